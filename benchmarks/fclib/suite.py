"""The suite `fclib`: which problems and solvers, and the tables and charts of what came out."""

from __future__ import annotations

import argparse
import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path

from rich.table import Table
from rich.text import Text

import gpx_lcp as gpx
from benchmarks.arguments import add_effort, add_filters, add_seed, add_tolerance, chosen
from benchmarks.fclib.baseline import read_baseline
from benchmarks.fclib.batches import AUTOMATIC, NAME, Line, ProblemBatch, problem_batch
from benchmarks.fclib.charts import accuracy_chart, profile_chart
from benchmarks.fclib.convergence import convergence_chart, histories
from benchmarks.fclib.problems import SHAKEN, find, own_problems, smallest_of_each_family
from benchmarks.fclib.scores import Scores
from benchmarks.fclib.tables import problem_table, ratio_table, remarks, solver_table
from benchmarks.interface import scientific
from benchmarks.records import Record

TOLERANCES = (1e-4, 1e-6, 1e-8, 1e-10)
QUICK_TOLERANCES = (1e-4, 1e-8)
REPEATS, QUICK_REPEATS = 5, 3
TIME_LIMIT, QUICK_TIME_LIMIT = 20.0, 2.0

# The exact law. Programs that approximate it solve another problem, so they run only where they are named.
FORMULATIONS = ("coulomb",)

# Where the results keep a copy of --baseline, for `plot` and `report`.
BASELINE = "baseline"

OWN_PROBLEMS = (
    "These are problems of our own, cubes and bricks at rest and with random velocities (Shaken...), written as FCLIB "
    "files and read back. They are no substitute for the collection, which --data names."
)


class Fclib:
    """The row of the suite in the table."""

    name = NAME
    summary = "FCLIB problem files, by every solver at several tolerances"
    not_shown = (
        "What this does not show: warm starts, which is how a simulation meets such problems; systems that carry their "
        "Jacobian and masses, on which some solvers are faster (a file holds A alone); several threads; other "
        "machines. Times are solve_seconds, without set-up and without Python, which are columns of the rows; on a "
        "shared machine they are good to 20-30 %. Solvers stop at their own limit of iterations, too. A problem that "
        "nobody solved stays in every share, and one problem can carry a mean of ratios: read it by family. "
        "'automatic' is gpx.solve with no solver named. A family is the leading letters of a file's name."
    )

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Add the suite's arguments."""
        add_filters(parser)
        parser.add_argument(
            "--data", type=Path, metavar="FOLDER", help="problems: every *.hdf5 below it (without: problems of our own)"
        )
        add_tolerance(parser, TOLERANCES, QUICK_TOLERANCES)
        add_effort(parser, (REPEATS, QUICK_REPEATS), (TIME_LIMIT, QUICK_TIME_LIMIT))
        add_seed(parser)
        parser.add_argument(
            "--baseline", type=Path, metavar="FILE", help="JSON of another library's times, drawn as peers (dashed)"
        )

    def scenes(self) -> Mapping[str, str]:
        """Return the problems of our own."""
        return {
            problem.name: "with random velocities" if problem.name.startswith(SHAKEN) else "at rest"
            for problem in own_problems()
        }

    def batches(self, asked: argparse.Namespace, folder: Path) -> Sequence[ProblemBatch]:
        """Return a batch for each problem."""
        _keep_baseline(asked.baseline, folder / BASELINE)
        problems = find(asked.data) if asked.data else own_problems()
        names = chosen([problem.name for problem in problems], asked.scene)
        problems = [problem for problem in problems if problem.name in names]
        if asked.quick and asked.scene is None:
            problems = smallest_of_each_family(problems)
        lines = lines_of(asked.solver, asked.formulation)
        usual = QUICK_TOLERANCES if asked.quick else TOLERANCES
        tolerances = tuple(dict.fromkeys(asked.tolerance or usual))
        repeats = asked.repeats or (QUICK_REPEATS if asked.quick else REPEATS)
        limit = asked.time_limit or (QUICK_TIME_LIMIT if asked.quick else TIME_LIMIT)
        seeds = tuple(dict.fromkeys(asked.seed or (0,)))
        return [
            problem_batch(problem, seed, lines, tolerances, repeats, limit)
            for problem in problems
            # Only the shaken ones of our own are random.
            for seed in (seeds if problem.path is None and problem.name.startswith(SHAKEN) else (0,))
            if lines
        ]

    def batch_tables(self, records: Sequence[Record]) -> Sequence[Table]:
        """Return nothing: a problem is one line of the table at the end."""
        return ()

    def tables(self, records: Sequence[Record], folder: Path) -> Sequence[Table | Text]:
        """Return the tables of problems, solvers and ratios, and what was unusual."""
        scores = _scores(records, folder)
        shown: list[Table | Text] = []
        if scores.subjects:
            shown += [problem_table(scores), solver_table(scores)]
            ratios = ratio_table(scores) if scores.baseline else None
            shown += [ratios] if ratios else []
        shown += [Text(remark, style="yellow") for remark in remarks(records)]
        if any(record.scene in self.scenes() for record in records):
            shown.append(Text(OWN_PROBLEMS, style="yellow"))
        if scores.baseline:
            shown.append(Text(_of_baseline(scores.baseline.name), style="dim"))
        return shown

    def draw(self, records: Sequence[Record], folder: Path, out: Path, footer: str) -> Sequence[Path]:
        """Draw time against accuracy, and a performance profile at each tolerance."""
        scores = _scores(records, folder)
        if not scores.subjects:
            return []
        footer = f"{footer}, cold starts, time limit {scores.time_limit:g} s, success judged by the certificate"
        if scores.baseline:
            footer += f"\n{_of_baseline(scores.baseline.name)}"
        paths = accuracy_chart(scores, footer, out / "speed-accuracy")
        paths += convergence_chart(scores, histories(scores, folder), footer, out / "convergence")
        for tolerance in scores.tolerances:
            paths += profile_chart(scores, tolerance, footer, out / f"profile-{scientific(tolerance)}")
        return paths


def lines_of(solvers: Sequence[str] | None, formulations: Sequence[str] | None) -> list[Line]:
    """Return who is to be run: for each formulation gpx.solve's own choice, and each installed solver of it."""
    lines: list[Line] = []
    for formulation in dict.fromkeys(formulations or FORMULATIONS):
        able = [row.name for row in gpx.solvers().values() if row.installed and formulation in row.programs]
        lines += [Line(name, formulation) for name in ([AUTOMATIC, *able] if able else [])]
    return [line for line in lines if solvers is None or line.solver in solvers]


def _scores(records: Sequence[Record], folder: Path) -> Scores:
    kept = sorted((folder / BASELINE).glob("*"))
    return Scores(records, read_baseline(kept[0]) if kept else None)


def _keep_baseline(path: Path | None, folder: Path) -> None:
    """Leave a copy of the baseline in the folder, and that of no earlier run; what is wrong with it is said now."""
    content = None
    if path is not None:
        read_baseline(path)
        content = path.read_bytes()
    shutil.rmtree(folder, ignore_errors=True)
    if path is not None and content is not None:
        folder.mkdir(parents=True)
        (folder / path.name).write_bytes(content)


def _of_baseline(name: str) -> str:
    return (
        f"Dashed: {name}, at the tolerances that it asked for. Its times come from another run, and perhaps another "
        "machine; its success is judged by the natural map that the file states."
    )

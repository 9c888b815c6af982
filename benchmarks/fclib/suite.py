"""`run fclib`: find the problems, try every solver on each, and print, write and draw what came out."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from fnmatch import fnmatchcase
from pathlib import Path

from rich.console import Console
from rich.text import Text

import gpx_lcp as gpx
from benchmarks import machine
from benchmarks.fclib.attempts import AUTOMATIC, UNREADABLE, Attempt, Line, Plan, rows_not_run, run_problem
from benchmarks.fclib.baseline import Baseline
from benchmarks.fclib.charts import accuracy_chart, profile_chart
from benchmarks.fclib.problems import ProblemFile, find, smallest_of_each_family, write_own
from benchmarks.fclib.scores import Scores
from benchmarks.fclib.tables import problem_table, ratio_table, remarks, solver_table
from benchmarks.interface import scientific
from benchmarks.pages import Pages
from benchmarks.rows import write_csv

NAME = "fclib"

TOLERANCES = (1e-4, 1e-6, 1e-8, 1e-10)
QUICK_TOLERANCES = (1e-4, 1e-8)

# The exact law. Programs that approximate it solve another problem, so they run only where they are named.
FORMULATIONS = ("coulomb",)

NOT_SHOWN = (
    "What this does not show: warm starts, which is how a simulation meets such problems; systems that carry their "
    "Jacobian and masses, on which some solvers are faster (a file holds A alone); several threads; other machines. "
    "Times are solve_seconds, without set-up and without Python, which are columns of rows.csv; on a shared machine "
    "they are good to 20-30 %. Solvers stop at their own limit of iterations, too. A problem that nobody solved stays "
    "in every share, and one problem can carry a mean of ratios: read it by family. 'automatic' is gpx.solve with "
    "no solver named. A family is the leading letters of a file's name."
)
OWN_PROBLEMS = (
    "No --data was given: these are problems of our own, cubes and bricks at rest and with random velocities "
    "(Shaken...), written as FCLIB files and read back. They are no substitute for the collection."
)


@dataclass(frozen=True)
class Request:
    """What the command line asked for.

    Parameters
    ----------
    data : Path or None
        None stands for the suite's own problems.
    solvers, formulations : sequences of str or None
        None stands for every solver, and for the exact law.
    problems : sequence of str or None
        Names, which may hold the wildcards * and ?; None stands for all.
    """

    data: Path | None
    solvers: Sequence[str] | None
    formulations: Sequence[str] | None
    problems: Sequence[str] | None
    baseline: Baseline | None
    plan: Plan
    quick: bool
    out: Path

    def lines(self) -> list[Line]:
        """Return who is to be run: for each formulation gpx.solve's own choice, and each installed solver of it."""
        lines: list[Line] = []
        for formulation in dict.fromkeys(self.formulations or FORMULATIONS):
            able = [row.name for row in gpx.solvers().values() if row.installed and formulation in row.programs]
            lines += [Line(name, formulation) for name in ([AUTOMATIC, *able] if able else [])]
        return [line for line in lines if self.solvers is None or line.solver in self.solvers]

    def choose(self, files: Sequence[ProblemFile]) -> list[ProblemFile]:
        """Return the problems that were asked for.

        Raises
        ------
        SettingsError
            When a name fits none.
        """
        if self.problems is None:
            return smallest_of_each_family(files) if self.quick else list(files)
        for pattern in self.problems:
            if not any(fnmatchcase(file.name, pattern) for file in files):
                raise gpx.SettingsError(f"--problem is {pattern}: there is none of that name among {len(files)} files")
        return [file for file in files if any(fnmatchcase(file.name, pattern) for pattern in self.problems)]


@dataclass
class Results:
    """What a run has measured so far, and the columns that say where."""

    where: Mapping[str, str]
    rows: list[Attempt] = field(default_factory=list)
    interrupted: bool = False

    @property
    def errors(self) -> int:
        """How many rows ended in an error, or in a file that cannot be read."""
        return sum(row.status in ("error", UNREADABLE) for row in self.rows)


def run_fclib(request: Request, console: Console) -> Results | None:
    """Run the suite; write rows, tables and charts to `request.out`, also when Ctrl-C cuts it short.

    Returns None, and says so, when no solver that was asked for can run.

    Raises
    ------
    SettingsError
        When there is no such folder, file or problem.
    """
    lines = request.lines()
    if not lines:
        console.print("[red]nothing to run:[/] no installed solver has such a name and formulation; see `list`.")
        return None
    where = {**machine.describe(), "measured_at": datetime.now(UTC).isoformat(timespec="seconds")}
    results, pages = Results(where), Pages(console)
    with tempfile.TemporaryDirectory(prefix="fclib-") as folder:
        if request.data is None:
            pages.show(Text(OWN_PROBLEMS, style="yellow"))
            write_own(Path(folder))
        problems = request.choose(find(request.data or Path(folder)))
        _measure(request, problems, lines, results, pages)
    footer = _footer(request, results)
    written = [request.out / "rows.csv", request.out / "tables.txt"]
    scores = Scores(results.rows, request.baseline)
    if scores.subjects:
        _show_tables(scores, pages)
        written += _draw(scores, footer, request.out)
    for remark in remarks(results.rows):
        pages.show(Text(remark, style="yellow"))
    for text in (footer, NOT_SHOWN):
        pages.show(Text(text, style="dim"))
    pages.write(request.out / "tables.txt")
    console.print("written: " + ", ".join(str(path) for path in written))
    if results.interrupted:
        console.print("[yellow]stopped by Ctrl-C: rows that were not measured say so.[/]")
    return results


def _measure(
    request: Request, problems: Sequence[ProblemFile], lines: Sequence[Line], results: Results, pages: Pages
) -> None:
    """Fill `results` problem by problem, writing each as it is done; Ctrl-C ends it early."""
    plan = request.plan
    done = 0

    def keep(rows: Sequence[Attempt]) -> None:
        nonlocal done
        done += 1
        results.rows += rows
        write_csv(request.out / "rows.csv", Attempt, results.rows, results.where)

    with pages.progress(len(problems) * len(lines) * len(plan.tolerances) * plan.repeats) as advance:
        try:
            for problem in problems:
                run_problem(problem, lines, plan, advance, keep)
        except KeyboardInterrupt:
            results.interrupted = True
            keep(rows_not_run(problems[done:], lines, plan))


def _show_tables(scores: Scores, pages: Pages) -> None:
    pages.show(problem_table(scores))
    pages.show(solver_table(scores))
    ratios = ratio_table(scores) if scores.baseline else None
    if ratios is not None:
        pages.show(ratios)


def _draw(scores: Scores, footer: str, out: Path) -> list[Path]:
    paths = accuracy_chart(scores, footer, out / "speed-accuracy")
    for tolerance in scores.tolerances:
        paths += profile_chart(scores, tolerance, footer, out / f"profile-{scientific(tolerance)}")
    return paths


def _footer(request: Request, results: Results) -> str:
    """Return versions, processor and limits of the run, and where the peers' times come from."""
    line = machine.version_line(
        results.where, "cold starts", f"time limit {request.plan.time_limit:g} s", "success judged by the certificate"
    )
    if request.baseline is None:
        return line
    return (
        f"{line}\nDashed: {request.baseline.name}, at the tolerances that it asked for. Its times come from another "
        "run, and perhaps another machine; its success is judged by the natural map that the file states."
    )

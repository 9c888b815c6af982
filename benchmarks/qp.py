"""The suite `qp`: every backend that solves convex programs, on the same programs that contact gives.

Frictionless contact is a QP, convex friction a QP over pyramids or a second-order cone program. A solver is judged by
the residual of the program that it was given, recomputed from its impulses, which is the same number for all; what the
convex program leaves out of Coulomb's law is in the certificate and no fault of the solver. gpx-lcp's own solvers of
the same programs stand beside the backends.
"""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.ticker import PercentFormatter
from rich.table import Table
from rich.text import Text

import gpx_lcp as gpx
from benchmarks.answers import file_recipe
from benchmarks.arguments import add_effort, add_filters, add_seed, add_tolerance, chosen
from benchmarks.attempts import COLD, ERROR, PROGRAM_RESIDUAL, REFUSED, Answer, Attempt, Outcome
from benchmarks.drawing import draw_legends, label_figure, panel_grid, plain_decades, save, title_panel
from benchmarks.fclib.problems import SHAKEN, ProblemFile, find, own_problems, own_system, smallest_of_each_family
from benchmarks.fclib.profiles import performance_ratios, profile, shifted_mean
from benchmarks.interface import Array, scientific
from benchmarks.machine import version_of
from benchmarks.records import Record
from benchmarks.style import PALETTE, SOLVERS, house_style
from benchmarks.tables import new_table
from formulations import DEFAULT_FACETS

NAME = "qp"
PROGRAMS = ("normal", "pyramid", "cone")
TITLES = {"normal": "Frictionless", "pyramid": "Friction pyramids", "cone": "Friction cones, convex"}
TOLERANCES, QUICK_TOLERANCES = (1e-4, 1e-6, 1e-8), (1e-6,)
REPEATS, QUICK_REPEATS = 3, 1
TIME_LIMIT, QUICK_TIME_LIMIT = 3.0, 1.0
# Added to every time before the geometric mean, s.
SHIFT = 1e-4
# Ratios beyond are not drawn.
FARTHEST = 1e5
# Colours of backends, in the order of the table of solvers.
MORE = tuple(PALETTE[name] for name in ("vermillion", "purple", "brown", "olive", "wine", "black"))
DASHES = ("--", "-.", ":")


@dataclass(frozen=True)
class ProgramBatch:
    """Every solver of one program at every tolerance on one problem; `path` is None for a problem of our own."""

    name: str
    path: Path | None
    seed: int
    attempts: Sequence[Attempt]
    repeats: int
    time_limit: float
    cases: Sequence[str] = (COLD,)

    def open(self) -> ProgramBench:
        """Read the file, or build the scene."""
        if self.path is None:
            system = own_system(self.name, self.seed)
            return ProgramBench(system, Answer(system, np.zeros_like(system.B)), self.time_limit)
        system = gpx.read_fclib(self.path)
        return ProgramBench(system, Answer(file_recipe(self.path), np.zeros_like(system.B)), self.time_limit)

    def only(self, attempts: Sequence[Attempt]) -> ProgramBatch:
        """Return the batch with these of its attempts."""
        return replace(self, attempts=attempts)


class ProgramBench:
    """A problem, and the answer with its system whose impulses are still to come."""

    def __init__(self, system: gpx.StackedSystem, answer: Answer, time_limit: float) -> None:
        self._system, self._answer, self._time_limit = system, answer, time_limit

    def try_once(self, attempt: Attempt, first: bool, seconds_left: float) -> Sequence[Outcome]:
        """Solve once; success is what the recomputed residual of the program says, in time."""
        tolerance, limit = attempt.tolerance, self._time_limit
        assert tolerance is not None
        tick = time.perf_counter()
        solution = gpx.solve(
            self._system, attempt.formulation, attempt.solver, tolerance=tolerance, time_limit=limit, presolve=False
        )
        call = time.perf_counter() - tick
        outcome = Outcome(
            step_seconds=(call,),
            setup_seconds=solution.setup_seconds,
            solve_seconds=solution.solve_seconds,
            status=solution.status.name.lower(),
        )
        if not first:
            return (outcome,)
        reached = solution.program_residual <= tolerance and call <= limit
        return (
            replace(
                outcome,
                method=solution.method,
                fallbacks=solution.fallbacks,
                contacts=self._system.contacts,
                iterations=solution.iterations,
                factorisations=solution.extras.get("factorisations"),
                certificate=solution.certificate,
                reached=reached,
                answer=replace(
                    self._answer,
                    impulse=solution.impulse,
                    program=solution.method.split("/")[0],
                    facets=DEFAULT_FACETS,
                    history=solution.history,
                ),
                figures={PROGRAM_RESIDUAL: solution.program_residual},
                again=reached,
            ),
        )


class Qp:
    """The row of the suite in the table."""

    name = NAME
    summary = "every QP and cone backend on the programs that contact gives"
    not_shown = (
        "What this does not show: what the convex programs leave out of Coulomb's law (the certificate's columns); "
        "warm starts; what a backend gains from settings other than its tolerances, which are set from the one asked "
        "for; other machines. Times are whole calls from Python, posing the program included, as users of a backend "
        "pay for it; without presolve. A program that nobody solved stays in every share."
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

    def scenes(self) -> Mapping[str, str]:
        """Return the problems of our own."""
        return {
            problem.name: "with random velocities" if problem.name.startswith(SHAKEN) else "at rest"
            for problem in own_problems()
        }

    def batches(self, asked: argparse.Namespace, folder: Path) -> Sequence[ProgramBatch]:
        """Return a batch for each problem and program."""
        problems = find(asked.data) if asked.data else own_problems()
        names = chosen([problem.name for problem in problems], asked.scene)
        problems = [problem for problem in problems if problem.name in names]
        if asked.quick and asked.scene is None:
            problems = smallest_of_each_family(problems)
        tolerances = tuple(dict.fromkeys(asked.tolerance or (QUICK_TOLERANCES if asked.quick else TOLERANCES)))
        repeats = asked.repeats or (QUICK_REPEATS if asked.quick else REPEATS)
        limit = asked.time_limit or (QUICK_TIME_LIMIT if asked.quick else TIME_LIMIT)
        seeds = tuple(dict.fromkeys(asked.seed or (0,)))
        return [
            ProgramBatch(problem.name, problem.path, seed, attempts, repeats, limit)
            for problem in problems
            for seed in (seeds if problem.path is None and problem.name.startswith(SHAKEN) else (0,))
            for program in PROGRAMS
            if asked.formulation is None or program in asked.formulation
            if (attempts := _attempts(problem, seed, program, tolerances, asked.solver))
        ]

    def batch_tables(self, records: Sequence[Record]) -> Sequence[Table]:
        """Return nothing: a problem is one count in the tables at the end."""
        return ()

    def tables(self, records: Sequence[Record], folder: Path) -> Sequence[Table | Text]:
        """Return a table for each program, and what was unusual."""
        tables: list[Table | Text] = [_table(program, found) for program, found in _programs(records).items()]
        errors = {f"{r.solver}: {r.status}: {r.message}" for r in records if r.status in (ERROR, REFUSED)}
        return [*tables, *(Text(error, style="yellow") for error in sorted(errors))]

    def draw(self, records: Sequence[Record], folder: Path, out: Path, footer: str) -> Sequence[Path]:
        """Draw a performance profile for each tolerance, a panel for each program."""
        found = _programs(records)
        if not found:
            return []
        footer = f"{footer}, cold, whole calls, success judged by the program's own residual"
        with house_style():
            return [
                path
                for tolerance in sorted({row.tolerance for row in records if row.tolerance}, reverse=True)
                for path in _chart(found, tolerance, footer, out / f"profile-{scientific(tolerance)}")
            ]


def able(program: str) -> list[str]:
    """Return the installed solvers of a convex program."""
    # Of the same name, but another program: the LCP over pyramids, which lets sliding contacts stay closed.
    other = {"lemke", "pgs"} if program == "pyramid" else set()
    rows = gpx.solvers().values()
    return [row.name for row in rows if row.installed and program in row.programs and row.name not in other]


def _attempts(
    problem: ProblemFile, seed: int, program: str, tolerances: Sequence[float], solvers: Sequence[str] | None
) -> list[Attempt]:
    return [
        Attempt(
            suite=NAME,
            scene=problem.name,
            solver=solver,
            formulation=program,
            setting=f"tolerance {scientific(tolerance)}",
            effort=-math.log10(tolerance),
            tolerance=tolerance,
            engine_version=version_of("gpx-lcp"),
            seed=seed,
        )
        for solver in able(program)
        if solvers is None or solver in solvers
        for tolerance in tolerances
    ]


def _programs(records: Sequence[Record]) -> dict[str, list[Record]]:
    found = {program: [row for row in records if row.formulation == program] for program in PROGRAMS}
    return {program: rows for program, rows in found.items() if rows}


def _seconds(row: Record) -> float:
    return row.step_seconds if row.reached and row.step_seconds is not None else math.inf


def _table(program: str, rows: Sequence[Record]) -> Table:
    table = new_table(f"{TITLES[program]}: problems solved, and the shifted geometric mean of their times, ms")
    table.add_column("solver")
    tolerances = sorted({row.tolerance for row in rows if row.tolerance}, reverse=True)
    for tolerance in tolerances:
        table.add_column(f"at {scientific(tolerance)}", justify="right", no_wrap=True)
        table.add_column("ms", justify="right", no_wrap=True)
    for solver in dict.fromkeys(row.solver for row in rows):
        cells = []
        for tolerance in tolerances:
            tried = [_seconds(row) for row in rows if (row.solver, row.tolerance) == (solver, tolerance)]
            solved = [seconds for seconds in tried if math.isfinite(seconds)]
            cells += [f"{len(solved)} of {len(tried)}", f"{1e3 * shifted_mean(solved, SHIFT):.3g}" if solved else ""]
        table.add_row(solver, *cells)
    return table


def _strokes(records: Sequence[Record]) -> dict[str, dict[str, str]]:
    """Return how each solver's line is drawn: of colours beyond the solvers' own, dashes tell neighbours apart."""
    spare = zip(MORE * len(records), DASHES * len(records), strict=False)
    strokes: dict[str, dict[str, str]] = {}
    for name in dict.fromkeys(row.solver for row in records):
        colour, dash = (SOLVERS[name], "-") if name in SOLVERS else next(spare)
        strokes[name] = {"color": colour, "linestyle": dash}
    return strokes


def _chart(found: Mapping[str, Sequence[Record]], tolerance: float, footer: str, stem: Path) -> list[Path]:
    figure, panels, legend, axes = panel_grid(len(found), 4.6, 4.6)
    strokes = _strokes([row for rows in found.values() for row in rows])
    farthest = 10.0
    for ax, (program, rows) in zip(axes, found.items(), strict=True):
        here = [row for row in rows if row.tolerance == tolerance]
        problems = list(dict.fromkeys((row.scene, row.seed) for row in here))
        solvers = list(dict.fromkeys(row.solver for row in here))
        times = {(row.scene, row.seed, row.solver): _seconds(row) for row in here}
        table = np.array([[times.get((*problem, solver), math.inf) for solver in solvers] for problem in problems])
        ratios = performance_ratios(table)
        farthest = max(farthest, float(np.max(ratios, where=np.isfinite(ratios), initial=1.0)))
        for solver, column in zip(solvers, ratios.T, strict=True):
            _draw_profile(ax, column, strokes[solver])
        title_panel(ax, TITLES[program], f"{len(problems)} problems")
    for ax in axes:
        ax.set_xscale("log")
        ax.set_xlim(0.93, min(FARTHEST, 10.0 ** math.ceil(math.log10(farthest))))
        ax.set_ylim(-0.02, 1.03)
        ax.yaxis.set_major_formatter(PercentFormatter(1.0))
        plain_decades(ax.xaxis)
    draw_legends(legend, [("solver", [(Line2D([], [], **stroke), name) for name, stroke in strokes.items()])])
    label_figure(
        figure,
        panels,
        "wall time / that of the fastest solver on the problem",
        "share of the problems solved within it",
        f"Convex programs of contact, to {scientific(tolerance)}",
        footer,
    )
    return save(figure, stem)


def _draw_profile(ax: Axes, ratios: Array, stroke: Mapping[str, str]) -> None:
    tau, share = profile(ratios)
    ax.step([1.0, *tau, FARTHEST], [0.0, *share, share[-1] if share.size else 0.0], where="post", **stroke)

"""Runs attempts: every line at every tolerance on one problem, repeats interleaved, one row each, failures too."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace

import gpx_lcp as gpx
from benchmarks.fclib.problems import ProblemFile, rank_ratio
from benchmarks.interface import scientific
from benchmarks.runner import failure, no_collection

# gpx.solve without a solver named: what a user gets who does not choose.
AUTOMATIC = "automatic"

# The clock's own step, s: nothing is said to take less.
TICK = time.get_clock_info("perf_counter").resolution

UNREADABLE, INTERRUPTED = "unreadable", "interrupted"


@dataclass(frozen=True)
class Line:
    """A solver with the program that it is asked to solve."""

    solver: str
    formulation: str

    @property
    def label(self) -> str:
        """The solver's name, and the program's where it is not the exact law."""
        return self.solver if self.formulation == "coulomb" else f"{self.solver} ({self.formulation})"


@dataclass(frozen=True)
class Plan:
    """How much is run.

    Parameters
    ----------
    repeats : int
        Solutions of each attempt, interleaved: every attempt on a problem once, then each again. An attempt that misses
        its tolerance is not repeated, and a further repeat starts only when another like the last one fits into the
        time limit.
    time_limit : float
        For one solution, s; more than this is a failure, whatever was reached.
    """

    tolerances: Sequence[float]
    repeats: int
    time_limit: float


@dataclass(frozen=True)
class Attempt:
    """A row: one line at one tolerance on one problem.

    Parameters
    ----------
    status : str
        The solver's own word; or "unreadable" (the file), "refused", "error", "interrupted".
    reached : bool
        Whether `natural_map`, of the certificate, is within the tolerance and the solution within the time limit.
    solve_seconds, setup_seconds, call_seconds : float
        Medians over the repeats: as the solution states them, and the whole call from outside.
    solve_seconds_low, solve_seconds_high : float
        Fastest and slowest repeat.
    rank_ratio : float
        Rows of A / rank of A.
    natural_map, cone_violation, ..., sliding_angle : float
        The certificate of the impulses; see `gpx_lcp.certify`.
    """

    problem: str
    family: str
    solver: str
    formulation: str
    tolerance: float
    time_limit: float
    status: str
    message: str = ""
    reached: bool = False
    dimension: int | None = None
    contacts: int | None = None
    rank_ratio: float | None = None
    method: str = ""
    fallbacks: str = ""
    iterations: int | None = None
    repeats: int = 0
    solve_seconds: float | None = None
    solve_seconds_low: float | None = None
    solve_seconds_high: float | None = None
    setup_seconds: float | None = None
    call_seconds: float | None = None
    natural_map: float | None = None
    cone_violation: float | None = None
    penetration_velocity: float | None = None
    complementarity: float | None = None
    dissipation: float | None = None
    sliding_angle: float | None = None

    @property
    def line(self) -> Line:
        """Who tried."""
        return Line(self.solver, self.formulation)


@dataclass
class Trials:
    """Every repeat of an attempt; what the first one found stands for all, as solvers are deterministic."""

    row: Attempt
    solutions: list[tuple[float, float, float]] = field(default_factory=list)

    def wants_more(self, plan: Plan) -> bool:
        """Whether another repeat is due."""
        if not self.solutions:
            return self.row.status == INTERRUPTED
        calls = [call for _, _, call in self.solutions]
        return self.row.reached and len(calls) < plan.repeats and sum(calls) + calls[-1] <= plan.time_limit

    def result(self) -> Attempt:
        """Return the row with the times of its repeats."""
        if not self.solutions:
            return self.row
        solve, setup, call = zip(*self.solutions, strict=True)
        return replace(
            self.row,
            repeats=len(solve),
            solve_seconds=max(statistics.median(solve), TICK),
            solve_seconds_low=min(solve),
            solve_seconds_high=max(solve),
            setup_seconds=statistics.median(setup),
            call_seconds=statistics.median(call),
        )


def run_problem(
    problem: ProblemFile,
    lines: Sequence[Line],
    plan: Plan,
    advance: Callable[[str], None],
    keep: Callable[[Sequence[Attempt]], None],
) -> None:
    """Run every line on one problem and hand the rows to `keep`, also those that Ctrl-C leaves unfinished.

    `advance(text)` is called once for each line, tolerance and repeat.
    """
    trials = [Trials(row) for row in rows_not_run([problem], lines, plan)]
    try:
        try:
            system = gpx.read_fclib(problem.path)
        except Exception as error:
            # A broken file is a row, and the others go on.
            unreadable = Attempt(problem.name, problem.family, "", "", 0.0, plan.time_limit, UNREADABLE, str(error))
            trials = [Trials(unreadable)]
            return
        ratio = rank_ratio(system)
        for trial in trials:
            trial.row = replace(trial.row, dimension=system.rows, contacts=system.contacts, rank_ratio=ratio)
        for _ in range(plan.repeats):
            for trial in trials:
                row = trial.row
                advance(f"{problem.name}: {row.line.label} {scientific(row.tolerance)}")
                if trial.wants_more(plan):
                    _try_once(trial, system)
    finally:
        keep([trial.result() for trial in trials])


def rows_not_run(problems: Iterable[ProblemFile], lines: Sequence[Line], plan: Plan) -> list[Attempt]:
    """Return the rows of problems before, or without, any attempt."""
    return [
        Attempt(problem.name, problem.family, line.solver, line.formulation, tolerance, plan.time_limit, INTERRUPTED)
        for problem in problems
        for line in lines
        for tolerance in plan.tolerances
    ]


def _try_once(trial: Trials, file: gpx.StackedSystem) -> None:
    """Solve once; a refusal or a failure becomes the attempt's status, never an exception of the harness."""
    row = trial.row
    # A system of its own for each attempt: what one caches is not there for the next.
    system = gpx.StackedSystem(file.A, file.B, file.friction)
    solver = None if row.solver == AUTOMATIC else row.solver
    try:
        with no_collection():
            tick = time.perf_counter()
            solution = gpx.solve(system, row.formulation, solver, tolerance=row.tolerance, time_limit=row.time_limit)
            call = time.perf_counter() - tick
        certificate = solution.certificate
    except Exception as error:
        status, message = failure(error)
        trial.row = replace(row, status=status, message=message, reached=False)
        return
    trial.solutions.append((solution.solve_seconds, solution.setup_seconds, call))
    if len(trial.solutions) > 1:
        return
    trial.row = replace(
        row,
        status=solution.status.name.lower(),
        reached=certificate.natural_map <= row.tolerance and call <= row.time_limit,
        method=solution.method,
        fallbacks=" ".join(solution.fallbacks),
        iterations=solution.iterations,
        natural_map=certificate.natural_map,
        cone_violation=certificate.cone_violation,
        penetration_velocity=certificate.penetration_velocity,
        complementarity=certificate.complementarity,
        dissipation=certificate.dissipation,
        sliding_angle=certificate.sliding_angle,
    )

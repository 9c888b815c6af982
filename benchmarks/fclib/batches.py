"""What the suite measures: one problem with every line at every tolerance is a batch."""

from __future__ import annotations

import math
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import gpx_lcp as gpx
from benchmarks.answers import file_recipe
from benchmarks.attempts import COLD, Answer, Attempt, FileRecipe, Outcome
from benchmarks.fclib.problems import ProblemFile, own_system, rank_ratio
from benchmarks.interface import scientific
from benchmarks.machine import version_of
from formulations import DEFAULT_FACETS

NAME = "fclib"

# gpx.solve without a solver named: what a user gets who does not choose.
AUTOMATIC = "automatic"


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
class ProblemBatch:
    """Every line at every tolerance on one problem.

    Parameters
    ----------
    path : Path or None
        The problem's file; None for a problem of our own, which is made from its name.
    seed : int
        Of the velocities of such a one.
    """

    name: str
    family: str
    path: Path | None
    seed: int
    attempts: Sequence[Attempt]
    repeats: int
    time_limit: float

    @property
    def cases(self) -> Sequence[str]:
        """Solved from nothing, as a file holds no impulses to start from."""
        return (COLD,)

    def open(self) -> ProblemBench:
        """Read the file. A problem of our own is written as one first, so that both go the same way."""
        if self.path is not None:
            return ProblemBench(self, gpx.read_fclib(self.path), file_recipe(self.path))
        with tempfile.TemporaryDirectory(prefix="fclib-") as folder:
            path = Path(folder) / "problem.hdf5"
            gpx.write_fclib(path, own_system(self.name, self.seed))
            system = gpx.read_fclib(path)
        return ProblemBench(self, system, system)

    def only(self, attempts: Sequence[Attempt]) -> ProblemBatch:
        """Return the batch with these of its attempts."""
        return replace(self, attempts=attempts)


def problem_batch(
    problem: ProblemFile, seed: int, lines: Sequence[Line], tolerances: Sequence[float], repeats: int, limit: float
) -> ProblemBatch:
    """Return the batch of one problem."""
    attempts = [
        Attempt(
            suite=NAME,
            scene=problem.name,
            solver=line.solver,
            formulation=line.formulation,
            setting=f"tolerance {scientific(tolerance)}",
            effort=-math.log10(tolerance),
            tolerance=tolerance,
            engine_version=version_of("gpx-lcp"),
            seed=seed,
        )
        for line in lines
        for tolerance in tolerances
    ]
    return ProblemBatch(problem.name, problem.family, problem.path, seed, attempts, repeats, limit)


class ProblemBench:
    """A problem that was read."""

    def __init__(self, batch: ProblemBatch, system: gpx.StackedSystem, kept: gpx.StackedSystem | FileRecipe) -> None:
        self._batch, self._file, self._kept = batch, system, kept
        self._figures = {"family": batch.family, "dimension": system.rows, "rank_ratio": rank_ratio(system)}

    def try_once(self, attempt: Attempt, first: bool, seconds_left: float) -> Sequence[Outcome]:
        """Solve once; success is what the certificate says, in time."""
        # A system of its own for each trial: what one caches is not there for the next.
        system = gpx.StackedSystem(self._file.A, self._file.B, self._file.friction)
        solver = None if attempt.solver == AUTOMATIC else attempt.solver
        tolerance = attempt.tolerance
        assert tolerance is not None
        limit = self._batch.time_limit
        tick = time.perf_counter()
        solution = gpx.solve(system, attempt.formulation, solver, tolerance=tolerance, time_limit=limit)
        call = time.perf_counter() - tick
        outcome = Outcome(
            step_seconds=(call,),
            setup_seconds=solution.setup_seconds,
            solve_seconds=solution.solve_seconds,
            status=solution.status.name.lower(),
        )
        if not first:
            return (outcome,)
        certificate = solution.certificate
        reached = certificate.natural_map <= tolerance and call <= limit
        return (
            replace(
                outcome,
                method=solution.method,
                fallbacks=solution.fallbacks,
                contacts=system.contacts,
                iterations=solution.iterations,
                factorisations=solution.extras.get("factorisations"),
                certificate=certificate,
                reached=reached,
                answer=Answer(
                    self._kept, solution.impulse, solution.method.split("/")[0], DEFAULT_FACETS, solution.history
                ),
                figures={**self._figures, "time_limit": limit},
                again=reached,
            ),
        )

"""What the suite measures: a scene stepped from nothing and from the last impulses, with and without presolve."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace

import gpx_lcp as gpx
from benchmarks.attempts import COLD, Answer, Attempt, Outcome
from benchmarks.machine import version_of
from benchmarks.presolve.scenes import SCENES

NAME = "presolve"
STEPPED = "stepped"
TIME_STEP = 1 / 240
# What exact methods are asked for, and what sweeps can mostly reach.
TOLERANCE, SWEPT_TOLERANCE = 1e-8, 1e-4

AS_ASKED, REDUCED, THREADED = "as asked", "presolved", "presolved, threads"
SETTINGS = (AS_ASKED, REDUCED, THREADED)


@dataclass(frozen=True)
class SceneBatch:
    """Every setting of every solver on one scene."""

    name: str
    attempts: Sequence[Attempt]
    repeats: int
    time_limit: float
    steps: int

    @property
    def cases(self) -> Sequence[str]:
        """Steps in a row, each from no impulses, and each from those of the last."""
        return (COLD, STEPPED)

    def open(self) -> SceneBench:
        """Build the scene, and take the steps before."""
        return SceneBench(self)

    def only(self, attempts: Sequence[Attempt]) -> SceneBatch:
        """Return the batch with these of its attempts."""
        return replace(self, attempts=attempts)


def tolerance_of(solver: str) -> float:
    """Return what a solver is asked for."""
    return SWEPT_TOLERANCE if solver == "pgs" else TOLERANCE


def formulation_of(solver: str, scene: str) -> str | None:
    """Return what a solver is asked on a scene; None where it solves no isotropic law that the scene is about."""
    programs = gpx.solvers()[solver].programs
    if "coulomb" in programs:
        return "coulomb"
    law = "normal" if SCENES[scene].frictionless else "cone"
    return law if law in programs else None


def scene_batch(
    name: str, solvers: Sequence[str], formulations: Sequence[str] | None, steps: int, repeats: int, limit: float
) -> SceneBatch:
    """Return the batch of a scene: those of the solvers that solve one of the formulations, if any are named."""
    attempts = [
        Attempt(
            suite=NAME,
            scene=name,
            solver=solver,
            formulation=formulation,
            setting=setting,
            effort=float(SETTINGS.index(setting)),
            tolerance=tolerance_of(solver),
            engine_version=version_of("gpx-lcp"),
        )
        for solver in solvers
        if (formulation := formulation_of(solver, name)) and formulation in (formulations or (formulation,))
        for setting in _settings(solver, name)
    ]
    return SceneBatch(name, attempts, repeats, limit, steps)


def _settings(solver: str, scene: str) -> Sequence[str]:
    return SETTINGS if SCENES[scene].threads > 1 and _takes_threads(solver) else SETTINGS[:2]


def _takes_threads(solver: str) -> bool:
    return "threads" in (gpx.solvers()[solver].defaults or ())


class SceneBench:
    """A scene, and a world of it for each setting; all go on from the same state."""

    def __init__(self, batch: SceneBatch) -> None:
        self._batch = batch
        self._scene = SCENES[batch.name]
        before = gpx.World(self._scene.make(), TIME_STEP)
        before.step(self._scene.steps_before)
        self._start = before.snapshot()

    def _world(self, attempt: Attempt, warm_start: bool) -> gpx.World:
        threads = self._scene.threads if attempt.setting == THREADED else 1
        world = gpx.World(
            self._scene.make(),
            TIME_STEP,
            solver=attempt.solver,
            # Without friction Coulomb's law is stepped as the frictionless one, unless it is named.
            formulation=None if attempt.formulation == "coulomb" else attempt.formulation,
            tolerance=tolerance_of(attempt.solver),
            presolve=attempt.setting != AS_ASKED,
            warm_start=warm_start,
            **({"threads": threads} if _takes_threads(attempt.solver) else {}),
        )
        world.restore(self._start)
        return world

    def try_once(self, attempt: Attempt, first: bool, seconds_left: float) -> Sequence[Outcome]:
        """Take steps from nothing, and from the last one in another world."""
        outcomes = []
        for case, warm_start in ((COLD, False), (STEPPED, True)):
            world = self._world(attempt, warm_start)
            # The first steps of a world fill its memory, and find the loads of what rests.
            world.step(5)
            outcomes.append(_outcome(case, world, *self._times(world, first)))
        return outcomes

    def _times(self, world: gpx.World, first: bool) -> tuple[list[float], float | None]:
        """Return the time of each step and, of the first trial, how many iterations one took on average.

        Making a Solution takes ten times as long as a small step and leaves the caches to others: the trials that are
        timed take their steps in a row.
        """
        times, iterations = [], 0
        for _ in range(self._batch.steps):
            self._scene.change(world)
            tick = time.perf_counter()
            world.step()
            times.append(time.perf_counter() - tick)
            if first:
                assert world.solution is not None
                iterations += world.solution.iterations or 0
        return times, iterations / self._batch.steps if first else None


def _outcome(case: str, world: gpx.World, times: Sequence[float], iterations: float | None) -> Outcome:
    solution = world.solution
    assert solution is not None
    report, system = solution.presolve, solution.system
    after = None if report is None else report.after
    removed = "" if report is None else ", ".join(reduction.name for reduction in report.reductions)
    return Outcome(
        step_seconds=times,
        setup_seconds=solution.setup_seconds,
        solve_seconds=solution.solve_seconds,
        case=case,
        status=solution.status.name.lower(),
        method=solution.method,
        fallbacks=solution.fallbacks,
        bodies=len(world.bodies),
        contacts=system.contacts,
        steps_asked=len(times),
        iterations=solution.iterations,
        factorisations=solution.extras.get("factorisations"),
        certificate=solution.certificate,
        reached=solution.status is gpx.Status.SOLVED,
        answer=Answer(system, solution.impulse, solution.method.split("/")[0]),
        figures={
            "islands": 1 if report is None else report.islands,
            "rows_left": system.contacts * system.rows if after is None else after.rows,
            "velocities_left": system.jacobian.shape[1] if after is None and system.jacobian is not None else None,
            "reductions": removed,
            "mean_iterations": iterations,
        }
        | ({} if after is None else {"velocities_left": after.velocities}),
    )

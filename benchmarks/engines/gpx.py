"""gpx-lcp itself, through its public names only: a `World` with every installed solver."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import gpx_lcp as gpx
from benchmarks.interface import Array, Contacts, Motion, Setting, StepFacts, SystemAnswer, scientific
from benchmarks.machine import version_of

# How accurate each solver is asked to be, by (solver, formulation); a name alone stands for its other formulations. An
# iterative method buys accuracy with time, so it gets a ladder; a direct one, and a QP backend, which converges fast or
# not at all, has one point.
TOLERANCES: Mapping[str | tuple[str, str], tuple[float, ...]] = {
    ("pgs", "coulomb"): (1e-1, 1e-2, 1e-3, 1e-4, 1e-6),
    "pgs": (1e-2, 1e-4),
    "lemke": (1e-9,),
    ("newton", "coulomb"): (1e-3, 1e-6, 1e-10),
    "interior_point": (1e-10,),
    "osqp": (1e-3, 1e-6),
}
BACKEND_TOLERANCES = (1e-6,)

QUICK: Mapping[str | tuple[str, str], tuple[float, ...]] = {
    ("pgs", "coulomb"): (1e-2, 1e-6),
    ("newton", "coulomb"): (1e-10,),
    "lemke": (1e-9,),
    "interior_point": (1e-10,),
    "osqp": (1e-3,),
}


class GpxLcp:
    """The row of gpx-lcp in the table of engines."""

    name = "gpx-lcp"
    install = "make setup"
    note = "every installed solver with every formulation it solves; its own step natively, backends from Python"

    def version(self) -> str:
        """Return the installed version."""
        return version_of("gpx-lcp")

    def settings(self, quick: bool) -> Sequence[Setting]:
        """Return each installed solver with each formulation that it solves, at each tolerance.

        A solver that is not the core's own is asked for the first step alone: following it would measure Python.
        """
        ladder, others = (QUICK, ()) if quick else (TOLERANCES, BACKEND_TOLERANCES)
        return [
            replace(
                self._setting(
                    row.name, formulation, f"tolerance {scientific(tolerance)}", -math.log10(tolerance), tolerance
                ),
                first_step_only=row.native is None,
            )
            for row in gpx.solvers().values()
            if row.installed
            for formulation in row.programs
            for tolerance in ladder.get((row.name, formulation), ladder.get(row.name, others))
        ]

    def sweeping(self, sweeps: int) -> Sequence[Setting]:
        """Return block projected Gauss-Seidel with exactly so many sweeps: its tolerance is out of reach.

        Over all contacts and without momentum, as the peers sweep.
        """
        effort = {"iterations": sweeps, "acceleration": False, "presolve": False}
        return [
            self._setting("pgs", formulation, f"{sweeps} sweeps", sweeps, 1e-15, **effort)
            for formulation in ("coulomb", "box", "normal")
        ]

    def simulate(self, scene: gpx.Scene, time_step: float, setting: Setting, time_limit: float) -> GpxSimulation:
        """Put the scene into a `World`."""
        return GpxSimulation(scene, time_step, setting, time_limit)

    def answer(self, system: gpx.StackedSystem, setting: Setting, time_limit: float) -> SystemAnswer:
        """Call `gpx.solve`."""
        start = time.perf_counter()
        solution = gpx.solve(system, setting.formulation, setting.solver, time_limit=time_limit, **setting.options)
        return SystemAnswer(solution.impulse, time.perf_counter() - start, _facts(solution))

    def _setting(
        self, solver: str, formulation: str, label: str, effort: float, tolerance: float, **options: Any
    ) -> Setting:
        return Setting(self.name, solver, formulation, label, effort, {"tolerance": tolerance, **options})


class GpxSimulation:
    """A scene in a `World`."""

    def __init__(self, scene: gpx.Scene, time_step: float, setting: Setting, time_limit: float) -> None:
        self._world = gpx.World(
            scene,
            time_step=time_step,
            solver=setting.solver,
            formulation=setting.formulation,
            time_limit=time_limit,
            **setting.options,
        )

    def set_gravity(self, gravity: Array) -> None:
        """Set the acceleration of free fall for the next steps."""
        self._world.gravity = gravity

    def step(self) -> None:
        """Advance by one time step."""
        self._world.step()

    def motion(self) -> Motion:
        """Return where the moving bodies are now."""
        return Motion(self._world.positions, self._world.orientations, self._world.velocities)

    def contacts(self) -> Contacts:
        """Return the contacts and impulses of the last step."""
        found = self._world.contacts
        return reported(found, found.force * self._world.time_step)

    def facts(self) -> StepFacts:
        """Return what the solution says."""
        solution = self._world.solution
        return StepFacts() if solution is None else _facts(solution)

    def close(self) -> None:
        """Nothing to free."""


def _facts(solution: gpx.Solution) -> StepFacts:
    return StepFacts(
        status=solution.status.name.lower(),
        method=solution.method,
        fallbacks=solution.fallbacks,
        iterations=solution.iterations,
        factorisations=solution.extras.get("factorisations"),
        setup_seconds=solution.setup_seconds,
        solve_seconds=solution.solve_seconds,
    )


def reported(found: gpx.Contacts, impulse: Array) -> Contacts:
    """Return contacts of a world with impulses on body b, (n, 3) N s, in the world's frame."""
    return Contacts(
        body_a=found.body_a,
        body_b=found.body_b,
        point_a=found.point,
        point_b=found.point,
        normal=found.normal,
        gap=found.gap,
        friction=found.friction,
        impulse=impulse,
    )

"""Pinocchio: its contact solvers, ADMM and projected Gauss-Seidel, on our stacked systems.

Pinocchio simulates no scenes of free bodies, so of a scene only the first step is compared, by the system of
`World.system()`. Only the call of the solver is timed: collision detection, stacking, the matrix A and its copy into
Pinocchio's operator come free.

* ADMM solves the exact Coulomb problem (`solve_ncp`) on the sparse operator, which is the faster of the two here.
* PGS takes the dense operator alone, and crashes the process on a wall of 10 rows (400 contacts): larger systems than
  300 contacts are refused.
* Without friction PGS calls itself converged after its first sweep, whatever is left.
* A system without contacts crashes the process, too, and is refused.
* Tolerances are absolute, on velocities of m/s and impulses of N s; the relative ones are set to 0. Iterations end at
  10 000, and no limit of time can be set.
"""

from __future__ import annotations

import importlib
import math
import time
from collections.abc import Sequence
from functools import cache
from typing import Any

import numpy as np
import scipy.sparse as sp

import gpx_lcp as gpx
from benchmarks.bodies import Bodies
from benchmarks.engines.gpx import reported
from benchmarks.interface import Array, Contacts, Motion, Setting, StepFacts, SystemAnswer, scientific
from benchmarks.machine import version_of
from benchmarks.measures import predicted_velocity

MOST_CONTACTS = {"ADMM": 2000, "PGS": 300}
MAX_ITERATIONS = 10_000
# What ADMM is asked for where it is to be careful: at 1e-12 it often ends at its limit of iterations.
CAREFUL = 1e-8


class Pinocchio:
    """Pinocchio's row in the table of engines."""

    name = "pinocchio"
    install = "pip install pin"
    note = "its contact solvers alone, on our stacked systems: first step only, and only the solver's call is timed"

    def version(self) -> str:
        """Return the installed version, or "" when it is missing."""
        return version_of("pin")

    def settings(self, quick: bool) -> Sequence[Setting]:
        """Return ADMM and PGS by tolerance."""
        ladder = {"ADMM": (1e-8,)} if quick else {"ADMM": (1e-4, 1e-8, 1e-12), "PGS": (1e-3, 1e-6)}
        return [
            Setting(
                self.name,
                solver,
                "coulomb",
                f"tolerance {scientific(tolerance)}",
                -math.log10(tolerance),
                {"tolerance": tolerance},
                first_step_only=True,
                careful=tolerance == CAREFUL,
            )
            for solver, tolerances in ladder.items()
            for tolerance in tolerances
        ]

    def sweeping(self, sweeps: int) -> Sequence[Setting]:
        """Return none: its PGS takes A as a dense matrix, whose sweeps are not the others'."""
        return []

    def simulate(self, scene: gpx.Scene, time_step: float, setting: Setting, time_limit: float) -> PinocchioStep:
        """Stack the system of the first step; Pinocchio's solvers cannot be limited in time."""
        return PinocchioStep(scene, time_step, setting)

    def answer(self, system: gpx.StackedSystem, setting: Setting, time_limit: float) -> SystemAnswer:
        """Solve a system from nothing; Pinocchio's solvers cannot be limited in time."""
        solver = PinocchioSolver(system, setting)
        start = time.perf_counter()
        solver.solve()
        seconds = time.perf_counter() - start
        return SystemAnswer(solver.impulse.reshape(-1, system.rows), seconds, solver.facts())


class PinocchioSolver:
    """One of Pinocchio's solvers with a stacked system put into its form.

    Its cones have three rows, tangent, tangent, normal; rows that our contacts lack are rows of zeros, in which no
    impulse has an effect, and g = -B.
    """

    def __init__(self, system: gpx.StackedSystem, setting: Setting) -> None:
        self._api = api = _load()
        self.method = f"coulomb/{setting.solver}"
        n, rows = system.contacts, system.rows
        if n > (most := MOST_CONTACTS[setting.solver]):
            raise gpx.SettingsError(f"{n} contacts: {setting.solver} of Pinocchio is run up to {most}")
        if n == 0:
            raise gpx.SettingsError("no contacts: Pinocchio's solvers crash the process on an empty system")
        # The place of each of our rows, normal first, in Pinocchio's system, normal last; its indices have 32 bits.
        self._place = (3 * np.arange(n)[:, None] + np.array([2, 0, 1])[:rows]).ravel().astype(np.int32)
        A = sp.coo_array(system.A)
        lifted = sp.coo_array((A.data, (self._place[A.coords[0]], self._place[A.coords[1]])), shape=(3 * n, 3 * n))
        self._free = np.zeros(3 * n)
        self._free[self._place] = -system.B
        model = api.Model()
        model.addJoint(0, api.JointModelFreeFlyer(), api.SE3.Identity(), "body")
        self._models, self._datas = api.StdVec_ConstraintModel(), api.StdVec_ConstraintData()
        # The solver takes only the friction from these; where the points are is in A.
        for friction in system.friction:
            contact = api.PointContactConstraintModel(model, 0, api.SE3.Identity(), 1, api.SE3.Identity())
            contact.setFriction(friction)
            constraint = api.ConstraintModel(contact)
            self._models.append(constraint)
            self._datas.append(constraint.createData())
        if setting.solver == "ADMM":
            self._operator = api.DelassusOperatorSparse(sp.csc_matrix(lifted))
        else:
            self._operator = api.DelassusOperatorDense(lifted.toarray())
        self._solver = getattr(api, f"{setting.solver}ConstraintSolver")(3 * n)
        self._result = getattr(api, f"{setting.solver}SolverResult")()
        self._settings = options = getattr(api, f"{setting.solver}SolverSettings")()
        options.max_iterations = MAX_ITERATIONS
        options.absolute_feasibility_tol = options.absolute_complementarity_tol = setting.options["tolerance"]
        options.relative_feasibility_tol = options.relative_complementarity_tol = 0.0
        self._converged: bool | None = None

    def solve(self) -> None:
        """Solve the system."""
        self._converged = self._solver.solve(
            self._operator, self._free, self._models, self._datas, self._settings, self._result
        )

    @property
    def solved(self) -> bool:
        """Whether there is an answer."""
        return self._converged is not None

    @property
    def impulse(self) -> Array:
        """The impulses, normal first, of all contacts in a row, N s; zero before there is an answer."""
        found = self._result.retrieveConstraintImpulses() if self.solved else np.zeros(self._free.size)
        impulse: Array = found[self._place]
        return impulse

    def facts(self) -> StepFacts:
        """Return the solver's word and count."""
        status = "solved" if self._converged else "max_iterations"
        return StepFacts(status=status, method=self.method, iterations=self._result.iterations)


class PinocchioStep:
    """The first step of a scene."""

    def __init__(self, scene: gpx.Scene, time_step: float, setting: Setting) -> None:
        self._bodies, self._time_step = Bodies.from_scene(scene), time_step
        self._world = gpx.World(scene, time_step)
        self._solver = PinocchioSolver(self._world.system(), setting)

    def set_gravity(self, gravity: Array) -> None:
        """Refuse: the system is stacked when the simulation is made."""
        raise gpx.SettingsError("Pinocchio's solvers are compared on the first step alone")

    def step(self) -> None:
        """Solve the system."""
        self._solver.solve()

    def motion(self) -> Motion:
        """Return the start, and after the step the velocities that the impulses give."""
        start = self._bodies.start
        if not self._solver.solved:
            return start
        contacts = self.contacts()
        velocity = predicted_velocity(self._bodies, start, contacts, self._time_step)
        return Motion(start.position + self._time_step * velocity[:, :3], start.orientation, velocity)

    def contacts(self) -> Contacts:
        """Return our contacts with Pinocchio's impulses."""
        found = self._world.contacts
        impulse = self._solver.impulse.reshape(found.gap.size, -1)
        return reported(found, np.einsum("cr,crd->cd", impulse, found.frame[:, : impulse.shape[1]]))

    def facts(self) -> StepFacts:
        """Return the solver's word and count."""
        return self._solver.facts()

    def close(self) -> None:
        """Nothing to free."""


@cache
def _load() -> Any:
    return importlib.import_module("pinocchio")

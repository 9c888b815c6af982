"""Pinocchio: its contact solvers, ADMM and projected Gauss-Seidel, on our stacked systems.

Pinocchio simulates no scenes of free bodies, so only the first step is compared, and only the call of the solver is
timed: collision detection, stacking, the matrix A and its copy into Pinocchio's operator come free. What it solves is
the system of `World.system()`, with its rows moved so that the normal comes last, as Pinocchio has it, and g = -B.

* ADMM solves the exact Coulomb problem (`solve_ncp`) on the sparse operator, which is the faster of the two here.
* PGS takes the dense operator alone, and crashes the process on a wall of 10 rows (400 contacts): larger systems than
  300 contacts are refused.
* Tolerances are absolute, on velocities of m/s and impulses of N s; the relative ones are set to 0. Iterations end at
  10 000.
"""

from __future__ import annotations

import importlib
import math
from collections.abc import Sequence
from functools import cache
from typing import Any

import numpy as np
import scipy.sparse as sp

import gpx_lcp as gpx
from benchmarks.bodies import Bodies
from benchmarks.engines.gpx import reported
from benchmarks.interface import Array, Contacts, Motion, Setting, StepFacts, scientific
from benchmarks.machine import version_of
from benchmarks.measures import predicted_velocity

MOST_CONTACTS = {"ADMM": 2000, "PGS": 300}
MAX_ITERATIONS = 10_000


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


class PinocchioStep:
    """The first step of a scene."""

    def __init__(self, scene: gpx.Scene, time_step: float, setting: Setting) -> None:
        self._api = api = _load()
        self._bodies, self._time_step = Bodies.from_scene(scene), time_step
        self._method = f"coulomb/{setting.solver}"
        self._world = gpx.World(scene, time_step)
        system = self._world.system()
        count = len(system.friction)
        if count > (most := MOST_CONTACTS[setting.solver]):
            raise gpx.SettingsError(f"{count} contacts: {setting.solver} of Pinocchio is run up to {most}")
        # Normal last: the rows of Pinocchio's cone are tangent, tangent, normal.
        self._order = np.roll(np.arange(system.B.size).reshape(count, 3), -1, axis=1).ravel()
        A = sp.csc_matrix(system.A)[self._order][:, self._order]
        self._free = -np.asarray(system.B)[self._order]
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
            self._operator = api.DelassusOperatorSparse(sp.csc_matrix(A))
        else:
            self._operator = api.DelassusOperatorDense(A.toarray())
        self._solver = getattr(api, f"{setting.solver}ConstraintSolver")(system.B.size)
        self._result = getattr(api, f"{setting.solver}SolverResult")()
        self._settings = options = getattr(api, f"{setting.solver}SolverSettings")()
        options.max_iterations = MAX_ITERATIONS
        options.absolute_feasibility_tol = options.absolute_complementarity_tol = setting.options["tolerance"]
        options.relative_feasibility_tol = options.relative_complementarity_tol = 0.0
        self._converged: bool | None = None

    def set_gravity(self, gravity: Array) -> None:
        """Refuse: the system is stacked when the simulation is made."""
        raise gpx.SettingsError("Pinocchio's solvers are compared on the first step alone")

    def step(self) -> None:
        """Solve the system."""
        self._converged = self._solver.solve(
            self._operator, self._free, self._models, self._datas, self._settings, self._result
        )

    def motion(self) -> Motion:
        """Return the start, and after the step the velocities that the impulses give."""
        start = self._bodies.start
        if self._converged is None:
            return start
        contacts = self.contacts()
        velocity = predicted_velocity(self._bodies, start, contacts, self._time_step)
        return Motion(start.position + self._time_step * velocity[:, :3], start.orientation, velocity)

    def contacts(self) -> Contacts:
        """Return our contacts with Pinocchio's impulses."""
        found = self._world.contacts
        impulse = np.zeros(self._order.size)
        if self._converged is not None:
            impulse[self._order] = self._result.retrieveConstraintImpulses()
        return reported(found, np.einsum("cr,crd->cd", impulse.reshape(-1, 3), found.frame))

    def facts(self) -> StepFacts:
        """Return the solver's word and count."""
        status = "solved" if self._converged else "max_iterations"
        return StepFacts(status=status, method=self._method, iterations=self._result.iterations)

    def close(self) -> None:
        """Nothing to free."""


@cache
def _load() -> Any:
    return importlib.import_module("pinocchio")

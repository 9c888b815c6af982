"""Bullet, through pybullet: sequential impulse and the two MLCP solvers, set so that the comparison is fair.

What pybullet 3.2.7 does behind one's back, each undone below (measured with this file's own figures; Bullet is double
precision in the wheels):

1. `createMultiBody` makes Featherstone multibodies, whose rows are slower and get no contact warm start, with 0.04
   linear and angular damping: `useMaximalCoordinates=1`, both dampings 0.
2. Friction and restitution of a pair are the *products* of the two bodies' values: each body is given the square root.
3. pybullet lowers Bullet's own defaults (warmStartingFactor 0.1 instead of 0.85, contactERP 0.08 instead of 0.2):
   Bullet's own are restored, except in the setting "as shipped".
4. solverResidualThreshold 1e-7 stops the sweeps early: 0, so that the sweeps asked for are the sweeps made.
5. contactSlop 1e-5 m lets a resting body fall at slop/dt in the first step and stays as overlap: 0.
6. splitImpulsePenetrationThreshold -0.04 keeps split impulse off, so the push that undoes an overlap adds energy: 0.
7. restitutionVelocityThreshold 0.2 m/s drops slow bounces: 0.
8. GEOM_PLANE under a box yields one contact, then two, never four: the ground is a box whose top is the plane.
9. MLCP solvers fail on redundant contacts unless globalCFM > 0, and then fall back to sequential impulse silently:
   every Dantzig setting has a globalCFM, and its first step is compared, bit for bit, with sequential impulse.
10. Whether Dantzig succeeds depends on the order of the pairs. With deterministicOverlappingPairs and the ground added
    first it solves the first step of every stack of this suite; without either it falls back on all of them, whatever
    globalCFM is (seen through 9).
11. Only constraintSolverType 1 (SI), 2 (MLCP-PGS) and 3 (MLCP-Dantzig) exist; others silently keep the previous solver.
12. Bodies fall asleep: turned off.
13. Contacts are reported with two friction impulses, along axes turned into the slip. Together with the normal impulse
    they explain the engine's velocities to rounding (`Measures.unexplained`), so they are its whole answer.
14. Of more than some 79 000 contacts, those beyond come back as zeros: such a step cannot be judged.
15. On a pyramid of 5 050 boxes, 20 000 contacts, every MLCP solver crashes the process; on thousands of falling balls
    they fall back. They are not asked on large scenes.
"""

from __future__ import annotations

import ctypes
import importlib
import math
import os
import sys
from collections.abc import Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np

import gpx_lcp as gpx
from benchmarks.engines.rebuild import box_of
from benchmarks.interface import Array, Contacts, GaveUp, Motion, Setting, StepFacts, scientific
from benchmarks.machine import version_of

SOLVER_TYPES = {"SI": 1, "MLCP-PGS": 2, "MLCP-Dantzig": 3}

# Quirks 3 to 7 and 10.
FAIR = {
    "warmStartingFactor": 0.85,
    "contactERP": 0.2,
    "erp": 0.2,
    "frictionERP": 0.2,
    "solverResidualThreshold": 0.0,
    "contactSlop": 0.0,
    "useSplitImpulse": 1,
    "splitImpulsePenetrationThreshold": 0.0,
    "restitutionVelocityThreshold": 0.0,
    "deterministicOverlappingPairs": 1,
}


class PyBullet:
    """pybullet's row in the table of engines."""

    name = "pybullet"
    install = (
        "pip install pybullet==3.2.7 under CPython 3.11 on Linux: there are no wheels for a later Python. "
        "`python3.11 -m venv .venv` before `make setup` gives it."
    )
    note = "Bullet 3, double precision, rigid bodies; split impulse on, damping and sleeping off"

    def version(self) -> str:
        """Return the installed version, or "" when pybullet is missing or cannot be loaded."""
        return version_of("pybullet")

    def settings(self, quick: bool) -> Sequence[Setting]:
        """Return sweeps of sequential impulse and of MLCP-PGS, Dantzig by regularisation, and pybullet as shipped."""
        sweeps = (50, 1000) if quick else (10, 50, 200, 1000, 3000)
        regularisations = (1e-9,) if quick else (1e-9, 1e-12, 1e-15)
        settings = [self._setting("SI", f"{count} sweeps", count, count, FAIR) for count in sweeps]
        # Dantzig pivots; its sweeps are those of the fallback.
        settings += [
            self._setting(
                "MLCP-Dantzig",
                f"globalCFM {scientific(cfm)}",
                -math.log10(cfm),
                50,
                {**FAIR, "globalCFM": cfm},
            )
            for cfm in regularisations
        ]
        if not quick:
            settings += [self._setting("MLCP-PGS", f"{count} sweeps", count, count, FAIR) for count in (50, 1000)]
            settings.append(self._setting("SI (as shipped)", "50 sweeps", 50, 50, {}))
        return settings

    def sweeping(self, sweeps: int) -> Sequence[Setting]:
        """Return sequential impulse with exactly so many sweeps."""
        return [self._setting("SI", f"{sweeps} sweeps", sweeps, sweeps, FAIR)]

    def simulate(self, scene: gpx.Scene, time_step: float, setting: Setting, time_limit: float) -> PyBulletSimulation:
        """Build the scene in a physics server of its own; a step of Bullet cannot be limited in time."""
        simulation = PyBulletSimulation(scene, time_step, setting)
        if setting.options["constraintSolverType"] != SOLVER_TYPES["SI"]:
            simulation.fallback = _first_step_of_fallback(scene, time_step, setting)
        return simulation

    def _setting(self, solver: str, label: str, effort: float, sweeps: int, parameters: dict[str, Any]) -> Setting:
        kind = SOLVER_TYPES[solver.split()[0]]
        options = {"numSolverIterations": sweeps, "constraintSolverType": kind, **parameters}
        # Bullet bounds the two friction rows of a contact apart, each by μ times the normal impulse: a box.
        return Setting(self.name, solver, "box", label, effort, options, not_large=kind != SOLVER_TYPES["SI"])


class PyBulletSimulation:
    """A scene in one physics server.

    Attributes
    ----------
    fallback : (n, 3) array or None
        The impulses that sequential impulse gives in the first step. Where an MLCP solver gives the same to the last
        bit, it has silently fallen back (quirk 9).
    """

    def __init__(self, scene: gpx.Scene, time_step: float, setting: Setting) -> None:
        self._api = _load()
        self._time_step = time_step
        self._solver = setting.solver
        self.fallback: Array | None = None
        self._steps = 0
        with _quiet():
            self._server = self._api.connect(self._api.DIRECT)
            self._api.setPhysicsEngineParameter(
                fixedTimeStep=time_step, numSubSteps=1, physicsClientId=self._server, **setting.options
            )
        self._api.setGravity(*scene.gravity, physicsClientId=self._server)
        # Fixed bodies first: Dantzig fails when the ground comes last (quirk 10).
        self._body = {self._add(body): body for body in (*scene.fixed, *scene.bodies)}
        self._count = len(scene.bodies)

    def set_gravity(self, gravity: Array) -> None:
        """Set the acceleration of free fall for the next steps."""
        self._api.setGravity(*gravity, physicsClientId=self._server)

    def step(self) -> None:
        """Advance by one time step."""
        self._api.stepSimulation(physicsClientId=self._server)
        self._steps += 1

    def motion(self) -> Motion:
        """Return where the moving bodies are now."""
        count = self._count
        position, orientation, velocity = np.empty((count, 3)), np.empty((count, 4)), np.empty((count, 6))
        for unique, body in self._body.items():
            if (index := body.index) >= 0:
                place, turn = self._api.getBasePositionAndOrientation(unique, physicsClientId=self._server)
                linear, angular = self._api.getBaseVelocity(unique, physicsClientId=self._server)
                position[index], velocity[index] = place, (*linear, *angular)
                orientation[index] = turn[3], *turn[:3]  # x, y, z, w to w, x, y, z
        return Motion(position, orientation, velocity)

    def contacts(self) -> Contacts:
        """Return the contacts and impulses of the last step; Bullet's normal points from its body B to its body A."""
        points = self._api.getContactPoints(physicsClientId=self._server)
        pairs = [(self._body[point[2]], self._body[point[1]]) for point in points]
        index = np.array([(a.index, b.index) for a, b in pairs], dtype=np.int64).reshape(-1, 2)
        # Columns: point on A, point on B, normal, distance, normal force, friction force and axis, twice.
        table = np.array([_flat(point[5:14]) for point in points])
        table = table.reshape(-1, 19)
        normal = table[:, 6:9]
        told = np.count_nonzero(normal.any(axis=1))
        if told < len(points):
            raise GaveUp(f"pybullet tells {told} of {len(points)} contacts; the others are zeros")
        force = normal * table[:, 10:11] + table[:, 12:15] * table[:, 11:12] + table[:, 16:19] * table[:, 15:16]
        return Contacts(
            body_a=index[:, 0],
            body_b=index[:, 1],
            point_a=table[:, 3:6],
            point_b=table[:, 0:3],
            normal=normal,
            gap=table[:, 9],
            friction=np.array([math.sqrt(a.material.friction * b.material.friction) for a, b in pairs]),
            impulse=force * self._time_step,
        )

    def facts(self) -> StepFacts:
        """Return which solver ran; Bullet tells no status and no count of sweeps."""
        if self.fallback is None or self._steps > 1:
            return StepFacts(method=self._solver)
        fell_back = np.array_equal(self.contacts().impulse, self.fallback)
        return StepFacts(method="SI" if fell_back else self._solver, fallbacks=("SI",) if fell_back else ())

    def close(self) -> None:
        """Shut the physics server down."""
        self._api.disconnect(physicsClientId=self._server)

    def _add(self, body: gpx.Body) -> int:
        """Add a body; return Bullet's number for it."""
        api, server = self._api, self._server
        _require_what_bullet_has(body)
        if isinstance(body.shape, gpx.Sphere):
            position, orientation = body.position, body.orientation
            shape = api.createCollisionShape(api.GEOM_SPHERE, radius=body.shape.radius, physicsClientId=server)
        else:
            half_sides, position, orientation = box_of(body)
            shape = api.createCollisionShape(api.GEOM_BOX, halfExtents=half_sides, physicsClientId=server)
        w, x, y, z = orientation
        unique = api.createMultiBody(
            0.0 if body.index < 0 else body.mass,
            shape,
            -1,
            position,
            (x, y, z, w),
            useMaximalCoordinates=1,
            physicsClientId=server,
        )
        api.changeDynamics(
            unique,
            -1,
            lateralFriction=math.sqrt(body.material.friction),
            restitution=math.sqrt(body.material.elasticity - 1.0),
            rollingFriction=0.0,
            spinningFriction=0.0,
            linearDamping=0.0,
            angularDamping=0.0,
            activationState=api.ACTIVATION_STATE_DISABLE_SLEEPING,
            physicsClientId=server,
        )
        if body.index >= 0:
            # Bullet takes the inertia from the shape; told otherwise for a rigid body, it answers with NaN.
            inertia = np.diag(api.getDynamicsInfo(unique, -1, physicsClientId=server)[2])
            if not np.allclose(inertia, body.inertia, rtol=1e-9, atol=0.0):
                raise gpx.SettingsError(
                    f"the inertia of {body.name} is not its shape's at uniform density, as Bullet has it"
                )
            api.resetBaseVelocity(unique, body.velocity, body.angular_velocity, physicsClientId=server)
        return int(unique)


def _require_what_bullet_has(body: gpx.Body) -> None:
    """Raise SettingsError for a body that this adapter cannot rebuild without changing the problem."""
    if not isinstance(body.shape, gpx.Box | gpx.Sphere | gpx.HalfSpace):
        kind = type(body.shape).__name__
        raise gpx.SettingsError(f"{body.name} is a {kind}: only boxes, spheres and half-spaces are rebuilt")
    if body.material.friction_rule != "geometric_mean":
        raise gpx.SettingsError(
            f"{body.name} combines friction by {body.material.friction_rule}: Bullet has the product alone, "
            "which square roots make the geometric mean"
        )


def _first_step_of_fallback(scene: gpx.Scene, time_step: float, setting: Setting) -> Array:
    """Return the impulses of the first step by sequential impulse, with every other parameter as in the setting."""
    options = {**setting.options, "constraintSolverType": SOLVER_TYPES["SI"]}
    with closing(PyBulletSimulation(scene, time_step, replace(setting, options=options))) as twin:
        twin.step()
        return twin.contacts().impulse


def _flat(values: Sequence[Any]) -> list[float]:
    return [number for value in values for number in (value if isinstance(value, tuple) else (value,))]


@cache
def _load() -> Any:
    with _quiet():
        return importlib.import_module("pybullet")


@contextmanager
def _quiet() -> Iterator[None]:
    """Send what Bullet's C code prints (its build time, each change of solver) nowhere, not into the tables.

    C keeps its own buffers, so they are flushed on both sides of the detour.
    """
    flush = ctypes.CDLL(None).fflush
    sys.stdout.flush()
    sys.stderr.flush()
    flush(None)
    kept = os.dup(1), os.dup(2)
    nowhere = os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nowhere, 1)
        os.dup2(nowhere, 2)
        yield
        flush(None)
    finally:
        for place, original in enumerate(kept, start=1):
            os.dup2(original, place)
            os.close(original)
        os.close(nowhere)

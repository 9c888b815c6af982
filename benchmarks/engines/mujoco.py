"""MuJoCo: Newton, CG and PGS on soft contacts, with the elliptic and the pyramidal cone, stiff and as shipped.

What MuJoCo 4.0 does behind one's back, and what is done about it here:

1. Contacts are soft: at solref "0.02 1", solimp "0.9 0.95 ..." stacks sink by millimetres. Its `refsafe` clamps the
   time constant to 2 dt, so "stiff" is solref "2 dt, 1", solimp "0.99 0.9999 0.0001 0.5 2". The settings "as shipped"
   keep what MuJoCo comes with.
2. The default cone is a pyramid inscribed in the friction cone, μ/√2 at 45°. Both cones are run.
3. Friction of a pair is the maximum of the two geoms', with torsion and rolling beside it: "μ 0 0", condim 3.
4. impratio 1 makes friction as soft as the normal direction, and boxes creep: stiff settings take 10.
5. A blow-up resets the simulation by itself: turned off, so that it is seen; warnings become the status.
6. There is no coefficient of restitution: scenes that bounce are refused.
7. Sleeping is opt-in and stays off. Newton starts from the last acceleration, and at rest ends after 0 or 1 iterations.
8. The contact points and forces after a step are those that the step solved. The impulses explain its velocities,
   friction included, to rounding from PGS, and from Newton and CG, which work on velocities, as far as they converged
   (`Measures.unexplained`).
"""

from __future__ import annotations

import importlib
import math
from collections.abc import Sequence
from functools import cache
from typing import Any

import numpy as np

import gpx_lcp as gpx
from benchmarks.bodies import rotation_matrices
from benchmarks.engines.rebuild import half_space_turn, one_friction, require_shapes
from benchmarks.interface import Array, Contacts, Motion, Setting, StepFacts, scientific
from benchmarks.machine import version_of

# solimp: dmin, dmax, width (m), midpoint, power.
STIFF_IMPEDANCE = (0.99, 0.9999, 0.0001, 0.5, 2.0)
STIFF = {"stiff": True, "impratio": 10.0}

# The program that each cone poses: both are convex and let sliding contacts open.
PROGRAMS = {"cone": "elliptic", "pyramid": "pyramidal"}

# Bytes for contacts and their Jacobian, per body: MuJoCo's own estimate is short for thousands of free bodies.
ARENA_PER_BODY = 200_000


class MuJoCo:
    """MuJoCo's row in the table of engines."""

    name = "mujoco"
    install = "pip install mujoco"
    note = "soft contacts, stiff (time constant 2 dt) and as shipped; elliptic and pyramidal cone; sleeping off"

    def version(self) -> str:
        """Return the installed version, or "" when it is missing."""
        return version_of("mujoco")

    def settings(self, quick: bool) -> Sequence[Setting]:
        """Return Newton and CG by tolerance, PGS by iterations, stiff; and Newton as shipped."""
        programs = ("cone",) if quick else ("cone", "pyramid")
        newton, conjugate, sweeps = ((1e-8,), (), (100,)) if quick else ((1e-6, 1e-10), (1e-6, 1e-10), (20, 100))
        settings = [
            self._setting(solver, program, f"tolerance {scientific(tolerance)}", -math.log10(tolerance), tolerance, 300)
            for program in programs
            for solver, tolerances in (("Newton", newton), ("CG", conjugate))
            for tolerance in tolerances
        ]
        settings += [
            self._setting("PGS", program, f"{count} iterations", count, 0.0, count)
            for program in programs
            for count in sweeps
        ]
        if not quick:
            shipped = {"tolerance": 1e-8, "iterations": 100}
            settings += [
                Setting(self.name, "Newton (as shipped)", program, "tolerance 1e-8", 8.0, shipped)
                for program in programs
            ]
        return settings

    def sweeping(self, sweeps: int) -> Sequence[Setting]:
        """Return PGS with exactly so many iterations."""
        return [self._setting("PGS", program, f"{sweeps} iterations", sweeps, 0.0, sweeps) for program in PROGRAMS]

    def simulate(self, scene: gpx.Scene, time_step: float, setting: Setting, time_limit: float) -> MuJoCoSimulation:
        """Compile the scene into a model; a step of MuJoCo cannot be limited in time."""
        return MuJoCoSimulation(scene, time_step, setting)

    def _setting(
        self, solver: str, program: str, label: str, effort: float, tolerance: float, iterations: int
    ) -> Setting:
        options = {**STIFF, "tolerance": tolerance, "iterations": iterations}
        return Setting(self.name, solver, program, label, effort, options)


class MuJoCoSimulation:
    """A scene in a model of its own."""

    def __init__(self, scene: gpx.Scene, time_step: float, setting: Setting) -> None:
        self._api = api = _load()
        self._time_step = time_step
        self._method = f"{setting.formulation}/{setting.solver}"
        require_shapes(scene, "MuJoCo")
        self._friction = one_friction(scene, "MuJoCo")
        spec = api.MjSpec()
        _set_options(api, spec, time_step, setting)
        spec.option.gravity = scene.gravity
        spec.memory = max(2**24, ARENA_PER_BODY * len(scene.bodies))
        stiff = setting.options.get("stiff", False)
        for body in (*scene.fixed, *scene.bodies):
            self._add(spec, body, time_step if stiff else None)
        self._model = spec.compile()
        self._data = api.MjData(self._model)
        # Body 0 is the world; geoms of fixed bodies hang on it.
        self._index = self._model.geom_bodyid - 1
        self._rest = self._data.qvel.reshape(-1, 6)
        for body in scene.bodies:
            turn = rotation_matrices(body.orientation[None])[0]
            self._rest[body.index] = *body.velocity, *(turn.T @ body.angular_velocity)

    def set_gravity(self, gravity: Array) -> None:
        """Set the acceleration of free fall for the next steps."""
        self._model.opt.gravity = gravity

    def step(self) -> None:
        """Advance by one time step."""
        self._api.mj_step(self._model, self._data)

    def motion(self) -> Motion:
        """Return where the moving bodies are now; MuJoCo turns free bodies in their own frame."""
        pose = self._data.qpos.reshape(-1, 7)
        velocity = self._data.qvel.reshape(-1, 6).copy()
        orientation = pose[:, 3:].copy()
        velocity[:, 3:] = np.einsum("bij,bj->bi", rotation_matrices(orientation), velocity[:, 3:])
        return Motion(pose[:, :3].copy(), orientation, velocity)

    def contacts(self) -> Contacts:
        """Return the contacts and impulses of the last step, whose normals point from the first geom to the second."""
        found = self._data.contact
        count = self._data.ncon
        frames = found.frame.reshape(count, 3, 3).copy()
        force = np.zeros((count, 6))
        for row in range(count):
            self._api.mj_contactForce(self._model, self._data, row, force[row])
        geoms = self._index[found.geom.reshape(count, 2)]
        point = found.pos.reshape(count, 3).copy()
        return Contacts(
            body_a=geoms[:, 0].astype(np.int64),
            body_b=geoms[:, 1].astype(np.int64),
            point_a=point,
            point_b=point,
            normal=frames[:, 0],
            gap=found.dist.reshape(count).copy(),
            friction=np.full(count, self._friction),
            impulse=np.einsum("crd,cr->cd", frames, force[:, :3]) * self._time_step,
        )

    def facts(self) -> StepFacts:
        """Return iterations, and MuJoCo's warnings as the status."""
        data = self._data
        kinds = self._api.mjtWarning
        warnings = [kinds(kind).name for kind in range(int(kinds.mjNWARNING)) if data.warning[kind].number]
        islands = max(1, min(data.nisland, data.solver_niter.size))
        return StepFacts(
            status=" ".join(warnings) or "ran", method=self._method, iterations=int(data.solver_niter[:islands].max())
        )

    def close(self) -> None:
        """Nothing to free: MuJoCo's memory goes with the object."""

    def _add(self, spec: Any, body: gpx.Body, stiff_step: float | None) -> None:
        """Add a body with its geom; stiff for steps of `stiff_step` seconds, or as shipped."""
        api, shape = self._api, body.shape
        kind = {
            gpx.Box: api.mjtGeom.mjGEOM_BOX,
            gpx.Sphere: api.mjtGeom.mjGEOM_SPHERE,
            gpx.HalfSpace: api.mjtGeom.mjGEOM_PLANE,
        }[type(shape)]  # type: ignore[index]
        # A plane of size zero has no edge.
        size = np.zeros(3)
        size[2] = 1.0
        if not isinstance(shape, gpx.HalfSpace):
            numbers = shape.numbers()  # type: ignore[union-attr]
            size[: len(numbers)] = numbers
        turn = half_space_turn(body) if isinstance(shape, gpx.HalfSpace) else body.orientation
        if body.index < 0:
            parent, place = spec.worldbody, {"pos": body.position, "quat": turn}
        else:
            parent, place = spec.worldbody.add_body(pos=body.position, quat=turn), {}
            parent.add_freejoint()
            parent.explicitinertial = True
            parent.mass, parent.inertia, parent.ipos = body.mass, np.diag(body.inertia), np.zeros(3)
        geom = parent.add_geom(type=kind, size=size, condim=3, friction=(self._friction, 0.0, 0.0), **place)
        if stiff_step is not None:
            geom.solref = (2.0 * stiff_step, 1.0)
            geom.solimp = STIFF_IMPEDANCE


def _set_options(api: Any, spec: Any, time_step: float, setting: Setting) -> None:
    solver, cone = setting.solver.split()[0], PROGRAMS[setting.formulation]
    option = spec.option
    option.timestep = time_step
    option.solver = getattr(api.mjtSolver, f"mjSOL_{solver.upper()}")
    option.cone = getattr(api.mjtCone, f"mjCONE_{cone.upper()}")
    option.tolerance = setting.options["tolerance"]
    option.iterations = setting.options["iterations"]
    option.impratio = setting.options.get("impratio", 1.0)
    option.disableflags = option.disableflags | int(api.mjtDisableBit.mjDSBL_AUTORESET)


@cache
def _load() -> Any:
    return importlib.import_module("mujoco")

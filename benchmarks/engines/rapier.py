"""Rapier, through rapier3d: small steps of one sweep each, on contact springs, in single precision.

What rapier3d 0.36 does behind one's back, and what is done about it here:

1. It computes in f32: loads are good to about 1e-5 at best, and positions to 1e-7 of their size.
2. Contacts are springs of 30 Hz (60 Hz against fixed bodies) with 5 mm of allowed overlap, so that a tower of 30 sinks
   by centimetres: "small steps" has 240 Hz and 480 Hz, "stiffer" 60 Hz and 120 Hz times the number of small steps, and
   "as shipped" keeps what Rapier comes with. More small steps on springs of the same stiffness help little.
3. Bodies fall asleep: `can_sleep(False)` for each. Gravity is zero unless given.
4. Friction is the mean of the two colliders'. The usual model has one row of friction for each patch, not for each
   point, and reports no friction impulse: `contacts` gives normal impulses alone, and `Measures.unexplained` shows
   what friction did beside them.
5. The distance that a contact reports can be an older one (contacts are recycled at rest): the gap is measured between
   the two points on the surfaces, after the step.
6. The wheel is a parallel build: RAYON_NUM_THREADS=1 keeps it on one thread (`set_num_threads(1)` would cost 12 µs a
   step); see benchmarks/__init__.py.
"""

from __future__ import annotations

import importlib
from collections.abc import Sequence
from functools import cache
from typing import Any

import numpy as np

import gpx_lcp as gpx
from benchmarks.engines.rebuild import one_friction, require_shapes
from benchmarks.interface import Array, Contacts, Motion, Setting, StepFacts
from benchmarks.machine import version_of

# Natural frequency of contacts between moving bodies, Hz; twice that against fixed ones. Twice as stiff for the number
# of small steps, stacks shake themselves apart (measured: tower of 30, wall of 10, 4 to 40 small steps).
STIFF = 240.0
STIFFEST_PER_SMALL_STEP = 60.0


class Rapier:
    """Rapier's row in the table of engines."""

    name = "rapier"
    install = "pip install rapier3d"
    note = "single precision, spring contacts, stiff (240 Hz) and as shipped; sleeping off; reports normal impulses"

    def version(self) -> str:
        """Return the installed version, or "" when it is missing."""
        return version_of("rapier3d")

    def settings(self, quick: bool) -> Sequence[Setting]:
        """Return the small steps of one sweep by their number, stiff; as stiff as they bear; and Rapier as shipped."""
        if quick:
            return [self._setting("small steps", 4, STIFF)]
        return [
            *(self._setting("small steps", count, STIFF) for count in (4, 8, 20)),
            *(self._setting("small steps, stiffer", count, STIFFEST_PER_SMALL_STEP * count) for count in (8, 20, 40)),
            self._setting("small steps (as shipped)", 4, None),
        ]

    def sweeping(self, sweeps: int) -> Sequence[Setting]:
        """Return none: its iterations are small steps, each with an integration of its own."""
        return []

    def simulate(self, scene: gpx.Scene, time_step: float, setting: Setting, time_limit: float) -> RapierSimulation:
        """Build the scene in a world of its own; a step of Rapier cannot be limited in time."""
        return RapierSimulation(scene, time_step, setting)

    def _setting(self, solver: str, count: int, stiffness: float | None) -> Setting:
        options = {"num_solver_iterations": count, "stiffness": stiffness}
        return Setting(self.name, solver, "cone", f"{count} small steps", count, options)


class RapierSimulation:
    """A scene in a world of its own."""

    def __init__(self, scene: gpx.Scene, time_step: float, setting: Setting) -> None:
        self._api = api = _load()
        self._time_step = time_step
        require_shapes(scene, "Rapier")
        self._friction = one_friction(scene, "Rapier")
        self._world = world = api.PhysicsWorld(gravity=scene.gravity.tolist())
        parameters = world.integration_parameters
        parameters.dt = time_step
        parameters.num_solver_iterations = setting.options["num_solver_iterations"]
        if (stiffness := setting.options["stiffness"]) is not None:
            parameters.contact_softness = api.SpringCoefficients(stiffness, parameters.contact_softness.damping_ratio)
            parameters.static_contact_softness = api.SpringCoefficients(
                2.0 * stiffness, parameters.static_contact_softness.damping_ratio
            )
        for body in scene.fixed:
            world.add_collider(self._placed(body))
        self._handles = [self._add(body) for body in scene.bodies]
        self._index = {handle: body.index for handle, body in zip(self._handles, scene.bodies, strict=True)}

    def set_gravity(self, gravity: Array) -> None:
        """Set the acceleration of free fall for the next steps."""
        self._world.gravity = gravity.tolist()

    def step(self) -> None:
        """Advance by one time step."""
        self._world.step()

    def motion(self) -> Motion:
        """Return where the moving bodies are now."""
        bodies = [self._world.rigid_bodies[handle] for handle in self._handles]
        return Motion(
            position=np.array([body.translation.to_tuple() for body in bodies], dtype=np.float64),
            orientation=np.array([_numbers(body.rotation) for body in bodies]),
            velocity=np.array([(*body.linvel.to_tuple(), *body.angvel.to_tuple()) for body in bodies]),
        )

    def contacts(self) -> Contacts:
        """Return the contacts and normal impulses of the last step."""
        bodies = self._world.rigid_bodies
        pairs, points, normals, impulses = [], [], [], []
        for pair in self._world.narrow_phase.contact_pairs():
            for manifold in pair.manifolds:
                data = manifold.data
                index = self._index.get(data.rigid_body1, -1), self._index.get(data.rigid_body2, -1)
                normal, known = data.normal.to_tuple(), manifold.points
                for contact in data.solver_contacts:
                    one, two = data.solver_contact_world_points(contact, bodies)
                    pairs.append(index)
                    points.append((_numbers(one), _numbers(two)))
                    normals.append(normal)
                    impulses.append(known[contact.contact_id].impulse)
        count = len(pairs)
        bodies_of = np.array(pairs, dtype=np.int64).reshape(count, 2)
        places = np.array(points, dtype=np.float64).reshape(count, 2, 3)
        normal_of = np.array(normals, dtype=np.float64).reshape(count, 3)
        return Contacts(
            body_a=bodies_of[:, 0],
            body_b=bodies_of[:, 1],
            point_a=places[:, 0],
            point_b=places[:, 1],
            normal=normal_of,
            gap=np.einsum("cd,cd->c", places[:, 1] - places[:, 0], normal_of),
            friction=np.full(count, self._friction),
            impulse=normal_of * np.array(impulses, dtype=np.float64).reshape(count, 1),
        )

    def facts(self) -> StepFacts:
        """Rapier tells no status; bodies whose state is not finite are put aside and counted."""
        lost = len(self._world.quarantine.bodies)
        return StepFacts(status=f"{lost} bodies not finite" if lost else "ran")

    def close(self) -> None:
        """Nothing to free: the world goes with the object."""

    def _add(self, body: gpx.Body) -> Any:
        api = self._api
        builder = api.RigidBody.dynamic()
        builder = builder.position(_isometry(api, body.position, body.orientation))
        builder = builder.linvel(body.velocity.tolist()).angvel(body.angular_velocity.tolist())
        properties = api.MassProperties((0.0, 0.0, 0.0), body.mass, np.diag(body.inertia).tolist())
        collider = self._collider(body).mass_properties(properties)
        return self._world.add_body(builder.can_sleep(False), [collider])

    def _placed(self, body: gpx.Body) -> Any:
        return self._collider(body).position(_isometry(self._api, body.position, body.orientation))

    def _collider(self, body: gpx.Body) -> Any:
        kinds, numbers = self._api.Collider, body.shape.numbers()  # type: ignore[union-attr]
        if isinstance(body.shape, gpx.Sphere):
            collider = kinds.ball(*numbers)
        elif isinstance(body.shape, gpx.HalfSpace):
            collider = kinds.halfspace(tuple(numbers))
        else:
            collider = kinds.cuboid(*numbers)
        return collider.friction(self._friction).restitution(0.0)


def _isometry(api: Any, position: Array, orientation: Array) -> Any:
    return api.Isometry3(position.tolist(), api.Rotation3.from_quaternion(*orientation.tolist()))


def _numbers(value: Any) -> tuple[float, ...]:
    if hasattr(value, "w"):
        return value.w, value.i, value.j, value.k
    return value.x, value.y, value.z


@cache
def _load() -> Any:
    return importlib.import_module("rapier3d")

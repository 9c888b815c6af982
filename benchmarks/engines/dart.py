"""DART, through dartpy: the boxed LCP by Dantzig's pivots.

What DART 6.20 does behind one's back, and what is done about it here:

1. Bodies fall asleep: deactivation is turned off.
2. At most 1 000 contacts are kept, the rest dropped silently: the limit is raised.
3. A contact at exactly zero depth is no contact: the scenes of the suite start with 1e-9 m of overlap.
4. Friction of a pair is the minimum of the two, and a box: μ on each axis apart, up to √2 μ between them.
5. Dantzig falls back to PGS by itself where it fails, and does not say so: `facts` cannot tell.
6. Its PGS counts as failed unless an iteration changes little: it is then run a second time as its own fallback, or its
   impulses are set to zero where there is no fallback. Ten to a hundred times as dear as Dantzig on these scenes, it is
   left out.
7. A is dense: beyond some 150 bodies a step takes seconds, and larger scenes are refused.
8. The half-space is a box, whose contacts with boxes DART's own collision detector finds four by four.
"""

from __future__ import annotations

import importlib
from collections.abc import Sequence
from functools import cache
from typing import Any

import numpy as np

import gpx_lcp as gpx
from benchmarks.engines.rebuild import box_of, one_friction, require_shapes
from benchmarks.interface import Array, Contacts, Motion, Setting, StepFacts
from benchmarks.machine import version_of

MOST_BODIES = 150


class Dart:
    """DART's row in the table of engines."""

    name = "dart"
    install = "pip install dartpy"
    note = "boxed LCP, dense; deactivation off, no limit on contacts; up to 150 bodies"

    def version(self) -> str:
        """Return the installed version, or "" when it is missing."""
        return version_of("dartpy")

    def settings(self, quick: bool) -> Sequence[Setting]:
        """Return Dantzig."""
        return [Setting(self.name, "Dantzig", "box", "pivots", 0.0)]

    def sweeping(self, sweeps: int) -> Sequence[Setting]:
        """Return none: PGS is left out (quirk 6)."""
        return []

    def simulate(self, scene: gpx.Scene, time_step: float, setting: Setting, time_limit: float) -> DartSimulation:
        """Build the scene in a world of its own; a step of DART cannot be limited in time."""
        if len(scene.bodies) > MOST_BODIES:
            raise gpx.SettingsError(
                f"{len(scene.bodies)} bodies: DART's matrix is dense, and beyond {MOST_BODIES} a step takes seconds"
            )
        return DartSimulation(scene, time_step, setting)


class DartSimulation:
    """A scene in a world of its own, one skeleton of one body for each body."""

    def __init__(self, scene: gpx.Scene, time_step: float, setting: Setting) -> None:
        self._api = api = _load()
        self._time_step = time_step
        self._method = f"box/{setting.solver}"
        require_shapes(scene, "DART")
        self._friction = one_friction(scene, "DART")
        self._world = world = api.simulation.World()
        world.setTimeStep(time_step)
        world.setGravity(scene.gravity)
        world.setCollisionDetector(api.collision.DARTCollisionDetector())
        sleep = world.getDeactivationOptions()
        sleep.mEnabled = False
        world.setDeactivationOptions(sleep)
        solver = world.getConstraintSolver()
        solver.getCollisionOption().maxNumContacts = 10**7
        self._index: dict[str, int] = {}
        for body in scene.fixed:
            self._add(body)
        self._nodes = [self._add(body) for body in scene.bodies]

    def set_gravity(self, gravity: Array) -> None:
        """Set the acceleration of free fall for the next steps."""
        self._world.setGravity(gravity)

    def step(self) -> None:
        """Advance by one time step."""
        self._world.step()

    def motion(self) -> Motion:
        """Return where the moving bodies are now."""
        poses = [node.getWorldTransform() for node in self._nodes]
        turns = [pose.quaternion() for pose in poses]
        return Motion(
            position=np.array([pose.translation() for pose in poses]),
            orientation=np.array([(turn.w(), turn.x(), turn.y(), turn.z()) for turn in turns]),
            velocity=np.array([(*node.getLinearVelocity(), *node.getAngularVelocity()) for node in self._nodes]),
        )

    def contacts(self) -> Contacts:
        """Return the contacts and impulses of the last step: DART's normal and force are those on its first object."""
        found = self._world.getLastCollisionResult().getContacts()
        count = len(found)
        objects = [(contact.collisionObject2, contact.collisionObject1) for contact in found]
        names = [[thing.getShapeFrame().getSkeleton().getName() for thing in pair] for pair in objects]
        index = np.array([[self._index[name] for name in pair] for pair in names], dtype=np.int64).reshape(count, 2)
        point = np.array([contact.point for contact in found]).reshape(count, 3)
        return Contacts(
            body_a=index[:, 0],
            body_b=index[:, 1],
            point_a=point,
            point_b=point,
            normal=np.array([contact.normal for contact in found]).reshape(count, 3),
            gap=-np.array([contact.penetrationDepth for contact in found]),
            friction=np.full(count, self._friction),
            impulse=np.array([contact.force for contact in found]).reshape(count, 3) * self._time_step,
        )

    def facts(self) -> StepFacts:
        """Return what was asked to run; DART tells no status and no count."""
        return StepFacts(method=self._method)

    def close(self) -> None:
        """Nothing to free: the world goes with the object."""

    def _add(self, body: gpx.Body) -> Any:
        dynamics = self._api.dynamics
        name = f"{len(self._index)}"
        self._index[name] = body.index
        skeleton = dynamics.Skeleton(name)
        pose = self._api.math.Isometry3()
        position, orientation = body.position, body.orientation
        if isinstance(body.shape, gpx.Sphere):
            shape = dynamics.SphereShape(body.shape.radius)
        else:
            half_sides, position, orientation = box_of(body)
            shape = dynamics.BoxShape([2.0 * half for half in half_sides])
        pose.set_quaternion(self._api.math.Quaternion(*orientation.tolist()))
        pose.set_translation(position)
        moves = body.index >= 0
        make = skeleton.createFreeJointAndBodyNodePair if moves else skeleton.createWeldJointAndBodyNodePair
        joint, node = make()
        frame = node.createShapeNode(shape)
        frame.createCollisionAspect()
        surface = frame.createDynamicsAspect()
        surface.setFrictionCoeff(self._friction)
        surface.setRestitutionCoeff(0.0)
        if moves:
            node.setInertia(dynamics.Inertia(body.mass, np.zeros(3), body.inertia))
            joint.setTransform(pose)
            joint.setLinearVelocity(body.velocity)
            joint.setAngularVelocity(body.angular_velocity)
        else:
            joint.setTransformFromParentBodyNode(pose)
        self._world.addSkeleton(skeleton)
        return node


@cache
def _load() -> Any:
    return importlib.import_module("dartpy")

"""Drake: convex and lagged approximations of compliant point contact, by SAP, and TAMSI.

What Drake 1.51 does behind one's back, and what is done about it here:

1. Point contact gives one point for each pair of geometries: a box on a box would rest on one point. Where two bodies
   touch at the start, the one above gets feet, spheres of 1 cm, so that each foot touches the other body at the contact
   point of the scene; boxes do not collide with boxes, nor feet with feet. What falls or slides far is therefore not
   comparable, what rests is.
2. Contact is compliant. Stiffness here goes up to 1e14 N/m at a point, which the solvers bear once quirk 3 is undone,
   and which gives loads right to 1e-8 even where gravity swings. The default dissipation (50 s/m, relaxation time
   0.1 s) is sticky: one time step, and 1 s/m.
3. SAP regularises stiff contacts until their time constant is some fraction of the time step:
   `sap_near_rigid_threshold` is set to 0.
4. SAP and "similar" are convex and let sliding contacts open, "lagged" does so less; TAMSI regularises friction by a
   speed of 1 mm/s, so that what rests creeps.
5. Friction of a pair is the harmonic mean: refused unless all bodies have the same.
6. Reading contacts through unsampled ports solves the coming step and keeps the answer. Contacts are therefore read
   from sampled ports, which hold those of the last step.
7. The gravity of a finished plant cannot change: where it swings, the difference acts as a force on each body.
"""

from __future__ import annotations

import importlib
import logging
from collections.abc import Sequence
from functools import cache
from typing import Any

import numpy as np

import gpx_lcp as gpx
from benchmarks.bodies import rotation_matrices
from benchmarks.engines.rebuild import half_space_turn, one_friction, require_shapes
from benchmarks.interface import Array, Contacts, GaveUp, Motion, Setting, StepFacts, scientific
from benchmarks.machine import version_of

FOOT = 0.01  # radius, m

# Of a point, N/m. TAMSI does not converge on towers with the last one, and the line search of the others ends in
# rounding with it where something slides: the middle one is the most careful.
STIFFNESS = (1e7, 1e10, 1e14)
CAREFUL = 1e10

MOST_BODIES = 300

# The approximation by name, and the program that it poses.
APPROXIMATIONS = {"SAP": ("kSap", "cone"), "lagged": ("kLagged", "coulomb"), "similar": ("kSimilar", "cone")}
TAMSI = {"TAMSI": ("kTamsi", "coulomb")}


class Drake:
    """Drake's row in the table of engines."""

    name = "drake"
    install = "pip install drake"
    note = f"compliant points, on feet where boxes touch; up to {MOST_BODIES} bodies"

    def version(self) -> str:
        """Return the installed version, or "" when it is missing."""
        return version_of("drake")

    def settings(self, quick: bool) -> Sequence[Setting]:
        """Return each approximation by the stiffness of a point."""
        if quick:
            return [self._setting("lagged", 1e7)]
        steps = {**dict.fromkeys(APPROXIMATIONS, STIFFNESS), **dict.fromkeys(TAMSI, STIFFNESS[:-1])}
        return [self._setting(solver, stiffness) for solver, values in steps.items() for stiffness in values]

    def sweeping(self, sweeps: int) -> Sequence[Setting]:
        """Return none: no solver of Drake sweeps."""
        return []

    def simulate(self, scene: gpx.Scene, time_step: float, setting: Setting, time_limit: float) -> DrakeSimulation:
        """Build the scene in a diagram of its own; a step of Drake cannot be limited in time."""
        if len(scene.bodies) > MOST_BODIES:
            raise gpx.SettingsError(f"{len(scene.bodies)} bodies: beyond {MOST_BODIES} a step of Drake takes too long")
        return DrakeSimulation(scene, time_step, setting)

    def _setting(self, solver: str, stiffness: float) -> Setting:
        kind, program = {**APPROXIMATIONS, **TAMSI}[solver]
        options = {"approximation": kind, "stiffness": stiffness}
        return Setting(
            self.name,
            solver,
            program,
            f"{scientific(stiffness)} N/m",
            float(np.log10(stiffness)),
            options,
            careful=stiffness == CAREFUL,
        )


class DrakeSimulation:
    """A scene in a diagram of its own."""

    def __init__(self, scene: gpx.Scene, time_step: float, setting: Setting) -> None:
        self._api = api = _load()
        self._time_step = time_step
        self._method = f"{setting.formulation}/{setting.solver}"
        require_shapes(scene, "Drake")
        self._friction = one_friction(scene, "Drake")
        self._stiffness = setting.options["stiffness"]
        if not hasattr(api.plant.DiscreteContactApproximation, setting.options["approximation"]):
            raise gpx.SettingsError(f"this version of Drake has no {setting.solver}")
        builder = api.framework.DiagramBuilder()
        config = api.plant.MultibodyPlantConfig(
            time_step=time_step,
            contact_model="point",
            discrete_contact_approximation=setting.options["approximation"][1:].lower(),
            sap_near_rigid_threshold=0.0,
            use_sampled_output_ports=True,
        )
        self._plant, self._graph = api.plant.AddMultibodyPlant(config, builder)
        self._plant.mutable_gravity_field().set_gravity_vector(scene.gravity)
        self._gravity, self._mass = scene.gravity, np.array([body.mass for body in scene.bodies])
        self._bodies: list[Any] = []
        self._boxes: list[Any] = []
        self._feet: list[Any] = []
        for body in scene.bodies:
            self._bodies.append(self._plant.AddRigidBody(f"{body.index}", self._inertia(body)))
        for body in (*scene.fixed, *scene.bodies):
            self._add_shape(body)
        self._add_feet(scene, time_step)
        self._plant.Finalize()
        self._filter()
        diagram = builder.Build()
        self._simulator = api.analysis.Simulator(diagram)
        self._context = self._plant.GetMyMutableContextFromRoot(self._simulator.get_mutable_context())
        for body, link in zip(scene.bodies, self._bodies, strict=True):
            self._plant.SetFreeBodyPose(self._context, link, self._pose(body.position, body.orientation))
            velocity = api.spatial.SpatialVelocity(body.angular_velocity, body.velocity)
            self._plant.SetFreeBodySpatialVelocity(self._context, link, velocity)
        self._index = {link.index(): row for row, link in enumerate(self._bodies)}
        self._simulator.Initialize()
        self._steps = 0

    def set_gravity(self, gravity: Array) -> None:
        """Set the acceleration of free fall for the next steps, as forces beside the plant's own, which is fixed."""
        force = np.zeros((len(self._bodies), 6))
        force[:, 3:] = self._mass[:, None] * (gravity - self._gravity)
        self._plant.get_applied_generalized_force_input_port().FixValue(self._context, force.ravel())

    def step(self) -> None:
        """Advance by one time step."""
        self._steps += 1
        try:
            self._simulator.AdvanceTo(self._steps * self._time_step)
        except RuntimeError as error:
            raise GaveUp(str(error).partition("\n")[0]) from error

    def motion(self) -> Motion:
        """Return where the moving bodies are now."""
        plant, context = self._plant, self._context
        poses = [plant.EvalBodyPoseInWorld(context, link) for link in self._bodies]
        speeds = [plant.EvalBodySpatialVelocityInWorld(context, link) for link in self._bodies]
        return Motion(
            position=np.array([pose.translation() for pose in poses]),
            orientation=np.array([pose.rotation().ToQuaternion().wxyz() for pose in poses]),
            velocity=np.array([(*speed.translational(), *speed.rotational()) for speed in speeds]),
        )

    def contacts(self) -> Contacts:
        """Return the contacts and impulses of the last step; Drake's normal points from its body B to its body A."""
        results = self._plant.get_contact_results_output_port().Eval(self._context)
        found = [results.point_pair_contact_info(row) for row in range(results.num_point_pair_contacts())]
        count = len(found)
        pairs = [(info.bodyB_index(), info.bodyA_index()) for info in found]
        index = np.array([[self._index.get(body, -1) for body in pair] for pair in pairs], dtype=np.int64)
        index = index.reshape(count, 2)
        point = np.array([info.contact_point() for info in found]).reshape(count, 3)
        return Contacts(
            body_a=index[:, 0],
            body_b=index[:, 1],
            point_a=point,
            point_b=point,
            normal=np.array([info.point_pair().nhat_BA_W for info in found]).reshape(count, 3),
            gap=-np.array([info.point_pair().depth for info in found]),
            friction=np.full(count, self._friction),
            # The force that Drake reports acts on its body B, ours on the other one.
            impulse=-np.array([info.contact_force() for info in found]).reshape(count, 3) * self._time_step,
        )

    def facts(self) -> StepFacts:
        """Return what was asked to run; a solver that does not converge throws in `step`."""
        return StepFacts(method=self._method)

    def close(self) -> None:
        """Nothing to free: the diagram goes with the object."""

    def _inertia(self, body: gpx.Body) -> Any:
        tree = self._api.tree
        rotational = tree.RotationalInertia(*np.diag(body.inertia))
        return tree.SpatialInertia.MakeFromCentralInertia(body.mass, np.zeros(3), rotational)

    def _pose(self, position: Array, orientation: Array) -> Any:
        quaternion = self._api.eigen_geometry.Quaternion(orientation)
        return self._api.math.RigidTransform(quaternion, position)

    def _surface(self) -> Any:
        api, properties = self._api, self._api.geometry.ProximityProperties()
        friction = api.plant.CoulombFriction(self._friction, self._friction)
        api.geometry.AddContactMaterial(
            dissipation=1.0, point_stiffness=2.0 * self._stiffness, friction=friction, properties=properties
        )
        properties.AddProperty("material", "relaxation_time", self._time_step)
        return properties

    def _add_shape(self, body: gpx.Body) -> None:
        geometry = self._api.geometry
        numbers = body.shape.numbers()  # type: ignore[union-attr]
        if isinstance(body.shape, gpx.HalfSpace):
            shape, pose = geometry.HalfSpace(), self._pose(body.position, half_space_turn(body))
        else:
            place = (body.position, body.orientation) if body.index < 0 else (np.zeros(3), np.array([1.0, 0, 0, 0]))
            pose = self._pose(*place)
            is_box = isinstance(body.shape, gpx.Box)
            shape = geometry.Box(*(2.0 * half for half in numbers)) if is_box else geometry.Sphere(numbers[0])
        link = self._plant.world_body() if body.index < 0 else self._bodies[body.index]
        name = f"shape {len(self._boxes)}"
        made = self._plant.RegisterCollisionGeometry(link, pose, shape, name, self._surface())
        if isinstance(body.shape, gpx.Box) or (isinstance(body.shape, gpx.HalfSpace)):
            self._boxes.append(made)

    def _add_feet(self, scene: gpx.Scene, time_step: float) -> None:
        """Put a foot where a box touches another body at the start, on body b of the contact, which is never fixed."""
        touching = gpx.World(scene, time_step).contacts
        for b, point, normal in zip(touching.body_b, touching.point, touching.normal, strict=True):
            above = scene.bodies[b]
            if not isinstance(above.shape, gpx.Box):
                continue
            # The foot's lowest point is at the contact; in the frame of the body that it belongs to.
            centre = rotation_matrices(above.orientation[None])[0].T @ (point + FOOT * normal - above.position)
            sphere = self._api.geometry.Sphere(FOOT)
            pose = self._api.math.RigidTransform(centre)
            name = f"foot {len(self._feet)}"
            self._feet.append(
                self._plant.RegisterCollisionGeometry(self._bodies[b], pose, sphere, name, self._surface())
            )

    def _filter(self) -> None:
        geometry, filters = self._api.geometry, self._graph.collision_filter_manager()
        for group in (self._boxes, self._feet):
            declaration = geometry.CollisionFilterDeclaration()
            filters.Apply(declaration.ExcludeWithin(geometry.GeometrySet(group)))


@cache
def _load() -> Any:
    modules = _Modules()
    # It warns, for each plant, that TAMSI is to be removed and that half-spaces do not deform; loading sets its level.
    logging.getLogger("drake").setLevel(logging.ERROR)
    return modules


class _Modules:
    """The parts of pydrake that are used here."""

    def __init__(self) -> None:
        self.plant = importlib.import_module("pydrake.multibody.plant")
        self.tree = importlib.import_module("pydrake.multibody.tree")
        self.geometry = importlib.import_module("pydrake.geometry")
        self.framework = importlib.import_module("pydrake.systems.framework")
        self.analysis = importlib.import_module("pydrake.systems.analysis")
        self.spatial = importlib.import_module("pydrake.multibody.math")
        self.math = importlib.import_module("pydrake.math")
        self.eigen_geometry = importlib.import_module("pydrake.common.eigen_geometry")

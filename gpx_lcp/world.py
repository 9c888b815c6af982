"""Time stepping: a scene in motion, one stacked system per step.

A step of length dt takes the state (x, v) to the next:

    v_free = v + dt (g + f/m), and the gyroscopic moments                        free motion
    contacts that v_free may close within dt                                    detection
    A = J M⁻¹ Jᵀ,  B = -(J v_free + gap and impact terms)                       stacking
    p with u = A p - B and the law of contact                                   `gpx.solve`
    v⁺ = v_free + M⁻¹ Jᵀ p                                                      velocities
    x⁺ = x + dt (v + v⁺)/2, or x + dt v⁺ at impacts and under applied forces    positions

Every stage but the solver runs in the core; the solver is any of `gpx.solvers()`. Solvers that the core has itself
(their row in the table says what `native` kernel they are) run there too: then `step(n)` is one call.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from os import PathLike
from pathlib import Path
from typing import Any, Self

import numpy as np
import numpy.typing as npt
import scipy.sparse as sp
from scipy.spatial.transform import Rotation

from formulations import StackedSystem
from formulations.checks import Array, as_array, freeze
from gpx_lcp import _core
from gpx_lcp.contacts import Contacts
from gpx_lcp.errors import ProblemError, SettingsError
from gpx_lcp.impact_laws import Stage, checked_impact_speed, impact_stage, law_named
from gpx_lcp.inhabitants import Inhabitants, table
from gpx_lcp.instant import Instant
from gpx_lcp.native import NativeSolver
from gpx_lcp.scene import Body, Scene, checked_orientation
from gpx_lcp.snapshot import ContactArrays, Snapshot
from gpx_lcp.solution import Solution, Status
from gpx_lcp.solve import solve
from gpx_lcp.solvers import solvers


class World:
    """A scene in motion.

    Parameters
    ----------
    scene : Scene
        Where it starts; later changes of the scene do not reach the world.
    time_step : float, s
    solver : str
        A name in `gpx.solvers()`.
    formulation : str, optional
        As in `gpx.solve`: unless given, the closest to Coulomb's law that the solver can solve.
    iterations : int, optional
        At most so many in each step; the solver's own limit unless given.
    tolerance : float
        As in `gpx.solve`; the solver stops there, or at `iterations`.
    warm_start : bool
        Start each step from the impulses of the last, contact by contact, where the solver can.
    impact_law : str
        How bodies rebound: "newton", "poisson", "energy_safe" or "sequential", see `gpx.LAWS`.
    impact_speed : float, optional, m/s
        Elasticity acts in contacts that close faster; unless given, 2 g dt, twice what gravity gives bodies at rest.
    presolve : bool
        As in `gpx.solve`. Without it every contact has three rows and every body six velocities.
    **settings
        The solver's own, e.g. `relaxation` of "pgs".

    Attributes
    ----------
    gravity : (3,) array, m/s²
        May be set between steps.
    forces : (bodies, 6) array, N and N m
        Force at the centre of mass and torque, world frame, that act in every step until changed; starts with those of
        the scene. May be set, or changed in place, between steps.

    Notes
    -----
    * Contacts have one row instead of three where no material of the scene has friction, and bodies three velocities
      instead of six where none of them rotates.
    * Overlap beyond 1e-4 of the smaller body's bounding radius is taken out by a fifth per step through a projection
      of the positions, min ½ ΔxᵀMΔx over J_n Δx ≥ what is asked of each contact. It never enters the velocities: a
      velocity term (Baumgarte) would throw a cube that overlaps by 1 cm up with 0.48 m/s at 240 steps a second.
    * Positions change by dt (v + v⁺)/2: parabolas are exact, and a block thrown over the ground stops where it should.
      Bodies that are stopped at a surface in this step, or that `forces` act on, and all that they touch, move by
      dt v⁺ instead: the mean would take the former into the surface and let springs gain energy.
    * With a solver of the core itself ("pgs", "newton", "interior_point") `step(n)` is one call: the steps cost no
      Python, and other threads run meanwhile. Results do not depend on how n is divided. Any other solver is called
      from Python once a step. `solution` is of the last step; `unsolved_steps` counts those above the tolerance.
    * A contact whose pair has an elasticity above 1 is an impact in the step that would close its gap, up to one step's
      travel above the surface, if it closes faster than `impact_speed` at the step's start; `solution.method` then
      names the law. Newton's law is in the step's program, also in the core's own steps: the contact leaves with e - 1
      times its closing speed.
    * The core has no other law: with one, a world is stepped stage by stage, and the impacts have a stage before the
      step's program, with Coulomb's law solved exactly whatever the solver of the step (without friction where the
      formulation is "normal"). `solution` is then of what they left to do, `solution.extras["impact"]` is the `Impact`,
      and `contacts` holds the impulses of both.

    Raises
    ------
    ProblemError, SettingsError, BackendMissing
        When the scene, a setting or the solver is not what is needed.
    """

    def __init__(
        self,
        scene: Scene,
        time_step: float,
        *,
        solver: str = "newton",
        formulation: str | None = None,
        iterations: int | None = None,
        tolerance: float = 1e-8,
        warm_start: bool = True,
        impact_law: str = "newton",
        impact_speed: float | None = None,
        presolve: bool = True,
        **settings: Any,
    ) -> None:
        if not isinstance(scene, Scene):
            raise ProblemError(f"scene is a {type(scene).__name__}: a Scene is needed")
        self._time_step = _checked_time_step(time_step)
        # The time, and the steps taken, when the length of a step was last changed.
        self._clock = 0.0, 0
        self._effort: Mapping[str, Any] = {
            "solver": solver,
            "formulation": formulation,
            "max_iterations": iterations,
            "tolerance": tolerance,
            "presolve": presolve,
            **settings,
        }
        self._options: Mapping[str, Any] = {
            "solver": solver,
            "formulation": formulation,
            "iterations": iterations,
            "tolerance": tolerance,
            "warm_start": warm_start,
            "impact_law": impact_law,
            "impact_speed": impact_speed,
            "presolve": presolve,
            **settings,
        }
        # One contact, solved, finds whatever is wrong with the settings before the first step does.
        solve(StackedSystem(np.eye(3), [1.0, 0.0, 0.0], [0.5]), **self._effort)
        if not isinstance(warm_start, bool):
            raise SettingsError(f"warm_start is {warm_start!r}: it must be True or False")
        self._warm_start = warm_start and solvers()[solver].warm_starts
        self._law = law_named("impact_law", impact_law)
        self._impact_speed = None if impact_speed is None else checked_impact_speed(impact_speed)

        bodies = scene.bodies
        self._inhabit(Inhabitants.of(bodies, scene.fixed))
        self.gravity = scene.gravity
        self.forces = table(bodies, "force", "torque")
        state = _core.State(
            table(bodies, "position"),
            table(bodies, "orientation", width=4),
            table(bodies, "velocity", "angular_velocity"),
        )
        self._now = Instant(steps=0, unsolved=0, state=state, time_step=self._time_step)

    @property
    def bodies(self) -> tuple[Body, ...]:
        """The moving bodies as they were added, in the order of the arrays."""
        return self._inhabitants.bodies

    @property
    def fixed(self) -> tuple[Body, ...]:
        """The bodies that never move."""
        return self._inhabitants.fixed

    @property
    def time_step(self) -> float:
        """The length of a step, s."""
        return self._time_step

    @time_step.setter
    def time_step(self, value: float) -> None:
        value = _checked_time_step(value)
        if value != self._time_step:
            self._clock = self.time, self._now.steps
            self._time_step = value

    @property
    def steps(self) -> int:
        """How many steps the world has taken."""
        return self._now.steps

    @property
    def time(self) -> float:
        """Time since the start, s."""
        since, steps = self._clock
        return since + (self._now.steps - steps) * self._time_step

    @property
    def positions(self) -> Array:
        """Centres of mass, (bodies, 3), m."""
        return freeze(self._now.state.positions)

    @positions.setter
    def positions(self, value: npt.ArrayLike) -> None:
        self._now = self._now.placed(positions=as_array("positions", value, (len(self.bodies), 3)))

    @property
    def orientations(self) -> Array:
        """Unit quaternions w, x, y, z from the body's frame to the world's, (bodies, 4)."""
        return freeze(self._now.state.orientations)

    @orientations.setter
    def orientations(self, value: npt.ArrayLike) -> None:
        rows = as_array("orientations", value, (len(self.bodies), 4))
        checked = [checked_orientation(body.name, row) for body, row in zip(self.bodies, rows, strict=True)]
        self._now = self._now.placed(orientations=np.array(checked).reshape(-1, 4))

    @property
    def velocities(self) -> Array:
        """Linear (m/s) and angular (rad/s) velocities, world frame, (bodies, 6)."""
        return freeze(self._now.state.velocities)

    @velocities.setter
    def velocities(self, value: npt.ArrayLike) -> None:
        self._now = self._now.placed(velocities=as_array("velocities", value, (len(self.bodies), 6)))

    @property
    def solution(self) -> Solution | None:
        """What the solver gave in the last step; None before the first, and until the next after a restore."""
        return None if self._now.solution is None else self._now.solution()

    @property
    def unsolved_steps(self) -> int:
        """How many of the steps so far ended above the tolerance: their solution's status is not SOLVED."""
        return self._now.unsolved

    @property
    def gravity(self) -> Array:
        """Acceleration of free fall, (3,), m/s²."""
        return self._gravity

    @gravity.setter
    def gravity(self, value: npt.ArrayLike) -> None:
        self._gravity = freeze(as_array("gravity", value, (3,)))

    @property
    def impact_speed(self) -> float:
        """The closing speed above which elasticity acts, m/s."""
        if self._impact_speed is not None:
            return self._impact_speed
        return 2.0 * float(np.linalg.norm(self._gravity)) * self._time_step

    @property
    def forces(self) -> Array:
        """Forces (N) and torques (N m) that act in every step, world frame, (bodies, 6)."""
        return self._forces

    @forces.setter
    def forces(self, value: npt.ArrayLike) -> None:
        self._forces = as_array("forces", value, (len(self.bodies), 6))

    def step(self, steps: int = 1) -> None:
        """Take `steps` steps.

        A KeyboardInterrupt leaves the world as it was after the last whole step.

        Raises
        ------
        SettingsError
            When `steps` is not a whole number, or negative.
        ProblemError
            When forces hold a NaN, or a body's state is no longer finite; the world keeps its last finite state.
        BackendError
            When the solver's backend fails in a way of its own.
        """
        if isinstance(steps, bool) or not isinstance(steps, int | np.integer) or steps < 0:
            raise SettingsError(f"steps is {steps!r}: it must be a whole number, not negative")
        if self._native is not None:
            self._take_native_steps(self._native, int(steps))
            return
        for _ in range(steps):
            self._now = self._next()

    def add(self, body: Body) -> Body:
        """Add a body that a Scene has made: `ball = world.add(gpx.Scene().add_rigid(gpx.Sphere(0.5), 1.0))`.

        It starts where it was added to its scene, with the velocity, force and torque that it has there. Contacts of
        the other bodies keep their impulses for the warm start.

        Returns
        -------
        Body
            The same with its row in the arrays of this world, one of `world.bodies` or `world.fixed` from now on.
        """
        if not isinstance(body, Body):
            raise ProblemError(f"body is a {type(body).__name__}: a Body, as Scene.add_rigid makes it, is needed")
        inhabitants, added = self._inhabitants.with_body(body)
        state, now = self._now.state, self._now
        if added.index >= 0:
            one = (added,)
            now = now.with_body(inhabitants.core, added.index).placed(
                positions=np.vstack((state.positions, table(one, "position"))),
                orientations=np.vstack((state.orientations, table(one, "orientation", width=4))),
                velocities=np.vstack((state.velocities, table(one, "velocity", "angular_velocity"))),
            )
            self._forces = np.vstack((self._forces, table(one, "force", "torque")))
        self._now = now
        self._inhabit(inhabitants)
        return added

    def remove(self, body: Body | str | int) -> None:
        """Remove a body.

        The moving bodies behind it move up by one row: take them from `world.bodies` again, which has them with their
        new index. Contacts that stay keep their impulses for the warm start.

        Parameters
        ----------
        body : Body, str or int
            One of `world.bodies` or `world.fixed`, or its name, or the row of a moving one.
        """
        number = self._inhabitants.number(body)
        inhabitants = self._inhabitants.without_body(number)
        state, now = self._now.state, self._now.without_body(inhabitants.core, number)
        if number < len(self.bodies):
            now = now.placed(
                positions=np.delete(state.positions, number, axis=0),
                orientations=np.delete(state.orientations, number, axis=0),
                velocities=np.delete(state.velocities, number, axis=0),
            )
            self._forces = np.delete(self._forces, number, axis=0)
        self._now = now
        self._inhabit(inhabitants)

    def move(
        self,
        body: Body | str | int,
        *,
        position: npt.ArrayLike | None = None,
        orientation: npt.ArrayLike | None = None,
        velocity: npt.ArrayLike | None = None,
        angular_velocity: npt.ArrayLike | None = None,
    ) -> None:
        """Put a moving body somewhere else or give it another velocity, at once; what is not given stays.

        `positions`, `orientations` and `velocities` may be set as a whole, too.

        Parameters
        ----------
        body : Body, str or int
            One of `world.bodies`, or its name or row.
        position, orientation, velocity, angular_velocity
            As in `Body`.
        """
        moving = self._inhabitants.moving(body)
        row, name = moving.index, moving.name
        state = self._now.state
        positions, orientations, velocities = state.positions, state.orientations, state.velocities
        if position is not None:
            positions[row] = as_array(f"position of {name}", position, (3,))
        if orientation is not None:
            orientations[row] = checked_orientation(name, orientation)
        if velocity is not None:
            velocities[row, :3] = as_array(f"velocity of {name}", velocity, (3,))
        if angular_velocity is not None:
            velocities[row, 3:] = as_array(f"angular_velocity of {name}", angular_velocity, (3,))
        self._now = self._now.placed(positions, orientations, velocities)

    def apply_force(
        self,
        body: Body | str | int,
        force: npt.ArrayLike = (0.0, 0.0, 0.0),
        *,
        torque: npt.ArrayLike = (0.0, 0.0, 0.0),
        point: npt.ArrayLike | None = None,
    ) -> None:
        """Add a force and a torque to those that act on a body in every step from now on: to its row of `forces`.

        Parameters
        ----------
        body : Body, str or int
            One of `world.bodies`, or its name or row.
        force : (3,) array, N
            World frame.
        torque : (3,) array, N m
            World frame.
        point : (3,) array, m, optional
            Where the force acts, world frame; the centre of mass unless given. Its torque is that of the body's present
            position and does not follow the body as it moves.
        """
        moving = self._inhabitants.moving(body)
        self._forces[moving.index] += self._wrench(moving, "force", force, "torque", torque, point)

    def apply_impulse(
        self,
        body: Body | str | int,
        impulse: npt.ArrayLike = (0.0, 0.0, 0.0),
        *,
        angular_impulse: npt.ArrayLike = (0.0, 0.0, 0.0),
        point: npt.ArrayLike | None = None,
    ) -> None:
        """Change the velocity of a body at once, by M⁻¹ times an impulse (N s) and an angular impulse (N m s).

        The parameters are those of `apply_force`. A body that does not rotate keeps its angular velocity.
        """
        moving = self._inhabitants.moving(body)
        wrench = self._wrench(moving, "impulse", impulse, "angular_impulse", angular_impulse, point)
        velocity = self._now.state.velocities[moving.index]
        velocity[:3] += wrench[:3] / moving.mass
        if moving.inertia.any():
            w, *xyz = self._now.state.orientations[moving.index]
            turn = Rotation.from_quat([*xyz, w])
            velocity[3:] += turn.apply(np.linalg.solve(moving.inertia, turn.inv().apply(wrench[3:])))
        self.move(moving, velocity=velocity[:3], angular_velocity=velocity[3:])

    def snapshot(self) -> bytes:
        """Return all that the world is at this instant, bit by bit: what `restore` and `load` take.

        They are the bytes of an `.npz` file: bodies, state, gravity, forces, time, the contacts of the last step with
        their impulses, and the settings of the solver.
        """
        now, contacts = self._now, self._now.contacts
        return Snapshot(
            options=self._options,
            bodies=self.bodies,
            fixed=self.fixed,
            steps=now.steps,
            unsolved=now.unsolved,
            time_step=self._time_step,
            clock=self._clock,
            gravity=self._gravity,
            forces=self._forces,
            positions=now.state.positions,
            orientations=now.state.orientations,
            velocities=now.state.velocities,
            last_time_step=now.time_step,
            contacts=None
            if contacts is None
            else ContactArrays(
                pairs=contacts.pairs,
                features=contacts.features,
                points=contacts.points,
                frames=contacts.frames,
                gaps=contacts.gaps,
                impulse=now.impulse,
            ),
        ).to_bytes()

    def restore(self, snapshot: bytes | str | PathLike[str]) -> None:
        """Take the world back to a snapshot: its bytes, or the file that `save` wrote.

        From there it moves as the world did that the snapshot was made of, bit by bit, if it has the same settings. It
        keeps its own; `World.load` makes a world with those of the snapshot.

        Raises
        ------
        ProblemError
            When they are no snapshot, damaged, or of another version; the world stays as it is.
        """
        self._take(Snapshot.read(snapshot))

    def save(self, path: str | PathLike[str]) -> None:
        """Write `snapshot()` to a file, best named `.npz`."""
        Path(path).write_bytes(self.snapshot())

    @classmethod
    def load(cls, snapshot: bytes | str | PathLike[str]) -> Self:
        """Return a new world from a snapshot, or the file that `save` wrote: with its bodies, state and settings.

        Raises
        ------
        ProblemError
            As `restore`.
        SettingsError, BackendMissing
            When the settings are not for this machine: its solver is not installed.
        """
        read = Snapshot.read(snapshot)
        world = cls(Scene(), read.time_step, **read.options)
        world._take(read)
        return world

    def _take(self, read: Snapshot) -> None:
        inhabitants = Inhabitants.of(read.bodies, read.fixed)
        contacts, impulse = None, np.zeros((0, 3))
        if read.contacts is not None:
            stored = read.contacts
            numbers = stored.pairs, stored.features, stored.points, stored.frames.reshape(-1, 9), stored.gaps
            contacts = _core.Contacts(inhabitants.core, *numbers)
            impulse = stored.impulse
        self._inhabit(inhabitants)
        self._time_step, self._clock = read.time_step, read.clock
        self.gravity, self.forces = read.gravity, read.forces
        self._now = Instant(
            steps=read.steps,
            unsolved=read.unsolved,
            state=_core.State(read.positions, read.orientations, read.velocities),
            time_step=read.last_time_step,
            contacts=contacts,
            impulse=impulse,
        )

    def _wrench(
        self,
        body: Body,
        linear_name: str,
        linear: npt.ArrayLike,
        angular_name: str,
        angular: npt.ArrayLike,
        point: npt.ArrayLike | None,
    ) -> Array:
        """Return (6,): a force or impulse, and with its moment about the centre of mass a torque or angular impulse."""
        force = as_array(f"{linear_name} on {body.name}", linear, (3,))
        torque = as_array(f"{angular_name} on {body.name}", angular, (3,))
        if point is not None:
            arm = as_array(f"point on {body.name}", point, (3,)) - self._now.state.positions[body.index]
            torque += np.cross(arm, force)
        return np.concatenate((force, torque))

    def system(self) -> StackedSystem:
        """Return the stacked system that the next step would solve."""
        free = self._free_velocities()
        return self._system(self._stack(self._detect(free), free))

    def collision(self) -> tuple[StackedSystem, Array]:
        """Return the system, B = -J v, and the restitutions (n, 2) of what touches now and moves as it does now."""
        velocities = self._now.state.velocities
        contacts = self._detect(np.zeros_like(velocities))
        stack = self._stack(contacts, velocities)
        step = self._system(stack)
        assert step.jacobian is not None and step.free_velocity is not None
        system = StackedSystem.from_jacobian(
            step.jacobian,
            stack.inverse_mass(),
            -(step.jacobian @ step.free_velocity),
            step.friction,
            free_velocity=step.free_velocity,
        )
        return system, stack.restitution

    @property
    def contacts(self) -> Contacts:
        """The contacts of the last step with their impulses; before the first step, those of the start without any."""
        contacts, impulse = self._now.contacts, self._now.impulse_of_rows(3)
        if contacts is None:
            contacts = self._detect(self._free_velocities())
            impulse = np.zeros((len(contacts), 3))
        frames = contacts.frames
        return Contacts(
            body_a=contacts.body_a,
            body_b=contacts.body_b,
            point=contacts.points,
            normal=frames[:, 0],
            frame=frames,
            gap=contacts.gaps,
            friction=contacts.friction,
            impulse=impulse,
            force=np.einsum("kr,krx->kx", impulse, frames) / self._now.time_step,
        )

    def __repr__(self) -> str:
        return f"World({len(self.bodies)} moving bodies, {len(self.fixed)} fixed, t = {self.time:.6g} s)"

    def _inhabit(self, inhabitants: Inhabitants) -> None:
        if not self._effort["presolve"]:
            inhabitants = replace(inhabitants, rows=3, columns=6)
        self._inhabitants = inhabitants
        self._native = NativeSolver.of(inhabitants.rows, self._effort) if self._law.in_core else None
        self._native_settings = {} if self._native is None else self._native.settings()

    def _free_velocities(self) -> Array:
        forces = as_array("forces", self._forces, (len(self.bodies), 6))
        free = self._inhabitants.core.free_velocities(self._now.state, forces, self._gravity_numbers(), self._time_step)
        self._require_finite(free)
        return free

    def _gravity_numbers(self) -> tuple[float, float, float]:
        x, y, z = self._gravity.tolist()
        return x, y, z

    def _detect(self, free: Array) -> _core.Contacts:
        return self._inhabitants.core.detect(self._now.state, free, self._time_step)

    def _stack(self, contacts: _core.Contacts, free: Array) -> _core.Stack:
        return self._inhabitants.core.stack(
            self._now.state,
            contacts,
            free,
            self._time_step,
            self.impact_speed,
            self._inhabitants.rows,
            self._inhabitants.columns,
        )

    @staticmethod
    def _system(stack: _core.Stack) -> StackedSystem:
        starts, columns, blocks, whitened = stack.jacobian()
        inverse_mass = stack.inverse_mass()
        shape = ((starts.size - 1) * blocks.shape[1], inverse_mass.shape[0] * inverse_mass.shape[1])
        return StackedSystem.from_jacobian(
            sp.bsr_array((blocks, columns, starts), shape=shape),
            inverse_mass,
            stack.target,
            stack.friction,
            free_velocity=stack.free_velocities.ravel(),
            whitened_blocks=whitened,
        )

    def _next(self) -> Instant:
        """Take one step, stage by stage."""
        now = self._now
        free = self._free_velocities()
        contacts = self._detect(free)
        stack = self._stack(contacts, free)
        system, stage = self._system(stack), None
        if not self._law.in_core and stack.impacts.any():
            stage = self._impacts(system, stack, contacts)
            system = stage.system
        start = None
        if self._warm_start and now.contacts is not None:
            last = now.start_impulse(3, self._time_step)
            start = self._inhabitants.core.match_impulses(contacts, now.contacts, last)[:, : system.rows]
        solution = solve(system, warm_start=start, **self._effort)
        failed, impulse = solution.status is not Status.SOLVED, solution.impulse
        if stage is not None:
            failed, impulse = failed or stage.impact.status is not Status.SOLVED, impulse + stage.impulse
            solution = replace(solution, extras={**solution.extras, "impact": stage.impact})
        solution = self._naming_the_law(stack, solution)
        moved = self._inhabitants.core.moved
        state = moved(now.state, contacts, stack, self._forces, impulse.ravel(), self._time_step)
        self._require_finite(np.hstack((state.positions, state.orientations, state.velocities)))
        return Instant(
            steps=now.steps + 1,
            unsolved=now.unsolved + failed,
            state=state,
            time_step=self._time_step,
            contacts=contacts,
            impulse=impulse,
            solution=lambda: solution,
        )

    def _impacts(self, system: StackedSystem, stack: _core.Stack, contacts: _core.Contacts) -> Stage:
        """Let the impact law have its stage."""
        velocities = self._now.state.velocities[:, : self._inhabitants.columns].ravel()
        found = contacts.gaps, stack.restitution, stack.impacts
        frictionless = self._effort["formulation"] == "normal"
        return impact_stage(
            self._law, system, velocities, found, self.impact_speed, self._time_step, frictionless=frictionless
        )

    def _naming_the_law(self, stack: _core.Stack, solution: Solution) -> Solution:
        """Return the solution of a step, with the law of its impacts in its method if there are any."""
        if not stack.impacts.any():
            return solution
        return replace(solution, method=f"{self._law.name} impact, {solution.method}")

    def _take_native_steps(self, native: NativeSolver, count: int) -> None:
        """Take steps in one call of the core; whatever ends it early, the whole steps before that count."""
        now = self._now
        asked = {
            "time_step": self._time_step,
            "gravity": self._gravity_numbers(),
            "impact_speed": self.impact_speed,
            "forces": as_array("forces", self._forces, (len(self.bodies), 6)),
            "rows": self._inhabitants.rows,
            "columns": self._inhabitants.columns,
            "warm_start": self._warm_start,
            **self._native_settings,
        }
        step, body, error = _core.take_steps(
            self._inhabitants.core,
            now.state,
            now.contacts,
            now.start_impulse(self._inhabitants.rows, self._time_step),
            asked,
            count,
        )
        if step is not None:
            self._now = Instant(
                steps=now.steps + step.steps,
                unsolved=now.unsolved + step.unsolved,
                state=step.state,
                time_step=self._time_step,
                contacts=step.contacts,
                impulse=step.impulse,
                solution=cache(
                    lambda: self._naming_the_law(step.stack, native.solution(step, self._system(step.stack)))
                ),
                step=step,
            )
        if body is not None:
            raise self._not_finite(body)
        if error is not None:
            raise error

    def _require_finite(self, numbers: Array) -> None:
        finite = np.isfinite(numbers).all(axis=1)
        if not finite.all():
            raise self._not_finite(int(np.argmin(finite)))

    def _not_finite(self, body: int) -> ProblemError:
        return ProblemError(
            f"the state of {self.bodies[body].name} is not finite after step {self._now.steps + 1}: "
            "is the time step too long for its forces?"
        )


def _checked_time_step(time_step: float) -> float:
    try:
        value = float(time_step)
    except (TypeError, ValueError) as error:
        raise SettingsError(f"time_step is {time_step!r}: it must be a number of seconds") from error
    if not (np.isfinite(value) and value > 0):
        raise SettingsError(f"time_step is {value:g}: it must be positive and finite")
    return value

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
from os import PathLike
from pathlib import Path
from typing import Any, Final, Self

import numpy as np
import numpy.typing as npt

from formulations import StackedSystem
from formulations.checks import Array, as_array, freeze
from gpx_lcp import _core
from gpx_lcp.contacts import Contacts
from gpx_lcp.errors import ProblemError, SettingsError
from gpx_lcp.impact_laws import checked_impact_speed, law_named
from gpx_lcp.inhabitants import Inhabitants, table
from gpx_lcp.native import NativeSolver
from gpx_lcp.population import Population
from gpx_lcp.scene import Scene
from gpx_lcp.snapshot import ContactArrays, Snapshot
from gpx_lcp.solution import Solution
from gpx_lcp.solve import solve
from gpx_lcp.solvers import solvers
from gpx_lcp.staged import Impacts, naming_the_law, solve_step, stacked_system

# Solved, it finds whatever is wrong with settings before the first step does. Two contacts: one alone would not get as
# far as the solver.
_PROBE: Final = StackedSystem(np.kron([[2.0, 1.0], [1.0, 2.0]], np.eye(3)), [1.0, 0.0, 0.0] * 2, [0.5, 0.5])


class World(Population):
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
        Start each step from the impulses of the last, contact by contact, where the solver can. After steps that kept
        their impulses, because they were a solution to the tolerance, that is the mean of all of these: the load.
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
      of the positions, min ½ ΔxᵀWMΔx over J_n Δx ≥ what is asked of each contact, W a third from each level of a stack
      to the next, so that what stands on others gives way. It never enters the velocities: a velocity term (Baumgarte)
      would throw a cube that overlaps by 1 cm up with 0.48 m/s at 240 steps a second.
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
        self._solution: Solution | None = None
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
        solve(_PROBE, **self._effort)
        if not isinstance(warm_start, bool):
            raise SettingsError(f"warm_start is {warm_start!r}: it must be True or False")
        self._warm_start = warm_start and solvers()[solver].warm_starts
        self._law = law_named("impact_law", impact_law)
        self._impact_speed = None if impact_speed is None else checked_impact_speed(impact_speed)

        self._core = _core.World(self._warm_start)
        bodies = scene.bodies
        place = table(bodies, "position"), table(bodies, "orientation", width=4)
        self._populate(Inhabitants.of(bodies, scene.fixed), *place, table(bodies, "velocity", "angular_velocity"))
        self.gravity = scene.gravity
        self.forces = table(bodies, "force", "torque")

    @property
    def time_step(self) -> float:
        """The length of a step, s."""
        return self._time_step

    @time_step.setter
    def time_step(self, value: float) -> None:
        value = _checked_time_step(value)
        if value != self._time_step:
            self._clock = self.time, self.steps
            self._time_step = value
            self._set_conditions()

    @property
    def steps(self) -> int:
        """How many steps the world has taken."""
        return self._core.steps

    @property
    def time(self) -> float:
        """Time since the start, s."""
        since, steps = self._clock
        return since + (self.steps - steps) * self._time_step

    @property
    def solution(self) -> Solution | None:
        """What the solver gave in the last step; None before the first, and until the next after a restore."""
        solved = self._core.solved if self._solution is None else None
        if solved is not None and self._native is not None:
            self._solution = naming_the_law(self._law, solved.stack, self._native.solution(solved))
        return self._solution

    @property
    def unsolved_steps(self) -> int:
        """How many of the steps so far ended above the tolerance: their solution's status is not SOLVED."""
        return self._core.unsolved

    @property
    def gravity(self) -> Array:
        """Acceleration of free fall, (3,), m/s²."""
        return self._gravity

    @gravity.setter
    def gravity(self, value: npt.ArrayLike) -> None:
        self._gravity = freeze(as_array("gravity", value, (3,)))
        self._set_conditions()

    @property
    def impact_speed(self) -> float:
        """The closing speed above which elasticity acts, m/s."""
        if self._impact_speed is not None:
            return self._impact_speed
        return 2.0 * float(np.linalg.norm(self._gravity)) * self._time_step

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
        # What it costs to ask counts here: two cubes at rest take the core three microseconds.
        if type(steps) is not int or steps < 0:
            steps = _checked_steps(steps)
        if self._native is not None:
            self._solution = None
            body = self._core.step(steps, self._forces)
            if body is not None:
                raise self._not_finite(body)
            return
        for _ in range(steps):
            self._take_step()

    def snapshot(self) -> bytes:
        """Return all that the world is at this instant, bit by bit: what `restore` and `load` take.

        They are the bytes of an `.npz` file: bodies, state, gravity, forces, time, the contacts of the last step with
        their impulses, and the settings of the solver.
        """
        contacts, impulse, starts = self._core.contacts, self._core.impulse(), self._core.starts()
        return Snapshot(
            options=self._options,
            bodies=self.bodies,
            fixed=self.fixed,
            steps=self.steps,
            unsolved=self.unsolved_steps,
            time_step=self._time_step,
            clock=self._clock,
            gravity=self._gravity,
            forces=self._forces,
            positions=self._core.positions,
            orientations=self._core.orientations,
            velocities=self._core.velocities,
            last_time_step=self._time_step if impulse is None else impulse[1],
            contacts=None
            if contacts is None or impulse is None or starts is None
            else ContactArrays(
                pairs=contacts.pairs,
                features=contacts.features,
                points=contacts.points,
                frames=contacts.frames,
                gaps=contacts.gaps,
                impulse=impulse[0],
                start=starts[0],
                kept=starts[1],
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
        contacts, impulse, start, kept = None, np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0, dtype=np.uint32)
        if read.contacts is not None:
            stored = read.contacts
            numbers = stored.pairs, stored.features, stored.points, stored.frames.reshape(-1, 9), stored.gaps
            contacts = _core.Contacts(inhabitants.core, *numbers)
            impulse, start, kept = stored.impulse, stored.start, stored.kept
        self._populate(inhabitants, read.positions, read.orientations, read.velocities)
        self._core.resume(read.steps, read.unsolved, contacts, impulse, read.last_time_step, start, kept)
        self._time_step, self._clock = read.time_step, read.clock
        self._solution = None
        self.gravity, self.forces = read.gravity, read.forces

    def system(self) -> StackedSystem:
        """Return the stacked system that the next step would solve."""
        free = self._free_velocities()
        return stacked_system(self._core.stack(self._core.detect(free), free))

    def collision(self) -> tuple[StackedSystem, Array]:
        """Return the system, B = -J v, and the restitutions (n, 2) of what touches now and moves as it does now."""
        velocities = self._core.velocities
        contacts = self._core.detect(np.zeros_like(velocities))
        stack = self._core.stack(contacts, velocities)
        step = stacked_system(stack)
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
        contacts, found = self._core.contacts, self._core.impulse(3)
        if contacts is None or found is None:
            contacts = self._core.detect(self._free_velocities())
            found = np.zeros((len(contacts), 3)), self._time_step
        impulse, time_step = found
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
            force=np.einsum("kr,krx->kx", impulse, frames) / time_step,
        )

    def __repr__(self) -> str:
        return f"World({len(self.bodies)} moving bodies, {len(self.fixed)} fixed, t = {self.time:.6g} s)"

    def _inhabit(self, inhabitants: Inhabitants) -> None:
        if not self._effort["presolve"]:
            inhabitants = replace(inhabitants, rows=3, columns=6)
        self._inhabitants = inhabitants
        self._native = NativeSolver.of(inhabitants.rows, self._effort) if self._law.in_core else None
        settings = None if self._native is None else self._native.settings()
        self._core.configure(inhabitants.rows, inhabitants.columns, settings)

    def _populate(self, inhabitants: Inhabitants, positions: Array, orientations: Array, velocities: Array) -> None:
        self._core.populate(inhabitants.core, positions, orientations, velocities)
        self._inhabit(inhabitants)

    def _set_conditions(self) -> None:
        self._core.set_conditions(self._time_step, self._gravity.tolist(), self.impact_speed)

    def _free_velocities(self) -> Array:
        as_array("forces", self._forces, (len(self.bodies), 6))
        free = self._core.free_velocities(self._forces)
        finite = np.isfinite(free).all(axis=1)
        if not finite.all():
            raise self._not_finite(int(np.argmin(finite)))
        return free

    def _take_step(self) -> None:
        """Take one step, stage by stage."""
        free = self._free_velocities()
        contacts = self._core.detect(free)
        stack = self._core.stack(contacts, free)
        before = self._core.velocities[:, : self._inhabitants.columns].ravel()
        start = self._core.start_impulses(contacts) if self._warm_start else None
        solution, impulse, failed = solve_step(
            stack, contacts, start, self._effort, Impacts(self._law, before, self.impact_speed, self._time_step)
        )
        body = self._core.advance(contacts, stack, impulse, failed)
        if body is not None:
            raise self._not_finite(body)
        self._solution = solution

    def _not_finite(self, body: int) -> ProblemError:
        as_array("forces", self._forces, (len(self.bodies), 6))
        return ProblemError(
            f"the state of {self.bodies[body].name} is not finite after step {self.steps + 1}: "
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


def _checked_steps(steps: Any) -> int:
    if isinstance(steps, bool) or not isinstance(steps, int | np.integer) or steps < 0:
        raise SettingsError(f"steps is {steps!r}: it must be a whole number, not negative")
    return int(steps)

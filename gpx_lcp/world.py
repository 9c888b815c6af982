"""Time stepping: a scene in motion, one stacked system per step.

A step of length dt takes the state (x, v) to the next:

    v_free = v + dt (g + f/m), and the gyroscopic moments                        free motion
    contacts that v_free may close within dt                                    detection
    A = J M⁻¹ Jᵀ,  B = -(J v_free + gap and impact terms)                       stacking
    p with u = A p - B and the law of contact                                   `gpx.solve`
    v⁺ = v_free + M⁻¹ Jᵀ p,  x⁺ = x + dt v⁺                                     semi-implicit Euler

Every stage but the solver runs in the core; the solver is any of `gpx.solvers()`. Solvers that the core has itself
(their row in the table says what `native` kernel they are) run there too: then `step(n)` is one call.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
import numpy.typing as npt
import scipy.sparse as sp

from formulations import StackedSystem
from formulations.checks import Array, as_array, freeze
from gpx_lcp import _core
from gpx_lcp.errors import ProblemError, SettingsError
from gpx_lcp.materials import COMBINE_RULES
from gpx_lcp.native import NativeSolver
from gpx_lcp.scene import Body, Scene
from gpx_lcp.solution import Solution, Status
from gpx_lcp.solve import solve
from gpx_lcp.solvers import solvers


@dataclass(frozen=True)
class Contacts:
    """The contacts of one step, as arrays over the n contacts.

    Attributes
    ----------
    body_a, body_b : (n,) int array
        Indices of the bodies; -1 is a body that never moves, which is always body a.
    point : (n, 3) array, m
        World frame, halfway between the surfaces.
    normal : (n, 3) array
        Unit, from body a to body b.
    frame : (n, 3, 3) array
        Rows: the normal and two tangents, the axes of `impulse`.
    gap : (n,) array, m
        At the start of the step; negative is penetration.
    friction : (n,) array
    impulse : (n, 3) array, N s
        On body b, in the contact frame; zero before the first step.
    force : (n, 3) array, N
        On body b, world frame: the impulse over the length of the step.
    """

    body_a: npt.NDArray[np.int64]
    body_b: npt.NDArray[np.int64]
    point: Array
    normal: Array
    frame: Array
    gap: Array
    friction: Array
    impulse: Array
    force: Array


@dataclass(frozen=True)
class _Instant:
    """All that a step changes, so that an interrupted step changes nothing.

    `solution` works the Solution out, once; `step` is what the core keeps of a step of its own.
    """

    steps: int
    unsolved: int
    state: _core.State
    contacts: _core.Contacts | None = None
    solution: Callable[[], Solution] | None = None
    step: _core.Step | None = None

    def impulse(self) -> Array:
        """Return the contacts' impulses as (n, 3), also where they have one row or no step has been taken."""
        impulse = np.zeros((0 if self.contacts is None else len(self.contacts), 3))
        if self.solution is not None:
            found = self.solution().impulse if self.step is None else self.step.impulse
            impulse[:, : found.shape[1]] = found
        return impulse


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
    * With a solver of the core itself ("pgs", "newton", "interior_point") `step(n)` is one call: the steps cost no
      Python, and other threads run meanwhile. Results do not depend on how n is divided. Any other solver is called
      from Python once a step. `solution` is of the last step; `unsolved_steps` counts those above the tolerance.
    * An impact of pair elasticity e > 1 leaves with (e - 1) times the closing speed of the step's start, if that is
      above 2 g dt; it happens in the step that would close the gap, up to one step's travel above the surface.

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
        **settings: Any,
    ) -> None:
        if not isinstance(scene, Scene):
            raise ProblemError(f"scene is a {type(scene).__name__}: a Scene is needed")
        self._time_step = _checked_time_step(time_step)
        self._effort: Mapping[str, Any] = {
            "solver": solver,
            "formulation": formulation,
            "max_iterations": iterations,
            "tolerance": tolerance,
            **settings,
        }
        # One contact, solved, finds whatever is wrong with the settings before the first step does.
        solve(StackedSystem(np.eye(3), [1.0, 0.0, 0.0], [0.5]), **self._effort)
        if not isinstance(warm_start, bool):
            raise SettingsError(f"warm_start is {warm_start!r}: it must be True or False")
        self._warm_start = warm_start and solvers()[solver].warm_starts

        self._bodies, self._fixed = scene.bodies, scene.fixed
        everybody = self._bodies + self._fixed
        self._core = _core_bodies(self._bodies, self._fixed)
        self._rows = 3 if any(body.material.friction for body in everybody) else 1
        self._columns = 6 if any(body.inertia.any() for body in self._bodies) else 3
        self.gravity = scene.gravity
        self.forces = _table(self._bodies, "force", "torque")
        state = _core.State(
            _table(self._bodies, "position"),
            _table(self._bodies, "orientation", width=4),
            _table(self._bodies, "velocity", "angular_velocity"),
        )
        self._native = NativeSolver.of(self._rows, self._effort)
        self._native_settings = {} if self._native is None else self._native.settings()
        self._now = _Instant(steps=0, unsolved=0, state=state)

    @property
    def bodies(self) -> tuple[Body, ...]:
        """The moving bodies as the scene had them, in the order of the arrays."""
        return self._bodies

    @property
    def time_step(self) -> float:
        """The length of a step, s."""
        return self._time_step

    @property
    def time(self) -> float:
        """Time since the start, s."""
        return self._now.steps * self._time_step

    @property
    def positions(self) -> Array:
        """Centres of mass, (bodies, 3), m."""
        return freeze(self._now.state.positions)

    @property
    def orientations(self) -> Array:
        """Unit quaternions w, x, y, z from the body's frame to the world's, (bodies, 4)."""
        return freeze(self._now.state.orientations)

    @property
    def velocities(self) -> Array:
        """Linear (m/s) and angular (rad/s) velocities, world frame, (bodies, 6)."""
        return freeze(self._now.state.velocities)

    @property
    def solution(self) -> Solution | None:
        """What the solver gave in the last step; None before the first."""
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
    def forces(self) -> Array:
        """Forces (N) and torques (N m) that act in every step, world frame, (bodies, 6)."""
        return self._forces

    @forces.setter
    def forces(self, value: npt.ArrayLike) -> None:
        self._forces = as_array("forces", value, (len(self._bodies), 6))

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

    def system(self) -> StackedSystem:
        """Return the stacked system that the next step would solve."""
        free = self._free_velocities()
        return self._system(self._stack(self._detect(free), free))

    @property
    def contacts(self) -> Contacts:
        """The contacts of the last step with their impulses; before the first step, those of the start without any."""
        contacts, impulse = self._now.contacts, self._now.impulse()
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
            force=np.einsum("kr,krx->kx", impulse, frames) / self._time_step,
        )

    def __repr__(self) -> str:
        return f"World({len(self._bodies)} moving bodies, {len(self._fixed)} fixed, t = {self.time:.6g} s)"

    def _free_velocities(self) -> Array:
        forces = as_array("forces", self._forces, (len(self._bodies), 6))
        free = self._core.free_velocities(self._now.state, forces, self._gravity_numbers(), self._time_step)
        self._require_finite(free)
        return free

    def _gravity_numbers(self) -> tuple[float, float, float]:
        x, y, z = self._gravity.tolist()
        return x, y, z

    def _detect(self, free: Array) -> _core.Contacts:
        return self._core.detect(self._now.state, free, self._time_step)

    def _stack(self, contacts: _core.Contacts, free: Array) -> _core.Stack:
        strength = float(np.linalg.norm(self._gravity))
        return self._core.stack(self._now.state, contacts, free, self._time_step, strength, self._rows, self._columns)

    def _system(self, stack: _core.Stack) -> StackedSystem:
        starts, columns, blocks, whitened = stack.jacobian()
        shape = ((starts.size - 1) * self._rows, len(self._bodies) * self._columns)
        return StackedSystem.from_jacobian(
            sp.bsr_array((blocks, columns, starts), shape=shape),
            stack.inverse_mass(),
            stack.target,
            stack.friction,
            free_velocity=stack.free_velocities.ravel(),
            whitened_blocks=whitened,
        )

    def _next(self) -> _Instant:
        """Take one step, stage by stage."""
        now = self._now
        free = self._free_velocities()
        contacts = self._detect(free)
        stack = self._stack(contacts, free)
        system = self._system(stack)
        start = None
        if self._warm_start and now.contacts is not None:
            start = self._core.match_impulses(contacts, now.contacts, now.impulse())[:, : system.rows]
        solution = solve(system, warm_start=start, **self._effort)
        state = self._core.moved(now.state, contacts, stack, solution.impulse.ravel(), self._time_step)
        self._require_finite(np.hstack((state.positions, state.orientations, state.velocities)))
        return _Instant(
            steps=now.steps + 1,
            unsolved=now.unsolved + (solution.status is not Status.SOLVED),
            state=state,
            contacts=contacts,
            solution=lambda: solution,
        )

    def _take_native_steps(self, native: NativeSolver, count: int) -> None:
        """Take steps in one call of the core; whatever ends it early, the whole steps before that count."""
        now = self._now
        asked = {
            "time_step": self._time_step,
            "gravity": self._gravity_numbers(),
            "forces": as_array("forces", self._forces, (len(self._bodies), 6)),
            "rows": self._rows,
            "columns": self._columns,
            "warm_start": self._warm_start,
            **self._native_settings,
        }
        step, body, error = _core.take_steps(self._core, now.state, now.step, asked, count)
        if step is not None:
            self._now = _Instant(
                steps=now.steps + step.steps,
                unsolved=now.unsolved + step.unsolved,
                state=step.state,
                contacts=step.contacts,
                solution=cache(lambda: native.solution(step, self._system(step.stack))),
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
            f"the state of {self._bodies[body].name} is not finite after step {self._now.steps + 1}: "
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


def _table(bodies: tuple[Body, ...], *names: str, width: int = 3) -> Array:
    rows = [np.concatenate([getattr(body, name) for name in names]) for body in bodies]
    return np.array(rows, dtype=np.float64).reshape(len(bodies), width * len(names))


def _core_bodies(moving: tuple[Body, ...], fixed: tuple[Body, ...]) -> _core.Bodies:
    def shape(body: Body) -> tuple[str, Array]:
        if body.shape is None:
            return "none", np.zeros(0)
        return body.shape.kind, np.ascontiguousarray(body.shape.numbers(), dtype=np.float64)

    def material(body: Body) -> tuple[float, int, float, int]:
        m = body.material
        return m.friction, COMBINE_RULES.index(m.friction_rule), m.elasticity, COMBINE_RULES.index(m.elasticity_rule)

    everybody = moving + fixed
    return _core.Bodies(
        len(moving),
        [shape(body) for body in everybody],
        [material(body) for body in everybody],
        np.array([body.mass for body in moving], dtype=np.float64),
        np.array([body.inertia.ravel() for body in moving], dtype=np.float64).reshape(-1, 9),
        np.hstack((_table(fixed, "position"), _table(fixed, "orientation", width=4))),
    )

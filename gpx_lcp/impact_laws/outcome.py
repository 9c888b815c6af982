"""What comes back from an impact law, in a collision of its own and inside a time step."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from formulations import Certificate, StackedSystem, certify
from formulations.checks import Array, freeze
from gpx_lcp.impact_laws._interface import Collision, ImpactLaw, dense_if_small
from gpx_lcp.solution import Solution, Status

# To which the programs of a law are solved within a time step, whatever the step's own tolerance.
STEP_TOLERANCE = 1e-10


@dataclass(frozen=True, eq=False)
class Impact:
    """What a law makes of a collision.

    Attributes
    ----------
    system : StackedSystem
        The collision as a plastic one, B = -u⁻.
    impulse : (n, rows) array, N s
        Total contact impulses on body b, normal first.
    contact_velocity : (n, rows) array, m/s
        After the impact, u⁺ = u⁻ + A p.
    velocities : (nv,) array, (bodies, 6) for a scene, m/s and rad/s
        Of the bodies after the impact; None where the system carries A alone.
    law : str
    status : Status
        SOLVED where every program that the law solved is; the worst of them otherwise, and MAX_ITERATIONS where the law
        stopped at a limit of its own.
    residual : float
        The largest residual among those programs.
    method : str
        The law, and the program and solver of its last program.
    energy_change : float, J
        What the impulses change the kinetic energy by, p·u⁻ + ½ pᵀA p.
    certificate : Certificate
        Of the total impulses. Its `energy_change` is that change relative to what was exchanged, `cone_violation` and
        `penetration_velocity` are those of the outcome; `natural_map` and `complementarity` compare it with a plastic
        impact and vanish only there.
    solutions : tuple of Solution
        Of the programs, in order.
    extras : mapping
        The law's own figures: `passes` of "sequential" and "energy_safe", the `violation` that the latter ends with.
    """

    system: StackedSystem
    impulse: Array
    contact_velocity: Array
    velocities: Array | None
    law: str
    energy_change: float
    solutions: tuple[Solution, ...] = field(repr=False)
    finished: bool
    extras: dict[str, Any]

    @property
    def status(self) -> Status:
        """The worst status of the programs."""
        failed = [solution.status for solution in self.solutions if solution.status is not Status.SOLVED]
        if failed:
            return failed[0]
        return Status.SOLVED if self.finished else Status.MAX_ITERATIONS

    @property
    def residual(self) -> float:
        """The largest residual of the programs."""
        return max((solution.program_residual for solution in self.solutions), default=0.0)

    @property
    def method(self) -> str:
        """The law, the program and the solver."""
        return f"{self.law} impact" + (f", {self.solutions[-1].method}" if self.solutions else "")

    @cached_property
    def certificate(self) -> Certificate:
        """The total impulses, judged on the collision."""
        return certify(self.system, self.impulse)


def collide(law: ImpactLaw, system: StackedSystem, restitution: Array, impact_speed: float, tolerance: float) -> Impact:
    """Run a law on the collision of a system with B = -u⁻; restitution is elasticity - 1, (n, 2)."""
    before = -system.B.reshape(system.contacts, system.rows)
    A = dense_if_small(system.A)
    found = law.run(Collision(A, before, system.friction, restitution, impact_speed, tolerance))
    p = found.impulse
    moved = system.apply(p)
    velocities = None
    if system.free_velocity is not None:
        velocities = freeze(system.free_velocity + system.body_velocity_change(p))
    return Impact(
        system=system,
        impulse=freeze(p),
        contact_velocity=freeze(before + moved),
        velocities=velocities,
        law=law.name,
        energy_change=float(np.vdot(p, before + 0.5 * moved)),
        solutions=found.solutions,
        finished=found.finished,
        extras=dict(found.extras),
    )


@dataclass(frozen=True, eq=False)
class Stage:
    """The impacts of a time step, done with; what is left is a step without impacts.

    Attributes
    ----------
    impact : Impact
        Of the contacts that took part.
    impulse : (contacts, rows) array, N s
        Its impulses, among all contacts of the step.
    system : StackedSystem
        What is left to solve. Contacts that bore an impulse keep at least the velocity that it left them with, so that
        the gravity of the step takes nothing from a rebound.
    """

    impact: Impact
    impulse: Array
    system: StackedSystem


def impact_stage(
    law: ImpactLaw,
    step: StackedSystem,
    velocities: Array,
    contacts: tuple[Array, Array, npt.NDArray[np.bool_]],
    impact_speed: float,
    time_step: float,
    *,
    frictionless: bool,
) -> Stage:
    """Take the impacts out of a step.

    Parameters
    ----------
    step : StackedSystem
        Of the step, with J, M⁻¹ and free velocities; its B is not read.
    velocities : (nv,) array
        Before the step.
    contacts : gaps (n,) in m, restitution (n, 2), impacts (n,)
        Those that are no impacts take part where they lie within the reach of the fastest one, its closing speed times
        the step.
    """
    gaps, restitution, impacts = contacts
    shape = (step.contacts, step.rows)
    assert step.jacobian is not None and step.inverse_mass is not None and step.free_velocity is not None
    before = (step.jacobian @ velocities).reshape(shape)
    reach = time_step * float(-before[impacts, 0].min())
    part = np.flatnonzero(impacts | (gaps <= reach))
    at = (step.rows * part[:, None] + np.arange(step.rows)).ravel()
    jacobian = step.jacobian.tocsr()[at]
    friction = np.zeros(part.size) if frictionless else step.friction[part]
    collision = StackedSystem.from_jacobian(
        jacobian, step.inverse_mass, -before[part].ravel(), friction, free_velocity=velocities
    )
    impact = collide(law, collision, restitution[part], impact_speed, STEP_TOLERANCE)
    impulse = np.zeros(shape)
    impulse[part] = impact.impulse
    free = step.free_velocity + step.body_velocity_change(impulse)
    B = -(step.jacobian @ free).reshape(shape)
    bore = impulse[:, 0] > 0.0
    kept = before + step.apply(impulse)
    B[bore] += kept[bore]
    B[~bore, 0] -= np.maximum(gaps[~bore], 0.0) / time_step
    left = StackedSystem.from_jacobian(step.jacobian, step.inverse_mass, B.ravel(), step.friction, free_velocity=free)
    return Stage(impact, impulse, left)

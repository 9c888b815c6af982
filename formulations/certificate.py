"""What is true of a set of contact impulses, measured without the help of whoever computed them.

There is one judge, the exact Coulomb law in De Saxcé's form, whatever program was posed and whichever engine solved it.
No field changes when masses, lengths or times change their unit.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, fields
from functools import cached_property

import numpy as np
import numpy.typing as npt

from formulations.checks import Array, as_array
from formulations.cones import de_saxce, project_friction_cone
from formulations.redundancy import Uniqueness, uniqueness
from formulations.system import StackedSystem

# Below this share of the velocity scale a contact counts as sticking, so that its direction of slip is not rounding.
SLIDING = 1e-6


@dataclass(frozen=True)
class Certificate:
    """Scale-free measures of impulses p against the exact Coulomb law; every one is zero at a solution.

    With u = A p - B, û = u + μ‖u_t‖ n, d_i = max diag(A_ii) and ‖·‖ the Euclidean norm over all contacts.

    Attributes
    ----------
    natural_map
        ‖d p - P_K(d p - û)‖ / ‖B‖, zero exactly at a solution. (The cone is homogeneous, so this is d times the
        natural map with ρ = 1/d, and it has a value for contacts between locked bodies, where d = 0.)
    cone_violation
        max (‖p_t‖ - μ p_n, -p_n)⁺ d / ‖B‖.
    penetration_velocity
        max (-u_n)⁺ / max |B|: how fast the worst contact still closes.
    complementarity
        |Σ p·û| / Σ ‖p‖ (‖û‖ + max |B|): a relative duality gap. The velocity scale in the denominator keeps it
        meaningful where every contact sticks and û is nothing but rounding.
    dissipation
        max (p_t·u_t)⁺ d / ‖B‖²: friction must not do positive work.
    sliding_angle
        The largest angle between p_t and -u_t over the contacts that slide, rad.
    energy_change
        (½ pᵀA p + p·J v_free) / (½ pᵀA p + Σ |p·J v_free|): what the impulses add to the kinetic energy, between -1
        and 1; None where the system does not carry its free velocity. Not positive for elasticity up to 2 unless a
        penetration is being pushed out, or Newton's law with friction gains energy.
    worst_contact
        Index of the contact with the largest share of `natural_map`; -1 without contacts.
    system, impulse
        What was judged.
    uniqueness, rank, nullity
        Whether other impulses give the same velocities: contact states, and the rank of A among them. Worked out when
        asked for.

    Source: V. Acary, M. Brémond, O. Huber, *On solving contact problems with Coulomb friction*, INRIA RR-9118 (2018)
    for the natural map. Departures: (1) scaled by d and ‖B‖ so that it has no unit, where the report divides by ‖q‖
    with ρ = 1.
    """

    natural_map: float
    cone_violation: float
    penetration_velocity: float
    complementarity: float
    dissipation: float
    sliding_angle: float
    energy_change: float | None
    worst_contact: int
    system: StackedSystem = field(repr=False, compare=False)
    impulse: Array = field(repr=False, compare=False)

    @cached_property
    def uniqueness(self) -> Uniqueness:
        """Whether other impulses give the same velocities: worked out when first asked for, a dense eigenproblem."""
        return uniqueness(self.system, self.impulse)

    @property
    def rank(self) -> int | None:
        """The rank of A on the faces of the contacts; see `Uniqueness`."""
        return self.uniqueness.rank

    @property
    def nullity(self) -> int | None:
        """The number of directions in which impulses change no velocity; 0 where they are unique."""
        return self.uniqueness.nullity

    def __str__(self) -> str:
        """One line a measure."""
        lines = []
        for measure in fields(self):
            if measure.repr:
                value = getattr(self, measure.name)
                text = f"{value:.3g}" if isinstance(value, float) else str(value)
                lines.append(f"{measure.name:<21}{text}")
        return "\n".join(lines)


def certify(system: StackedSystem, impulse: npt.ArrayLike) -> Certificate:
    """Measure impulses, also another engine's, against the exact Coulomb law of the system.

    Parameters
    ----------
    system : StackedSystem
    impulse : (n, rows) array, N s
        Contact impulses on body b, normal first.

    Raises
    ------
    ProblemError
        When the impulses have another shape or are not finite.
    """
    p = as_array("impulse", impulse, (system.contacts, system.rows))
    if system.contacts == 0:
        return Certificate(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, None if system.free_velocity is None else 0.0, -1, system, p)
    u = system.velocity(p)
    corrected = de_saxce(u, system.friction)
    d, mu = system.scale, system.friction
    scale, largest = system.size, float(np.abs(system.B).max())
    share = natural_map_vectors(p, corrected, mu, d)
    p_t, u_t = np.linalg.norm(p[:, 1:], axis=1), np.linalg.norm(u[:, 1:], axis=1)
    p_size, corrected_size = np.linalg.norm(p, axis=1), np.linalg.norm(corrected, axis=1)
    work = np.einsum("nd,nd->n", p[:, 1:], u[:, 1:])
    slides = (u_t > SLIDING * largest) & (d * p_t > SLIDING * scale)
    cosine = np.clip(-work[slides] / (p_t[slides] * u_t[slides]), -1.0, 1.0)
    return Certificate(
        natural_map=_relative(float(np.linalg.norm(share)), scale),
        cone_violation=_relative(float((d * np.maximum(p_t - mu * p[:, 0], -p[:, 0])).max(initial=0.0)), scale),
        penetration_velocity=_relative(float((-u[:, 0]).max(initial=0.0)), largest),
        complementarity=_relative(
            float(abs(np.einsum("nd,nd->", p, corrected))), float(p_size @ (corrected_size + largest))
        ),
        dissipation=_relative(float((d * work).max(initial=0.0)), scale**2),
        sliding_angle=float(np.arccos(cosine).max(initial=0.0)),
        energy_change=_energy_change(system, p),
        worst_contact=int(np.linalg.norm(share, axis=1).argmax()),
        system=system,
        impulse=p,
    )


def natural_map_vectors(impulse: Array, velocity: Array, friction: Array, scale: Array) -> Array:
    """Return d p - P_K(d p - velocity) of each contact, (n, rows), m/s.

    Written as velocity + (x - P_K(x)) with x = d p - velocity, whose second term is exactly zero inside the cone: the
    difference as it stands would lose the velocity beside impulses that run off to 1e16 times its size.
    """
    x = scale[:, None] * impulse - velocity
    return velocity + (x - project_friction_cone(x, friction))


def relative_norm(system: StackedSystem, vectors: Array) -> float:
    """Return ‖vectors‖ / ‖B‖: the norm in which every program's residual is stated."""
    flat = vectors.reshape(-1)
    return _relative(math.sqrt(float(flat @ flat)), system.size)


def _relative(value: float, scale: float) -> float:
    """Return value / scale; with no scale at all (B = 0), zero where the value is zero and infinity elsewhere."""
    if value == 0.0:
        return 0.0
    return value / scale if scale > 0.0 else float("inf")


def _energy_change(system: StackedSystem, p: Array) -> float | None:
    if system.free_velocity is None or system.jacobian is None:
        return None
    closing = np.asarray(system.jacobian @ system.free_velocity).reshape(p.shape)
    gained = 0.5 * float(np.einsum("nd,nd->", p, system.apply(p)))
    exchanged = np.einsum("nd,nd->n", p, closing)
    size = gained + float(np.abs(exchanged).sum())
    return (gained + float(exchanged.sum())) / size if size > 0.0 else 0.0

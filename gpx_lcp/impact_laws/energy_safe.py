"""One weighted inequality for all contacts, and the least energy: never a gain, with any number of frictional contacts.

    minimise the kinetic energy after the impact,  ½ pᵀA p + p·u⁻,  over the impulses p of the friction cones with
        u_n⁺ ≥ 0                                                       in every contact,
        Σ w_i u_n⁺ ≥ Σ w_i (e_i - 1) |u_n⁻|                            over the contacts that do not separate before,
        Σ w_i t_i·(-u_t⁺) ≥ Σ w_i (e_t,i - 1) ‖u_t⁻‖                   over those with tangential elasticity above 1,

w_i = 1/A_ii of the row in question, the local inertia, and t_i = u_t⁻/‖u_t⁻‖.

**Why it never gains.** Let λ be the exact plastic impulses and u_c = u⁻ + A λ. Contacts that bear an impulse are
closed, and friction brakes: λ·u_c ≤ 0, hence λᵀA λ ≤ -λ·u⁻. The impulses s λ, 1 ≤ s ≤ 2, change the energy by

    s λ·u⁻ + ½ s² λᵀA λ  ≤  s (1 - s/2) λ·u⁻  ≤  0.

They lie in the cones, and with s = max e they fulfil the first two constraints where all contacts close, as then
u_n⁺ = s u_c - (s - 1) u_n⁻ ≥ (s - 1) |u_n⁻|. Elsewhere s is the largest for which none overlaps, and the sums ask for
no more than s λ reaches. So s λ is always admitted, and what minimises the energy has no more of it than s λ. Where
tangential elasticity asks for more, λ_t may be scaled by more than λ_n: if the outcome, measured, gains no energy
either and leaves no normal velocity smaller, it stands for s λ in all this.

Source: S. Rakshit, A. Chatterjee, *Scalar generalization of Newtonian restitution for simultaneous impact*, Int. J.
Mech. Sci. 103 (2015), of which we have read the abstract: a single scalar inequality weighted with the help of local
normal inertias, and the energy-minimising impulse. The weights and the proof are ours. Departures: (1) Σ w u_n⁺ is
bounded from above, too, by what is asked or s λ reaches, whichever is more; without it the least energy makes a sliding
contact jump, for the friction that more normal impulse gives; (2) cones instead of facets; (3) the third inequality;
(4) where not all contacts close, no more is asked than s λ reaches.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np
import scipy.sparse as sp

from formulations.checks import Array
from gpx_lcp.impact_laws._interface import Collision, ImpactLaw, Impulses
from gpx_lcp.solution import Solution, Status

# Method of multipliers: passes at most, and the weight of the penalty as a multiple of 1/max (A_nn)_ii.
# The weight grows where a pass leaves more than the share SLOW of the violation; large ones cost accuracy.
PASSES: Final = 100
PENALTY: Final = 1e2
LARGEST_PENALTY: Final = 1e5
SLOW: Final = 0.5
# Nothing below is asked of the programs within.
LEAST_TOLERANCE: Final = 1e-13


def run(collision: Collision) -> Impulses:
    """Minimise the energy over what the inequalities allow."""
    plastic = collision.solve(-collision.before)
    closing = -collision.before[:, 0]
    restitution = collision.acting(closing)
    if not restitution.any():
        return Impulses(plastic.impulse, (plastic,))
    safe = _safe(collision, plastic.impulse, restitution.max(axis=0))
    matrix, least = _inequalities(collision, restitution, safe)
    solution, violation, passes = _minimise(collision, matrix, least, safe)
    found = violation <= collision.tolerance
    impulse = _without_gain(collision, solution.impulse[: len(safe)] if found else safe, plastic.impulse)
    return Impulses(impulse, (plastic, solution), found, {"violation": violation, "passes": passes})


def _safe(collision: Collision, plastic: Array, restitution: Array) -> Array:
    """Return impulses that gain no energy and let no contact overlap, from the plastic λ: s λ, or more of λ_t."""
    normal, tangential = restitution
    safe = _scale(collision, plastic, float(normal)) * plastic
    if tangential <= normal:
        return np.asarray(safe)
    more = safe.copy()
    size = np.linalg.norm(plastic[:, 1:], axis=1)
    limit = np.where(size > 0.0, collision.friction * safe[:, 0] / np.where(size > 0.0, size, 1.0), 0.0)
    more[:, 1:] = np.minimum(1.0 + tangential, limit)[:, None] * plastic[:, 1:]
    kept = collision.apply(more - safe)[:, 0] >= -collision.rounding
    return more if collision.energy(more) <= 0.0 and kept.all() else np.asarray(safe)


def _scale(collision: Collision, plastic: Array, restitution: float) -> float:
    """Return the largest s ≤ 1 + restitution for which s λ lets no contact overlap."""
    before = collision.before[:, 0]
    after = before + collision.apply(plastic)[:, 0]
    leaving = before > np.maximum(after, 0.0)
    limits = np.maximum(after[leaving], 0.0) / (before[leaving] - np.maximum(after[leaving], 0.0))
    return 1.0 + min(restitution, float(limits.min(initial=np.inf)))


def _inequalities(collision: Collision, restitution: Array, safe: Array) -> tuple[Array, Array]:
    """Return G, (m, rows n), and h of the inequalities G p ≥ h, N s; the impulses `safe` fulfil them."""
    n, rows = collision.before.shape
    before = collision.before
    diagonal = np.asarray(collision.A.diagonal()).reshape(n, rows)
    weights = 1.0 / np.where(diagonal > 0.0, diagonal, np.inf)
    reached = before + collision.apply(safe)
    staying = before[:, 0] <= 0.0
    normal = np.zeros((n, n, rows))
    normal[np.arange(n), np.arange(n), 0] = weights[:, 0]
    bounce = np.zeros((n, rows))
    bounce[:, 0] = weights[:, 0] * staying
    asked, offered = np.vdot(bounce[:, 0], -restitution[:, 0] * before[:, 0]), np.vdot(bounce, reached)
    offset = np.vdot(bounce, before)
    rows_of_velocity = [*normal, bounce, -bounce]
    least = [*(-weights[:, 0] * before[:, 0]), min(asked, offered) - offset, offset - max(asked, offered)]
    if restitution[:, 1].any() and rows > 1:
        size = np.linalg.norm(before[:, 1:], axis=1)
        reversal = np.zeros((n, rows))
        sliding = (size > collision.rounding) & (restitution[:, 1] > 0.0)
        reversal[sliding, 1:] = -(weights[sliding, 1:] * before[sliding, 1:]) / size[sliding, None]
        wanted = -np.vdot(reversal[:, 1:], restitution[:, 1:] * before[:, 1:])
        rows_of_velocity.append(reversal)
        least.append(min(wanted, np.vdot(reversal, reached)) - np.vdot(reversal, before))
    stacked = np.array(rows_of_velocity).reshape(len(rows_of_velocity), -1)
    return np.asarray((collision.A.T @ stacked.T).T), np.array(least)


def _minimise(collision: Collision, matrix: Array, least: Array, safe: Array) -> tuple[Solution, float, int]:
    """Minimise the energy over the cones and G p ≥ h by the method of multipliers.

    Returns the last pass, whose first n impulses are p, how far from h it ends as a share of the impulses, and the
    number of passes.

    With slacks z ≥ 0 each pass is a cone program in (p, z): min ½ pᵀA p + p·u⁻ - y·(G p - z - h) + ½ ρ ‖G p - z - h‖².
    """
    n, rows = collision.before.shape
    count = least.size
    largest = float(collision.normal_diagonal.max())
    slacks = np.zeros((count, rows * count))
    slacks[np.arange(count), rows * np.arange(count)] = -1.0
    joined = np.hstack((matrix, slacks))
    squares = joined.T @ joined
    energy = np.zeros_like(squares)
    energy[: rows * n, : rows * n] = collision.A.toarray() if sp.issparse(collision.A) else collision.A
    start = np.concatenate((-collision.before.ravel(), np.zeros(rows * count)))
    friction = np.concatenate((collision.friction, np.zeros(count)))
    multiplier = np.zeros(count)
    size = float(np.abs(safe).max())
    # The penalty stands in B and A, so that a share of ‖B‖ is more of a velocity than elsewhere.
    tolerance = max(1e-2 * collision.tolerance, LEAST_TOLERANCE)
    program = "cone" if rows > 1 else "normal"
    weight, violation, passes = PENALTY * largest, np.inf, 0
    while True:
        passes += 1
        A = energy + weight * squares
        B = start + joined.T @ (multiplier + weight * least)
        solution = collision.solve(B, friction, 0.5 * (A + A.T), formulation=program, tolerance=tolerance)
        residual = joined @ solution.impulse.ravel() - least
        multiplier -= weight * residual
        last, violation = violation, float(np.abs(residual).max()) / size
        if violation <= collision.tolerance or passes == PASSES:
            break
        if violation > SLOW * last:
            weight = min(10.0 * weight, LARGEST_PENALTY * largest)
    if solution.program_residual <= collision.tolerance:  # what was asked of the law; more was tried
        solution = replace(solution, status=Status.SOLVED)
    return solution, violation, passes


def _without_gain(collision: Collision, impulse: Array, plastic: Array) -> Array:
    """Return the impulses, moved towards the plastic ones by what the rounding of an elastic impact gained."""
    gain, loss = collision.energy(impulse), collision.energy(plastic)
    if gain <= 0.0 or loss >= 0.0:
        return impulse
    share = gain / (gain - loss)
    return np.asarray((1.0 - share) * impulse + share * plastic)


LAW = ImpactLaw(
    name="energy_safe",
    summary="one weighted inequality for all contacts, and the least energy",
    promises="Never gains energy, with any number of contacts, friction and elasticities. A single contact leaves with "
    "(e - 1) times the speed at which it closed.",
    breaks="With several contacts only the weighted sum of the rebounds is what elasticity says, and energy is lost "
    "even at elasticity 2: a cradle of three gives (-1/6, 1/3, 5/6).",
    run=run,
)

"""Poisson's law: a phase of compression that stops the closing, and one of restitution that gives impulse back.

Compression is plastic, the exact Coulomb problem with B = -u⁻. Its impulses λ leave u_c = u⁻ + A λ. Restitution adds r
with at least (e - 1) times the normal impulse of compression, and more only where bodies would overlap without,

    0 ≤ r_n - (e - 1) λ_n  ⟂  u_n⁺ ≥ 0,        ‖r_t‖ ≤ μ r_n, against the sliding that is left,   u⁺ = u_c + A r,

where sliding counts from -(e_t - 1) u_t⁻: friction drives the tangential velocity there as far as Coulomb's bound lets
it, which is what stops it at e_t = 1 and turns it round at e_t = 2. Elasticity acts in contacts whose compression took
up more than the impact speed, λ_n (A_nn)_ii: the closing speed that λ_n stops in a contact alone.

Friction leans on the given normal impulse, which is no unknown. It becomes a contact of its own, whose normal belongs
to a private mass that exactly (e - 1) λ_n stops, and whose tangents are those of the contact: the whole phase is one
more exact Coulomb problem.

Without friction it never gains energy. Compression loses ½ λᵀA λ. With b = (e - 1) λ and r = b + x, restitution gains
½ (bᵀA b - xᵀA x), the least of ½ (b + x)ᵀA (b + x) + x·u_c over x ≥ 0; x = λ - b is admitted and gives ½ λᵀA λ, since
u_c vanishes where λ does not.

Source: Ch. Glocker, F. Pfeiffer, *Multiple impacts with friction in rigid multibody systems*, Nonlinear Dynamics 7
(1995); Ch. Glocker, *Energetic consistency conditions for standard impacts, part II*, Multibody Syst. Dyn. 32 (2014)
for the gains of several contacts. Departures: (1) the friction cone instead of its plane section; (2) tangential
elasticity after Newton, on the velocity, instead of a share of the tangential impulse.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from formulations.checks import Array
from gpx_lcp.impact_laws._interface import Collision, ImpactLaw, Impulses
from gpx_lcp.solution import Solution


def run(collision: Collision) -> Impulses:
    """Compress, then give back."""
    compression = collision.solve(-collision.before)
    restitution = collision.acting(compression.impulse[:, 0] * collision.normal_diagonal)
    if not restitution.any():
        return Impulses(compression.impulse, (compression,))
    given = restitution[:, 0] * np.maximum(compression.impulse[:, 0], 0.0)
    impulse, expansion = _expand(collision, compression, given, restitution[:, 1])
    return Impulses(compression.impulse + impulse, (compression, expansion))


def _expand(collision: Collision, compression: Solution, given: Array, tangential: Array) -> tuple[Array, Solution]:
    """Return the impulses of restitution, (n, rows), and the Solution that they come from."""
    n, rows = collision.before.shape
    start = np.zeros((n, rows))
    start[:, 0] = given
    B = -(collision.before + collision.apply(compression.impulse + start))
    B[:, 1:] -= tangential[:, None] * collision.before[:, 1:]
    leaning = np.flatnonzero((given > 0.0) & (collision.friction > 0.0)) if rows > 1 else np.zeros(0, np.intp)
    # Rows of the contacts as they are, then of those with a private normal: their tangents again, and nothing.
    copied = (rows * leaning[:, None] + np.arange(rows)).ravel()
    of_tangents = np.tile(np.arange(rows) > 0, leaning.size)
    at = np.arange(rows * n, rows * (n + leaning.size))[of_tangents]
    both = sp.csr_array(
        (
            np.ones(rows * n + at.size),
            (np.concatenate((np.arange(rows * n), at)), np.concatenate((np.arange(rows * n), copied[of_tangents]))),
        ),
        shape=(rows * (n + leaning.size), rows * n),
    )
    private = np.zeros((n + leaning.size, rows))
    private[n:, 0] = collision.normal_diagonal[leaning]
    A = both @ sp.csr_array(collision.A) @ both.T + sp.diags_array(private.ravel())
    leaning_B = B[leaning]
    leaning_B[:, 0] = collision.normal_diagonal[leaning] * given[leaning]
    solution = collision.solve(
        np.concatenate((B, leaning_B)),
        np.concatenate((collision.friction, collision.friction[leaning])),
        sp.csr_array(A),
    )
    impulse = start + solution.impulse[:n]
    impulse[leaning, 1:] += solution.impulse[n:, 1:]
    return impulse, solution


LAW = ImpactLaw(
    name="poisson",
    summary="a phase of compression, and one that gives (e - 1) times its impulse back",
    promises="Each contact gives back e - 1 of the impulse of its compression. Without friction no energy is gained.",
    breaks="Several contacts with friction can gain energy: see the linkages. With friction the rebound is not e - 1 "
    "of the closing speed (Kane's double pendulum). A row of equal balls is no cradle.",
    run=run,
)

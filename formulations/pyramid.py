"""Coulomb's law with the friction disc replaced by a regular polygon inside it.

**LCP** (Stewart and Trinkle). p_t = D β over the corners d_1 … d_k of the polygon, β ≥ 0, and with λ the speed of
slip along the corner that opposes it best,

    0 ≤ p_n ⟂ u_n ≥ 0,     0 ≤ β ⟂ Dᵀ u_t + e λ ≥ 0,     0 ≤ λ ⟂ μ p_n - eᵀ β ≥ 0.

Friction dissipates as much as the polygon lets it, contacts do not open by sliding; its strength depends on the
direction: μ cos(π/k) … μ. This is the program named "pyramid".

**QP**. min ½ pᵀ A p - Bᵀ p over {p_t ∈ μ p_n P}, convex, named "pyramid_qp": a sliding contact opens at the speed
u_n = max over corners of -μ d·u_t (the associated law), which Coulomb's does not.

The map back is p_t = D β for the LCP and nothing for the QP.

Sources: D. E. Stewart, J. C. Trinkle, *An implicit time-stepping scheme for rigid body dynamics with inelastic
collisions and Coulomb friction*, Int. J. Numer. Meth. Eng. 39 (1996), eqs. 13-16, for the LCP; the QP is the
polyhedral case of M. Anitescu, *Optimization-based simulation of nonsmooth rigid multibody dynamics*, Math. Program.
105 (2006).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
import scipy.sparse as sp

from formulations.certificate import relative_norm
from formulations.checks import Array
from formulations.cones import project_polygon, project_polyhedral_cone, pyramid_directions
from formulations.lcp import LCP
from formulations.qp import QP
from formulations.system import StackedSystem

DEFAULT_FACETS: Final = 8


def pyramid_lcp(system: StackedSystem, facets: int = DEFAULT_FACETS) -> LCP:
    """Pose the contacts as Stewart and Trinkle's LCP in z = (p_n; β; λ), contact by contact."""
    return friction_lcp(system, [pyramid_directions(system.rows, facets)])


def pyramid_impulse(system: StackedSystem, z: Array, facets: int = DEFAULT_FACETS) -> Array:
    """Map z = (p_n; β; λ) of every contact back to contact impulses (n, rows)."""
    return friction_lcp_impulse(system, z, [pyramid_directions(system.rows, facets)])


def friction_lcp(system: StackedSystem, groups: Sequence[Array]) -> LCP:
    """Pose friction with one bound eᵀβ ≤ μ p_n for each group of tangent directions; shared with the box.

    Parameters
    ----------
    groups : sequence of (k, rows - 1) arrays
        The directions d_j of each group; p_t = Σ β_j d_j over all of them.
    """
    basis = _basis(system, groups)
    size = basis.shape[1]
    width = size // system.contacts
    bound, total = _bounds(system, groups)
    matrix = system.A if isinstance(system.A, np.ndarray) else system.A.toarray()
    M = np.asarray(basis.T @ (basis.T @ matrix.T).T)
    M += total - bound.T
    q = -np.asarray(basis.T @ system.B)
    assert M.shape == (size, size) and width * system.contacts == size
    return LCP(M, q)


def friction_lcp_impulse(system: StackedSystem, z: Array, groups: Sequence[Array]) -> Array:
    """Map the LCP's z back to impulses: p_n as it is, p_t = Σ β_j d_j."""
    return np.asarray(_basis(system, groups) @ z).reshape(system.contacts, system.rows)


def pyramid_qp(system: StackedSystem, facets: int = DEFAULT_FACETS) -> QP:
    """Pose the contacts as the convex QP over the pyramids, in the stacked impulses."""
    corners = pyramid_directions(system.rows, facets)
    if system.rows == 1:
        return QP.from_matrix(system.A, -system.B, lower=np.zeros(system.contacts))
    normals = corners if system.rows == 2 else 0.5 * (corners + np.roll(corners, -1, axis=0))
    support = np.einsum("kd,kd->k", normals, corners)
    blocks = np.empty((system.contacts, len(normals) + 1, system.rows))
    blocks[:, :-1, 0] = -system.friction[:, None] * support
    blocks[:, :-1, 1:] = normals
    blocks[:, -1, :] = 0.0
    blocks[:, -1, 0] = -1.0
    facet_rows = sp.bsr_array((blocks, np.arange(system.contacts), np.arange(system.contacts + 1)))
    return QP.from_matrix(system.A, -system.B, facets=facet_rows)


def pyramid_residual(system: StackedSystem, impulse: Array, facets: int = DEFAULT_FACETS) -> float:
    """Return the residual of the LCP in impulses; see `friction_residual`."""
    return friction_residual(system, impulse, pyramid_directions(system.rows, facets))


def friction_residual(system: StackedSystem, impulse: Array, corners: Array) -> float:
    """Return the natural map of Signorini's condition and of maximal dissipation over a polygon, relative to ‖B‖.

    ‖(d p_n - (d p_n - u_n)⁺,  d p_t - Π(d p_t - u_t))‖ / ‖B‖,  Π the projection onto d μ p_n⁺ times the polygon.
    """
    scaled = system.scale[:, None] * impulse
    velocity = system.velocity(impulse)
    radius = system.friction * np.maximum(scaled[:, 0], 0.0)
    vectors = np.empty_like(scaled)
    normal, tangent = scaled[:, 0] - velocity[:, 0], scaled[:, 1:] - velocity[:, 1:]
    vectors[:, 0] = velocity[:, 0] + np.minimum(normal, 0.0)
    vectors[:, 1:] = velocity[:, 1:] + (tangent - project_polygon(tangent, radius, corners))
    return relative_norm(system, vectors)


def pyramid_qp_residual(system: StackedSystem, impulse: Array, facets: int = DEFAULT_FACETS) -> float:
    """Return ‖d p - P(d p - u)‖ / ‖B‖ with P the projection onto the pyramids: zero exactly at the QP's solution."""
    velocity = system.velocity(impulse)
    x = system.scale[:, None] * impulse - velocity
    projected = project_polyhedral_cone(x, system.friction, pyramid_directions(system.rows, facets))
    return relative_norm(system, velocity + (x - projected))


def _basis(system: StackedSystem, groups: Sequence[Array]) -> sp.csr_array:
    """Return the block-diagonal matrix from z to impulses: a column for p_n, one for each β, and zeros for each λ."""
    # Contacts of one row have no tangent directions, and their box has no group of them.
    directions = np.concatenate([np.zeros((0, system.rows - 1)), *groups])
    block = np.zeros((system.rows, 1 + len(directions) + len(groups)))
    block[0, 0] = 1.0
    block[1:, 1 : 1 + len(directions)] = directions.T
    return sp.csr_array(sp.kron(sp.eye_array(system.contacts), sp.csr_array(block)))


def _bounds(system: StackedSystem, groups: Sequence[Array]) -> tuple[Array, Array]:
    """Return the couplings of β and λ: E with λ added to each β's row, and its transpose less the friction bound."""
    directions = sum(len(group) for group in groups)
    width = 1 + directions + len(groups)
    spread = np.zeros((width, width))
    capacity = np.zeros((width, width))
    first = 1
    for number, group in enumerate(groups):
        spread[first : first + len(group), 1 + directions + number] = 1.0
        capacity[0, 1 + directions + number] = 1.0
        first += len(group)
    eye = np.eye(system.contacts)
    coupling = np.kron(eye, spread).astype(np.float64)
    return coupling - np.kron(np.diag(system.friction), capacity), coupling

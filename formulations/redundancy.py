"""Whether the impulses of a solution are the only ones that give its velocities.

Redundant contacts (a table on four legs, the four corners of a box) share a load in more than one way. The body
velocities do not say how: impulses p + q give the same ones wherever A q = 0. For given velocities u Coulomb's law
leaves to each contact

    open      (u_n > 0)             p = 0,
    sliding   (u_n = 0, u_t ≠ 0)    p = λ (1, -μ u_t/‖u_t‖),  λ ≥ 0,
    sticking  (u = 0)               p in the friction cone K,

so that the impulses of a solution form a convex set, {N z : z ∈ C, A N z = A p}, with an orthonormal basis of each
contact's face in the columns of N and the cones C that bound the faces. `minimum_norm` takes one point of it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import numpy.typing as npt
import scipy.sparse as sp

from formulations.checks import Array, as_array
from formulations.system import StackedSystem

# A contact velocity below this share of max |B| is zero: between a solver's error and any motion that matters.
STILL: Final = 1e-6
# Eigenvalues below this share of the largest are zero. A tower of 50 cubes has honest ones at 4e-8.
RANK_TOLERANCE: Final = 1e-10
# Rows beyond which no dense eigenvalue problem is started; that many take some seconds.
LARGEST: Final = 3000


@dataclass(frozen=True)
class Uniqueness:
    """The contact states of a solution, and the freedom that they leave to its impulses.

    Attributes
    ----------
    open, sliding, sticking : int
        Numbers of contacts. A closed contact without friction counts as sliding: it has its normal alone.
    rank, nullity : int or None
        Of A on the faces of the contacts, NᵀA N; they add up to 3 for each sticking contact in space (2 in the plane)
        and 1 for each sliding one. With nullity 0 the velocities determine the impulses. Otherwise so many directions
        change no velocity; how far the impulses may move along them is for the cones to say. None where the smaller of
        the matrices NᵀA N and Ĵᵀ N Nᵀ Ĵ has more than 3000 rows.
    """

    open: int
    sliding: int
    sticking: int
    rank: int | None
    nullity: int | None


def uniqueness(system: StackedSystem, impulse: npt.ArrayLike) -> Uniqueness:
    """Count rank and nullity of A on the faces of the contacts, at a solution.

    Rows are scaled to unit diagonal, so that masses do not matter. An eigenvalue counts as zero below 1e-10 of the
    largest, or below twice what the most negative one shows the rounding of A to be: the A of problem files carries
    six digits.

    Parameters
    ----------
    system : StackedSystem
    impulse : (n, rows) array, N s
        A solution; see `certify` for how good a one.

    Raises
    ------
    ProblemError
        When the impulses have another shape or are not finite.
    """
    p = as_array("impulse", impulse, (system.contacts, system.rows))
    basis, friction = contact_faces(system, p)
    sizes = np.abs(basis).any(axis=1).sum(axis=1)
    open_, sticking = int((sizes == 0).sum()), int((friction > 0.0).sum())
    width = int(sizes.sum())
    rank = _rank(system, basis)
    return Uniqueness(open_, system.contacts - open_ - sticking, sticking, rank, None if rank is None else width - rank)


def contact_faces(system: StackedSystem, p: Array) -> tuple[Array, Array]:
    """Return N as blocks (n, rows, rows), unused columns zero, and the friction of each cone in its coordinates."""
    u = system.velocity(p)
    still = STILL * float(np.abs(system.B).max(initial=0.0))
    slip = np.linalg.norm(u[:, 1:], axis=1)
    closed = (u[:, 0] <= still) & (system.scale > 0.0)
    sticks = closed & (slip <= still) & (system.friction > 0.0) & (system.rows > 1)
    faces = np.zeros((system.contacts, system.rows, system.rows))
    faces[sticks] = np.eye(system.rows)
    slides = closed & ~sticks
    mu = system.friction[slides]
    faces[slides, 0, 0] = 1.0
    direction = u[slides, 1:] / np.where(slip > still, slip, np.inf)[slides, None]
    faces[slides, 1:, 0] = -mu[:, None] * direction
    faces[slides, :, 0] /= np.linalg.norm(faces[slides, :, 0], axis=1)[:, None]
    return faces, np.where(sticks, system.friction, 0.0)


def _rank(system: StackedSystem, faces: Array) -> int | None:
    used = np.abs(faces).any(axis=1).reshape(-1)
    factor = system.whitened_jacobian
    N = block_diagonal(faces)
    if factor is None:
        if used.sum() > LARGEST:
            return None
        gram = dense(N.T @ (system.A @ N))[np.ix_(used, used)]
    else:
        if min(used.sum(), factor.shape[1]) > LARGEST:
            return None
        rows = sp.csr_array(N.T @ factor)[used]
        size = np.sqrt(np.asarray(rows.multiply(rows).sum(axis=1)).reshape(-1))
        rows = sp.csr_array(sp.dia_array((_inverse(size)[None, :], [0]), shape=(size.size, size.size)) @ rows)
        gram = dense(rows @ rows.T if used.sum() <= factor.shape[1] else rows.T @ rows)
    if gram.size == 0:
        return 0
    if factor is None:
        weight = _inverse(np.sqrt(np.maximum(gram.diagonal(), 0.0)))
        gram = 0.5 * weight[:, None] * (gram + gram.T) * weight
    return int(not_zero(np.asarray(np.linalg.eigvalsh(gram), np.float64)).sum())


def not_zero(values: Array) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    """Return which eigenvalues, rising, of a matrix that should be positive semidefinite are not zero."""
    return np.asarray(values > max(RANK_TOLERANCE * values[-1], -2.0 * values[0]))


def block_diagonal(blocks: Array) -> sp.bsr_array:
    """Return the matrix of square blocks (n, size, size) along the diagonal."""
    count, size, _ = blocks.shape
    return sp.bsr_array((blocks, np.arange(count), np.arange(count + 1)), shape=(count * size, count * size))


def dense(matrix: Any) -> Array:
    """Return a matrix as an array."""
    return np.asarray(matrix.toarray() if sp.issparse(matrix) else matrix)


def _inverse(values: Array) -> Array:
    return np.asarray(1.0 / np.where(values > 0.0, values, np.inf))

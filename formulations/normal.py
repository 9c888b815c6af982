"""The frictionless program: Signorini's condition alone, 0 ≤ p_n ⟂ u_n = A_nn p_n - B_n ≥ 0.

It is an LCP with a symmetric positive semidefinite matrix, hence the optimality condition of the convex QP

    min ½ p_nᵀ A_nn p_n - B_nᵀ p_n    over p_n ≥ 0,

and the velocities are unique even where redundant contacts leave the impulses open. The map back sets p_t = 0.
"""

from __future__ import annotations

import numpy as np

from formulations.certificate import relative_norm
from formulations.checks import Array
from formulations.lcp import LCP
from formulations.qp import QP
from formulations.system import Matrix, StackedSystem


def normal_matrix(system: StackedSystem) -> Matrix:
    """Return A_nn, (n, n), 1/kg: the rows and columns of the normals."""
    return system.A[:: system.rows, :: system.rows]


def normal_lcp(system: StackedSystem) -> LCP:
    """Pose the frictionless contacts as an LCP in the normal impulses, dense."""
    matrix = normal_matrix(system)
    return LCP(matrix if isinstance(matrix, np.ndarray) else matrix.toarray(), -system.B[:: system.rows])


def normal_qp(system: StackedSystem) -> QP:
    """Pose the frictionless contacts as a convex QP in the normal impulses, sparse."""
    return QP.from_matrix(normal_matrix(system), -system.B[:: system.rows], lower=np.zeros(system.contacts))


def normal_impulse(system: StackedSystem, normal: Array) -> Array:
    """Map normal impulses (n,) back to contact impulses (n, rows)."""
    impulse = np.zeros((system.contacts, system.rows))
    impulse[:, 0] = normal
    return impulse


def normal_residual(system: StackedSystem, impulse: Array) -> float:
    """Return ‖(d p_n - (d p_n - u_n)⁺, d p_t)‖ / ‖B‖: zero exactly at a solution, where p_t vanishes too."""
    vectors = system.scale[:, None] * impulse
    velocity = system.velocity(impulse)[:, 0]
    vectors[:, 0] = velocity + np.minimum(vectors[:, 0] - velocity, 0.0)
    return relative_norm(system, vectors)

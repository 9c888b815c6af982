"""The smallest impulses that give the velocities of a solution, where redundant contacts leave a choice.

With the notation of `redundancy` and rows G that span those of A (Ĵᵀ where the system carries it), the problem is

    min ½‖z‖²    subject to    G N z = G p,  z ∈ C,         impulses N z.

Its solution is z = P_C(Nᵀ Gᵀ w), where w minimises the convex function ½‖P_C(Nᵀ Gᵀ w)‖² - (G p)ᵀ w: Newton's method and
step halving find it, in one step where the plain least-norm impulses leave no cone.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np
import numpy.typing as npt
import scipy.linalg
import scipy.sparse as sp
import scipy.sparse.linalg

from formulations.certificate import certify
from formulations.checks import Array, as_array
from formulations.cones import friction_cone_derivative, project_friction_cone
from formulations.errors import ProblemError
from formulations.redundancy import LARGEST, block_diagonal, contact_faces, dense, not_zero
from formulations.system import StackedSystem

NEWTON_STEPS: Final = 100
# Relative to the size of G p; and added to the Newton matrix, which is singular on velocities that no contact feels.
ROUNDING: Final = 1e-13
DAMPING: Final = 1e-12


def minimum_norm(system: StackedSystem, impulse: npt.ArrayLike, *, tolerance: float = 1e-8) -> Array:
    """Return the impulses of least norm √Σ‖p_i‖² among all that solve the system with the same velocities.

    Which ones these are is a question without unit: every row of p is an impulse in N s. A box on its four corners gets
    a quarter of its weight on each, and equal contacts are treated equally.

    Parameters
    ----------
    system : StackedSystem
    impulse : (n, rows) array, N s
        A solution of Coulomb's law.
    tolerance : float
        Bound on the `natural_map` of the impulses given, and of those returned unless the given ones have more.

    Returns
    -------
    (n, rows) array, N s
        The impulses as they were where none of smaller norm is found with so small a natural map. That happens where
        the cones leave no room, or where the A of a problem file is rounded so coarsely that its rank is in doubt.

    Raises
    ------
    ProblemError
        When the impulses have another shape, are not finite or are no solution to the tolerance, or when the system
        carries A alone with more than 3000 rows (its eigenvectors are needed).
    """
    p = as_array("impulse", impulse, (system.contacts, system.rows))
    found = certify(system, p).natural_map
    if found > tolerance:
        raise ProblemError(
            f"impulse has natural_map {found:.2g}: only a solution, with at most {tolerance:g}, has a least norm"
        )
    if not p.any():
        return p.copy()
    smaller = _least_norm(system, p)
    better = np.linalg.norm(smaller) < np.linalg.norm(p) and certify(system, smaller).natural_map <= tolerance
    return smaller if better else p.copy()


def _least_norm(system: StackedSystem, p: Array) -> Array:
    faces, friction = contact_faces(system, p)
    N = block_diagonal(faces)
    rows: Any = _spanning_rows(system) @ N
    feasible = project_friction_cone((N.T @ p.reshape(-1)).reshape(p.shape), friction)
    target = rows @ feasible.reshape(-1)
    w, aim = np.zeros(rows.shape[0]), np.zeros(p.shape)
    z = aim
    # At the apex the projection has no derivative; the identity makes the first step the plain least-norm solution.
    derivative = np.broadcast_to(np.eye(system.rows), faces.shape)
    for _ in range(NEWTON_STEPS):
        gradient = rows @ z.reshape(-1) - target
        if np.linalg.norm(gradient) <= ROUNDING * np.linalg.norm(target):
            break
        dw = _solve(rows, derivative, -gradient)
        step = (rows.T @ dw).reshape(p.shape)
        value, slope, length = 0.5 * np.square(z).sum() - target @ w, gradient @ dw, 1.0
        while True:
            z = project_friction_cone(aim + length * step, friction)
            reached = 0.5 * np.square(z).sum() - target @ (w + length * dw)
            if reached <= value + 1e-4 * length * slope or length < 1e-6:
                break
            length *= 0.5
        w, aim = w + length * dw, aim + length * step
        derivative = friction_cone_derivative(aim, friction)
    return np.asarray((N @ z.reshape(-1)).reshape(p.shape))


def _spanning_rows(system: StackedSystem) -> Any:
    """Return rows that span the rows of A: Ĵᵀ, sparse, or the eigenvectors of the symmetric part of A."""
    if system.whitened_jacobian is not None:
        return sp.csr_array(system.whitened_jacobian.T)
    if system.B.size > LARGEST:
        raise ProblemError(f"A has {system.B.size} rows: without a Jacobian, at most {LARGEST} can be handled")
    A = dense(system.A)
    values, vectors = scipy.linalg.eigh(0.5 * (A + A.T))
    return vectors[:, not_zero(values)].T


def _solve(rows: Any, derivative: Array, right: Array) -> Array:
    """Return x with (R P Rᵀ + a little) x = right."""
    matrix = rows @ block_diagonal(derivative) @ rows.T
    little = DAMPING * float(matrix.diagonal().max())
    if sp.issparse(matrix):
        matrix = sp.csc_array(matrix + little * sp.eye_array(right.size))
        return np.asarray(scipy.sparse.linalg.splu(matrix).solve(right))
    matrix[np.diag_indices(right.size)] += little
    return np.asarray(scipy.linalg.solve(matrix, right, assume_a="pos"))

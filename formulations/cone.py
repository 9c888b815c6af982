"""The convex relaxation: friction cones, but contacts that open as they slide.

    min ½ pᵀ A p - Bᵀ p    over p ∈ K,      or   K ∋ p ⟂ u = A p - B ∈ K*.

It is Coulomb's law without De Saxcé's correction: isotropic, convex, with unique velocities, yet u_n = μ‖u_t‖ while
sliding. A point mass thrown along a plane at speed v meets p_n = m (g dt + μ v)/(1 + μ²) instead of m g dt in its first
step. With μ = 0, and wherever every contact sticks, it is exact. Impulses need no map back.

As a second-order cone program the contact vector is scaled to x = (μ p_n, p_t), ‖x_t‖ ≤ x_n; contacts without friction
become single rows p_n ≥ 0.

Source: M. Anitescu, *Optimization-based simulation of nonsmooth rigid multibody dynamics*, Math. Program. 105 (2006);
V. Acary, F. Cadoux, C. Lemaréchal, J. Malick, *A formulation of the linear discrete Coulomb friction problem via
convex optimization*, ZAMM 91 (2011), with s = 0.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from formulations.certificate import natural_map_vectors, relative_norm
from formulations.checks import Array
from formulations.qp import QP
from formulations.system import StackedSystem


def cone_qp(system: StackedSystem) -> QP:
    """Return the objective of the cone program; its constraint is p ∈ K, see `cone_rows`."""
    return QP.from_matrix(system.A, -system.B)


def cone_rows(system: StackedSystem) -> tuple[sp.csc_array, list[int]]:
    """Return S and the sizes of the second-order cones with S p ∈ Q, (μ p_n, p_t) contact by contact.

    A contact without friction has μ p_n = 0 as its first row, which forces p_t = 0; its p_n ≥ 0 is a cone of one row
    of its own, appended at the end. So is it for every contact, which costs nothing and keeps the cones regular.
    """
    weights = np.ones((system.contacts, system.rows))
    weights[:, 0] = system.friction
    cones = sp.dia_array((weights.reshape(1, -1), [0]), shape=(system.B.size, system.B.size))
    normals = sp.eye_array(system.B.size, format="csr")[:: system.rows]
    sizes = [system.rows] * system.contacts + [1] * system.contacts
    return sp.csc_array(sp.vstack((cones, normals))), sizes


def cone_residual(system: StackedSystem, impulse: Array) -> float:
    """Return ‖d p - P_K(d p - u)‖ / ‖B‖: zero exactly at the cone program's solution."""
    velocity = system.velocity(impulse)
    return relative_norm(system, natural_map_vectors(impulse, velocity, system.friction, system.scale))

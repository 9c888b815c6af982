"""The exact Coulomb law, the default truth:  K ∋ p ⟂ û ∈ K*,  û = u + μ‖u_t‖ n,  u = A p - B.

De Saxcé's correction turns Signorini's condition and Coulomb's law of maximal dissipation into one complementarity
over the friction cone: a contact opens (p = 0, u_n ≥ 0), sticks (u = 0, p ∈ K) or slides (u_n = 0, p_t = -μ p_n
u_t/‖u_t‖). It is not the optimality condition of any convex program: solutions may be several, or none.

Source: G. De Saxcé, Z.-Q. Feng, *The bipotential method*, Math. Comput. Modelling 28 (1998); V. Acary, M. Brémond,
O. Huber, INRIA RR-9118 (2018), eqs. 5-9.
"""

from __future__ import annotations

from formulations.certificate import natural_map_vectors, relative_norm
from formulations.checks import Array
from formulations.cones import de_saxce
from formulations.system import StackedSystem


def coulomb_residual(system: StackedSystem, impulse: Array) -> float:
    """Return ‖d p - P_K(d p - û)‖ / ‖B‖: the certificate's natural map."""
    corrected = de_saxce(system.velocity(impulse), system.friction)
    return relative_norm(system, natural_map_vectors(impulse, corrected, system.friction, system.scale))

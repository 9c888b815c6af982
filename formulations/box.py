"""Coulomb's law with the friction disc replaced by a square round it: |p_t1| ≤ μ p_n and |p_t2| ≤ μ p_n.

The boxed LCP of the game engines (bounds that follow p_n, their "findex"): each tangent axis has its own bound, so

    0 ≤ p_n ⟂ u_n ≥ 0,      p_ta = μ p_n where u_ta < 0,  -μ p_n where u_ta > 0,  between them where u_ta = 0.

As an LCP it is Stewart and Trinkle's with one group of directions ±e_a, and one λ_a, for each axis. Friction reaches
μ p_n along an axis and √2 μ p_n between two: a box thrown askew stops short and turns towards an axis. The map back
is p_ta = β_a⁺ - β_a⁻.

Source: P. Lötstedt, *Mechanical systems of rigid bodies subject to unilateral constraints* (1982); D. Baraff,
*Fast contact force computation for nonpenetrating rigid bodies*, SIGGRAPH 1994, for the bounds that follow p_n.
"""

from __future__ import annotations

import numpy as np

from formulations.checks import Array
from formulations.cones import box_directions
from formulations.lcp import LCP
from formulations.pyramid import friction_lcp, friction_lcp_impulse, friction_residual
from formulations.system import StackedSystem


def box_lcp(system: StackedSystem) -> LCP:
    """Pose the contacts as an LCP in z = (p_n; β₁⁺, β₁⁻, β₂⁺, β₂⁻; λ₁, λ₂), contact by contact."""
    return friction_lcp(system, _axes(system.rows))


def box_impulse(system: StackedSystem, z: Array) -> Array:
    """Map z back to contact impulses (n, rows)."""
    return friction_lcp_impulse(system, z, _axes(system.rows))


def box_residual(system: StackedSystem, impulse: Array) -> float:
    """Return the residual of the boxed LCP in impulses, ‖natural map‖ / ‖B‖; see `friction_residual`."""
    return friction_residual(system, impulse, box_directions(system.rows))


def _axes(rows: int) -> list[Array]:
    return [np.stack((axis, -axis)) for axis in np.eye(rows - 1)]

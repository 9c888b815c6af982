"""Primal-dual interior point: a direct, second-order method for the frictionless, the convex and the exact Coulomb law.

In Lorentz coordinates, r = (μ p_n, p_t) and û = (u_n/μ, u_t) of each contact up to one factor, the problem is

    r ∈ Q,  z ∈ Q,  r ∘ z = 0,    z = û + ‖u_t‖ e    (the last term for "coulomb" alone).

Newton's method follows r ∘ z = τ e as τ falls, in Nesterov-Todd scaling, with the friction coupling ‖u_t‖ inside the
Newton step: one sparse factorisation a step, of a matrix on the bodies' velocities (6 × bodies: regular also where
redundant contacts make A singular, block-tridiagonal on a tower) or, where the system carries A alone, on the impulses.
Ten to forty steps reach 1e-8 on stacks, whatever the mass ratio. The central path of Coulomb's law can fold; there it
is followed by its length, τ growing until the next fold turns it down again. Where the steps get nowhere, the proximal
Newton method goes on from there, and `fallbacks` says so.

A few Gauss-Seidel sweeps come first, and more of them only while they promise to reach the tolerance for the price of a
few factorisations: that solves loosely coupled contacts at once. What they leave is no start for the path, which begins
in the middle of the cones; there is nothing to warm-start here, see "newton" for that.

Source: V. Acary, P. Armand, H. M. Nguyen, M. Shpakovych, *Second-order cone programming for frictional contact
mechanics using interior point algorithm*, Optim. Methods Softw. 39 (2024); see `gpx_lcp/rust/src/exact` for the
equations and the departures.
"""

from __future__ import annotations

from typing import Any, Final

from gpx_lcp.solvers._exact import DEFAULTS, exact_settings, run_exact
from gpx_lcp.solvers._interface import Outcome, Request, Solver


def run(request: Request) -> Outcome:
    """Follow the central path; iterations are Newton steps, each with one factorisation."""
    return run_exact(request, "interior_point")


def native(request: Request) -> dict[str, Any]:
    """Return what the core's own step is told."""
    return exact_settings(request, "interior_point")


SOLVER: Final = Solver(
    name="interior_point",
    method="direct: primal-dual interior point, sparse factorisation on bodies or contacts",
    programs={"normal": "convex QP", "cone": "second-order cone program", "coulomb": "Coulomb NCP"},
    run=run,
    native=native,
    defaults=DEFAULTS,
)

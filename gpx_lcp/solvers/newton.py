"""Proximal Newton: a second-order method for the same laws as the interior point, which profits from a warm start.

The proximal point method solves, again and again for a moving centre p_k,

    p = P_K(p_k - σ û(p)),     û = u + μ‖u_t‖ n  ("coulomb"; û = u otherwise),   u = A p - B,

by a generalised Newton method that sees the friction coupling; with σ = ∞ this is the problem itself. σ grows while
Newton is quick. Before that a semismooth Newton method on the law itself is tried, which takes the contacts' states
(open, sticking, sliding) from the point it has: one factorisation solves a tower at rest, from nothing or when its load
changes, and impulses of the step before that still hold cost none. Where Newton is not quick, because much slides, a
number of sweeps looks for the states; where that is not enough, the interior point takes over, and where that stalls,
proximal Newton again with more patience: see `fallbacks`.

Its last steps converge quadratically where the solution is regular, and need no polish: every one of the 34 problem
files of the measurements is solved to 1e-12.

Source: R. T. Rockafellar, *Monotone operators and the proximal point algorithm*, SIAM J. Control Optim. 14 (1976); V.
Acary, M. Brémond, O. Huber, INRIA RR-9118 (2018), section on proximal point algorithms.
"""

from __future__ import annotations

from typing import Any, Final

from gpx_lcp.solvers._exact import DEFAULTS, exact_settings, run_exact
from gpx_lcp.solvers._interface import Outcome, Request, Solver


def run(request: Request) -> Outcome:
    """Iterate from the warm start, or from rest; iterations are Newton steps, each with one factorisation.

    A start that is nearly a solution is swept over first; where that makes it one, there are no Newton steps.
    """
    return run_exact(request, "newton")


def native(request: Request) -> dict[str, Any]:
    """Return what the core's own step is told."""
    return exact_settings(request, "newton")


SOLVER: Final = Solver(
    name="newton",
    method="proximal point around a generalised Newton method; interior point where that is hard",
    programs={"normal": "projected equation", "cone": "projected equation", "coulomb": "projected equation"},
    run=run,
    native=native,
    defaults=DEFAULTS,
    warm_starts=True,
)

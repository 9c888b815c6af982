"""What the two exact solvers share."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, Final

from formulations import refutation
from gpx_lcp.solution import Status
from gpx_lcp.solvers._interface import Outcome, Request
from gpx_lcp.solvers._native import core_settings, run_core

MAX_STEPS: Final = 3000
# Contacts in a plane, up to which the exact law is searched for a solution that the methods did not find.
SEARCHED: Final = 6
# The settings of both: threads that presolve's islands are solved on.
DEFAULTS: Final = {"threads": 1}


def run_exact(request: Request, method: str) -> Outcome:
    """Run one of the core's exact methods on Ĵ where the system carries it, else on A.

    `extras` tells the number of `factorisations`, the `factor_seconds` that they took with the assembly of their
    blocks, and in `fill` the values in the factors of one Newton system. INFEASIBLE comes with
    `extras["infeasibility"]`, y (n, rows): impulses of the law's cone (frictionless ones for Coulomb's law) that move
    nothing, A y = 0, with Bᵀ y > 0; no impulses p at all can have 0 ≤ yᵀ (A p - B) = -Bᵀ y. Coulomb's law may have no
    solution without such a y: of up to six contacts in a plane, `extras["refutation"]` then is the proof, see
    `formulations.existence`. It is looked for where the methods stop without limits of the caller's.
    """
    outcome = run_core(request, exact_settings(request, method))
    if outcome.status in (Status.STALLED, Status.MAX_ITERATIONS) and _may_be_searched(request):
        proof = refutation(request.system)
        if proof is not None:
            extras = {**outcome.extras, "refutation": proof}
            return replace(outcome, status=Status.INFEASIBLE, extras=extras)
    return outcome


def _may_be_searched(request: Request) -> bool:
    limited = request.max_iterations is not None or request.time_limit is not None
    system = request.system
    in_plane = request.formulation == "coulomb" and system.rows == 2
    return in_plane and system.contacts <= SEARCHED and not limited


def exact_settings(request: Request, method: str) -> dict[str, Any]:
    """Return what the core's exact methods, alone or in a native step, are told beside the system.

    Raises
    ------
    SettingsError
        When `threads` is not a whole number from 1 to 256.
    """
    return core_settings(request, method, MAX_STEPS, request.formulation)

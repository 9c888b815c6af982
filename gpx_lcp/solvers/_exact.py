"""What the two exact solvers share: from a request to the core's arrays and back."""

from __future__ import annotations

from time import perf_counter
from typing import Any, Final

import numpy as np

from formulations import refutation
from gpx_lcp import _core
from gpx_lcp.core_system import core_system
from gpx_lcp.errors import SettingsError
from gpx_lcp.solution import Status
from gpx_lcp.solvers._interface import Outcome, Request

MAX_STEPS: Final = 3000
MAX_THREADS: Final = 256
# Contacts in a plane, up to which the exact law is searched for a solution that the methods did not find.
SEARCHED: Final = 6
# The settings of both: threads that presolve's islands are solved on.
DEFAULTS: Final = {"threads": 1}
STATUS: Final = {
    "solved": Status.SOLVED,
    "max_iterations": Status.MAX_ITERATIONS,
    "stalled": Status.STALLED,
    "infeasible": Status.INFEASIBLE,
}


def run_exact(request: Request, method: str) -> Outcome:
    """Run one of the core's exact methods on Ĵ where the system carries it, else on A.

    `extras` tells the number of `factorisations`, the `factor_seconds` that they took with the assembly of their
    blocks, and in `fill` the values in the factors of one Newton system. INFEASIBLE comes with
    `extras["infeasibility"]`, y (n, rows): impulses of the law's cone (frictionless ones for Coulomb's law) that move
    nothing, A y = 0, with Bᵀ y > 0; no impulses p at all can have 0 ≤ yᵀ (A p - B) = -Bᵀ y. Coulomb's law may have no
    solution without such a y: of up to six contacts in a plane, `extras["refutation"]` then is the proof, see
    `formulations.existence`. It is looked for where the methods stop without limits of the caller's.
    """
    began = perf_counter()
    system = request.system
    start = None if request.warm_start is None else request.warm_start.reshape(-1)
    report = _core.exact(core_system(system), exact_settings(request, method), start)
    elapsed = perf_counter() - began
    extras: dict[str, Any] = {
        "factorisations": report.factorisations,
        "factor_seconds": report.factor_seconds,
        "fill": report.fill,
    }
    if report.infeasibility is not None:
        ray = report.infeasibility.reshape(system.contacts, system.rows)
        extras["infeasibility"] = ray / np.abs(ray).max()
    status = STATUS[report.status]
    if status in (Status.STALLED, Status.MAX_ITERATIONS) and _may_be_searched(request):
        proof = refutation(system)
        if proof is not None:
            status, extras["refutation"] = Status.INFEASIBLE, proof
    return Outcome(
        impulse=report.impulse.reshape(system.contacts, system.rows),
        status=status,
        program=request.formulation,
        iterations=report.iterations,
        setup_seconds=elapsed - report.solve_seconds,
        solve_seconds=report.solve_seconds,
        history=tuple(report.history),
        fallbacks=tuple(report.fallbacks),
        extras=extras,
        presolved=report.presolve,
    )


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
    threads = request.settings["threads"]
    if isinstance(threads, bool) or not isinstance(threads, int) or not 1 <= threads <= MAX_THREADS:
        raise SettingsError(f"threads is {threads!r}: it must be a whole number from 1 to {MAX_THREADS}")
    return {
        "kernel": "exact",
        "method": method,
        "law": request.formulation,
        # A hair stricter, so that the judge's own rounding does not turn down what is accepted here.
        "tolerance": (1.0 - 1e-6) * request.tolerance,
        "max_iterations": MAX_STEPS if request.max_iterations is None else request.max_iterations,
        "time_limit": request.time_limit,
        "presolve": request.presolve,
        "threads": threads,
    }

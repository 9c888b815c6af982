"""What the core's own solvers share: from a request to the core and back."""

from __future__ import annotations

from time import perf_counter
from typing import Any, Final

import numpy as np

from formulations.checks import Array
from gpx_lcp import _core
from gpx_lcp.core_system import core_system
from gpx_lcp.errors import SettingsError
from gpx_lcp.solution import Status
from gpx_lcp.solvers._interface import Outcome, Request

MAX_THREADS: Final = 256
NO_CORNERS: Final = np.zeros(0)


def core_settings(
    request: Request,
    method: str,
    most: int,
    program: str,
    corners: Array = NO_CORNERS,
    relaxation: float = 1.0,
    acceleration: bool = True,
) -> dict[str, Any]:
    """Return what the core's methods, alone or in a native step, are told beside the system.

    Parameters
    ----------
    most : int
        The method's own limit of iterations.
    program : "normal", "cone", "coulomb" or "polygon"
    corners : (2 k,) array
        Of the polygon, two tangents each.

    Raises
    ------
    SettingsError
        When `threads` is not a whole number from 1 to 256.
    """
    threads = request.settings["threads"]
    if isinstance(threads, bool) or not isinstance(threads, int | np.integer) or not 1 <= threads <= MAX_THREADS:
        raise SettingsError(f"threads is {threads!r}: it must be a whole number from 1 to {MAX_THREADS}")
    return {
        "method": method,
        "program": program,
        "corners": corners,
        "tolerance": request.tolerance,
        "max_iterations": most if request.max_iterations is None else request.max_iterations,
        "time_limit": request.time_limit,
        "relaxation": relaxation,
        "acceleration": acceleration,
        "presolve": request.presolve,
        "threads": int(threads),
    }


def run_core(request: Request, settings: dict[str, Any]) -> Outcome:
    """Run one of the core's methods on Ĵ where the system carries it, else on A."""
    began = perf_counter()
    start = None if request.warm_start is None else request.warm_start.reshape(-1)
    found = _core.solve(core_system(request.system), settings, start)
    return outcome_of(request, found, perf_counter() - began - found.solve_seconds)


def outcome_of(request: Request, found: _core.Found, setup_seconds: float) -> Outcome:
    """Return what the core found as the outcome of a solver."""
    extras = found.extras
    if "infeasibility" in extras:
        ray = extras["infeasibility"].reshape(found.impulse.shape)
        extras["infeasibility"] = ray / np.abs(ray).max()
    return Outcome(
        impulse=found.impulse,
        status=Status[found.status.upper()],
        program=request.formulation,
        iterations=found.iterations,
        setup_seconds=setup_seconds,
        solve_seconds=found.solve_seconds,
        history=tuple(found.history),
        fallbacks=tuple(found.fallbacks),
        extras=extras,
        presolved=found.presolve,
    )

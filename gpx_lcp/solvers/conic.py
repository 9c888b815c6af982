"""The convex cone program through backends that take second-order cones: Clarabel and SCS.

Both solve  min ½ xᵀ P x + qᵀ x  over  G x + s = 0, s ∈ K, here with P, q of the system without units, G = -S and
S p = (μ p_n, p_t) in second-order cones (`formulations.cone`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from time import perf_counter
from typing import Any, Final

import numpy as np
import scipy.sparse as sp

from formulations import QP, cone_qp, cone_rows
from formulations.checks import Array
from gpx_lcp.errors import BackendError
from gpx_lcp.solution import Status
from gpx_lcp.solvers._interface import Outcome, Request

Found = tuple[Any, bool, int, float, dict[str, Any]]


def _clarabel(qp: QP, rows: sp.csc_array, cones: list[tuple[str, int]], request: Request) -> Found:
    import clarabel

    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.max_threads = 1
    for key in ("tol_gap_abs", "tol_gap_rel", "tol_feas"):
        setattr(settings, key, 0.1 * request.tolerance)
    if request.max_iterations is not None:
        settings.max_iter = request.max_iterations
    if request.time_limit is not None:
        settings.time_limit = request.time_limit
    for key, value in request.settings.items():
        setattr(settings, key, value)
    kinds = {"second-order": clarabel.SecondOrderConeT, "positive": clarabel.NonnegativeConeT}
    solver = clarabel.DefaultSolver(
        sp.csc_matrix(sp.triu(qp.P)),
        qp.q,
        sp.csc_matrix(-rows),
        np.zeros(rows.shape[0]),
        [kinds[kind](size) for kind, size in cones],
        settings,
    )
    found = solver.solve()
    status = str(found.status)
    return np.array(found.x), status == "Solved", found.iterations, found.solve_time, {"status": status}


def _scs(qp: QP, rows: sp.csc_array, cones: list[tuple[str, int]], request: Request) -> Found:
    import scs

    # SCS wants the positive rows before the second-order cones.
    start = np.cumsum([0, *(size for _, size in cones)])
    order = np.concatenate(
        [
            np.arange(start[index], start[index + 1])
            for wanted in ("positive", "second-order")
            for index, (kind, _) in enumerate(cones)
            if kind == wanted
        ]
    )
    data = {
        "P": sp.csc_matrix(sp.triu(qp.P)),
        "A": sp.csc_matrix(-sp.csr_array(rows)[order]),
        "b": np.zeros(rows.shape[0]),
        "c": qp.q,
    }
    cone = {
        "l": sum(size for kind, size in cones if kind == "positive"),
        "q": [size for kind, size in cones if kind == "second-order"],
    }
    settings: dict[str, Any] = {
        "verbose": False,
        "eps_abs": 0.1 * request.tolerance,
        "eps_rel": 0.1 * request.tolerance,
    }
    if request.max_iterations is not None:
        settings["max_iters"] = request.max_iterations
    if request.time_limit is not None:
        settings["time_limit_secs"] = request.time_limit
    solver = scs.SCS(data, cone, **{**settings, **request.settings})
    guess = {} if request.warm_start is None else {"x": request.warm_start.reshape(-1)}
    found = solver.solve(warm_start=bool(guess), **guess)
    info = found["info"]
    # SCS tells milliseconds.
    return found["x"], info["status"] == "solved", info["iter"], 1e-3 * info["solve_time"], {"status": info["status"]}


def _backend(name: str, solve: Callable[[QP, sp.csc_array, list[tuple[str, int]], Request], Found]) -> Any:
    def run(request: Request) -> Outcome:
        start = perf_counter()
        system, factors = request.system.normalised()
        qp = cone_qp(system)
        rows, sizes = cone_rows(system)
        cones = [("second-order" if size > 1 else "positive", size) for size in sizes]
        if request.warm_start is not None:
            request = replace(request, warm_start=request.warm_start / factors[:, None])
        try:
            x, solved, iterations, seconds, extras = solve(qp, rows, cones, request)
        except Exception as error:
            raise BackendError(f"{name} failed: {error}") from error
        finished = perf_counter()
        usable = x is not None and bool(np.isfinite(x).all())
        flat: Array = np.asarray(x, dtype=np.float64) if usable else np.zeros(system.B.size)
        status = Status.SOLVED if solved else Status.MAX_ITERATIONS
        return Outcome(
            impulse=factors[:, None] * flat.reshape(system.contacts, system.rows),
            status=status if usable else Status.NUMERICAL_ERROR,
            program="cone",
            iterations=iterations,
            setup_seconds=finished - start - seconds,
            solve_seconds=seconds,
            extras=extras,
        )

    return run


BACKENDS: Final[Mapping[str, Callable[[Request], Outcome]]] = {
    "clarabel": _backend("clarabel", _clarabel),
    "scs": _backend("scs", _scs),
}

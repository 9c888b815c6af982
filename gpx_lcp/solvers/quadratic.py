"""OSQP and every other backend that qpsolvers has installed, each under its own name.

A backend solves the convex programs: `normal` and `pyramid` as QPs through `qpsolvers.Problem`, and `cone` where it
takes second-order cones. The QP is posed on the system without units (`StackedSystem.normalised`), so that a backend's
absolute tolerances mean the same for every problem; matrices go in sparse wherever the backend takes them so.

What a backend says of itself is kept in `extras`; whether it solved the problem is judged by the program's residual.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from importlib.metadata import metadata
from time import perf_counter
from typing import Any, Final

import numpy as np
import qpsolvers
import scipy.sparse as sp

from formulations import QP, normal_impulse, normal_qp, pyramid_qp
from formulations.checks import Array
from gpx_lcp.errors import BackendError
from gpx_lcp.solution import Status
from gpx_lcp.solvers import conic
from gpx_lcp.solvers._interface import Outcome, Request, Solver

# Under which names a backend takes its accuracy and its limit of iterations. One that is not listed runs with its own
# defaults. A tenth of the tolerance is asked for: a backend bounds its own residuals, not our natural map.
_ACCURACY: Final[Mapping[str, tuple[str, ...]]] = {
    "clarabel": ("tol_gap_abs", "tol_gap_rel", "tol_feas"),
    "cvxopt": ("abstol", "reltol", "feastol"),
    "daqp": ("primal_tol", "dual_tol"),
    "ecos": ("abstol", "reltol", "feastol"),
    "highs": ("primal_feasibility_tolerance", "dual_feasibility_tolerance"),
    "osqp": ("eps_abs", "eps_rel"),
    "piqp": ("eps_abs", "eps_rel", "eps_duality_gap_abs", "eps_duality_gap_rel"),
    "proxqp": ("eps_abs", "eps_rel"),
    "qpalm": ("eps_abs", "eps_rel"),
    "scs": ("eps_abs", "eps_rel"),
}
_LIMIT: Final[Mapping[str, str]] = {
    "clarabel": "max_iter",
    "cvxopt": "maxiters",
    "daqp": "iter_limit",
    "ecos": "max_iters",
    "osqp": "max_iter",
    "piqp": "max_iter",
    "proxqp": "max_iter",
    "qpalm": "max_iter",
    "scs": "max_iters",
}
_DEFAULTS: Final[Mapping[str, Mapping[str, Any]]] = {"osqp": {"max_iter": 20_000}}
_WARM_STARTS: Final = ("osqp", "proxqp", "qpalm", "scs")


def backends() -> list[Solver]:
    """Return a row for every backend that qpsolvers knows, installed or not."""
    return [_row(name) for name in known_backends()]


def known_backends() -> tuple[str, ...]:
    """Return the names of qpsolvers' backends, from the extras that it declares and from what it found."""
    # Extras with a hyphen are collections of backends.
    extras = [name for name in metadata("qpsolvers").get_all("Provides-Extra") or [] if "-" not in name]
    return tuple(sorted({*extras, *qpsolvers.available_solvers}))


def _row(name: str) -> Solver:
    programs = {"normal": "QP", "pyramid": "QP"}
    if name in conic.BACKENDS:
        programs["cone"] = "second-order cone QP"
    return Solver(
        name=name,
        method="convex QP backend, through qpsolvers",
        programs=programs,
        run=lambda request: _run(name, request),
        warm_starts=name in _WARM_STARTS,
        defaults=None,
        apart=name not in qpsolvers.sparse_solvers,
        installed=name in qpsolvers.available_solvers,
        install=f"pip install 'qpsolvers[{name}]'",
    )


def _run(name: str, request: Request) -> Outcome:
    if request.formulation == "cone":
        return conic.BACKENDS[name](request)
    start = perf_counter()
    system, factors = request.system.normalised()
    normal = request.formulation == "normal"
    qp = normal_qp(system) if normal else pyramid_qp(system, request.facets)
    problem = _problem(qp, dense=name not in qpsolvers.sparse_solvers)
    guess = None
    if request.warm_start is not None:
        scaled = request.warm_start / factors[:, None]
        guess = scaled[:, 0] if normal else scaled.reshape(-1)
    posed = perf_counter()
    found = _solve(name, problem, guess, _settings(name, request))
    finished = perf_counter()
    x = found.x
    usable = x is not None and bool(np.isfinite(x).all())
    flat: Array = np.asarray(x, dtype=np.float64) if usable else np.zeros(problem.q.size)
    impulse = normal_impulse(system, flat) if normal else flat.reshape(system.contacts, system.rows)
    if not usable:
        status = Status.NUMERICAL_ERROR
    else:
        status = Status.SOLVED if found.found else Status.MAX_ITERATIONS
    build = found.build_time if found.build_time is not None else 0.0
    solve = found.solve_time if found.solve_time is not None else finished - posed - build
    return Outcome(
        impulse=factors[:, None] * impulse,
        status=status,
        program="normal" if normal else "pyramid_qp",
        iterations=_iterations(found.extras),
        setup_seconds=posed - start + build,
        solve_seconds=solve,
        extras={key: value for key, value in found.extras.items() if isinstance(value, str | int | float | bool)},
    )


def _solve(name: str, problem: qpsolvers.Problem, guess: Array | None, settings: dict[str, Any]) -> qpsolvers.Solution:
    try:
        with warnings.catch_warnings():
            # Backends warn of inaccurate solutions; the certificate says it with a figure.
            warnings.simplefilter("ignore")
            return qpsolvers.solve_problem(problem, solver=name, initvals=guess, **settings)
    except Exception as error:
        raise BackendError(f"{name} failed: {error}") from error


def _settings(name: str, request: Request) -> dict[str, Any]:
    settings: dict[str, Any] = dict(_DEFAULTS.get(name, {}))
    settings.update({key: 0.1 * request.tolerance for key in _ACCURACY.get(name, ())})
    if request.max_iterations is not None and name in _LIMIT:
        settings[_LIMIT[name]] = request.max_iterations
    if request.time_limit is not None and name in ("osqp", "clarabel", "highs"):
        settings["time_limit"] = request.time_limit
    settings.update(request.settings)
    return settings


def _problem(qp: QP, *, dense: bool) -> qpsolvers.Problem:
    convert = _dense if dense else _sparse
    bound = None if qp.G is None else np.zeros(qp.G.shape[0])
    return qpsolvers.Problem(convert(qp.P), qp.q, G=None if qp.G is None else convert(qp.G), h=bound, lb=qp.lower)


def _dense(matrix: sp.csc_array) -> Array:
    return np.asarray(matrix.toarray())


def _sparse(matrix: sp.csc_array) -> sp.csc_matrix:
    """Return the matrix class and the index type that the backends' C code takes."""
    indices, pointers = matrix.indices.astype(np.int32), matrix.indptr.astype(np.int32)
    return sp.csc_matrix((matrix.data, indices, pointers), shape=matrix.shape)


def _iterations(extras: Mapping[str, Any]) -> int:
    """Return the count of iterations under whichever name the backend has for it; 0 where it does not tell."""
    info = extras.get("info")
    places = [extras, info] if isinstance(info, Mapping) else [extras]
    for key in ("iterations", "iter", "num_iter"):
        for place in places:
            if key in place:
                return int(place[key])
        if hasattr(info, key):
            return int(getattr(info, key))
    return 0

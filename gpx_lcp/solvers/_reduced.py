"""Presolve for the solvers outside the core: they solve the parts that it leaves, and their impulses are lifted back.

The core reduces the system, see `gpx_lcp.presolve`, and says to which tolerance each part is to be solved for the whole
to be within its own. A part is a stacked system like any other, and poses the same program.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from operator import itemgetter
from time import perf_counter
from typing import Any, Final

import numpy as np
import scipy.sparse as sp

from formulations import StackedSystem
from formulations.checks import Array
from gpx_lcp import _core
from gpx_lcp.core_system import core_system, program_residual
from gpx_lcp.presolved import Counted
from gpx_lcp.solution import Status
from gpx_lcp.solvers._interface import SEVERITY, Outcome, Request, Solver

# The formulations that reductions keep: they turn tangents, and polygons have axes of their own there.
ISOTROPIC: Final = ("normal", "cone")
# What no impulse at all leaves of any system, at most.
WITHOUT_IMPULSES: Final = 1.0


def presolving(row: Solver) -> Solver:
    """Return the row of a solver that takes a system as it is, made to solve the parts that presolve leaves of it.

    Each part has `max_iterations` to itself, and `iterations` are the most of any part; the time is that of all
    together. The status is the worst. Of several parts, `extras["parts"]` has the extras of each. Where all parts are
    solved and the whole is not, at tolerances near rounding, the whole has the last word; it starts from what the parts
    have found, if the solver can. What starts from a solution keeps it, or no impulses where these are none worse.
    """

    def run(request: Request) -> Outcome:
        began = perf_counter()
        if not (request.presolve and request.formulation in ISOTROPIC):
            return row.run(request)
        system = core_system(request.system)
        handed = perf_counter()
        reduced = system.reduced(request.formulation, request.tolerance, row.apart)
        # Closed forms are part of it: it counts as solving, as it does in the core.
        solving = perf_counter() - handed
        if reduced is None or _is_as_large(request, reduced[1]):
            return _run(row, request, began)
        impulse, parts, summary = reduced
        requests = [_request(request, part) for part in parts]
        seconds = perf_counter() - began - solving, solving
        outcomes = [_run(row, own, began) for own in requests]
        for part, outcome in zip(parts, outcomes, strict=True):
            part.lift(outcome.impulse, impulse)
        whole = _joined(request.formulation, impulse, parts, outcomes, seconds, summary)
        # A solver that leaves more of its parts than it was asked for leaves no less of the whole.
        if _is_solved(request, whole) or not all(map(_is_solved, requests, outcomes)):
            return whole
        again = _run(row, replace(request, warm_start=impulse if row.warm_starts else None), began)
        better = min(whole, again, key=lambda outcome: _residual(request, outcome.impulse))
        return replace(
            better,
            setup_seconds=whole.setup_seconds + again.setup_seconds,
            solve_seconds=whole.solve_seconds + again.solve_seconds,
        )

    return replace(row, run=run)


def _is_as_large(request: Request, parts: Sequence[_core.Part]) -> bool:
    """Whether the only part has all unknowns of the program, which are impulses: fewer velocities are no gain."""
    if len(parts) != 1:
        return False
    if request.formulation == "normal":
        return parts[0].friction.size == request.system.contacts
    return parts[0].target.size == request.system.B.size


def _request(whole: Request, part: _core.Part) -> Request:
    """Return what is asked of a part."""
    start = None if whole.warm_start is None else part.restrict(np.ascontiguousarray(whole.warm_start))
    return replace(whole, system=_system(part), tolerance=part.tolerance, warm_start=start)


def _system(part: _core.Part) -> StackedSystem:
    (starts, columns, blocks, bodies), target = part.matrix(), part.target
    width = blocks.shape[2]
    matrix = sp.bsr_array((blocks, columns, starts), shape=(target.size, bodies * width))
    if not part.of_bodies:
        return StackedSystem.from_checked(sp.csr_array(matrix), target, part.friction)
    unit = np.broadcast_to(np.eye(width), (bodies, width, width))
    return StackedSystem.from_jacobian(matrix, unit, target, part.friction)


def _run(row: Solver, request: Request, began: float) -> Outcome:
    """Run the solver, where there is something to do and time left for it."""

    def at_once(impulse: Array, status: Status, seconds: float = 0.0) -> Outcome:
        return Outcome(impulse.copy(), status, request.formulation, 0, 0.0, seconds)

    nothing, start = np.zeros((request.system.contacts, request.system.rows)), request.warm_start
    if request.tolerance >= WITHOUT_IMPULSES or not request.system.B.any():
        return at_once(nothing, Status.SOLVED)
    if start is not None:
        judged = perf_counter()
        # Impulses that do nothing but hold each other are not kept.
        residual, kept = min(((_residual(request, p), p) for p in (nothing, start)), key=itemgetter(0))
        if residual <= request.tolerance:
            return at_once(kept, Status.SOLVED, perf_counter() - judged)
    if request.time_limit is None:
        return row.run(request)
    left = request.time_limit - (perf_counter() - began)
    if left <= 0.0:
        return at_once(nothing if start is None else start, Status.MAX_ITERATIONS)
    return row.run(replace(request, time_limit=left))


def _residual(request: Request, impulse: Array) -> float:
    return program_residual(request.system, request.formulation, impulse, request.facets)


def _is_solved(request: Request, outcome: Outcome) -> bool:
    return _residual(request, outcome.impulse) <= request.tolerance


def _joined(
    program: str,
    impulse: Array,
    parts: Sequence[_core.Part],
    outcomes: Sequence[Outcome],
    seconds: tuple[float, float],
    summary: Counted,
) -> Outcome:
    """Return what was found for the parts as the outcome of the whole; `impulse` is lifted already.

    `seconds` are what it took to set up and to solve without them.
    """
    extras = [dict(outcome.extras) for outcome in outcomes]
    ray = np.zeros_like(impulse)
    for part, own in zip(parts, extras, strict=True):
        if "infeasibility" in own:
            part.lift(own.pop("infeasibility"), ray)
    joined: dict[str, Any] = extras[0] if len(extras) == 1 else {"parts": extras} if extras else {}
    if ray.any():
        joined["infeasibility"] = ray / np.abs(ray).max()
    return Outcome(
        impulse=impulse,
        status=max((outcome.status for outcome in outcomes), key=SEVERITY.index, default=Status.SOLVED),
        program=program,
        iterations=max((outcome.iterations for outcome in outcomes), default=0),
        setup_seconds=seconds[0] + sum(outcome.setup_seconds for outcome in outcomes),
        solve_seconds=seconds[1] + sum(outcome.solve_seconds for outcome in outcomes),
        history=outcomes[0].history if len(outcomes) == 1 else (),
        fallbacks=tuple(dict.fromkeys(name for outcome in outcomes for name in outcome.fallbacks)),
        extras=joined,
        presolved=summary,
    )

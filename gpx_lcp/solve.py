"""From a stacked system to a certified solution: checks, picks, runs one solver, and judges what it found."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from time import perf_counter
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from formulations import DEFAULT_FACETS, FORMULATIONS, PROJECTIONS, StackedSystem
from formulations.checks import Array, as_array
from gpx_lcp import _core
from gpx_lcp.core_system import program_residual
from gpx_lcp.errors import BackendMissing, ProblemError, SettingsError
from gpx_lcp.solution import Solution, Status
from gpx_lcp.solvers import Outcome, Request, Solver, solvers

# What runs where only a formulation is named: from nothing, and from a warm start. Measured on 32 problem files with
# fewer than 2000 contacts and on 11 towers and walls, at rest and at random velocities, to 1e-4, 1e-8 and 1e-10:
#
#   from nothing  interior_point, whose sweeps solve by themselves what is loosely coupled. Wall time against the
#                 quickest of newton, interior_point without presolve, and pgs in each of 129 cases: above 2 in 9 of
#                 them, at most 4.9. These are pgs's: capsules, single objects and grains to 1e-4, small towers and
#                 walls at random velocities. Counting its sweeps cheaper in the choice leaves 6 above 2, but sweeps do
#                 not share an arch's indeterminate loads evenly, so that it was not kept. newton is up to twice as
#                 quick on walls at rest; pgs alone fails on most of what is tall or wide.
#   warm start    newton: no factorisation where the start is still a solution, and a few near it.
PREFERRED: Final[Mapping[str, tuple[str, str]]] = {
    "normal": ("interior_point", "newton"),
    "box": ("pgs", "pgs"),
    "pyramid": ("pgs", "pgs"),
    "cone": ("interior_point", "newton"),
    "coulomb": ("interior_point", "newton"),
}


def solve(
    system: StackedSystem,
    formulation: str | None = None,
    solver: str | None = None,
    *,
    tolerance: float = 1e-8,
    max_iterations: int | None = None,
    time_limit: float | None = None,
    warm_start: npt.ArrayLike | None = None,
    facets: int = DEFAULT_FACETS,
    presolve: bool = True,
    **settings: Any,
) -> Solution:
    """Solve A F dt = B over the impulses that the contacts allow, and certify what was found.

    Parameters
    ----------
    system : StackedSystem
    formulation : str, optional
        "normal", "box", "pyramid", "cone" or "coulomb"; unless given, "normal" where there is no friction and
        otherwise the closest to Coulomb's law that the solver, if one is named, can solve.
    solver : str, optional
        A name in `solvers()`; unless given,

        =====================  ==================  ==================
        formulation            from nothing        from a warm start
        =====================  ==================  ==================
        normal, cone, coulomb  "interior_point"    "newton"
        box, pyramid           "pgs"               "pgs"
        =====================  ==================  ==================
    tolerance : float
        Bound on the residual of the program, its natural map relative to ‖B‖: a number without unit. 1e-3 is what
        games need, 1e-8 what a reference needs.
    max_iterations : int, optional
        Sweeps, pivots or steps; each solver has a limit of its own.
    time_limit : float, optional, s
    warm_start : (n, rows) array, optional, N s
        Impulses to start from. Those outside the cones of the formulation are projected onto them, and
        `extras["warm_start_moved"]` tells how far, relative to the largest impulse.
    facets : int
        Of the pyramids, at least 3.
    presolve : bool
        Whether the solver solves the smallest systems with the same answer, which is mapped back; see
        `gpx_lcp.presolve`. "interior_point", "newton" and "pgs" do so on as many `threads` as their setting says.
        Polygons ("box", "pyramid") are solved as they are, but that "lemke" takes islands apart. Each part has
        `max_iterations` to itself, and `Solution.iterations` is the most of any; the time limit is that of all. Where
        a solver outside the core solves several parts, `extras["parts"]` has the extras of each.
    **settings
        The solver's own settings, e.g. `relaxation` of "pgs".

    Returns
    -------
    Solution
        Always, also when the solver did not converge: see its status and its certificate.

    Raises
    ------
    SettingsError
        When a name or a setting is unknown, out of range, or not for this solver.
    ProblemError
        When the system or the warm start is not what is needed.
    BackendMissing
        When the solver is not installed; the message says which command installs it.
    BackendError
        When a backend fails in a way of its own.
    """
    row, request = posed(
        system,
        warm_start is not None,
        formulation,
        solver,
        tolerance=tolerance,
        max_iterations=max_iterations,
        time_limit=time_limit,
        facets=facets,
        presolve=presolve,
        **settings,
    )
    extras: dict[str, Any] = {}
    if warm_start is not None:
        guess, moved = _checked_warm_start(row, request, warm_start)
        request = replace(request, warm_start=guess)
        extras["warm_start_moved"] = moved
    outcome = row.run(request) if system.B.any() else _nothing_to_do(request)
    return judged(request, row, outcome, extras)


def posed(
    system: StackedSystem,
    warm: bool,
    /,
    formulation: str | None = None,
    solver: str | None = None,
    *,
    tolerance: float = 1e-8,
    max_iterations: int | None = None,
    time_limit: float | None = None,
    facets: int = DEFAULT_FACETS,
    presolve: bool = True,
    **settings: Any,
) -> tuple[Solver, Request]:
    """Check a question as `solve` takes it; return the solver's row and the request, the warm start still to come."""
    if not isinstance(system, StackedSystem):
        raise ProblemError(f"system is a {type(system).__name__}: a StackedSystem is needed")
    if formulation is None:
        formulation = default_formulation(system, solver)
    if formulation not in FORMULATIONS:
        raise SettingsError(f"formulation is {formulation!r}: it must be one of {', '.join(map(repr, FORMULATIONS))}")
    row = _solver_row(formulation, PREFERRED[formulation][warm] if solver is None else solver)
    _check_limits(tolerance, max_iterations, time_limit, facets)
    if not isinstance(presolve, bool):
        raise SettingsError(f"presolve is {presolve!r}: it must be True or False")
    request = Request(
        system=system,
        formulation=formulation,
        tolerance=float(tolerance),
        max_iterations=max_iterations,
        time_limit=time_limit,
        warm_start=None,
        facets=facets,
        presolve=presolve,
        settings=_checked_settings(row, settings),
    )
    return row, request


def default_formulation(system: StackedSystem, solver: str | None) -> str:
    """Return the formulation meant where none is named."""
    frictionless = system.rows == 1 or not system.friction.any()
    if solver is not None and solver in solvers():
        return solvers()[solver].default_formulation(frictionless)
    return "normal" if frictionless else "coulomb"


def judged(request: Request, row: Solver, outcome: Outcome, extras: Mapping[str, Any]) -> Solution:
    """Turn what a solver says into what is true: SOLVED is what the program's residual says."""
    system = request.system
    residual = program_residual(system, outcome.program, outcome.impulse, request.facets)
    status = outcome.status
    if residual <= request.tolerance:
        status = Status.SOLVED
    elif status is Status.SOLVED:
        status = Status.STALLED
    return Solution(
        system=system,
        impulse=outcome.impulse,
        status=status,
        program_residual=residual,
        method=f"{outcome.program}/{row.name}",
        fallbacks=outcome.fallbacks,
        iterations=outcome.iterations,
        setup_seconds=outcome.setup_seconds,
        solve_seconds=outcome.solve_seconds,
        history=outcome.history,
        extras={**outcome.extras, **extras},
        presolved=outcome.presolved,
    )


def _nothing_to_do(request: Request) -> Outcome:
    """Return the answer where B = 0, or where there is no contact: no impulse."""
    start = perf_counter()
    impulse = np.zeros((request.system.contacts, request.system.rows))
    return Outcome(impulse, Status.SOLVED, request.formulation, 0, 0.0, perf_counter() - start)


def _solver_row(formulation: str, name: str) -> Solver:
    table = solvers()
    if name not in table:
        raise SettingsError(f"solver is {name!r}: it must be one of {', '.join(table)}")
    row = table[name]
    if formulation not in row.programs:
        able = ", ".join(other.name for other in table.values() if formulation in other.programs and other.installed)
        raise SettingsError(
            f"{name} does not solve the formulation {formulation!r}, only {', '.join(row.programs)}; "
            f"{formulation!r} is solved by {able}"
        )
    if not row.installed:
        here = ", ".join(other.name for other in table.values() if other.installed)
        raise BackendMissing(f"{name} is not installed; {row.install} installs it. Installed: {here}")
    return row


def _check_limits(tolerance: float, max_iterations: int | None, time_limit: float | None, facets: int) -> None:
    if not (isinstance(tolerance, int | float) and 0.0 < tolerance < np.inf):
        raise SettingsError(f"tolerance is {tolerance!r}: it must be a positive number")
    if max_iterations is not None and not (isinstance(max_iterations, int) and max_iterations >= 0):
        raise SettingsError(f"max_iterations is {max_iterations!r}: it must be a whole number, not negative")
    if time_limit is not None and not (isinstance(time_limit, int | float) and time_limit > 0.0):
        raise SettingsError(f"time_limit is {time_limit!r}: it must be a positive number of seconds")
    if not (isinstance(facets, int) and facets >= 3):
        raise SettingsError(f"facets is {facets!r}: a pyramid has at least 3")


def _checked_settings(row: Solver, settings: Mapping[str, Any]) -> Mapping[str, Any]:
    if row.defaults is None:
        return settings
    for name in settings:
        if name not in row.defaults:
            known = ", ".join(row.defaults) or "none"
            raise SettingsError(f"{row.name} has no setting {name!r}; its own settings: {known}")
    return {**row.defaults, **settings}


def _checked_warm_start(row: Solver, request: Request, warm_start: npt.ArrayLike) -> tuple[Array, float]:
    system = request.system
    if not row.warm_starts:
        able = ", ".join(other.name for other in solvers().values() if other.warm_starts and other.installed)
        raise SettingsError(f"{row.name} cannot be warm-started; these can: {able}")
    guess = as_array("warm_start", warm_start, (system.contacts, system.rows))
    if row.native is not None:
        # By the formula of the core's own steps, so that a step stage by stage starts from the same numbers.
        return _core.admit(row.native(request), system.friction, guess)
    inside = PROJECTIONS[request.formulation](guess, system.friction, request.facets)
    size = float(np.abs(guess).max(initial=0.0))
    moved = float(np.abs(inside - guess).max(initial=0.0)) / size if size > 0.0 else 0.0
    return inside, moved

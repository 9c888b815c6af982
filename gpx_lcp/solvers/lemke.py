"""Lemke's method with the lexicographic ratio test: a direct solver for every LCP form.

The LCP is augmented by one artificial variable, w = M z + q + d z₀. Starting from z₀ large enough, complementary
pivots keep w ⟂ z in all but one pair until z₀ leaves the basis (a solution) or the entering variable can grow without
end (a secondary ray). For copositive-plus M, which every contact program here has, a ray proves that the constraints
M z + q ≥ 0, z ≥ 0 have no point, and its direction is the Farkas certificate. Lexicographic comparison of the rows of
the basis inverse settles ties, so that redundant contacts cannot make it cycle.

Source: C. E. Lemke, *Bimatrix equilibrium points and mathematical programming*, Manage. Sci. 11 (1965); R. W. Cottle,
J.-S. Pang, R. E. Stone, *The Linear Complementarity Problem* (1992), algorithms 4.4.5 and 4.9.3.

Departures: (1) the inverse of the basis is kept instead of the tableau; each pivot column is refined once against the
basis itself, and the inverse is worked out afresh when that finds it wrong; (2) rows tie when the step would leave
them within rounding of zero, and the lexicographic order decides among those with a large pivot, unless it idles:
redundant contacts tie by the dozen, and a pivot of rounding size would end in nonsense; (3) the last basis is factored
once more and its solution refined, so that the answer carries no error of the pivots; (4) where the pivots get lost all
the same, they start anew with another d.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from time import perf_counter
from typing import Final, TypeAlias

import numpy as np
import numpy.typing as npt
import scipy.linalg as la
from scipy.optimize import linprog

from formulations import (
    LCP,
    SettingsError,
    StackedSystem,
    box_impulse,
    box_lcp,
    normal_impulse,
    normal_lcp,
    pyramid_impulse,
    pyramid_lcp,
)
from formulations.checks import Array
from gpx_lcp.core_system import core_system
from gpx_lcp.solution import Status
from gpx_lcp.solvers._interface import SEVERITY, Outcome, Request, Solver

# The inverse is worked out afresh when it gets a pivot column wrong by this share.
REFRESH: Final = 1e-9
# But not more often than every so many pivots: where the basis itself is ill-conditioned, it would not help.
PATIENCE: Final = 20
# Entries of a pivot column below this share of its largest one are rounding, not pivots.
PIVOT_TOLERANCE: Final = 1e-11
# Basic variables below this share of the largest one are zero: rows that would get there are ties.
ZERO: Final = 1e-11
# Among tied rows, those whose pivot is below this share of the largest one are left alone: a wall of five rows then
# takes 89 pivots instead of 278, and none of them ill-conditioned.
LARGE_PIVOT: Final = 0.5
# After so many pivots per unknown that moved nothing, only rounding is left alone, and the lexicographic order rules.
IDLE_PIVOTS: Final = 2
TINY_PIVOT: Final = 1e-4
# Relative differences of the rows of the inverse below this are none.
TIE_TOLERANCE: Final = 1e-9
PIVOTS_PER_UNKNOWN: Final = 50
# The artificial variable's column is d = 1 + frac(step · i). Where pivots from d = 1 end in rounding, or at a ray that
# proves nothing, another path often does not.
COVERS: Final = (0.0, 0.618033988749895, 0.414213562373095)
# Unknowns up to which islands are solved together.
FEW_UNKNOWNS: Final = 100
FINAL: Final = (Status.SOLVED, Status.INFEASIBLE)

Contacts: TypeAlias = npt.NDArray[np.uint32]


@dataclass(frozen=True)
class LCPSolution:
    """What became of an LCP.

    Attributes
    ----------
    z, w : (n,) arrays
        The best point found; w = M z + q.
    status : Status
        SOLVED, INFEASIBLE with a certificate, STALLED at a ray that proves nothing or at the accuracy that rounding
        leaves, MAX_ITERATIONS or NUMERICAL_ERROR.
    residual : float
        ‖min(z, w)‖ / ‖q‖, see `LCP.residual`.
    iterations : int
        Pivots.
    infeasibility : (n,) array or None
        y ≥ 0 with Mᵀ y ≤ 0 and qᵀ y < 0: proof that no z ≥ 0 has M z + q ≥ 0.
    """

    z: Array
    w: Array
    status: Status
    residual: float
    iterations: int
    infeasibility: Array | None = None


def solve_lcp(
    M: npt.ArrayLike,
    q: npt.ArrayLike,
    *,
    tolerance: float = 1e-8,
    max_iterations: int | None = None,
    time_limit: float | None = None,
) -> LCPSolution:
    """Solve 0 ≤ z ⟂ M z + q ≥ 0 by Lemke's method.

    Parameters
    ----------
    M : (n, n) array
    q : (n,) array
    tolerance : float
        Bound on the residual ‖min(z, w)‖ / ‖q‖ of a point that is called SOLVED.
    max_iterations : int, optional
        Pivots; 50 n unless given.
    time_limit : float, optional, s

    Raises
    ------
    ProblemError
        When M and q do not fit each other or are not finite.
    SettingsError
        When the tolerance is not positive.
    """
    if not tolerance > 0.0:
        raise SettingsError(f"tolerance is {tolerance!r}: it must be positive")
    lcp = LCP(M, q)
    # Pivots see data of size one, so that their tolerances have no unit; w and z₀ scale with q, z with q over M.
    matrix_size, vector_size = (float(np.abs(part).max(initial=0.0)) or 1.0 for part in (lcp.M, lcp.q))
    scaled = LCP(lcp.M / matrix_size, lcp.q / vector_size)
    deadline = None if time_limit is None else perf_counter() + time_limit
    limit = PIVOTS_PER_UNKNOWN * lcp.q.size if max_iterations is None else max_iterations
    best: LCPSolution | None = None
    count = 0
    for step in COVERS:
        pivots = _Pivots(scaled, cover=1.0 + (step * np.arange(lcp.q.size, dtype=np.float64)) % 1.0)
        status = pivots.run(limit - count, deadline)
        count += pivots.count
        z = pivots.solution() * (vector_size / matrix_size)
        if not np.isfinite(z).all():
            z, status = np.zeros_like(z), Status.NUMERICAL_ERROR
        residual = lcp.residual(z)
        infeasibility = None
        if residual <= tolerance:
            status = Status.SOLVED
        elif status is Status.SOLVED:
            status = Status.STALLED
        elif status is Status.INFEASIBLE:
            infeasibility = _proof(lcp, pivots.ray())
            status = Status.STALLED if infeasibility is None else Status.INFEASIBLE
        if best is None or status in FINAL or residual < best.residual:
            best = LCPSolution(z, lcp.M @ z + lcp.q, status, residual, count, infeasibility)
        if status in FINAL or status is Status.MAX_ITERATIONS:
            break
    assert best is not None
    return replace(best, iterations=count)


class _Pivots:
    """The basis and its inverse. Variables 0 … n-1 are w, n … 2n-1 are z, 2n is z₀."""

    def __init__(self, lcp: LCP, cover: Array) -> None:
        self.lcp = lcp
        self.size = lcp.q.size
        self.cover = cover
        self.basis = np.arange(self.size)
        self.matrix = np.eye(self.size, order="F")
        self.inverse = np.eye(self.size, order="F")
        self.value = lcp.q.copy()
        self.count = 0
        self.fresh = 0
        self.idle = 0
        self.entering = 2 * self.size
        self.direction = np.zeros(self.size)

    def column(self, variable: int) -> Array:
        """Return the column of a variable in w - M z - d z₀ = q."""
        if variable == 2 * self.size:
            return -self.cover
        if variable >= self.size:
            return -self.lcp.M[:, variable - self.size]
        unit = np.zeros(self.size)
        unit[variable] = 1.0
        return unit

    def basis_direction(self, variable: int) -> Array:
        """Return the column of a variable in terms of the basis, refined once."""
        column = self.column(variable)
        direction = self.inverse @ column
        rest = column - self.matrix @ direction
        if np.abs(rest).max() > REFRESH * np.abs(column).max() and self.count >= self.fresh + PATIENCE:
            self.refresh()
            direction = self.inverse @ column
            rest = column - self.matrix @ direction
        return np.asarray(direction + self.inverse @ rest)

    def run(self, limit: int, deadline: float | None) -> Status:
        """Pivot until z₀ leaves (SOLVED), a ray appears (INFEASIBLE, unproved yet) or the limit is reached."""
        if self.size == 0 or self.lcp.q.min() >= 0.0:
            return Status.SOLVED
        # The first pivot makes every basic variable lexicographically positive: the row of the least q/d leaves.
        ratios = self.value / self.cover
        ties = np.flatnonzero(ratios <= ratios.min() + TIE_TOLERANCE * np.abs(ratios).max())
        self.pivot(int(ties[-1]), -self.cover)
        while self.count < limit:
            if deadline is not None and perf_counter() > deadline:
                return Status.MAX_ITERATIONS
            self.direction = self.basis_direction(self.entering)
            row = self.leaving_row()
            if row is None:
                return Status.INFEASIBLE
            done = self.basis[row] == 2 * self.size
            self.pivot(row, self.direction)
            if done:
                return Status.SOLVED
        return Status.MAX_ITERATIONS

    def leaving_row(self) -> int | None:
        """Return the row of the lexicographically least ratio, or None at a ray."""
        direction, value = self.direction, self.value
        rows = np.flatnonzero(direction > PIVOT_TOLERANCE * max(1.0, float(np.abs(direction).max())))
        if rows.size == 0:
            return None
        zero = ZERO * float(np.abs(value).max())
        longest = float(((value[rows] + zero) / direction[rows]).min())
        rows = rows[value[rows] <= longest * direction[rows]]
        self.idle = self.idle + 1 if float((value[rows] / direction[rows]).min()) <= zero else 0
        share = LARGE_PIVOT if self.idle <= IDLE_PIVOTS * self.size else TINY_PIVOT
        rows = rows[direction[rows] >= share * direction[rows].max()]
        artificial = np.flatnonzero(self.basis[rows] == 2 * self.size)
        if artificial.size:
            return int(rows[artificial[0]])
        best = int(rows[0])
        for row in rows[1:]:
            difference = self.inverse[row] / direction[row] - self.inverse[best] / direction[best]
            decisive = np.flatnonzero(np.abs(difference) > TIE_TOLERANCE * np.abs(difference).max())
            if decisive.size and difference[decisive[0]] < 0.0:
                best = int(row)
        return best

    def pivot(self, row: int, direction: Array) -> None:
        """Exchange the entering variable for the basic one of `row`; its complement enters next."""
        leaving = int(self.basis[row])
        self.matrix[:, row] = self.column(self.entering)
        self.basis[row] = self.entering
        self.entering = (leaving + self.size) % (2 * self.size) if leaving < 2 * self.size else leaving
        self.count += 1
        ratio = float(self.value[row] / direction[row])
        self.value -= ratio * direction
        self.value[row] = ratio
        pivot_row = self.inverse[row] / direction[row]
        self.inverse = la.blas.dger(-1.0, direction, pivot_row, a=self.inverse, overwrite_a=True)
        self.inverse[row] = pivot_row

    def refresh(self) -> None:
        """Invert the basis afresh. A basis is never singular, except by rounding: then the pivots go on as they are."""
        self.fresh = self.count
        try:
            with warnings.catch_warnings():
                # An ill-conditioned basis shows in the residual of the answer.
                warnings.simplefilter("ignore", la.LinAlgWarning)
                self.inverse = np.asfortranarray(la.inv(self.matrix))
        except la.LinAlgError:
            return
        self.value = self.inverse @ self.lcp.q
        self.value += self.inverse @ (self.lcp.q - self.matrix @ self.value)

    def solution(self) -> Array:
        """Return z of the present basis, from a fresh factorisation with one step of refinement."""
        z = np.zeros(self.size)
        if self.size == 0:
            return z
        matrix = self.matrix
        with warnings.catch_warnings():
            # A zero pivot shows as a value that is not finite, which the caller reports.
            warnings.simplefilter("ignore", la.LinAlgWarning)
            factors = la.lu_factor(matrix)
        value = la.lu_solve(factors, self.lcp.q)
        if np.isfinite(value).all():
            value += la.lu_solve(factors, self.lcp.q - matrix @ value)
        basic = (self.basis >= self.size) & (self.basis < 2 * self.size)
        z[self.basis[basic] - self.size] = np.maximum(value[basic], 0.0)
        return z

    def ray(self) -> Array:
        """Return the z part of the direction in which the entering variable grows without end."""
        z = np.zeros(self.size)
        basic = (self.basis >= self.size) & (self.basis < 2 * self.size)
        z[self.basis[basic] - self.size] = -self.direction[basic]
        if self.size <= self.entering < 2 * self.size:
            z[self.entering - self.size] = 1.0
        return z


def _proof(lcp: LCP, ray: Array) -> Array | None:
    """Return a certificate of infeasibility: the ray itself where it is one, else what a linear program finds."""
    ray = np.maximum(ray, 0.0)
    if lcp.proves_infeasible(ray):
        return np.asarray(ray / ray.max())
    size = lcp.q.size
    result = linprog(
        np.ones(size), A_ub=lcp.M.T, b_ub=np.zeros(size), A_eq=lcp.q[None, :], b_eq=[-1.0], bounds=(0, None)
    )
    if result.status == 0 and lcp.proves_infeasible(result.x):
        return np.asarray(result.x / result.x.max())
    return None


@dataclass(frozen=True)
class _Form:
    """How a formulation becomes an LCP, and its z impulses again; `unknowns` of a contact from its rows and facets."""

    pose: Callable[[StackedSystem, int], LCP]
    impulse: Callable[[StackedSystem, Array, int], Array]
    unknowns: Callable[[int, int], int]


_FORMS: Final[Mapping[str, _Form]] = {
    "normal": _Form(lambda system, _: normal_lcp(system), lambda system, z, _: normal_impulse(system, z), lambda *_: 1),
    "box": _Form(
        lambda system, _: box_lcp(system), lambda system, z, _: box_impulse(system, z), lambda rows, _: 3 * rows - 2
    ),
    "pyramid": _Form(pyramid_lcp, pyramid_impulse, lambda _, facets: facets + 2),
}


def _run(request: Request) -> Outcome:
    """Solve islands apart: a pivot takes time as the square of the unknowns, and their number grows with them."""
    start = perf_counter()
    whole = request.system
    islands = core_system(whole).islands() if request.presolve else [np.arange(whole.contacts, dtype=np.uint32)]
    form = _FORMS[request.formulation]
    parts = _gathered(islands, FEW_UNKNOWNS // form.unknowns(whole.rows, request.facets))
    system, factors = whole.normalised()
    impulse, ray = np.zeros((2, whole.contacts, whole.rows))
    status, pivots, unknowns, posing = Status.SOLVED, 0, 0, perf_counter() - start
    for contacts in parts:
        posed = perf_counter()
        part = system if len(parts) == 1 else system.restricted(contacts)
        lcp = form.pose(part, request.facets)
        unknowns += lcp.q.size
        posing += perf_counter() - posed
        found = solve_lcp(
            lcp.M,
            lcp.q,
            tolerance=request.tolerance,
            max_iterations=None if request.max_iterations is None else max(request.max_iterations - pivots, 0),
            time_limit=None if request.time_limit is None else request.time_limit - (perf_counter() - start),
        )
        pivots += found.iterations
        status = max(status, found.status, key=SEVERITY.index)
        impulse[contacts] = form.impulse(part, found.z, request.facets)
        if found.infeasibility is not None:
            ray[contacts] = form.impulse(part, found.infeasibility, request.facets)
    extras: dict[str, object] = {"unknowns": unknowns}
    if ray.any():
        ray *= factors[:, None]
        extras["infeasibility"] = ray / np.abs(ray).max()
    velocities = 0 if whole.jacobian is None else whole.jacobian.shape[1]
    size = (whole.contacts, whole.contacts * whole.rows, velocities)
    return Outcome(
        impulse=factors[:, None] * impulse,
        status=status,
        program=request.formulation,
        iterations=pivots,
        setup_seconds=posing,
        solve_seconds=perf_counter() - start - posing,
        extras=extras,
        presolved=(len(islands), size, size, ()) if len(parts) > 1 else None,
    )


def _gathered(islands: Sequence[Contacts], few: int) -> list[Contacts]:
    """Return islands put together while they have few contacts: one by one they take longer to pose than to solve."""
    parts: list[list[Contacts]] = []
    count = few
    for island in islands:
        count += island.size
        if count > few:
            parts.append([])
            count = island.size
        parts[-1].append(island)
    return [np.sort(np.concatenate(part)) for part in parts]


SOLVER: Final = Solver(
    name="lemke",
    method="direct: Lemke's complementary pivoting, lexicographic",
    programs={"normal": "LCP", "box": "boxed LCP", "pyramid": "Stewart-Trinkle LCP"},
    run=_run,
    apart=True,
)

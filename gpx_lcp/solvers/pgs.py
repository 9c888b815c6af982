"""Projected block Gauss-Seidel: visit the contacts one by one, solve each one exactly, repeat; the sweeps run in Rust.

With the other contacts held, contact i has the velocity u_i = A_ii p_i + b_i, and the formulation's own law makes that
a problem of at most three unknowns: p_i = 0 (separate), u_i = 0 (stick) or the boundary of the cone (slide), of which
the last takes one scalar equation. The relaxation ω takes p_i + ω(p_i* - p_i) instead of the solution p_i*, projected.

It needs a row of A (a system given by A) or one body state w = Ĵᵀ p (a system given by J and M⁻¹: A = Ĵ Ĵᵀ is then
never formed), so that a sweep costs the same whatever the accuracy. Information travels one contact a sweep or less: a
column of n equal masses contracts its error by cos²(π/2n) a sweep, a mass R on a mass 1 by R/(1 + R). Where sliding
contacts make it cycle, a relaxation of 0.7 often ends that.

A tower of n cubes whose contacts stick bends like a beam, and its sweeps grow with n⁴. So sweeps have momentum, unless
`acceleration=False` says otherwise: each starts beyond where the last has led (Nesterov, restarted), and a tower of 30
takes thousands of sweeps to 1e-6 instead of millions. `python -m benchmarks run acceleration` measures it against
sweeps without, Anderson's mixing and sub-steps. A relaxation above 1 overshoots by itself and wants no momentum beside
it.

Presolve comes first, as it does for the exact methods (see `gpx_lcp.presolve`): what is swept are the smallest systems
with the same answer, by kernels of their size, each part until it is within the tolerance or out of sweeps; what needs
no iteration is not swept at all. Polygons have axes of their own in the tangent plane, which reductions would turn:
"box" and "pyramid" are swept as they are. `presolve=False` sweeps any system as it is.

Contacts that share no body do not feel each other, so that their order does not matter: a system of bodies is swept by
colours, eight pairs of bodies abreast in the lanes of a register, and by as many threads as the setting `threads` says.
Their number changes no bit of the result. Threads share the parts that presolve leaves, or the sweeps of a part that is
most of the system. A system given by A is swept in its own order, one island by one thread, and so are contacts that
touch more than two bodies.

Sources: M. Jean, J. J. Moreau, *Unilaterality and dry friction in the dynamics of rigid body collections*, Contact
Mechanics International Symposium (1992); V. Acary, M. Brémond, O. Huber, INRIA RR-9118 (2018), algorithm NSGS; H.
Mazhar, T. Heyn, D. Negrut, A. Tasora, *Using Nesterov's method to accelerate multibody dynamics with friction and
contact*, ACM Transactions on Graphics 34 (2015).
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from formulations import FORMULATIONS
from formulations.checks import Array
from formulations.cones import box_directions, pyramid_directions
from gpx_lcp.errors import SettingsError
from gpx_lcp.solvers._interface import Outcome, Request, Solver
from gpx_lcp.solvers._native import NO_CORNERS, core_settings, run_core

MAX_SWEEPS: Final = 10_000


def run(request: Request) -> Outcome:
    """Sweep until the residual of the program is within the tolerance.

    A warm start whose residual is within the tolerance costs no sweep. The residual is evaluated at the start and every
    ten sweeps. Parts that presolve leaves are swept together where they have one shape, until all of them leave no more
    than the whole may; `iterations` are the most sweeps of any part, and `history` is that of the only part, or the
    residual of all together in the end. STALLED means that three thousand sweeps have not lowered it by one part in
    10⁴. Impulses outside the law's own polygon are first brought to it, keeping their
    normal part.

    Raises
    ------
    SettingsError
        When `relaxation` is not a number between 0 and 2, both excluded, `acceleration` is not True or False, or
        `threads` is not a whole number from 1 to 256.
    """
    return run_core(request, native(request))


def native(request: Request) -> dict[str, Any]:
    """Return what the sweeps, alone or in the core's own step, are told beside the system.

    Raises
    ------
    SettingsError
        See `run`.
    """
    relaxation, acceleration = request.settings["relaxation"], request.settings["acceleration"]
    if isinstance(relaxation, bool) or not isinstance(relaxation, int | float) or not 0.0 < relaxation < 2.0:
        raise SettingsError(f"relaxation is {relaxation!r}: it must be a number between 0 and 2, both excluded")
    if not isinstance(acceleration, bool):
        raise SettingsError(f"acceleration is {acceleration!r}: it must be True or False")
    program, corners = _program(request.formulation, request.system.rows, request.facets)
    return core_settings(
        request, "gauss_seidel", MAX_SWEEPS, program, corners, float(relaxation), acceleration=acceleration
    )


def _program(formulation: str, rows: int, facets: int) -> tuple[str, Array]:
    """Return the core's program and, for a polygon, its corners; with one row per contact all programs are the same."""
    if rows == 1:
        return "normal", NO_CORNERS
    if formulation not in ("box", "pyramid"):
        return formulation, NO_CORNERS
    directions = box_directions(rows) if formulation == "box" else pyramid_directions(rows, facets)
    corners = np.zeros((len(directions), 2))
    corners[:, : rows - 1] = directions
    return "polygon", corners.reshape(-1)


SOLVER: Final = Solver(
    name="pgs",
    method="projected block Gauss-Seidel",
    programs={name: name for name in FORMULATIONS},
    run=run,
    native=native,
    warm_starts=True,
    defaults={"relaxation": 1.0, "acceleration": True, "threads": 1},
)

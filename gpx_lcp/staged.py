"""A step taken stage by stage: what Python does between the stages of the core, so that any solver can stand there.

The stages themselves are methods of the core's world: free motion, detection, stacking, and the advance to the next
state.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import scipy.sparse as sp

from formulations import StackedSystem
from formulations.checks import Array
from gpx_lcp import _core
from gpx_lcp.impact_laws import ImpactLaw, impact_stage
from gpx_lcp.solution import Solution, Status
from gpx_lcp.solve import solve


@dataclass(frozen=True)
class Impacts:
    """How bodies rebound in a step.

    Attributes
    ----------
    velocities : (nv,) array
        Of the bodies before the step.
    speed : float, m/s
        Elasticity acts in contacts that close faster.
    time_step : float, s
    """

    law: ImpactLaw
    velocities: Array
    speed: float
    time_step: float


def stacked_system(stack: _core.Stack) -> StackedSystem:
    """Return the system that the core has stacked."""
    starts, columns, blocks, whitened = stack.jacobian()
    inverse_mass = stack.inverse_mass()
    shape = ((starts.size - 1) * blocks.shape[1], inverse_mass.shape[0] * inverse_mass.shape[1])
    return StackedSystem.from_jacobian(
        sp.bsr_array((blocks, columns, starts), shape=shape),
        inverse_mass,
        stack.target,
        stack.friction,
        free_velocity=stack.free_velocities.ravel(),
        whitened_blocks=whitened,
    )


def solve_step(
    stack: _core.Stack, contacts: _core.Contacts, start: Array | None, effort: Mapping[str, Any], impacts: Impacts
) -> tuple[Solution, Array, bool]:
    """Return the solution of a step, the impulses of all its contacts, and whether anything is above the tolerance.

    Where the law of impact is not the core's own, it has its stage first; the solution is of what that left to do, the
    impulses are both.

    Parameters
    ----------
    start : (n, 3) array, N s, optional
        Of the warm start.
    effort : mapping
        What `gpx.solve` is asked for beside the system.
    """
    system, stage = stacked_system(stack), None
    if not impacts.law.in_core and stack.impacts.any():
        found = contacts.gaps, stack.restitution, stack.impacts
        frictionless = effort["formulation"] == "normal"
        stage = impact_stage(
            impacts.law,
            system,
            impacts.velocities,
            found,
            impacts.speed,
            impacts.time_step,
            frictionless=frictionless,
        )
        system = stage.system
    solution = solve(system, warm_start=None if start is None else start[:, : system.rows], **effort)
    failed, impulse = solution.status is not Status.SOLVED, solution.impulse
    if stage is not None:
        failed, impulse = failed or stage.impact.status is not Status.SOLVED, impulse + stage.impulse
        solution = replace(solution, extras={**solution.extras, "impact": stage.impact})
    return naming_the_law(impacts.law, stack, solution), impulse, failed


def naming_the_law(law: ImpactLaw, stack: _core.Stack, solution: Solution) -> Solution:
    """Return the solution of a step, with the law of its impacts in its method if there are any."""
    if not stack.impacts.any():
        return solution
    return replace(solution, method=f"{law.name} impact, {solution.method}")

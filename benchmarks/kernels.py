"""What the sweep kernel alone costs: nanoseconds per contact and sweep, by formulation, on A and on Ĵ.

The time is the solver's own (`solve_seconds`): sweeps and the residual every ten sweeps, without assembly or set-up.
"""

from __future__ import annotations

import statistics
from collections.abc import Iterable
from dataclasses import dataclass

import numpy.typing as npt

import gpx_lcp as gpx

# A tolerance that no residual reaches, so that every sweep asked for is done.
NEVER = 1e-300


@dataclass(frozen=True)
class SweepCost:
    """Nanoseconds per contact and sweep: median, fastest and slowest of the repeats."""

    scene: str
    form: str
    formulation: str
    contacts: int
    nanoseconds: float
    low: float
    high: float


def sweep_costs(
    scene: str,
    system: gpx.StackedSystem,
    formulations: Iterable[str] = ("normal", "box", "pyramid", "cone", "coulomb"),
    sweeps: int = 500,
    repeats: int = 7,
) -> list[SweepCost]:
    """Return the cost of a sweep for each formulation, on the system as it is and on its explicit A.

    Each run starts from where `sweeps` sweeps from zero lead, so that the mixture of sticking, sliding and separate
    contacts is that of the scene and not of the first sweeps.

    Parameters
    ----------
    scene : str
        What the system is called in the result.
    system : StackedSystem
        With at least one contact; `gpx.World(gpx.scenes.tower(30)).system()` is the usual one.
    sweeps, repeats : int
        Sweeps per run, and runs per formulation, the forms and formulations taking turns.
    """
    forms = {"A": gpx.StackedSystem(system.A, system.B, system.friction)}
    if system.jacobian is not None:
        forms["J"] = system
    cases = [(form, formulation) for form in forms for formulation in formulations]
    starts = {case: _run(forms[case[0]], case[1], sweeps, None).impulse for case in cases}
    times: dict[tuple[str, str], list[float]] = {case: [] for case in cases}
    for _ in range(repeats):
        for case in cases:
            solution = _run(forms[case[0]], case[1], sweeps, starts[case])
            times[case].append(1e9 * solution.solve_seconds / (max(solution.iterations, 1) * system.contacts))
    return [
        SweepCost(scene, form, formulation, system.contacts, statistics.median(values), min(values), max(values))
        for (form, formulation), values in times.items()
    ]


def _run(system: gpx.StackedSystem, formulation: str, sweeps: int, start: npt.ArrayLike | None) -> gpx.Solution:
    return gpx.solve(system, formulation, "pgs", tolerance=NEVER, max_iterations=sweeps, warm_start=start)

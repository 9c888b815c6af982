"""What one sweep costs per contact, of gpx-lcp's and the peers' sweeping solvers, in the same run.

    cost = (t(many sweeps) - t(few sweeps)) / (contacts · (many - few))

with t the wall time of the first step of a fresh simulation. The difference drops collision detection, assembly and the
call itself, in every engine alike, so what is left is the sweep. Both solve one normal and two friction rows a contact.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Mapping
from contextlib import closing
from dataclasses import dataclass

import gpx_lcp as gpx
from benchmarks.interface import Engine, Setting

FEW, MANY = 100, 1100

# Far above what they take, s: here the sweeps are what counts.
TIME_LIMIT = 60.0


@dataclass(frozen=True)
class Rate:
    """Nanoseconds per contact and sweep.

    Parameters
    ----------
    median : float
        From the medians of the interleaved repeats: what one gets.
    fastest : float
        From the fastest repeats: what the sweep costs where nothing else disturbs the processor.
    """

    scene: str
    engine: str
    solver: str
    formulation: str
    contacts: int
    repeats: int
    median: float
    fastest: float


def measure_rates(
    name: str,
    scene: gpx.Scene,
    engines: Mapping[str, Engine],
    time_step: float,
    repeats: int,
    wanted: Callable[[Setting], bool],
    advance: Callable[[str], None],
) -> list[Rate]:
    """Return the rate of every wanted sweeping solver; `advance(text)` is called before each repeat."""
    pairs = [
        (engine, few, many)
        for engine in engines.values()
        for few, many in zip(engine.sweeping(FEW), engine.sweeping(MANY), strict=True)
        if wanted(few)
    ]
    short: list[list[float]] = [[] for _ in pairs]
    long: list[list[float]] = [[] for _ in pairs]
    contacts = [0] * len(pairs)
    for _ in range(repeats):
        advance(f"{name}: cost of a sweep")
        for index, (engine, few, many) in enumerate(pairs):
            short[index].append(_first_step(engine, scene, time_step, few)[0])
            seconds, contacts[index] = _first_step(engine, scene, time_step, many)
            long[index].append(seconds)
    return [
        Rate(
            scene=name,
            engine=setting.engine,
            solver=setting.solver,
            formulation=setting.formulation,
            contacts=contacts[index],
            repeats=repeats,
            median=_cost(statistics.median(short[index]), statistics.median(long[index]), contacts[index]),
            fastest=_cost(min(short[index]), min(long[index]), contacts[index]),
        )
        for index, (_, setting, _) in enumerate(pairs)
    ]


def _cost(few: float, many: float, contacts: int) -> float:
    return 1e9 * (many - few) / (contacts * (MANY - FEW))


def _first_step(engine: Engine, scene: gpx.Scene, time_step: float, setting: Setting) -> tuple[float, int]:
    """Return the wall time of the first step of a fresh simulation, s, and its number of contacts."""
    with closing(engine.simulate(scene, time_step, setting, TIME_LIMIT)) as simulation:
        tick = time.perf_counter()
        simulation.step()
        seconds = time.perf_counter() - tick
        return seconds, simulation.contacts().gap.size

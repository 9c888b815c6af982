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

import numpy as np

import gpx_lcp as gpx
from benchmarks.interface import Contacts, Engine, Setting

FEW, MANY = 100, 1100

# How far inside its cone, as a share of its radius, an impulse may lie that still slides.
EDGE = 1e-9
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
    open, sliding : float
        Shares of the contacts that exert nothing, and that push with all the friction they have, after many sweeps.
    """

    scene: str
    engine: str
    solver: str
    formulation: str
    contacts: int
    repeats: int
    median: float
    fastest: float
    open: float
    sliding: float


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
    solved: list[Contacts | None] = [None] * len(pairs)
    for _ in range(repeats):
        advance(f"{name}: cost of a sweep")
        for index, (engine, few, many) in enumerate(pairs):
            short[index].append(_first_step(engine, scene, time_step, few)[0])
            seconds, solved[index] = _first_step(engine, scene, time_step, many)
            long[index].append(seconds)
    return [
        _rate(name, setting, contacts, short[index], long[index])
        for index, (_, setting, _) in enumerate(pairs)
        if (contacts := solved[index]) is not None
    ]


def _rate(name: str, setting: Setting, contacts: Contacts, short: list[float], long: list[float]) -> Rate:
    count = contacts.gap.size
    normal = np.einsum("ij,ij->i", contacts.impulse, contacts.normal)
    tangential = np.linalg.norm(contacts.impulse - normal[:, None] * contacts.normal, axis=1)
    at_edge = tangential >= (1.0 - EDGE) * contacts.friction * normal
    return Rate(
        scene=name,
        engine=setting.engine,
        solver=setting.solver,
        formulation=setting.formulation,
        contacts=count,
        repeats=len(long),
        median=_cost(statistics.median(short), statistics.median(long), count),
        fastest=_cost(min(short), min(long), count),
        open=float(np.mean(normal <= 0.0)),
        sliding=float(np.mean((normal > 0.0) & at_edge)),
    )


def _cost(few: float, many: float, contacts: int) -> float:
    return 1e9 * (many - few) / (contacts * (MANY - FEW))


def _first_step(engine: Engine, scene: gpx.Scene, time_step: float, setting: Setting) -> tuple[float, Contacts]:
    """Return the wall time of the first step of a fresh simulation, s, and its contacts."""
    with closing(engine.simulate(scene, time_step, setting, TIME_LIMIT)) as simulation:
        tick = time.perf_counter()
        simulation.step()
        seconds = time.perf_counter() - tick
        return seconds, simulation.contacts()

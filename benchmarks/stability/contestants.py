"""Who climbs: every installed solver with every formulation that has friction, and the peers at their most careful."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import gpx_lcp as gpx
from benchmarks.attempts import OWN
from benchmarks.engines import ENGINES, SYSTEM_ENGINES
from benchmarks.interface import Setting
from benchmarks.stability.modes import Mode, SystemQuestion

# Methods of our own are asked for what is their default; backends for what they can mostly reach.
TOLERANCE, BACKEND_TOLERANCE = 1e-8, 1e-6

FRICTIONLESS = "normal"
ORDER = ("newton", "interior_point", "pgs", "lemke")


def own_settings(mode: Mode) -> list[Setting]:
    """Return each installed solver with each formulation that it is asked for in a mode, ours first."""
    rows = {row.name: row for row in gpx.solvers().values() if row.installed}
    names = [*ORDER, *sorted(name for name in rows if name not in ORDER)]
    return [
        Setting(OWN, name, formulation, "", 0.0, _options(name))
        for name in names
        if not mode.solvers or name in mode.solvers
        for formulation in formulations(rows[name].programs, mode.frictionless)
    ]


def _options(name: str) -> dict[str, float]:
    # Where sweeps crawl is what several ladders are about: they go over the contacts as they are.
    asked = {"presolve": False} if name == "pgs" else {}
    return {"tolerance": TOLERANCE if name in ORDER else BACKEND_TOLERANCE, **asked}


def formulations(programs: Iterable[str], frictionless: bool) -> list[str]:
    """Return which of a solver's formulations are posed: `normal` alone where there is no friction, else the others."""
    return [name for name in reversed(list(programs)) if (name == FRICTIONLESS) == frictionless]


def peer_settings(engine: str) -> list[Setting]:
    """Return the most careful setting of each of a peer's solvers, with the first program that it poses."""
    lines: dict[str, list[Setting]] = {}
    for setting in ENGINES[engine].settings(False):
        line = lines.setdefault(setting.solver, [])
        if not line or setting.formulation == line[0].formulation:
            line.append(setting)
    return [max(line, key=lambda setting: (setting.careful, setting.effort)) for line in lines.values()]


def settings(mode: Mode, names: Sequence[str]) -> list[Setting]:
    """Return the settings of each engine that can be asked: with a system or, where it simulates, with a scene."""
    systems = isinstance(mode.build(mode.rungs[0]), SystemQuestion)
    peers = [name for name in names if name != OWN and not mode.solvers and (not systems or name in SYSTEM_ENGINES)]
    found = [setting for name in peers for setting in peer_settings(name) if systems or not setting.first_step_only]
    return [*(own_settings(mode) if OWN in names else []), *found]

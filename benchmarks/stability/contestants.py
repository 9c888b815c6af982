"""Who climbs: every installed solver with every formulation that has friction, and the peers at their most careful."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import gpx_lcp as gpx
from benchmarks.attempts import OWN
from benchmarks.engines import ENGINES, PEERS
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
        Setting(OWN, name, formulation, "", 0.0, {"tolerance": TOLERANCE if name in ORDER else BACKEND_TOLERANCE})
        for name in names
        if not mode.solvers or name in mode.solvers
        for formulation in formulations(rows[name].programs, mode.frictionless)
    ]


def formulations(programs: Iterable[str], frictionless: bool) -> list[str]:
    """Return which of a solver's formulations are posed: `normal` alone where there is no friction, else the others."""
    return [name for name in reversed(list(programs)) if (name == FRICTIONLESS) == frictionless]


def peer_settings(engine: str) -> Sequence[Setting]:
    """Return the setting with the most effort of each of a peer's solvers, with the first program that it poses."""
    found: dict[str, Setting] = {}
    for setting in ENGINES[engine].settings(False):
        known = found.setdefault(setting.solver, setting)
        if setting.formulation == known.formulation and setting.effort > known.effort:
            found[setting.solver] = setting
    return list(found.values())


def settings(mode: Mode, peers: Iterable[str]) -> Mapping[str, Sequence[Setting]]:
    """Return the settings of each engine that is installed; a system is asked of gpx-lcp alone."""
    found: dict[str, Sequence[Setting]] = {OWN: own_settings(mode)}
    if isinstance(mode.build(mode.rungs[0]), SystemQuestion):
        return found
    return found | {name: peer_settings(name) for name in PEERS if name in set(peers) and ENGINES[name].version()}

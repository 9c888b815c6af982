"""The table of engines: gpx-lcp itself and its peers. One file and one row each."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from benchmarks.attempts import OWN
from benchmarks.engines.dart import Dart
from benchmarks.engines.drake import Drake
from benchmarks.engines.gpx import GpxLcp
from benchmarks.engines.mujoco import MuJoCo
from benchmarks.engines.pinocchio import Pinocchio
from benchmarks.engines.pybullet import PyBullet
from benchmarks.engines.rapier import Rapier
from benchmarks.interface import Engine, Setting, SystemEngine
from gpx_lcp import BackendMissing

# Those that solve stacked systems without a scene around them.
SYSTEM_ENGINES: Mapping[str, SystemEngine] = {engine.name: engine for engine in (GpxLcp(), Pinocchio())}

ENGINES: Mapping[str, Engine] = {
    engine.name: engine
    for engine in (
        SYSTEM_ENGINES[OWN],
        *(PyBullet(), MuJoCo(), Rapier(), Dart(), Drake()),
        SYSTEM_ENGINES["pinocchio"],
    )
}

__all__ = ["ENGINES", "OWN", "PEERS", "SYSTEM_ENGINES", "as_shipped", "require_installed"]

PEERS = tuple(name for name in ENGINES if name != OWN)


def as_shipped(names: Iterable[str]) -> list[Setting]:
    """Return the setting with which each peer comes; the first one that simulates where none is named so."""
    found = []
    for name in names:
        if name != OWN:
            simulating = [setting for setting in ENGINES[name].settings(False) if not setting.first_step_only]
            found += ([each for each in simulating if "as shipped" in each.solver] or simulating)[:1]
    return found


def require_installed(name: str) -> None:
    """Raise BackendMissing, with the command that installs it, where an engine is not installed."""
    if not ENGINES[name].version():
        raise BackendMissing(ENGINES[name].install)

"""The table of engines: gpx-lcp itself and its peers. One file and one row each."""

from __future__ import annotations

from collections.abc import Mapping

from benchmarks.attempts import OWN
from benchmarks.engines.dart import Dart
from benchmarks.engines.drake import Drake
from benchmarks.engines.gpx import GpxLcp
from benchmarks.engines.mujoco import MuJoCo
from benchmarks.engines.pinocchio import Pinocchio
from benchmarks.engines.pybullet import PyBullet
from benchmarks.engines.rapier import Rapier
from benchmarks.interface import Engine, Setting

ENGINES: Mapping[str, Engine] = {
    engine.name: engine for engine in (GpxLcp(), PyBullet(), MuJoCo(), Rapier(), Dart(), Drake(), Pinocchio())
}

__all__ = ["ENGINES", "OWN", "PEERS", "as_shipped"]

PEERS = tuple(name for name in ENGINES if name != OWN)


def as_shipped() -> list[Setting]:
    """Return the setting with which each installed peer comes; the first one of an engine that names none so."""
    found = []
    for name in PEERS:
        if ENGINES[name].version():
            simulating = [setting for setting in ENGINES[name].settings(False) if not setting.first_step_only]
            found += ([each for each in simulating if "as shipped" in each.solver] or simulating)[:1]
    return found

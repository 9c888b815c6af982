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
from benchmarks.interface import Engine

ENGINES: Mapping[str, Engine] = {
    engine.name: engine for engine in (GpxLcp(), PyBullet(), MuJoCo(), Rapier(), Dart(), Drake(), Pinocchio())
}

__all__ = ["ENGINES", "OWN", "PEERS"]

PEERS = tuple(name for name in ENGINES if name != OWN)

"""The table of engines: gpx-lcp itself and its peers. One file and one row each."""

from __future__ import annotations

from collections.abc import Mapping

from benchmarks.engines.gpx import GpxLcp
from benchmarks.engines.pybullet import PyBullet
from benchmarks.interface import Engine

OWN = "gpx-lcp"

ENGINES: Mapping[str, Engine] = {engine.name: engine for engine in (GpxLcp(), PyBullet())}

PEERS = tuple(name for name in ENGINES if name != OWN)

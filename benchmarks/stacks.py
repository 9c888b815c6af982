"""The suite `stacks`: resting stacks, whose interface loads are known on paper.

Two cases per scene. **cold**: the first step from touching rest, with nothing to warm-start from; only a solver that
finds all loads at once passes. **stepped**: the warm-started steps after it, where any engine at rest passes on load,
and drift, penetration and time per step tell the engines apart.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import gpx_lcp as gpx

NAME = "stacks"

TIME_STEP = 1 / 240


@dataclass(frozen=True)
class StackScene:
    """A scene of the suite: its title in tables and charts, and how to make it."""

    title: str
    make: Callable[[], gpx.Scene]


SCENES: Mapping[str, StackScene] = {
    "tower-5": StackScene("Tower of 5", lambda: gpx.scenes.tower(5)),
    "tower-10": StackScene("Tower of 10", lambda: gpx.scenes.tower(10)),
    "tower-30": StackScene("Tower of 30", lambda: gpx.scenes.tower(30)),
    "wall-5": StackScene("Wall, 5 rows", lambda: gpx.scenes.wall(5)),
    "wall-10": StackScene("Wall, 10 rows", lambda: gpx.scenes.wall(10)),
    "heavy-on-light": StackScene("Heavy on light, 1000:1", lambda: gpx.scenes.heavy_on_light(2, 1000.0)),
}

# Enough for continuous integration to see every part of the run work; too small to conclude from.
QUICK_SCENES = ("tower-5", "wall-5", "heavy-on-light")

NOT_SHOWN = (
    "What this does not show: scenes that move (sliding, impacts, rolling), where friction laws differ most and where "
    "a resting stack cannot tell them apart; large scenes, several threads, other machines, other time steps; how a "
    "wall shares its load between neighbours, which statics leaves open (only cuts and bodies are checked); engines "
    "that are not installed here. Step time is the whole call, collision detection included; steps of gpx-lcp with a "
    "solver that is not its own are driven from Python. Times on a shared machine are good to 20-30 %: compare within "
    "one run. The program `normal` leaves friction out and is not ranked. The certificate judges all impulses by the "
    "exact Coulomb law, which an engine with a box or a pyramid does not pose."
)

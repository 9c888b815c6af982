"""The suite `stacks`: resting stacks, whose interface loads are known on paper.

Two cases per scene. **cold**: the first step from touching rest, with nothing to warm-start from; only a solver that
finds all loads at once passes. **stepped**: the last quarter of the warm-started steps after it, where any engine at
rest passes on load, and drift, penetration and time per step tell the engines apart. Where gravity swings, the load is
known in every step too, and rest is never free.

Bodies start with an overlap of 1e-9 m: at exactly zero depth some engines see no contact in the first step.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

import gpx_lcp as gpx
from benchmarks.interface import Array, Setting
from benchmarks.measures import layers

NAME = "stacks"

TIME_STEP = 1 / 240

OVERLAP = 1e-9

# Gravity that swings by half of itself, five times a second.
SWING, SWING_RATE = 0.5, 5.0


@dataclass(frozen=True)
class StackScene:
    """A scene of the suite: its title in tables and charts, how to make it, and how it is run.

    Parameters
    ----------
    title : str
    make : callable
    charted : bool
        Whether every solver is run and drawn; else those alone that simulate with friction, for the table of ratios.
    swings : bool
        Whether gravity swings.
    at_rest : bool
        Whether nothing should move, so that loads have a truth.
    usual : bool
        Whether it is run unless scenes are named: the large ones take minutes.
    large : bool
        Whether it has thousands of contacts, so that our steps are also held to pybullet's certificate.
    patience : float
        How many times the usual time limit each setting has.
    """

    title: str
    make: Callable[[], gpx.Scene]
    charted: bool = False
    swings: bool = False
    at_rest: bool = True
    usual: bool = True
    large: bool = False
    patience: float = 1.0

    def wants(self, setting: Setting) -> bool:
        """Whether a setting is run on this scene."""
        if self.large and setting.not_large:
            return False
        return self.charted or not (setting.first_step_only or setting.formulation == "normal")

    def gravity(self) -> Callable[[float], Array] | None:
        """Return gravity over time, (3,), m/s², where it changes."""
        return swinging_gravity if self.swings else None


def swinging_gravity(time: float) -> Array:
    """Return g (1 + 0.5 sin(2π 5 Hz t)) downwards."""
    factor = 1.0 + SWING * math.sin(2.0 * math.pi * SWING_RATE * time)
    return np.array([0.0, 0.0, -9.81 * factor])


def pressed(scene: gpx.Scene) -> gpx.Scene:
    """Return the same scene with each layer of bodies 1e-9 m into the one below."""
    up = -scene.gravity / np.linalg.norm(scene.gravity)
    layer = layers(np.array([body.position for body in scene.bodies]) @ up)
    moved = gpx.Scene(scene.gravity)
    for body in scene.fixed:
        assert body.shape is not None
        moved.add_static(
            body.shape,
            position=body.position,
            orientation=body.orientation,
            material=body.material,
            name=body.name,
        )
    for body in scene.bodies:
        moved.add_rigid(
            body.shape,
            body.mass,
            inertia=body.inertia,
            position=body.position - OVERLAP * (layer[body.index] + 1) * up,
            orientation=body.orientation,
            material=body.material,
            name=body.name,
        )
    return moved


def _heavy(ratio: float) -> StackScene:
    return StackScene(f"10 cubes, top × {ratio:g}", lambda: pressed(gpx.scenes.heavy_on_light(10, ratio)), usual=False)


# Scenes of hundreds of contacts, which take longer to judge than to step, and of thousands.
MIDDLING: Mapping[str, Any] = {"usual": False, "patience": 5.0}
LARGE: Mapping[str, Any] = {"usual": False, "large": True, "patience": 30.0}

SCENES: Mapping[str, StackScene] = {
    "tower-5": StackScene("Tower of 5", lambda: pressed(gpx.scenes.tower(5)), charted=True),
    "tower-10": StackScene("Tower of 10", lambda: pressed(gpx.scenes.tower(10)), charted=True),
    "tower-30": StackScene("Tower of 30", lambda: pressed(gpx.scenes.tower(30)), charted=True),
    "wall-5": StackScene("Wall, 5 rows", lambda: pressed(gpx.scenes.wall(5)), charted=True),
    "wall-10": StackScene("Wall, 10 rows", lambda: pressed(gpx.scenes.wall(10)), charted=True),
    "heavy-on-light": StackScene(
        "Heavy on light, 1000:1", lambda: pressed(gpx.scenes.heavy_on_light(2, 1000.0)), charted=True
    ),
    "tower-100": StackScene("Tower of 100", lambda: pressed(gpx.scenes.tower(100)), **MIDDLING),
    "wall-20": StackScene("Wall, 20 rows", lambda: pressed(gpx.scenes.wall(20)), **MIDDLING),
    "pyramid-10": StackScene("Pyramid of 55", lambda: pressed(gpx.scenes.pyramid(10)), usual=False),
    "table-4": StackScene("Table on 4 legs", lambda: pressed(gpx.scenes.table(4)), usual=False),
    "table-9": StackScene("Table on 9 legs", lambda: pressed(gpx.scenes.table(9)), usual=False),
    "heavy-10": _heavy(10.0),
    "heavy-100": _heavy(100.0),
    "heavy-1000": _heavy(1000.0),
    "towerg-30": StackScene("Tower of 30, gravity swings", lambda: pressed(gpx.scenes.tower(30)), swings=True),
    "towerg-100": StackScene(
        "Tower of 100, gravity swings", lambda: pressed(gpx.scenes.tower(100)), swings=True, **MIDDLING
    ),
    "pile-1000": StackScene("1 000 balls fall", lambda: gpx.scenes.sphere_pile(1000), **LARGE, at_rest=False),
    "pile-8000": StackScene("8 000 balls fall", lambda: gpx.scenes.sphere_pile(8000), **LARGE, at_rest=False),
    "pyramid-100": StackScene("Pyramid of 5 050", lambda: pressed(gpx.scenes.pyramid(100)), **LARGE),
}

USUAL_SCENES = tuple(name for name, scene in SCENES.items() if scene.usual)

# Enough for continuous integration to see every part of the run work; too small to conclude from.
QUICK_SCENES = ("tower-5", "wall-5", "heavy-on-light")

NOT_SHOWN = (
    "What this does not show: scenes that move (sliding, impacts, rolling), where friction laws differ most and where "
    "a resting stack cannot tell them apart; several threads, other machines, other time steps; how a wall shares its "
    "load between neighbours, which statics leaves open (only cuts and bodies are checked); engines that are not "
    "installed here. Step time is the whole call, collision detection included, except for pinocchio, whose solvers "
    "are timed alone; solvers of gpx-lcp that are not its own are asked for the first step only, from Python. Engines "
    "with springs or compliance at contacts (mujoco, rapier, drake) do not pose the rigid problem: their first step "
    "shows that, their settled steps carry the right loads all the same. Times of a shared machine hold to 20-30 %: "
    "compare within one run. The program `normal` leaves friction out and is not ranked. The certificate judges all "
    "impulses by the exact Coulomb law, which an engine with a box or a pyramid does not pose."
)

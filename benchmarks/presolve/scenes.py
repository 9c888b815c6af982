"""The scenes of the suite: some that presolve makes small, and some that it cannot."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np

import gpx_lcp as gpx

# How fast towers and walls start to move, m/s and rad/s, where they do.
SHAKING: Final = 0.3


def nothing(world: gpx.World) -> None:
    """Leave a world as it is."""


def swing_load(world: gpx.World) -> None:
    """Make all weights swing by half, so that what rests has other loads in every step."""
    world.gravity = (0.0, 0.0, -9.81 * (1.0 + 0.5 * np.sin(8.0 * world.time)))


@dataclass(frozen=True)
class PresolveScene:
    """A scene: what it is, how to make it, steps taken before anything is measured, and what is changed before each."""

    title: str
    make: Callable[[], gpx.Scene]
    steps_before: int = 0
    threads: int = 1
    change: Callable[[gpx.World], None] = nothing

    @cached_property
    def frictionless(self) -> bool:
        """Whether no contact has friction."""
        scene = self.make()
        return not any(body.material.friction for body in (*scene.bodies, *scene.fixed))


def shaken(scene: gpx.Scene, plane: bool, seed: int = 0) -> gpx.Scene:
    """Return the scene with a random velocity for every body, in the plane x-z or in space."""
    rng = np.random.default_rng(seed)
    result = gpx.Scene(scene.gravity)
    for body in scene.fixed:
        assert body.shape is not None
        result.add_static(
            body.shape, position=body.position, orientation=body.orientation, material=body.material, name=body.name
        )
    for body in scene.bodies:
        linear, angular = SHAKING * rng.normal(size=(2, 3))
        keep = np.array([1.0, 0.0, 1.0])
        result.add_rigid(
            body.shape,
            body.mass,
            position=body.position,
            orientation=body.orientation,
            material=body.material,
            velocity=linear * keep if plane else linear,
            angular_velocity=angular * (1.0 - keep) if plane else angular,
            name=body.name,
        )
    return result


def towers(count: int, height: int) -> gpx.Scene:
    """Return towers that know nothing of each other, each cube with a random velocity."""
    scene = gpx.Scene()
    scene.add_static(gpx.HalfSpace(), name="ground")
    for place in range(count):
        for level in range(height):
            scene.add_rigid(gpx.Box(1, 1, 1), 1.0, position=(3.0 * place, 0.0, 0.5 + level))
    return shaken(scene, plane=False)


SCENES: Final[Mapping[str, PresolveScene]] = {
    "tower-30": PresolveScene("tower of 30 at rest", lambda: gpx.scenes.tower(30)),
    "tower-30-plane": PresolveScene("tower of 30, moving in a plane", lambda: shaken(gpx.scenes.tower(30), True)),
    "wall-10": PresolveScene("wall of 10 rows at rest", lambda: gpx.scenes.wall(10)),
    "wall-6-plane": PresolveScene("wall of 6 rows, moving in its plane", lambda: shaken(gpx.scenes.wall(6), True)),
    "arch-25": PresolveScene("arch of 25 stones", lambda: gpx.scenes.arch(25)),
    "cards-4": PresolveScene("house of cards, 4 levels", lambda: gpx.scenes.card_house(4)),
    "column-100": PresolveScene("column of 100 point masses", lambda: gpx.scenes.column(100)),
    "column-100-load": PresolveScene(
        "column of 100, loads that change", lambda: gpx.scenes.column(100), change=swing_load
    ),
    "pile-100-smooth": PresolveScene(
        "100 balls without friction in a pit",
        lambda: gpx.scenes.sphere_pile(100, friction=0.0),
        steps_before=150,
    ),
    "islands-20": PresolveScene("20 towers of 8, moving", lambda: towers(20, 8), threads=2),
    "tower-30-space": PresolveScene("tower of 30, moving in space", lambda: shaken(gpx.scenes.tower(30), False)),
    "pile-100": PresolveScene("100 balls with friction in a pit", lambda: gpx.scenes.sphere_pile(100), 150),
    "table-6": PresolveScene("table on six legs", lambda: gpx.scenes.table(6)),
}
QUICK: Final = ("tower-30", "column-100", "table-6")

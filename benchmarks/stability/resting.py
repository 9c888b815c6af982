"""What rests: towers, masses that differ, contacts in surplus, an arch and a house of cards.

The truth is statics: a horizontal cut carries the weight above it, and nothing moves.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

import gpx_lcp as gpx
from benchmarks.interface import Array
from benchmarks.stability.modes import GRAVITY, TIME_STEP, Course, Mode, SceneQuestion, SystemQuestion, worst
from benchmarks.stacks import pressed

# Of a load, and of the way that a body at rest may go, m.
LOAD, DRIFT = 1e-2, 1e-2
# Of a load that one solve gives.
SOLVED_LOAD = 1e-3

AT_REST = "each cut carries the weight above it, and nothing moves"
RULE = "loads within 1 %, no body 1 cm away"


def resting(scene: gpx.Scene, steps: int = 48, time_step: float = TIME_STEP) -> SceneQuestion:
    """Return a scene that should stay as it is."""
    return SceneQuestion(pressed(scene), steps, _load_and_drift, time_step)


def standing(scene: gpx.Scene) -> SceneQuestion:
    """Return a scene that should stand, whose loads statics leaves open."""
    return SceneQuestion(scene, 48, lambda course: course.measures.drift / DRIFT)


def _load_and_drift(course: Course) -> float:
    return worst(course.measures.load_error / LOAD, course.measures.drift / DRIFT)


def column(height: float) -> SystemQuestion:
    """Return a column of equal point masses."""
    n = int(height)
    truth = GRAVITY * TIME_STEP * np.arange(n, 0, -1)
    system = gpx.World(gpx.scenes.column(n), TIME_STEP).system()
    return SystemQuestion(system, lambda p, u: _off(p[:, 0], truth))


def relaxed(factor: float) -> SystemQuestion:
    """Return a column of five, swept with over-relaxation and nothing else."""
    question = column(5)
    return SystemQuestion(question.system, question.error, settings={"relaxation": factor, "acceleration": False})


def shuffled(seed: float) -> SystemQuestion:
    """Return a tower of ten whose contacts are in random order."""
    system = gpx.World(gpx.scenes.tower(10), TIME_STEP).system()
    assert system.jacobian is not None and system.inverse_mass is not None
    order = np.random.default_rng(int(seed)).permutation(system.contacts)
    rows = (3 * order[:, None] + np.arange(3)).ravel()
    mixed = gpx.StackedSystem.from_jacobian(
        system.jacobian.tocsr()[rows], system.inverse_mass, system.B[rows], system.friction[order]
    )
    truth = GRAVITY * TIME_STEP * np.arange(10, 0, -1)
    # Four contacts to an interface, from below.
    return SystemQuestion(mixed, lambda p, u: _off(np.bincount(order // 4, p[:, 0]), truth))


def scaled(scale: float) -> SystemQuestion:
    """Return a tower of three with masses that many times as large and velocities that many times as small."""
    system = gpx.World(gpx.scenes.tower(3), TIME_STEP).system()
    assert system.jacobian is not None and system.inverse_mass is not None
    other = gpx.StackedSystem.from_jacobian(
        system.jacobian, system.inverse_mass / scale, system.B / scale, system.friction
    )
    truth = GRAVITY * TIME_STEP * np.arange(3, 0, -1)
    return SystemQuestion(other, lambda p, u: _off(p[:, 0].reshape(3, 4).sum(axis=1), truth))


def _off(load: Array, truth: Array) -> float:
    return float(np.abs(load / truth - 1.0).max()) / SOLVED_LOAD


def stepped(rate: float) -> SceneQuestion:
    """Return a tower of five with so many steps per second; soft contacts have at least 50 ms to settle."""
    return resting(gpx.scenes.tower(5), max(48, round(0.05 * rate)), 1.0 / rate)


def deck(legs: float) -> gpx.Scene:
    """Return a plate of 10 kg on a square grid of legs of 1 kg, 8 contacts each."""
    side = math.isqrt(int(legs))
    scene, material = gpx.Scene(), gpx.Material(0.5)
    scene.add_static(gpx.HalfSpace(), material=material)
    for k in range(side * side):
        x, y = (1.8 * (place / (side - 1)) - 0.9 for place in divmod(k, side))
        scene.add_rigid(gpx.Box(0.1, 0.1, 0.5), 1.0, position=(x, y, 0.25), material=material)
    scene.add_rigid(gpx.Box(2.0, 2.0, 0.1), 10.0, position=(0.0, 0.0, 0.55), material=material)
    return scene


def elastic_tower(elasticity: float) -> gpx.Scene:
    """Return three cubes of some elasticity at rest."""
    scene, material = gpx.Scene(), gpx.Material(0.5, elasticity)
    scene.add_static(gpx.HalfSpace(), material=material)
    for k in range(3):
        scene.add_rigid(gpx.Box(1, 1, 1), 1.0, position=(0.0, 0.0, k + 0.5), material=material)
    return scene


HEIGHTS = (2, 5, 10, 30, 100, 300, 1000)

MODES: Mapping[str, Mode] = {
    "column": Mode(
        "F1", "column of point masses", "masses", HEIGHTS, column, "load k is (n - k + 1) m g", "loads within 0.1 %",
        frictionless=True,
    ),
    "mass-ratio": Mode(
        "F2", "heavy cube on a light one", "mass ratio", (1, 10, 100, 1e3, 1e4, 1e5, 1e6),
        lambda ratio: resting(gpx.scenes.heavy_on_light(2, ratio)), AT_REST, RULE,
    ),
    "deck": Mode(
        "F3", "plate on many legs", "legs", (4, 9, 16, 36, 64), lambda legs: resting(deck(legs)), AT_REST, RULE,
    ),
    "tower": Mode(
        "F4", "tower of cubes", "cubes", HEIGHTS, lambda n: resting(gpx.scenes.tower(int(n))), AT_REST, RULE,
    ),
    "elastic-rest": Mode(
        "F18", "elastic cubes at rest", "elasticity", (1, 1.2, 1.5, 1.8, 2),
        lambda elasticity: resting(elastic_tower(elasticity)), "nothing bounces", RULE,
    ),
    "time-step": Mode(
        "F22", "tower of 5, longer steps", "steps per second", (480, 240, 120, 60, 30), stepped, AT_REST, RULE,
    ),
    "short-step": Mode(
        "F22", "tower of 5, shorter steps", "steps per second", (240, 500, 1000, 2000, 5000, 1e4),
        stepped, AT_REST, RULE,
    ),
    "arch": Mode(
        "F23", "arch", "stones", (5, 11, 25, 51, 101), lambda n: standing(gpx.scenes.arch(int(n))), "it stands",
        "no stone 1 cm away after 0.2 s",
    ),
    "cards": Mode(
        "F23", "house of cards", "levels", (1, 2, 3, 4, 6, 10), lambda n: standing(gpx.scenes.card_house(int(n))),
        "it stands", "no card 1 cm away after 0.2 s",
    ),
    "units": Mode(
        "F25, F30", "other units", "masses times, velocities over", (1, 1e3, 1e6, 1e9, 1e12, 1e15), scaled,
        "the impulses stay as they are", "loads within 0.1 %",
    ),
    "density": Mode(
        "F26", "heavier cubes, tower of 3", "mass of each, kg", (1, 10, 100, 1e3, 1e4, 1e5, 1e6),
        lambda mass: resting(gpx.scenes.tower(3, mass=mass)), AT_REST, RULE,
    ),
    "relaxation": Mode(
        "F28", "over-relaxed sweeps", "relaxation", (1, 1.2, 1.5, 1.8, 1.95, 1.99), relaxed,
        "load k is (n - k + 1) m g", "loads within 0.1 %", frictionless=True, solvers=("pgs",),
    ),
    "order": Mode(
        "F29", "tower of 10, contacts shuffled", "seed", (1, 2, 3, 4, 5, 6, 7, 8), shuffled,
        "each interface carries the weight above it", "loads within 0.1 %",
    ),
}  # fmt: skip

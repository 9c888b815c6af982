"""What bounces, or is pushed: energy that must neither be lost nor come from nowhere."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

import gpx_lcp as gpx
from benchmarks.interface import Array
from benchmarks.stability.modes import GRAVITY, TIME_STEP, Course, Mode, SceneQuestion, SystemQuestion, worst

# From which the ball falls, m.
HEIGHT = 0.2
TRAVEL = math.sqrt(2.0 * GRAVITY * HEIGHT) * TIME_STEP


def cradle(balls: float) -> SystemQuestion:
    """Return Newton's cradle as one stacked system."""
    n = int(balls)
    system = gpx.World(gpx.scenes.cradle(n), TIME_STEP).system()
    before, after = np.eye(n)[0], np.full(n, 2.0 / n) - np.eye(n)[0]

    def error(p: Array, u: Array) -> float:
        gained = system.body_velocity_change(p).reshape(n, -1)[:, 0]
        return float(np.abs(before + gained - after).max()) / 1e-4

    return SystemQuestion(system, error)


def bouncing(bounces: float) -> SceneQuestion:
    """Return a ball of elasticity 2 that bounces so many times."""
    count = int(bounces)
    scene, material = gpx.Scene(), gpx.Material(0.0, 2.0)
    scene.add_static(gpx.HalfSpace(), material=material)
    scene.add_rigid(gpx.Sphere(0.5), 1.0, position=(0.0, 0.0, 0.5 + HEIGHT), material=material)
    fall = math.sqrt(2.0 * HEIGHT / GRAVITY)

    def error(course: Course) -> float:
        z = course.path[:, 0, 2] - 0.5
        apexes = z[1:-1][(z[1:-1] > z[:-2]) & (z[1:-1] >= z[2:])]
        if apexes.size < count:
            return math.inf
        return float(np.abs(apexes[:count] - HEIGHT).max()) / TRAVEL

    return SceneQuestion(scene, math.ceil((2 * count + 1) * fall / TIME_STEP) + 5 * count, error)


def small_base(side: float) -> SceneQuestion:
    """Return a cube of elasticity 2 that falls on a smaller fixed block, flat, at 1 m/s."""
    scene, material = gpx.Scene(), gpx.Material(0.0, 2.0)
    scene.add_static(gpx.Box(side, side, 1.0), position=(0.0, 0.0, -0.5), material=material)
    scene.add_rigid(gpx.Box(1, 1, 1), 1.0, position=(0.0, 0.0, 0.5), velocity=(0.0, 0.0, -1.0), material=material)

    def error(course: Course) -> float:
        velocity = course.motion.velocity[0]
        return worst(abs(velocity[2] - 1.0) / (4.0 * GRAVITY * TIME_STEP), float(np.abs(velocity[3:]).max()) / 1e-2)

    return SceneQuestion(scene, 2, error)


def overlapping(depth: float) -> SceneQuestion:
    """Return a cube that starts inside the ground."""
    scene, material = gpx.Scene(), gpx.Material(0.5)
    scene.add_static(gpx.HalfSpace(), material=material)
    scene.add_rigid(gpx.Box(1, 1, 1), 1.0, position=(0.0, 0.0, 0.5 - depth), material=material)
    return SceneQuestion(scene, 120, lambda course: (float(course.path[:, 0, 2].max()) - 0.5) / (0.1 * depth))


MODES: Mapping[str, Mode] = {
    "cradle": Mode(
        "F17", "cradle as one system", "balls", (2, 5, 10, 30, 100, 300), cradle,
        "the first ball leaves with -(n - 2)/n, the others with 2/n", "velocities within 1e-4 m/s", frictionless=True,
    ),
    "small-base": Mode(
        "F19", "elastic cube on a small block", "side of the block, m", (1, 0.5, 0.2, 0.1, 0.05, 0.01), small_base,
        "every corner rebounds at 1 m/s", "within what gravity adds in 4 steps, no turning", frictionless=True,
    ),
    "bouncing": Mode(
        "F20", "elastic ball", "bounces", (1, 2, 3, 5, 8), bouncing, "each apex is as high as the drop",
        "within one step's travel", frictionless=True,
    ),
    "overlap": Mode(
        "F21", "cube inside the ground", "depth, m", (1e-3, 3e-3, 1e-2, 3e-2, 0.1), overlapping,
        "it comes out and stays", "never a tenth of the depth above the ground",
    ),
}  # fmt: skip

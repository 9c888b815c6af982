"""What slides, or is about to: friction that acts in every direction, at any speed, and at the edge of its cone.

The truth is Coulomb's law for one body that does not turn: it slows down by μ g, along its path.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

import gpx_lcp as gpx
from benchmarks.interface import Array
from benchmarks.stability.modes import EXACT, GRAVITY, NO_DILATION, TIME_STEP, Course, Mode, SceneQuestion, worst

STEPS = 48
TIME = STEPS * TIME_STEP
# Of the velocity that friction took away; soft contacts take it up a step or two late.
SLOWED = 0.05
# How far a body that slides may rise, m.
RISE = 1e-3
# Of g t, at the edge of the cone; and of the velocity on the sliding side.
HELD, SLID = 1e-4, 0.1


def plate(friction: float, velocity: tuple[float, float, float]) -> gpx.Scene:
    """Return a plate of 1 × 1 × 0.05 m on the ground, thrown: too flat to tip over for friction up to 20."""
    scene, material = gpx.Scene(), gpx.Material(friction)
    scene.add_static(gpx.HalfSpace(), material=material)
    scene.add_rigid(gpx.Box(1, 1, 0.05), 1.0, position=(0, 0, 0.025), velocity=velocity, material=material)
    return scene


def _sliding(scene: gpx.Scene, slowed: float, allowed: float = SLOWED) -> SceneQuestion:
    """Return a scene whose one body is slower by `slowed`, m/s, at the end, or stands still."""
    start = np.array(scene.bodies[0].velocity)[:2]
    speed = float(np.linalg.norm(start))
    truth = start * max(0.0, 1.0 - slowed / speed)

    def error(course: Course) -> float:
        lost = min(slowed, speed) or GRAVITY * TIME
        off = float(np.linalg.norm(course.motion.velocity[0, :2] - truth)) / lost
        return worst(off / allowed, float((course.path[:, 0, 2] - course.path[0, 0, 2]).max()) / RISE)

    return SceneQuestion(scene, STEPS, error)


def glide(speed: float) -> SceneQuestion:
    """Return a plate thrown along the ground at a speed."""
    return _sliding(plate(0.5, (speed, 0.0, 0.0)), 0.5 * GRAVITY * TIME)


def landing(fall: float) -> SceneQuestion:
    """Return a plate that lands at a speed while it slides: its first step has the blow's friction, too."""
    return _sliding(plate(0.5, (30.0, 0.0, -fall)), 0.5 * (fall + GRAVITY * TIME))


def heading(degrees: float) -> SceneQuestion:
    """Return a plate thrown at an angle to its axes."""
    angle = math.radians(degrees)
    return _sliding(plate(0.5, (3.0 * math.cos(angle), 3.0 * math.sin(angle), 0.0)), 0.5 * GRAVITY * TIME)


def rough(friction: float) -> SceneQuestion:
    """Return a plate thrown along ground of some friction."""
    return _sliding(plate(friction, (25.0, 0.0, 0.0)), friction * GRAVITY * TIME)


def slope(share: float) -> SceneQuestion:
    """Return a cube on a slope whose tangent is 1 + share times the friction: it slides where share is positive."""
    angle = math.atan(0.5 * (1.0 + share))
    down: Array = np.array([math.cos(angle), 0.0, -math.sin(angle)])
    truth = max(0.0, GRAVITY * TIME * (math.sin(angle) - 0.5 * math.cos(angle)))

    def error(course: Course) -> float:
        off = float(np.linalg.norm(course.motion.velocity[0, :3] - truth * down))
        return off / (HELD * GRAVITY * TIME + SLID * truth)

    return SceneQuestion(gpx.scenes.incline(angle, 0.5), STEPS, error)


NEARER = (1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8)
SLOWS = "it slows down by μ g, straight on, flat on the ground"
RULE = "velocity lost within 5 %, never 1 mm off the ground"

MODES: Mapping[str, Mode] = {
    "glide": Mode(
        "F6", "fast along the ground", "speed, m/s", (0.01, 0.1, 1, 10, 100), glide, SLOWS, RULE, programs=NO_DILATION,
    ),
    "landing": Mode(
        "F7", "landing while sliding", "fall, m/s", (0.1, 0.5, 1, 2, 5, 10), landing,
        "it loses μ (fall + g t)", RULE, programs=NO_DILATION,
    ),
    "heading": Mode(
        "F8", "oblique to the axes", "angle, °", (0, 5, 15, 22.5, 30, 45), heading, SLOWS, RULE, programs=EXACT,
    ),
    "rough": Mode(
        "F9", "rougher ground", "friction", (0, 0.1, 0.5, 1, 2, 5, 10), rough, SLOWS, RULE, programs=NO_DILATION,
    ),
    "edge-held": Mode(
        "F10", "slope just held by friction", "share of friction left", NEARER, lambda share: slope(-share),
        "it stays", "slower than 1e-4 g t",
    ),
    "edge-sliding": Mode(
        "F10", "slope just too steep", "share of friction missing", NEARER, slope,
        "it slides with g (sin θ - μ cos θ)", "velocity within 10 % and 1e-4 g t", programs=NO_DILATION,
    ),
}  # fmt: skip

"""Motions known on paper: the scene of each, what is true of its end, and how far from it a course ends."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

import gpx_lcp as gpx
from benchmarks.interface import Array, Contacts, Motion

G: Final = 9.81


@dataclass(frozen=True)
class Course:
    """Where the bodies began, all heights of the first one, and the end."""

    start: Motion
    heights: Sequence[float]
    end: Motion
    contacts: Contacts
    time_step: float

    @property
    def way(self) -> Array:
        """How far the first body went, (3,), m."""
        way: Array = self.end.position[0] - self.start.position[0]
        return way


@dataclass(frozen=True)
class Case:
    """A motion: its scene, how long it takes, s, what is true of it, and the error of a course."""

    title: str
    truth: str
    make: Callable[[], gpx.Scene]
    seconds: float
    error: Callable[[Course], float]


def _turned(axis: tuple[float, float, float], angle: float) -> tuple[float, float, float, float]:
    x, y, z = (math.sin(0.5 * angle) * part for part in axis)
    return (math.cos(0.5 * angle), x, y, z)


def _on_ground(friction: float) -> tuple[gpx.Scene, gpx.Material]:
    scene, material = gpx.Scene(), gpx.Material(friction)
    scene.add_static(gpx.HalfSpace(), material=material)
    return scene, material


def _off(truth: Sequence[float], size: float) -> Callable[[Course], float]:
    """Return the error of the way of the first body, relative to a size."""
    return lambda course: float(np.linalg.norm(course.way - np.array(truth))) / size


def _flight() -> Case:
    def make() -> gpx.Scene:
        scene = gpx.Scene()
        scene.add_rigid(gpx.Sphere(0.5), 1.0, position=(0, 0, 100), velocity=(3, 1, 8))
        return scene

    return Case("Free flight", "a parabola", make, 1.0, _off((3.0, 1.0, 8.0 - 0.5 * G), 0.5 * G))


def _throw() -> Case:
    speed, friction, angle = 4.0, 0.5, math.radians(30.0)
    distance = speed**2 / (2.0 * friction * G)
    along = (math.cos(angle), math.sin(angle), 0.0)

    def make() -> gpx.Scene:
        scene, material = _on_ground(friction)
        velocity = (speed * along[0], speed * along[1], 0.0)
        scene.add_rigid(gpx.Box(1, 1, 0.2), 1.0, position=(0, 0, 0.1), velocity=velocity, material=material)
        return scene

    return Case(
        "Level throw at 30°",
        "stops after v²/(2 μ g), straight on",
        make,
        1.5,
        _off([distance * part for part in along], distance),
    )


def _slope(share: float) -> Case:
    """Return a cube on a slope askew to its sides, whose tangent is a share of the friction."""
    friction, azimuth = 0.5, math.radians(30.0)
    angle = math.atan(share * friction)
    acceleration = max(0.0, G * (math.sin(angle) - friction * math.cos(angle)))
    across = (math.cos(azimuth), math.sin(azimuth))
    down = np.array([math.cos(angle) * across[0], math.cos(angle) * across[1], -math.sin(angle)])

    def make() -> gpx.Scene:
        normal = (math.sin(angle) * across[0], math.sin(angle) * across[1], math.cos(angle))
        scene, material = gpx.Scene(), gpx.Material(friction)
        scene.add_static(gpx.HalfSpace(normal), material=material)
        x, y, z = (0.5 * part for part in normal)
        tilt = _turned((-across[1], across[0], 0.0), angle)
        scene.add_rigid(gpx.Box(1, 1, 1), 1.0, position=(x, y, z), orientation=tilt, material=material)
        return scene

    free = 0.5 * G * math.sin(angle)
    held = acceleration == 0.0
    title = "Askew slope that holds" if held else "Askew slope too steep"
    truth = "a cube stays" if held else "a cube slides with g (sin θ - μ cos θ)"
    return Case(title, truth, make, 1.0, _off(0.5 * acceleration * down, free if held else 0.5 * acceleration))


def _ball_down(grip: float) -> Case:
    angle = 0.5
    friction = grip * 2.0 / 7.0 * math.tan(angle)
    rolls = grip >= 1.0
    acceleration = 5.0 / 7.0 * G * math.sin(angle) if rolls else G * (math.sin(angle) - friction * math.cos(angle))

    def make() -> gpx.Scene:
        normal = (math.sin(angle), 0.0, math.cos(angle))
        scene, material = gpx.Scene(), gpx.Material(friction)
        scene.add_static(gpx.HalfSpace(normal), material=material)
        scene.add_rigid(gpx.Sphere(0.5), 1.0, position=tuple(0.5 * part for part in normal), material=material)
        return scene

    way = 0.5 * acceleration
    title = "Ball rolls down a slope" if rolls else "Ball slips down a slope"
    truth = "5/7 g sin θ" if rolls else "g (sin θ - μ cos θ)"
    return Case(title, truth, make, 1.0, _off((way * math.cos(angle), 0.0, -way * math.sin(angle)), way))


def _backspin() -> Case:
    speed, spin = 4.0, -40.0
    truth = (5.0 * speed + 2.0 * 0.5 * spin) / 7.0

    def error(course: Course) -> float:
        return abs(float(course.end.velocity[0, 0]) - truth) / abs(truth)

    return Case(
        "Ball with backspin",
        "comes back at (5 v + 2 r ω)/7",
        lambda: gpx.scenes.rolling_sphere(speed, spin),
        2.0,
        error,
    )


def _tall_box(friction: float) -> Case:
    topples = friction > 0.5

    def make() -> gpx.Scene:
        scene, material = _on_ground(friction)
        scene.add_rigid(gpx.Box(0.3, 0.3, 0.6), 1.0, position=(0, 0, 0.3), velocity=(5, 0, 0), material=material)
        return scene

    def upright(course: Course) -> float:
        _, x, y, _ = course.end.orientation[0]
        return abs(float(1.0 - 2.0 * (x * x + y * y)))

    distance = 25.0 / (2.0 * friction * G)
    if topples:
        return Case("Tall box, μ = 0.55", "goes over and lies", make, 2.0, upright)
    return Case("Tall box, μ = 0.45", "slides upright for v²/(2 μ g)", make, 2.0, _off((distance, 0.0, 0.0), distance))


def _ladder() -> Case:
    angle, length = math.radians(60.0), 2.0
    friction = 1.03 * 0.5 / math.tan(angle)

    def make() -> gpx.Scene:
        scene, material = _on_ground(friction)
        scene.add_static(gpx.HalfSpace((1, 0, 0)), material=gpx.Material(0.0), name="wall")
        tilt = angle - 0.5 * math.pi
        thickness = 0.01
        # Of the corner that is lowest and the one that is nearest to the wall, from the middle.
        x = 0.5 * (length * abs(math.sin(tilt)) + thickness * math.cos(tilt))
        z = 0.5 * (length * math.cos(tilt) + thickness * abs(math.sin(tilt)))
        scene.add_rigid(
            gpx.Box(thickness, 0.4, length),
            1.0,
            position=(x, 0.0, z),
            orientation=_turned((0.0, 1.0, 0.0), tilt),
            material=material,
        )
        return scene

    return Case("Ladder on a smooth wall", "stands: μ is 3 % above cot θ / 2", make, 1.0, _off((0, 0, 0), length))


def _bricks() -> Case:
    def error(course: Course) -> float:
        return float(np.linalg.norm(course.end.position - course.start.position, axis=1).max()) / 2.0

    title, truth = "Overhanging bricks", "four stand at 0.999 of Σ 1/(2k)"
    return Case(title, truth, lambda: gpx.scenes.bricks(4, 0.999), 1.0, error)


def _table() -> Case:
    def error(course: Course) -> float:
        found, load = course.contacts, np.zeros(4)
        for body, other, impulse in zip(found.body_a, found.body_b, found.impulse, strict=True):
            if min(body, other) < 0 <= max(body, other) < 4:
                load[max(body, other)] += abs(impulse[2]) / course.time_step
        return float(np.abs(load / (3.5 * G) - 1.0).max())

    return Case("Table on four legs", "each carries a quarter", lambda: gpx.scenes.table(4), 0.5, error)


def _turntable() -> Case:
    """Return a block on a heavy square table that turns on smooth ground; the table is the first body."""
    radius, friction = 0.5, 0.5
    spin = math.sqrt(0.9 * friction * G / radius)

    def make() -> gpx.Scene:
        scene, material = gpx.Scene(), gpx.Material(friction)
        scene.add_static(gpx.HalfSpace(), material=gpx.Material(0.0))
        table = {"position": (0, 0, 0.1), "angular_velocity": (0, 0, spin)}
        scene.add_rigid(gpx.Box(4, 4, 0.2), 1e5, material=material, **table)
        block = {"position": (radius, 0, 0.21), "velocity": (0, spin * radius, 0), "angular_velocity": (0, 0, spin)}
        scene.add_rigid(gpx.Box(0.1, 0.1, 0.02), 0.1, material=material, **block)
        return scene

    def error(course: Course) -> float:
        return abs(float(np.linalg.norm(course.end.position[1, :2])) / radius - 1.0)

    return Case("Block on a turntable", "goes round with it: ω² r is 0.9 μ g", make, 1.0, error)


def _bounce() -> Case:
    drop, restitution = 1.0, 0.8

    def make() -> gpx.Scene:
        scene, material = gpx.Scene(), gpx.Material(0.0, 1.0 + restitution)
        scene.add_static(gpx.HalfSpace(), material=material)
        scene.add_rigid(gpx.Sphere(0.5), 1.0, position=(0, 0, 0.5 + drop), material=material)
        return scene

    def error(course: Course) -> float:
        heights = np.array(course.heights)
        low = int(heights.argmin())
        return abs(float(heights[low:].max()) - 0.5 - restitution**2 * drop) / drop

    fall = math.sqrt(2.0 * drop / G)
    return Case("Bouncing ball", "comes back to e² h", make, fall * (1.0 + 1.5 * restitution), error)


CASES: Mapping[str, Case] = {
    "flight": _flight(),
    "throw": _throw(),
    "slope-holds": _slope(0.98),
    "slope-slides": _slope(1.2),
    "ball-rolls": _ball_down(1.05),
    "ball-slips": _ball_down(0.7),
    "backspin": _backspin(),
    "tall-box-slides": _tall_box(0.45),
    "tall-box-topples": _tall_box(0.55),
    "ladder": _ladder(),
    "turntable": _turntable(),
    "bricks": _bricks(),
    "table": _table(),
    "bounce": _bounce(),
}

"""The scene library: small scenes with answers known on paper, used by tests, benchmarks and examples alike.

Unless said otherwise cubes have sides of 1 m and 1 kg, gravity is 9.81 m/s² along -z, friction 0.5, elasticity 1, and
the ground is the half-space below z = 0. Bodies that rest on each other touch exactly; every scene is deterministic.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from gpx_lcp.errors import ProblemError
from gpx_lcp.materials import Material
from gpx_lcp.scene import Scene
from gpx_lcp.shapes import Box, HalfSpace, Sphere

__all__ = [
    "column",
    "cradle",
    "heavy_on_light",
    "incline",
    "pyramid",
    "rolling_sphere",
    "sphere_pile",
    "table",
    "tower",
    "wall",
]

# Between bricks of one row, as a share of their length: wide enough that neighbours never count as touching.
BRICK_GAP: Final = 0.01
# Between cubes of one row of a pyramid.
PYRAMID_PITCH: Final = 1.1


def _count(name: str, value: int, least: int = 1) -> int:
    if isinstance(value, bool) or not isinstance(value, int | np.integer) or value < least:
        raise ProblemError(f"{name} is {value!r}: it must be a whole number of at least {least}")
    return int(value)


def _on_ground(friction: float = 0.5, elasticity: float = 1.0) -> tuple[Scene, Material]:
    scene = Scene()
    material = Material(friction, elasticity)
    scene.add_static(HalfSpace(), material=material, name="ground")
    return scene, material


def tower(n: int, size: float = 1.0, mass: float = 1.0, friction: float = 0.5) -> Scene:
    """Return `n` cubes on top of each other: the load on interface k from below is (n - k) m g, four contacts each."""
    scene, material = _on_ground(friction)
    for k in range(_count("n", n)):
        scene.add_rigid(Box(size, size, size), mass, position=(0.0, 0.0, (k + 0.5) * size), material=material)
    return scene


def wall(rows: int, friction: float = 0.5) -> Scene:
    """Return a brick wall along x: `rows` bricks of 2 × 1 × 1 m in the lowest row, one less in each row above.

    Bricks weigh 1 kg. Each rests on two, except in the lowest row; bricks of one row stand 2 cm apart, so that they do
    not touch. Contacts: 4 rows + 8 rows (rows - 1)/2.
    """
    scene, material = _on_ground(friction)
    pitch = 2.0 * (1.0 + BRICK_GAP)
    for row in range(_count("rows", rows)):
        bricks = rows - row
        for k in range(bricks):
            x = (k - 0.5 * (bricks - 1)) * pitch
            scene.add_rigid(Box(2, 1, 1), 1.0, position=(x, 0.0, row + 0.5), material=material)
    return scene


def pyramid(base: int, friction: float = 0.5) -> Scene:
    """Return a pyramid of cubes in one plane: `base` in the lowest row, one less in each above, 1.1 m apart.

    It has base (base + 1)/2 cubes: pyramid(100) is the well-known one of 5 050.
    """
    scene, material = _on_ground(friction)
    for row in range(_count("base", base)):
        cubes = base - row
        for k in range(cubes):
            x = (k - 0.5 * (cubes - 1)) * PYRAMID_PITCH
            scene.add_rigid(Box(1, 1, 1), 1.0, position=(x, 0.0, row + 0.5), material=material)
    return scene


def heavy_on_light(n: int, ratio: float, friction: float = 0.5) -> Scene:
    """Return a tower of `n` cubes whose top one weighs `ratio` kg, the others 1 kg."""
    scene, material = _on_ground(friction)
    for k in range(_count("n", n)):
        mass = ratio if k == n - 1 else 1.0
        scene.add_rigid(Box(1, 1, 1), mass, position=(0.0, 0.0, k + 0.5), material=material)
    return scene


def table(legs: int, friction: float = 0.5) -> Scene:
    """Return a plate of 10 kg (2 × 2 × 0.1 m) on 4 to 9 loose legs of 1 kg (0.2 × 0.2 × 1 m).

    Legs stand at the corners, then at the middles of the sides, then at the centre. With more than three the load of
    each is indeterminate; the impulses of least norm are symmetric. The legs come first, the plate is the last body.
    """
    if _count("legs", legs, 4) > 9:
        raise ProblemError(f"legs is {legs}: it must be at most 9")
    places = [(-1, -1), (1, -1), (1, 1), (-1, 1), (0, -1), (1, 0), (0, 1), (-1, 0), (0, 0)]
    scene, material = _on_ground(friction)
    for k, (x, y) in enumerate(places[:legs]):
        leg = Box(0.2, 0.2, 1.0)
        scene.add_rigid(leg, 1.0, position=(0.9 * x, 0.9 * y, 0.5), material=material, name=f"leg {k}")
    scene.add_rigid(Box(2.0, 2.0, 0.1), 10.0, position=(0.0, 0.0, 1.05), material=material, name="plate")
    return scene


def incline(angle: float, friction: float) -> Scene:
    """Return a cube at rest on a slope of `angle` rad that falls towards +x.

    It stays where tan(angle) < friction, and else slides down with g (sin(angle) - friction cos(angle)).
    """
    if not (math.isfinite(angle) and 0.0 <= angle < 0.5 * math.pi):
        raise ProblemError(f"angle is {angle!r}: it must be at least 0 and below π/2 rad")
    scene = Scene()
    material = Material(friction)
    normal = np.array([math.sin(angle), 0.0, math.cos(angle)])
    scene.add_static(HalfSpace(tuple(normal)), material=material, name="slope")
    orientation = (math.cos(0.5 * angle), 0.0, math.sin(0.5 * angle), 0.0)
    scene.add_rigid(Box(1, 1, 1), 1.0, position=0.5 * normal, orientation=orientation, material=material)
    return scene


def cradle(n: int, elasticity: float = 2.0) -> Scene:
    """Return Newton's cradle without strings: `n` balls of 1 kg that touch in a row, no gravity, the first at 1 m/s.

    As one stacked system with elasticity 2 the first ball leaves with -(n - 2)/n and every other with 2/n, where nature
    gives 1 to the last alone.
    """
    scene = Scene(gravity=(0.0, 0.0, 0.0))
    material = Material(friction=0.0, elasticity=elasticity)
    for k in range(_count("n", n, 2)):
        speed = 1.0 if k == 0 else 0.0
        scene.add_rigid(Sphere(0.5), 1.0, position=(float(k), 0.0, 0.0), velocity=(speed, 0.0, 0.0), material=material)
    return scene


def rolling_sphere(speed: float = 4.0, spin: float = 0.0, friction: float = 0.5) -> Scene:
    """Return a ball of 1 kg and radius 0.5 m that starts along +x with `speed`, turning with `spin` rad/s about +y.

    It slides until it rolls, with (5 speed + 2 r spin)/7.
    """
    scene, material = _on_ground(friction)
    scene.add_rigid(
        Sphere(0.5),
        1.0,
        position=(0.0, 0.0, 0.5),
        velocity=(speed, 0.0, 0.0),
        angular_velocity=(0.0, spin, 0.0),
        material=material,
    )
    return scene


def sphere_pile(n: int, seed: int = 0, friction: float = 0.5) -> Scene:
    """Return `n` balls of radius 0.5 m and 1 kg about to fall into a square pit with open top.

    They start in layers, 1.1 m apart, each moved by up to 4 cm along every axis by the generator with this seed.
    """
    n = _count("n", n)
    side = math.ceil(n ** (1 / 3) - 1e-9)
    pitch = 1.1
    scene, material = _on_ground(friction)
    half = 0.5 * side * pitch
    for normal in ((1.0, 0.0, 0.0), (-1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, -1.0, 0.0)):
        position = -half * np.array(normal)
        scene.add_static(HalfSpace(normal), position=position, material=material, name="side of the pit")
    shifts = np.random.default_rng(_count("seed", seed, 0)).uniform(-0.04, 0.04, (n, 3))
    for k in range(n):
        cell = np.array([k % side, k // side % side, k // side**2])
        corner = np.array([0.5 * pitch - half, 0.5 * pitch - half, 0.55])
        scene.add_rigid(Sphere(0.5), 1.0, position=corner + pitch * cell + shifts[k], material=material)
    return scene


def column(n: int) -> Scene:
    """Return `n` point masses of 1 kg above each other, 1 m apart, without friction: contact along one axis.

    A is the tridiagonal matrix of a chain with 1, 2, 2, ... on its diagonal and -1 beside it, 1/kg, on which sweeps of
    projected Gauss-Seidel contract the error by exactly cos²(π/2n). The load on contact k from below is (n - k) m g.
    """
    scene, material = _on_ground(friction=0.0)
    for k in range(_count("n", n)):
        scene.add_point_mass(1.0, position=(0.0, 0.0, k + 0.5), shape=Sphere(0.5), material=material)
    return scene

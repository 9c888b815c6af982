"""The scene library: small scenes with answers known on paper, used by tests, benchmarks and examples alike.

Unless said otherwise cubes have sides of 1 m and 1 kg, gravity is 9.81 m/s² along -z, friction 0.5, elasticity 1, and
the ground is the half-space below z = 0. Bodies that rest on each other touch exactly; every scene is deterministic.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import Final

import numpy as np
import numpy.typing as npt

from formulations.checks import Array
from gpx_lcp.errors import ProblemError
from gpx_lcp.materials import Material
from gpx_lcp.scene import GRAVITY, Scene
from gpx_lcp.shapes import Box, ConvexHull, Cylinder, HalfSpace, Sphere

__all__ = [
    "arch",
    "break_shot",
    "bricks",
    "card_house",
    "column",
    "cradle",
    "cylinders",
    "heavy_on_light",
    "incline",
    "pyramid",
    "rocking_block",
    "rolling_sphere",
    "sphere_pile",
    "superball",
    "swinging_gravity",
    "table",
    "tower",
    "wall",
    "wedge",
]

# Between bricks of one row, as a share of their length: wide enough that neighbours never count as touching.
BRICK_GAP: Final = 0.01
# Between cubes of one row of a pyramid.
PYRAMID_PITCH: Final = 1.1
# Inner and outer radius of the arch, m: thickness 2/9 of the mean radius, twice what a semicircle needs.
ARCH_RADII: Final = (4.0, 5.0)
# Of a house of cards: the slope of a leaning card to the vertical, height of a storey, thickness of a card, distance of
# neighbouring pairs, and the slit between two roof cards, m.
CARD_LEAN: Final = math.radians(15.0)
CARD_HEIGHT: Final = 1.0
CARD_THICKNESS: Final = 0.02
CARD_PITCH: Final = 0.8
CARD_SLIT: Final = 0.002


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


def cradle(n: int, elasticity: float = 2.0, masses: Sequence[float] | None = None) -> Scene:
    """Return Newton's cradle without strings: `n` balls that touch in a row, no gravity, the first at 1 m/s.

    They weigh 1 kg, or what `masses` says. As one stacked system (impact law "newton") with elasticity 2 and equal
    masses the first ball leaves with -(n - 2)/n and every other with 2/n, where nature, and the law "sequential", give
    1 to the last alone.
    """
    scene = Scene(gravity=(0.0, 0.0, 0.0))
    material = Material(friction=0.0, elasticity=elasticity)
    if masses is not None and len(masses) != _count("n", n, 2):
        raise ProblemError(f"masses has {len(masses)} entries, but n is {n}")
    for k in range(_count("n", n, 2)):
        speed, mass = 1.0 if k == 0 else 0.0, 1.0 if masses is None else masses[k]
        scene.add_rigid(Sphere(0.5), mass, position=(float(k), 0.0, 0.0), velocity=(speed, 0.0, 0.0), material=material)
    return scene


def break_shot(elasticity: float = 2.0) -> Scene:
    """Return three equal balls without friction: the first, at 1 m/s along +x, meets two that touch each other.

    It strikes both at once, at 30° to its path, and all three touch. With elasticity 2 energy and symmetry leave one
    answer: -1/5 for the first, (3/5, ±√3/5) for the others.
    """
    scene = Scene(gravity=(0.0, 0.0, 0.0))
    material = Material(friction=0.0, elasticity=elasticity)
    for x, y, speed in ((-0.5 * math.sqrt(3.0), 0.0, 1.0), (0.0, 0.5, 0.0), (0.0, -0.5, 0.0)):
        scene.add_rigid(Sphere(0.5), 1.0, position=(x, y, 0.0), velocity=(speed, 0.0, 0.0), material=material)
    return scene


def superball(spin: float = 10.0, elasticity: float = 2.0, tangential_elasticity: float = 2.0) -> Scene:
    """Return a ball of 1 kg and radius 0.5 m that touches the ground at 2 m/s downwards, with `spin` rad/s about +y.

    Friction 2. With tangential elasticity 2 the contact point reverses its velocity: the ball leaves with 4/7 r spin
    along +x and turns with -3/7 spin; with 1 it leaves rolling, with 2/7 r spin and 2/7 spin.
    """
    scene = Scene()
    material = Material(2.0, elasticity, tangential_elasticity=tangential_elasticity)
    scene.add_static(HalfSpace(), material=material, name="ground")
    scene.add_rigid(
        Sphere(0.5),
        1.0,
        position=(0.0, 0.0, 0.5),
        velocity=(0.0, 0.0, -2.0),
        angular_velocity=(0.0, spin, 0.0),
        material=material,
    )
    return scene


def rocking_block(elasticity: float = 1.0, friction: float = 1.0) -> Scene:
    """Return a block of 1 × 1 × 3 m and 1 kg that stands on the ground and turns about its left edge, at 1 rad/s.

    It has rocked back: its right edge strikes, its left edge rests. Plastic, without sliding, it goes on about the
    right edge with 1 - 3/2 sin²α of its spin, tan α = 1/3: 0.85.

    Source: G. W. Housner, *The behavior of inverted pendulum structures during earthquakes*, Bull. Seismol. Soc. Am. 53
    (1963).
    """
    scene, material = _on_ground(friction, elasticity)
    scene.add_rigid(
        Box(1, 1, 3),
        1.0,
        position=(0.0, 0.0, 1.5),
        velocity=(1.5, 0.0, -0.5),
        angular_velocity=(0.0, 1.0, 0.0),
        material=material,
    )
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


def swinging_gravity(time: float, share: float = 0.5, frequency: float = 5.0) -> Array:
    """Return gravity that swings about 9.81 m/s² along -z by a `share` of it, with `frequency` Hz.

    Set before each step, `world.gravity = swinging_gravity(world.time)`, it makes the loads of a stack change while the
    stack stands still: each is that of the gravity of its step, so that no solver can live off the step before.
    """
    return np.array(GRAVITY) * (1.0 + share * math.sin(2.0 * math.pi * frequency * time))


def column(n: int) -> Scene:
    """Return `n` point masses of 1 kg above each other, 1 m apart, without friction: contact along one axis.

    A is the tridiagonal matrix of a chain with 1, 2, 2, ... on its diagonal and -1 beside it, 1/kg, on which sweeps of
    projected Gauss-Seidel contract the error by exactly cos²(π/2n). The load on contact k from below is (n - k) m g.
    """
    scene, material = _on_ground(friction=0.0)
    for k in range(_count("n", n)):
        scene.add_point_mass(1.0, position=(0.0, 0.0, k + 0.5), shape=Sphere(0.5), material=material)
    return scene


def wedge(angle: float, friction: float = 0.5, speed: float = 0.0) -> Scene:
    """Return a block of 1 kg that fits between two fixed walls, each at `angle` rad to the vertical, open upwards.

    The groove runs along y; the block is 1 m long and high, 1 m wide at half its height, and starts with `speed` along
    the groove. Four contacts to a wall.

    With angle 0 the walls are parallel and nothing presses the block against them, so that Coulomb's law leaves open
    what happens: every fall between that with g and none at all is an exact solution, with normal impulses to match.
    With a positive angle and no friction each wall carries m g / (2 sin(angle)). A block that slides along the groove
    is slowed by friction g / sin(angle). Pulled upwards, it leaves freely if friction < tan(angle); else it may as
    well stay, held by stress of its own making.

    Source: D. Horak, J. Trinkle, *On the similarities and differences among contact models in robot simulation*, IEEE
    Robot. Autom. Lett. 4 (2019), the wedging example, for the parallel walls.
    """
    if not (math.isfinite(angle) and 0.0 <= angle < 0.25 * math.pi):
        raise ProblemError(f"angle is {angle!r}: it must be at least 0 and below π/4 rad")
    scene = Scene()
    material = Material(friction)
    for side in (-1.0, 1.0):
        normal = (-side * math.cos(angle), 0.0, math.sin(angle))
        scene.add_static(HalfSpace(normal), position=(0.5 * side, 0.0, 0.0), material=material, name="wall")
    half = {z: 0.5 + z * math.tan(angle) for z in (-0.5, 0.5)}
    block = _prism([(x, z) for z in half for x in (-half[z], half[z])], 1.0)
    scene.add_rigid(block, 1.0, position=block.centroid, velocity=(0.0, speed, 0.0), material=material)
    return scene


def arch(stones: int = 25, friction: float = 0.8) -> Scene:
    """Return a semicircular arch of equal stones of 1 kg, from left to right, between two fixed springers at z = 0.

    Radii 4 and 5 m, depth 1 m. The load on each springer is half the weight; the thrust in the arch is indeterminate.
    It can stand where a line of thrust fits inside it, at angles to the joints' normals below that of friction: that
    takes a thickness of 0.1075 of the mean radius, here 0.2222, and for 25 stones a friction of 0.3077, which is the
    least for which the linear program of plane equilibrium has a solution.

    Source: J. Heyman, *The safety of masonry arches*, Int. J. Mech. Sci. 11 (1969), after Milankovitch (1907).
    """
    scene = Scene()
    material = Material(friction)
    inner, outer = ARCH_RADII
    for side in (-1.0, 1.0):
        position = (0.5 * side * (inner + outer), 0.0, -0.5)
        scene.add_static(Box(2.0 * (outer - inner), 2.0, 1.0), position=position, material=material, name="springer")
    angles = np.linspace(math.pi, 0.0, _count("stones", stones, 3) + 1)
    # sin(π) is not quite zero, and the stones are to stand on their springers.
    joints = [np.array([math.cos(a), abs(math.sin(a)) if 0.0 < a < math.pi else 0.0]) for a in angles]
    for left, right in itertools.pairwise(joints):
        stone = _prism([radius * joint for joint in (left, right) for radius in ARCH_RADII], 1.0)
        scene.add_rigid(stone, 1.0, position=stone.centroid, material=material)
    return scene


def card_house(levels: int = 4, friction: float = 0.5) -> Scene:
    """Return a house of cards: `levels` pairs of leaning cards in the lowest storey, one less in each above, and roofs.

    Cards weigh 1 kg; leaning ones stand 1 m high at 15° to the vertical, 2 cm thick and 0.7 m wide. Their ends are cut
    so that they stand, lean on each other and carry the next roof with faces, not edges. A roof card of 2 cm bridges
    two neighbouring pairs and carries the pair above it: levels (levels + 1) leaning cards and levels (levels - 1)/2
    roofs. The ground carries the whole weight.

    A leaning card under weight w and load q at its top pushes outwards with about (w/2 + q) tan 15° = 0.268 (w/2 + q),
    and its foot carries w + q. By the linear program of plane equilibrium four levels can stand from a friction of
    0.2256 on, one level from 0.1223.
    """
    scene, material = _on_ground(friction)
    run, foot = CARD_HEIGHT * math.tan(CARD_LEAN), CARD_THICKNESS / math.cos(CARD_LEAN)
    # The left card of a pair whose middle is x = 0, anticlockwise from the outer end of its foot.
    reach = run + 0.5 * foot
    corners = [(-reach, 0.0), (foot - reach, 0.0), (0.0, CARD_HEIGHT - 0.5 * foot / math.tan(CARD_LEAN))]
    corners += [(0.0, CARD_HEIGHT), (-0.5 * foot, CARD_HEIGHT)]
    roof = Box(CARD_PITCH - CARD_SLIT, 0.7, CARD_THICKNESS)
    floor = 0.0
    for level in range(_count("levels", levels)):
        pairs = levels - level
        middles = [(k - 0.5 * (pairs - 1)) * CARD_PITCH for k in range(pairs)]
        for middle in middles:
            for side in (1.0, -1.0):
                card = _prism([(side * x, z) for x, z in corners], 0.7)
                position = card.centroid + np.array([middle, 0.0, floor])
                scene.add_rigid(card, 1.0, position=position, material=material)
        floor += CARD_HEIGHT
        for left, right in itertools.pairwise(middles):
            position = (0.5 * (left + right), 0.0, floor + 0.5 * CARD_THICKNESS)
            scene.add_rigid(roof, 1.0, position=position, material=material, name=f"roof of level {level}")
        floor += CARD_THICKNESS
    return scene


def cylinders(between: float = 0.3, ground: float = 0.1) -> Scene:
    """Return three equal cylinders of 1 kg along y, two side by side on the ground and the third on top of them.

    Radius 0.5 m, length 2 m; friction `between` the cylinders and with the `ground`. They stand if and only if
    between >= tan 15° = 0.2679 and ground >= tan 15° / 3 = 0.0893. For moments about its axis the friction on a lower
    cylinder is the same, s, above and below; with the load n from the top one, 30° off the vertical, its balance along
    x is n sin 30° = s (1 + cos 30°). On the top one 2 (n cos 30° + s sin 30°) = m g, so that n = m g / 2, and the
    ground carries 3/2 m g under each. Stress between the lower two would only ask for more friction.

    Below the threshold of the ground velocities have no single answer: the three may yaw as they slide out, or not.
    """
    scene = Scene()
    material = Material(between)
    rule = "minimum" if ground <= between else "maximum"
    scene.add_static(HalfSpace(), material=Material(ground, friction_rule=rule), name="ground")
    turned = (math.cos(0.25 * math.pi), math.sin(0.25 * math.pi), 0.0, 0.0)
    for x, z in ((-0.5, 0.5), (0.5, 0.5), (0.0, 0.5 + 0.5 * math.sqrt(3.0))):
        scene.add_rigid(Cylinder(0.5, 2.0), 1.0, position=(x, 0.0, z), orientation=turned, material=material)
    return scene


def bricks(n: int, share: float = 0.999, friction: float = 0.5) -> Scene:
    """Return `n` bricks of 2 × 1 × 1 m and 1 kg that lean out over the edge x = 0 of a table, the lowest first.

    The k-th from the top reaches share/k m beyond what carries it. At share 1 the centre of mass of any k topmost
    bricks is right above an edge and the top one overhangs by the harmonic sum Σ 1/k m, in bricks' lengths Σ 1/(2k):
    1.0417 for four. Below it stands, above it topples; a single brick with the angular acceleration m g d / (I + m r²),
    where d = share - 1 is how far the centre is beyond the edge, r² = d² + 1/4 and I = 5/12 m.
    """
    scene = Scene()
    material = Material(friction)
    scene.add_static(Box(6, 2, 1), position=(-3.0, 0.0, -0.5), material=material, name="table")
    end = 0.0
    for level in range(_count("n", n)):
        end += share / (n - level)
        scene.add_rigid(Box(2, 1, 1), 1.0, position=(end - 1.0, 0.0, level + 0.5), material=material)
    return scene


def _prism(corners: Sequence[npt.ArrayLike], depth: float) -> ConvexHull:
    """Return the convex body with these corners in the x-z plane and `depth` along y, centred there."""
    flat = np.asarray(corners, dtype=np.float64)
    return ConvexHull([(x, y, z) for y in (-0.5 * depth, 0.5 * depth) for x, z in flat])

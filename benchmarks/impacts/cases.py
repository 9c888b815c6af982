"""The cases of the suite: what happens, what is known about it, and what a law makes of it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

import gpx_lcp as gpx
from benchmarks.attempts import Figure
from benchmarks.impacts.collisions import DoublePendulum, random_bodies, random_linkage
from benchmarks.interface import Array

SIZES = range(2, 8)
# Random collisions of each kind.
COLLISIONS = 500
# What counts as energy gained, as a share of the kinetic energy before, and as momentum lost.
GAIN, MOMENTUM = 1e-9, 1e-12
TIME_STEP, GRAVITY = 1 / 240, 9.81


@dataclass(frozen=True)
class Finding:
    """What a law made of a case.

    Parameters
    ----------
    shown : str
        For the table.
    right : bool
        Whether it is what the case's `known` says.
    figures : mapping
        The numbers behind it.
    unsolved : int
        Collisions, or steps, whose programs were not all solved.
    impact : Impact or None
        Where the case is one collision.
    """

    shown: str
    right: bool
    figures: Mapping[str, Figure] = field(default_factory=dict)
    unsolved: int = 0
    impact: gpx.Impact | None = None


@dataclass(frozen=True)
class Case:
    """One line of the table."""

    title: str
    known: str
    run: Callable[[str], Finding]


def _numbers(values: Sequence[float] | Array, digits: int = 3) -> str:
    return "(" + ", ".join(f"{round(float(v), digits) + 0.0:.{digits}g}" for v in values) + ")"


def cradle(law: str) -> Finding:
    """Equal balls, elasticity 2, n = 2 to 7."""
    found = {n: gpx.impact(gpx.scenes.cradle(n), law) for n in SIZES}
    speeds = {n: impact.velocities[:, 0] for n, impact in found.items()}
    worst = max(float(np.abs(v - np.eye(n)[-1]).max()) for n, v in speeds.items())
    energy = max(abs(impact.energy_change) / 0.5 for impact in found.values())
    shown = f"{_numbers(speeds[3])}, {_numbers(speeds[5], 2)}"
    figures = {"off_by": worst, "energy_error": energy}
    return Finding(shown, worst < 1e-9, figures, _unsolved(found.values()), found[5])


def unequal_cradle(law: str) -> Finding:
    """Masses 1, 2, ..., n kg, elasticity 2, n = 2 to 7: the energy, and the velocities of three."""
    found = {n: gpx.impact(gpx.scenes.cradle(n, masses=np.arange(1.0, n + 1.0)), law) for n in SIZES}
    energy = max(abs(impact.energy_change) / 0.5 for impact in found.values())
    # 1 kg strikes 2 kg, which strikes 3 kg: two meetings of two bodies each, after which nothing closes.
    off = float(np.abs(found[3].velocities[:, 0] - [-1 / 3, -2 / 15, 8 / 15]).max())
    shown = f"{_numbers(found[3].velocities[:, 0])}, energy kept to {energy:.0e}"
    return Finding(shown, off < 1e-9, {"off_by": off, "energy_error": energy}, _unsolved(found.values()), found[3])


def break_shot(law: str) -> Finding:
    """One ball into two that touch."""
    impact = gpx.impact(gpx.scenes.break_shot(), law)
    v = impact.velocities
    side = np.sqrt(3.0) / 5.0
    off = float(np.abs(v[:, :2] - [[-0.2, 0.0], [0.6, side], [0.6, -side]]).max())
    uneven = float(np.abs(v[1, :2] - v[2, :2] * [1.0, -1.0]).max())
    figures = {"off_by": off, "asymmetry": uneven}
    shown = f"{v[0, 0]:.3f}; {_numbers(v[1, :2])}, ({v[2, 0]:.3g}, {v[2, 1]:.3g})"
    return Finding(shown, off < 1e-9, figures, _unsolved([impact]), impact)


def bouncing_ball(law: str) -> Finding:
    """Elasticity 2, dropped from 0.2 m: the apexes of ten bounces."""
    height = 0.2
    scene = gpx.Scene()
    material = gpx.Material(0.0, 2.0)
    scene.add_static(gpx.HalfSpace(), material=material)
    scene.add_rigid(gpx.Sphere(0.5), 1.0, position=(0.0, 0.0, 0.5 + height), material=material)
    world = gpx.World(scene, TIME_STEP, impact_law=law)
    apexes: list[float] = []
    above, rising = height, False
    while len(apexes) < 10:
        world.step()
        now = float(world.positions[0, 2]) - 0.5
        if rising and now <= above:
            apexes.append(above)
        above, rising = now, now > above
    travel = np.sqrt(2.0 * GRAVITY * height) * TIME_STEP
    low, high = ((extreme - height) / travel for extreme in (min(apexes), max(apexes)))
    shown = f"{1e3 * (min(apexes) - height):+.0e} to {1e3 * (max(apexes) - height):+.0e} mm"
    right = max(abs(low), abs(high)) <= 1.0
    return Finding(shown, right, {"lowest_in_steps": low, "highest_in_steps": high}, world.unsolved_steps)


def superball(law: str) -> Finding:
    """Both elasticities 2, spin 10 rad/s."""
    impact = gpx.impact(gpx.scenes.superball(10.0), law)
    v = impact.velocities[0]
    off = float(np.abs(v - [20 / 7, 0.0, 2.0, 0.0, -30 / 7, 0.0]).max())
    shown = f"{v[0]:.3f} m/s, {v[4]:.3f} rad/s"
    return Finding(shown, off < 1e-8, {"off_by": off}, _unsolved([impact]), impact)


def rocking_block(law: str) -> Finding:
    """Plastic as Housner has it, and with elasticity 1.5."""
    plastic, elastic = (gpx.impact(gpx.scenes.rocking_block(e), law) for e in (1.0, 1.5))
    spin = float(plastic.velocities[0, 4])
    shown = f"{spin:.3f}; at 1.5: {elastic.velocities[0, 4]:.3f}"
    figures = {"off_by": abs(spin - 0.85), "spin_at_1.5": float(elastic.velocities[0, 4])}
    return Finding(shown, abs(spin - 0.85) < 1e-8, figures, _unsolved([plastic, elastic]), elastic)


def double_pendulum(law: str) -> Finding:
    """Kane's: elasticity 1.5, friction 0.5."""
    pendulum = DoublePendulum.striking()
    impact = gpx.impact(pendulum.system, law, elasticity=1.5)
    assert impact.velocities is not None and pendulum.system.free_velocity is not None
    before = pendulum.energy(pendulum.system.free_velocity)
    change = pendulum.energy(impact.velocities) / before - 1.0
    shown = f"{100.0 * change:+.1f} %"
    return Finding(shown, change <= 0.0, {"energy_change_share": change}, _unsolved([impact]), impact)


def stack(law: str) -> Finding:
    """Ten cubes of elasticity 1.8, both ways, for half a second."""
    scene = gpx.Scene()
    material = gpx.Material(0.5, 1.8, tangential_elasticity=1.8)
    scene.add_static(gpx.HalfSpace(), material=material)
    for k in range(10):
        scene.add_rigid(gpx.Box(1, 1, 1), 1.0, position=(0.0, 0.0, k + 0.5), material=material)
    world = gpx.World(scene, TIME_STEP, impact_law=law)
    fastest = 0.0
    for _ in range(120):
        world.step()
        fastest = max(fastest, float(np.abs(world.velocities).max()))
    return Finding(f"{fastest:.0e} m/s", fastest < 1e-7, {"speed": fastest}, world.unsolved_steps)


def random_collisions(law: str) -> Finding:
    """Free bodies in space, all contacts at once, with friction and both elasticities."""
    gains, momentum, unsolved = [], 0.0, 0
    for seed in range(COLLISIONS):
        bodies = random_bodies(seed)
        before = bodies.system.free_velocity
        impact = bodies.impact(law)
        gains.append((bodies.energy(impact.velocities) - bodies.energy(before)) / bodies.energy(before))
        momentum = max(momentum, bodies.momenta(impact.velocities).changed_from(bodies.momenta(before)))
        unsolved += _unsolved([impact])
    number = sum(gain > GAIN for gain in gains)
    shown = f"{number} gain, at most {100.0 * max(gains):.2g} %; momentum {momentum:.0e}"
    figures = {"gains": number, "largest_gain": max(gains), "momentum_error": momentum}
    return Finding(shown, max(gains) <= 0.0 and momentum <= MOMENTUM, figures, unsolved)


def random_linkages(law: str) -> Finding:
    """Few coordinates and several rough contacts, as linkages have."""
    gains, unsolved, impossible = [], 0, 0
    for seed in range(COLLISIONS):
        system, elasticity, tangential = random_linkage(seed)
        impact = gpx.impact(system, law, elasticity=elasticity, tangential_elasticity=tangential)
        if impact.status is gpx.Status.INFEASIBLE:
            impossible += 1
            continue
        gains.append(impact.energy_change / (0.5 * float(system.free_velocity @ system.free_velocity)))
        unsolved += _unsolved([impact])
    number = sum(gain > GAIN for gain in gains)
    shown = f"{number} gain, at most {100.0 * max(gains):.2g} %"
    if impossible:
        shown += f"; {impossible} have no solution"
    figures = {"gains": number, "largest_gain": max(gains), "impossible": impossible}
    return Finding(shown, max(gains) <= 0.0 and not impossible, figures, unsolved)


def moving_observer(law: str) -> Finding:
    """Three balls of different elasticity in a row, the default rule, and all of it with (3, -2, 1) m/s added."""
    outcomes = []
    for added in ((0.0, 0.0, 0.0), (3.0, -2.0, 1.0)):
        scene = gpx.Scene(gravity=(0.0, 0.0, 0.0))
        for k, (mass, elasticity) in enumerate(((1.0, 2.0), (3.0, 1.2), (0.5, 1.6))):
            material = gpx.Material(0.3, elasticity, tangential_elasticity=1.5)
            velocity = np.array([1.0 - k, 0.2 * k, 0.0]) + added
            scene.add_rigid(gpx.Sphere(0.5), mass, position=(k, 0.0, 0.0), velocity=velocity, material=material)
        impact = gpx.impact(scene, law, tolerance=1e-13)
        outcomes.append(impact.velocities - np.array([*added, 0.0, 0.0, 0.0]))
    off = float(np.abs(outcomes[0] - outcomes[1]).max())
    return Finding(f"{off:.0e} m/s", off <= 1e-12, {"off_by": off})


def _unsolved(impacts: Iterable[gpx.Impact]) -> int:
    return sum(impact.status is not gpx.Status.SOLVED for impact in impacts)


CASES: Mapping[str, Case] = {
    "cradle": Case("Cradle of n equal balls, n = 2 ... 7 (3 and 5 shown)", "(0, ..., 0, 1)", cradle),
    "cradle-unequal": Case(
        "Cradle of 1, 2, ..., n kg, n = 2 ... 7 (3 shown)", "(-1/3, -2/15, 8/15), energy kept", unequal_cradle
    ),
    "break-shot": Case("Break shot, three balls", "-0.2; (0.6, ±0.346)", break_shot),
    "bouncing-ball": Case(
        "Bouncing ball, ten apexes against the start", "within ±8.25 mm, a step's travel", bouncing_ball
    ),
    "superball": Case("Superball, tangential elasticity 2", "2.857 m/s, -4.286 rad/s: spin reversed", superball),
    "rocking-block": Case("Rocking block, spin after 1 rad/s", "0.85 where plastic (Housner)", rocking_block),
    "double-pendulum": Case("Kane's double pendulum, energy", "no gain", double_pendulum),
    "stack": Case("Stack of ten, elasticity 1.8, at rest", "stands", stack),
    "random": Case(f"{COLLISIONS} random frictional collisions", "no gain, momentum kept to 1e-12", random_collisions),
    "linkages": Case(f"{COLLISIONS} random collisions of linkages", "an outcome, and no gain", random_linkages),
    "observer": Case("A common velocity added", "nothing changes: 1e-12", moving_observer),
}

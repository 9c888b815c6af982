"""Contacts that rest stay: no creep, no sinking, no gain of energy, without sleeping; overlap goes without a jump."""

import numpy as np
import pytest

import gpx_lcp as gpx

G = 9.81
DT = 1 / 240


def height_energy(world):
    """Return the energy of gravity, J; that of motion is asserted to be none."""
    masses = np.array([body.mass for body in world.bodies])
    return G * masses @ world.positions[:, 2]


def stand(scene, time_step, seconds, samples=6):
    """Step a scene that is at rest, and assert that it stays, at each of some samples of the time."""
    world = gpx.World(scene, time_step)
    start, before = world.positions, height_energy(world)
    for _ in range(samples):
        world.step(round(seconds / time_step / samples))
        assert np.abs(world.positions - start).max() < 1e-6
        assert np.abs(world.velocities).max() < 1e-7
        assert height_energy(world) - before < 1e-9 * before
        upward = np.maximum(0.0, -world.contacts.gap)
        assert upward.max() < 1e-7
    assert world.unsolved_steps == 0
    return world


@pytest.mark.parametrize("time_step", [1 / 60, 1 / 240, 1 / 1000])
@pytest.mark.parametrize(
    "scene", [gpx.scenes.tower(30), gpx.scenes.wall(5), gpx.scenes.heavy_on_light(5, 100), gpx.scenes.table(5)], ids=str
)
def test_stacks_stand(scene, time_step):
    stand(scene, time_step, seconds=600 * time_step)


def test_a_tower_of_a_hundred_stands():
    world = stand(gpx.scenes.tower(100), DT, seconds=1.0)
    loads = world.contacts.force[:, 2].reshape(100, 4).sum(axis=1)
    assert loads == pytest.approx(G * np.arange(100, 0, -1), rel=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("scene", [gpx.scenes.tower(30), gpx.scenes.wall(10), gpx.scenes.tower(100)], ids=str)
def test_stacks_stand_for_a_minute(scene):
    stand(scene, DT, seconds=60.0)


def test_a_block_on_a_slope_does_not_creep_for_a_minute():
    world = gpx.World(gpx.scenes.incline(np.arctan(0.49), 0.5), DT)
    start = world.positions
    world.step(60 * 240)
    assert np.abs(world.positions - start).max() < 1e-7


def overlapping(depth, time_step=DT):
    scene = gpx.Scene()
    scene.add_static(gpx.HalfSpace())
    scene.add_rigid(gpx.Box(1, 1, 1), 1.0, position=(0, 0, 0.5 - depth))
    return gpx.World(scene, time_step, tolerance=1e-12)


@pytest.mark.parametrize("time_step", [1 / 60, 1 / 240, 1 / 1000])
def test_a_box_put_into_the_ground_comes_up_without_speed(time_step):
    """A velocity term that takes out a fifth of the overlap per step throws it up with 0.2 d/dt, 0.48 m/s at 240 Hz.

    The way up is the least that can be: at the end it overlaps by the slop, never having been above the ground, and
    what it gained is its weight lifted so far. Afterwards nothing changes any more.
    """
    depth, share = 0.01, 0.2
    world = overlapping(depth, time_step)
    system = world.system()
    with_term = system.B.copy()
    with_term[::3] += share * depth / time_step
    thrown = gpx.StackedSystem(system.A, with_term, system.friction)
    popped = system.velocity(gpx.solve(thrown, solver="newton", tolerance=1e-10).impulse)[:, 0]
    assert popped == pytest.approx([share * depth / time_step] * 4, rel=1e-6)

    for _ in range(120):
        world.step()
        assert np.abs(world.velocities).max() < 1e-8
        assert world.positions[0, 2] < 0.5
    lifted = world.positions[0, 2] - (0.5 - depth)
    assert depth - 1e-4 < lifted < depth
    settled = height_energy(world)
    world.step(round(10 / time_step))
    assert height_energy(world) == pytest.approx(settled, rel=1e-9)
    assert np.abs(world.velocities).max() < 1e-8


def test_a_stack_put_into_itself_comes_apart_and_then_stands():
    """Ten cubes, each 1 cm into the one below: it rises, without speed, to ten cubes' height less the slops."""
    scene = gpx.Scene()
    scene.add_static(gpx.HalfSpace())
    for k in range(10):
        scene.add_rigid(gpx.Box(1, 1, 1), 1.0, position=(0, 0, 0.49 + 0.99 * k))
    world = gpx.World(scene, DT)
    for _ in range(20):
        world.step(24)
        assert np.abs(world.velocities).max() < 1e-6
    top = world.positions[-1, 2]
    assert 9.5 - 10 * 1e-4 < top < 9.5
    settled = height_energy(world)
    world.step(2400)
    assert height_energy(world) == pytest.approx(settled, rel=1e-7)
    assert np.abs(world.positions[:, :2]).max() < 1e-6


def test_the_two_ways_of_stepping_keep_a_stack_in_the_same_place():
    world = gpx.World(gpx.scenes.tower(3), DT, solver="lemke", formulation="normal")
    start = world.positions
    world.step(240)
    assert np.abs(world.positions - start).max() < 1e-9


def test_ten_thousand_bodies_step():
    """Layers of cubes with a ball on each: the loads on the ground are the whole weight."""
    scene = gpx.Scene()
    scene.add_static(gpx.HalfSpace())
    for k in range(5000):
        x, y = 1.5 * (k % 100), 1.5 * (k // 100)
        scene.add_rigid(gpx.Box(1, 1, 1), 1.0, position=(x, y, 0.5))
        scene.add_rigid(gpx.Sphere(0.5), 1.0, position=(x, y, 1.5))
    world = gpx.World(scene, DT)
    world.step(2)
    assert world.unsolved_steps == 0
    contacts = world.contacts
    assert len(contacts.gap) == 5 * 5000
    assert contacts.force[contacts.body_a == -1, 2].sum() == pytest.approx(10_000 * G, rel=1e-6)
    assert len(world.snapshot()) < 20e6
    loaded = gpx.World.load(world.snapshot())
    loaded.step()
    world.step()
    assert loaded.positions.tobytes() == world.positions.tobytes()

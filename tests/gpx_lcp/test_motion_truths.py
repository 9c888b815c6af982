"""Distances, thresholds and energies known on paper, and how they follow the length of a step."""

import numpy as np
import pytest

import gpx_lcp as gpx

G = 9.81
DT = 1 / 240


def rotation(quaternion):
    w, x, y, z = quaternion
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def turned(axis, angle):
    return (np.cos(angle / 2), *(np.sin(angle / 2) * np.asarray(axis, dtype=float) / np.linalg.norm(axis)))


def energy(world):
    """Return the energy of gravity and motion, J."""
    total = 0.0
    for body, z, q, v in zip(world.bodies, world.positions[:, 2], world.orientations, world.velocities, strict=True):
        spin = rotation(q).T @ v[3:]
        total += body.mass * (G * z + 0.5 * v[:3] @ v[:3]) + 0.5 * spin @ body.inertia @ spin
    return total


@pytest.mark.parametrize("time_step", [1 / 60, 1 / 240, 1 / 1000])
def test_a_thrown_body_keeps_to_its_parabola(time_step):
    scene = gpx.Scene()
    scene.add_rigid(gpx.Box(1, 1, 1), 1.0, velocity=(3, 1, 8), angular_velocity=(0, 0, 2))
    world = gpx.World(scene, time_step)
    world.step(round(1 / time_step))
    assert world.positions[0] == pytest.approx([3, 1, 8 - G / 2], rel=1e-12)


@pytest.mark.parametrize("time_step", [1 / 60, 1 / 240, 1 / 1000])
@pytest.mark.parametrize("height", [0.2, 1.0])
@pytest.mark.parametrize("degrees", [0, 30, 45, 77])
def test_a_level_throw_stops_where_friction_stops_it(time_step, height, degrees):
    """At v²/(2 μ g), straight ahead, whatever the angle to the block's sides."""
    speed, friction = 4.0, 0.5
    along = np.array([np.cos(np.radians(degrees)), np.sin(np.radians(degrees)), 0.0])
    scene = gpx.Scene()
    scene.add_static(gpx.HalfSpace())
    scene.add_rigid(gpx.Box(1, 1, height), 1.0, position=(0, 0, height / 2), velocity=speed * along)
    world = gpx.World(scene, time_step)
    world.step(round(1.5 / time_step))
    distance = speed**2 / (2 * friction * G)
    assert np.abs(world.velocities).max() < 1e-7
    assert world.positions[0] - [0, 0, height / 2] == pytest.approx(distance * along, abs=1e-4 * distance)
    assert world.positions[0] @ np.cross([0, 0, 1], along) == pytest.approx(0, abs=1e-8)


def diagonal_slope(angle, friction, azimuth):
    """Return a cube on a slope that falls askew to its sides, and the way down."""
    normal = np.array([np.sin(angle) * np.cos(azimuth), np.sin(angle) * np.sin(azimuth), np.cos(angle)])
    tilt = turned((-np.sin(azimuth), np.cos(azimuth), 0.0), angle)
    material = gpx.Material(friction)
    scene = gpx.Scene()
    scene.add_static(gpx.HalfSpace(normal), material=material)
    scene.add_rigid(gpx.Box(1, 1, 1), 1.0, position=0.5 * normal, orientation=tilt, material=material)
    return scene, np.array([np.cos(angle) * np.cos(azimuth), np.cos(angle) * np.sin(azimuth), -np.sin(angle)])


@pytest.mark.parametrize("azimuth", np.radians([15, 30, 45, 200]))
@pytest.mark.parametrize("friction", [0.3, 0.5, 0.8])
@pytest.mark.parametrize("share", [0.98, 1.02])
def test_cubes_on_diagonal_slopes_stick_below_the_friction_angle_and_slide_above(share, friction, azimuth):
    angle = np.arctan(share * friction)
    scene, downhill = diagonal_slope(angle, friction, azimuth)
    world = gpx.World(scene, DT, tolerance=1e-11)
    start = world.positions
    world.step(240)
    acceleration = max(0.0, G * (np.sin(angle) - friction * np.cos(angle)))
    assert world.velocities[0, :3] == pytest.approx(acceleration * downhill, abs=1e-8)
    assert (world.positions - start)[0] == pytest.approx(acceleration / 2 * downhill, abs=1e-8)
    assert world.velocities[0, 3:] == pytest.approx(np.zeros(3), abs=1e-8)


@pytest.mark.parametrize(("shape", "share", "needed"), [("ball", 5 / 7, 2 / 7), ("cylinder", 2 / 3, 1 / 3)])
@pytest.mark.parametrize("grip", [1.05, 0.7])
def test_round_bodies_roll_down_a_slope_if_friction_is_enough(shape, share, needed, grip):
    """With 5/7 or 2/3 of g sin θ without slip if μ is at least 2/7 or 1/3 of tan θ; else with g (sin θ - μ cos θ)."""
    angle = 0.5
    friction = grip * needed * np.tan(angle)
    normal = np.array([np.sin(angle), 0, np.cos(angle)])
    material = gpx.Material(friction)
    scene = gpx.Scene()
    scene.add_static(gpx.HalfSpace(normal), material=material)
    body = gpx.Sphere(0.5) if shape == "ball" else gpx.Cylinder(0.5, 1.0)
    scene.add_rigid(body, 1.0, position=0.5 * normal, orientation=turned((1, 0, 0), np.pi / 2), material=material)
    world = gpx.World(scene, DT, tolerance=1e-11)
    world.step(240)
    rolls = grip >= 1.0
    acceleration = share * G * np.sin(angle) if rolls else G * (np.sin(angle) - friction * np.cos(angle))
    downhill = np.array([np.cos(angle), 0, -np.sin(angle)])
    assert world.velocities[0, :3] == pytest.approx(acceleration * downhill, rel=1e-6, abs=1e-6)
    assert world.positions[0] - 0.5 * normal == pytest.approx(acceleration / 2 * downhill, rel=1e-4, abs=1e-6)
    slip = acceleration - 0.5 * world.velocities[0, 4]
    assert (abs(slip) < 1e-6) == rolls


@pytest.mark.parametrize("friction", [0.45, 0.55])
def test_a_tall_box_thrown_upright_slides_or_topples(friction):
    """0.3 m wide and 0.6 m high: up to μ = 1/2 it stays upright and stops at v²/(2 μ g), above it goes over."""
    scene = gpx.Scene()
    material = gpx.Material(friction)
    scene.add_static(gpx.HalfSpace(), material=material)
    scene.add_rigid(gpx.Box(0.3, 0.3, 0.6), 1.0, position=(0, 0, 0.3), velocity=(5, 0, 0), material=material)
    world = gpx.World(scene, DT)
    world.step(480)
    upright = rotation(world.orientations[0])[2, 2]
    if friction < 0.5:
        assert upright == pytest.approx(1.0, abs=1e-12)
        assert world.positions[0, 0] == pytest.approx(25 / (2 * friction * G), rel=1e-4)
    else:
        assert abs(upright) < 0.1


@pytest.mark.parametrize("share", [0.97, 1.03])
@pytest.mark.parametrize("degrees", [45, 60, 70])
def test_a_ladder_on_a_smooth_wall_slips_if_the_ground_is_too_smooth(degrees, share):
    """It needs μ = cot θ / 2; the ladder is thin, so that where its edges touch moves that by less than one in 100."""
    angle = np.radians(degrees)
    scene = gpx.Scene()
    scene.add_static(gpx.HalfSpace(), material=gpx.Material(share * 0.5 / np.tan(angle)), name="ground")
    scene.add_static(gpx.HalfSpace((1, 0, 0)), material=gpx.Material(0.0), name="wall")
    size = np.array([0.01, 0.4, 2.0])
    tilt = turned((0, 1, 0), angle - np.pi / 2)
    corners = (np.indices((2, 2, 2)).reshape(3, -1).T - 0.5) * size @ rotation(tilt).T
    low = corners.min(axis=0)
    rule = gpx.Material(share * 0.5 / np.tan(angle))
    scene.add_rigid(gpx.Box(*size), 1.0, position=(-low[0], 0, -low[2]), orientation=tilt, material=rule)
    world = gpx.World(scene, DT)
    world.step(120)
    if share > 1:
        assert np.abs(world.velocities).max() < 1e-7
    else:
        assert world.velocities[0, 0] > 0.01 and world.velocities[0, 2] < -0.01


@pytest.mark.parametrize("share", [0.9, 1.1])
def test_a_turntable_keeps_what_friction_can_hold(share):
    """A block at r = 0.5 m goes round as long as ω² r <= μ g; the table is heavy and turns on smooth ground."""
    radius, friction = 0.5, 0.5
    spin = np.sqrt(share * friction * G / radius)
    scene = gpx.Scene()
    scene.add_static(gpx.HalfSpace(), material=gpx.Material(0.0), name="ground")
    rough = gpx.Material(friction)
    scene.add_rigid(gpx.Cylinder(2.0, 0.2), 1e6, position=(0, 0, 0.1), angular_velocity=(0, 0, spin), material=rough)
    block = scene.add_rigid(
        gpx.Box(0.1, 0.1, 0.02),
        0.1,
        position=(radius, 0, 0.21),
        velocity=(0, spin * radius, 0),
        angular_velocity=(0, 0, spin),
        material=rough,
    )
    world = gpx.World(scene, 1 / 1000)
    world.step(1000)
    away = np.linalg.norm(world.positions[block][:2]) / radius
    if share < 1:
        assert away == pytest.approx(1.0, abs=0.01)
    else:
        assert away > 1.2


def tumbling(seed, time_step):
    """Return balls and bricks that fall on each other, turning."""
    rng = np.random.default_rng(seed)
    scene = gpx.Scene()
    scene.add_static(gpx.HalfSpace())
    for k in range(8):
        orientation = rng.normal(size=4)
        scene.add_rigid(
            gpx.Box(0.5, 0.6, 0.8) if k % 2 else gpx.Sphere(0.3),
            1.0,
            position=(*(0.3 * rng.normal(size=2)), 1 + 0.9 * k),
            orientation=orientation / np.linalg.norm(orientation),
            velocity=rng.normal(size=3),
            angular_velocity=3 * rng.normal(size=3),
        )
    return gpx.World(scene, time_step)


@pytest.mark.parametrize("time_step", [1 / 60, 1 / 240])
@pytest.mark.parametrize("seed", range(4))
def test_things_that_fall_on_each_other_never_gain_energy(seed, time_step):
    """All that the steps ever add, over two seconds of falling, striking, sliding and rolling, is a share of 1e-5."""
    world = tumbling(seed, time_step)
    energies = [energy(world)]
    for _ in range(round(2 / time_step)):
        world.step()
        energies.append(energy(world))
    gains = np.diff(energies)
    assert gains[gains > 0].sum() < 1e-5 * energies[0]
    assert energies[-1] < 0.5 * energies[0]
    assert world.unsolved_steps == 0


def test_an_elastic_ball_bounces_to_the_same_height_for_a_minute():
    material = gpx.Material(0.0, 2.0)
    scene = gpx.Scene()
    scene.add_static(gpx.HalfSpace(), material=material)
    scene.add_rigid(gpx.Sphere(0.5), 1.0, position=(0, 0, 1.5), material=material)
    world = gpx.World(scene, DT, tolerance=1e-12)
    start = energy(world)
    for _ in range(60):
        world.step(240)
        assert energy(world) == pytest.approx(start, rel=1e-9)


def test_a_spring_that_the_user_works_out_keeps_its_energy():
    """Forces that follow the positions step by step: 60 s of a spring with ω = 10/s and no gain in amplitude."""
    scene = gpx.Scene(gravity=(0, 0, 0))
    scene.add_point_mass(1.0, position=(1, 0, 0))
    world = gpx.World(scene, DT)
    reach = []
    for _ in range(60 * 240):
        world.forces[0, 0] = -100 * world.positions[0, 0]
        world.step()
        reach.append(abs(world.positions[0, 0]))
    assert max(reach[-240:]) == pytest.approx(max(reach[:240]), rel=1e-3)


@pytest.mark.parametrize("legs", [4, 8, 9])
def test_the_smallest_impulses_share_a_table_evenly(legs):
    """By symmetry: what the law leaves open, `minimum_norm` settles with the same load on every leg."""
    world = gpx.World(gpx.scenes.table(legs), DT, tolerance=1e-10)
    system = world.system()
    world.step()
    contacts = world.contacts
    smallest = gpx.minimum_norm(system, world.solution.impulse)
    on_plate = contacts.body_b == legs
    for impulse in (contacts.impulse, smallest):
        assert impulse[on_plate, 0].sum() / DT == pytest.approx(10 * G, rel=1e-8)
    loads = [smallest[on_plate & (contacts.body_a == leg), 0].sum() / DT for leg in range(legs)]
    assert loads == pytest.approx([10 * G / legs] * legs, rel=1e-6)
    assert np.linalg.norm(smallest) <= np.linalg.norm(contacts.impulse) * (1 + 1e-12)
    assert gpx.certify(system, smallest).natural_map < 1e-8

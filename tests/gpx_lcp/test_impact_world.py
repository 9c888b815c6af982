"""Impact laws in worlds: rebounds over time, stacks that stand, and who takes which path."""

import numpy as np
import pytest

import gpx_lcp as gpx

LAWS = tuple(gpx.LAWS)
DT = 1 / 240
G = 9.81


def bouncing_ball(elasticity, friction=0.0, height=1.0, **motion):
    scene = gpx.Scene()
    material = gpx.Material(friction, elasticity)
    scene.add_static(gpx.HalfSpace(), material=material)
    scene.add_rigid(gpx.Sphere(0.5), 1.0, position=(0, 0, 0.5 + height), material=material, **motion)
    return scene


def apexes(world, bounces):
    """Heights above the ground at which the ball turns downwards, between bounces."""
    heights, rising = [], False
    while len(heights) < bounces:
        before = world.positions[0, 2] - 0.5
        world.step()
        if rising and world.positions[0, 2] - 0.5 <= before:
            heights.append(before)
        rising = world.positions[0, 2] - 0.5 > before
    return np.array(heights)


@pytest.mark.parametrize("law", LAWS)
def test_an_elastic_ball_reaches_its_height_for_ten_bounces(law):
    height, time_step = 0.2, 1 / 120
    world = gpx.World(bouncing_ball(2.0, height=height), time_step, impact_law=law)
    travel = np.sqrt(2 * G * height) * time_step
    assert np.abs(apexes(world, 10) - height).max() <= travel


@pytest.mark.parametrize("law", LAWS)
def test_a_rebound_leaves_with_its_share_of_the_speed_whatever_gravity_does_meanwhile(law):
    world = gpx.World(bouncing_ball(1.5, friction=0.4, velocity=(1, 0, 0)), DT, impact_law=law)
    while world.velocities[0, 2] <= 0.0:
        before = world.velocities[0]
        world.step()
    assert world.velocities[0, 2] == pytest.approx(-0.5 * before[2], rel=1e-8)
    assert world.solution.method.startswith(f"{law} impact, ")
    world.step()
    assert "impact" not in world.solution.method


@pytest.mark.parametrize("law", LAWS)
def test_a_superball_in_a_world_turns_round(law):
    world = gpx.World(gpx.scenes.superball(), DT, impact_law=law)
    world.step()
    assert world.velocities[0] == pytest.approx([20 / 7, 0, 2, 0, -30 / 7, 0], abs=1e-7)


@pytest.mark.parametrize("law", LAWS)
def test_a_stack_of_ten_elastic_cubes_stands(law):
    scene = gpx.Scene()
    material = gpx.Material(0.5, 1.8, tangential_elasticity=1.8)
    scene.add_static(gpx.HalfSpace(), material=material)
    for k in range(10):
        scene.add_rigid(gpx.Box(1, 1, 1), 1.0, position=(0, 0, k + 0.5), material=material)
    world = gpx.World(scene, DT, impact_law=law)
    start = world.positions
    for _ in range(10):
        world.step(12)
        assert "impact" not in world.solution.method
    assert np.abs(world.velocities).max() < 1e-7
    assert np.abs(world.positions - start).max() < 1e-7


@pytest.mark.parametrize("law", LAWS)
def test_a_tower_that_is_dropped_comes_to_rest(law):
    scene = gpx.Scene()
    material = gpx.Material(0.5, 1.5)
    scene.add_static(gpx.HalfSpace(), material=material)
    for k in range(3):
        scene.add_rigid(gpx.Box(1, 1, 1), 1.0, position=(0, 0, k + 0.6), material=material)
    world = gpx.World(scene, DT, impact_law=law)
    energy = [float((world.positions[:, 2] * G + 0.5 * (world.velocities**2)[:, :3].sum(axis=1)).sum())]
    for _ in range(24):
        world.step(15)
        v = world.velocities
        energy.append(
            float((world.positions[:, 2] * G).sum() + 0.5 * (v[:, :3] ** 2).sum() + (v[:, 3:] ** 2).sum() / 12)
        )
    assert np.abs(world.velocities).max() < 1e-3
    assert max(energy) <= energy[0] + 1e-9
    assert world.positions[:, 2] == pytest.approx([0.5, 1.5, 2.5], abs=2e-3)
    assert world.unsolved_steps == 0


def test_a_cradle_with_gaps_smaller_than_a_steps_travel_passes_the_impulse_on():
    scene = gpx.Scene(gravity=(0, 0, 0))
    material = gpx.Material(0.0, 2.0)
    for k in range(4):
        position, velocity = (k + 1e-4 * k, 0, 0), (float(k == 0), 0, 0)
        scene.add_rigid(gpx.Sphere(0.5), 1.0, position=position, velocity=velocity, material=material)
    world = gpx.World(scene, DT, impact_law="sequential")
    world.step(5)
    assert world.velocities[:, 0] == pytest.approx([0, 0, 0, 1], abs=1e-9)


def test_contacts_hold_the_impulses_of_both_stages_and_the_solution_those_that_were_left():
    world = gpx.World(bouncing_ball(2.0), DT, impact_law="poisson")
    while "impact" not in (world.solution.extras if world.solution else ()):
        before = world.velocities[0, 2]
        world.step()
    impact = world.solution.extras["impact"]
    assert isinstance(impact, gpx.Impact) and impact.law == "poisson"
    assert impact.impulse[0, 0] == pytest.approx(-2 * before, rel=1e-9)
    assert world.solution.impulse[0, 0] == pytest.approx(G * DT, rel=1e-6)
    assert world.contacts.impulse[0, 0] == pytest.approx(-2 * before + G * DT, rel=1e-9)


def test_friction_that_the_formulation_leaves_out_is_left_out_of_impacts_too():
    for law in LAWS:
        world = gpx.World(gpx.scenes.superball(), DT, formulation="normal", impact_law=law)
        world.step()
        assert world.velocities[0] == pytest.approx([0, 0, 2, 0, 10, 0], abs=1e-9)


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("solver", ["newton", "lemke", "pgs"])
def test_every_law_steps_with_every_solver(law, solver):
    world = gpx.World(gpx.scenes.superball(), DT, solver=solver, impact_law=law, tolerance=1e-6)
    world.step(3)
    assert world.velocities[0, 2] == pytest.approx(2.0 - 2 * G * DT, abs=1e-3)


def test_the_impact_speed_follows_gravity_unless_it_is_given():
    world = gpx.World(bouncing_ball(2.0), DT)
    assert world.impact_speed == pytest.approx(2 * G * DT)
    world.gravity = (0, 0, -1)
    assert world.impact_speed == pytest.approx(2 * DT)
    for law in LAWS:
        world = gpx.World(bouncing_ball(2.0), DT, impact_law=law, impact_speed=10.0)
        world.step(150)
        assert world.impact_speed == 10.0
        assert np.abs(world.velocities).max() < 1e-9


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (dict(impact_law="hertz"), "impact_law is 'hertz': it must be one of 'newton'"),
        (dict(impact_speed=-1.0), "impact_speed is -1.0"),
        (dict(impact_speed="fast"), "impact_speed is 'fast'"),
        (dict(impact_speed=np.nan), "impact_speed is nan"),
    ],
)
def test_a_wrong_law_is_refused(change, message):
    with pytest.raises(gpx.SettingsError, match=message):
        gpx.World(gpx.Scene(), DT, **change)


def test_tangential_elasticity_outside_its_range_is_refused():
    for value in (0.5, 2.5, np.nan):
        with pytest.raises(gpx.ProblemError, match=f"tangential_elasticity.* is {value}"):
            gpx.Material(tangential_elasticity=value)

"""What a user changes between two steps: bodies that come, go and are moved, forces, gravity, the time step."""

import numpy as np
import pytest

import gpx_lcp as gpx

G = 9.81
DT = 1 / 240
STAGED = dict(solver="lemke", formulation="normal")
SOLVERS = [dict(solver="newton"), dict(solver="pgs"), STAGED]


def solver_name(settings):
    return settings["solver"]


def cube(height, name=None, **more):
    return gpx.Scene().add_rigid(gpx.Box(1, 1, 1), 1.0, position=(0, 0, height), name=name, **more)


def loads(world):
    """Return the load on each interface of a tower, N."""
    return world.contacts.force[:, 2].reshape(-1, 4).sum(axis=1)


@pytest.mark.parametrize("settings", SOLVERS, ids=solver_name)
def test_a_cube_put_on_a_tower_adds_its_weight_to_every_load(settings):
    world = gpx.World(gpx.scenes.tower(3), DT, **settings)
    world.step(5)
    top = world.add(cube(3.5, "top"))
    assert top.index == 3 and world.bodies[3] is top
    world.step(5)
    assert loads(world) == pytest.approx([4 * G, 3 * G, 2 * G, G], rel=1e-6)
    assert world.positions[top] == pytest.approx([0, 0, 3.5], abs=1e-6)
    assert world.positions.shape == (4, 3) and world.forces.shape == (4, 6)


@pytest.mark.parametrize("settings", SOLVERS, ids=solver_name)
def test_the_rest_of_a_tower_falls_by_itself_when_a_cube_is_removed(settings):
    world = gpx.World(gpx.scenes.tower(4), DT, **settings)
    world.step(5)
    world.remove(1)
    assert [body.index for body in world.bodies] == [0, 1, 2]
    assert world.contacts.body_a.tolist() == [-1] * 4 + [1] * 4
    assert world.contacts.body_b.tolist() == [0] * 4 + [2] * 4
    world.step(12)
    assert world.positions[0, 2] == pytest.approx(0.5, abs=1e-6)
    assert world.velocities[1:, 2] == pytest.approx([-G * 12 * DT] * 2, rel=1e-6)
    world.step(240)
    assert world.positions[:, 2] == pytest.approx([0.5, 1.5, 2.5], abs=1e-3)
    assert loads(world) == pytest.approx([3 * G, 2 * G, G], rel=1e-5)


@pytest.mark.parametrize("solver", ["newton", "pgs"])
def test_what_still_touches_starts_warm_after_other_bodies_came_and_went(solver):
    """What came and went touched nothing: the tower's step costs what it costs in a world that nobody changed."""
    scene = gpx.scenes.tower(6)
    scene.add_static(gpx.Box(1, 1, 0.1), position=(5, 0, 1), name="shelf")
    passer_by = scene.add_rigid(gpx.Sphere(0.1), 1.0, position=(9, 0, 9), name="passer-by")
    unchanged, world = (gpx.World(scene, DT, solver=solver, tolerance=1e-6) for _ in range(2))
    unchanged.step(41)
    world.step(40)
    world.remove(passer_by)
    world.remove("shelf")
    world.add(gpx.Scene().add_static(gpx.Box(1, 1, 0.1), position=(-5, 0, 1), name="other shelf"))
    world.add(cube(40))
    impulse = world.contacts.impulse
    world.step()
    assert world.solution.iterations <= unchanged.solution.iterations + 1
    assert world.contacts.impulse == pytest.approx(impulse, abs=1e-6)


def test_fixed_bodies_come_and_go():
    world = gpx.World(gpx.scenes.tower(1), DT)
    world.step(3)
    ground = world.fixed[0]
    world.remove(ground)
    assert world.fixed == () and len(world.contacts.gap) == 0
    world.step(24)
    assert world.velocities[0, 2] == pytest.approx(-G * 0.1)
    floor = world.add(gpx.Scene().add_static(gpx.HalfSpace(), position=(0, 0, -1), name="floor"))
    assert floor.index == -1 and world.fixed == (floor,)
    world.step(240)
    assert world.positions[0] == pytest.approx([0, 0, -0.5], abs=1e-6)


def test_the_last_body_may_leave_and_the_first_may_come():
    world = gpx.World(gpx.Scene(), DT)
    ball = world.add(gpx.Scene().add_rigid(gpx.Sphere(0.5), 2.0, velocity=(1, 0, 0), force=(0, 0, 2 * G)))
    world.step(24)
    assert world.velocities[ball] == pytest.approx([1, 0, 0, 0, 0, 0], abs=1e-12)
    world.remove(ball)
    world.step()
    assert world.positions.shape == (0, 3)


def test_friction_and_rotation_may_arrive_with_a_body():
    """A world without either has one row per contact and three velocities per body, until they come."""
    world = gpx.World(gpx.scenes.column(2), DT)
    world.step(2)
    assert world.solution.impulse.shape[1] == 1
    block = gpx.Scene().add_rigid(gpx.Box(1, 1, 1), 1.0, position=(3, 0, 0.5), velocity=(1, 0, 0))
    world.add(block)
    world.remove("ground")
    world.add(gpx.Scene().add_static(gpx.HalfSpace(), position=(0, 0, 0), material=gpx.Material(0.5), name="rough"))
    world.step(1)
    assert world.solution.impulse.shape[1] == 3
    assert world.velocities[2, 0] == pytest.approx(1 - 0.5 * G * DT)
    world.remove("rough")
    world.remove(2)
    world.add(gpx.scenes.column(1).fixed[0])
    world.step(1)
    assert world.solution.impulse.shape[1] == 1
    assert world.positions[:, 2] == pytest.approx([0.5, 1.5], abs=1e-9)


def test_bodies_are_moved_between_steps():
    world = gpx.World(gpx.scenes.tower(2), DT)
    world.step(2)
    half = np.sqrt(0.5)
    world.move(1, position=(3, 0, 2), orientation=(half, 0, 0, half), velocity=(0, 1, 0))
    assert world.positions.tolist()[1] == [3, 0, 2]
    assert world.velocities[1] == pytest.approx([0, 1, 0, 0, 0, 0], abs=1e-8)
    assert world.orientations[1] == pytest.approx([half, 0, 0, half])
    world.move("body 0", angular_velocity=(0, 0, 2))
    assert world.velocities[0].tolist()[3:] == [0, 0, 2]
    world.step()
    assert len(world.contacts.gap) == 4
    assert world.velocities[1] == pytest.approx([0, 1, -G * DT, 0, 0, 0], abs=1e-8)
    world.positions = world.positions + np.array([10, 0, 0])
    world.velocities = np.zeros((2, 6))
    world.orientations = [[1, 0, 0, 0]] * 2
    assert world.positions[:, 0] == pytest.approx([10, 13], abs=1e-6)
    world.step()
    assert world.velocities[0] == pytest.approx(np.zeros(6), abs=1e-8)


def test_a_body_put_back_on_its_stack_rests_there_again():
    world = gpx.World(gpx.scenes.tower(3), DT)
    world.step(3)
    world.move(2, position=(0, 0, 2.6))
    world.step(2)
    world.move(2, position=(0, 0, 2.5), velocity=(0, 0, 0), orientation=(1, 0, 0, 0), angular_velocity=(0, 0, 0))
    world.step()
    assert loads(world) == pytest.approx([3 * G, 2 * G, G], rel=1e-6)


def test_a_force_at_a_point_turns_the_body():
    """2 N along y, 0.3 m beside the centre of a ball with I = 2/5 m r², besides a torque of 0.1 N m."""
    scene = gpx.Scene(gravity=(0, 0, 0))
    ball = scene.add_rigid(gpx.Sphere(0.5), 2.0, position=(1, 1, 1))
    world = gpx.World(scene, 0.01)
    world.apply_force(ball, (0, 2, 0), torque=(0, 0, 0.1), point=(1.3, 1, 1))
    assert world.forces.tolist() == [[0, 2, 0, 0, 0, pytest.approx(0.7)]]
    world.step(100)
    assert world.velocities[0] == pytest.approx([0, 1, 0, 0, 0, 0.7 / 0.2], rel=1e-12)
    world.apply_force(ball, (0, -2, 0), torque=(0, 0, -0.7))
    assert world.forces == pytest.approx(np.zeros((1, 6)), abs=1e-15)


def test_an_impulse_at_a_point_changes_velocities_at_once():
    """A rod of 3 kg and 2 m, I = m l²/12, struck at its end by 6 N s: it moves with 2 m/s and turns with 6 rad/s."""
    scene = gpx.Scene(gravity=(0, 0, 0))
    half = np.sqrt(0.5)
    rod = scene.add_rigid(None, 3.0, inertia=(1e-3, 1.0, 1.0), orientation=(half, 0, 0, half), name="rod")
    point = scene.add_point_mass(2.0, position=(0, 5, 0))
    world = gpx.World(scene, 0.01)
    world.apply_impulse("rod", (-6, 0, 0), point=(0, 1, 0))
    assert world.velocities[rod] == pytest.approx([-2, 0, 0, 0, 0, 6])
    world.apply_impulse(rod, angular_impulse=(0, 0, -6))
    assert world.velocities[rod] == pytest.approx([-2, 0, 0, 0, 0, 0], abs=1e-15)
    world.apply_impulse(point, (0, 0, 3), point=(1, 5, 0))
    assert world.velocities[point].tolist() == [0, 0, 1.5, 0, 0, 0]


@pytest.mark.parametrize("settings", SOLVERS, ids=solver_name)
def test_the_time_step_may_change_and_forces_stay(settings):
    world = gpx.World(gpx.scenes.tower(3), 1 / 240, **settings)
    world.step(24)
    before = world.contacts.force
    world.time_step = 1 / 60
    assert world.contacts.force == pytest.approx(before)
    world.step(6)
    assert world.time == pytest.approx(0.2, rel=1e-15) and world.steps == 30
    assert world.contacts.impulse[:, 0].sum() == pytest.approx(6 * G / 60, rel=1e-6)
    world.time_step = 1 / 1000
    world.step(100)
    assert world.time == pytest.approx(0.3, rel=1e-15)
    assert loads(world) == pytest.approx([3 * G, 2 * G, G], rel=1e-5)
    assert np.abs(world.velocities).max() < 1e-6


def test_impulses_of_a_step_of_another_length_start_the_next_as_forces():
    world = gpx.World(gpx.scenes.tower(10), 1 / 240)
    world.step(10)
    world.time_step = 1 / 100
    world.step()
    assert world.solution.iterations <= 1


def test_gravity_that_swings_is_felt_in_each_step():
    world = gpx.World(gpx.scenes.tower(5), DT, tolerance=1e-11)
    for _ in range(48):
        world.gravity = gpx.scenes.swinging_gravity(world.time)
        strength = -world.gravity[2]
        world.step()
        assert loads(world) == pytest.approx(strength * np.arange(5, 0, -1), rel=1e-8)
    assert -gpx.scenes.swinging_gravity(0.05)[2] == pytest.approx(1.5 * G)
    assert -gpx.scenes.swinging_gravity(0.15)[2] == pytest.approx(0.5 * G)


def test_without_gravity_a_stack_floats_and_a_push_moves_it_along():
    scene = gpx.Scene(gravity=(0, 0, 0))
    for k in range(3):
        scene.add_rigid(gpx.Box(1, 1, 1), 1.0, position=(0, 0, k + 0.5))
    world = gpx.World(scene, DT)
    world.step(5)
    assert not world.velocities.any()
    world.apply_impulse(0, (0, 0, 3))
    world.step(24)
    assert world.velocities[:, 2] == pytest.approx([1, 1, 1], rel=1e-7)


@pytest.mark.parametrize("settings", SOLVERS[:2], ids=solver_name)
def test_contacts_tell_where_bodies_press_and_how_hard(settings):
    world = gpx.World(gpx.scenes.table(4), DT, **settings)
    world.step(3)
    contacts = world.contacts
    n = len(contacts.gap)
    assert contacts.point.shape == contacts.normal.shape == contacts.force.shape == contacts.impulse.shape == (n, 3)
    assert contacts.frame.shape == (n, 3, 3) and contacts.friction.tolist() == [0.5] * n
    on_ground = contacts.body_a == -1
    assert contacts.force[on_ground, 2].sum() == pytest.approx(14 * G, rel=1e-6)
    assert contacts.point[on_ground, 2] == pytest.approx([0] * 16, abs=1e-6)
    assert contacts.force == pytest.approx(np.einsum("kr,krx->kx", contacts.impulse, contacts.frame) / DT)
    # Moments about the middle vanish, so that points and forces belong together.
    torque = np.cross(contacts.point[on_ground], contacts.force[on_ground]).sum(axis=0)
    assert torque == pytest.approx(np.zeros(3), abs=1e-5)


def test_changing_one_world_does_not_change_another_of_the_same_scene():
    scene = gpx.scenes.tower(2)
    one, other = gpx.World(scene, DT), gpx.World(scene, DT)
    one.remove(0)
    one.forces[0, 0] = 5.0
    assert len(other.bodies) == 2 and not other.forces.any() and len(scene.bodies) == 2
    assert [body.index for body in other.bodies] == [0, 1]


def test_bodies_that_are_not_there_are_refused():
    scene = gpx.scenes.tower(3)
    world = gpx.World(scene, DT)
    first, second, third = world.bodies
    world.remove(second)
    assert world.bodies[0] is first
    for stale in (second, third):
        with pytest.raises(gpx.ProblemError, match=f"{stale.name} is not in world.bodies or world.fixed"):
            world.remove(stale)
    with pytest.raises(gpx.ProblemError, match="0 bodies of the world are named 'body 1'"):
        world.remove("body 1")
    world.add(cube(5, "body 0"))
    with pytest.raises(gpx.ProblemError, match="2 bodies of the world are named 'body 0'"):
        world.move("body 0", position=(0, 0, 0))
    with pytest.raises(gpx.ProblemError, match="body is 3: the rows of the world's moving bodies are 0 to 2"):
        world.apply_force(3, (1, 0, 0))
    with pytest.raises(gpx.ProblemError, match="body is True: a Body, its name or its row is needed"):
        world.remove(True)
    with pytest.raises(gpx.ProblemError, match=r"body is a Scene: a Body, as Scene\.add_rigid makes it, is needed"):
        world.add(scene)
    with pytest.raises(gpx.ProblemError, match="ground never moves"):
        world.move("ground", position=(0, 0, 1))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda w: w.move(0, position=(0, np.nan, 0)), r"position of body 0\[1\] is nan"),
        (lambda w: w.move(0, orientation=(1, 1, 0, 0)), "orientation of body 0 has length 1.41421"),
        (lambda w: w.move(0, velocity=1.0), r"velocity of body 0 has shape \(\), but \(3,\) is needed"),
        (lambda w: w.apply_force(0, (np.inf, 0, 0)), r"force on body 0\[0\] is inf"),
        (lambda w: w.apply_force(0, torque=(1, 2)), r"torque on body 0 has shape \(2,\)"),
        (lambda w: w.apply_force(0, (1, 0, 0), point="top"), "point on body 0 is not an array of numbers"),
        (lambda w: w.apply_impulse(0, (np.nan, 0, 0)), r"impulse on body 0\[0\] is nan"),
        (lambda w: setattr(w, "positions", np.zeros((1, 3))), r"positions has shape \(1, 3\), but \(2, 3\) is needed"),
        (lambda w: setattr(w, "velocities", np.full((2, 6), np.nan)), r"velocities\[0, 0\] is nan"),
        (lambda w: setattr(w, "orientations", np.ones((2, 4))), "orientation of body 0 has length 2"),
        (lambda w: setattr(w, "time_step", 0.0), "time_step is 0: it must be positive and finite"),
    ],
)
def test_a_wrong_change_is_refused_and_changes_nothing(change, message):
    world = gpx.World(gpx.scenes.tower(2), DT)
    world.step(2)
    before = world.snapshot()
    with pytest.raises((gpx.ProblemError, gpx.SettingsError), match=message):
        change(world)
    assert world.snapshot() == before


@pytest.mark.parametrize("settings", SOLVERS, ids=solver_name)
def test_the_step_that_fails_among_many_is_named(settings):
    """At 1e307 m a step a body passes the largest double, 1.798e308, in the eighteenth."""
    scene = gpx.Scene(gravity=(0, 0, 0))
    scene.add_point_mass(1.0, name="calm")
    scene.add_point_mass(1.0, velocity=(1e307, 0, 0), name="runaway")
    world = gpx.World(scene, 1.0, **settings)
    world.step(3)
    with pytest.raises(gpx.ProblemError, match="the state of runaway is not finite after step 18: is the time step"):
        world.step(1000)
    assert world.steps == 17
    assert world.positions[1, 0] == pytest.approx(1.7e308)

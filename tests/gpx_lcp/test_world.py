"""Motion, against answers known on paper: where the law is algebraic to rounding, where it is a step to first order."""

import itertools

import numpy as np
import pytest

import gpx_lcp as gpx

G = 9.81
DT = 1 / 240


def ball_on_ground(velocity=(0, 0, 0), spin=(0, 0, 0), radius=0.5, material=None, height=0.0):
    scene = gpx.Scene()
    scene.add_static(gpx.HalfSpace(), material=material)
    position = (0, 0, radius + height)
    scene.add_rigid(
        gpx.Sphere(radius), 1.0, position=position, velocity=velocity, angular_velocity=spin, material=material
    )
    return scene


def rotation(quaternion):
    w, x, y, z = quaternion
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def test_free_flight_is_semi_implicit_euler_to_rounding():
    scene = gpx.Scene()
    scene.add_rigid(gpx.Sphere(1), 2.0, velocity=(1, 2, 3), force=(4, 0, 0), torque=(0, 0, 0.8))
    world = gpx.World(scene, 0.01)
    world.step(100)
    assert world.time == 1.0
    assert world.velocities[0] == pytest.approx([3, 2, 3 - G, 0, 0, 1.0], rel=1e-12)
    lag = 0.5 * 0.01
    assert world.positions[0] == pytest.approx([2 + 2 * lag, 2, 3 - 0.5 * G - G * lag], rel=1e-12)


def test_gravity_and_forces_may_change_between_steps():
    world = gpx.World(ball_on_ground(), DT, tolerance=1e-12)
    world.gravity = (0, 0, -2 * G)
    world.step()
    assert world.contacts.force[0] == pytest.approx([0, 0, 2 * G], abs=1e-9)
    world.gravity = (0, 0, 0)
    world.forces[0, 2] = -3.0
    world.step()
    assert world.contacts.force[0] == pytest.approx([0, 0, 3], abs=1e-9)


@pytest.mark.parametrize("speed", [0.5, 5.0, 200.0, 1e5])
def test_torque_free_rotation_keeps_its_angular_momentum(speed):
    """Also where a body turns many times a step, which no explicit scheme survives."""
    scene = gpx.Scene()
    inertia = np.array([1.0, 2.0, 2.9])
    spin = speed * np.array([0.1, 1.0, 0.05])
    scene.add_rigid(None, 1.0, inertia=inertia, angular_velocity=spin)
    world = gpx.World(scene, DT)
    momentum, energy = inertia * spin, inertia @ spin**2
    for _ in range(20):
        world.step(24)
        turn = rotation(world.orientations[0])
        body_spin = turn.T @ world.velocities[0, 3:]
        now = turn @ (inertia * body_spin)
        assert np.linalg.norm(now) == pytest.approx(np.linalg.norm(momentum), rel=1e-9)
        assert np.linalg.norm(world.orientations[0]) == pytest.approx(1.0, abs=1e-14)
        if speed <= 5.0:
            assert now == pytest.approx(momentum, rel=1e-9, abs=1e-9 * np.linalg.norm(momentum))
            assert inertia @ body_spin**2 == pytest.approx(energy, rel=0.06)


def test_a_point_mass_feels_no_torque():
    scene = gpx.Scene()
    scene.add_static(gpx.HalfSpace())
    scene.add_point_mass(1.0, position=(0, 0, 0.5), velocity=(1, 0, 0), shape=gpx.Sphere(0.5))
    scene.add_rigid(gpx.Sphere(0.5), 1.0, position=(5, 0, 0.5), velocity=(1, 0, 0))
    world = gpx.World(scene, DT, tolerance=1e-12)
    world.step(10)
    assert world.velocities[0] == pytest.approx([1 - 0.5 * G * world.time, 0, 0, 0, 0, 0], abs=1e-12)
    assert abs(world.velocities[1, 4]) > 0.1


@pytest.mark.parametrize("angle", [0.2, 0.4, 0.46])
def test_block_sticks_where_the_slope_is_below_the_friction_angle(angle):
    world = gpx.World(gpx.scenes.incline(angle, 0.5), DT, tolerance=1e-12)
    start = world.positions
    world.step(240)
    assert np.abs(world.velocities).max() < 1e-11
    assert np.abs(world.positions - start).max() < 1e-11


@pytest.mark.parametrize(("angle", "friction"), [(0.47, 0.5), (0.6, 0.5), (0.3, 0.0), (0.3, 0.1)])
def test_block_slides_down_a_steeper_slope(angle, friction):
    world = gpx.World(gpx.scenes.incline(angle, friction), DT, tolerance=1e-13)
    world.step(240)
    downhill = np.array([np.cos(angle), 0, -np.sin(angle)])
    speed = G * (np.sin(angle) - friction * np.cos(angle))
    assert world.velocities[0] == pytest.approx([*(speed * downhill), 0, 0, 0], abs=1e-9)


@pytest.mark.parametrize("direction", np.linspace(0, np.pi, 7))
def test_the_direction_of_sliding_does_not_change_friction(direction):
    along = np.array([np.cos(direction), np.sin(direction), 0])
    scene = gpx.Scene()
    scene.add_static(gpx.HalfSpace())
    scene.add_rigid(gpx.Box(1, 1, 0.1), 1.0, position=(0, 0, 0.05), velocity=4 * along)
    world = gpx.World(scene, DT, tolerance=1e-13, formulation="coulomb")
    world.step(96)
    assert world.velocities[0, :3] == pytest.approx((4 - 0.5 * G * world.time) * along, abs=1e-9)
    world.step(144)
    assert np.abs(world.velocities).max() < 1e-11


def test_a_sliding_ball_ends_up_rolling_with_five_sevenths_of_its_speed():
    world = gpx.World(gpx.scenes.rolling_sphere(), DT, tolerance=1e-13)
    world.step(54)  # it rolls from t = 2 v0/(7 μ g) = 0.233 s on
    assert world.velocities[0, 0] == pytest.approx(4 - 0.5 * G * world.time, abs=1e-9)
    world.step(180)
    rolling = 4 * 5 / 7
    assert world.velocities[0] == pytest.approx([rolling, 0, 0, 0, rolling / 0.5, 0], abs=1e-9)


def test_a_ball_with_backspin_comes_back():
    """R = 0.25, v0 = 4, ω0 = 200, μ = 0.5: from 2 (v0 + ω0 R)/(7 μ g) = 3.145 s on it rolls at (5 v0 - 2 ω0 R)/7."""
    material = gpx.Material(0.5)
    world = gpx.World(ball_on_ground((4, 0, 0), (0, -200, 0), 0.25, material), DT, tolerance=1e-12)
    world.step(int(3.14 / DT))
    assert world.velocities[0, 0] == pytest.approx(4 - 0.5 * G * world.time, abs=1e-6)
    world.step(20)
    assert world.velocities[0, 0] == pytest.approx((5 * 4 - 2 * 200 * 0.25) / 7, abs=1e-6)


def apex(elasticity, steps_of_fall, height=1.0):
    """Height of the first rebound of a ball; the fall takes `steps_of_fall` steps and a half."""
    time_step = np.sqrt(2 * height / G) / (steps_of_fall + 0.5)
    scene = ball_on_ground(material=gpx.Material(0.0, elasticity), height=height)
    world = gpx.World(scene, time_step, tolerance=1e-13)
    heights = []
    for _ in range(3 * steps_of_fall):
        world.step()
        heights.append(world.positions[0, 2] - 0.5)
    impact = int(np.argmin(heights[: steps_of_fall + 5]))
    return max(heights[impact:]), time_step


@pytest.mark.parametrize("elasticity", [1.0, 1.25, 1.5, 1.9, 2.0])
def test_rebound_height_is_right_to_first_order_in_the_step(elasticity):
    truth = (elasticity - 1) ** 2
    errors = []
    for steps in (40, 80, 160):
        height, time_step = apex(elasticity, steps)
        assert abs(height - truth) <= np.sqrt(2 * G) * time_step
        errors.append(abs(height - truth))
    if elasticity in (1.0, 2.0):
        assert max(errors) < 1e-12
    else:
        ratios = np.array(errors[:-1]) / errors[1:]
        assert ((ratios > 1.8) & (ratios < 2.2)).all()


def test_a_cube_that_falls_flat_rebounds_without_turning():
    scene = gpx.Scene()
    material = gpx.Material(0.5, 1.5)
    scene.add_static(gpx.HalfSpace(), material=material)
    scene.add_rigid(gpx.Box(1, 1, 1), 1.0, position=(0, 0, 0.5), velocity=(0, 0, -2), material=material)
    world = gpx.World(scene, DT, tolerance=1e-13)
    world.step()
    assert world.velocities[0] == pytest.approx([0, 0, 1, 0, 0, 0], abs=1e-9)


@pytest.mark.parametrize("elasticity", [1.0, 1.5, 2.0])
def test_elastic_bodies_at_rest_do_not_bounce(elasticity):
    scene = gpx.Scene()
    material = gpx.Material(0.5, elasticity)
    scene.add_static(gpx.HalfSpace(), material=material)
    for k in range(3):
        scene.add_rigid(gpx.Box(1, 1, 1), 1.0, position=(0, 0, k + 0.5), material=material)
    world = gpx.World(scene, DT)
    world.step(120)
    assert np.abs(world.velocities).max() < 1e-7


@pytest.mark.parametrize("n", [2, 3, 5])
@pytest.mark.parametrize("solver", ["lemke", "pgs"])
def test_cradle_gives_the_answer_of_one_stacked_system(n, solver):
    world = gpx.World(gpx.scenes.cradle(n), DT, solver=solver, tolerance=1e-13)
    world.step()
    expected = [-(n - 2) / n] + [2 / n] * (n - 1)
    assert world.velocities[:, 0] == pytest.approx(expected, abs=1e-9)
    world.step(20)
    assert world.velocities[:, 0] == pytest.approx(expected, abs=1e-9)


def test_fast_bodies_do_not_pass_through_thin_ones():
    scene = gpx.Scene(gravity=(0, 0, 0))
    scene.add_static(gpx.Box(2, 2, 0.01))
    scene.add_rigid(gpx.Sphere(0.1), 1.0, position=(0, 0, 1), velocity=(0, 0, -100))
    world = gpx.World(scene, 1 / 60, tolerance=1e-12)
    world.step(10)
    assert world.positions[0, 2] == pytest.approx(0.105, abs=1e-9)


@pytest.mark.parametrize(("time_step", "steps"), [(1 / 60, 60), (1 / 240, 240), (1 / 1000, 300)])
def test_a_tower_stands_still(time_step, steps):
    world = gpx.World(gpx.scenes.tower(5), time_step, tolerance=1e-9)
    start = world.positions
    world.step(steps)
    assert np.abs(world.velocities).max() < 1e-7
    assert np.abs(world.positions - start).max() < 1e-7
    loads = world.contacts.force[:, 2].reshape(5, 4).sum(axis=1)
    assert loads == pytest.approx(G * np.arange(5, 0, -1), rel=1e-6)


def test_a_wall_and_a_table_stand_still():
    for scene in (gpx.scenes.wall(4), gpx.scenes.table(6), gpx.scenes.pyramid(3)):
        world = gpx.World(scene, DT, tolerance=1e-9)
        start = world.positions
        world.step(60)
        assert np.abs(world.velocities).max() < 1e-6
        assert np.abs(world.positions - start).max() < 1e-6


def test_overlap_is_taken_out_without_a_jump():
    """A cube 1 cm deep in the ground: it comes up, never faster than it sinks back, and ends at the slop."""
    scene = gpx.Scene()
    scene.add_static(gpx.HalfSpace())
    scene.add_rigid(gpx.Box(1, 1, 1), 1.0, position=(0, 0, 0.49))
    world = gpx.World(scene, DT, tolerance=1e-12)
    depths = []
    for _ in range(120):
        world.step()
        depths.append(0.5 - world.positions[0, 2])
        assert np.abs(world.velocities).max() < 1e-9
    assert (np.diff(depths) <= 1e-12).all()
    assert 0 < depths[-1] < 1e-4


def test_overlap_under_a_stack_lifts_the_stack():
    scene = gpx.Scene()
    scene.add_static(gpx.HalfSpace())
    for k in range(3):
        scene.add_rigid(gpx.Box(1, 1, 1), 1.0, position=(0, 0, 0.49 + k))
    world = gpx.World(scene, DT)
    world.step(240)
    assert world.positions[:, 2] == pytest.approx([0.5, 1.5, 2.5], abs=4e-4)
    assert np.abs(world.velocities).max() < 1e-6


def test_a_warm_start_saves_sweeps_and_does_not_change_the_motion():
    asked = {"tolerance": 1e-10, "presolve": False}
    worlds = [gpx.World(gpx.scenes.tower(6), DT, warm_start=warm, **asked) for warm in (True, False)]
    for world in worlds:
        world.step(20)
    warm, cold = (world.solution.iterations for world in worlds)
    assert warm < 0.5 * cold
    assert worlds[0].positions == pytest.approx(worlds[1].positions, abs=1e-7)


@pytest.mark.parametrize(
    "settings",
    [
        dict(solver="pgs", formulation="coulomb"),
        dict(solver="pgs", formulation="cone"),
        dict(solver="pgs", formulation="pyramid"),
        dict(solver="pgs", formulation="box"),
        dict(solver="lemke", formulation="pyramid", facets=4),
        dict(solver="osqp", formulation="pyramid", tolerance=1e-6),
    ],
    ids=lambda s: f"{s['formulation']}-{s['solver']}",
)
def test_every_kind_of_solver_steps_a_world(settings):
    world = gpx.World(gpx.scenes.tower(2), DT, **settings)
    world.step(5)
    assert np.abs(world.velocities).max() < 1e-4
    assert world.solution.method.endswith(settings["solver"])


def test_forces_are_impulses_per_time_in_the_world_frame():
    world = gpx.World(gpx.scenes.incline(0.4, 0.6), DT, tolerance=1e-12)
    world.step(2)
    contacts = world.contacts
    assert contacts.force.sum(axis=0) == pytest.approx([0, 0, G], abs=1e-9)
    assert np.einsum("kx,kx->k", contacts.force, contacts.normal) == pytest.approx(contacts.impulse[:, 0] / DT)
    assert np.allclose(contacts.normal, [np.sin(0.4), 0, np.cos(0.4)])


def test_contacts_before_the_first_step_carry_no_impulse():
    contacts = gpx.World(gpx.scenes.tower(2), DT).contacts
    assert len(contacts.gap) == 8
    assert not contacts.impulse.any() and not contacts.force.any()


def test_system_is_what_the_next_step_solves():
    world = gpx.World(gpx.scenes.tower(3), DT, tolerance=1e-11, warm_start=False)
    system = world.system()
    world.step()
    assert np.array_equal(world.solution.velocity, system.velocity(world.solution.impulse))
    assert world.solution.certificate.natural_map < 1e-10


def test_two_runs_are_bit_identical():
    runs = []
    for _ in range(2):
        world = gpx.World(gpx.scenes.sphere_pile(30, seed=4), 1 / 120, iterations=20)
        world.step(60)
        runs.append((world.positions, world.orientations, world.velocities, world.contacts.impulse))
    for one, other in zip(*runs, strict=True):
        assert one.tobytes() == other.tobytes()


def test_a_pile_settles_without_sinking():
    world = gpx.World(gpx.scenes.sphere_pile(27, seed=1), 1 / 120, iterations=100)
    world.step(360)
    assert world.contacts.gap.min() > -1e-3
    assert np.abs(world.velocities[:, :3]).max() < 0.2
    distance = [np.linalg.norm(a - b) for a, b in itertools.combinations(world.positions, 2)]
    assert min(distance) > 0.999


def test_an_empty_scene_steps_and_does_nothing():
    world = gpx.World(gpx.Scene(), DT)
    world.step(3)
    assert world.time == 3 * DT
    assert world.positions.shape == (0, 3) and world.velocities.shape == (0, 6) and world.orientations.shape == (0, 4)
    assert world.system().contacts == 0 and len(world.contacts.gap) == 0
    only_ground = gpx.Scene()
    only_ground.add_static(gpx.HalfSpace())
    gpx.World(only_ground, DT).step(2)


def test_no_gravity_means_no_motion():
    scene = gpx.Scene(gravity=(0, 0, 0))
    scene.add_static(gpx.HalfSpace())
    scene.add_rigid(gpx.Box(1, 1, 1), 1.0, position=(0, 0, 0.5))
    world = gpx.World(scene, DT)
    world.step(10)
    assert world.positions.tolist() == [[0, 0, 0.5]]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (dict(time_step=0), "time_step is 0: it must be positive and finite"),
        (dict(time_step=np.nan), "time_step is nan"),
        (dict(time_step="soon"), "time_step is 'soon': it must be a number of seconds"),
        (dict(solver="magic"), "solver is 'magic'"),
        (dict(formulation="magic"), "formulation is 'magic'"),
        (dict(tolerance=-1.0), "tolerance is -1"),
        (dict(iterations=-1), "max_iterations is -1"),
        (dict(warm_start="yes"), "warm_start is 'yes': it must be True or False"),
        (dict(speed=3), "speed"),
        (dict(solver="pgs", relaxation=3.0), "relaxation is 3"),
    ],
)
def test_a_wrong_setting_is_refused_before_the_first_step(change, message):
    with pytest.raises(gpx.SettingsError, match=message):
        gpx.World(**{"scene": gpx.Scene(), "time_step": DT, **change})


def test_wrong_arguments_between_steps_are_refused():
    world = gpx.World(gpx.scenes.tower(1), DT)
    with pytest.raises(gpx.ProblemError, match="scene is a str"):
        gpx.World("tower", DT)
    for steps in (-1, 1.5, True, "two"):
        with pytest.raises(gpx.SettingsError, match=r"steps is .*: it must be a whole number"):
            world.step(steps)
    with pytest.raises(gpx.ProblemError, match=r"gravity\[2\] is nan"):
        world.gravity = (0, 0, np.nan)
    with pytest.raises(gpx.ProblemError, match=r"forces has shape \(6,\), but \(1, 6\) is needed"):
        world.forces = np.zeros(6)
    world.forces[0, 0] = np.inf
    with pytest.raises(gpx.ProblemError, match=r"forces\[0, 0\] is inf"):
        world.step()


def test_a_state_that_overflows_names_the_body_and_the_step_and_is_not_kept():
    scene = gpx.Scene()
    scene.add_point_mass(1.0)
    scene.add_point_mass(1e-300, name="dust")
    world = gpx.World(scene, DT)
    world.step()
    world.forces[1, 0] = 1e300
    with pytest.raises(
        gpx.ProblemError, match="the state of dust is not finite after step 2: is the time step too long"
    ):
        world.step()
    world.forces[1, 0] = 1e10
    with pytest.raises(gpx.ProblemError, match="the state of dust is not finite"):
        world.step()
    assert np.isfinite(world.positions).all() and world.time == DT


def test_an_interrupt_inside_a_step_taken_stage_by_stage_keeps_the_last_whole_step(monkeypatch):
    settings = dict(solver="lemke", formulation="pyramid")
    world, other = (gpx.World(gpx.scenes.tower(2), DT, **settings) for _ in range(2))
    calls = itertools.count()

    def interrupted(*args, **kwargs):
        if next(calls) == 3:
            raise KeyboardInterrupt
        return gpx.solve(*args, **kwargs)

    monkeypatch.setattr("gpx_lcp.staged.solve", interrupted)
    with pytest.raises(KeyboardInterrupt):
        world.step(10)
    other.step(3)
    assert world.time == 3 * DT
    assert np.array_equal(world.positions, other.positions)
    assert np.array_equal(world.contacts.impulse, other.contacts.impulse)


def test_arrays_of_a_world_are_read_only_copies():
    world = gpx.World(gpx.scenes.tower(1), DT)
    with pytest.raises(ValueError, match="read-only"):
        world.positions[0] = 5.0
    before = world.positions
    world.gravity = (1, 0, 0)
    world.step()
    assert before.tolist() == [[0, 0, 0.5]]

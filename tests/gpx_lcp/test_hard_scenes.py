"""Scenes that other solvers fail on, each against paper: both exact solvers, at 1e-8 and from a cold start."""

import math

import numpy as np
import pytest
import scipy.optimize
import scipy.sparse

import gpx_lcp as gpx
from gpx_lcp import scenes

G, STEP = 9.81, 1 / 240
FALL = G * STEP
TOLERANCE = 1e-8
TAN15 = math.tan(math.radians(15.0))
SIN30, COS30 = 0.5, math.sqrt(0.75)
TAN30 = SIN30 / COS30

both_solvers = pytest.mark.parametrize("solver", ["newton", "interior_point"])


def solved(system, solver, tolerance=TOLERANCE, **settings):
    """Return the impulses that solve the system and the velocities of the bodies after them, (bodies, D)."""
    solution = gpx.solve(system, "coulomb", solver, tolerance=tolerance, **settings)
    assert solution.status is gpx.Status.SOLVED
    assert solution.certificate.natural_map <= tolerance
    return solution.impulse, body_velocities(system, solution)


def body_velocities(system, solution):
    moved = system.free_velocity + system.body_velocity_change(solution.impulse).reshape(-1)
    return moved.reshape(len(system.inverse_mass), -1)


def system_of(scene, step=STEP):
    return gpx.World(scene, step).system()


def solve_scene(scene, solver, tolerance=TOLERANCE):
    return solved(system_of(scene), solver, tolerance)


def load_on(scene, impulse, fixed_only=False):
    """Return what carries each body from below, N: the vertical force of its contacts as body b."""
    contacts = gpx.World(scene, STEP).contacts
    load = np.zeros(len(scene.bodies))
    upward = np.einsum("kr,kr->k", impulse, contacts.frame[:, :, 2])
    if fixed_only:
        upward[contacts.body_a >= 0] = 0.0
    np.add.at(load, contacts.body_b, upward)
    return load / STEP


def planar(system):
    """Return the system of a scene symmetric about y = 0, held to that plane: two rows, bodies moving as x, z, ω_y."""
    plane = [0, 2, 4]
    jacobian = system.jacobian.toarray().reshape(system.contacts, 3, -1, 6)[..., plane]
    tangent = np.abs(jacobian[:, 1:]).max(axis=(2, 3)).argmax(axis=1) + 1
    rows = np.stack([np.zeros_like(tangent), tangent], axis=1)
    contact = np.arange(system.contacts)[:, None]
    return gpx.StackedSystem.from_jacobian(
        jacobian[contact, rows].reshape(2 * system.contacts, -1),
        system.inverse_mass[:, plane][:, :, plane],
        system.B.reshape(-1, 3)[contact, rows].reshape(-1),
        system.friction,
        free_velocity=system.free_velocity.reshape(-1, 6)[:, plane].reshape(-1),
    )


def equilibrium_exists(system):
    """Say whether forces in the plane y = 0, within the friction cones, hold a scene that is symmetric about it.

    A linear program, Jᵀ p = -M v_free: what cannot pass it cannot stand.
    """
    flat = planar(system)
    n = flat.contacts
    wedges = [[[-mu, 1.0], [-mu, -1.0]] for mu in flat.friction]
    needed = -np.einsum("bij,bj->bi", np.linalg.inv(flat.inverse_mass), flat.free_velocity.reshape(-1, 3))
    answer = scipy.optimize.linprog(
        np.zeros(2 * n),
        A_ub=scipy.sparse.block_diag(wedges),
        b_ub=np.zeros(2 * n),
        A_eq=flat.jacobian.T,
        b_eq=needed.reshape(-1) / FALL,
        bounds=[(0.0, None), (None, None)] * n,
    )
    return answer.status == 0


def stays(velocity):
    """Say whether velocities are nil to 1e-8 m/s: contacts move with 1e-9 at a residual of 1e-8, and stacks add up."""
    return bool(np.abs(velocity).max() <= 1e-8)


# Mass ratios and tables


@both_solvers
@pytest.mark.parametrize("ratio", [1.0, 1e3, 1e6])
def test_heavy_cube_on_light_ones_weighs_what_it_weighs(solver, ratio):
    """The load on interface k from below is (ratio + n - 1 - k) g."""
    scene = scenes.heavy_on_light(10, ratio)
    impulse, velocity = solve_scene(scene, solver)
    np.testing.assert_allclose(load_on(scene, impulse), G * (ratio + np.arange(9, -1, -1)), rtol=1e-7)
    assert stays(velocity)


@both_solvers
@pytest.mark.parametrize(("ratio", "tolerance"), [(1e6, 1e-10), (1e7, 1e-8)])
def test_a_load_too_heavy_for_the_tolerance_is_not_called_infeasible(solver, ratio, tolerance):
    """The answer is there, loads (ratio + n - 1 - k) g; rounding alone is in the way of the last digits."""
    solution = gpx.solve(system_of(scenes.heavy_on_light(10, ratio)), "coulomb", solver, tolerance=tolerance)
    assert solution.status is not gpx.Status.INFEASIBLE
    assert "infeasibility" not in solution.extras


@both_solvers
def test_table_on_nine_legs_shares_its_load_alike_among_like_legs(solver):
    """The ground carries 19 kg. What each leg carries is indeterminate; of the smallest impulses corners get alike."""
    scene = scenes.table(9)
    impulse, velocity = solve_scene(scene, solver)
    assert load_on(scene, impulse, fixed_only=True)[:9].sum() == pytest.approx(19 * G, rel=1e-7)
    assert stays(velocity)
    legs = load_on(scene, gpx.minimum_norm(system_of(scene), impulse), fixed_only=True)[:9]
    assert legs.sum() == pytest.approx(19 * G, rel=1e-7)
    np.testing.assert_allclose(legs[:4], legs[0], rtol=1e-6)
    np.testing.assert_allclose(legs[4:8], legs[4], rtol=1e-6)
    assert (legs > G).all()


# The wedge


def held_between_walls(world):
    """Return the impulses that hold the block of `wedge(0, 0.5)`: a friction of m g dt / 8 at each contact."""
    frames = world.contacts.frame
    impulse = np.zeros((8, 3))
    impulse[:, 0] = FALL / 8 / 0.5
    impulse[:, 1:] = FALL / 8 * frames[:, 1:, 2]
    return impulse


def test_a_block_between_parallel_walls_has_solutions_from_fall_to_rest():
    """With a share s of the impulses that hold it, it falls with (1 - s) g dt: sliding at the limit of friction."""
    world = gpx.World(scenes.wedge(0.0, 0.5), STEP)
    system = world.system()
    for share in (0.0, 0.3, 1.0):
        impulse = share * held_between_walls(world)
        assert gpx.certify(system, impulse).natural_map <= 1e-15
        speed = system.free_velocity + system.body_velocity_change(impulse).reshape(-1)
        np.testing.assert_allclose(speed, [0, 0, (share - 1) * FALL, 0, 0, 0], atol=1e-15)


@both_solvers
@pytest.mark.parametrize("step", [1 / 60, 1 / 240, 1e-6])
def test_a_block_between_parallel_walls_falls(solver, step):
    """Of the solutions both solvers give the one without impulses, whatever the step and whatever they start from."""
    world = gpx.World(scenes.wedge(0.0, 0.5), step)
    assert world.contacts.gap.tolist() == [0.0] * 8
    impulse, velocity = solved(world.system(), solver)
    assert not impulse.any()
    np.testing.assert_allclose(velocity[0], [0, 0, -G * step, 0, 0, 0], atol=1e-15)


def test_a_warm_start_from_rest_does_not_hold_the_block():
    world = gpx.World(scenes.wedge(0.0, 0.5), STEP)
    _, velocity = solved(world.system(), "newton", warm_start=held_between_walls(world))
    assert velocity[0, 2] == pytest.approx(-FALL, rel=1e-12)


@both_solvers
@pytest.mark.parametrize("angle", [0.1, 0.3, 0.7])
def test_each_wall_of_a_groove_carries_half_the_weight_over_its_sine(solver, angle):
    world = gpx.World(scenes.wedge(angle, friction=0.0), STEP)
    solution = gpx.solve(world.system(), "normal", solver, tolerance=TOLERANCE)
    assert solution.status is gpx.Status.SOLVED
    right = world.contacts.normal[:, 0] < 0
    for wall in (right, ~right):
        assert solution.impulse[wall].sum() == pytest.approx(FALL / (2 * math.sin(angle)), rel=1e-6)


@both_solvers
@pytest.mark.parametrize(("angle", "friction"), [(0.3, 0.2), (0.3, 0.5), (0.3, 1.0)])
def test_a_block_rests_in_a_groove(solver, angle, friction):
    """Normal impulses lie between m g dt / 2 (sin ± μ cos) on a wall, without bound where it can jam itself."""
    scene = scenes.wedge(angle, friction)
    impulse, velocity = solve_scene(scene, solver)
    assert stays(velocity)
    least = FALL / (math.sin(angle) + friction * math.cos(angle))
    assert impulse[:, 0].sum() >= least * (1 - 1e-6)
    if friction < math.tan(angle):
        assert impulse[:, 0].sum() <= FALL / (math.sin(angle) - friction * math.cos(angle)) * (1 + 1e-6)


@both_solvers
def test_friction_along_a_groove_is_that_of_its_normal_loads(solver):
    """Slowed by μ g / sin(angle)."""
    angle, friction, speed = 0.3, 0.5, 2.0
    _, velocity = solve_scene(scenes.wedge(angle, friction, speed), solver, tolerance=1e-10)
    slowed = speed - friction * FALL / math.sin(angle)
    np.testing.assert_allclose(velocity[0], [0, slowed, 0, 0, 0, 0], atol=1e-8)


@both_solvers
@pytest.mark.parametrize("friction", [0.2, 0.5])
def test_a_block_pulled_out_of_a_groove_leaves(solver, friction):
    """Below tan(angle) = 0.309 that is the only solution; above it, jammed is another."""
    world = gpx.World(scenes.wedge(0.3, friction), STEP)
    world.gravity = (0.0, 0.0, G)
    impulse, velocity = solved(world.system(), solver)
    assert not impulse.any()
    assert velocity[0, 2] == FALL


# Arches and card houses


@both_solvers
def test_an_arch_of_25_stones_stands_with_half_its_weight_on_each_springer(solver):
    scene = scenes.arch(25)
    impulse, velocity = solve_scene(scene, solver)
    assert stays(velocity)
    on_springers = load_on(scene, impulse, fixed_only=True)
    assert on_springers[[0, 24]] == pytest.approx(12.5 * G, rel=1e-6)
    assert not on_springers[1:24].any()
    thrust = np.einsum("kr,kr->k", impulse, gpx.World(scene, STEP).contacts.frame[:, :, 0])[:4].sum()
    assert 0.0 < thrust < 0.8 * 12.5 * FALL


@both_solvers
@pytest.mark.parametrize(("friction", "stands"), [(0.310, True), (0.305, False)])
def test_an_arch_stands_as_long_as_a_line_of_thrust_fits_inside(solver, friction, stands):
    system = system_of(scenes.arch(25, friction))
    assert equilibrium_exists(system) is stands
    for form in (system, planar(system)):
        _, velocity = solved(form, solver)
        assert stays(velocity) is stands


@both_solvers
@pytest.mark.parametrize("scene", [scenes.arch(25), scenes.card_house(4)], ids=["arch", "card house"])
def test_what_stands_still_stands_after_a_few_steps(scene, solver):
    world = gpx.World(scene, STEP, solver=solver)
    start = world.positions
    world.step(5)
    assert world.solution.certificate.natural_map <= TOLERANCE
    np.testing.assert_allclose(world.positions, start, atol=1e-9)


@both_solvers
@pytest.mark.parametrize("levels", [1, 2, 4])
def test_a_card_house_stands_and_the_ground_carries_it(solver, levels):
    scene = scenes.card_house(levels)
    assert len(scene.bodies) == levels * (levels + 1) + levels * (levels - 1) // 2
    impulse, velocity = solve_scene(scene, solver)
    assert stays(velocity)
    load = load_on(scene, impulse, fixed_only=True)
    assert load.sum() == pytest.approx(len(scene.bodies) * G, rel=1e-7)
    assert np.count_nonzero(load) == 2 * levels


@both_solvers
@pytest.mark.parametrize(("friction", "stands"), [(0.2265, True), (0.2245, False)])
def test_a_card_house_of_four_levels_stands_where_statics_lets_it(solver, friction, stands):
    system = system_of(scenes.card_house(4, friction))
    assert equilibrium_exists(system) is stands
    for form in (system, planar(system)):
        _, velocity = solved(form, solver)
        assert stays(velocity) is stands


@both_solvers
@pytest.mark.parametrize(("excess", "stands"), [(1e-3, True), (-1e-3, False)])
def test_two_leaning_cards_need_the_friction_of_their_moments(solver, excess, stands):
    """A card stands on the inner end of its foot, x_f, and leans on its tip: μ >= (x_c - x_f) / height."""
    foot = scenes.CARD_THICKNESS / math.cos(scenes.CARD_LEAN)
    inner = foot - (scenes.CARD_HEIGHT * math.tan(scenes.CARD_LEAN) + 0.5 * foot)
    least = (scenes.card_house(1).bodies[0].position[0] - inner) / scenes.CARD_HEIGHT
    _, velocity = solve_scene(scenes.card_house(1, least + excess), solver)
    assert stays(velocity) is stands


# Sharp thresholds


@both_solvers
@pytest.mark.parametrize("between", [1.001 * TAN15, 0.5])
@pytest.mark.parametrize("ground", [1.001 * TAN15 / 3, 0.5])
def test_three_cylinders_stand_just_above_both_thresholds(solver, between, ground):
    """Accelerations of 1e-9 m/s² are 4e-12 m/s a step: for that the tolerance is 1e-12."""
    scene = scenes.cylinders(between, ground)
    impulse, _ = solve_scene(scene, solver)
    assert load_on(scene, impulse, fixed_only=True) == pytest.approx([1.5 * G, 1.5 * G, 0.0], rel=1e-6)
    _, velocity = solve_scene(scene, solver, tolerance=1e-12)
    assert np.abs(velocity / STEP).max() <= 1e-9


@both_solvers
@pytest.mark.parametrize("share", [0.999, 0.9, 0.0])
def test_three_cylinders_slide_off_each_other_just_below_the_threshold_between_them(solver, share):
    """The lower ones roll, 3/2 m a = n (sin 30° - μ (1 + cos 30°)), and the top one falls with a tan 30°."""
    mu = share * TAN15
    system = system_of(scenes.cylinders(mu, 0.5))
    per_load = (SIN30 - mu * (1 + COS30)) / 1.5
    outward = G / (TAN30 + 2 * (COS30 + mu * SIN30) / per_load)
    for velocity in (solved(planar(system), solver)[1], solved(system, solver)[1][:, [0, 2, 4]]):
        expected = [[-outward, 0, -2 * outward], [outward, 0, 2 * outward], [0, -TAN30 * outward, 0]]
        np.testing.assert_allclose(velocity / STEP, expected, rtol=1e-4, atol=1e-6)


@both_solvers
@pytest.mark.parametrize("share", [0.999, 0.9, 0.0])
def test_three_cylinders_slide_on_the_ground_just_below_the_threshold_there(solver, share):
    """The lower ones roll on the top one, backwards with a / r cos 30°; the ground carries 3/2 m g - m a tan 30° / 2.

    That is so in the plane. In space the three may yaw together as well: where the ends of a cylinder press unequally
    on the ground, so do they rub, and the friction has a moment about the vertical. Then they slide out faster.
    """
    mu = share * TAN15 / 3
    system = system_of(scenes.cylinders(0.5, mu))
    inertia = 1 + 0.5 / COS30**2 + 0.5 * TAN30**2 - 0.5 * mu * TAN30 * (1 + 1 / COS30)
    outward = G * (0.5 * TAN30 - 1.5 * mu * (1 + 1 / COS30)) / inertia
    _, velocity = solved(planar(system), solver)
    turning = 2 * outward / COS30
    expected = [[-outward, 0, turning], [outward, 0, -turning], [0, -TAN30 * outward, 0]]
    np.testing.assert_allclose(velocity / STEP, expected, rtol=1e-4, atol=1e-6)
    # What is compared is a thousandth of what the tolerance is relative to.
    _, velocity = solved(system, solver, tolerance=1e-3 * TOLERANCE)
    left, right, _ = velocity[:, 0] / STEP
    assert -left == pytest.approx(right, rel=1e-5)
    assert right >= outward * (1 - 1e-4)


@both_solvers
@pytest.mark.parametrize("n", [1, 4, 10])
def test_overhanging_bricks_stand_just_below_the_harmonic_sum(solver, n):
    scene = scenes.bricks(n, 0.999)
    assert scene.bodies[-1].position[0] + 1.0 == pytest.approx(0.999 * sum(1 / k for k in range(1, n + 1)))
    system = system_of(scene)
    assert equilibrium_exists(system)
    impulse, velocity = solved(system, solver)
    assert stays(velocity)
    np.testing.assert_allclose(load_on(scene, impulse), G * np.arange(n, 0, -1), rtol=1e-6)


@both_solvers
@pytest.mark.parametrize("n", [1, 4, 10])
def test_overhanging_bricks_topple_just_above_the_harmonic_sum(solver, n):
    system = system_of(scenes.bricks(n, 1.001))
    assert not equilibrium_exists(system)
    _, velocity = solved(system, solver)
    turning = velocity[:, 4] / STEP
    assert turning.max() > 1e-3


@both_solvers
def test_one_brick_topples_about_the_edge_with_the_acceleration_of_its_lever(solver):
    beyond = 0.001
    _, velocity = solve_scene(scenes.bricks(1, 1.0 + beyond), solver, tolerance=1e-11)
    lever = beyond**2 + 0.25
    assert velocity[0, 4] / STEP == pytest.approx(G * beyond / (5 / 12 + lever), rel=1e-6)


# Both forms, and bad input


@both_solvers
@pytest.mark.parametrize(
    "scene",
    [
        scenes.heavy_on_light(10, 1e6),
        scenes.table(9),
        scenes.wedge(0.3, 0.5, speed=2.0),
        scenes.arch(),
        scenes.arch(friction=0.25),
        scenes.card_house(),
        scenes.card_house(friction=0.2),
        scenes.cylinders(),
        scenes.bricks(4, 0.999),
        scenes.bricks(4, 1.001),
    ],
    ids=["heavy", "table", "wedge", "arch", "low arch", "cards", "low cards", "cylinders", "bricks", "low bricks"],
)
def test_every_scene_is_solved_from_the_delassus_matrix_alone(solver, scene):
    system = system_of(scene)
    bare = gpx.StackedSystem(system.A, system.B, system.friction)
    solution = gpx.solve(bare, "coulomb", solver, tolerance=TOLERANCE)
    assert solution.status is gpx.Status.SOLVED
    assert solution.certificate.natural_map <= TOLERANCE


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: scenes.wedge(-0.1), "angle is -0.1: it must be at least 0 and below π/4 rad"),
        (lambda: scenes.wedge(0.8), "angle is 0.8"),
        (lambda: scenes.wedge(0.1, speed=math.nan), "velocity of body 0"),
        (lambda: scenes.arch(2), "stones is 2: it must be a whole number of at least 3"),
        (lambda: scenes.arch(25, friction=-1.0), "friction is -1"),
        (lambda: scenes.card_house(0), "levels is 0: it must be a whole number of at least 1"),
        (lambda: scenes.cylinders(ground=-0.1), "friction is -0.1"),
        (lambda: scenes.cylinders(between=math.nan), "friction"),
        (lambda: scenes.bricks(1.5), "n is 1.5: it must be a whole number of at least 1"),
        (lambda: scenes.bricks(2, share=math.inf), "position of body 0"),
    ],
)
def test_a_hard_scene_that_cannot_be_is_refused(make, message):
    with pytest.raises(gpx.ProblemError, match=message):
        make()

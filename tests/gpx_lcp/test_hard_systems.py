"""Systems at the edge of what has an answer, and what must not matter: Painlevé's rod, driven walls, order, units."""

import math

import numpy as np
import pytest
import scipy.sparse

import gpx_lcp as gpx
from gpx_lcp import scenes

STEP = 1 / 240
TOLERANCE = 1e-8

both_solvers = pytest.mark.parametrize("solver", ["newton", "interior_point"])


def system_of(scene):
    return gpx.World(scene, STEP).system()


def body_velocities(system, solution):
    moved = system.free_velocity + system.body_velocity_change(solution.impulse).reshape(-1)
    return moved.reshape(len(system.inverse_mass), -1)


# Painlevé's rod: A in units of 1/m, tip's slip along t1


def painleve(friction, approach, slip=4.0, rows=3):
    """Return a uniform rod of 1 kg, tan θ = 2 to the plane, whose tip closes with `approach` and slides with `slip`.

    With half-length l and I = m l²/3 its tip has A_nn = 1 + 3 cos²θ = 8/5, A_tt = 1 + 3 sin²θ = 17/5,
    A_nt = 3 sinθ cosθ = 6/5 and, across, 1 + 3 = 4. Friction against the slip presses the tip into the plane:
    A_nn - μ A_nt < 0 from μ = 4/3 on.
    """
    A = np.array([[8 / 5, 6 / 5, 0.0], [6 / 5, 17 / 5, 0.0], [0.0, 0.0, 4.0]])
    return gpx.StackedSystem(A[:rows, :rows], [approach, -slip, 0.0][:rows], [friction])


@both_solvers
@pytest.mark.parametrize("rows", [2, 3])
@pytest.mark.parametrize("below", [0.3, 0.01])
def test_painleve_rod_slides_on_below_its_threshold(solver, rows, below):
    """The only solution is p_n = B_n / (A_nn - μ A_nt), p_t = -μ p_n, and the tip goes on sliding."""
    mu, approach, slip = 4 / 3 - below, 0.01, 4.0
    normal = approach / (8 / 5 - 6 / 5 * mu)
    solution = gpx.solve(painleve(mu, approach, slip, rows), "coulomb", solver, tolerance=TOLERANCE)
    assert solution.status is gpx.Status.SOLVED
    assert solution.certificate.natural_map <= TOLERANCE
    np.testing.assert_allclose(solution.impulse[0, :2], [normal, -mu * normal], rtol=1e-5)
    slides = slip + (6 / 5 - 17 / 5 * mu) * normal
    assert slides > 0.0
    np.testing.assert_allclose(solution.velocity[0, :2], [0.0, slides], rtol=1e-5, atol=1e-7)


@both_solvers
@pytest.mark.parametrize("rows", [2, 3])
@pytest.mark.parametrize("above", [0.01, 0.3, 5.0])
def test_painleve_rod_stops_at_once_above_its_threshold(solver, rows, above):
    """No force lets the tip slide on; the only solution is an impact without collision that stops it: A p = B."""
    mu, approach, slip = 4 / 3 + above, 0.01, 4.0
    system = painleve(mu, approach, slip, rows)
    solution = gpx.solve(system, "coulomb", solver, tolerance=TOLERANCE)
    assert solution.status is gpx.Status.SOLVED
    assert solution.certificate.natural_map <= TOLERANCE
    stop = np.array([17 / 5 * approach + 6 / 5 * slip, -8 / 5 * slip - 6 / 5 * approach]) / 4.0
    assert abs(stop[1]) <= mu * stop[0]
    np.testing.assert_allclose(solution.impulse[0, :2], stop, rtol=1e-6)
    np.testing.assert_allclose(solution.velocity, 0.0, atol=1e-7)


@both_solvers
def test_painleve_rod_that_is_leaving_above_its_threshold_leaves(solver):
    """Three solutions: it leaves (p = 0), it slides on with p_n = -B_n / (μ A_nt - A_nn), or it jams and stops.

    Both solvers give the first, which needs no impulse.
    """
    mu, approach, slip = 4 / 3 + 0.3, -0.01, 4.0
    system = painleve(mu, approach, slip)
    sliding = -approach / (6 / 5 * mu - 8 / 5)
    jam = np.array([17 / 5 * approach + 6 / 5 * slip, -8 / 5 * slip - 6 / 5 * approach]) / 4.0
    for impulse in ([0.0, 0.0, 0.0], [sliding, -mu * sliding, 0.0], [*jam, 0.0]):
        assert gpx.certify(system, [impulse]).natural_map <= 1e-14
    solution = gpx.solve(system, "coulomb", solver, tolerance=TOLERANCE)
    assert solution.status is gpx.Status.SOLVED
    assert not solution.impulse.any()


@pytest.mark.parametrize("seed", range(3))
def test_newton_solves_a_struck_pyramid_from_where_sweeps_end(seed):
    solution = gpx.solve(tumbling(scenes.pyramid(8), seed), "coulomb", "newton", tolerance=TOLERANCE)
    assert solution.status is gpx.Status.SOLVED
    assert solution.iterations <= 60
    assert "gauss_seidel" in solution.fallbacks and "interior_point" not in solution.fallbacks


# No solution at all


def tumbling_wall(rows, seed, planar=False):
    """Return the first step of a wall whose bricks start with random velocities, all of them or those in its plane."""
    return tumbling(scenes.wall(rows), seed, planar)


def tumbling(scene, seed, planar=False):
    """Return the first step of a scene whose bodies start with random velocities."""
    rest = system_of(scene)
    random = np.random.default_rng(seed).normal(size=(len(rest.inverse_mass), 6))
    if planar:
        random[:, [1, 3, 5]] = 0.0
    free = rest.free_velocity + random.reshape(-1)
    return gpx.StackedSystem.from_jacobian(
        rest.jacobian, rest.inverse_mass, -(rest.jacobian @ free), rest.friction, free_velocity=free
    )


def require_infeasible(system, solver):
    """Verify y without the solver's help: in the cone, A y = 0 and Bᵀ y > 0, so that A p - B cannot be in K*."""
    solution = gpx.solve(system, "coulomb", solver, tolerance=TOLERANCE)
    assert solution.status is gpx.Status.INFEASIBLE
    # The proof is looked for before the long runs of proximal Newton, not after them.
    assert solution.iterations <= 200
    assert np.isfinite(solution.impulse).all()
    y = solution.extras["infeasibility"]
    assert y.shape == (system.contacts, system.rows)
    assert (y[:, 0] >= 0.0).all()
    assert not y[:, 1:].any()
    assert y[:, 0].max() == 1.0
    assert system.B @ y.reshape(-1) > 0.0
    np.testing.assert_allclose(system.apply(y), 0.0, atol=1e-7 * system.scale.max())


@both_solvers
@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e6])
def test_two_walls_that_close_on_a_body_have_no_solution(solver, scale):
    """A = [[1, -1], [-1, 1]], B = (1, 1): y = (1, 1)."""
    system = gpx.StackedSystem(np.array([[1.0, -1.0], [-1.0, 1.0]]) * scale, [1.0, 1.0], [0.0, 0.0])
    solution = gpx.solve(system, "normal", solver, tolerance=TOLERANCE)
    assert solution.status is gpx.Status.INFEASIBLE
    y = solution.extras["infeasibility"][:, 0]
    np.testing.assert_allclose(y, 1.0, rtol=1e-6)
    np.testing.assert_allclose(system.A @ y, 0.0, atol=1e-5 * scale)
    assert system.B @ y > 0.0


def driven_walls(closing, friction=0.5, angle=0.0):
    """Return the system of `wedge(angle)` whose walls also close with this speed along their normals, and slide."""
    rest = system_of(scenes.wedge(angle, friction))
    B = rest.B.reshape(-1, 3).copy()
    B[:, 0] += closing
    B[:4, 1:] += [0.3, -0.2]
    return gpx.StackedSystem.from_jacobian(rest.jacobian, rest.inverse_mass, B.reshape(-1), rest.friction)


@both_solvers
@pytest.mark.parametrize("friction", [0.1, 0.5, 2.0])
@pytest.mark.parametrize("closing", [1e-3, 1.0, 1e3])
def test_walls_driven_into_a_block_in_space_have_no_solution(solver, friction, closing):
    """Eight contacts with friction: equal normal impulses on both walls move nothing, and Bᵀ y = 8 × closing."""
    system = driven_walls(closing, friction)
    require_infeasible(system, solver)
    bare = gpx.StackedSystem(system.A, system.B, system.friction)
    require_infeasible(bare, solver)


@both_solvers
def test_a_groove_driven_together_throws_the_block_out(solver):
    """Where friction < tan(angle) the block can always leave upwards: feasible at any speed, and solved."""
    solution = gpx.solve(driven_walls(1.0, 0.1, angle=0.3), "coulomb", solver, tolerance=TOLERANCE)
    assert solution.status is gpx.Status.SOLVED
    assert solution.certificate.natural_map <= TOLERANCE


def side_by_side(*systems):
    """Return systems that do not touch each other as one."""
    return gpx.StackedSystem.from_jacobian(
        scipy.sparse.block_diag([each.jacobian.tocoo() for each in systems]),
        np.concatenate([each.inverse_mass for each in systems]),
        np.concatenate([each.B for each in systems]),
        np.concatenate([each.friction for each in systems]),
    )


@both_solvers
def test_a_jam_beside_a_tower_is_found(solver):
    require_infeasible(side_by_side(system_of(scenes.tower(5)), driven_walls(1.0)), solver)


@both_solvers
def test_a_jam_beside_a_tumbling_wall_is_found(solver):
    require_infeasible(side_by_side(tumbling_wall(3, 0), driven_walls(0.01)), solver)


@both_solvers
def test_a_groove_that_friction_locks_is_not_called_solved(solver):
    """A point mass between walls at an angle α that close on it, with μ > tan α: no solution, and no simple proof.

    Not to be run through it has to leave upwards, v_z sin α >= 1. Then it slips up both walls, and the vertical
    impulse of each is p_n (sin α - μ cos α) < 0. Without friction it would leave, so that no frictionless y exists.
    """
    angle, friction = 0.3, 0.5
    sine, cosine = math.sin(angle), math.cos(angle)
    jacobian = [[side * cosine, 0.0, sine, 0.0, side, 0.0, -side * sine, 0.0, cosine] for side in (1.0, -1.0)]
    B = np.array([[1.0, 0.0, 0.0]] * 2)
    system = gpx.StackedSystem.from_jacobian(np.reshape(jacobian, (6, 3)), np.ones(3), B.reshape(-1), [friction] * 2)
    solution = gpx.solve(system, "coulomb", solver, tolerance=TOLERANCE)
    assert solution.status not in (gpx.Status.SOLVED, gpx.Status.INFEASIBLE)
    assert solution.certificate.natural_map > 1e-3
    assert np.isfinite(solution.impulse).all()


# Order, repetition and units


def reordered(system, order):
    rows = (3 * order[:, None] + np.arange(3)).reshape(-1)
    return gpx.StackedSystem.from_jacobian(
        system.jacobian.tocsr()[rows],
        system.inverse_mass,
        system.B[rows],
        system.friction[order],
        free_velocity=system.free_velocity,
    )


def spread_over_orders(system, formulation, solver, tolerance=TOLERANCE):
    """Return how far the bodies' velocities differ over four orders of the contacts, m/s and rad/s."""
    rng = np.random.default_rng(5)
    velocities = []
    for order in [np.arange(system.contacts), *(rng.permutation(system.contacts) for _ in range(3))]:
        mixed = reordered(system, order)
        solution = gpx.solve(mixed, formulation, solver, tolerance=tolerance)
        assert solution.status is gpx.Status.SOLVED
        velocities.append(body_velocities(mixed, solution))
    return np.ptp(velocities, axis=0).max()


@both_solvers
@pytest.mark.parametrize(
    "scene",
    [scenes.tower(20), scenes.table(9), scenes.arch(), scenes.card_house(), scenes.bricks(4, 1.001)],
    ids=["tower", "table", "arch", "card house", "toppling bricks"],
)
def test_the_order_of_contacts_changes_no_velocity(solver, scene):
    """The tolerance bounds the residual relative to ‖B‖, and velocities are no better: nine digits need nine."""
    assert spread_over_orders(system_of(scene), "coulomb", solver, tolerance=1e-9) <= 1e-9


@both_solvers
@pytest.mark.parametrize("velocities", ["any", "planar"])
def test_the_order_of_contacts_changes_no_velocity_of_a_tumbling_wall(solver, velocities):
    """Sliding walls have several exact solutions: the core puts contacts in an order of its own before it starts."""
    assert spread_over_orders(tumbling_wall(4, 0, planar=velocities == "planar"), "coulomb", solver) <= 1e-9


@both_solvers
def test_the_order_of_rows_and_columns_of_a_changes_no_velocity(solver):
    given = tumbling_wall(4, 0)
    order = np.random.default_rng(1).permutation(given.contacts)
    rows = (3 * order[:, None] + np.arange(3)).reshape(-1)
    system = gpx.StackedSystem(given.A, given.B, given.friction)
    mixed = gpx.StackedSystem(given.A[rows][:, rows], given.B[rows], given.friction[order])
    first, second = (gpx.solve(each, "coulomb", solver, tolerance=TOLERANCE) for each in (system, mixed))
    assert first.status is second.status is gpx.Status.SOLVED
    np.testing.assert_allclose(second.velocity, first.velocity[order], atol=1e-9)


@both_solvers
@pytest.mark.parametrize("formulation", ["normal", "cone"])
def test_the_order_of_contacts_changes_no_velocity_of_a_tumbling_wall_by_a_convex_law(solver, formulation):
    """Convex programs have one velocity; 1e-9 m/s of it need a tighter tolerance where much slides."""
    assert spread_over_orders(tumbling_wall(4, 0), formulation, solver, tolerance=1e-12) <= 1e-9


@both_solvers
@pytest.mark.parametrize("scene", [scenes.arch(), scenes.card_house()], ids=["arch", "card house"])
def test_the_same_input_gives_the_same_bits(solver, scene):
    first, second = (gpx.solve(system_of(scene), "coulomb", solver, tolerance=TOLERANCE) for _ in range(2))
    assert first.impulse.tobytes() == second.impulse.tobytes()
    assert first.iterations == second.iterations


def in_other_units(system, mass, time):
    """Return the system whose masses are larger by one factor and whose times by another."""
    return gpx.StackedSystem.from_jacobian(
        system.jacobian,
        system.inverse_mass / mass,
        system.B / time,
        system.friction,
        free_velocity=system.free_velocity / time,
    )


several_scenes = pytest.mark.parametrize(
    "scene", [scenes.arch(), scenes.bricks(4, 1.001), scenes.table(9)], ids=["arch", "toppling bricks", "table"]
)


@both_solvers
@pytest.mark.parametrize("mass", [1e-6, 1e6])
@pytest.mark.parametrize("time", [1e-6, 1e6])
@several_scenes
def test_units_of_mass_and_time_change_no_velocity(solver, mass, time, scene):
    """Velocities scale with 1 / time; impulses need not agree, where several are exact."""
    one = system_of(scene)
    other = in_other_units(one, mass, time)
    first, second = (gpx.solve(each, "coulomb", solver, tolerance=TOLERANCE) for each in (one, other))
    assert first.status is second.status is gpx.Status.SOLVED
    np.testing.assert_allclose(body_velocities(other, second) * time, body_velocities(one, first), atol=1e-8)


@both_solvers
@pytest.mark.parametrize("mass", [2.0**-20, 2.0**20])
@pytest.mark.parametrize("time", [2.0**-20, 2.0**20])
@several_scenes
def test_units_that_are_powers_of_two_change_no_digit(solver, mass, time, scene):
    """Impulses scale with mass / time."""
    # Both are made here: the square roots of M⁻¹ that a World takes differ in the last digit.
    one, other = (in_other_units(system_of(scene), *units) for units in ((1.0, 1.0), (mass, time)))
    first, second = (gpx.solve(each, "coulomb", solver) for each in (one, other))
    np.testing.assert_array_equal(second.impulse * time / mass, first.impulse)
    assert first.iterations == second.iterations


@both_solvers
def test_a_falling_arch_falls_the_same_way_twice(solver):
    worlds = [gpx.World(scenes.arch(friction=0.25), STEP, solver=solver) for _ in range(2)]
    for world in worlds:
        world.step(8)
    assert worlds[0].positions.tobytes() == worlds[1].positions.tobytes()
    assert worlds[0].velocities.tobytes() == worlds[1].velocities.tobytes()


@pytest.mark.parametrize("solver", ["interior_point", "newton"])
def test_a_contact_between_locked_bodies_opens_or_cannot_be(solver):
    """Nothing moves the second contact: it is solved where it separates, and proved infeasible where it closes."""
    A = np.zeros((6, 6))
    A[:3, :3] = np.eye(3)
    opening = gpx.solve(gpx.StackedSystem(A, [1.0, 0.1, 0.0, -1.0, 3.0, 0.0], [0.5, 0.5]), "coulomb", solver)
    assert opening.status is gpx.Status.SOLVED
    closing = gpx.solve(gpx.StackedSystem(A, [1.0, 0.1, 0.0, 1.0, 0.0, 0.0], [0.5, 0.5]), "coulomb", solver)
    assert closing.status is gpx.Status.INFEASIBLE
    np.testing.assert_array_equal(closing.extras["infeasibility"], [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]])

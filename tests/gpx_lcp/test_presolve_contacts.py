"""Presolve: contacts that are left out, because they are out of reach or kept open by others; systems given by A."""

import numpy as np
import pytest
import scipy.sparse as sp
from hypothesis import given
from hypothesis import strategies as st

import gpx_lcp as gpx

STEP = 1 / 240
LAWS = ("normal", "cone", "coulomb")


def assert_same_velocities(system, formulation=None):
    """Both ways are solved to 1e-12 and agree to 1e-10 of the largest velocity; what is left out has no impulse."""
    plain = gpx.solve(system, formulation, tolerance=1e-12, presolve=False)
    smaller = gpx.solve(system, formulation, tolerance=1e-12)
    assert smaller.program_residual <= max(1e-12, plain.program_residual)
    largest = np.abs(system.B).max(initial=0.0)
    np.testing.assert_allclose(smaller.velocity, plain.velocity, rtol=0, atol=1e-10 * largest)
    return smaller


def removed(report):
    """Contacts removed, by the name of the reduction."""
    return {item.name: item.removed.contacts for item in report.reductions if item.removed.contacts}


def balls_on_a_floor(heights, sideways=(), friction=0.5):
    """Point masses above a floor, neighbours `sideways` apart; what a detection with a wide margin would give."""
    n, rows, gaps = len(heights), [], []
    for ball, height in enumerate(heights):
        block = np.zeros((3, 3 * n))
        block[:, 3 * ball : 3 * ball + 3] = np.eye(3)[[2, 0, 1]]
        rows.append(block)
        gaps.append(height)
    for ball, gap in enumerate(sideways):
        block = np.zeros((3, 3 * n))
        block[:, 3 * ball + 3 : 3 * ball + 6] = np.eye(3)
        block[:, 3 * ball : 3 * ball + 3] = -np.eye(3)
        rows.append(block)
        gaps.append(gap)
    free = np.tile([0.0, 0.0, -9.81 * STEP], n)
    jacobian = np.vstack(rows)
    B = -jacobian @ free
    B[::3] -= np.array(gaps) / STEP
    inverse = np.repeat(1.0 / np.arange(1.0, n + 1.0), 3)
    friction = np.full(len(rows), friction)
    return gpx.StackedSystem.from_jacobian(sp.csr_array(jacobian), inverse, B, friction, free_velocity=free)


@pytest.mark.parametrize("formulation", LAWS)
def test_neighbours_out_of_reach_are_left_out_and_their_islands_fall_apart(formulation):
    """No impulse can bring balls that fall at 4 cm/s through 1 m in a step."""
    system = balls_on_a_floor([0.0] * 6, [1.0] * 5)
    solution = assert_same_velocities(system, formulation)
    assert solution.presolve.islands == 1
    assert removed(solution.presolve) == {"inactive": 5, "closed form": 6}
    np.testing.assert_array_equal(solution.impulse[6:], 0.0)
    np.testing.assert_allclose(solution.impulse[:6, 0], 9.81 * STEP * np.arange(1, 7), rtol=1e-13)


def test_what_can_be_reached_stays():
    """Two unit masses: the first runs at 1 m/s, and both its energy and its path allow it to reach the second."""
    jacobian = np.array([[-1.0, 1.0]])
    for gap, count in ((0.5 * STEP, 1), (1.5 * STEP, 0)):
        free = np.array([1.0, 0.0])
        B = -jacobian @ free - gap / STEP
        wall = gpx.StackedSystem.from_jacobian(
            np.vstack((jacobian, [[0.0, -1.0]])), np.ones(2), [*B, 0.0], np.zeros(2), free_velocity=free
        )
        assert removed(gpx.presolve(wall)).get("inactive", 0) == 2 * (1 - count)


def test_reach_is_found_without_the_velocities():
    jacobian = balls_on_a_floor([0.0] * 3, [0.2] * 2)
    blind = gpx.StackedSystem.from_jacobian(jacobian.jacobian, jacobian.inverse_mass, jacobian.B, jacobian.friction)
    by_matrix = gpx.StackedSystem(jacobian.A, jacobian.B, jacobian.friction)
    for system in (blind, by_matrix):
        assert removed(assert_same_velocities(system).presolve) == {"inactive": 2, "closed form": 3}


def bodies_with_gaps(rng, bodies, contacts, speed, friction):
    """Random rows between random bodies and the ground, some closed and some apart."""
    jacobian, gaps = np.zeros((3 * contacts, 6 * bodies)), np.zeros(contacts)
    for contact in range(contacts):
        frame = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        lines = slice(3 * contact, 3 * contact + 3)
        first = int(rng.integers(0, bodies))
        jacobian[lines, 6 * first : 6 * first + 6] = np.hstack((frame, rng.normal(size=(3, 3))))
        second = int(rng.integers(0, bodies + 1))
        if second not in (first, bodies):
            jacobian[lines, 6 * second : 6 * second + 6] = -np.hstack((frame, rng.normal(size=(3, 3))))
        gaps[contact] = max(0.0, rng.normal(scale=3.0 * speed * STEP))
    free = speed * rng.normal(size=6 * bodies)
    B = -jacobian @ free
    B[::3] -= gaps / STEP
    roots = rng.normal(size=(bodies, 6, 6))
    inverse = roots @ roots.transpose(0, 2, 1) + np.eye(6)
    mu = friction * rng.uniform(0.0, 1.0, contacts)
    return gpx.StackedSystem.from_jacobian(sp.csr_array(jacobian), inverse, B, mu, free_velocity=free)


@given(st.integers(0, 10**6), st.sampled_from(LAWS), st.booleans())
def test_random_gaps_keep_their_velocities(seed, formulation, by_matrix):
    """Coulomb's law at coefficients small enough for one solution."""
    rng = np.random.default_rng(seed)
    friction = 0.02 if formulation == "coulomb" else 0.8
    system = bodies_with_gaps(rng, int(rng.integers(1, 5)), int(rng.integers(1, 10)), 2.0, friction)
    if by_matrix:
        system = gpx.StackedSystem(system.A, system.B, system.friction)
    assert_same_velocities(system, formulation)


@given(st.integers(0, 10**6), st.sampled_from(LAWS))
def test_impulses_stay_in_the_ball(seed, formulation):
    """‖w - c/2‖ ≤ ‖c‖/2 with c a stop of all bodies: no impulse adds to their kinetic energy."""
    rng = np.random.default_rng(seed)
    system = bodies_with_gaps(rng, int(rng.integers(1, 5)), int(rng.integers(1, 10)), 2.0, 0.8)
    solution = gpx.solve(system, formulation, tolerance=1e-12, presolve=False)
    if solution.status is not gpx.Status.SOLVED:
        return
    mass = np.linalg.inv(system.inverse_mass)
    free = system.free_velocity.reshape(-1, 6)
    after = free + system.body_velocity_change(solution.impulse).reshape(-1, 6)
    before, left = (np.einsum("bi,bij,bj->", v, mass, v) for v in (free, after))
    assert left <= before * (1.0 + 1e-9)


def plate(friction, rows=3, tilt=0.0, gap=None):
    """A plate on a grid of points, its centre of mass above one of its quarters."""
    places = [(0.5 * i - 0.3, 0.5 * j - 0.4) for i in range(rows) for j in range(rows)]
    frame = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    jacobian = np.vstack([np.hstack((frame, np.cross([x, y, -0.1], frame))) for x, y in places])
    free = np.array([0.02, 0.01, -0.04, tilt, 0.0, 0.0])
    B = -jacobian @ free
    if gap is not None:
        B[::3] -= gap
    inverse = np.diag([1.0, 1.0, 1.0, 3.0, 4.0, 5.0])
    return gpx.StackedSystem.from_jacobian(jacobian, [inverse], B, np.full(len(places), friction))


CORNERS, REST = [0, 2, 6, 8], [1, 3, 4, 5, 7]


@pytest.mark.parametrize(("formulation", "friction"), [("normal", 0.5), ("coulomb", 0.0), ("cone", 0.5)])
@pytest.mark.parametrize("tilt", [0.0, 0.1])
def test_corners_carry_a_plate(formulation, friction, tilt):
    solution = assert_same_velocities(plate(friction, tilt=tilt), formulation)
    assert removed(solution.presolve)["redundant"] == 5
    np.testing.assert_array_equal(solution.impulse[REST], 0.0)
    assert (solution.impulse[CORNERS, 0] > 0.0).any()


def test_friction_by_coulombs_law_keeps_every_contact():
    assert "redundant" not in removed(gpx.presolve(plate(0.5), "coulomb"))


def test_a_point_that_closes_first_is_not_redundant():
    """The centre of the plate is a bump of 2 mm: the corners are apart, and do not keep it open."""
    gap = np.full(9, 2e-3 / STEP)
    gap[4] = 0.0
    solution = assert_same_velocities(plate(0.0, gap=gap))
    assert solution.impulse[4, 0] > 0.0
    np.testing.assert_array_equal(solution.impulse[[0, 1, 2, 3, 5, 6, 7, 8], 0], 0.0)


def test_points_on_an_edge_are_redundant_and_duplicates_of_corners_are_not():
    line = plate(0.0, rows=3)
    blocks = line.jacobian.toarray().reshape(9, 3, 6)
    chosen = blocks[[0, 1, 2, 2]].reshape(-1, 6)
    B = line.B.reshape(9, 3)[[0, 1, 2, 2]].reshape(-1)
    system = gpx.StackedSystem.from_jacobian(chosen, line.inverse_mass, B, np.zeros(4))
    solution = assert_same_velocities(system)
    assert removed(solution.presolve)["redundant"] == 1
    assert solution.impulse[1, 0] == 0.0
    assert solution.impulse[2, 0] == solution.impulse[3, 0] > 0.0


@given(st.integers(0, 10**6), st.sampled_from(LAWS[:2]))
def test_random_points_on_a_face_keep_their_velocities(seed, formulation):
    rng = np.random.default_rng(seed)
    frame = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    count = int(rng.integers(2, 12))
    # On a grid, so that some lie on edges and some on each other.
    places = rng.integers(0, 4, size=(count, 2)) @ frame[1:] - 0.3 * frame[0] - rng.normal(size=3)
    jacobian = np.vstack([np.hstack((frame, np.cross(place, frame))) for place in places])
    free = rng.normal(size=6)
    B = -jacobian @ free
    B[::3] -= np.where(rng.random(count) < 0.3, rng.random(count), 0.0)
    system = gpx.StackedSystem.from_jacobian(jacobian, rng.uniform(0.5, 2.0, 6), B, np.full(count, 0.4))
    assert_same_velocities(system, formulation)


def test_a_matrix_falls_into_its_blocks():
    parts = [balls_on_a_floor([0.0] * n) for n in (1, 2, 3)]
    matrix = sp.block_diag([part.A for part in parts]).toarray()
    B, friction = (np.concatenate([getattr(part, name) for part in parts]) for name in ("B", "friction"))
    order = np.random.default_rng(1).permutation(len(friction))
    rows = (3 * order[:, None] + np.arange(3)).reshape(-1)
    for form in (np.ascontiguousarray, sp.csr_array):
        system = gpx.StackedSystem(form(matrix[np.ix_(rows, rows)]), B[rows], friction[order])
        solution = assert_same_velocities(system)
        assert solution.presolve.islands == 6
        assert solution.presolve.after == (0, 0, 0)
        assert solution.iterations == 0


@given(st.integers(0, 10**6), st.sampled_from(LAWS))
def test_random_blocks_of_a_matrix_keep_their_velocities(seed, formulation):
    rng = np.random.default_rng(seed)
    sizes = rng.integers(1, 5, size=int(rng.integers(1, 4)))
    blocks = [rng.normal(size=(3 * n, 3 * n + 3)) for n in sizes]
    matrix = sp.block_diag([block @ block.T for block in blocks]).toarray()
    count = int(sizes.sum())
    friction = 0.02 if formulation == "coulomb" else 0.5
    system = gpx.StackedSystem(matrix, rng.normal(size=3 * count), np.full(count, friction))
    assert_same_velocities(system, formulation)
    assert gpx.presolve(system, formulation).islands == len(sizes)


def test_a_matrix_without_friction_keeps_its_normal_rows():
    rng = np.random.default_rng(2)
    block = rng.normal(size=(12, 18))
    system = gpx.StackedSystem(block @ block.T, rng.uniform(0.5, 1.0, 12), np.zeros(4))
    solution = assert_same_velocities(system, "cone")
    assert solution.presolve.before == (4, 12, 0)
    assert solution.presolve.after == (4, 4, 0)
    assert [item.name for item in solution.presolve.reductions] == ["frictionless"]


def test_a_matrix_that_is_not_symmetric_keeps_its_contacts():
    """Energy says nothing of it."""
    even = balls_on_a_floor([0.0] * 2, [0.2])
    matrix = even.A.toarray()
    matrix[4, 6] *= 1.001
    skew = gpx.StackedSystem(matrix, even.B, even.friction)
    assert "inactive" in removed(gpx.presolve(gpx.StackedSystem(even.A, even.B, even.friction)))
    assert "inactive" not in removed(gpx.presolve(skew))


@pytest.mark.parametrize("friction", [0.0, 0.5])
def test_a_world_leaves_out_what_is_out_of_reach(friction):
    """A ball slides along a wall at 10 m/s, and half of that at most can turn against the wall."""
    scene, material = gpx.Scene(), gpx.Material(friction=friction)
    scene.add_static(gpx.HalfSpace(), material=material)
    scene.add_static(gpx.Box(50, 1, 5), position=(0.0, 1.0 + 0.75 * 10.0 * STEP, 0.0), material=material)
    scene.add_rigid(gpx.Sphere(0.5), 1.0, position=(0.0, 0.0, 0.5), velocity=(10.0, 0.0, 0.0), material=material)
    world = gpx.World(scene, time_step=STEP, warm_start=False)
    world.step()
    assert world.solution.system.contacts == 2
    assert removed(world.solution.presolve) == {"inactive": 1, "closed form": 1}
    assert_same_velocities(world.solution.system)

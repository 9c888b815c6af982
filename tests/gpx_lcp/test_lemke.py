import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp
from hypothesis import given
from hypothesis import strategies as st

import gpx_lcp as gpx
from formulations import LCP


def test_a_positive_right_hand_side_needs_no_pivot():
    solution = gpx.solve_lcp(np.eye(3), [1.0, 2.0, 0.0])
    assert solution.status is gpx.Status.SOLVED
    assert solution.iterations == 0
    np.testing.assert_array_equal(solution.z, 0.0)


def test_known_answer_on_paper():
    solution = gpx.solve_lcp([[2.0, 1.0], [1.0, 2.0]], [-5.0, -6.0])
    np.testing.assert_allclose(solution.z, [4 / 3, 7 / 3], rtol=1e-14)
    np.testing.assert_allclose(solution.w, 0.0, atol=1e-14)


@given(st.integers(1, 12), st.integers(0, 10**6))
def test_positive_definite_problems_are_solved(size, seed):
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(size, size))
    solution = gpx.solve_lcp(root @ root.T + 1e-3 * np.eye(size), rng.normal(size=size), tolerance=1e-10)
    assert solution.status is gpx.Status.SOLVED
    assert (solution.z >= 0.0).all()


@given(st.integers(2, 10), st.integers(1, 4), st.integers(0, 10**6))
def test_degenerate_semidefinite_problems_are_solved(size, rank, seed):
    """Redundant rows, whole numbers and repeated ratios: ties at every pivot, which must not cycle."""
    rng = np.random.default_rng(seed)
    root = rng.integers(-1, 2, size=(size, min(rank, size))).astype(float)
    M = root @ root.T
    q = -M @ rng.integers(0, 2, size=size)
    solution = gpx.solve_lcp(M, q, tolerance=1e-10)
    assert solution.status is gpx.Status.SOLVED


@pytest.mark.parametrize("scale", [1e-12, 1.0, 1e12])
def test_units_do_not_matter(scale):
    rng = np.random.default_rng(3)
    root = rng.normal(size=(6, 3))
    M, q = root @ root.T, -root @ rng.normal(size=3)
    one = gpx.solve_lcp(M, q)
    other = gpx.solve_lcp(scale * M, q / scale)
    assert other.status is gpx.Status.SOLVED
    assert other.iterations == one.iterations
    np.testing.assert_allclose(other.z * scale**2, one.z, rtol=1e-8)


def test_driven_walls_are_infeasible_with_a_certificate():
    """Two contacts with opposite normals on one body, both closing: F13 of the failure modes, y = (1, 1)."""
    M, q = np.array([[1.0, -1.0], [-1.0, 1.0]]), np.array([-1.0, -1.0])
    solution = gpx.solve_lcp(M, q)
    assert solution.status is gpx.Status.INFEASIBLE
    np.testing.assert_allclose(solution.infeasibility, [1.0, 1.0])
    assert LCP(M, q).proves_infeasible(solution.infeasibility)
    assert np.isfinite(solution.z).all()


def test_infeasible_contacts_return_an_impulse_direction_that_proves_it():
    system = gpx.StackedSystem.from_jacobian([[1.0], [-1.0]], [0.5], [1.0, 1.0], [0.0, 0.0])
    solution = gpx.solve(system, "normal", "lemke")
    assert solution.status is gpx.Status.INFEASIBLE
    y = solution.extras["infeasibility"]
    assert (y >= 0.0).all()
    np.testing.assert_allclose(system.apply(y), 0.0, atol=1e-12)
    assert np.sum(y.ravel() * system.B) > 0.0


def test_a_ray_that_proves_nothing_is_not_called_infeasible():
    """z = (1, 1) solves it, but M is not copositive-plus and Lemke ends in a ray."""
    M, q = np.array([[-1.0, 2.0], [2.0, -1.0]]), np.array([-1.0, -1.0])
    solution = gpx.solve_lcp(M, q)
    assert LCP(M, q).residual(np.array([1.0, 1.0])) == 0.0
    assert solution.status is gpx.Status.STALLED
    assert solution.infeasibility is None


def test_the_limit_of_pivots_is_a_status():
    rng = np.random.default_rng(0)
    root = rng.normal(size=(8, 8))
    solution = gpx.solve_lcp(root @ root.T, -np.ones(8), max_iterations=1)
    assert solution.status is gpx.Status.MAX_ITERATIONS
    assert np.isfinite(solution.z).all()


@pytest.mark.parametrize("size", range(2, 9))
def test_murtys_exponential_family(size):
    """M lower triangular with 2 below a unit diagonal, q = -1: a P-matrix, unique z = (1, 0, …, 0)."""
    M = 2.0 * np.tril(np.ones((size, size)), -1) + np.eye(size)
    solution = gpx.solve_lcp(M, -np.ones(size))
    assert solution.status is gpx.Status.SOLVED
    np.testing.assert_allclose(solution.z, np.eye(size)[0], atol=1e-12)


@pytest.mark.parametrize(
    ("M", "q", "options", "error", "message"),
    [
        (np.eye(2), [1.0], {}, gpx.ProblemError, r"M has shape \(2, 2\) but q has length 1"),
        ([[np.nan]], [1.0], {}, gpx.ProblemError, r"M\[0, 0\] is nan"),
        (np.eye(1), [np.inf], {}, gpx.ProblemError, r"q\[0\] is inf"),
        (np.eye(1), [1.0], {"tolerance": 0.0}, gpx.SettingsError, "tolerance is 0.0"),
    ],
)
def test_bad_input_is_refused(M, q, options, error, message):
    with pytest.raises(error, match=message):
        gpx.solve_lcp(M, q, **options)


def test_nothing_to_solve():
    assert gpx.solve_lcp(np.zeros((0, 0)), []).status is gpx.Status.SOLVED


@pytest.mark.parametrize("formulation", ["normal", "box", "pyramid"])
def test_every_form_of_random_contacts(formulation, random_system):
    for seed in range(5):
        solution = gpx.solve(random_system(seed), formulation, "lemke", tolerance=1e-9)
        assert solution.status is gpx.Status.SOLVED
        assert solution.program_residual <= 1e-9


@pytest.mark.parametrize(("formulation", "rows"), [("normal", 6), ("box", 4), ("pyramid", 3)])
def test_redundant_contacts_of_a_wall_tie_by_the_dozen(formulation, rows):
    system = gpx.World(gpx.scenes.wall(rows), time_step=1 / 240).system()
    solution = gpx.solve(system, formulation, "lemke", tolerance=1e-11, presolve=False)
    assert solution.status is gpx.Status.SOLVED
    assert np.abs(solution.velocity[:, 0]).max() < 1e-11


def test_the_nasty_problems(problems):
    files = sorted((problems / "lcp").glob("*.npz"))
    assert files
    for file in files:
        data = np.load(file)
        solution = gpx.solve_lcp(data["M"], data["q"], tolerance=1e-10)
        assert solution.status is gpx.Status.SOLVED, file.name


@pytest.mark.parametrize("formulation", ["pyramid", "box"])
def test_contacts_of_one_row_have_no_friction_to_pose(formulation):
    # Two masses of 1 kg on each other: loads 2 and 1, times the 0.5 m/s that only the ground's contact has to cancel.
    system = gpx.StackedSystem([[1.0, -1.0], [-1.0, 2.0]], [0.5, 0.0], [0.3, 0.3])
    solution = gpx.solve(system, formulation, "lemke")
    assert solution.status is gpx.Status.SOLVED
    np.testing.assert_allclose(solution.impulse, [[1.0], [0.5]], rtol=1e-14)


def apart(*systems):
    """Return these systems, given by A, as one, the contacts of each between those of the others."""
    contacts = [system.contacts for system in systems]
    order = np.argsort(np.concatenate([np.arange(n) / n for n in contacts]), kind="stable")
    rows = (systems[0].rows * order[:, None] + np.arange(systems[0].rows)).ravel()
    A = la.block_diag(*(sp.csr_array(system.A).toarray() for system in systems))[np.ix_(rows, rows)]
    B = np.concatenate([system.B for system in systems])[rows]
    return gpx.StackedSystem(A, B, np.concatenate([system.friction for system in systems])[order])


@pytest.mark.parametrize(("formulation", "contacts"), [("normal", 30), ("box", 8), ("pyramid", 8)])
def test_islands_are_solved_apart(formulation, contacts, random_system):
    """Four systems that know nothing of each other, their contacts in turns."""
    system = apart(*(random_system(seed, contacts, bodies=contacts // 2) for seed in range(4)))
    parts = gpx.solve(system, formulation, "lemke", tolerance=1e-11)
    whole = gpx.solve(system, formulation, "lemke", tolerance=1e-11, presolve=False)
    assert parts.status is whole.status is gpx.Status.SOLVED
    assert parts.presolve is not None
    assert parts.presolve.islands == 4
    assert whole.presolve is None
    if formulation == "normal":
        np.testing.assert_allclose(parts.velocity[:, 0], whole.velocity[:, 0], atol=1e-10)


def test_one_island_without_a_solution_is_said_of_all():
    walls = gpx.StackedSystem([[1.0, -1.0], [-1.0, 1.0]], [1.0, 1.0], [0.0, 0.0])
    system = apart(walls, gpx.StackedSystem([[2.0]], [3.0], [0.0]))
    solution = gpx.solve(system, "normal", "lemke")
    assert solution.status is gpx.Status.INFEASIBLE
    y = solution.extras["infeasibility"].ravel()
    assert system.B @ y > 0.0
    np.testing.assert_allclose(system.A @ y, 0.0, atol=1e-12)
    assert sorted(y) == [0.0, 1.0, 1.0]


def test_pivots_of_all_islands_are_limited_together(random_system):
    system = apart(*(random_system(seed) for seed in range(4)))
    needed = gpx.solve(system, "pyramid", "lemke").iterations
    solution = gpx.solve(system, "pyramid", "lemke", max_iterations=needed - 1)
    assert solution.iterations == needed - 1
    assert solution.status is gpx.Status.MAX_ITERATIONS

"""What `gpx.solve` promises whichever solver runs."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import gpx_lcp as gpx
from formulations import FORMULATIONS, RESIDUALS

# Our own solvers and the backends of the `bench` extra; qpsolvers may have found others, whose faults are their own.
TESTED = ("lemke", "interior_point", "pgs", "osqp", "clarabel", "daqp", "piqp", "proxqp", "scs")
INSTALLED = {name: row for name, row in gpx.solvers().items() if row.installed and name in TESTED}
PAIRS = [(formulation, name) for name, row in INSTALLED.items() for formulation in row.programs]


@pytest.fixture
def contact():
    """One contact that sticks: p = B / 2."""
    return gpx.StackedSystem(2.0 * np.eye(3), [1.0, 0.1, 0.0], [0.5])


@pytest.mark.parametrize(("formulation", "name"), PAIRS)
def test_every_solver_solves_a_sticking_contact(formulation, name, contact):
    solution = gpx.solve(contact, formulation, name, tolerance=1e-8, presolve=False)
    expected = [[0.5, 0.0, 0.0]] if formulation == "normal" else [[0.5, 0.05, 0.0]]
    np.testing.assert_allclose(solution.impulse, expected, atol=1e-8)
    assert solution.status is gpx.Status.SOLVED
    assert solution.method.endswith(f"/{name}")


@pytest.mark.parametrize(("formulation", "name"), PAIRS)
def test_solved_means_that_the_residual_holds(formulation, name, random_system):
    """The residual is computed here once more; a status may be anything else, but never wrongly SOLVED."""
    for seed in range(3):
        system = random_system(seed)
        solution = gpx.solve(system, formulation, name, tolerance=1e-7, time_limit=5.0)
        program = solution.method.split("/")[0]
        residual = RESIDUALS[program](system, solution.impulse, 8)
        assert (solution.status is gpx.Status.SOLVED) == (residual <= 1e-7)
        assert solution.program_residual == pytest.approx(residual, rel=1e-6, abs=1e-15)
        assert np.isfinite(solution.impulse).all()
        np.testing.assert_allclose(solution.velocity, system.velocity(solution.impulse), atol=1e-12)
        assert residual <= 1e-4


@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_no_contacts_and_nothing_to_stop_are_solved_at_once(formulation):
    empty = gpx.StackedSystem(np.zeros((0, 0)), [], [])
    solution = gpx.solve(empty, formulation)
    assert solution.status is gpx.Status.SOLVED
    assert solution.impulse.shape == (0, 3)
    still = gpx.solve(gpx.StackedSystem(np.eye(3), np.zeros(3), [0.5]), formulation)
    assert still.status is gpx.Status.SOLVED
    np.testing.assert_array_equal(still.impulse, 0.0)


def test_the_formulation_follows_from_the_friction(contact, column):
    assert gpx.solve(contact).method.startswith("coulomb/")
    assert gpx.solve(column(3)).method.startswith("normal/")
    assert gpx.solve(contact, solver="osqp").method == "pyramid_qp/osqp"


def test_the_table_prints_every_formulation_and_solver():
    text = repr(gpx.solvers())
    for word in (*FORMULATIONS, *INSTALLED):
        assert word in text
    assert "not installed" in text


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"formulation": "magic"}, "formulation is 'magic': it must be one of 'normal', 'box'"),
        ({"solver": "magic"}, "solver is 'magic': it must be one of lemke"),
        ({"formulation": "coulomb", "solver": "lemke"}, "lemke does not solve the formulation 'coulomb', only normal"),
        ({"tolerance": 0.0}, "tolerance is 0.0"),
        ({"tolerance": float("nan")}, "tolerance is nan"),
        ({"tolerance": "small"}, "tolerance is 'small'"),
        ({"max_iterations": -1}, "max_iterations is -1"),
        ({"max_iterations": 1.5}, "max_iterations is 1.5"),
        ({"time_limit": 0.0}, "time_limit is 0.0"),
        ({"facets": 2}, "facets is 2: a pyramid has at least 3"),
        ({"solver": "lemke", "formulation": "normal", "speed": 9}, "lemke has no setting 'speed'"),
        ({"solver": "lemke", "formulation": "normal", "warm_start": np.zeros((1, 3))}, "lemke cannot be warm-started"),
    ],
)
def test_bad_settings_are_refused(contact, options, message):
    with pytest.raises(gpx.SettingsError, match=message):
        gpx.solve(contact, **options)


@pytest.mark.parametrize(
    ("warm_start", "message"),
    [
        (np.zeros((2, 3)), r"warm_start has shape \(2, 3\), but \(1, 3\)"),
        (np.full((1, 3), np.nan), r"warm_start\[0, 0\] is nan"),
        ("cold", "warm_start is not an array"),
    ],
)
def test_a_wrong_warm_start_is_refused(contact, warm_start, message):
    with pytest.raises(gpx.ProblemError, match=message):
        gpx.solve(contact, solver="pgs", warm_start=warm_start)


def test_a_warm_start_outside_the_cone_is_projected_and_says_so(contact):
    solution = gpx.solve(contact, solver="pgs", warm_start=[[-1.0, 0.0, 0.0]])
    assert solution.extras["warm_start_moved"] == 1.0
    assert solution.status is gpx.Status.SOLVED
    assert gpx.solve(contact, solver="pgs", warm_start=[[1.0, 0.0, 0.0]]).extras["warm_start_moved"] == 0.0


def test_a_system_is_needed():
    with pytest.raises(gpx.ProblemError, match="system is a ndarray"):
        gpx.solve(np.eye(3))


def test_a_missing_backend_names_the_command_that_installs_it(contact):
    missing = [name for name, row in gpx.solvers().items() if not row.installed]
    assert missing
    with pytest.raises(gpx.BackendMissing, match=rf"pip install 'qpsolvers\[{missing[0]}\]'"):
        gpx.solve(contact, "normal", missing[0])


def test_a_backends_own_failure_becomes_a_backend_error(contact):
    with pytest.raises(gpx.BackendError, match="osqp failed"):
        gpx.solve(contact, "normal", "osqp", presolve=False, no_such_setting=1)


@given(st.integers(0, 10**6), st.sampled_from([-6, 0, 6]), st.sampled_from([-6, 0, 6]))
def test_units_of_mass_and_time_do_not_matter(seed, mass, time):
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(6, 8))
    A, B, friction = root @ root.T, rng.normal(size=6), rng.uniform(0.0, 1.0, 2)
    one = gpx.solve(gpx.StackedSystem(A, B, friction), "pyramid", "lemke")
    other = gpx.solve(gpx.StackedSystem(A / 10.0**mass, B * 10.0**time, friction), "pyramid", "lemke")
    assert one.status is other.status is gpx.Status.SOLVED
    np.testing.assert_allclose(
        other.impulse / 10.0 ** (mass + time), one.impulse, atol=1e-7 * np.abs(one.impulse).max() + 1e-12
    )


@given(st.integers(0, 10**6))
def test_the_order_of_contacts_does_not_change_the_velocities(seed):
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(9, 12))
    A, B, friction = root @ root.T, rng.normal(size=9), rng.uniform(0.0, 0.3, 3)
    order = rng.permutation(3)
    rows = (3 * order[:, None] + np.arange(3)).ravel()
    one = gpx.solve(gpx.StackedSystem(A, B, friction), "cone", "clarabel", tolerance=1e-9)
    other = gpx.solve(
        gpx.StackedSystem(A[np.ix_(rows, rows)], B[rows], friction[order]), "cone", "clarabel", tolerance=1e-9
    )
    np.testing.assert_allclose(other.velocity, one.velocity[order], atol=1e-6 * np.abs(B).max())


@pytest.mark.parametrize("formulation", ["normal", "cone", "coulomb"])
def test_unnamed_solver_depends_on_the_warm_start(bricks, formulation):
    system = bricks(3)
    cold = gpx.solve(system, formulation)
    assert cold.method.endswith("/interior_point")
    warm = gpx.solve(system, formulation, warm_start=cold.impulse)
    assert warm.method.endswith("/newton")
    assert warm.extras["factorisations"] == 0


def test_loosely_coupled_contacts_need_no_factorisation():
    """Forty contacts that know nothing of each other: the first sweep solves them."""
    system = gpx.StackedSystem(np.eye(120), np.tile([1.0, 0.3, -0.4], 40), np.full(40, 0.2))
    solution = gpx.solve(system, tolerance=1e-12)
    assert solution.status is gpx.Status.SOLVED
    assert solution.extras["factorisations"] == 0
    np.testing.assert_allclose(solution.impulse[:, 1:], np.tile([0.12, -0.16], (40, 1)), atol=1e-12)

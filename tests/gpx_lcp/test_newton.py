import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import gpx_lcp as gpx


@pytest.mark.parametrize("formulation", ["normal", "cone", "coulomb"])
def test_small_tower_from_rest(bricks, formulation):
    solution = gpx.solve(bricks(5), formulation, "newton", tolerance=1e-10)
    assert solution.status is gpx.Status.SOLVED
    loads = solution.impulse[:, 0].reshape(5, 4).sum(axis=1)
    np.testing.assert_allclose(loads, 9.81 / 240 * np.arange(5, 0, -1), rtol=1e-8)


def test_a_solution_as_warm_start_costs_no_factorisation(bricks):
    system = bricks(20)
    cold = gpx.solve(system, "coulomb", "interior_point", tolerance=1e-9)
    warm = gpx.solve(system, "coulomb", "newton", tolerance=1e-8, warm_start=cold.impulse)
    assert warm.status is gpx.Status.SOLVED
    assert warm.extras["factorisations"] == 0


def test_a_resting_stack_costs_little_when_its_load_changes(bricks):
    system = bricks(20)
    before = gpx.solve(system, "coulomb", "interior_point", tolerance=1e-9)
    heavier = gpx.StackedSystem.from_jacobian(system.jacobian, system.inverse_mass, 1.001 * system.B, system.friction)
    after = gpx.solve(heavier, "coulomb", "newton", tolerance=1e-8, warm_start=before.impulse, presolve=False)
    assert after.status is gpx.Status.SOLVED
    assert after.extras["factorisations"] == 1


def test_what_rests_is_solved_from_nothing_in_a_few_steps(bricks):
    for count in (3, 30, 100):
        solution = gpx.solve(bricks(count), "coulomb", "newton", tolerance=1e-10, presolve=False)
        assert solution.status is gpx.Status.SOLVED
        assert solution.extras["factorisations"] == 1
        assert solution.iterations <= 4
        assert solution.fallbacks == ()


def test_a_sliding_wall_is_solved_cold(bricks):
    solution = gpx.solve(bricks(3, 4, speed=1.0), "coulomb", "newton", tolerance=1e-8)
    assert solution.status is gpx.Status.SOLVED
    assert solution.certificate.natural_map <= 1e-8


@given(st.integers(0, 10**6), st.sampled_from([1, 2, 3]), st.sampled_from(["normal", "cone", "coulomb"]))
def test_random_contacts_are_solved_in_both_forms(random_system, seed, rows, formulation):
    system = random_system(seed, rows=rows)
    for form in (system, gpx.StackedSystem(system.A, system.B, system.friction)):
        assert gpx.solve(form, formulation, "newton", tolerance=1e-9).status is gpx.Status.SOLVED


def test_slight_asymmetry_is_solved_as_given(random_system):
    system = random_system(5)
    A = np.asarray(system.A.todense())
    A = A * (1.0 + 1e-3 * np.random.default_rng(1).uniform(-1.0, 1.0, A.shape))
    solution = gpx.solve(gpx.StackedSystem(A, system.B, system.friction), "coulomb", "newton", tolerance=1e-10)
    assert solution.certificate.natural_map <= 1e-10


@pytest.mark.parametrize("solver", ["newton", "interior_point"])
@pytest.mark.parametrize("formulation", ["normal", "cone", "coulomb"])
def test_driven_walls_are_infeasible_with_a_certificate(solver, formulation):
    """Two opposite contacts on one body, both closing: y = (1, 1) moves nothing and Bᵀ y = 2."""
    J = np.diag([1.0, 1.0, 1.0])
    jacobian = np.vstack((J, np.diag([-1.0, 1.0, -1.0])))
    system = gpx.StackedSystem.from_jacobian(jacobian, np.ones(3), [1.0, 0, 0, 1.0, 0, 0], [0.5, 0.5])
    for form in (system, gpx.StackedSystem(system.A, system.B, system.friction)):
        solution = gpx.solve(form, formulation, solver)
        assert solution.status is gpx.Status.INFEASIBLE
        ray = solution.extras["infeasibility"]
        np.testing.assert_allclose(form.apply(ray), 0.0, atol=1e-6)
        assert form.B @ ray.reshape(-1) > 0.0
        assert (ray[:, 0] >= 0.0).all()
        assert np.isfinite(solution.impulse).all()


def test_a_block_held_between_two_walls_gets_one_of_its_solutions():
    """Gravity along the walls, no preload: it may fall (p = 0) or stay (p_n = m g dt / 2μ at each wall)."""
    walls = np.vstack((np.eye(3), np.diag([-1.0, 1.0, -1.0])))
    free = np.array([0.0, -9.81 / 240, 0.0])
    system = gpx.StackedSystem.from_jacobian(walls, np.ones(3), -walls @ free, [0.5, 0.5])
    solution = gpx.solve(system, "coulomb", "newton", tolerance=1e-10)
    assert solution.status is gpx.Status.SOLVED
    fall, stay = np.allclose(solution.impulse, 0.0), np.allclose(solution.velocity, 0.0, atol=1e-9)
    assert fall != stay


def test_real_problems_are_solved_to_the_last_digits(problems):
    """Newton's last steps are as good as an active-set polish: no figure is left but rounding."""
    for path in sorted(problems.glob("friction*/*.hdf5")):
        system = gpx.read_fclib(path)
        if system.contacts < 300:
            solution = gpx.solve(system, "coulomb", "newton", tolerance=1e-12)
            assert solution.status is gpx.Status.SOLVED, path.stem
            assert solution.certificate.natural_map <= 1e-12, path.stem

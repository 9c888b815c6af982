import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import gpx_lcp as gpx

WEIGHT = 9.81 / 240


@pytest.mark.parametrize("formulation", ["normal", "cone", "coulomb"])
def test_tower_of_thirty_cubes_carries_the_weight_above(bricks, formulation):
    system = bricks(30)
    solution = gpx.solve(system, formulation, "interior_point", tolerance=1e-10)
    assert solution.status is gpx.Status.SOLVED
    assert solution.certificate.natural_map <= 1e-10
    loads = solution.impulse[:, 0].reshape(30, 4).sum(axis=1)
    np.testing.assert_allclose(loads, WEIGHT * np.arange(30, 0, -1), rtol=1e-8)
    assert solution.iterations <= 40


def test_tall_towers_with_random_velocities_are_solved_around_the_folds_of_their_paths():
    """One tower in a hundred takes more than 150 steps; without going around folds, or through kinks, many do."""
    rest = gpx.World(gpx.scenes.tower(300), 1 / 240).system()
    steps = []
    for seed in range(10):
        free = rest.free_velocity + np.random.default_rng(seed).normal(size=rest.free_velocity.size)
        B = -(rest.jacobian @ free)
        system = gpx.StackedSystem.from_jacobian(rest.jacobian, rest.inverse_mass, B, rest.friction)
        solution = gpx.solve(system, "coulomb", "interior_point", tolerance=1e-8)
        assert solution.status is gpx.Status.SOLVED
        steps.append(solution.iterations)
    assert np.median(steps) <= 100
    assert np.sort(steps)[-2] <= 150


@pytest.mark.parametrize("ratio", [1e3, 1e6])
def test_a_heavy_cube_on_light_ones_is_no_harder(bricks, ratio):
    solution = gpx.solve(bricks(10, top=ratio), "coulomb", "interior_point", tolerance=1e-8)
    assert solution.status is gpx.Status.SOLVED
    assert solution.iterations <= 40
    loads = solution.impulse[:, 0].reshape(10, 4).sum(axis=1)
    np.testing.assert_allclose(loads, WEIGHT * (ratio + np.arange(9, -1, -1)), rtol=1e-6)


def test_column_of_point_masses(column):
    solution = gpx.solve(column(100), "normal", "interior_point", tolerance=1e-11)
    assert solution.status is gpx.Status.SOLVED
    np.testing.assert_allclose(solution.impulse[:, 0], WEIGHT * np.arange(100, 0, -1), rtol=1e-6)


def _thrown_point(angle: float, friction: float = 0.5, speed: float = 4.0, mass: float = 2.0) -> gpx.StackedSystem:
    free = np.array([-WEIGHT, speed * np.cos(angle), speed * np.sin(angle)])
    return gpx.StackedSystem.from_jacobian(np.eye(3), np.full(3, 1.0 / mass), -free, [friction])


@pytest.mark.parametrize("angle", [0.0, 0.3, np.pi / 4, 2.0])
def test_coulomb_friction_decelerates_alike_in_every_direction(angle):
    solution = gpx.solve(_thrown_point(angle), "coulomb", "interior_point", tolerance=1e-12)
    impulse = solution.impulse[0]
    np.testing.assert_allclose(impulse[0], 2.0 * WEIGHT, rtol=1e-9)
    np.testing.assert_allclose(impulse[1:], -WEIGHT * np.array([np.cos(angle), np.sin(angle)]), rtol=1e-9, atol=1e-12)


def test_the_convex_cone_dilates_as_theory_says():
    """u_n = μ‖u_t‖ while sliding: p_n = m (g dt + μ v) / (1 + μ²)."""
    solution = gpx.solve(_thrown_point(0.3), "cone", "interior_point", tolerance=1e-12)
    np.testing.assert_allclose(solution.impulse[0, 0], 2.0 * (WEIGHT + 0.5 * 4.0) / 1.25, rtol=1e-9)


@given(st.integers(0, 10**6), st.sampled_from([1, 2, 3]), st.sampled_from(["normal", "cone", "coulomb"]))
def test_random_contacts_are_solved_in_both_forms(random_system, seed, rows, formulation):
    system = random_system(seed, rows=rows)
    bare = gpx.StackedSystem(system.A, system.B, system.friction)
    velocities = []
    for form in (system, bare):
        solution = gpx.solve(form, formulation, "interior_point", tolerance=1e-9)
        assert solution.status is gpx.Status.SOLVED
        velocities.append(solution.velocity)
    if formulation != "coulomb":  # whose solution need not be unique
        np.testing.assert_allclose(*velocities, atol=1e-5)


@pytest.mark.parametrize("power", [-20, 20])
def test_units_change_no_step(bricks, power):
    """Powers of two change no digit either."""
    system = bricks(4, speed=0.1)
    one = gpx.StackedSystem(system.A, system.B, system.friction)
    other = gpx.StackedSystem(2.0**power * system.A, 2.0 ** (2 * power) * system.B, system.friction)
    first, second = (gpx.solve(each, "coulomb", "interior_point") for each in (one, other))
    assert first.status is second.status is gpx.Status.SOLVED
    assert first.iterations == second.iterations
    np.testing.assert_allclose(second.impulse / 2.0**power, first.impulse, rtol=1e-12, atol=1e-15)


def test_contacts_without_friction_among_others(bricks):
    system = bricks(5)
    friction = np.where(np.arange(20) % 4 == 0, 0.0, 0.5)
    mixed = gpx.StackedSystem.from_jacobian(system.jacobian, system.inverse_mass, system.B, friction)
    solution = gpx.solve(mixed, "coulomb", "interior_point", tolerance=1e-9)
    assert solution.status is gpx.Status.SOLVED
    np.testing.assert_array_equal(solution.impulse[friction == 0.0, 1:], 0.0)


def test_a_contact_that_moves_nothing_gets_no_impulse():
    A = np.zeros((6, 6))
    A[:3, :3] = np.diag([1.0, 2.0, 2.0])
    solution = gpx.solve(gpx.StackedSystem(A, [1.0, 0, 0, 0, 0, 0], [0.5, 0.5]), "coulomb", "interior_point")
    assert solution.status is gpx.Status.SOLVED
    np.testing.assert_allclose(solution.impulse, [[1.0, 0, 0], [0, 0, 0]], atol=1e-8)


def test_limits_are_kept_and_the_best_point_comes_back(bricks):
    system = bricks(6)
    stopped = gpx.solve(system, "coulomb", "interior_point", max_iterations=3, presolve=False)
    assert stopped.status is gpx.Status.MAX_ITERATIONS
    assert stopped.iterations == 3
    assert np.isfinite(stopped.impulse).all()
    assert stopped.program_residual <= 1.0
    late = gpx.solve(system, "coulomb", "interior_point", time_limit=1e-9, presolve=False)
    assert late.status is gpx.Status.MAX_ITERATIONS


def test_history_falls_and_ends_at_the_residual(bricks):
    solution = gpx.solve(bricks(6), "coulomb", "interior_point", presolve=False)
    residuals = [residual for _, residual in solution.history]
    assert residuals == sorted(residuals, reverse=True)
    np.testing.assert_allclose(residuals[-1], solution.program_residual, rtol=1e-3, atol=1e-12)


def test_extras_tell_what_the_factorisations_took(bricks):
    solution = gpx.solve(bricks(6), "coulomb", "interior_point", presolve=False)
    assert solution.extras["factorisations"] >= 1 and solution.extras["fill"] > 0
    assert 0.0 < solution.extras["factor_seconds"] < solution.solve_seconds


def test_a_setting_it_does_not_have_is_refused(bricks):
    with pytest.raises(gpx.SettingsError, match="relaxation"):
        gpx.solve(bricks(1), "coulomb", "interior_point", relaxation=1.0)


@pytest.mark.parametrize("folder", ["friction2d", "friction3d"])
def test_real_problems_that_any_peer_solves_are_solved(problems, folder):
    solvable = json.loads((problems / "baseline.json").read_text())
    for path in sorted((problems / folder).glob("*.hdf5")):
        if solvable.get(path.stem, {}).get("best_scaled_1e-8_s") is None:
            continue
        solution = gpx.solve(gpx.read_fclib(path), "coulomb", "interior_point", tolerance=1e-8)
        assert solution.status is gpx.Status.SOLVED, path.stem
        assert solution.certificate.natural_map <= 1e-8, path.stem

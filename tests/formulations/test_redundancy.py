import numpy as np
import pytest

import formulations as fm
import gpx_lcp as gpx

WEIGHT = 9.81 / 240


def _solved(system, solver="newton"):
    solution = gpx.solve(system, "coulomb", solver, tolerance=1e-10)
    assert solution.status is gpx.Status.SOLVED
    return solution


def _bare(system):
    return fm.StackedSystem(system.A, system.B, system.friction)


@pytest.mark.parametrize("solver", ["newton", "interior_point", "pgs"])
def test_a_box_on_four_corners_puts_a_quarter_on_each(bricks, solver):
    system = bricks(1)
    for form in (system, _bare(system)):
        solution = _solved(form, solver)
        assert (solution.certificate.rank, solution.certificate.nullity) == (6, 6)
        smallest = fm.minimum_norm(form, solution.impulse)
        np.testing.assert_allclose(smallest, np.tile([WEIGHT / 4, 0.0, 0.0], (4, 1)), atol=1e-9)


def test_a_tower_has_one_smallest_answer_whoever_solves_it(bricks):
    system = bricks(10)
    first, second = (_solved(system, solver) for solver in ("newton", "interior_point"))
    assert (first.certificate.rank, first.certificate.nullity) == (60, 60)
    smallest = fm.minimum_norm(system, first.impulse)
    np.testing.assert_allclose(smallest[:, 0], np.repeat(WEIGHT * np.arange(10, 0, -1) / 4, 4), rtol=1e-7)
    np.testing.assert_allclose(fm.minimum_norm(system, second.impulse), smallest, atol=1e-8)


def test_nine_legs_share_a_load_by_symmetry(bricks):
    """Point contacts at (-1, 0, 1)², of which any three would do: an even load is the smallest."""
    frame = np.roll(np.eye(3), 1, axis=0)
    arms = [np.array([x, y, -0.5]) for x in (-1.0, 0.0, 1.0) for y in (-1.0, 0.0, 1.0)]
    jacobian = np.vstack([np.hstack((frame, np.cross(arm, frame))) for arm in arms])
    free = np.array([0.0, 0.0, -WEIGHT, 0.0, 0.0, 0.0])
    system = fm.StackedSystem.from_jacobian(jacobian, np.ones(6), -jacobian @ free, np.full(9, 0.5))
    uneven = np.zeros((9, 3))
    uneven[[0, 8], 0] = WEIGHT / 2
    assert fm.uniqueness(system, uneven) == fm.Uniqueness(0, 0, 9, rank=6, nullity=21)
    smallest = fm.minimum_norm(system, uneven)
    np.testing.assert_allclose(smallest, np.tile([WEIGHT / 9, 0.0, 0.0], (9, 1)), atol=1e-12)


def test_the_cones_bound_the_smallest_impulses():
    """Two parallel contacts and a third that pulls against them: the plain least-norm solution would pull."""
    normals = np.array([[1.0], [1.0], [-1.0]])
    system = fm.StackedSystem.from_jacobian(normals, [1.0], [1.0, 1.0, -1.0], np.zeros(3))
    given = np.array([[3.0], [0.0], [2.0]])
    assert fm.certify(system, given).nullity == 2
    np.testing.assert_allclose(fm.minimum_norm(system, given), [[0.5], [0.5], [0.0]], atol=1e-12)


def test_sliding_contacts_keep_their_direction(bricks):
    """The four corners of a sliding box: one normal each, three of them would do."""
    box = bricks(1)
    free = box.free_velocity + np.array([2.0, 1.0, 0, 0, 0, 0])
    system = fm.StackedSystem.from_jacobian(box.jacobian, box.inverse_mass, -(box.jacobian @ free), box.friction)
    solution = _solved(system)
    assert fm.uniqueness(system, solution.impulse) == fm.Uniqueness(0, 4, 0, rank=3, nullity=1)
    smallest = fm.minimum_norm(system, solution.impulse)
    certificate = fm.certify(system, smallest)
    assert certificate.natural_map <= 1e-8
    assert certificate.sliding_angle <= 1e-6
    assert np.linalg.norm(smallest) <= np.linalg.norm(solution.impulse)


def test_independent_contacts_are_unique(random_system):
    system = random_system(3, contacts=3, bodies=4)
    certificate = _solved(system).certificate
    assert certificate.nullity == 0
    assert certificate.rank == 3 * certificate.uniqueness.sticking + certificate.uniqueness.sliding


@pytest.mark.parametrize("seed", range(10))
def test_the_smallest_impulses_solve_the_same_problem(random_system, seed):
    system = random_system(seed, contacts=12, bodies=3)
    solution = _solved(system)
    for form in (system, _bare(system)):
        smallest = fm.minimum_norm(form, solution.impulse)
        assert fm.certify(form, smallest).natural_map <= 1e-8
        np.testing.assert_allclose(form.velocity(smallest), solution.velocity, atol=1e-6)
        assert np.linalg.norm(smallest) <= np.linalg.norm(solution.impulse)


def test_too_many_rows_are_not_counted(bricks, monkeypatch):
    monkeypatch.setattr("formulations.redundancy.LARGEST", 5)
    monkeypatch.setattr("formulations.least_norm.LARGEST", 5)
    system = _bare(bricks(1))
    impulse = _solved(system).impulse
    certificate = fm.certify(system, impulse)
    assert certificate.rank is certificate.nullity is None
    assert certificate.uniqueness.sticking == 4
    with pytest.raises(fm.ProblemError, match="A has 12 rows: without a Jacobian, at most 5"):
        fm.minimum_norm(system, impulse)


def test_what_is_no_solution_has_no_least_norm(bricks):
    with pytest.raises(fm.ProblemError, match="impulse has natural_map 1: only a solution, with at most 1e-08"):
        fm.minimum_norm(bricks(1), np.zeros((4, 3)))

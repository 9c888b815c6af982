import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from formulations.cones import (
    box_directions,
    de_saxce,
    friction_cone_derivative,
    project_dual_cone,
    project_friction_cone,
    project_polygon,
    project_polyhedral_cone,
    pyramid_directions,
)

numbers = st.floats(-10.0, 10.0)
frictions = st.floats(0.0, 5.0)


def vectors(rows):
    return st.lists(numbers, min_size=rows, max_size=rows).map(lambda values: np.array([values]))


@pytest.mark.parametrize("rows", [1, 2, 3])
def test_projection_is_idempotent_and_leaves_an_orthogonal_rest(rows):
    @given(vectors(rows), frictions)
    def check(x, mu):
        friction = np.array([mu])
        p = project_friction_cone(x, friction)
        assert np.linalg.norm(p[:, 1:]) <= mu * p[0, 0] + 1e-12
        np.testing.assert_allclose(project_friction_cone(p, friction), p, atol=1e-12)
        assert abs(np.sum(p * (x - p))) <= 1e-12 * (1.0 + np.sum(x * x))
        # Moreau: the rest is minus the projection of -x onto the dual cone.
        np.testing.assert_allclose(p - x, project_dual_cone(-x, friction), atol=1e-12)

    check()


def test_projection_of_known_points():
    friction = np.array([1.0, 1.0, 1.0, 0.0, 0.5])
    x = np.array([[2.0, 1, 0], [-2.0, 1, 0], [0.0, 2, 0], [1.0, 3, 4], [0.0, 0, 2.5]])
    expected = [[2.0, 1, 0], [0, 0, 0], [1, 1, 0], [1, 0, 0], [1.0, 0, 0.5]]
    np.testing.assert_allclose(project_friction_cone(x, friction), expected, atol=1e-15)


def test_without_friction_only_the_positive_normal_is_left():
    friction = np.zeros(3)
    x = np.array([[-1.0, 0, 0], [-1.0, 2, 0], [1.0, 2, 0]])
    np.testing.assert_array_equal(project_friction_cone(x, friction), [[0.0, 0, 0], [0, 0, 0], [1, 0, 0]])
    np.testing.assert_array_equal(friction_cone_derivative(x, friction)[:2], 0.0)


@pytest.mark.parametrize("rows", [1, 2, 3])
def test_derivative_agrees_with_differences_where_the_projection_is_smooth(rows):
    rng = np.random.default_rng(0)
    x, friction = rng.normal(size=(300, rows)), rng.uniform(0.0, 2.0, 300)
    derivative = friction_cone_derivative(x, friction)
    step = 1e-6
    for axis in range(rows):
        shift = step * np.eye(rows)[axis]
        difference = project_friction_cone(x + shift, friction) - project_friction_cone(x - shift, friction)
        error = np.abs(difference / (2 * step) - derivative[:, :, axis]).max(axis=1)
        length = np.linalg.norm(x[:, 1:], axis=1)
        kink = np.minimum(np.abs(length - friction * x[:, 0]), np.abs(friction * length + x[:, 0]))
        smooth = (kink > 1e-4) & ((length > 1e-2) | (rows == 1))
        assert smooth.sum() > 200
        assert error[smooth].max() < 1e-5


def test_derivative_has_eigenvalues_between_zero_and_one_everywhere():
    rng = np.random.default_rng(1)
    x, friction = rng.normal(size=(500, 3)), rng.uniform(0.0, 3.0, 500)
    x[:50, 1:] = 0.0
    x[50:60] = 0.0
    derivative = friction_cone_derivative(x, friction)
    np.testing.assert_allclose(derivative, derivative.transpose(0, 2, 1), atol=1e-14)
    values = np.linalg.eigvalsh(derivative)
    assert values.min() >= -1e-12
    assert values.max() <= 1.0 + 1e-12


@pytest.mark.parametrize("corners", [pyramid_directions(3, 3), pyramid_directions(3, 8), box_directions(3)])
def test_polyhedral_projection_meets_the_variational_inequality(corners):
    rng = np.random.default_rng(2)
    x, friction = rng.normal(size=(200, 3)), rng.uniform(0.0, 2.0, 200)
    friction[:20] = 0.0
    p = project_polyhedral_cone(x, friction, corners)
    np.testing.assert_allclose(project_polyhedral_cone(p, friction, corners), p, atol=1e-12)
    np.testing.assert_allclose(np.sum(p * (x - p), axis=1), 0.0, atol=1e-12)
    for corner in corners:
        generator = np.column_stack((np.ones(200), friction[:, None] * corner))
        assert np.sum((x - p) * generator, axis=1).max() <= 1e-12


def test_polyhedral_cone_in_the_plane_is_the_friction_cone():
    rng = np.random.default_rng(3)
    x, friction = rng.normal(size=(200, 2)), rng.uniform(0.0, 2.0, 200)
    expected = project_friction_cone(x, friction)
    np.testing.assert_allclose(project_polyhedral_cone(x, friction, pyramid_directions(2, 8)), expected, atol=1e-13)


def test_polygon_projection_meets_the_variational_inequality():
    rng = np.random.default_rng(4)
    x, radius, corners = rng.normal(size=(200, 2)), rng.uniform(0.0, 2.0, 200), pyramid_directions(3, 5)
    radius[:10] = 0.0
    p = project_polygon(x, radius, corners)
    for corner in corners:
        assert np.sum((x - p) * (radius[:, None] * corner - p), axis=1).max() <= 1e-12


def test_pyramid_with_many_facets_tends_to_the_cone():
    rng = np.random.default_rng(5)
    x, friction = rng.normal(size=(100, 3)), rng.uniform(0.1, 2.0, 100)
    exact = np.linalg.norm(x - project_friction_cone(x, friction), axis=1)
    errors = []
    for facets in (8, 16, 32):
        projected = project_polyhedral_cone(x, friction, pyramid_directions(3, facets))
        errors.append(np.abs(np.linalg.norm(x - projected, axis=1) - exact).max())
    # The corners lie on the circle, the facets 1 - cos(π/k) inside it: second order in 1/k.
    assert errors[0] > 3.0 * errors[1] > 9.0 * errors[2]


def test_de_saxce_lifts_the_normal_velocity_by_the_sliding_speed():
    lifted = de_saxce(np.array([[1.0, 3.0, 4.0]]), np.array([0.5]))
    np.testing.assert_array_equal(lifted, [[3.5, 3.0, 4.0]])

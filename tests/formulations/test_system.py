import numpy as np
import pytest
import scipy.linalg
import scipy.sparse as sp

from formulations import ProblemError, StackedSystem

A = np.diag([2.0, 3.0, 4.0])
B = np.array([1.0, 0.5, 0.0])
FRICTION = np.array([0.5])


def test_factors_give_the_same_matrix_as_their_product(random_system):
    system = random_system(0)
    mass = np.diag(system.inverse_mass[:, 0, 0])
    jacobian = system.jacobian.toarray()
    np.testing.assert_allclose(system.A.toarray(), jacobian @ mass @ jacobian.T, atol=1e-12)
    np.testing.assert_allclose(system.diagonal, np.diag(jacobian @ mass @ jacobian.T), atol=1e-12)


@pytest.mark.parametrize(
    "form", [np.asarray, sp.csr_array, sp.csc_matrix, sp.coo_array, lambda A: sp.bsr_array(A, blocksize=(3, 3))]
)
def test_every_matrix_form_gives_the_same_velocity(form, random_system):
    system = random_system(1)
    impulse = np.random.default_rng(0).normal(size=(6, 3))
    explicit = StackedSystem(form(system.A.toarray()), system.B, system.friction)
    np.testing.assert_allclose(explicit.velocity(impulse), system.velocity(impulse), atol=1e-12)
    np.testing.assert_allclose(explicit.scale, system.scale)


def test_inverse_mass_may_be_a_diagonal_blocks_or_a_matrix():
    jacobian = np.hstack([np.eye(3), -np.eye(3)])
    block = np.array([[2.0, 1.0, 0.5], [1.0, 2.0, 0.0], [0.5, 0.0, 1.0]])
    blocks = np.stack([block, np.eye(3)])
    matrix = sp.coo_array(scipy.linalg.block_diag(*blocks))
    systems = [StackedSystem.from_jacobian(jacobian, form, B, FRICTION) for form in (blocks, matrix, matrix.toarray())]
    for system in systems:
        assert system.inverse_mass.shape == (2, 3, 3)
        np.testing.assert_allclose(system.A.toarray(), block + np.eye(3), atol=1e-14)
    diagonal = StackedSystem.from_jacobian(jacobian, np.full(6, 0.5), B, FRICTION)
    assert diagonal.inverse_mass.shape == (6, 1, 1)
    np.testing.assert_allclose(diagonal.A.toarray(), np.eye(3))


def test_a_locked_axis_has_no_response():
    system = StackedSystem.from_jacobian(np.eye(3), np.array([1.0, 0.0, 2.0]), B, FRICTION)
    np.testing.assert_allclose(system.A.toarray(), np.diag([1.0, 0.0, 2.0]), atol=1e-15)


def test_body_velocities_change_by_the_impulse_over_the_mass(random_system):
    system = random_system(2)
    impulse = np.random.default_rng(1).normal(size=(6, 3))
    after = system.free_velocity + system.body_velocity_change(impulse)
    np.testing.assert_allclose(system.jacobian @ after, system.velocity(impulse).ravel(), atol=1e-12)


def test_normalised_system_has_the_same_solutions(random_system):
    system = random_system(3)
    small, factors = system.normalised()
    impulse = np.abs(np.random.default_rng(2).normal(size=(6, 3)))
    np.testing.assert_allclose(small.scale, 1.0)
    assert np.linalg.norm(small.B) == pytest.approx(1.0)
    ratio = system.velocity(factors[:, None] * impulse) / small.velocity(impulse)
    np.testing.assert_allclose(ratio, np.repeat(ratio[:, :1], 3, axis=1), rtol=1e-9)


def test_a_system_cannot_be_changed():
    system = StackedSystem(A, B, FRICTION)
    with pytest.raises(AttributeError, match="immutable"):
        system.B = B
    with pytest.raises(ValueError, match="read-only"):
        system.B[0] = 1.0
    with pytest.raises(ValueError, match="read-only"):
        system.A[0, 0] = 1.0


def test_the_users_arrays_are_not_frozen_and_not_shared():
    own = A.copy()
    system = StackedSystem(own, B, FRICTION)
    own[0, 0] = 7.0
    assert system.A[0, 0] == 2.0


@pytest.mark.parametrize("rows", [1, 2, 3])
def test_rows_per_contact_follow_from_the_sizes(rows):
    assert StackedSystem(np.eye(2 * rows), np.ones(2 * rows), [0.1, 0.2]).rows == rows


def test_no_contacts_is_a_system_too():
    for system in (
        StackedSystem(np.zeros((0, 0)), [], []),
        StackedSystem.from_jacobian(np.zeros((0, 6)), np.ones(6), [], [], free_velocity=np.ones(6)),
        StackedSystem.from_jacobian(np.zeros((0, 0)), np.zeros((0, 6, 6)), [], []),
    ):
        assert system.contacts == 0
        assert system.velocity(np.zeros((0, 3))).shape == (0, 3)
        assert system.A.shape == (0, 0)


@pytest.mark.parametrize(
    ("A", "B", "friction", "message"),
    [
        (np.diag([1.0, np.nan, 1.0]), B, FRICTION, r"A\[1, 1\] is nan"),
        (sp.csr_array(np.diag([1.0, np.inf, 1.0])), B, FRICTION, r"A\[1, 1\] is inf"),
        (np.eye(4), B, FRICTION, r"A has shape \(4, 4\) but B has length 3: A must be 3 x 3"),
        (np.ones(3), B, FRICTION, r"A has shape \(3,\)"),
        (A, [1.0, np.nan, 0.0], FRICTION, r"B\[1\] is nan"),
        (A, B, [-0.1], r"friction\[0\] is -0.1: it must be at least 0"),
        (A, B, [np.inf], r"friction\[0\] is inf"),
        (A, B, [0.5, 0.5], r"B has length 3 but friction has 2 contacts"),
        (np.diag([1.0, -1.0, 1.0]), B, FRICTION, r"A\[1, 1\] is -1: the diagonal"),
        (np.array([[1.0, 0.1, 0], [0, 1, 0], [0, 0, 1]]), B, FRICTION, r"A\[0, 1\] and A\[1, 0\] differ by 0.1"),
        ("rubbish", B, FRICTION, "A is not an array of numbers"),
    ],
)
def test_bad_matrices_are_refused_with_the_place_of_the_fault(A, B, friction, message):
    with pytest.raises(ProblemError, match=message):
        StackedSystem(A, B, friction)


def test_the_asymmetry_of_six_digit_files_is_accepted():
    matrix = np.eye(3)
    matrix[0, 1] = 2.5e-3
    assert StackedSystem(matrix, B, FRICTION).A[0, 1] == 2.5e-3


def test_a_part_may_be_less_symmetric_than_the_whole():
    """What is rounding of the largest entry may be a tenth of the smallest."""
    A = np.diag([1.0, 1.0, 1e-3, 1e-3])
    A[2, 3] = 1e-4
    for matrix in (A, sp.csr_array(A)):
        system = StackedSystem(matrix, np.ones(4), np.zeros(4))
        part = system.restricted(np.array([2, 3]))
        small, _ = system.normalised()
        np.testing.assert_array_equal(sp.csr_array(part.A).toarray(), A[2:, 2:])
        np.testing.assert_allclose(sp.csr_array(small.A).toarray()[2:, 2:], [[1.0, 0.1], [0.0, 1.0]], rtol=1e-15)
        with pytest.raises(ProblemError, match="not symmetric"):
            StackedSystem(part.A, part.B, part.friction)


@pytest.mark.parametrize(
    ("jacobian", "inverse_mass", "message"),
    [
        (np.eye(3), [1.0, -1.0, 1.0], r"inverse_mass of block 1, axis 0 is -1: masses must not be negative"),
        (np.eye(3), [1.0, np.nan, 1.0], r"inverse_mass\[1\] is nan"),
        (np.eye(4), np.ones(3), r"jacobian has shape \(4, 4\), but B has length 3 and inverse_mass 3 velocities"),
        (np.full((3, 3), np.nan), np.ones(3), r"jacobian\[0, 0\] is nan"),
        (sp.csr_array(np.diag([1.0, np.inf, 1.0])), np.ones(3), r"jacobian\[1, 1\] is inf"),
        (
            np.eye(3),
            np.array([[[1.0, 0.5, 0], [0, 1, 0], [0, 0, 1]]]),
            "inverse_mass of block 0 differs from its transpose",
        ),
        (
            np.eye(3),
            np.array([[[1.0, 2.0, 0], [2.0, 1, 0], [0, 0, 1]]]),
            "inverse_mass of block 0 has the eigenvalue -1",
        ),
        (np.eye(3), np.ones((3, 2)), r"inverse_mass has shape \(3, 2\)"),
    ],
)
def test_bad_factors_are_refused_with_the_place_of_the_fault(jacobian, inverse_mass, message):
    with pytest.raises(ProblemError, match=message):
        StackedSystem.from_jacobian(jacobian, inverse_mass, B, FRICTION)


def test_body_velocities_need_the_factors():
    with pytest.raises(ProblemError, match="from_jacobian"):
        StackedSystem(A, B, FRICTION).body_velocity_change(np.zeros((1, 3)))


def test_a_whitened_jacobian_that_is_given_is_the_one_that_is_used(random_system):
    system = random_system(0)
    blocks = np.asarray(system.whitened_jacobian.data)
    turned = -blocks  # L is free up to an orthogonal factor
    given = StackedSystem.from_jacobian(
        system.jacobian, system.inverse_mass, system.B, system.friction, whitened_blocks=turned
    )
    assert np.array_equal(given.whitened_jacobian.data, turned)
    np.testing.assert_allclose(given.A.toarray(), system.A.toarray(), rtol=1e-12)
    turned[3, 0] *= 1.01
    with pytest.raises(ProblemError, match=r"row 0 of whitened_blocks\[3\] has the square .*, but J and M⁻¹ give"):
        StackedSystem.from_jacobian(
            system.jacobian, system.inverse_mass, system.B, system.friction, whitened_blocks=turned
        )

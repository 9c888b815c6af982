import numpy as np
import pytest

from formulations import RESIDUALS, ProblemError, StackedSystem, certify


def sliding_block(mu=0.5, speed=3.0, step=9.81 / 240, mass=2.0):
    """A point mass that slides along the first tangent; its exact impulse is (1, -mu, 0) m g dt."""
    A = np.eye(3) / mass
    B = np.array([step, -speed, 0.0])
    impulse = mass * step * np.array([[1.0, -mu, 0.0]])
    return StackedSystem(A, B, [mu]), impulse


def test_every_field_vanishes_at_a_sliding_solution():
    system, impulse = sliding_block()
    certificate = certify(system, impulse)
    assert certificate.natural_map < 1e-15
    assert certificate.cone_violation < 1e-15
    assert certificate.penetration_velocity == 0.0
    assert certificate.complementarity < 1e-15
    assert certificate.dissipation == 0.0
    assert certificate.sliding_angle < 1e-7
    assert certificate.energy_change is None
    assert certificate.worst_contact == 0


def test_each_fault_shows_in_its_own_field():
    system, impulse = sliding_block()
    askew = impulse @ np.array([[1.0, 0, 0], [0, 0.8, 0.6], [0, -0.6, 0.8]])
    assert certify(system, askew).sliding_angle == pytest.approx(np.arccos(0.8), abs=0.02)
    assert certify(system, 0.5 * impulse).penetration_velocity == pytest.approx(0.5 * (9.81 / 240) / 3.0)
    pushing = impulse * [1.0, -1.0, 1.0]
    assert certify(system, pushing).dissipation > 0.0
    assert certify(system, impulse * [1.0, 2.0, 1.0]).cone_violation > 0.0
    assert certify(system, -impulse).cone_violation > 0.0
    assert certify(system, 2.0 * impulse).complementarity > 1e-3


def test_pulling_without_friction_is_a_violation():
    system = StackedSystem(np.eye(3), [1.0, 0.0, 0.0], [0.0])
    assert certify(system, [[-1.0, 0.0, 0.0]]).cone_violation == pytest.approx(1.0)


@pytest.mark.parametrize("mass", [1e-6, 1.0, 1e6])
@pytest.mark.parametrize("length", [1e-6, 1.0, 1e6])
@pytest.mark.parametrize("time", [1e-6, 1.0, 1e6])
def test_no_field_changes_with_the_units(random_system, mass, length, time):
    """Contact rows are velocities; rotations are without a unit of length, so their columns of J scale with it."""
    system = random_system(5)
    impulse = np.random.default_rng(3).normal(size=(6, 3))
    speed = length / time
    columns = np.tile([1.0, 1, 1, length, length, length], 4)
    inverse = system.inverse_mass[:, 0, 0] / mass / np.tile([1.0, 1, 1, length**2, length**2, length**2], 4)
    scaled = StackedSystem.from_jacobian(
        system.jacobian.toarray() * columns,
        inverse,
        system.B * speed,
        system.friction,
        free_velocity=system.free_velocity * speed / columns,
    )
    one, other = certify(system, impulse), certify(scaled, impulse * mass * speed)
    for field in vars(one).keys() - {"system", "impulse"}:
        assert getattr(other, field) == pytest.approx(getattr(one, field), rel=1e-9, abs=1e-13), field


def test_exchanging_the_tangents_changes_nothing(random_system):
    system = random_system(6)
    impulse = np.random.default_rng(4).normal(size=(6, 3))
    turn = np.array([[1.0, 0, 0], [0, 0, -1.0], [0, 1.0, 0]])
    blocks = np.kron(np.eye(6), turn)
    turned = StackedSystem(blocks @ system.A.toarray() @ blocks.T, blocks @ system.B, system.friction)
    assert certify(turned, impulse @ turn.T).natural_map == pytest.approx(
        certify(system, impulse).natural_map, rel=1e-12
    )


def test_energy_of_plastic_and_elastic_collisions():
    inverse_mass, closing = np.array([1.0, 0.5]), np.array([3.0, -1.0])
    jacobian = np.array([[-1.0, 1.0]])
    for elasticity, sign in ((1.0, -1.0), (1.5, -1.0), (2.0, 0.0), (2.5, 1.0)):
        B = -elasticity * jacobian @ closing
        system = StackedSystem.from_jacobian(jacobian, inverse_mass, B, [0.0], free_velocity=closing)
        impulse = B.reshape(1, 1) / system.A.toarray()
        after = closing + system.body_velocity_change(impulse)
        gained = 0.5 * (after**2 - closing**2) @ (1.0 / inverse_mass)
        change = certify(system, impulse).energy_change
        assert np.sign(np.round(change, 12)) == sign == np.sign(np.round(gained, 12))


def test_locked_contacts_have_a_value_and_never_nan():
    system = StackedSystem(np.zeros((3, 3)), [1.0, 0.0, 0.0], [0.5])
    assert certify(system, np.zeros((1, 3))).natural_map == pytest.approx(1.0)
    system = StackedSystem(np.zeros((3, 3)), [-1.0, 0.0, 0.0], [0.5])
    assert certify(system, np.zeros((1, 3))).natural_map == 0.0


@pytest.mark.parametrize("program", sorted(RESIDUALS))
def test_impulses_that_run_off_fool_no_judge(program):
    """Driven walls have no solution; p = 1e20 (1, 1) moves nothing, and beside it the closing speed is rounding."""
    system = StackedSystem([[1.0, -1.0], [-1.0, 1.0]], [1.0, 1.0], [0.5, 0.5])
    assert RESIDUALS[program](system, np.full((2, 1), 1e20), 8) == pytest.approx(1.0)


def test_no_contacts_and_no_motion():
    assert certify(StackedSystem(np.zeros((0, 0)), [], []), np.zeros((0, 3))).natural_map == 0.0
    still = StackedSystem(np.eye(3), np.zeros(3), [0.5])
    assert certify(still, np.zeros((1, 3))).natural_map == 0.0
    assert certify(still, np.ones((1, 3))).natural_map == np.inf


def test_the_worst_contact_is_named():
    system = StackedSystem(np.eye(9), np.tile([1.0, 0.0, 0.0], 3), [0.5] * 3)
    assert certify(system, [[1.0, 0, 0], [0.3, 0, 0], [1.0, 0, 0]]).worst_contact == 1


@pytest.mark.parametrize(
    ("impulse", "message"),
    [(np.zeros((2, 3)), r"impulse has shape \(2, 3\), but \(1, 3\)"), ([[np.nan, 0, 0]], r"impulse\[0, 0\] is nan")],
)
def test_bad_impulses_are_refused(impulse, message):
    with pytest.raises(ProblemError, match=message):
        certify(StackedSystem(np.eye(3), np.ones(3), [0.5]), impulse)


def test_a_certificate_prints_one_line_a_field():
    system, impulse = sliding_block()
    text = str(certify(system, impulse))
    assert text.splitlines()[0].startswith("natural_map")
    assert len(text.splitlines()) == 8

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from formulations import ElasticityWarning, ProblemError, SettingsError, two_body_impulse, two_body_impulse_along

masses = st.floats(0.1, 100.0)
speeds = st.floats(-10.0, 10.0)


def after(mass, velocity, impulse):
    return velocity[0] - impulse / mass[0], velocity[1] + impulse / mass[1]


@given(masses, masses, speeds, speeds)
def test_elastic_collisions_keep_energy_and_momentum(m1, m2, v1, v2):
    w1, w2 = after((m1, m2), (v1, v2), two_body_impulse((m1, m2), (v1, v2), elasticity=(2.0, 2.0)))
    scale = m1 * v1**2 + m2 * v2**2 + 1.0
    assert abs(m1 * w1**2 + m2 * w2**2 - m1 * v1**2 - m2 * v2**2) <= 1e-9 * scale
    assert abs(m1 * w1 + m2 * w2 - m1 * v1 - m2 * v2) <= 1e-9 * scale


@given(masses, masses, speeds, speeds)
def test_plastic_collisions_equalise_the_velocities(m1, m2, v1, v2):
    w1, w2 = after((m1, m2), (v1, v2), two_body_impulse((m1, m2), (v1, v2), elasticity=(1.0, 1.0)))
    assert v1 <= v2 or abs(w1 - w2) <= 1e-9 * (1.0 + abs(v1) + abs(v2))


@given(masses, masses, speeds, speeds, st.floats(1.0, 2.0), st.floats(1.0, 2.0), st.floats(-50.0, 50.0))
def test_the_default_rule_is_the_same_in_every_frame(m1, m2, v1, v2, e1, e2, frame):
    here = two_body_impulse((m1, m2), (v1, v2), elasticity=(e1, e2))
    there = two_body_impulse((m1, m2), (v1 + frame, v2 + frame), elasticity=(e1, e2))
    assert abs(here - there) <= 1e-10 * (m1 + m2) * 70.0


def test_the_papers_rule_to_the_letter_depends_on_the_frame():
    def literal(frame):
        return two_body_impulse((1.0, 2.0), (3.0 + frame, -1.0 + frame), elasticity=(2.0, 1.0), rule="paper")

    assert literal(0.0) == pytest.approx((2 * 3.0 + 1 * 1.0) / (1 + 0.5))
    assert literal(1.0) == pytest.approx((2 * 4.0 - 1 * 0.0) / (1 + 0.5))


@given(masses, masses, speeds, speeds, st.floats(1.0, 2.0))
def test_both_rules_agree_where_the_elasticities_do(m1, m2, v1, v2, e):
    one = two_body_impulse((m1, m2), (v1, v2), elasticity=(e, e))
    other = two_body_impulse((m1, m2), (v1, v2), elasticity=(e, e), rule="paper")
    assert one == pytest.approx(other, rel=1e-9, abs=1e-9)


def test_mixed_elasticity_weighs_each_by_the_others_mass():
    impulse = two_body_impulse((1.0, 3.0), (4.0, 0.0), elasticity=(2.0, 1.0))
    assert impulse == pytest.approx((2 * 3 + 1 * 1) / 4 * 4.0 / (1 + 1 / 3))


def test_against_an_immovable_body_the_moving_ones_elasticity_counts():
    assert two_body_impulse((2.0, np.inf), (3.0, 0.0), elasticity=(1.5, 1.0)) == pytest.approx(1.5 * 3.0 * 2.0)


def test_parting_bodies_do_not_collide():
    assert two_body_impulse((1.0, 1.0), (-1.0, 1.0)) == 0.0
    np.testing.assert_array_equal(two_body_impulse_along((1.0, 1.0), [[-1.0, 5], [1.0, 0]], np.eye(2)), [0.0, 0.0])


def test_elasticity_zero_is_no_collision():
    assert two_body_impulse((1.0, 1.0), (1.0, -1.0), elasticity=(0.0, 0.0)) == 0.0


def test_tunnelling_and_energy_gain_only_by_name_and_with_a_warning():
    with pytest.raises(ProblemError, match=r"elasticity\[0\] is 0.5: between 0 and 1 the bodies tunnel"):
        two_body_impulse((1.0, 1.0), (1.0, -1.0), elasticity=(0.5, 1.0))
    with pytest.warns(ElasticityWarning, match="will tunnel"):
        impulse = two_body_impulse((1.0, 1.0), (1.0, -1.0), elasticity=(0.5, 0.5), allow="tunnelling")
    w1, w2 = after((1.0, 1.0), (1.0, -1.0), impulse)
    assert w1 > w2
    with pytest.raises(ProblemError, match=r"elasticity\[1\] is 2.5: above 2 the collision gains energy"):
        two_body_impulse((1.0, 1.0), (1.0, -1.0), elasticity=(1.0, 2.5))
    with pytest.warns(ElasticityWarning, match="gains energy"):
        impulse = two_body_impulse((1.0, 1.0), (1.0, -1.0), elasticity=(2.5, 2.5), allow="energy_gain")
    assert sum(w**2 for w in after((1.0, 1.0), (1.0, -1.0), impulse)) > 2.0
    with pytest.raises(ProblemError, match="below 0 the force would be reversed"):
        two_body_impulse((1.0, 1.0), (1.0, -1.0), elasticity=(-1.0, 1.0), allow="tunnelling")


def test_a_basis_separates_bounciness_from_friction():
    turn = np.array([[0.6, 0.8], [-0.8, 0.6]])
    velocity = np.array([[2.0, 1.0], [0.0, 0.0]]) @ turn
    mass = (1.0, np.inf)
    for tangential, sliding in ((0.0, 1.0), (1.0, 0.0), (2.0, -1.0), (0.5, 0.5)):
        impulse = two_body_impulse_along(mass, velocity, turn, elasticity=[1.5, tangential])
        left = turn @ (velocity[0] - impulse @ turn / mass[0])
        np.testing.assert_allclose(left, [-1.0, sliding], atol=1e-12)


@pytest.mark.parametrize(
    ("arguments", "options", "error", "message"),
    [
        (((1.0, -1.0), (1.0, 0.0)), {}, ProblemError, r"mass\[1\] is -1: it must be positive"),
        (((1.0, 0.0), (1.0, 0.0)), {}, ProblemError, r"mass\[1\] is 0"),
        (((np.nan, 1.0), (1.0, 0.0)), {}, ProblemError, r"mass\[0\] is nan"),
        (((np.inf, np.inf), (1.0, 0.0)), {}, ProblemError, "infinite for both"),
        (((1.0,), (1.0, 0.0)), {}, ProblemError, r"mass has shape \(1,\)"),
        (((1.0, 1.0), (1.0, np.nan)), {}, ProblemError, r"velocity\[1\] is nan"),
        (((1.0, 1.0), (1.0, 0.0)), {"rule": "mine"}, SettingsError, "rule is 'mine'"),
        (((1.0, 1.0), (1.0, 0.0)), {"allow": "all"}, SettingsError, "allow is 'all'"),
    ],
)
def test_bad_input_is_refused(arguments, options, error, message):
    with pytest.raises(error, match=message):
        two_body_impulse(*arguments, **options)


def test_a_skewed_basis_is_refused():
    with pytest.raises(ProblemError, match="not orthonormal"):
        two_body_impulse_along((1.0, 1.0), np.zeros((2, 2)), [[1.0, 0.0], [1.0, 1.0]])
    with pytest.raises(ProblemError, match="elasticity does not fit"):
        two_body_impulse_along((1.0, 1.0), np.zeros((2, 2)), np.eye(2), elasticity=[1.0, 1.0, 1.0])

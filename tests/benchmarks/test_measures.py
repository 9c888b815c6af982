"""The measures against contact sets made by hand, whose loads are known."""

from dataclasses import replace

import numpy as np
import pytest

import gpx_lcp as gpx
from benchmarks.bodies import Bodies, rotation_matrices
from benchmarks.interface import Contacts, Motion
from benchmarks.measures import contact_frames, cut_load_errors, measure

DT = 1 / 240
CORNERS = np.array([(0.5, 0.5), (0.5, -0.5), (-0.5, 0.5), (-0.5, -0.5)])


def two_cubes() -> Bodies:
    return Bodies.from_scene(gpx.scenes.tower(2))


def resting_contacts(lower_share: float = 1.0, upper_share: float = 1.0) -> Contacts:
    """Four corner contacts per face of a tower of two cubes, each face carrying that share of the weight above it."""
    points = np.array([(x, y, height) for height in (0.0, 1.0) for x, y in CORNERS])
    weight = np.repeat([2 * 9.81 * lower_share, 9.81 * upper_share], 4)
    impulse = np.zeros((8, 3))
    impulse[:, 2] = 0.25 * weight * DT
    return Contacts(
        body_a=np.repeat([-1, 0], 4),
        body_b=np.repeat([0, 1], 4),
        point_a=points,
        point_b=points,
        normal=np.tile([0.0, 0.0, 1.0], (8, 1)),
        gap=np.zeros(8),
        friction=np.full(8, 0.5),
        impulse=impulse,
    )


def test_exact_loads_have_no_error_in_any_measure():
    bodies = two_cubes()
    measures = measure(bodies, bodies.start, bodies.start, resting_contacts(), DT)
    assert max(measures.load_error, measures.body_error, measures.certificate.natural_map, measures.unexplained) < 1e-14
    assert measures.penetration == measures.drift == measures.certificate.cone_violation == 0.0


@pytest.mark.parametrize(
    ("lower", "upper", "errors"), [(0.5, 1.0, [0.5, 0.0]), (1.0, 0.0, [0.0, 1.0]), (1.25, 1, [0.25, 0])]
)
def test_cut_errors_are_the_missing_share_of_the_weight_above(lower, upper, errors):
    found = cut_load_errors(two_cubes(), resting_contacts(lower, upper), DT)
    np.testing.assert_allclose(found, errors, atol=1e-14)


def test_a_contact_counts_the_same_whichever_body_comes_first():
    contacts = resting_contacts(0.9, 0.8)
    turned = replace(
        contacts,
        body_a=contacts.body_b,
        body_b=contacts.body_a,
        normal=-contacts.normal,
        impulse=-contacts.impulse,
    )
    bodies = two_cubes()
    one, other = (measure(bodies, bodies.start, bodies.start, c, DT) for c in (contacts, turned))
    assert one.figures() == pytest.approx(other.figures(), rel=1e-12, abs=1e-14)
    assert one.certificate.natural_map == pytest.approx(other.certificate.natural_map, rel=1e-12, abs=1e-14)


def test_no_contact_carries_nothing_and_leaves_free_fall():
    empty = Contacts(**{name: value[:0] for name, value in vars(resting_contacts()).items()})
    bodies = two_cubes()
    measures = measure(bodies, bodies.start, bodies.start, empty, DT)
    assert (measures.load_error, measures.body_error, measures.unexplained) == pytest.approx((1.0, 1.0, 1.0))


def test_body_error_is_the_acceleration_left_in_units_of_gravity():
    bodies = two_cubes()
    # The lower cube carries 1.1 times both weights: 0.2 of its own weight is left over.
    measures = measure(bodies, bodies.start, bodies.start, resting_contacts(lower_share=1.1), DT)
    assert measures.body_error == pytest.approx(0.2)


def test_penetration_and_drift_are_lengths():
    bodies = two_cubes()
    contacts = replace(resting_contacts(), gap=np.array([0, 0, 0, -0.003, 0.5, 0, 0, 0]))
    after = Motion(
        bodies.start.position + np.array([[0, 0, 0], [0.3, 0.4, 0]]), bodies.start.orientation, bodies.start.velocity
    )
    measures = measure(bodies, bodies.start, after, contacts, DT)
    assert (measures.penetration, measures.drift) == pytest.approx((0.003, 0.5))


def test_a_velocity_that_the_impulses_do_not_give_is_unexplained():
    bodies = two_cubes()
    velocity = bodies.start.velocity.copy()
    velocity[1, 2] = 9.81 * DT
    after = replace(bodies.start, velocity=velocity)
    assert measure(bodies, bodies.start, after, resting_contacts(), DT).unexplained == pytest.approx(1.0)


def test_friction_beyond_the_cone_shows_in_the_certificate_and_not_in_the_loads():
    contacts = resting_contacts()
    # Opposite pushes at two corners: in balance, but more than μ times the normal impulse.
    contacts.impulse[4, 0], contacts.impulse[5, 0] = 1.0, -1.0
    bodies = two_cubes()
    measures = measure(bodies, bodies.start, bodies.start, contacts, DT)
    assert measures.load_error < 1e-14
    assert measures.certificate.cone_violation > 1.0


def test_the_law_allows_an_open_gap_to_close_within_the_step():
    bodies = two_cubes()
    fall = 9.81 * DT * DT
    contacts = resting_contacts(0.0, 0.0)
    falls = measure(bodies, bodies.start, bodies.start, replace(contacts, gap=np.full(8, fall)), DT)
    overlaps = measure(bodies, bodies.start, bodies.start, contacts, DT)
    assert falls.certificate.penetration_velocity < 1e-12
    assert overlaps.certificate.penetration_velocity == pytest.approx(1.0)


def test_contact_frames_are_right_handed_and_start_with_the_normal():
    normal = np.random.default_rng(3).normal(size=(50, 3))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    frames = contact_frames(normal)
    np.testing.assert_allclose(frames @ frames.transpose(0, 2, 1), np.broadcast_to(np.eye(3), (50, 3, 3)), atol=1e-14)
    np.testing.assert_allclose(np.linalg.det(frames), 1.0)
    np.testing.assert_array_equal(frames[:, 0], normal)


def test_inverse_mass_turns_with_the_body():
    scene = gpx.Scene()
    scene.add_rigid(gpx.Box(1, 2, 3), 2.0)
    half = np.sqrt(0.5)
    quarter_turn_about_z = np.array([[half, 0.0, 0.0, half]])
    np.testing.assert_allclose(rotation_matrices(quarter_turn_about_z)[0] @ [1, 0, 0], [0, 1, 0], atol=1e-15)
    block = Bodies.from_scene(scene).inverse_mass(quarter_turn_about_z)[0]
    ix, iy, iz = 2 / 12 * np.array([13, 10, 5])
    np.testing.assert_allclose(np.diag(block), [0.5, 0.5, 0.5, 1 / iy, 1 / ix, 1 / iz])


def test_a_scene_that_the_measures_do_not_understand_is_refused():
    with pytest.raises(gpx.ProblemError, match="no moving body"):
        Bodies.from_scene(gpx.Scene())
    scene = gpx.Scene()
    scene.add_rigid(gpx.Sphere(1.0), 1.0, force=(1.0, 0.0, 0.0), name="pushed")
    with pytest.raises(gpx.ProblemError, match="pushed has a force"):
        Bodies.from_scene(scene)

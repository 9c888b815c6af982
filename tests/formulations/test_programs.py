"""Each program against answers on paper: where it agrees with Coulomb's law, and by how much it errs where not."""

import numpy as np
import pytest

import gpx_lcp as gpx
from formulations import (
    RESIDUALS,
    StackedSystem,
    box_impulse,
    box_lcp,
    certify,
    cone_rows,
    normal_lcp,
    pyramid_impulse,
    pyramid_lcp,
    pyramid_qp,
)

MASS, FRICTION, FALL, SPEED = 2.0, 0.5, 9.81 / 240, 3.0
ANGLES = np.linspace(0.0, np.pi / 2, 13)


def thrown(angle, mass=MASS, mu=FRICTION, speed=SPEED):
    """A point mass thrown along the ground at an angle to the first tangent."""
    B = np.array([FALL, -speed * np.cos(angle), -speed * np.sin(angle)])
    return StackedSystem(np.eye(3) / mass, B, [mu])


def resting(angle, load, mass=MASS, mu=FRICTION):
    """A point mass at rest that is pushed along the ground with `load` times the friction it can get."""
    push = load * mu * FALL
    return StackedSystem(np.eye(3) / mass, [FALL, -push * np.cos(angle), -push * np.sin(angle)], [mu])


@pytest.mark.parametrize("angle", ANGLES)
def test_coulomb_brakes_by_mu_g_in_every_direction(angle):
    solution = gpx.solve(thrown(angle), "coulomb", "pgs", tolerance=1e-12)
    braking = SPEED - np.linalg.norm(solution.velocity[0, 1:])
    assert braking == pytest.approx(FRICTION * FALL, abs=1e-9)
    assert solution.impulse[0, 0] == pytest.approx(MASS * FALL, rel=1e-9)
    assert solution.certificate.sliding_angle < 1e-6


@pytest.mark.parametrize("angle", ANGLES)
@pytest.mark.parametrize("solver", ["pgs", "clarabel"])
def test_the_cone_program_is_isotropic_but_dilates(angle, solver):
    """While sliding at v it asks p_n = m (g dt + μ v)/(1 + μ²) and opens at u_n = μ‖u_t‖: F6 of the failure modes."""
    if not gpx.solvers()[solver].installed:
        pytest.skip(f"{solver} is not installed")
    solution = gpx.solve(thrown(angle), "cone", solver, tolerance=1e-10)
    assert solution.impulse[0, 0] == pytest.approx(MASS * (FALL + FRICTION * SPEED) / (1 + FRICTION**2), rel=1e-8)
    assert solution.velocity[0, 0] == pytest.approx(FRICTION * np.linalg.norm(solution.velocity[0, 1:]), rel=1e-8)
    assert solution.certificate.natural_map > 0.1


@pytest.mark.parametrize("angle", ANGLES)
@pytest.mark.parametrize("solver", ["pgs", "lemke"])
def test_the_box_brakes_each_axis_apart(angle, solver):
    """Friction of a box is μ p_n along each axis that slides: up to √2 too strong, and turned towards the diagonal."""
    solution = gpx.solve(thrown(angle), "box", solver, tolerance=1e-11)
    slides = np.array([np.cos(angle), np.sin(angle)]) * SPEED > FRICTION * FALL
    expected = np.where(slides, FRICTION * MASS * FALL, [np.cos(angle) * SPEED * MASS, np.sin(angle) * SPEED * MASS])
    np.testing.assert_allclose(-solution.impulse[0, 1:], expected, atol=1e-9)
    assert solution.impulse[0, 0] == pytest.approx(MASS * FALL, rel=1e-9)


@pytest.mark.parametrize("angle", ANGLES)
@pytest.mark.parametrize("facets", [4, 8])
@pytest.mark.parametrize("solver", ["pgs", "lemke"])
def test_the_pyramid_brakes_along_its_nearest_corner(angle, facets, solver):
    """Sliding friction has the full size μ p_n, but points at the nearest corner: up to π/k askew."""
    solution = gpx.solve(thrown(angle), "pyramid", solver, tolerance=1e-11, facets=facets)
    friction = -solution.impulse[0, 1:] / (FRICTION * MASS * FALL)
    along = friction @ [np.cos(angle), np.sin(angle)]
    assert along >= np.cos(np.pi / facets) - 1e-9
    spacing = 2 * np.pi / facets
    askew = abs((angle + spacing / 2) % spacing - spacing / 2)
    if askew < spacing / 2 - 1e-3:
        assert along == pytest.approx(np.cos(askew), abs=1e-9)
        assert np.linalg.norm(friction) == pytest.approx(1.0, abs=1e-9)


@pytest.mark.parametrize(
    ("formulation", "strength"),
    [
        ("coulomb", lambda angle: 1.0),
        ("cone", lambda angle: 1.0),
        ("box", lambda angle: 1.0 / max(abs(np.cos(angle)), abs(np.sin(angle)))),
        ("pyramid", lambda angle: 1.0 / (abs(np.cos(angle)) + abs(np.sin(angle)))),
    ],
)
@pytest.mark.parametrize("angle", ANGLES)
def test_holding_strength_by_direction(formulation, strength, angle):
    """A push just below the strength holds, one just above slides: 1, √2 for the box, 1/√2 for four facets."""
    for load, holds in ((0.999 * strength(angle), True), (1.001 * strength(angle), False)):
        solution = gpx.solve(resting(angle, load), formulation, "pgs", tolerance=1e-12, facets=4)
        speed = np.linalg.norm(solution.velocity[0, 1:])
        assert (speed <= 1e-10) == holds


def test_frictionless_contacts_slide_freely():
    solution = gpx.solve(thrown(0.3), "normal", "lemke")
    np.testing.assert_allclose(solution.impulse, [[MASS * FALL, 0.0, 0.0]], atol=1e-15)
    assert np.linalg.norm(solution.velocity[0, 1:]) == pytest.approx(SPEED)


@pytest.mark.parametrize("formulation", ["box", "pyramid", "coulomb"])
def test_in_the_plane_box_and_pyramid_are_coulombs_law(formulation, random_system):
    solver = "pgs" if formulation == "coulomb" else "lemke"
    for seed in range(5):
        system = random_system(seed, rows=2)
        solution = gpx.solve(system, formulation, solver, tolerance=1e-9, max_iterations=100_000)
        assert solution.certificate.natural_map <= 1e-9


def test_the_lcps_have_the_shape_and_the_signs_of_their_derivation():
    system = thrown(0.3)
    assert normal_lcp(system).q == pytest.approx([-FALL])
    pyramid = pyramid_lcp(system, 4)
    assert pyramid.q.size == 1 + 4 + 1
    np.testing.assert_allclose(pyramid.M[5], [FRICTION, -1, -1, -1, -1, 0])
    np.testing.assert_allclose(pyramid.M[1:5, 5], 1.0)
    box = box_lcp(system)
    assert box.q.size == 1 + 4 + 2
    np.testing.assert_allclose(box.M[5], [FRICTION, -1, -1, 0, 0, 0, 0])
    np.testing.assert_allclose(
        pyramid_impulse(system, np.array([1.0, 0.3, 0, 0.1, 0, 9]), 4), [[1.0, 0.2, 0.0]], atol=1e-15
    )
    np.testing.assert_allclose(box_impulse(system, np.array([1.0, 0.3, 0, 0, 0.2, 9, 9])), [[1.0, 0.3, -0.2]])


def test_the_facets_of_the_pyramid_qp_meet_its_corners():
    system = thrown(0.0)
    qp = pyramid_qp(system, 8)
    for corner in range(8):
        angle = 2 * np.pi * corner / 8
        point = np.array([1.0, FRICTION * np.cos(angle), FRICTION * np.sin(angle)])
        slack = -(qp.G @ point)
        assert slack.min() >= -1e-15
        assert np.sum(slack < 1e-12) == 2


def test_cone_rows_scale_the_normal_by_friction():
    rows, sizes = cone_rows(thrown(0.0))
    np.testing.assert_allclose(rows @ [2.0, 0.3, 0.4], [1.0, 0.3, 0.4, 2.0])
    assert sizes == [3, 1]


@pytest.mark.parametrize("program", sorted(RESIDUALS))
def test_residuals_have_no_unit(program, random_system):
    system = random_system(3)
    impulse = np.random.default_rng(0).normal(size=(6, 3))
    heavy = StackedSystem(system.A / 1e6, system.B * 1e3, system.friction)
    assert RESIDUALS[program](heavy, 1e9 * impulse, 8) == pytest.approx(
        RESIDUALS[program](system, impulse, 8), rel=1e-9
    )


def test_the_coulomb_residual_is_the_certificates_natural_map(random_system):
    system = random_system(4)
    impulse = np.random.default_rng(1).normal(size=(6, 3))
    assert RESIDUALS["coulomb"](system, impulse, 8) == certify(system, impulse).natural_map

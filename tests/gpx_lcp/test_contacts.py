"""Contact manifolds of every pair of shapes, against geometry done by hand."""

import numpy as np
import pytest

import gpx_lcp as gpx

UPRIGHT = (1.0, 0.0, 0.0, 0.0)
CORNERS = np.array([(x, y, z) for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])


def turned(axis, angle):
    return (np.cos(angle / 2), *(np.sin(angle / 2) * np.asarray(axis, dtype=float)))


LYING = turned((1, 0, 0), np.pi / 2)


def contacts(lower, upper, height, orientation=UPRIGHT, shift=(0.0, 0.0), lower_orientation=UPRIGHT):
    scene = gpx.Scene(gravity=(0, 0, 0))
    scene.add_static(lower, orientation=lower_orientation)
    scene.add_rigid(upper, 1.0, position=(*shift, height), orientation=orientation)
    return gpx.World(scene, 1e-2).contacts


def sorted_rows(points):
    rounded = np.round(points, 9) + 0.0
    return points[np.lexsort(rounded.T)]


HULL = gpx.ConvexHull(CORNERS)
PRISM = gpx.ConvexHull([(np.cos(t), np.sin(t), z) for t in np.arange(6) * np.pi / 3 for z in (-0.5, 0.5)])


@pytest.mark.parametrize("gap", [0.0, 1e-16, -1e-16, 1e-9, -1e-9, -1e-3])
@pytest.mark.parametrize(
    ("lower", "upper", "height", "orientation", "corners"),
    [
        (gpx.HalfSpace(), gpx.Sphere(0.5), 0.5, UPRIGHT, [(0, 0)]),
        (gpx.HalfSpace(), gpx.Box(1, 1, 1), 0.5, UPRIGHT, [(-0.5, -0.5), (0.5, -0.5), (-0.5, 0.5), (0.5, 0.5)]),
        (gpx.HalfSpace(), gpx.Capsule(0.5, 2), 0.5, LYING, [(0, -1), (0, 1)]),
        (gpx.HalfSpace(), gpx.Capsule(0.5, 2), 1.5, UPRIGHT, [(0, 0)]),
        (gpx.HalfSpace(), gpx.Cylinder(0.5, 2), 0.5, LYING, [(0, -1), (0, 1)]),
        (gpx.HalfSpace(), HULL, 0.5, UPRIGHT, [(-0.5, -0.5), (0.5, -0.5), (-0.5, 0.5), (0.5, 0.5)]),
        (gpx.Box(3, 3, 1), gpx.Sphere(0.5), 1.0, UPRIGHT, [(0, 0)]),
        (gpx.Box(1, 1, 1), gpx.Box(1, 1, 1), 1.0, UPRIGHT, [(-0.5, -0.5), (0.5, -0.5), (-0.5, 0.5), (0.5, 0.5)]),
        (gpx.Box(3, 3, 1), gpx.Capsule(0.5, 2), 1.0, LYING, [(0, -1), (0, 1)]),
        (gpx.Box(3, 3, 1), gpx.Cylinder(0.5, 2), 1.0, LYING, [(0, -1), (0, 1)]),
        (gpx.Box(3, 3, 1), HULL, 1.0, UPRIGHT, [(-0.5, -0.5), (0.5, -0.5), (-0.5, 0.5), (0.5, 0.5)]),
        (HULL, HULL, 1.0, UPRIGHT, [(-0.5, -0.5), (0.5, -0.5), (-0.5, 0.5), (0.5, 0.5)]),
        (PRISM, PRISM, 1.0, UPRIGHT, [(np.cos(t), np.sin(t)) for t in np.arange(6) * np.pi / 3]),
        (HULL, gpx.Sphere(0.5), 1.0, UPRIGHT, [(0, 0)]),
        (HULL, gpx.Capsule(0.5, 1), 1.5, UPRIGHT, [(0, 0)]),
        (gpx.Cylinder(2, 1), gpx.Sphere(0.5), 1.0, UPRIGHT, [(0, 0)]),
        (gpx.Cylinder(2, 1), gpx.Box(1, 1, 1), 1.0, UPRIGHT, [(-0.5, -0.5), (0.5, -0.5), (-0.5, 0.5), (0.5, 0.5)]),
        (gpx.Cylinder(2, 1), gpx.Capsule(0.5, 1), 1.0, LYING, [(0, -0.5), (0, 0.5)]),
        (gpx.Sphere(0.5), gpx.Sphere(0.25), 0.75, UPRIGHT, [(0, 0)]),
        (gpx.Sphere(0.5), gpx.Box(1, 1, 1), 1.0, UPRIGHT, [(0, 0)]),
    ],
)
def test_bodies_that_rest_on_each_other(lower, upper, height, orientation, corners, gap):
    found = contacts(lower, upper, height + gap, orientation)
    assert np.allclose(found.normal, [0, 0, 1], atol=1e-9)
    assert found.gap == pytest.approx([gap] * len(corners), abs=1e-12)
    assert sorted_rows(found.point[:, :2]) == pytest.approx(sorted_rows(np.array(corners, dtype=float)), abs=1e-9)
    assert np.ptp(found.point[:, 2]) < 1e-9


@pytest.mark.parametrize("lower", [gpx.HalfSpace(), gpx.Box(4, 4, 1), gpx.Cylinder(3, 1)], ids=lambda s: s.kind)
def test_an_upright_cylinder_stands_on_eight_points_of_its_rim(lower):
    found = contacts(lower, gpx.Cylinder(0.5, 2), 1.0 if isinstance(lower, gpx.HalfSpace) else 1.5)
    assert len(found.gap) == 8
    assert np.linalg.norm(found.point[:, :2], axis=1) == pytest.approx([0.5] * 8, abs=1e-12)
    assert np.allclose(found.gap, 0.0, atol=1e-12)


@pytest.mark.parametrize("gap", [0.0, 1e-12, -1e-12, -1e-3])
@pytest.mark.parametrize("shape", [gpx.Cylinder(0.5, 2), gpx.Capsule(0.5, 2)], ids=lambda s: s.kind)
def test_parallel_round_sides_touch_along_a_line(shape, gap):
    found = contacts(shape, shape, 1.0 + gap, LYING, shift=(0.0, 0.5), lower_orientation=LYING)
    assert np.allclose(found.normal, [0, 0, 1], atol=1e-9)
    assert found.gap == pytest.approx([gap, gap], abs=1e-12)
    assert sorted_rows(found.point)[:, 1] == pytest.approx([-0.5, 1.0])


@pytest.mark.parametrize("shape", [gpx.Cylinder(0.5, 2), gpx.Capsule(0.5, 2)], ids=lambda s: s.kind)
def test_crossed_round_sides_touch_in_a_point(shape):
    found = contacts(shape, shape, 1.0, LYING, shift=(0.3, 0.2), lower_orientation=turned((0, 1, 0), np.pi / 2))
    assert found.point == pytest.approx(np.array([[0.3, 0.0, 0.5]]), abs=1e-9)
    assert found.gap == pytest.approx([0.0], abs=1e-12)
    assert found.normal == pytest.approx(np.array([[0, 0, 1]]), abs=1e-9)


@pytest.mark.parametrize("gap", [0.0, 1e-14, -1e-14, -1e-3])
@pytest.mark.parametrize("shape", [gpx.Box(1, 1, 1), HULL], ids=lambda s: s.kind)
def test_crossed_edges_touch_in_a_point_along_their_common_normal(shape, gap):
    """Two cubes, each balanced on an edge: the lower one's edge runs along x, the upper one's along y."""
    lower, upper = turned((1, 0, 0), np.pi / 4), turned((0, 1, 0), np.pi / 4)
    found = contacts(shape, shape, np.sqrt(2) + gap, upper, shift=(0.1, 0.2), lower_orientation=lower)
    assert found.point == pytest.approx(np.array([[0.1, 0.0, np.sqrt(0.5) + gap / 2]]), abs=1e-9)
    assert found.gap == pytest.approx([gap], abs=1e-12)
    assert found.normal == pytest.approx(np.array([[0, 0, 1]]), abs=1e-9)


def test_cubes_turned_against_each_other_touch_on_an_octagon():
    found = contacts(gpx.Box(1, 1, 1), gpx.Box(1, 1, 1), 1.0, turned((0, 0, 1), np.pi / 4))
    assert len(found.gap) == 8
    assert np.linalg.norm(found.point[:, :2], axis=1) == pytest.approx([0.5 / np.cos(np.pi / 8)] * 8, abs=1e-12)


@pytest.mark.parametrize("noise", [1e-16, 1e-12, 1e-9])
def test_rounding_neither_loses_nor_adds_corners(noise):
    rng = np.random.default_rng(1)
    for _ in range(200):
        tilt = turned(rng.normal(size=3) / 2, noise)
        tilt = np.asarray(tilt) / np.linalg.norm(tilt)
        found = contacts(gpx.Box(1, 1, 1), gpx.Box(1, 1, 1), 1.0, tilt, shift=noise * rng.normal(size=2))
        assert sorted_rows(np.abs(found.point[:, :2])) == pytest.approx(np.full((4, 2), 0.5), abs=10 * noise + 1e-12)
        assert np.allclose(found.normal, [0, 0, 1], atol=1e-8)


def test_a_tilted_box_over_the_ground_shows_its_two_low_corners():
    angle = 0.3
    height = 0.5 * np.sin(angle) + 0.5 * np.cos(angle)
    found = contacts(gpx.HalfSpace(), gpx.Box(1, 1, 1), height, turned((1, 0, 0), angle))
    assert len(found.gap) == 2
    assert np.allclose(found.gap, 0.0, atol=1e-15)


def test_deep_overlap_is_pushed_out_the_short_way():
    found = contacts(gpx.Box(4, 4, 1), gpx.Sphere(0.5), 0.3)
    assert found.normal == pytest.approx(np.array([[0, 0, 1]]))
    assert found.gap == pytest.approx([-0.7])
    found = contacts(gpx.Box(4, 4, 1), gpx.Box(1, 1, 1), 0.8)
    assert np.allclose(found.normal, [0, 0, 1])
    assert np.allclose(found.gap, -0.2)


def test_balls_with_the_same_centre_still_give_a_contact():
    found = contacts(gpx.Sphere(0.5), gpx.Sphere(0.5), 0.0)
    assert found.gap.tolist() == [-1.0]
    assert np.linalg.norm(found.normal) == 1.0


def test_a_ball_whose_centre_lies_on_a_face_is_pushed_out_of_that_face():
    found = contacts(gpx.Box(4, 4, 1), gpx.Sphere(0.5), 0.5, shift=(0.2, 0.3))
    assert found.normal.tolist() == [[0, 0, 1]]
    assert found.gap.tolist() == [-0.5]


def test_frames_are_right_handed_and_orthonormal_for_any_normal():
    rng = np.random.default_rng(3)
    for normal in [*rng.normal(size=(50, 3)), *np.eye(3), *-np.eye(3)]:
        unit = normal / np.linalg.norm(normal)
        scene = gpx.Scene(gravity=(0, 0, 0))
        scene.add_static(gpx.HalfSpace(normal))
        scene.add_rigid(gpx.Sphere(0.5), 1.0, position=0.5 * unit)
        (frame,) = gpx.World(scene, 0.01).contacts.frame
        assert np.allclose(frame @ frame.T, np.eye(3), atol=1e-15)
        assert np.linalg.det(frame) == pytest.approx(1.0)
        assert np.allclose(frame[0], unit, atol=1e-15)


def test_bodies_far_apart_have_no_contacts_and_fast_ones_are_seen_coming():
    assert len(contacts(gpx.HalfSpace(), gpx.Sphere(0.5), 0.6).gap) == 0
    scene = gpx.Scene(gravity=(0, 0, 0))
    scene.add_static(gpx.HalfSpace())
    scene.add_rigid(gpx.Box(1, 1, 1), 1.0, position=(0, 0, 0.6), velocity=(0, 0, -30))
    assert gpx.World(scene, 0.01).contacts.gap == pytest.approx([0.1] * 4)


def test_bodies_without_a_shape_and_two_fixed_bodies_touch_nothing():
    scene = gpx.Scene()
    scene.add_static(gpx.HalfSpace())
    scene.add_static(gpx.Box(1, 1, 1))
    scene.add_point_mass(1.0)
    scene.add_rigid(None, 1.0, inertia=(1, 1, 1))
    assert len(gpx.World(scene, 0.01).contacts.gap) == 0


def test_the_fixed_body_is_body_a_and_of_two_moving_ones_the_first():
    world = gpx.World(gpx.scenes.tower(3), 0.01)
    assert world.contacts.body_a.tolist() == [-1] * 4 + [0] * 4 + [1] * 4
    assert world.contacts.body_b.tolist() == [0] * 4 + [1] * 4 + [2] * 4
    assert np.allclose(world.contacts.normal, [0, 0, 1])


def test_many_bodies_find_all_their_neighbours():
    """The broad phase against every pair of balls, one by one."""
    rng = np.random.default_rng(8)
    centres = rng.uniform(0, 4, (200, 3))
    scene = gpx.Scene(gravity=(0, 0, 0))
    for centre in centres:
        scene.add_rigid(gpx.Sphere(0.25), 1.0, position=centre)
    found = gpx.World(scene, 0.01).contacts
    distance = np.linalg.norm(centres[:, None] - centres[None], axis=2)
    expected = {(i, j) for i, j in np.argwhere(distance <= 0.5).tolist() if i < j}
    assert set(zip(found.body_a.tolist(), found.body_b.tolist(), strict=True)) == expected
    assert len(found.gap) == len(expected)

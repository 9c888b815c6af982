"""Bodies, shapes and materials: what they compute, and every way to get them wrong."""

import operator

import numpy as np
import pytest

import gpx_lcp as gpx

RNG = np.random.default_rng(5)
CUBE_CORNERS = [(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]


def sampled_inertia(inside, bound, mass, samples=400_000):
    points = np.random.default_rng(0).uniform(-1, 1, (samples, 3)) * bound
    points = points[inside(points)]
    second = points.T @ points / len(points)
    return mass * (np.trace(second) * np.eye(3) - second)


def capsule(p):
    return np.hypot(np.hypot(p[:, 0], p[:, 1]), np.maximum(np.abs(p[:, 2]) - 0.5, 0)) < 0.4


def cylinder(p):
    return (np.hypot(p[:, 0], p[:, 1]) < 0.4) & (np.abs(p[:, 2]) < 0.5)


@pytest.mark.parametrize(
    ("shape", "inside"),
    [
        (gpx.Sphere(0.9), lambda p: np.linalg.norm(p, axis=1) < 0.9),
        (gpx.Box(0.4, 0.8, 1.8), lambda p: (np.abs(p) < [0.2, 0.4, 0.9]).all(axis=1)),
        (gpx.Capsule(0.4, 1.0), capsule),
        (gpx.Cylinder(0.4, 1.0), cylinder),
    ],
    ids=lambda value: getattr(value, "kind", ""),
)
def test_inertia_is_that_of_a_uniform_solid(shape, inside):
    expected = sampled_inertia(inside, 1.0, 3.0)
    assert np.allclose(shape.inertia(3.0), expected, atol=0.02 * expected.max())


def test_hull_of_a_box_has_the_inertia_volume_and_centre_of_the_box():
    corners = np.array(CUBE_CORNERS) * [0.5, 1.0, 1.5] + [7, -3, 2]
    hull = gpx.ConvexHull(np.vstack((corners, [[7, -3, 2]])))
    assert len(hull.points) == 8
    assert hull.volume == pytest.approx(6.0, rel=1e-12)
    assert hull.centroid == pytest.approx([7, -3, 2], abs=1e-12)
    assert np.allclose(hull.inertia(2.0), gpx.Box(1, 2, 3).inertia(2.0), atol=1e-12)


def test_a_hull_that_mirrors_itself_has_its_centre_and_axes_in_the_mirror():
    """To the last bit, however its faces are cut into triangles."""
    for corners in np.random.default_rng(3).normal(size=(50, 7, 2)):
        hull = gpx.ConvexHull([(x, y, z) for y in (-0.35, 0.35) for x, z in corners])
        assert hull.centroid[1] == 0.0
        assert hull.inertia(3.0)[1, [0, 2]].tolist() == [0.0, 0.0]


def test_bodies_are_rows_of_the_worlds_arrays():
    scene = gpx.Scene()
    ground = scene.add_static(gpx.HalfSpace())
    first = scene.add_rigid(gpx.Sphere(1), 1.0, position=(1, 2, 3), name="ball")
    second = scene.add_point_mass(2.0, position=(4, 5, 6), velocity=(7, 8, 9))
    world = gpx.World(scene, 0.01)
    assert world.positions[first].tolist() == [1, 2, 3]
    assert world.velocities[second].tolist() == [7, 8, 9, 0, 0, 0]
    assert [body.name for body in world.bodies] == ["ball", "body 1"]
    with pytest.raises(TypeError, match="fixed body 0 never moves"):
        operator.index(ground)
    with pytest.raises(IndexError):
        world.positions[ground]


def test_given_inertia_may_be_a_diagonal_and_the_quaternion_is_made_unit():
    scene = gpx.Scene()
    body = scene.add_rigid(None, 1.0, inertia=(1, 2, 2.5), orientation=(1, 1e-7, 0, 0))
    assert body.inertia.tolist() == np.diag([1, 2, 2.5]).tolist()
    assert np.linalg.norm(body.orientation) == 1.0


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        (dict(mass=0.0), r"mass of crate is 0: it must be positive"),
        (dict(mass=-2.0), r"mass of crate is -2: it must be positive"),
        (dict(mass=np.nan), r"mass of crate.* is nan"),
        (dict(mass="heavy"), r"mass of crate is not an array of numbers"),
        (dict(position=(0, np.inf, 0)), r"position of crate\[1\] is inf"),
        (dict(position=(0, 0)), r"position of crate has shape \(2,\), but \(3,\) is needed"),
        (dict(velocity=(0, 0, np.nan)), r"velocity of crate\[2\] is nan"),
        (dict(angular_velocity=1.0), r"angular_velocity of crate has shape \(\)"),
        (dict(force=(np.nan, 0, 0)), r"force of crate\[0\] is nan"),
        (dict(torque=(0, 0, 0, 0)), r"torque of crate has shape \(4,\)"),
        (dict(orientation=(2, 0, 0, 0)), r"orientation of crate has length 2: it must be a unit quaternion"),
        (dict(orientation=(0, 0, 0, 0)), r"orientation of crate has length 0"),
        (dict(inertia=(1, 1, 0)), r"inertia of crate has the principal value 0"),
        (dict(inertia=(1, 1, 3)), r"inertia of crate has the principal values 1, 1, 3"),
        (dict(inertia=[[1, 1, 0], [0, 1, 0], [0, 0, 1]]), r"inertia of crate is not symmetric"),
        (dict(shape="box"), r"shape of crate is a str: a shape such as Box"),
        (dict(shape=None), r"crate has no shape to take its inertia from"),
        (dict(shape=gpx.HalfSpace()), r"crate is a HalfSpace, which cannot move: use add_static"),
        (dict(material=0.5), r"material of crate is a float: a Material is needed"),
    ],
)
def test_a_wrong_body_is_refused_by_name_and_value(wrong, message):
    scene = gpx.Scene()
    with pytest.raises(gpx.ProblemError, match=message):
        scene.add_rigid(**{"shape": gpx.Box(1, 1, 1), "mass": 1.0, "name": "crate", **wrong})
    assert scene.bodies == ()


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: gpx.Sphere(0.0), "radius of a Sphere is 0: it must be positive"),
        (lambda: gpx.Box(1, -1, 1), "y of a Box is -1: it must be positive"),
        (lambda: gpx.Capsule(1, np.nan), r"length of a Capsule.* is nan"),
        (lambda: gpx.Cylinder("a", 1), "radius of a Cylinder is not an array of numbers"),
        (lambda: gpx.HalfSpace((0, 0, 0)), "normal of a HalfSpace is zero"),
        (lambda: gpx.HalfSpace((0, 1)), "normal of a HalfSpace has shape"),
        (lambda: gpx.ConvexHull([[0, 0, 0], [1, 0, 0], [0, 1, 0]]), "the 3 points of a ConvexHull span no volume"),
        (lambda: gpx.ConvexHull(RNG.random((9, 3)) * [1, 1, 0]), "the 9 points of a ConvexHull span no volume"),
        (lambda: gpx.ConvexHull(np.ones((5, 2))), r"points of a ConvexHull has shape \(5, 2\), but \(n, 3\) is needed"),
        (lambda: gpx.HalfSpace().inertia(1.0), "a HalfSpace cannot move"),
        (lambda: gpx.Scene(gravity=(0, 0)), r"gravity has shape \(2,\)"),
        (lambda: gpx.Scene().add_point_mass(-1), "mass of body 0 is -1"),
        (lambda: gpx.Scene().add_point_mass(1, shape=gpx.HalfSpace()), "body 0 is a HalfSpace, which cannot move"),
        (lambda: gpx.Scene().add_static(None), "shape of fixed body 0 is a NoneType"),
    ],
)
def test_a_wrong_shape_or_scene_is_refused(make, message):
    with pytest.raises(gpx.ProblemError, match=message):
        make()


@pytest.mark.parametrize(
    ("wrong", "error", "message"),
    [
        (dict(friction=-0.1), gpx.ProblemError, "friction is -0.1: it must not be negative"),
        (dict(friction=np.nan), gpx.ProblemError, "friction.* is nan"),
        (dict(elasticity=2.5), gpx.ProblemError, "elasticity is 2.5: it must lie between 1 .* and 2"),
        (dict(elasticity=0.5), gpx.ProblemError, "elasticity is 0.5"),
        (dict(elasticity=-1), gpx.ProblemError, "elasticity is -1"),
        (dict(friction_rule="mean"), gpx.SettingsError, "friction_rule is 'mean': it must be one of 'geometric_mean'"),
        (dict(friction_rule="centre_of_mass"), gpx.SettingsError, "friction_rule is 'centre_of_mass'"),
        (dict(elasticity_rule="x"), gpx.SettingsError, "elasticity_rule is 'x': it must be one of 'centre_of_mass'"),
    ],
)
def test_a_wrong_material_is_refused(wrong, error, message):
    with pytest.raises(error, match=message):
        gpx.Material(**wrong)


@pytest.mark.parametrize(
    ("rule", "other", "expected"),
    [
        ("geometric_mean", "geometric_mean", np.sqrt(0.2 * 0.8)),
        ("average", "average", 0.5),
        ("minimum", "minimum", 0.2),
        ("product", "product", 0.16),
        ("maximum", "maximum", 0.8),
        ("minimum", "maximum", 0.8),
        ("maximum", "average", 0.8),
    ],
)
def test_friction_of_a_pair_follows_the_rule_that_stands_later(rule, other, expected):
    scene = gpx.Scene()
    scene.add_static(gpx.HalfSpace(), material=gpx.Material(0.2, friction_rule=rule))
    scene.add_rigid(gpx.Sphere(1), 1.0, position=(0, 0, 1), material=gpx.Material(0.8, friction_rule=other))
    assert gpx.World(scene, 0.01).contacts.friction == pytest.approx([expected], rel=1e-15)


@pytest.mark.parametrize(
    ("rule", "expected"),
    [
        ("centre_of_mass", (1.25 * 3 + 2.0 * 1) / 4),
        ("average", 1.625),
        ("geometric_mean", 1.5),
        ("minimum", 1.25),
        ("maximum", 2.0),
        ("product", 1.25),
    ],
)
def test_elasticity_of_a_pair_sets_the_rebound(rule, expected):
    """Masses 1 and 3 meet head-on: B is the pair's elasticity times the closing speed."""
    scene = gpx.Scene(gravity=(0, 0, 0))
    for k, (mass, elasticity) in enumerate(((1.0, 1.25), (3.0, 2.0))):
        material = gpx.Material(0.0, elasticity, elasticity_rule=rule)
        scene.add_rigid(gpx.Sphere(0.5), mass, position=(k, 0, 0), velocity=(1.5 - 2 * k, 0, 0), material=material)
    assert gpx.World(scene, 0.01).system().B == pytest.approx([2.0 * expected], rel=1e-14)

"""The scene library: each scene is what its docstring says."""

import numpy as np
import pytest

import gpx_lcp as gpx
from gpx_lcp import scenes

G = 9.81


def contacts_of(scene):
    return len(gpx.World(scene, 1 / 240).contacts.gap)


@pytest.mark.parametrize("n", [1, 2, 7, 30])
def test_tower_has_four_touching_contacts_an_interface(n):
    contacts = gpx.World(scenes.tower(n), 1 / 240).contacts
    assert len(contacts.gap) == 4 * n
    assert np.abs(contacts.gap).max() == 0.0


@pytest.mark.parametrize("rows", [1, 2, 5, 10])
def test_wall_bricks_touch_above_and_below_and_never_sideways(rows):
    contacts = gpx.World(scenes.wall(rows), 1 / 60).contacts
    assert len(scenes.wall(rows).bodies) == rows * (rows + 1) // 2
    assert len(contacts.gap) == 4 * rows + 8 * (rows * (rows - 1) // 2)
    assert np.allclose(contacts.normal, [0, 0, 1])


def test_pyramid_of_a_hundred_has_5050_cubes_that_touch_above_and_below_only():
    assert len(scenes.pyramid(100).bodies) == 5050
    assert contacts_of(scenes.pyramid(6)) == 4 * 6 + 8 * 15


def test_sizes_masses_and_friction_reach_the_bodies():
    tower = scenes.tower(2, size=0.5, mass=3.0, friction=0.7)
    assert [body.mass for body in tower.bodies] == [3.0, 3.0]
    assert tower.bodies[1].position.tolist() == [0, 0, 0.75]
    assert tower.bodies[0].material.friction == tower.fixed[0].material.friction == 0.7
    assert [body.mass for body in scenes.heavy_on_light(3, 1000.0).bodies] == [1, 1, 1000]
    assert scenes.cradle(3, 1.5).bodies[0].material.elasticity == 1.5


@pytest.mark.parametrize("legs", [4, 5, 8, 9])
def test_table_stands_on_its_legs(legs):
    world = gpx.World(scenes.table(legs), 1 / 240, tolerance=1e-10)
    assert len(world.contacts.gap) == 8 * legs
    world.step(3)
    on_ground = world.contacts.body_a == -1
    assert world.contacts.force[on_ground, 2].sum() == pytest.approx((10 + legs) * G, rel=1e-7)


def test_column_is_the_chain_on_which_sweeps_contract_as_theory_says():
    n = 10
    system = gpx.World(scenes.column(n), 1 / 240).system()
    chain = 2 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1)
    chain[0, 0] = 1
    assert system.rows == 1
    assert system.jacobian.shape == (n, 3 * n)
    assert np.array_equal(system.A.toarray(), chain)
    sweep = np.eye(n) - np.linalg.solve(np.tril(chain), chain)
    assert np.abs(np.linalg.eigvals(sweep)).max() == pytest.approx(np.cos(np.pi / (2 * n)) ** 2, rel=1e-12)
    impulse = gpx.solve(system, solver="lemke").impulse[:, 0]
    assert impulse == pytest.approx(G / 240 * np.arange(n, 0, -1), rel=1e-9)


def test_cradle_touches_and_knows_no_gravity():
    contacts = gpx.World(scenes.cradle(4), 1 / 240).contacts
    assert contacts.gap.tolist() == [0, 0, 0]
    assert np.allclose(contacts.normal, [1, 0, 0])


def test_rolling_sphere_with_spin_ends_at_the_speed_of_its_docstring():
    world = gpx.World(scenes.rolling_sphere(speed=2.0, spin=3.0), 1 / 240, tolerance=1e-12)
    world.step(240)
    assert world.velocities[0, 0] == pytest.approx((5 * 2 + 2 * 0.5 * 3) / 7, abs=1e-9)


def test_sphere_pile_depends_on_its_seed_alone_and_starts_without_overlap():
    one, same, other = (np.array([b.position for b in scenes.sphere_pile(50, s).bodies]) for s in (1, 1, 2))
    assert np.array_equal(one, same) and not np.array_equal(one, other)
    distance = np.linalg.norm(one[:, None] - one[None], axis=2) + 10 * np.eye(50)
    assert distance.min() > 1.0
    assert (gpx.World(scenes.sphere_pile(50, 1), 1 / 240).contacts.gap > 0).all()


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: scenes.tower(0), "n is 0: it must be a whole number of at least 1"),
        (lambda: scenes.tower(2.5), "n is 2.5"),
        (lambda: scenes.tower(1, mass=-1), "mass of body 0 is -1"),
        (lambda: scenes.tower(1, friction=-1), "friction is -1"),
        (lambda: scenes.wall(True), "rows is True"),
        (lambda: scenes.pyramid(-1), "base is -1"),
        (lambda: scenes.heavy_on_light(2, 0.0), "mass of body 1 is 0"),
        (lambda: scenes.table(3), "legs is 3: it must be a whole number of at least 4"),
        (lambda: scenes.table(10), "legs is 10: it must be at most 9"),
        (lambda: scenes.incline(2.0, 0.5), "angle is 2.0: it must be at least 0 and below"),
        (lambda: scenes.incline(float("nan"), 0.5), "angle is nan"),
        (lambda: scenes.cradle(1), "n is 1: it must be a whole number of at least 2"),
        (lambda: scenes.cradle(3, 2.5), "elasticity is 2.5"),
        (lambda: scenes.sphere_pile(5, seed=-1), "seed is -1"),
        (lambda: scenes.column("ten"), "n is 'ten'"),
    ],
)
def test_a_scene_that_cannot_be_is_refused(make, message):
    with pytest.raises(gpx.ProblemError, match=message):
        make()

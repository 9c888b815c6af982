"""Snapshots: a restored world goes on bit by bit as the one it was taken of; what is no snapshot is refused."""

import io
import json

import numpy as np
import pytest

import gpx_lcp as gpx

DT = 1 / 240
SETTINGS = [
    dict(solver="newton"),
    dict(solver="newton", formulation="cone", tolerance=1e-6),
    dict(solver="interior_point"),
    dict(solver="pgs", iterations=7, relaxation=0.9),
    dict(solver="pgs", formulation="pyramid", facets=6, iterations=7, warm_start=False),
    dict(solver="lemke", formulation="pyramid"),
]


def every_shape():
    """Return a scene with every kind of shape, materials and rules, that slides, rolls and bounces."""
    rough = gpx.Material(0.7, 1.3, "average", "minimum")
    scene = gpx.Scene(gravity=(0.1, 0.2, -9.0))
    scene.add_static(gpx.HalfSpace((0.1, 0, 1)), material=rough, name="slope")
    scene.add_static(gpx.Box(4, 0.1, 4), position=(0, 2, 0))
    scene.add_rigid(gpx.Box(1, 0.7, 0.3), 1.1, position=(0, 0, 0.3), velocity=(1, 0.3, 0), material=rough)
    scene.add_rigid(gpx.Sphere(0.3), 0.5, position=(0.1, 0.1, 0.9), angular_velocity=(3, 1, 0), force=(0, 0.1, 0))
    scene.add_rigid(gpx.Capsule(0.2, 0.7), 0.5, position=(2, 0, 0.6), orientation=(0.6, 0.8, 0, 0), name="pill")
    scene.add_rigid(gpx.Cylinder(0.2, 0.7), 0.5, position=(-2, 0, 0.9), orientation=(0.8, 0, 0.6, 0))
    points = np.random.default_rng(5).normal(size=(12, 3)) * 0.3
    scene.add_rigid(gpx.ConvexHull(points), 0.8, position=(1, 1, 0.9), torque=(0, 0, 0.01))
    scene.add_point_mass(0.7, position=(-1.2, 0, 0.5), shape=gpx.Sphere(0.2))
    scene.add_rigid(None, 1.0, inertia=(1, 2, 2.5), angular_velocity=(1, 2, 3))
    return scene


def same(one, other):
    for name in ("positions", "orientations", "velocities", "forces", "gravity"):
        assert getattr(one, name).tobytes() == getattr(other, name).tobytes(), name
    for name in ("body_a", "body_b", "point", "frame", "gap", "friction", "impulse", "force"):
        assert getattr(one.contacts, name).tobytes() == getattr(other.contacts, name).tobytes(), name
    assert (one.time, one.steps, one.time_step) == (other.time, other.steps, other.time_step)
    assert one.unsolved_steps == other.unsolved_steps


@pytest.mark.parametrize("settings", SETTINGS, ids=lambda s: "-".join(map(str, s.values())))
def test_a_loaded_world_goes_on_bit_by_bit(settings, tmp_path):
    world = gpx.World(every_shape(), DT, **settings)
    world.step(20)
    world.time_step = 1 / 200
    world.step(10)
    world.apply_force("pill", (0, 0, 0.3), point=(0, 0, 0))
    world.save(tmp_path / "world.npz")
    loaded = gpx.World.load(tmp_path / "world.npz")
    assert loaded.snapshot() == world.snapshot()
    same(world, loaded)
    for steps in (1, 9, 30):
        world.step(steps)
        loaded.step(steps)
        same(world, loaded)
    assert world.solution.method == loaded.solution.method
    assert world.solution.iterations == loaded.solution.iterations


@pytest.mark.parametrize("settings", [SETTINGS[0], SETTINGS[3], SETTINGS[-1]], ids=lambda s: s["solver"])
def test_a_world_taken_back_replays_bit_by_bit(settings):
    world = gpx.World(every_shape(), DT, **settings)
    world.step(15)
    taken = world.snapshot()
    world.step(25)
    then = world.snapshot()
    world.remove(0)
    world.add(gpx.Scene().add_rigid(gpx.Sphere(0.1), 1.0, position=(0, 0, 9)))
    world.time_step = 0.01
    world.gravity = (0, 0, 0)
    world.step(5)
    world.restore(taken)
    assert world.snapshot() == taken
    assert world.solution is None
    world.step(25)
    assert world.snapshot() == then


@pytest.mark.parametrize("solver", ["newton", "osqp"])
def test_a_world_at_rest_replays_bit_by_bit_from_any_step(solver):
    """Where its steps start depends on how long they have kept their impulses."""
    world = gpx.World(gpx.scenes.wall(3), DT, solver=solver, tolerance=1e-6)
    world.step(60)
    taken = [world.snapshot()]
    for _ in range(25):
        world.step()
        taken.append(world.snapshot())
    for first in range(0, 25, 6):
        loaded = gpx.World.load(taken[first])
        for after in taken[first + 1 :]:
            loaded.step()
            assert loaded.snapshot() == after


def test_a_snapshot_may_be_taken_before_the_first_step_and_of_nothing():
    for scene in (gpx.Scene(), gpx.scenes.tower(2), gpx.scenes.column(3)):
        world = gpx.World(scene, DT)
        loaded = gpx.World.load(world.snapshot())
        world.step(3)
        loaded.step(3)
        assert loaded.snapshot() == world.snapshot()


def test_impulses_of_one_row_are_kept_too():
    world = gpx.World(gpx.scenes.column(5), DT)
    world.step(3)
    loaded = gpx.World.load(world.snapshot())
    world.step()
    loaded.step()
    same(world, loaded)
    assert loaded.solution.iterations <= 1


def test_the_bodies_of_a_loaded_world_are_those_that_were_saved():
    world = gpx.World(every_shape(), DT)
    loaded = gpx.World.load(world.snapshot())
    for one, other in zip(world.bodies + world.fixed, loaded.bodies + loaded.fixed, strict=True):
        assert (one.index, one.name, one.material, one.mass) == (other.index, other.name, other.material, other.mass)
        assert type(one.shape) is type(other.shape)
        assert one.shape is None or np.array_equal(one.shape.numbers(), other.shape.numbers())
        for name in ("inertia", "position", "orientation", "velocity", "angular_velocity", "force", "torque"):
            assert getattr(one, name).tobytes() == getattr(other, name).tobytes()
    hull = loaded.bodies[4].shape
    assert hull.volume == world.bodies[4].shape.volume
    with pytest.raises(ValueError, match="read-only"):
        hull.points[0] = 0.0


def changed(snapshot, words=None, **arrays):
    """Return the snapshot with other words in its text or other arrays; None takes one out."""
    with np.load(io.BytesIO(snapshot)) as archive:
        content = dict(archive)
    content["world"] = np.array(json.dumps({**json.loads(str(content["world"])), **(words or {})}))
    content.update(arrays)
    file = io.BytesIO()
    np.savez(file, **{name: array for name, array in content.items() if array is not None})
    return file.getvalue()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (dict(words=dict(version=1)), r"format 'gpx_lcp.World', version 1: 'gpx_lcp.World', version 2 is needed"),
        (dict(contact_start=np.zeros((7, 3))), r"contact_start of the snapshot is float64 of shape \(7, 3\)"),
        (dict(words=dict(format="other")), "the snapshot is of format 'other'"),
        (dict(words=dict(names=[])), "names 0 bodies, but 2 move"),
        (dict(words=dict(shapes=[{"kind": "torus"}] * 2)), "a shape of the snapshot is of kind 'torus'"),
        (dict(words=dict(shapes=[{"kind": "box", "x": 1}] * 2)), "a box of the snapshot has x: x, y, z are needed"),
        (dict(words=dict(shapes=[None])), "body_shapes of the snapshot: every entry must be from 0 to 0"),
        (dict(words=dict(shapes=[dict(kind="box", x=-1, y=1, z=1)] * 3)), "x of a Box is -1"),
        (dict(positions=None), "the snapshot lacks the array 'positions'"),
        (dict(positions=np.zeros((3, 3))), r"body_masses of the snapshot: those of moving"),
        (dict(velocities=np.full((2, 6), np.nan)), r"velocities of the snapshot\[0, 0\] is nan"),
        (dict(gravity=np.zeros(3, dtype=np.float32)), r"gravity of the snapshot is float32 of shape \(3,\)"),
        (dict(body_masses=np.array([1.0, 0.0, np.inf])), "those of moving bodies must be positive and finite"),
        (dict(time_steps=np.array([0.0, 1.0])), "time_steps of the snapshot are 0, 1: both must be positive"),
        (dict(contact_impulse=np.zeros((8, 2))), r"contact_impulse of the snapshot has shape \(8, 2\)"),
        (dict(contact_pairs=np.full((8, 2), 7, dtype=np.uint32)), r"a contact is between the bodies \[7, 7\]"),
    ],
    ids=lambda value: None if isinstance(value, str) else "-".join(str(key) for key in value.get("words", value)),
)
def test_a_snapshot_with_one_thing_broken_is_refused(change, message):
    world = gpx.World(gpx.scenes.tower(2), DT)
    world.step(2)
    taken = world.snapshot()
    broken = changed(taken, **change)
    with pytest.raises(gpx.ProblemError, match=message):
        gpx.World.load(broken)
    with pytest.raises(gpx.ProblemError, match=message):
        world.restore(broken)
    assert world.snapshot() == taken


def test_what_is_no_snapshot_is_refused(tmp_path):
    world = gpx.World(gpx.scenes.tower(2), DT)
    taken = world.snapshot()
    bent = bytearray(taken)
    bent[len(bent) // 2] ^= 1
    other = io.BytesIO()
    np.savez(other, positions=np.zeros(3))
    for wrong in (b"", b"not a zip", taken[:500], taken[:-30], bytes(bent), other.getvalue()):
        with pytest.raises(gpx.ProblemError, match=r"bytes are no snapshot of a World, or a damaged one"):
            world.restore(wrong)
    with pytest.raises(FileNotFoundError):
        gpx.World.load(tmp_path / "nothing.npz")
    assert world.snapshot() == taken


def test_a_setting_that_no_text_can_hold_is_named():
    world = gpx.World(gpx.scenes.tower(1), DT)
    world._options = {**world._options, "callback": print}
    with pytest.raises(gpx.SettingsError, match="a snapshot cannot hold the setting <built-in function print>"):
        world.snapshot()

"""Steps that the core takes in one call: the same motion as stage by stage, interrupts, and who counts as solved."""

import _thread
import threading

import numpy as np
import pytest

import gpx_lcp as gpx

DT = 1 / 240


@pytest.mark.parametrize("solver", ["newton", "pgs"])
def test_an_interrupt_of_native_steps_keeps_the_last_whole_step(solver):
    world, other = (gpx.World(gpx.scenes.tower(2), DT, solver=solver) for _ in range(2))
    threading.Timer(0.05, _thread.interrupt_main).start()
    with pytest.raises(KeyboardInterrupt):
        world.step(10**9)
    other.step(round(world.time / DT))
    assert np.array_equal(world.positions, other.positions)
    assert np.array_equal(world.contacts.impulse, other.contacts.impulse)


def test_an_interrupt_inside_a_native_step_does_not_take_it():
    effort = dict(iterations=10**9, tolerance=1e-15, presolve=False)
    world = gpx.World(gpx.scenes.tower(300), DT, solver="pgs", warm_start=False, **effort)
    threading.Timer(0.05, _thread.interrupt_main).start()
    with pytest.raises(KeyboardInterrupt):
        world.step(1)
    assert world.time == 0.0 and world.solution is None


NATIVE = [
    dict(solver="newton"),
    dict(solver="newton", warm_start=False),
    dict(solver="newton", formulation="cone", tolerance=1e-11),
    dict(solver="newton", formulation="normal"),
    dict(solver="interior_point"),
    dict(solver="interior_point", formulation="cone"),
    dict(solver="pgs", iterations=20),
    dict(solver="pgs", iterations=20, warm_start=False, relaxation=0.8),
    dict(solver="pgs", iterations=20, acceleration=False),
    dict(solver="pgs", iterations=20, presolve=False),
    dict(solver="pgs", tolerance=1e-4),
    dict(solver="pgs", formulation="normal", iterations=20),
    dict(solver="pgs", formulation="cone", iterations=20),
    dict(solver="pgs", formulation="box", iterations=20),
    dict(solver="pgs", formulation="pyramid", facets=6, iterations=20),
]


def falling_things(friction=0.5):
    """Return a scene that slides, rolls, overlaps and bounces, with a body that does not rotate."""
    material = gpx.Material(friction, elasticity=1.5)
    scene = gpx.Scene()
    scene.add_static(gpx.HalfSpace(), material=material)
    scene.add_rigid(gpx.Box(1, 1, 1), 1.0, position=(0, 0, 0.49), velocity=(1, 0.3, 0), material=material)
    scene.add_rigid(gpx.Box(1, 0.6, 0.5), 2.0, position=(0.1, 0, 1.24), velocity=(1, 0, 0), material=material)
    scene.add_rigid(gpx.Sphere(0.3), 0.5, position=(0.1, 0.1, 1.9), angular_velocity=(3, 1, 0), material=material)
    scene.add_point_mass(0.7, position=(-1.2, 0, 0.5), velocity=(2, 0, -1), shape=gpx.Sphere(0.5), material=material)
    return scene


@pytest.mark.parametrize("settings", NATIVE, ids=lambda s: "-".join(map(str, s.values())))
@pytest.mark.parametrize("friction", [0.5, 0.0])
def test_native_steps_are_the_stages_one_by_one(settings, friction):
    """The same motion to the last bit, and the same solution."""
    native = gpx.World(falling_things(friction), DT, **settings)
    staged = gpx.World(falling_things(friction), DT, **settings)
    staged._native = None
    for steps in (1, 7, 30):
        native.step(steps)
        staged.step(steps)
        for name in ("positions", "orientations", "velocities"):
            assert np.array_equal(getattr(native, name), getattr(staged, name)), name
        for name in ("body_a", "body_b", "point", "frame", "gap", "friction", "impulse"):
            assert np.array_equal(getattr(native.contacts, name), getattr(staged.contacts, name)), name
        one, other = native.solution, staged.solution
        assert np.array_equal(one.impulse, other.impulse)
        assert one.program_residual == pytest.approx(other.program_residual, rel=1e-6, abs=1e-14)
        for name in ("status", "method", "fallbacks", "iterations"):
            assert getattr(one, name) == getattr(other, name), name
        assert [count for count, _ in one.history] == [count for count, _ in other.history]
        assert [r for _, r in one.history] == pytest.approx([r for _, r in other.history], rel=1e-6, abs=1e-14)
        assert one.extras.keys() == other.extras.keys()
        assert native.unsolved_steps == staged.unsolved_steps


@pytest.mark.parametrize("settings", NATIVE, ids=lambda s: "-".join(map(str, s.values())))
def test_the_core_judges_a_step_as_python_does(settings):
    world = gpx.World(falling_things(), DT, **settings)
    for _ in range(20):
        world.step()
        judged = world.solution.program_residual
        assert world._core.solved.found.residual == pytest.approx(judged, rel=1e-6, abs=1e-14)
        assert (world._core.solved.found.status == "solved") == (world.solution.status is gpx.Status.SOLVED)


def test_steps_that_were_not_solved_are_counted():
    world = gpx.World(gpx.scenes.tower(5), DT, solver="pgs", iterations=3, presolve=False)
    world.step(4)
    world.step()
    assert world.unsolved_steps == 5
    assert world.solution.status is gpx.Status.MAX_ITERATIONS
    world = gpx.World(gpx.scenes.tower(5), DT)
    world.step(5)
    assert world.unsolved_steps == 0


def test_a_world_is_read_while_it_takes_steps_and_changed_afterwards():
    world = gpx.World(gpx.scenes.tower(2), DT)
    world.step(3)
    seen = []

    def meanwhile():
        seen.append(world.steps)
        try:
            world.move(0, velocity=(1, 0, 0))
        except gpx.ProblemError as error:
            seen.append(str(error))
        _thread.interrupt_main()

    threading.Timer(0.05, meanwhile).start()
    with pytest.raises(KeyboardInterrupt):
        world.step(10**9)
    assert seen[0] == 3 and "taking steps in another call" in seen[1]
    assert world.steps > 3
    world.move(0, velocity=(1, 0, 0))
    assert world.velocities[0, 0] == 1.0


@pytest.mark.parametrize("tolerance", [1e-6, 1e-10])
def test_a_wall_at_rest_is_factored_no_more(tolerance):
    """What the tolerance leaves of velocities is stopped by sweeps."""
    world = gpx.World(gpx.scenes.wall(6), DT, tolerance=tolerance)
    world.step(60)
    for _ in range(60):
        world.step()
        assert world.solution.status is gpx.Status.SOLVED
        assert world.solution.extras["factorisations"] == 0


@pytest.mark.parametrize("settings", [dict(solver="newton"), dict(solver="pgs", tolerance=1e-5)], ids=str)
def test_impulses_at_rest_are_kept_for_many_steps(settings):
    """Steps start from the mean of those since they were kept first, the load; from the last, half would not hold."""
    native = gpx.World(gpx.scenes.wall(8), DT, **settings)
    staged = gpx.World(gpx.scenes.wall(8), DT, **settings)
    staged._native = None
    for world in (native, staged):
        world.step(60)
    kept = 0
    for _ in range(60):
        native.step()
        staged.step()
        assert np.array_equal(native.contacts.impulse, staged.contacts.impulse)
        assert np.array_equal(native.velocities, staged.velocities)
        kept += native._core.starts()[1].min() > 0
    assert kept > 45

"""The other engines on small scenes, judged by the same measures; each test skips an engine that is not installed."""

import numpy as np
import pytest

import gpx_lcp as gpx
from benchmarks.bodies import Bodies
from benchmarks.engines import ENGINES, PEERS, SYSTEM_ENGINES
from benchmarks.engines.rebuild import box_of, one_friction
from benchmarks.interface import Diverged, GaveUp, Setting
from benchmarks.measures import Measures, measure
from benchmarks.stacks import pressed, swinging_gravity

DT = 1 / 240
SIMULATORS = [name for name in PEERS if name != "pinocchio"]


def needs(name: str) -> None:
    if not ENGINES[name].version():
        pytest.skip(f"{name} is not installed: {ENGINES[name].install}")


def stiff(name: str) -> Setting:
    """The setting of an engine that comes closest to rigid contact."""
    wanted = {
        "pybullet": ("MLCP-Dantzig", "globalCFM 1e-9"),
        "mujoco": ("Newton", "tolerance 1e-10"),
        "rapier": ("small steps", "8 small steps"),
        "dart": ("Dantzig", "pivots"),
        "drake": ("lagged", "1e10 N/m"),
        "pinocchio": ("ADMM", "tolerance 1e-12"),
    }[name]
    found = [s for s in ENGINES[name].settings(False) if (s.solver, s.label) == wanted]
    return found[0]


def follow(name: str, scene: gpx.Scene, steps: int, setting: Setting | None = None) -> tuple[Measures, object, object]:
    """Return the measures of the last of so many steps, the facts and the motion."""
    bodies = Bodies.from_scene(scene)
    simulation = ENGINES[name].simulate(scene, DT, setting or stiff(name), 10.0)
    try:
        for _ in range(steps - 1):
            simulation.step()
        before = simulation.motion()
        simulation.step()
        after = simulation.motion()
        return measure(bodies, before, after, simulation.contacts(), DT), simulation.facts(), after
    finally:
        simulation.close()


@pytest.mark.parametrize("name", SIMULATORS)
def test_a_settled_tower_carries_its_weight_in_every_engine(name):
    needs(name)
    measures, facts, _ = follow(name, pressed(gpx.scenes.tower(3)), 200)
    # Rapier computes in single precision.
    assert max(measures.load_error, measures.body_error) < (1e-3 if name == "rapier" else 1e-5)
    assert measures.penetration < 1e-4
    assert measures.drift < 1e-3
    assert facts.status == "ran"


@pytest.mark.parametrize("name", [name for name in SIMULATORS if name != "rapier"])
def test_reported_impulses_explain_the_motion_of_a_sliding_cube(name):
    needs(name)
    scene = gpx.Scene()
    material = gpx.Material(friction=0.3)
    scene.add_static(gpx.HalfSpace(), material=material)
    scene.add_rigid(gpx.Box(1, 1, 1), 1.0, position=(0, 0, 0.5 - 1e-9), velocity=(2.0, 1.0, 0.0), material=material)
    measures, _, after = follow(name, scene, 3)
    assert measures.unexplained < 1e-5
    assert after.velocity[0, 0] < 2.0 - 0.1 * 3 * 0.3 * 9.81 * DT  # friction acts, in the sense that is ours


def test_rapier_reports_normal_impulses_alone():
    needs("rapier")
    scene = gpx.scenes.incline(0.2, 0.5)
    measures, _, _ = follow("rapier", scene, 100)
    # It sticks, held by friction that is not reported: sin(0.2) of the weight.
    assert measures.body_error == pytest.approx(np.sin(0.2), rel=2e-2)
    assert measures.drift < 5e-3


@pytest.mark.parametrize("name", SIMULATORS)
def test_a_ball_comes_to_rest_on_the_ground(name):
    needs(name)
    scene = gpx.Scene()
    scene.add_static(gpx.HalfSpace())
    scene.add_rigid(gpx.Sphere(0.5), 2.0, position=(0, 0, 0.5 - 1e-9))
    measures, _, _ = follow(name, scene, 200)
    assert measures.load_error < 1e-3
    assert measures.drift < 1e-3


@pytest.mark.parametrize("name", SIMULATORS)
def test_the_start_is_that_of_the_scene(name):
    needs(name)
    scene = gpx.Scene()
    half = np.sqrt(0.5)
    scene.add_rigid(
        gpx.Box(1, 2, 3),
        2.0,
        position=(1.0, 2.0, 3.0),
        orientation=(half, 0.0, half, 0.0),
        velocity=(4.0, 5.0, 6.0),
        angular_velocity=(0.1, 0.2, 0.3),
    )
    simulation = ENGINES[name].simulate(scene, DT, stiff(name), 1.0)
    motion, start = simulation.motion(), Bodies.from_scene(scene).start
    simulation.close()
    np.testing.assert_allclose(motion.position, start.position, rtol=1e-6)
    np.testing.assert_allclose(np.abs(motion.orientation @ start.orientation.T), 1.0, rtol=1e-6)
    np.testing.assert_allclose(motion.velocity, start.velocity, rtol=1e-6)


@pytest.mark.parametrize("name", SIMULATORS)
def test_gravity_can_change_between_steps(name):
    needs(name)
    scene = gpx.Scene()
    scene.add_rigid(gpx.Box(1, 1, 1), 2.0)
    simulation = ENGINES[name].simulate(scene, DT, stiff(name), 1.0)
    simulation.set_gravity(np.array([0.0, 0.0, -1.0]))
    simulation.step()
    simulation.set_gravity(np.array([0.0, 3.0, 0.0]))
    simulation.step()
    velocity = simulation.motion().velocity[0]
    simulation.close()
    np.testing.assert_allclose(velocity, [0.0, 3.0 * DT, -DT, 0.0, 0.0, 0.0], rtol=1e-5, atol=1e-9)


@pytest.mark.parametrize("solver", ["ADMM", "PGS"])
def test_pinocchio_solves_our_system(solver):
    needs("pinocchio")
    setting = next(s for s in reversed(ENGINES["pinocchio"].settings(False)) if s.solver == solver)
    measures, facts, _ = follow("pinocchio", pressed(gpx.scenes.tower(3)), 1, setting)
    assert measures.load_error < (1e-8 if solver == "ADMM" else 1e-3)
    assert measures.unexplained < 1e-12
    assert (facts.status, facts.method) == ("solved", f"coulomb/{solver}")
    assert setting.first_step_only
    with pytest.raises(gpx.SettingsError, match="first step alone"):
        ENGINES["pinocchio"].simulate(gpx.scenes.tower(1), DT, setting, 1.0).set_gravity(np.zeros(3))


@pytest.mark.parametrize("solver", ["ADMM", "PGS"])
def test_pinocchio_solves_systems_of_fewer_rows(solver):
    needs("pinocchio")
    setting = next(s for s in reversed(ENGINES["pinocchio"].settings(False)) if s.solver == solver)
    # A point mass that slides in a plane: normal impulse m g dt, friction against the sliding.
    planar = gpx.StackedSystem(np.eye(2) / 2.0, [0.1, -3.0], [0.5])
    answer = SYSTEM_ENGINES["pinocchio"].answer(planar, setting, 1.0)
    np.testing.assert_allclose(answer.impulse, [[0.2, -0.1]], atol=1e-3 if solver == "PGS" else 1e-8)
    assert (answer.facts.status, answer.facts.method) == ("solved", f"coulomb/{solver}")
    if solver == "ADMM":  # PGS ends after a sweep where there is no friction
        column = gpx.World(gpx.scenes.column(3), DT).system()
        answer = SYSTEM_ENGINES["pinocchio"].answer(column, setting, 1.0)
        np.testing.assert_allclose(answer.impulse[:, 0], 9.81 * DT * np.array([3.0, 2.0, 1.0]), rtol=1e-7)


def test_pinocchio_is_not_asked_what_crashes_it():
    needs("pinocchio")
    falling = gpx.Scene()
    falling.add_rigid(gpx.Sphere(0.5), 1.0)
    with pytest.raises(gpx.SettingsError, match="no contacts"):
        ENGINES["pinocchio"].simulate(falling, DT, stiff("pinocchio"), 1.0)


def test_drake_gives_up_in_words_of_its_own():
    needs("drake")
    setting = next(s for s in ENGINES["drake"].settings(False) if (s.solver, s.label) == ("SAP", "1e14 N/m"))
    scene = gpx.Scene()
    scene.add_static(gpx.HalfSpace())
    scene.add_rigid(gpx.Box(1, 1, 1), 1.0, position=(0, 0, 0.49))
    with pytest.raises(GaveUp, match="did not converge"):
        follow("drake", scene, 120, setting)


def test_what_is_not_finite_is_not_measured():
    bodies = Bodies.from_scene(gpx.scenes.tower(2))
    simulation = ENGINES["gpx-lcp"].simulate(gpx.scenes.tower(2), DT, ENGINES["gpx-lcp"].settings(True)[0], 1.0)
    simulation.step()
    contacts, start = simulation.contacts(), bodies.start
    contacts.impulse[0, 0] = np.nan
    with pytest.raises(Diverged, match="not finite"):
        measure(bodies, start, start, contacts, DT)


def test_too_large_a_scene_is_refused_where_a_step_would_not_end():
    needs("pinocchio")
    setting = next(s for s in ENGINES["pinocchio"].settings(False) if s.solver == "PGS")
    with pytest.raises(gpx.SettingsError, match="400 contacts"):
        ENGINES["pinocchio"].simulate(gpx.scenes.wall(10), DT, setting, 1.0)
    for name, count in (("dart", 151), ("drake", 301)):
        with pytest.raises(gpx.SettingsError, match=f"{count} bodies"):
            ENGINES[name].simulate(gpx.scenes.tower(count), DT, Setting(name, "", "", "", 0.0), 1.0)


@pytest.mark.parametrize("name", ["mujoco", "rapier", "dart", "drake"])
def test_a_scene_that_an_engine_would_change_is_refused(name):
    needs(name)
    shapes, friction, bounce, inertia = (gpx.Scene() for _ in range(4))
    shapes.add_rigid(gpx.Cylinder(0.5, 1.0), 1.0, name="roll")
    friction.add_rigid(gpx.Box(1, 1, 1), 1.0, material=gpx.Material(friction=0.1))
    friction.add_rigid(gpx.Box(1, 1, 1), 1.0, material=gpx.Material(friction=0.2))
    bounce.add_rigid(gpx.Box(1, 1, 1), 1.0, material=gpx.Material(elasticity=1.5), name="ball")
    tensor = np.eye(3) + 0.1 * np.eye(3)[[1, 0, 2]] * [1, 1, 0]
    inertia.add_rigid(gpx.Box(1, 1, 1), 1.0, inertia=tensor, name="odd")
    for scene, text in (
        (shapes, "roll is a Cylinder"),
        (friction, r"different friction \(0.1, 0.2\)"),
        (bounce, "ball bounces"),
        (inertia, "inertia of odd"),
    ):
        with pytest.raises(gpx.SettingsError, match=text):
            ENGINES[name].simulate(scene, DT, stiff(name), 1.0)


def test_one_friction_refuses_a_product_rule():
    scene = gpx.Scene()
    scene.add_rigid(gpx.Box(1, 1, 1), 1.0, material=gpx.Material(friction_rule="product"), name="brick")
    with pytest.raises(gpx.SettingsError, match="brick combines friction by product"):
        one_friction(scene, "any")
    assert one_friction(gpx.Scene(), "any") == 0.0


def test_a_half_space_becomes_a_box_whose_top_is_the_plane():
    scene = gpx.Scene()
    ground = scene.add_static(gpx.HalfSpace((0.0, 1.0, 0.0)), position=(0.0, 2.0, 0.0))
    half_sides, position, turn = box_of(ground)
    assert half_sides[2] == 1.0
    np.testing.assert_allclose(position, [0.0, 1.0, 0.0])
    half = np.sqrt(0.5)
    np.testing.assert_allclose(turn, [half, -half, 0.0, 0.0], atol=1e-15)


def test_pressed_layers_overlap_by_a_nanometre_and_nothing_else_changes():
    scene = gpx.scenes.wall(3)
    moved = pressed(scene)
    for before, after in zip(scene.bodies, moved.bodies, strict=True):
        layer = round(before.position[2] - 0.5)
        np.testing.assert_allclose(before.position - after.position, [0, 0, 1e-9 * (layer + 1)], atol=1e-15)
        assert (before.mass, before.shape, before.material) == (after.mass, after.shape, after.material)
    assert len(moved.fixed) == len(scene.fixed)


def test_gravity_swings_by_half_of_itself_five_times_a_second():
    values = [swinging_gravity(time)[2] / -9.81 for time in (0.0, 0.05, 0.15, 0.2)]
    np.testing.assert_allclose(values, [1.0, 1.5, 0.5, 1.0], atol=1e-12)

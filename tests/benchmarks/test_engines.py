"""Every engine on a tower of two cubes, judged by the same measures."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

import gpx_lcp as gpx
from benchmarks import stacks
from benchmarks.bodies import Bodies
from benchmarks.engines import ENGINES
from benchmarks.engines import pybullet as pybullet_module
from benchmarks.engines.pybullet import FAIR, PyBullet
from benchmarks.interface import GaveUp, Setting
from benchmarks.measures import Measures, measure

DT = 1 / 240

needs_pybullet = pytest.mark.skipif(
    not PyBullet().version(), reason="pybullet is not installed: it has wheels up to 3.11"
)


def first_step(engine, scene, setting) -> tuple[Measures, object]:
    bodies = Bodies.from_scene(scene)
    simulation = engine.simulate(scene, DT, setting, 10.0)
    try:
        before = simulation.motion()
        np.testing.assert_allclose(before.position, bodies.start.position, atol=1e-15)
        simulation.step()
        return measure(bodies, before, simulation.motion(), simulation.contacts(), DT), simulation.facts()
    finally:
        simulation.close()


def test_what_crashes_on_large_scenes_is_not_asked_there():
    def asked(scene: str) -> set[str]:
        return {setting.solver for setting in PyBullet().settings(False) if stacks.SCENES[scene].wants(setting)}

    assert asked("pyramid-100") == {"SI", "SI (as shipped)"}
    assert asked("wall-20") == {"SI", "SI (as shipped)", "MLCP-PGS", "MLCP-Dantzig"}


def bullet(solver: str, kind: int, sweeps: int = 2000, **parameters: float) -> Setting:
    return Setting(
        "pybullet",
        solver,
        "box",
        "",
        0.0,
        {**FAIR, "numSolverIterations": sweeps, "constraintSolverType": kind, **parameters},
    )


@pytest.mark.parametrize("name", list(ENGINES))
def test_settings_are_told_apart_by_their_labels(name):
    engine = ENGINES[name]
    for quick in (True, False):
        settings = engine.settings(quick)
        assert len({(s.line, s.label) for s in settings}) == len(settings) > 0
    assert len(engine.settings(True)) <= len(engine.settings(False))


def test_gpx_carries_the_weight_and_its_impulses_explain_its_motion():
    setting = Setting("gpx-lcp", "pgs", "coulomb", "", 0.0, {"tolerance": 1e-10, "presolve": False})
    measures, facts = first_step(ENGINES["gpx-lcp"], gpx.scenes.tower(2), setting)
    assert measures.load_error < 1e-8
    assert measures.certificate.natural_map < 1e-9
    assert measures.unexplained < 1e-12
    assert (facts.status, facts.method) == ("solved", "coulomb/pgs")
    assert facts.iterations > 0


@needs_pybullet
@pytest.mark.parametrize(
    "setting",
    [bullet("SI", 1), bullet("MLCP-PGS", 2), bullet("MLCP-Dantzig", 3, globalCFM=1e-9)],
    ids=lambda setting: setting.solver,
)
def test_pybullet_carries_the_weight_and_its_impulses_explain_its_motion(setting):
    measures, facts = first_step(ENGINES["pybullet"], gpx.scenes.tower(2), setting)
    assert measures.load_error < 1e-5
    assert measures.unexplained < 1e-11
    assert facts.fallbacks == ()


@needs_pybullet
def test_pybullet_tells_that_dantzig_without_regularisation_fell_back():
    _, facts = first_step(ENGINES["pybullet"], gpx.scenes.tower(2), bullet("MLCP-Dantzig", 3, sweeps=50))
    assert facts.fallbacks == ("SI",)
    assert facts.method == "SI"


@needs_pybullet
def test_pybullet_that_tells_some_of_its_contacts_alone_is_not_judged(monkeypatch):
    simulation = ENGINES["pybullet"].simulate(gpx.scenes.tower(2), DT, bullet("SI", 1), 1.0)
    simulation.step()
    real = pybullet_module._load()
    points = real.getContactPoints(physicsClientId=simulation._server)
    nothing = (0, 0, 0, -1, -1, *[(0.0, 0.0, 0.0)] * 3, 0.0, 0.0, 0.0, (0.0, 0.0, 0.0), 0.0, (0.0, 0.0, 0.0))
    monkeypatch.setattr(simulation, "_api", SimpleNamespace(getContactPoints=lambda **_: [*points, nothing]))
    with pytest.raises(GaveUp, match="tells 8 of 9 contacts"):
        simulation.contacts()
    monkeypatch.undo()
    simulation.close()


@needs_pybullet
def test_pybullet_friction_and_damping_are_those_of_the_scene():
    # A cube thrown level slows down by μ g dt a step: sqrt friction on both bodies, no damping.
    scene = gpx.Scene()
    material = gpx.Material(friction=0.3)
    scene.add_static(gpx.HalfSpace(), material=material)
    scene.add_rigid(gpx.Box(1, 1, 1), 1.0, position=(0, 0, 0.5), velocity=(2.0, 0.0, 0.0), material=material)
    simulation = ENGINES["pybullet"].simulate(scene, DT, bullet("SI", 1), 1.0)
    try:
        for _ in range(10):
            simulation.step()
        np.testing.assert_allclose(simulation.motion().velocity[0, 0], 2.0 - 10 * 0.3 * 9.81 * DT, rtol=1e-9)
        np.testing.assert_allclose(simulation.contacts().friction, 0.3)
    finally:
        simulation.close()


@needs_pybullet
def test_pybullet_ground_is_turned_to_the_slope():
    measures, _ = first_step(ENGINES["pybullet"], gpx.scenes.incline(0.2, 0.5), bullet("SI", 1))
    assert measures.body_error < 1e-6  # it sticks: tan 0.2 < 0.5
    measures, _ = first_step(ENGINES["pybullet"], gpx.scenes.incline(0.2, 0.1), bullet("SI", 1))
    assert measures.body_error == pytest.approx(math.sin(0.2) - 0.1 * math.cos(0.2), rel=1e-6)


@needs_pybullet
def test_pybullet_refuses_what_it_would_silently_change():
    shapes = gpx.Scene()
    shapes.add_rigid(gpx.Cylinder(0.5, 1.0), 1.0, name="roll")
    rules = gpx.Scene()
    rules.add_rigid(gpx.Box(1, 1, 1), 1.0, material=gpx.Material(friction_rule="minimum"), name="brick")
    inertia = gpx.Scene()
    inertia.add_rigid(gpx.Box(1, 1, 1), 1.0, inertia=(1.0, 1.0, 1.0), name="shell")
    for scene, text in (
        (shapes, "roll is a Cylinder"),
        (rules, "brick combines friction"),
        (inertia, "inertia of shell"),
    ):
        with pytest.raises(gpx.SettingsError, match=text):
            ENGINES["pybullet"].simulate(scene, DT, bullet("SI", 1), 1.0)

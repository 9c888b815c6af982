"""The ladders: their truths hold by an independent check, and no solver of gpx-lcp is wrong in silence."""

import re
from dataclasses import replace

import numpy as np
import pytest

import benchmarks.stability
import gpx_lcp as gpx
from benchmarks.attempts import OWN, Attempt
from benchmarks.engines import ENGINES, PEERS
from benchmarks.interface import Setting
from benchmarks.stability import contestants
from benchmarks.stability.climbing import DIVERGES, NOT_ASKED, SILENT, STANDS, ModeBatch
from benchmarks.stability.modes import Course, SystemQuestion, coulomb_error
from benchmarks.stability.table import MODES, QUICK

SYSTEMS = [name for name, mode in MODES.items() if isinstance(mode.build(mode.rungs[0]), SystemQuestion)]
SCENES = [name for name in MODES if name not in SYSTEMS]


def plain_solution(system):
    """Return impulses by block Gauss-Seidel as in a textbook: numpy alone, De Saxcé's correction, no tricks."""
    A = np.asarray(system.A.todense()) if hasattr(system.A, "todense") else np.asarray(system.A)
    rows, n, mu = system.rows, system.contacts, system.friction
    p, step = np.zeros((n, rows)), 0.9 / np.array([np.linalg.eigvalsh(A[k : k + rows, k : k + rows])[-1]
                                                   for k in range(0, n * rows, rows)])  # fmt: skip
    for _ in range(20_000):
        moved = 0.0
        for k in range(n):
            u = A[k * rows : (k + 1) * rows] @ p.ravel() - system.B[k * rows : (k + 1) * rows]
            u[0] += mu[k] * np.linalg.norm(u[1:])
            x = p[k] - step[k] * u
            tangent = np.linalg.norm(x[1:])
            if mu[k] * tangent <= -x[0]:
                x = np.zeros(rows)
            elif tangent > mu[k] * x[0]:
                normal = (x[0] + mu[k] * tangent) / (1.0 + mu[k] ** 2)
                x = np.array([normal, *(mu[k] * normal / tangent * x[1:])])
            moved = max(moved, float(np.abs(x - p[k]).max()) / step[k])
            p[k] = x
        if moved <= 1e-11 * np.abs(system.B).max():
            break
    return p


@pytest.mark.parametrize("name", [name for name in SYSTEMS if name not in ("jam", "units", "order")])
def test_a_plain_method_finds_the_truth_of_the_easiest_rung(name):
    question = MODES[name].build(MODES[name].rungs[0])
    impulse = plain_solution(question.system)
    assert question.error(impulse, question.system.velocity(impulse)) <= 1.0
    # And the rule is no open door: a push more than there should be falls.
    impulse[0, 0] += 0.1 * np.abs(question.system.B).max() / question.system.scale[0]
    assert question.error(impulse, question.system.velocity(impulse)) > 1.0


def test_the_truths_of_towers_are_their_weights():
    for name in ("units", "order"):
        question = MODES[name].build(MODES[name].rungs[0])
        solution = gpx.solve(question.system, "pyramid", "lemke")
        assert question.error(solution.impulse, solution.velocity) <= 1.0
        assert question.error(1.1 * solution.impulse, solution.velocity) > 1.0


@pytest.mark.parametrize("rung", MODES["jam"].rungs)
def test_a_jam_has_no_solution_as_all_pushes_together_only_close_it(rung):
    system = MODES["jam"].build(rung).system
    # Farkas: y = (1, ..., 1) moves no body, and takes up what the walls close by.
    y = np.ones(system.contacts)
    assert np.abs(np.asarray(system.A @ y)).max() == 0.0 and system.B @ y == 2.0


@pytest.mark.parametrize("name", [name for name in SCENES if name != "bouncing"])
def test_an_engine_that_knows_no_truth_stands_on_the_easiest_rung(name):
    peers = [contestants.peer_settings(engine)[0] for engine in ("mujoco", "pybullet") if ENGINES[engine].version()]
    outcomes = {climb(name, setting, 1, 5.0)[0] for setting in peers}
    if outcomes <= {NOT_ASKED}:
        pytest.skip("no peer with these shapes is installed: tests/gpx_lcp/test_hard_scenes.py has their statics")
    assert STANDS in outcomes


def test_the_apexes_of_a_ball_are_those_of_free_flight():
    question = MODES["bouncing"].build(5)
    fall = np.sqrt(2.0 * 0.2 / 9.81)
    since_apex = (np.arange(question.steps + 1) / 240 + fall) % (2.0 * fall) - fall
    z = 0.7 - 0.5 * 9.81 * since_apex**2
    course = Course(z[:, None, None] * [0, 0, 1], None, None, None, question.steps / 240)
    assert question.error(course) <= 1.0
    assert question.error(replace(course, path=0.97 * course.path)) > 1.0


def climb(name, setting, rungs, limit):
    attempt = Attempt("stability", name, setting.solver, setting.formulation, engine=setting.engine)
    batch = ModeBatch(name, [attempt], [setting], limit, most=rungs)
    return [outcome.figures["outcome"] for outcome in batch.open().try_once(attempt, True, limit)]


@pytest.mark.parametrize("name", SYSTEMS)
def test_no_solver_is_wrong_in_silence_on_a_system(name):
    for setting in contestants.own_settings(MODES[name]):
        assert not {SILENT, DIVERGES} & set(climb(name, setting, 1 if name == "order" else 2, 0.3)), setting


@pytest.mark.parametrize("name", SCENES)
def test_no_solver_of_our_own_is_wrong_in_silence_on_a_scene(name):
    program = "normal" if MODES[name].frictionless else "coulomb"
    for solver in ("newton", "interior_point", "pgs"):
        outcomes = climb(name, Setting(OWN, solver, program, "", 0.0, {"tolerance": 1e-8}), 2, 0.5)
        assert not {SILENT, DIVERGES} & set(outcomes), solver


def test_peers_are_asked_what_they_can_be_asked_with_one_setting_for_each_solver():
    names = [OWN, *PEERS]
    for name, mode in MODES.items():
        settings = contestants.settings(mode, names)
        peers = [setting for setting in settings if setting.engine != OWN]
        assert len({(setting.engine, setting.solver) for setting in peers}) == len(peers)
        if mode.solvers:
            assert not peers
        elif name in SYSTEMS:
            assert {(setting.engine, setting.label) for setting in peers} == {
                ("pinocchio", "tolerance 1e-8"),
                ("pinocchio", "tolerance 1e-6"),
            }
        else:
            assert {setting.engine for setting in peers} == {*PEERS} - {"pinocchio"}
            assert {s.label for s in peers if s.engine == "drake"} == {"1e10 N/m"}
            assert {s.label for s in peers if s.solver == "SI"} == {"3000 sweeps"}
    assert contestants.settings(MODES["tower"], ["drake"])[0].engine == "drake"


@pytest.mark.slow
@pytest.mark.parametrize("name", MODES)
def test_no_solver_is_wrong_in_silence_to_the_end_of_any_ladder(name):
    for setting in contestants.own_settings(MODES[name]):
        assert not {SILENT, DIVERGES} & set(climb(name, setting, None, 1.0)), setting


def test_every_failure_mode_of_the_list_has_a_ladder_or_a_reason():
    lines = re.findall(r"^(F\d+)\s+\S.*?\s{2,}(.+)$", benchmarks.stability.__doc__, re.MULTILINE)
    assert [code for code, _ in lines] == [f"F{number}" for number in range(1, 32)]
    for code, words in lines:
        for name in re.findall(r"`([a-z-]+)`", words):
            assert name in MODES or name in ("impacts",), name
        known = {name for name, mode in MODES.items() if code in mode.code.split(", ")}
        named = {name for name in re.findall(r"`([a-z-]+)`", words) if name in MODES}
        assert known == named, code
        assert known or words.startswith("none: ")


def test_ladders_are_told_apart_by_their_rungs():
    for mode in MODES.values():
        assert len(set(mode.labels)) == len(mode.rungs) >= 5
    assert set(QUICK) <= set(MODES)


def test_the_law_line_by_line_sees_each_breach():
    system = gpx.StackedSystem(np.eye(3), [1.0, -3.0, 0.0], [0.5])

    def error(*impulse):
        return coulomb_error(system, np.array([impulse]), system.velocity(np.array([impulse])))

    assert error(1.0, -0.5, 0.0) == 0.0
    assert error(0.9, -0.45, 0.0) == pytest.approx(0.1 / 3)  # closes
    assert error(1.1, -0.55, 0.0) == pytest.approx(0.1 / 3)  # pushes what opens
    assert error(1.0, -0.6, 0.0) == pytest.approx(0.1 / 3)  # beyond the cone
    assert error(1.0, -0.4, 0.0) == pytest.approx(0.1 / 3)  # slides with less than friction has
    assert error(1.0, 0.0, 0.5) > 0.1  # slides another way than friction pulls

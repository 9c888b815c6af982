"""How a rung ends: solvers and engines that lie, break, dawdle or admit, and those that are right."""

import time
from dataclasses import replace

import numpy as np
import pytest

import gpx_lcp as gpx
from benchmarks import engines
from benchmarks.attempts import OWN, Attempt
from benchmarks.interface import Contacts, Motion, Setting, StepFacts
from benchmarks.stability import climbing
from benchmarks.stability.climbing import (
    DIVERGES,
    NOT_CLIMBED,
    OTHER_LAW,
    SAYS_SO,
    SILENT,
    STANDS,
    TOO_SLOW,
    ModeBatch,
    Told,
    judge,
)
from benchmarks.stability.modes import EXACT
from benchmarks.stability.table import MODES

SOLVER = Setting(OWN, "newton", "coulomb", "", 0.0, {"tolerance": 1e-8})


def climb(mode, setting, limit=5.0):
    """Return the outcomes of one ladder by name."""
    attempt = Attempt("stability", mode, setting.solver, setting.formulation, engine=setting.engine)
    batch = ModeBatch(mode, [attempt], [setting], limit)
    return [outcome.figures["outcome"] for outcome in batch.open().try_once(attempt, True, limit)]


@pytest.mark.parametrize(
    ("told", "feasible", "outcome"),
    [
        (Told("solved", 0.9, {"coulomb"}), True, STANDS),
        (Told("solved", 1.1, {"coulomb"}), True, SILENT),
        (Told("solved", 1e9, {"coulomb"}), True, DIVERGES),
        (Told("solved", 1.1, {"cone"}), True, OTHER_LAW),
        (Told("solved", 1.1, {"coulomb", "cone"}), True, OTHER_LAW),
        (Told("solved", np.inf, {"cone"}), True, DIVERGES),
        (Told("stalled", 0.0, {"coulomb"}), True, SAYS_SO),
        (Told("max_iterations", 9.0, {"coulomb"}, late=True), True, TOO_SLOW),
        (Told("infeasible", 0.0, {"coulomb"}), True, SILENT),
        (Told("infeasible", np.inf, {"coulomb"}), False, STANDS),
        (Told("solved", 2.0, {"coulomb"}), False, SILENT),
        (Told("stalled", np.inf, {"coulomb"}), False, SAYS_SO),
        (Told("ran", 0.9, {"box"}), True, STANDS),
        (Told("ran", 1.1, {"coulomb"}), True, SILENT),
        (Told("ran", 1.1, {"box"}), True, OTHER_LAW),
        (Told("ran", np.inf, {"box"}), True, DIVERGES),
        (Told("mjWARN_BADQACC", np.inf, {"cone"}), True, SAYS_SO),
    ],
)
def test_a_rung_ends_as_status_error_and_time_say(told, feasible, outcome):
    mode = replace(MODES["painleve"], programs=EXACT)
    assert judge(mode, told, feasible) == outcome


def test_a_solver_that_lies_is_caught_on_the_first_rung_on_which_it_does(monkeypatch):
    real = gpx.solve

    def lies(system, *arguments, **settings):
        solution = real(system, *arguments, **settings)
        # Right for up to ten masses, then one part in a hundred too much, still called solved.
        return replace(solution, impulse=1.01 * solution.impulse) if system.contacts > 10 else solution

    monkeypatch.setattr(gpx, "solve", lies)
    outcomes = climb("column", replace(SOLVER, formulation="normal"))
    assert outcomes == [STANDS, STANDS, STANDS, SILENT, NOT_CLIMBED, NOT_CLIMBED, NOT_CLIMBED]


def test_a_solver_that_breaks_down_says_so(monkeypatch):
    def breaks(*arguments, **settings):
        raise gpx.BackendError("no")

    monkeypatch.setattr(gpx, "solve", breaks)
    assert climb("fathi", replace(SOLVER, formulation="normal"))[:2] == [SAYS_SO, NOT_CLIMBED]


class FakeEngine:
    """An engine that leaves bodies where they are, except for what `spoil` does to them at each step."""

    name = install = note = "fake"

    def __init__(self, spoil, status="ran"):
        self.spoil, self.status = spoil, status

    def version(self):
        return "1"

    def simulate(self, scene, time_step, setting, time_limit):
        return FakeSimulation(scene, time_step, self)


class FakeSimulation:
    def __init__(self, scene, time_step, engine):
        self.engine, self.time_step, self.scene = engine, time_step, scene
        self.position = np.array([body.position for body in scene.bodies])

    def step(self):
        self.position = self.engine.spoil(self.position)

    def motion(self):
        still = np.zeros((len(self.position), 6))
        upright = np.tile([1.0, 0.0, 0.0, 0.0], (len(self.position), 1))
        return Motion(self.position, upright, still)

    def contacts(self):
        """Return one contact below each body that carries all that is above it, as a tower has them."""
        n = len(self.position)
        mass = np.array([body.mass for body in self.scene.bodies])
        load = np.cumsum(mass[::-1])[::-1] * 9.81 * self.time_step
        point = np.column_stack((np.zeros((n, 2)), np.arange(n)))
        up = np.tile([0.0, 0.0, 1.0], (n, 1))
        below = np.arange(n) - 1
        return Contacts(below, np.arange(n), point, point, up, np.zeros(n), np.full(n, 0.5), load[:, None] * up)

    def facts(self):
        return StepFacts(self.engine.status)

    def close(self):
        pass


def slowly(position):
    begun = time.process_time()
    while time.process_time() - begun < 0.1:
        pass
    return position


@pytest.mark.parametrize(
    ("engine", "outcome"),
    [
        (FakeEngine(lambda position: position), STANDS),
        (FakeEngine(lambda position: position - 1e-3), SILENT),
        (FakeEngine(lambda position: position * 1e3), DIVERGES),
        (FakeEngine(lambda position: position * np.nan), DIVERGES),
        (FakeEngine(lambda position: position * np.nan, "1 bodies not finite"), SAYS_SO),
        (FakeEngine(slowly), TOO_SLOW),
    ],
)
def test_an_engine_ends_as_what_it_did_says(monkeypatch, engine, outcome):
    monkeypatch.setattr(engines, "ENGINES", {"fake": engine})
    outcomes = climb("mass-ratio", Setting("fake", "any", "coulomb", "any", 0.0), limit=0.3)
    assert outcomes[0] == outcome
    assert outcomes[1] == (STANDS if outcome == STANDS else NOT_CLIMBED)


def test_a_missing_engine_is_missing():
    attempt = Attempt("stability", "tower", "", "", engine="drake")
    with pytest.raises(gpx.BackendMissing, match="drake"):
        ModeBatch("tower", [attempt], [None], 1.0).open().try_once(attempt, True, 1.0)


def test_a_quick_ladder_keeps_its_last_rung():
    batch = ModeBatch("mass-ratio", [], [], 1.0, stride=2)
    assert batch.cases == ("1", "100", "1e4", "1e6") and batch.rungs == (1, 100, 1e4, 1e6)
    assert climbing.MODES["fathi"].labels[-1] == "128"

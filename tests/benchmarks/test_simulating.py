"""Simulations by engines that misbehave: a failure is a row, never a hole and never the end of the run."""

import itertools
from dataclasses import replace

import numpy as np
import pytest

import gpx_lcp as gpx
from benchmarks import engines, measuring, stacks
from benchmarks.attempts import Attempt
from benchmarks.bodies import Bodies
from benchmarks.interface import Contacts, Setting, StepFacts
from benchmarks.rates import FEW, MANY, measure_rates
from benchmarks.simulating import SceneBatch
from benchmarks.sweep_costs import sweep_batch

PLAN = {"repeats": 3, "steps": 8, "time_limit": 30.0}
CASES = ("cold", "stepped")


class Still:
    """An engine that holds everything in place, with no contact; `on_step` may misbehave."""

    name, install, note = "still", "cannot be had", ""

    def __init__(self, on_step=lambda step: None, status="ran"):
        self.on_step, self.status, self.made = on_step, status, 0

    def version(self):
        return "1.0"

    def sweeping(self, sweeps):
        return [Setting("still", "sweeps", "box", str(sweeps), sweeps)]

    def simulate(self, scene, time_step, setting, time_limit):
        self.made += 1
        return StillSimulation(self, Bodies.from_scene(scene).start)


class StillSimulation:
    def __init__(self, engine, motion):
        self.engine, self._motion, self.steps = engine, motion, 0

    def step(self):
        self.engine.on_step(self.steps)
        self.steps += 1

    def motion(self):
        return self._motion

    def contacts(self):
        flat, wide, index = np.zeros(1), np.zeros((1, 3)), np.zeros(1, dtype=np.int64)
        up = np.array([[0.0, 0.0, 1.0]])
        return Contacts(index - 1, index, wide, wide, up, flat, flat, wide)

    def facts(self):
        return StepFacts(status=self.engine.status, iterations=self.steps)

    def close(self):
        pass


def attempt(engine: str) -> Attempt:
    return Attempt("stacks", "a scene", "none", "box", "as is", 1.0, engine=engine)


@pytest.fixture
def simulate(monkeypatch):
    """Return a function that runs engines on one cube on the ground."""

    def run(made: dict[str, Still], plan=PLAN, first_step_only=False, told=None, **kind):
        scene = stacks.StackScene("A cube", lambda: gpx.scenes.tower(1), **kind)
        monkeypatch.setattr(stacks, "SCENES", {"a scene": scene})
        monkeypatch.setattr(engines, "ENGINES", made)
        attempts = [attempt(name) for name in made]
        settings = {
            a.key: Setting(a.engine, "none", "box", "as is", 1.0, first_step_only=first_step_only) for a in attempts
        }
        batch = SceneBatch("a scene", attempts, settings, **plan)
        measured = measuring.measure(batch, (lambda text: None) if told is None else told.append)
        rows = list(measured.records)
        assert [(row.engine, row.case) for row in rows] == list(itertools.product(made, CASES))
        return rows

    return run


def raises(error):
    def on_step(step):
        raise error

    return on_step


def test_a_quiet_engine_gives_a_cold_and_a_stepped_row(simulate):
    engine, told = Still(), []
    cold, stepped = simulate({"still": engine}, told=told)
    assert engine.made == len(told) == PLAN["repeats"]
    assert (cold.steps, stepped.steps, cold.repeats) == (1, 8, 3)
    assert cold.figure("load_error") == 1.0
    assert (cold.iterations, stepped.iterations) == (1.0, 8.5)  # of the last quarter: two steps
    assert cold.step_seconds_low <= cold.step_seconds <= cold.step_seconds_high
    assert cold.status == "ran"


def test_about_a_dozen_of_the_settled_steps_are_judged_and_the_last_is_one_of_them():
    for steps in (1, 8, 20, 240, 1000):
        plan = SceneBatch("a scene", (), {}, 1, steps, 1.0)
        judged = [step for step in range(steps + 1) if plan.judges(step)]
        assert judged[0] == 0 and judged[-1] == steps
        assert all(step > plan.settled_from for step in judged[1:])
        assert len(judged) - 1 <= 23


def test_a_setting_for_the_first_step_alone_is_not_followed(simulate):
    cold, stepped = simulate({"still": Still()}, first_step_only=True)
    assert (cold.status, cold.repeats, cold.steps) == ("ran", 3, 1)
    assert (stepped.status, stepped.measured) == ("first step only", False)


def test_gravity_of_the_scene_reaches_the_engine_and_the_measures(monkeypatch, simulate):
    told = []
    empty = StillSimulation.contacts

    def carrying(self):
        # The ground holds the cube of 1 kg up against the gravity of this step of 0.5 s.
        return replace(empty(self), impulse=np.array([[0.0, 0.0, -0.5 * told[-1]]]))

    monkeypatch.setattr(StillSimulation, "set_gravity", lambda self, g: told.append(g[2]), raising=False)
    monkeypatch.setattr(StillSimulation, "contacts", carrying)
    monkeypatch.setattr(stacks, "TIME_STEP", 0.5)
    monkeypatch.setattr(stacks, "swinging_gravity", lambda time: np.array([0.0, 0.0, -1.0 - time]))
    rows = simulate({"still": Still()}, {"repeats": 1, "steps": 2, "time_limit": 30.0}, swings=True)
    assert told == [-1.0, -1.5, -2.0]
    assert [row.figure("load_error") for row in rows] == pytest.approx([0.0, 0.0])
    assert [row.figure("body_error") for row in rows] == pytest.approx([0.0, 0.0])


def test_where_bodies_move_only_the_certificate_judges(simulate):
    for row in simulate({"still": Still()}, at_rest=False):
        assert row.figure("load_error") is row.figure("body_error") is row.figure("drift") is None
        assert row.natural_map is not None and row.measured


def test_a_simulation_without_hope_is_given_up_early(monkeypatch, simulate):
    # A clock that moves by 1 s a step, against 100 s for 1000 steps.
    now = [0.0]
    monkeypatch.setattr("benchmarks.simulating.time.perf_counter", lambda: now[0])

    def on_step(step):
        now[0] += 1.0

    _, stepped = simulate({"still": Still(on_step)}, {"repeats": 1, "steps": 1000, "time_limit": 100.0})
    assert stepped.cut_short and stepped.steps_asked == 1000
    assert 3 <= stepped.steps <= 12
    assert f"time limit: {stepped.steps} of 1000 steps" in stepped.message
    # Its repeats make the first step alone.
    cold, again = simulate({"still": Still(on_step)}, {"repeats": 3, "steps": 1000, "time_limit": 100.0})
    assert (cold.repeats, again.repeats, again.steps) == (3, 1, stepped.steps)
    _, stepped = simulate({"still": Still(on_step)}, {"repeats": 1, "steps": 90, "time_limit": 100.0})
    assert not stepped.cut_short and stepped.steps == 90


def test_an_engine_that_breaks_is_a_row_and_the_others_go_on(simulate):
    rows = simulate({"broken": Still(raises(RuntimeError("out of order"))), "still": Still()})
    assert [row.status for row in rows] == ["error", "error", "ran", "ran"]
    assert rows[0].message == "RuntimeError: out of order"
    assert not rows[0].measured and rows[2].measured


def test_an_engine_that_refuses_a_setting_says_why(simulate):
    rows = simulate({"picky": Still(raises(gpx.SettingsError("not with me")))})
    assert [(row.status, row.message) for row in rows] == [("refused", "not with me")] * 2


def test_an_engine_that_breaks_later_keeps_its_first_step(simulate):
    def on_step(step):
        if step == 3:
            raise RuntimeError("later")

    cold, stepped = simulate({"tired": Still(on_step)})
    assert cold.measured and cold.status == "error"
    assert stepped.natural_map is None and stepped.status == "error"


def test_the_worst_status_of_the_steps_is_reported(simulate):
    cold, _ = simulate({"still": Still(status="max_iterations")})
    assert cold.status == "max_iterations"


def test_without_time_one_step_is_made_and_the_stepped_row_says_so(simulate):
    cold, stepped = simulate({"still": Still()}, {**PLAN, "time_limit": 1e-9})
    assert (cold.steps, cold.repeats) == (1, 1)
    assert stepped.status == "time limit"
    assert not stepped.measured


def test_ctrl_c_keeps_what_was_measured_and_lists_the_rest(simulate):
    made = {"still": Still(), "stopped": Still(raises(KeyboardInterrupt())), "never": Still()}
    rows = simulate(made, {**PLAN, "repeats": 1})
    assert [row.status for row in rows if row.case == "cold"] == ["ran", "interrupted", "interrupted"]


def test_an_engine_that_is_missing_is_a_row_with_its_install_command(simulate, monkeypatch):
    monkeypatch.setattr(Still, "version", lambda self: "")
    rows = simulate({"still": Still()})
    assert [(row.status, row.message, row.finished) for row in rows] == [("missing", "cannot be had", False)] * 2


def test_the_worst_of_each_measure_stands_beside_the_worst_certificate(simulate):
    _, stepped = simulate({"still": Still()})
    # Nothing carries the cube, in no step: that is what the stored impulses say, too.
    assert stepped.certificate["natural_map"] == stepped.natural_map > 0.0
    assert stepped.answer == "1"


def test_rates_are_the_difference_of_two_sweep_counts(monkeypatch):
    # A clock that a simulation moves by 1 ms and 2 µs per sweep: per contact (one here) and sweep, that is 2000 ns.
    now = [0.0]
    monkeypatch.setattr("benchmarks.rates.time.perf_counter", lambda: now[0])

    class Clocked(Still):
        def simulate(self, scene, time_step, setting, time_limit):
            def on_step(step):
                now[0] += 1e-3 + 2e-6 * setting.effort

            self.on_step = on_step
            return super().simulate(scene, time_step, setting, time_limit)

    told: list[str] = []
    scene = gpx.scenes.tower(1)
    (rate,) = measure_rates("tower-1", scene, {"still": Clocked()}, 1 / 240, 3, lambda setting: True, told.append)
    assert rate.median == pytest.approx(2000.0)
    assert rate.fastest == pytest.approx(2000.0)
    assert (rate.contacts, len(told)) == (1, 3)
    assert MANY > FEW
    assert measure_rates("tower-1", scene, {"still": Clocked()}, 1 / 240, 3, lambda setting: False, told.append) == []


def test_a_sweep_costs_the_median_of_its_repeats(monkeypatch):
    batch = sweep_batch("tower-30", ["gpx-lcp"], [("gpx-lcp", "pgs", "coulomb")])
    monkeypatch.setattr(stacks, "SCENES", {"tower-30": stacks.StackScene("", lambda: gpx.scenes.tower(1))})
    (row,) = measuring.measure(replace(batch, repeats=3), lambda text: None).records
    assert (row.case, row.repeats, row.contacts, row.status) == ("sweep", 3, 4, "ran")
    assert row.step_seconds_low <= row.step_seconds <= row.step_seconds_high

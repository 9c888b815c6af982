"""Ensembles: the same table however the members are shared out, and failures as rows."""

import sys
import types

import numpy as np
import pytest

import gpx_lcp as gpx

# Clocks are all that may differ from one way of running to another.
STEADY = ("status", "message", "method", "contacts", "iterations", "natural_map", "unsolved_steps")


def pile(seed: int, friction: float) -> gpx.Scene:
    return gpx.scenes.sphere_pile(3, seed=seed, friction=friction)


def height(world) -> dict[str, float]:
    return {"height": float(world.positions[:, 2].max()), "settled": bool(np.abs(world.velocities).max() < 1e-3)}


def assert_same(one, other):
    assert list(one) == list(other)
    for name in one:
        if not name.endswith("_seconds"):
            np.testing.assert_array_equal(one[name], other[name], err_msg=name)


MEMBERS = {"seed": range(3), "friction": [0.1, 0.5]}


def test_members_are_the_product_of_the_parameters_in_order():
    table = gpx.ensemble(gpx.scenes.incline, {"angle": [0.1, 0.6], "friction": [0.2, 0.5]}, workers=1)
    assert table["angle"].tolist() == [0.1, 0.1, 0.6, 0.6]
    assert table["friction"].tolist() == [0.2, 0.5, 0.2, 0.5]
    assert set(table["status"]) == {"solved"} and set(table["unsolved_steps"]) == {0}
    assert (table["natural_map"] < 1e-8).all() and (table["contacts"] == 4).all()
    assert (table["solve_seconds"] > 0.0).all()


def test_worlds_are_simulated_and_observed():
    table = gpx.ensemble(pile, MEMBERS, steps=5, observe=height, workers=1, solver="pgs", tolerance=1e-6)
    assert {"height", "settled", *STEADY, *MEMBERS} <= set(table)
    assert {len(column) for column in table.values()} == {6}
    alone = gpx.World(pile(2, 0.5), 1 / 240, solver="pgs", tolerance=1e-6)
    alone.step(5)
    assert table["height"][5] == alone.positions[:, 2].max()


def test_processes_give_the_same_table():
    shared = gpx.ensemble(pile, MEMBERS, steps=2, observe=height, workers=2)
    assert_same(shared, gpx.ensemble(pile, MEMBERS, steps=2, observe=height, workers=1))


def test_a_cluster_gives_the_same_table():
    distributed = pytest.importorskip("distributed", reason="distributed is not installed")
    with (
        distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=":0") as cluster,
    ):
        shared = gpx.ensemble(pile, MEMBERS, steps=2, observe=height, scheduler=cluster.scheduler_address)
    assert_same(shared, gpx.ensemble(pile, MEMBERS, steps=2, observe=height, workers=1))


def picky(seed: int) -> gpx.Scene:
    if seed == 1:
        raise ValueError("not this one")
    return gpx.scenes.tower(1)


def test_a_member_that_fails_is_a_row_and_the_others_go_on():
    table = gpx.ensemble(picky, {"seed": range(3)}, workers=1, observe=lambda solution: {"word": "yes", "number": 2.5})
    assert table["status"].tolist() == ["solved", "error", "solved"]
    assert table["message"][1] == "ValueError: not this one"
    assert np.isnan(table["natural_map"][1]) and table["contacts"].tolist() == [4, -1, 4]
    assert table["word"].tolist() == ["yes", "", "yes"]
    np.testing.assert_array_equal(table["number"], [2.5, np.nan, 2.5])


def test_systems_are_solved_as_they_are():
    def load(weight):
        return gpx.StackedSystem(np.eye(3), [weight, 0.0, 0.0], [0.5])

    table = gpx.ensemble(load, {"weight": [1.0, 2.0]}, workers=1, observe=lambda s: {"p": float(s.impulse[0, 0])})
    np.testing.assert_allclose(table["p"], [1.0, 2.0], rtol=1e-8)


def test_an_ensemble_of_nobody_is_an_empty_table():
    table = gpx.ensemble(pile, {"seed": [], "friction": [0.1]}, workers=1)
    assert set(STEADY) <= set(table) and all(len(column) == 0 for column in table.values())


def test_what_is_not_solved_is_counted():
    table = gpx.ensemble(gpx.scenes.tower, {"n": [5]}, steps=3, workers=1, solver="pgs", iterations=1, presolve=False)
    assert table["status"].tolist() == ["max_iterations"] and table["unsolved_steps"].tolist() == [3]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"steps": -1}, "steps is -1"),
        ({"workers": 0}, "workers is 0"),
        ({"solver": "bogus"}, "bogus"),
        ({"parameters": {"status": [1]}}, "parameters has the name 'status'"),
        ({"make": lambda n: 3, "workers": 1}, "make returns a int: a Scene or a StackedSystem is needed"),
        ({"make": lambda n: gpx.scenes.tower(n), "workers": 2}, "make cannot be sent to a process"),
        ({"observe": lambda s: {"method": 1}}, "observe returns 'method'"),
        ({"observe": lambda s: {"n": 1}}, "observe returns 'n', which is a parameter"),
        ({"make": lambda n: gpx.StackedSystem(np.eye(3), np.ones(3), [0.5]), "steps": 2}, "has no time"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_a_wrong_setting_is_named(arguments, message):
    asked = {"make": gpx.scenes.tower, "parameters": {"n": [1]}, "workers": 1, **arguments}
    with pytest.raises(gpx.SettingsError, match=message):
        gpx.ensemble(asked.pop("make"), asked.pop("parameters"), **asked)


def test_what_the_other_process_does_not_have_is_named(monkeypatch):
    pytest.importorskip("distributed", reason="distributed is not installed")
    ghost = types.ModuleType("ghost")
    exec("def make(n): pass", ghost.__dict__)
    monkeypatch.setitem(sys.modules, "ghost", ghost)
    for where in ({"workers": 2}, {"scheduler": "local"}):
        with pytest.raises(gpx.SettingsError, match=r"cannot be loaded in the process .*No module named 'ghost'"):
            gpx.ensemble(ghost.make, {"n": [1, 2]}, **where)


def test_a_cluster_needs_distributed_and_an_address_that_answers(monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "distributed", None)
    with pytest.raises(gpx.BackendMissing, match="gpx-lcp\\[cluster\\]"):
        gpx.ensemble(pile, MEMBERS, scheduler="local")

"""The suite of presolve: who is asked what, and that it is measured."""

import io

import pytest
from rich.console import Console

from benchmarks import cli, exit_codes, store
from benchmarks.presolve.batches import AS_ASKED, REDUCED, SETTINGS, formulation_of, scene_batch


@pytest.mark.parametrize(
    ("solver", "with_friction", "without"),
    [("newton", "coulomb", "coulomb"), ("clarabel", "cone", "normal"), ("osqp", None, "normal")],
)
def test_a_solver_is_asked_for_the_closest_law_that_it_solves(solver, with_friction, without):
    assert formulation_of(solver, "wall-10") == with_friction
    assert formulation_of(solver, "column-100") == without


def test_threads_are_for_solvers_that_take_them():
    batch = scene_batch("islands-20", ("newton", "clarabel"), None, 1, 1, 1.0)
    settings = {name: tuple(a.setting for a in batch.attempts if a.solver == name) for name in ("newton", "clarabel")}
    assert settings == {"newton": SETTINGS, "clarabel": (AS_ASKED, REDUCED)}
    assert not scene_batch("islands-20", ("newton",), ("cone",), 1, 1, 1.0).attempts


def test_solvers_outside_the_core_are_measured(tmp_path):
    page = io.StringIO()
    named = ["--solver", "newton", "--solver", "osqp", "--solver", "clarabel"]
    arguments = ["run", "presolve", "--scene", "column-100", "--scene", "table-6", *named, "--quick"]
    assert cli.main([*arguments, "--out", str(tmp_path)], Console(file=page, width=200)) == exit_codes.OK
    rows = store.read(tmp_path / "presolve")
    assert {(row.scene, row.formulation, row.solver) for row in rows} == {
        ("column-100", "coulomb", "newton"),
        ("column-100", "normal", "osqp"),
        ("column-100", "normal", "clarabel"),
        ("table-6", "coulomb", "newton"),
        ("table-6", "cone", "clarabel"),
    }
    by_hand = [row for row in rows if row.formulation == "normal" and row.setting == REDUCED]
    assert {row.figure("rows_left") for row in by_hand} == {0}
    assert (tmp_path / "presolve" / "gain-osqp.png").exists()

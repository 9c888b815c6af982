"""Which rows count in the table against the peers."""

import pytest

from benchmarks import ratios
from benchmarks.records import Record
from benchmarks.tables import certified_table, ratio_table
from tests.benchmarks.make_record import record


def row(engine, step_ms, load_error=1e-9, case="stepped", solver="newton", formulation="coulomb", **more) -> Record:
    known = {"body_error": 1e-12, "penetration": 1e-6, "drift": 1e-6, "natural_map": 1e-3, "steps": 9, "steps_asked": 9}
    known |= {"load_error": load_error, "status": "ran"} | more
    return record("scene", case, engine, solver, formulation, step_ms=step_ms, **known)


OURS = row("gpx-lcp", 2.0)
THEIRS = row("mujoco", 4.0, solver="Newton")


def test_the_ratio_is_of_the_fastest_that_meet_the_bound():
    rows = [OURS, THEIRS, row("gpx-lcp", 3.0), row("drake", 1.0, load_error=1e-3), row("dart", 0.5, case="cold")]
    assert ratios.standing(rows, "scene", 1e-8).value == pytest.approx(0.5)
    assert ratios.standing(rows, "scene", 1e-2).value == pytest.approx(2.0)
    assert ratios.standing(rows, "another", 1e-2) == ratios.Ratio(None, None)


@pytest.mark.parametrize(
    "fault",
    [{"body_error": 1e-3}, {"drift": 2e-3}, {"penetration": 2e-3}, {"load_error": None}, {"formulation": "normal"}],
    ids=str,
)
def test_what_does_not_stand_or_balance_does_not_count(fault):
    worse = row("mujoco", 1.0, **fault)
    assert ratios.standing([OURS, worse], "scene", 1e-8).peer is None
    ours = row("gpx-lcp", 1.0, **fault)
    assert ratios.standing([ours, THEIRS], "scene", 1e-8).own is None


def test_peers_that_had_no_time_are_counted():
    short = row("dart", 9.0, steps=3)
    ratio = ratios.standing([OURS, short], "scene", 1e-8)
    assert (ratio.peer, ratio.unfinished, ratio.value) == (None, 1, None)


def test_the_cold_step_is_held_against_pybullet_as_it_is_usually_run():
    usual = row("pybullet", 8.0, load_error=0.9, case="cold", solver="SI", setting="50 sweeps", formulation="box")
    exact, rough = row("gpx-lcp", 2.0, 1e-11, case="cold"), row("gpx-lcp", 1.0, 1e-6, case="cold")
    ratio = ratios.cold([usual, exact, rough, row("mujoco", 0.1, case="cold")], "scene")
    assert ratio == ratios.Ratio(exact, usual)


def test_by_the_certificate_ours_must_be_no_less_accurate():
    bullet = {"setting": "50 sweeps", "formulation": "box"}
    usual = row("pybullet", 8.0, solver="SI", natural_map=1e-2, **bullet)
    shipped = row("pybullet", 5.0, solver="SI (as shipped)", natural_map=2e-1, **bullet)
    rough, fine = row("gpx-lcp", 1.0, natural_map=1e-1), row("gpx-lcp", 2.0, natural_map=1e-3)
    rows = [usual, shipped, rough, fine]
    assert ratios.certified(rows, "scene") == ratios.Ratio(fine, usual)
    assert ratios.certified(rows, "scene", ratios.SHIPPED_SOLVER) == ratios.Ratio(rough, shipped)
    text = text_of(certified_table({"scene": "A scene"}, rows))
    assert "2 newton / 8 pybullet SI " in text and "1 newton / 5 pybullet SI (as shipped)" in text


def text_of(table) -> str:
    from rich.console import Console

    console = Console(width=200, record=True, file=None, quiet=False)
    with console.capture() as capture:
        console.print(table)
    return capture.get()


def test_tables_tell_the_ratio_nobody_and_that_we_do_not():
    titles = {"scene": "A scene"}
    assert "0.50  2 newton / 4 mujoco Newton" in text_of(ratio_table(titles, [OURS, THEIRS]))
    assert "nobody: 2 newton" in text_of(ratio_table(titles, [OURS]))
    assert "nobody (1 not in time): 2 newton" in text_of(ratio_table(titles, [OURS, row("dart", 9.0, steps=3)]))
    assert "we do not / 4 mujoco Newton" in text_of(ratio_table(titles, [THEIRS]))
    assert "A scene" not in text_of(ratio_table({"scene": "A scene", "other": "Other"}, []))
    usual = row("pybullet", 4.0, solver="SI", setting="50 sweeps", formulation="box")
    assert "0.50" in text_of(certified_table(titles, [OURS, usual]))

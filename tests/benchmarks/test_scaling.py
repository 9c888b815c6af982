"""The suite of growing scenes: its exponents, its rows and its chart."""

import io

import pytest
from rich.console import Console

from benchmarks import cli, exit_codes, scaling, store
from benchmarks.engines.pybullet import PyBullet
from tests.benchmarks.make_record import record


def rows_of(power, bodies=(10, 100, 1000)):
    return [record(bodies=n, step_seconds=1e-6 * n**power) for n in bodies]


@pytest.mark.parametrize("power", [0.5, 1.0, 2.0])
def test_the_exponent_of_a_power_law_is_its_power(power):
    assert scaling.exponent(rows_of(power)) == pytest.approx(power, abs=1e-12)


def test_one_size_has_no_exponent():
    assert scaling.exponent(rows_of(1.0, (10,))) is None


def test_a_family_has_about_as_many_bodies_as_its_name_says():
    for name, (family, size) in scaling.SCENES.items():
        if size <= 300:
            assert len(family.make(size).bodies) == pytest.approx(size, rel=0.1), name


def test_growing_towers_are_measured_and_drawn(tmp_path):
    page = io.StringIO()
    arguments = ["run", "scaling", "--quick", "--scene", "tower-10", "--scene", "tower-30", "--solver", "newton"]
    arguments += ["--peer", "none", "--out", str(tmp_path)]
    assert cli.main(arguments, Console(file=page, width=200)) == exit_codes.OK
    rows = store.read(tmp_path / "scaling")
    assert [(row.bodies, row.contacts, row.status) for row in rows] == [(10, 40, "solved"), (30, 120, "solved")]
    assert all(row.natural_map <= scaling.SOLVER_TOLERANCE and row.steps == scaling.STEPS for row in rows)
    assert "exponent" in page.getvalue()
    assert (tmp_path / "scaling" / "scaling.png").exists()
    assert cli.main(["check", str(tmp_path / "scaling")], Console(file=page)) == exit_codes.OK


def test_a_scene_that_takes_too_long_is_a_row(tmp_path):
    arguments = ["run", "scaling", "--quick", "--scene", "pile-1000", "--solver", "newton", "--time-limit", "0.01"]
    arguments += ["--peer", "none", "--out", str(tmp_path)]
    assert cli.main(arguments, Console(file=io.StringIO())) == exit_codes.OK
    (row,) = store.read(tmp_path / "scaling")
    assert row.status == "time limit" and not row.measured and row.bodies == 1000


def test_a_missing_peer_is_a_row_of_each_scene(tmp_path, monkeypatch):
    monkeypatch.setattr(PyBullet, "version", lambda self: "")
    page = io.StringIO()
    arguments = ["run", "scaling", "--quick", "--scene", "tower-10", "--solver", "newton", "--peer", "pybullet"]
    assert cli.main([*arguments, "--out", str(tmp_path)], Console(file=page, width=200)) == exit_codes.OK
    assert [(row.engine, row.status) for row in store.read(tmp_path / "scaling")] == [
        ("gpx-lcp", "solved"),
        ("pybullet", "missing"),
    ]
    assert "pybullet is missing. pip install pybullet" in page.getvalue()

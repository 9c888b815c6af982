"""The command line from outside: what it prints, what it writes, and its exit codes."""

import csv
import io
import runpy
import sys
from dataclasses import replace

import pytest
from rich.console import Console

import benchmarks
import gpx_lcp as gpx
from benchmarks import cli, exit_codes, stacks
from benchmarks.engines.pybullet import PyBullet

CHARTS = ("speed-accuracy-cold", "speed-accuracy-stepped", "forces")


def call(*arguments: str) -> tuple[int, str]:
    page = io.StringIO()
    code = cli.main(arguments, Console(file=page, width=200, highlight=False))
    return code, page.getvalue()


def run(tmp_path, *arguments: str) -> tuple[int, str, list[dict[str, str]]]:
    code, text = call("run", "stacks", "--out", str(tmp_path), "--scene", "tower-5", "--repeats", "1", *arguments)
    table = tmp_path / "stacks" / "rows.csv"
    lines = table.read_text(encoding="utf-8").splitlines() if table.exists() else []
    return code, text, list(csv.DictReader(lines))


SMALL = ("--solver", "pgs", "--formulation", "coulomb", "--steps", "4", "--quick")


def test_list_names_scenes_engines_and_solvers():
    code, text = call("list")
    assert code == exit_codes.OK
    for name in (*stacks.SCENES, "gpx-lcp", "pybullet (peer)", "pgs", "osqp", "coulomb"):
        assert name in text


def test_list_says_how_to_get_a_missing_peer(monkeypatch):
    monkeypatch.setattr(PyBullet, "version", lambda self: "")
    text = call("list")[1]
    assert "missing" in text
    assert "pip install pybullet==3.2.7" in text


def test_run_writes_rows_tables_charts_and_answers(tmp_path):
    # A limit that no busy machine reaches: what is asserted here is not how fast it is.
    code, text, rows = run(tmp_path, *SMALL, "--time-limit", "60", "--peer", "none")
    assert code == exit_codes.OK
    assert {row["case"] for row in rows} == {"cold", "stepped"}
    for row in rows:
        assert (row["engine"], row["solver"], row["formulation"]) == ("gpx-lcp", "pgs", "coulomb")
        assert row["status"] == "solved"
        assert float(row["load_error"]) < 0.1
        assert row["setup_seconds"] and row["solve_seconds"] and row["iterations"] and row["peak_memory"]
        assert row["cpu"] and row["gpx_lcp"] and row["build_profile"] == "release" and row["answer"]
    names = {path.name for path in (tmp_path / "stacks").iterdir()}
    charts = {f"{stem}.{kind}" for stem in CHARTS for kind in ("png", "svg")}
    assert names == {"rows.parquet", "rows.csv", "tables.txt", "asked.json", "answers"} | charts
    assert "What this does not show" in " ".join(text.split())
    assert "Tower of 5" in (tmp_path / "stacks" / "tables.txt").read_text()


def test_a_missing_peer_is_listed_and_the_run_goes_on(tmp_path, monkeypatch):
    monkeypatch.setattr(PyBullet, "version", lambda self: "")
    code, text, rows = run(tmp_path, *SMALL, "--peer", "pybullet")
    assert code == exit_codes.OK
    assert "pybullet is missing" in text and "pip install pybullet==3.2.7" in text
    missing = [row for row in rows if row["engine"] == "pybullet"]
    assert {row["status"] for row in missing} == {"missing"} and "CPython 3.11" in missing[0]["message"]


@pytest.mark.skipif(not PyBullet().version(), reason="pybullet is not installed: it has wheels up to 3.11")
def test_filters_leave_a_named_peer_in(tmp_path):
    asked = (*SMALL, "--tolerance", "1e-6")
    named = run(tmp_path / "named", *asked, "--peer", "pybullet")[2]
    assert {(row["engine"], row["solver"]) for row in named} >= {("gpx-lcp", "pgs"), ("pybullet", "SI")}
    assert {float(row["tolerance"]) for row in named if row["engine"] == "gpx-lcp"} == {1e-6}
    unnamed = run(tmp_path / "all", *asked)[2]
    assert {row["engine"] for row in unnamed if row["status"] != "missing"} == {"gpx-lcp"}


@pytest.mark.skipif(not PyBullet().version(), reason="pybullet is not installed: it has wheels up to 3.11")
def test_resume_goes_on_with_what_was_asked_and_with_a_peer_that_is_there_by_now(tmp_path, monkeypatch):
    asked = ("--solver", "pgs", "--peer", "pybullet", "--steps", "4", "--quick")
    with monkeypatch.context() as patch:
        patch.setattr(PyBullet, "version", lambda self: "")
        assert "missing" in {row["status"] for row in run(tmp_path, *asked)[2]}
    code, text = call("run", "stacks", "--out", str(tmp_path), "--resume")
    assert code == exit_codes.OK
    assert "2 of 5 attempts are there; 3 are left" in text
    lines = (tmp_path / "stacks" / "rows.csv").read_text(encoding="utf-8").splitlines()
    rows = list(csv.DictReader(lines))
    assert len(rows) == 10 and {row["engine"] for row in rows} == {"gpx-lcp", "pybullet"}
    assert "missing" not in {row["status"] for row in rows}
    code, text = call("run", "stacks", "--out", str(tmp_path), "--resume", "--repeats", "7")
    assert code == exit_codes.USAGE and "leave out --repeats" in text
    code, text = call("run", "stacks", "--out", str(tmp_path / "nowhere"), "--resume")
    assert code == exit_codes.USAGE and "holds no run to go on with" in text


def test_a_debug_build_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(gpx, "BUILD_PROFILE", "debug")
    code, text, rows = run(tmp_path, *SMALL)
    assert code == exit_codes.REFUSED
    assert "debug build" in text and "make setup" in text
    assert not rows


def test_nothing_to_run_is_refused(tmp_path):
    code, text, rows = run(tmp_path, "--solver", "osqp", "--formulation", "coulomb")
    assert code == exit_codes.REFUSED
    assert "nothing to run" in text
    assert not rows


def test_a_name_that_nothing_has_is_refused_and_one_that_is_right_does_not_hide_it(tmp_path):
    for wrong in (("--solver", "newtn"), ("--formulation", "cones")):
        code, text, rows = run(tmp_path, *SMALL, *wrong, "--peer", "none")
        assert code == exit_codes.USAGE
        assert f"{wrong[0]} is {wrong[1]}: nothing to run here has that name; there are" in text and not rows


def test_a_solver_that_is_not_installed_is_named_with_its_command(tmp_path, monkeypatch):
    known = gpx.solvers()
    gone = replace(known["clarabel"], installed=False, install="pip install clarabel")
    monkeypatch.setattr(gpx, "solvers", lambda: {**known, "clarabel": gone})
    code, text, rows = run(tmp_path, "--solver", "clarabel", "--peer", "none")
    assert code == exit_codes.REFUSED
    assert "clarabel is not installed: pip install clarabel" in text and not rows


def test_a_tolerance_that_no_setting_has_is_refused(tmp_path):
    code, text, _ = run(tmp_path, "--tolerance", "1e-5", "--peer", "none")
    assert code == exit_codes.USAGE and "--tolerance is 1e-5: no setting asks for it; there are 1e-10," in text


def test_a_folder_that_cannot_be_made_is_named(tmp_path):
    (tmp_path / "file").write_text("")
    code, text = call("run", "stacks", "--out", str(tmp_path / "file" / "below"), "--quick")
    assert code == exit_codes.USAGE and "below/stacks cannot be made" in text


def test_a_new_run_takes_the_place_of_the_old_one_and_says_so(tmp_path):
    first = run(tmp_path, *SMALL, "--time-limit", "60", "--peer", "none")
    assert "give way" not in first[1]
    kept = len(list((tmp_path / "stacks" / "answers").iterdir()))
    code, text, rows = run(tmp_path, *SMALL, "--time-limit", "60", "--peer", "none")
    assert code == exit_codes.OK and f"{len(rows)} rows that were in" in text
    assert len(list((tmp_path / "stacks" / "answers").iterdir())) == kept


@pytest.mark.parametrize(
    ("error", "code", "words"),
    [
        (ModuleNotFoundError("No module named 'rich'", name="rich"), exit_codes.REFUSED, "rich is not installed"),
        (KeyboardInterrupt(), exit_codes.INTERRUPTED, "stopped by Ctrl-C"),
    ],
)
def test_what_goes_wrong_while_it_loads_is_an_exit_code(monkeypatch, capsys, error, code, words):
    class Stops:
        def find_spec(self, name, path=None, target=None):
            if name == "benchmarks.cli":
                raise error

    monkeypatch.delitem(sys.modules, "benchmarks.cli", raising=False)
    monkeypatch.delattr(benchmarks, "cli", raising=False)
    monkeypatch.setattr(sys, "meta_path", [Stops(), *sys.meta_path])
    with pytest.raises(SystemExit) as stop:
        runpy.run_module("benchmarks", run_name="__main__")
    assert stop.value.code == code
    assert words in capsys.readouterr().out


def test_a_scene_that_is_not_there_is_named(tmp_path):
    code, text = call("run", "stacks", "--out", str(tmp_path), "--scene", "bogus")
    assert code == exit_codes.USAGE
    assert "--scene is bogus: there is none of that name; there are tower-5" in text


def test_ctrl_c_keeps_the_rows_and_says_so(tmp_path, monkeypatch):
    def interrupted(self, steps=1):
        raise KeyboardInterrupt

    monkeypatch.setattr(gpx.World, "step", interrupted)
    code, text, rows = run(tmp_path, *SMALL, "--scene", "wall-5", "--peer", "none")
    assert code == exit_codes.INTERRUPTED
    assert "stopped by Ctrl-C" in text
    assert {(row["scene"], row["status"]) for row in rows} == {("tower-5", "interrupted"), ("wall-5", "interrupted")}
    assert "--resume measures them" in text


def test_an_error_in_an_engine_is_the_exit_code(tmp_path, monkeypatch):
    def broken(self, steps=1):
        raise RuntimeError("out of order")

    monkeypatch.setattr(gpx.World, "step", broken)
    code, text, rows = run(tmp_path, *SMALL, "--peer", "none")
    assert code == exit_codes.FAILED
    assert {row["status"] for row in rows} == {"error"}
    assert "RuntimeError: out of order" in text


@pytest.mark.parametrize(
    "arguments",
    [
        ("stacks", "--repeats", "0"),
        ("stacks", "--steps", "-1"),
        ("stacks", "--time-limit", "0"),
        ("stacks", "--peer", "bogus"),
        ("stacks", "--tolerance", "-1"),
        ("stacks", "--repeats", "many"),
        ("analytic", "--peer", "bogus"),
        ("scaling", "--time-limit", "soon"),
        ("fclib", "--repeats", "0"),
        ("fclib", "--tolerance", "0"),
        ("fclib", "--seed", "-1"),
        ("fclib", "--steps", "5"),
    ],
    ids=" ".join,
)
def test_a_wrong_argument_is_a_usage_error(arguments, capsys):
    with pytest.raises(SystemExit) as stop:
        cli.main(["run", *arguments])
    assert stop.value.code == exit_codes.USAGE
    assert arguments[1] in capsys.readouterr().err


def test_help_tells_the_exit_codes(capsys):
    with pytest.raises(SystemExit):
        cli.main(["run", "--help"])
    assert "130  stopped by Ctrl-C" in capsys.readouterr().out

"""The suite fclib from outside: a small folder of problems, what is printed and written, and the exit codes."""

import csv
import io
import json

import pytest
from matplotlib.image import imread
from rich.console import Console

import gpx_lcp as gpx
from benchmarks import cli, exit_codes
from benchmarks.fclib.suite import Fclib, lines_of

FILES = {"Tower-2": gpx.scenes.tower(2), "Tower-3": gpx.scenes.tower(3), "Slope1": gpx.scenes.incline(0.3, 0.2)}


@pytest.fixture
def data(tmp_path):
    """A folder with problems at two depths and one truncated file."""
    folder = tmp_path / "collection"
    (folder / "deep").mkdir(parents=True)
    for name, scene in FILES.items():
        gpx.write_fclib(folder / "deep" / f"{name}.hdf5", gpx.World(scene, time_step=1 / 240).system())
    (folder / "Broken-1.hdf5").write_bytes((folder / "deep" / "Slope1.hdf5").read_bytes()[:400])
    return folder


@pytest.fixture
def baseline(tmp_path):
    run = {"seconds": 1e-3, "natural_map": 1e-12, "natural_map_scaled": 1e-12, "iterations": 3, "outcome": "solved"}
    failed = {**run, "seconds": None, "natural_map_scaled": 0.5, "outcome": "not reached"}
    held = {
        "Tower-2": {"runs": {"nsgs 1e-04": run, "prox 1e-04": {**run, "seconds": 2e-3}}, "best_scaled_1e-4_s": 1e-3},
        "Slope1": {"runs": {"nsgs 1e-04": failed}, "best_scaled_1e-4_s": None},
    }
    path = tmp_path / "peer.json"
    path.write_text(json.dumps(held))
    return path


@pytest.fixture
def no_charts(monkeypatch):
    """Drawing takes longer than everything else here: one test looks at the charts."""
    monkeypatch.setattr(Fclib, "draw", lambda self, records, folder, out, footer: [])


def call(tmp_path, *arguments: str) -> tuple[int, str, list[dict[str, str]]]:
    page = io.StringIO()
    out = tmp_path / "out"
    code = cli.main(["run", "fclib", "--out", str(out), *arguments], Console(file=page, width=200, highlight=False))
    table = out / "fclib" / "rows.csv"
    lines = table.read_text(encoding="utf-8").splitlines() if table.exists() else []
    return code, " ".join(page.getvalue().split()), list(csv.DictReader(lines))


ONE = ("--solver", "pgs", "--solver", "newton", "--tolerance", "1e-4", "--repeats", "2")
SMALL = (*ONE, "--tolerance", "1e-8")


def test_every_problem_gets_a_row_for_each_solver_and_tolerance_and_a_broken_file_one(tmp_path, data, baseline):
    code, text, rows = call(tmp_path, "--data", str(data), *ONE, "--baseline", str(baseline))
    assert code == exit_codes.FAILED
    broken = [row for row in rows if row["scene"] == "Broken-1"]
    assert [row["solver"] for row in broken] == ["newton", "pgs"]
    assert all(row["status"] == "unreadable" and "not a readable HDF5 file" in row["message"] for row in broken)
    rows = [row for row in rows if row not in broken]
    keys = {(row["scene"], row["solver"], float(row["tolerance"])) for row in rows}
    assert keys == {(name, solver, tol) for name in FILES for solver in ("pgs", "newton") for tol in (1e-4,)}
    assert len(rows) == len(keys)
    for row in rows:
        assert (float(row["natural_map"]) <= float(row["tolerance"])) == (row["reached"] == "true")
        assert float(row["solve_seconds_low"]) <= float(row["solve_seconds"]) <= float(row["solve_seconds_high"])
        assert row["formulation"] == "coulomb" and row["cpu"] and row["revision"] and row["measured_at"] and row["host"]
    tower = next(row for row in rows if row["scene"] == "Tower-3")
    assert (tower["family"], tower["contacts"], tower["dimension"]) == ("Tower", "12", "3")
    assert float(tower["rank_ratio"]) == 36 / 18
    assert "Broken-1 cannot be read" in text
    assert "What this does not show" in text and "Its times come from another run" in text
    written = {path.name for path in (tmp_path / "out" / "fclib").iterdir()}
    charts = {f"{stem}.{kind}" for stem in ("speed-accuracy", "convergence", "profile-1e-4") for kind in ("png", "svg")}
    assert written == {"rows.parquet", "rows.csv", "tables.txt", "asked.json", "answers", "baseline"} | charts
    for name in charts:
        if name.endswith("png"):
            pixels = imread(tmp_path / "out" / "fclib" / name)
            assert 0.02 < (pixels[:, :, :3].min(axis=2) < 0.95).mean() < 0.6  # neither blank nor black
    assert "Each problem at 1e-4" in (tmp_path / "out" / "fclib" / "tables.txt").read_text()


def test_without_data_it_runs_its_own_problems_and_says_so(tmp_path, no_charts):
    code, text, rows = call(tmp_path, "--quick", "--scene", "*Tower-5", "--solver", "newton", "--tolerance", "1e-8")
    assert code == exit_codes.OK
    assert "problems of our own" in text
    assert {row["scene"]: row["reached"] for row in rows} == {"Tower-5": "true", "ShakenTower-5": "true"}


def test_automatic_and_the_exact_law_are_what_runs_unless_others_are_named():
    usual = lines_of(None, None)
    assert {line.formulation for line in usual} == {"coulomb"}
    assert {"automatic", "pgs", "newton", "interior_point"} <= {line.label for line in usual}
    assert [line.label for line in lines_of(["pgs"], ["box", "cone"])] == ["pgs (box)", "pgs (cone)"]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--data", "nowhere"), "--data is nowhere: there is no such folder"),
        (("--data", "."), "holds no *.hdf5 file"),
        (("--scene", "bogus"), "--scene is bogus: there is none of that name"),
        (("--baseline", "nowhere.json"), "cannot be read as JSON"),
    ],
    ids=lambda value: value[0] if isinstance(value, tuple) else "",
)
def test_what_is_not_there_is_a_usage_error(tmp_path, monkeypatch, arguments, message):
    monkeypatch.chdir(tmp_path)
    code, text, rows = call(tmp_path, *arguments)
    assert code == exit_codes.USAGE
    assert message in text
    assert not rows


def test_a_solver_that_breaks_is_a_row_and_the_exit_code(tmp_path, data, monkeypatch, no_charts):
    def broken(*arguments, **settings):
        raise RuntimeError("out of order")

    monkeypatch.setattr(gpx, "solve", broken)
    code, text, rows = call(tmp_path, "--data", str(data), "--scene", "Tower-*", *SMALL)
    assert code == exit_codes.FAILED
    assert {(row["status"], row["reached"], row["natural_map"]) for row in rows} == {("error", "false", "")}
    assert len(rows) == 8
    assert "pgs: error on Tower-2 and 1 more: RuntimeError: out of order" in text


@pytest.mark.parametrize("named", [("--solver", "lemke"), ("--solver", "bogus"), ("--formulation", "bogus")])
def test_a_name_that_no_attempt_has_is_refused_with_those_that_there_are(tmp_path, data, named):
    code, text, rows = call(tmp_path, "--data", str(data), *named)
    assert code == exit_codes.USAGE
    assert f"{named[0]} is {named[1]}: nothing to run here has that name; there are " in text and not rows


def test_a_solver_is_known_that_only_another_formulation_brings_in(tmp_path, data):
    _, _, rows = call(tmp_path, "--data", str(data), "--solver", "osqp", "--formulation", "normal")
    assert {row["solver"] for row in rows} == {"osqp"}


def test_ctrl_c_keeps_what_was_measured_and_names_the_rest(tmp_path, data, monkeypatch, no_charts):
    solve = gpx.solve
    calls = []

    def interrupted(*arguments, **settings):
        calls.append(1)
        if len(calls) > 8:  # Slope1 is done, Tower-2 has begun
            raise KeyboardInterrupt
        return solve(*arguments, **settings)

    monkeypatch.setattr(gpx, "solve", interrupted)
    code, text, rows = call(
        tmp_path, "--data", str(data), "--scene", "Slope1", "--scene", "Tower-*", *SMALL, "--repeats", "2"
    )
    assert code == exit_codes.INTERRUPTED
    assert "stopped by Ctrl-C" in text
    finished = {row["scene"] for row in rows if row["status"] != "interrupted"}
    assert finished == {"Slope1"}
    assert {row["scene"] for row in rows} == set(FILES)


def test_the_solvers_word_is_not_believed(tmp_path, monkeypatch, no_charts):
    solve = gpx.solve

    def boastful(system, formulation, solver, **settings):
        return solve(system, "box", "pgs", **settings)  # solved, but as another problem

    monkeypatch.setattr(gpx, "solve", boastful)
    rows = call(tmp_path, "--scene", "ShakenTower-5", *SMALL)[2]
    assert {(row["status"], row["reached"]) for row in rows} == {("solved", "false")}
    assert all(float(row["natural_map"]) > 1e-3 for row in rows)

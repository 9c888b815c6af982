"""`check` and `compare` on results that were tampered with, and on real ones."""

import io
from dataclasses import replace

import pytest
from rich.console import Console

import gpx_lcp as gpx
from benchmarks import cli, exit_codes, store
from benchmarks.fclib.suite import Fclib
from benchmarks.stacks_suite import Stacks
from benchmarks.verbs.check import breaches_of
from benchmarks.verbs.compare import change
from tests.benchmarks.make_record import record

CHARTS = ("speed-accuracy-cold", "speed-accuracy-stepped", "forces")


def call(*arguments) -> tuple[int, str]:
    page = io.StringIO()
    code = cli.main([str(a) for a in arguments], Console(file=page, width=200, highlight=False))
    return code, page.getvalue()


@pytest.fixture(autouse=True, scope="module")
def no_charts():
    """Drawing takes longer than everything else here: one test draws."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Stacks, "draw", lambda *arguments: [])
        patch.setattr(Fclib, "draw", lambda *arguments: [])
        yield patch


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    """Results of both suites: a stack by gpx-lcp, and one problem of our own beside one from a file."""
    out = tmp_path_factory.mktemp("results")
    plain = ("--quick", "--out", out, "--repeats", "2")
    call("run", "stacks", *plain, "--scene", "tower-5", "--peer", "none", "--steps", "8", "--time-limit", "60")
    data = out / "data"
    data.mkdir()
    gpx.write_fclib(data / "Tower-2.hdf5", gpx.World(gpx.scenes.tower(2), time_step=1 / 240).system())
    solvers = [word for name in ("newton", "pgs", "clarabel") for word in ("--solver", name)]
    programs = [word for name in ("coulomb", "cone", "normal") for word in ("--formulation", name)]
    call("run", "fclib", *plain, "--data", data, *solvers, *programs)
    return out


def test_every_stored_answer_is_certified_again(results):
    code, text = call("check", results / "stacks", results / "fclib")
    assert code == exit_codes.OK, text
    rows = [row for suite in ("stacks", "fclib") for row in store.read(results / suite)]
    answered = [row for row in rows if row.answer]
    assert len(answered) > 20 and {row.suite for row in answered} == {"stacks", "fclib"}
    assert all(row.answer for row in rows if row.certificate)
    assert f"every claim of {len(answered)} answers holds" in text


@pytest.mark.parametrize(
    ("tamper", "claim"),
    [
        (lambda row: {"certificate": {**row.certificate, "natural_map": 1e-3}}, "natural_map is stated as 0.001, and"),
        (lambda row: {"tolerance": 1e-30, "reached": True}, "1e-30 is said to be reached, but the natural map is"),
        (lambda row: {"tolerance": 1e-30, "status": "solved"}, "its program's residual is"),
        (lambda row: {"answer": ""}, "it states a certificate, but no impulses are kept"),
        (lambda row: {"answer": "nowhere.npz:0"}, "cannot be read as stored answers"),
        (lambda row: {"answer": row.answer.split(":")[0] + ":99"}, "there is no number 99"),
    ],
)
def test_a_claim_that_does_not_hold_is_found(results, tamper, claim):
    rows = store.read(results / "fclib")
    row = next(row for row in rows if row.solver == "newton" and row.formulation == "coulomb")
    assert list(breaches_of(results / "fclib", [row])) == []
    found = list(breaches_of(results / "fclib", [replace(row, **tamper(row))]))
    assert claim in " ".join(breach.claim for breach in found)


def test_a_claim_that_does_not_hold_is_the_exit_code(results, tmp_path):
    rows = store.read(results / "stacks")
    rows[0] = replace(rows[0], certificate={**rows[0].certificate, "cone_violation": 0.5})
    folder = tmp_path / "stacks"
    (folder).mkdir()
    (folder / "answers").symlink_to(results / "stacks" / "answers")
    store.Folder(folder, rows).write()
    code, text = call("check", folder)
    assert code == exit_codes.FAILED
    assert "does not hold" in text and "cone_violation is stated as 0.5" in text and "1 claims do not hold" in text


def test_a_problem_file_that_is_gone_or_changed_cannot_be_certified(results, tmp_path):
    data = tmp_path / "data"
    data.mkdir()
    path = data / "Tower-2.hdf5"
    system = gpx.World(gpx.scenes.tower(2), time_step=1 / 240).system()
    gpx.write_fclib(path, system)
    call("run", "fclib", "--quick", "--out", tmp_path, "--data", data, "--solver", "newton")
    rows = store.read(tmp_path / "fclib")
    gpx.write_fclib(path, gpx.StackedSystem(system.A, 2.0 * system.B, system.friction))
    assert "has changed since" in next(breaches_of(tmp_path / "fclib", rows)).claim
    path.unlink()
    assert "is gone" in next(breaches_of(tmp_path / "fclib", rows)).claim


def timed(low, middle, high, **more):
    more = {"repeats": 3, **more}
    return record(step_seconds=middle, step_seconds_low=low, step_seconds_high=high, **more)


OLD = timed(1.0, 1.1, 1.2, natural_map=1e-9)


@pytest.mark.parametrize(
    ("new", "speed", "quality"),
    [
        (timed(1.1, 1.3, 1.5, natural_map=1e-9), "within noise", "same"),
        (timed(1.3, 1.4, 1.5, natural_map=1.5e-9), "slower", "same"),
        (timed(0.5, 0.6, 0.9, natural_map=1e-6), "faster", "worse"),
        (timed(0.5, 0.6, 0.9, natural_map=1e-11), "faster", "better"),
        (timed(0.5, 0.5, 0.5, natural_map=1e-9, repeats=2), "no spread", "same"),
        (record(status="error"), "", "worse"),
    ],
)
def test_times_differ_where_the_repeats_do_not_overlap_and_errors_from_a_factor_of_two(new, speed, quality):
    found = change(OLD, new)
    assert (found.speed, found.quality) == (speed, quality)


def test_a_tolerance_missed_is_worse_and_how_far_below_it_does_not_matter():
    reached, missed = (record(tolerance=1e-8, reached=r, natural_map=m) for r, m in ((True, 1e-9), (False, 2e-8)))
    assert change(reached, missed).quality == "worse"
    assert change(missed, reached).why == "reaches its tolerance"
    assert change(reached, replace(reached, certificate={"natural_map": 1e-14})).quality == "same"


def test_errors_below_rounding_are_the_same():
    assert change(record(natural_map=1e-16), record(natural_map=5e-13)).quality == "same"
    assert change(record(natural_map=float("inf")), record(natural_map=1e-3)).quality == "better"


def test_compare_lists_changes_and_says_by_its_code_that_something_got_worse(tmp_path):
    rows = [timed(1.0, 1.1, 1.2, scene=f"s{n}", natural_map=1e-9) for n in range(4)]
    later = [timed(2.0, 2.1, 2.2, scene="s0", natural_map=1e-9), *rows[1:3]]
    for name, held in (("a", rows), ("b", later)):
        store.Folder(tmp_path / name, held).write()
    code, text = call("compare", tmp_path / "a", tmp_path / "b")
    assert code == exit_codes.FAILED
    assert "3 rows in both" in text and "slower" in text and "1.91" in text
    assert "1 rows are only in" in text
    assert call("compare", tmp_path / "a", tmp_path / "a")[0] == exit_codes.OK
    code, text = call("compare", tmp_path / "a", tmp_path / "nowhere")
    assert code == exit_codes.USAGE and "holds no results" in text


def test_plot_draws_stored_rows_again_merged(results, tmp_path, no_charts):
    no_charts.undo()
    assert call("plot", results / "stacks", "--out", tmp_path)[0] == exit_codes.OK
    drawn = {path.name for path in (tmp_path / "stacks").iterdir()}
    assert drawn == {f"{stem}.{kind}" for stem in CHARTS for kind in ("png", "svg")}
    assert call("plot", tmp_path / "nowhere")[0] == exit_codes.USAGE

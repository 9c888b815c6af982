"""The harness with a suite that takes no time: nothing is lost, nothing is there twice, whatever happens in between."""

import argparse
import csv
import io
import signal
import weakref
from dataclasses import replace

import pyarrow.parquet
import pytest
from rich.console import Console

import gpx_lcp as gpx
from benchmarks import exit_codes, store
from benchmarks.answers import Archive
from benchmarks.interface import Diverged, GaveUp
from benchmarks.measuring import measure, step_times
from benchmarks.records import CERTIFICATE
from benchmarks.verbs.run import run
from tests.benchmarks.fake_suite import FakeSuite

# What differs between two runs of the same sweep: clocks, memory, and in which file an answer lies.
CHANCE = ("seconds", "memory", "measured_at", "answer")


def call(suite, out, resume=False, scheduler=None):
    page = Console(file=io.StringIO(), width=200)
    return run(suite, argparse.Namespace(out=out, resume=resume, scheduler=scheduler), ["run", "fake"], page)


def steady(folder):
    """Return the rows of a run, without what chance decides."""
    rows = store.as_table(store.read(folder / "fake")).to_pylist()
    return [{name: value for name, value in row.items() if not any(c in name for c in CHANCE)} for row in rows]


def by_key(rows):
    return sorted(rows, key=lambda row: (row["scene"], row["solver"]))


class Stops:
    """Raises KeyboardInterrupt before the given trials, counted over all runs."""

    def __init__(self, *trials):
        self.trials, self.made = trials, []

    def __call__(self, attempt):
        self.made.append(attempt.key)
        if len(self.made) in self.trials:
            raise KeyboardInterrupt


@pytest.mark.parametrize(
    ("scenes", "attempts", "stops"),
    [
        (4, 5, (3, 19, 30)),  # in the first round of a batch, in its second, and later
        pytest.param(50, 20, (7, 801, 1502), marks=pytest.mark.slow),
    ],
)
def test_a_sweep_interrupted_three_times_and_resumed_gives_the_same_rows(tmp_path, scenes, attempts, stops):
    assert call(FakeSuite(scenes, attempts), tmp_path / "whole") == exit_codes.OK
    stopping = Stops(*stops)
    suite = FakeSuite(scenes, attempts, stopping)
    codes = [call(suite, tmp_path / "parts", resume=n > 0) for n in range(4)]
    assert codes == [exit_codes.INTERRUPTED] * 3 + [exit_codes.OK]
    whole, parts = steady(tmp_path / "whole"), steady(tmp_path / "parts")
    assert len(whole) == scenes * attempts
    assert by_key(parts) == by_key(whole)
    # Only what a stop cut short is measured again: its own attempt, and those of its batch in want of a repeat.
    assert len(stopping.made) <= 2 * scenes * attempts + 3 * 2 * attempts


def test_after_ctrl_c_every_attempt_has_a_row_and_what_was_measured_is_kept(tmp_path):
    assert call(FakeSuite(2, 3, Stops(5)), tmp_path) == exit_codes.INTERRUPTED
    rows = store.read(tmp_path / "fake")
    assert [(row.scene, row.status) for row in rows] == [
        ("scene-0", "solved"),
        ("scene-0", "interrupted"),
        ("scene-0", "interrupted"),
        *[("scene-1", "interrupted")] * 3,
    ]
    assert [row.repeats for row in rows] == [2, 1, 1, 0, 0, 0]
    assert rows[1].natural_map is not None and rows[3].natural_map is None


class StopsUnseen:
    """Sends Ctrl-C before a trial, where Python drops the KeyboardInterrupt: in a weak reference's callback."""

    def __init__(self, trial):
        self.trial, self.made = trial, 0

    def __call__(self, attempt):
        self.made += 1
        if self.made == self.trial:
            gone = Stops()
            kept = weakref.ref(gone, lambda reference: signal.raise_signal(signal.SIGINT))
            del gone
            assert kept() is None


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
def test_a_ctrl_c_that_python_drops_stops_the_run_before_the_next_trial(tmp_path):
    unseen = StopsUnseen(5)
    assert call(FakeSuite(2, 3, unseen), tmp_path) == exit_codes.INTERRUPTED
    assert unseen.made == 5
    assert [row.repeats for row in store.read(tmp_path / "fake")] == [2, 2, 1, 0, 0, 0]
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_resume_makes_only_what_is_missing(tmp_path):
    call(FakeSuite(2, 3), tmp_path)
    made = Stops()
    assert call(FakeSuite(2, 4, made), tmp_path, resume=True) == exit_codes.OK
    assert {key[:4] for key in made.made} == {(f"scene-{n}", "0", "gpx-lcp", "solver-3") for n in range(2)}
    assert len(store.read(tmp_path / "fake")) == 8


def test_rows_and_answers_come_back_as_they_were(tmp_path):
    suite = FakeSuite(1, 2)
    (batch,) = suite.batches(None, tmp_path)
    measured = measure(batch, lambda text: None)
    stored = store.Folder(tmp_path / "fake").keep("a scene / with signs", measured)
    read = store.read(tmp_path / "fake")
    assert [row.answer for row in read] == ["a_scene_with_signs-0.npz:0", "a_scene_with_signs-0.npz:1"]
    for row, old in zip(read, stored, strict=True):
        assert row.key == old.key and row.where == old.where and row.figures == old.figures
        assert row.certificate == {name: value for name, value in old.certificate.items() if value is not None}
    kept = Archive(tmp_path / "fake" / "answers" / "a_scene_with_signs-0.npz")[1]
    assert kept.impulse.tolist() == [[1.5, 0.0, 0.0]]
    assert (kept.system.B.tolist(), kept.program, kept.facets) == ([1.0, 0.0, 0.0], "coulomb", 8)


def test_the_csv_holds_what_the_parquet_holds(tmp_path):
    call(FakeSuite(1, 2), tmp_path)
    table = pyarrow.parquet.read_table(tmp_path / "fake" / "rows.parquet")
    with (tmp_path / "fake" / "rows.csv").open(newline="") as stream:
        read = list(csv.DictReader(stream))
    assert list(read[0]) == table.column_names
    wanted = {"suite", "scene", "seed", "engine", "formulation", "solver", "setting", "tolerance", "case", "status"}
    wanted |= {"setup_seconds", "solve_seconds", "step_seconds", "iterations", "factorisations", "fallbacks"}
    wanted |= {"peak_memory", "cpu", "build_profile", "revision", "host", "numpy", *CERTIFICATE}
    assert wanted <= set(read[0])
    assert read[1]["natural_map"] == str(table["natural_map"][1].as_py())
    assert read[0]["setup_seconds"] == ""


def test_results_of_several_runs_merge_and_the_finished_row_counts(tmp_path):
    call(FakeSuite(2, 3, Stops(5)), tmp_path / "cut")
    call(FakeSuite(1, 3), tmp_path / "whole")
    cut, whole = (store.read(tmp_path / name / "fake") for name in ("cut", "whole"))
    for runs in ((cut, whole), (whole, cut)):
        together = store.merged(runs)
        assert len(together) == 6
        assert {row.status for row in together if row.scene == "scene-0"} == {"solved", "stalled"}


def raises(error):
    def before(attempt):
        raise error

    return before


def test_an_error_is_a_row_and_the_exit_code(tmp_path):
    assert call(FakeSuite(1, 1, raises(RuntimeError("out of order"))), tmp_path) == exit_codes.FAILED
    (row,) = store.read(tmp_path / "fake")
    assert (row.status, row.message, row.reached) == ("error", "RuntimeError: out of order", False)


def test_a_refusal_is_a_row_and_no_failure(tmp_path):
    assert call(FakeSuite(1, 1, raises(gpx.SettingsError("not with me"))), tmp_path) == exit_codes.OK
    (row,) = store.read(tmp_path / "fake")
    assert (row.status, row.message) == ("refused", "not with me")


@pytest.mark.parametrize(("error", "status"), [(GaveUp("no"), "gave up"), (Diverged("far"), "diverged")])
def test_what_an_engine_says_or_does_itself_is_a_row_and_no_failure(tmp_path, error, status):
    assert call(FakeSuite(1, 1, raises(error)), tmp_path) == exit_codes.OK
    (row,) = store.read(tmp_path / "fake")
    assert (row.status, row.message, row.reached) == (status, str(error), False)


def test_what_only_the_first_trial_tells_is_kept_and_counts_for_nothing_where_others_tell(tmp_path):
    def measured(told):
        (batch,) = FakeSuite(1, 1).batches(None, tmp_path)
        bench, trials = batch.open(), iter(told)

        class Tells:
            def try_once(self, *arguments):
                (outcome,) = bench.try_once(*arguments)
                return (replace(outcome, setup_seconds=next(trials)),)

        object.__setattr__(batch, "repeats", len(told))
        object.__setattr__(batch, "open", Tells)
        return measure(batch, lambda text: None).records[0].setup_seconds

    assert measured([3.0, None, None]) == 3.0
    assert measured([9.0, 1.0, 2.0]) == 1.5
    assert measured([None, None]) is None


def test_a_scene_that_cannot_be_built_is_unreadable_in_every_row(tmp_path):
    (batch,) = FakeSuite(1, 2).batches(None, tmp_path)

    def broken():
        raise gpx.ProblemError("no such thing")

    object.__setattr__(batch, "open", broken)
    told = []
    records = measure(batch, told.append).records
    assert [(row.status, row.message) for row in records] == [("unreadable", "no such thing")] * 2
    assert len(told) == 4


def test_an_answer_that_is_not_there_is_named(tmp_path):
    call(FakeSuite(1, 1), tmp_path)
    archive = Archive(tmp_path / "fake" / "answers" / "scene-0-0.npz")
    with pytest.raises(gpx.ProblemError, match="holds 1 answers: there is no number 1"):
        archive[1]
    with pytest.raises(gpx.ProblemError, match="cannot be read as stored answers"):
        Archive(tmp_path / "nowhere.npz")


def test_peak_memory_is_that_of_the_attempt(tmp_path):
    (batch,) = FakeSuite(1, 2, lambda a: bytearray(200_000_000) and None if a.effort else None).batches(None, tmp_path)
    small, large = (row.peak_memory for row in measure(batch, lambda text: None).records)
    if small is None:
        pytest.skip("this system does not tell the peak of a process")
    assert large - small > 150_000_000


def test_step_times_drop_a_hiccup_and_keep_a_dear_step():
    middle, low, high = step_times([[1.0, 5.0], [1.0, 5.0], [9.0, 5.0]])
    assert (middle, low, high) == (3.0, 3.0, 7.0)
    assert step_times([[1.0, 3.0], [1.0]])[0] == 2.0

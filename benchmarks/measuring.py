"""Measures a batch: repeats interleaved, one row per attempt and case, failures too, never an exception of the harness.

The first trial of each attempt is judged, and times are those of the others, where there are any: the engines are
deterministic, and judging between timed steps makes them slower, by half where a step takes 0.1 ms.
"""

from __future__ import annotations

import gc
import platform
import statistics
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field, replace
from datetime import UTC, datetime
from functools import cache
from pathlib import Path

import numpy as np

import gpx_lcp as gpx
from benchmarks import machine
from benchmarks.answers import pack
from benchmarks.attempts import (
    DIVERGED,
    ERROR,
    GAVE_UP,
    INTERRUPTED,
    MISSING,
    REFUSED,
    UNREADABLE,
    Answer,
    Attempt,
    Batch,
    Bench,
    Outcome,
)
from benchmarks.interface import Array, Diverged, GaveUp
from benchmarks.records import Record, certificate_columns

# The clock's own step, s: nothing is said to take less.
TICK = time.get_clock_info("perf_counter").resolution


@dataclass(frozen=True)
class Measured:
    """What a batch gave.

    Parameters
    ----------
    records : sequence of Record
        For every attempt and case. `answer` holds the index of the answer in `answers`.
    answers : bytes
        As `benchmarks.answers.pack` makes them; empty without any.
    interrupted : bool
        Whether Ctrl-C ended it.
    """

    records: Sequence[Record]
    answers: bytes
    interrupted: bool = False


@dataclass
class Trials:
    """Every trial of one attempt."""

    attempt: Attempt
    outcomes: list[Sequence[Outcome]] = field(default_factory=list)
    status: str = ""
    message: str = ""
    spent: float = 0.0
    last: float = 0.0
    peak_memory: int | None = None

    def wants_more(self, batch: Batch) -> bool:
        """Whether another trial is due: a further one starts only when another like the last would fit."""
        if self.status or len(self.outcomes) >= batch.repeats:
            return False
        if not self.outcomes:
            return True
        return all(outcome.again for outcome in self.outcomes[-1]) and self.spent + self.last <= batch.time_limit


def measure(batch: Batch, advance: Callable[[str], None]) -> Measured:
    """Run every attempt of a batch; `advance(text)` is called before each trial, `batch.repeats` times per attempt."""
    trials = [Trials(attempt) for attempt in batch.attempts]
    interrupted = False
    # What is there already is left out of every collection between trials, which would take longer than most of them.
    gc.freeze()
    try:
        _try_all(batch, trials, advance)
    except KeyboardInterrupt:
        interrupted = True
        for trial in trials:
            if trial.wants_more(batch):
                trial.status = INTERRUPTED
    finally:
        gc.unfreeze()
    answers: list[Answer] = []
    records = [_record(trial, case, answers) for trial in trials for case in batch.cases]
    return Measured(records, pack(answers), interrupted)


def not_measured(batch: Batch) -> list[Record]:
    """Return the rows of a batch that was never reached."""
    return [
        _record(Trials(attempt, status=INTERRUPTED), case, []) for attempt in batch.attempts for case in batch.cases
    ]


def _try_all(batch: Batch, trials: Sequence[Trials], advance: Callable[[str], None]) -> None:
    try:
        bench = batch.open()
    except Exception as error:
        # A broken file is the status of its rows, and the other files go on.
        for trial in trials:
            trial.status, trial.message = UNREADABLE, str(error)
            for _ in range(batch.repeats):
                advance(trial.attempt.label)
        return
    for _ in range(batch.repeats):
        for trial in trials:
            advance(trial.attempt.label)
            if trial.wants_more(batch):
                _try_once(trial, bench, batch)


def _try_once(trial: Trials, bench: Bench, batch: Batch) -> None:
    first = not trial.outcomes
    start = time.perf_counter()
    try:
        with no_collection(), peak_memory(trial if first else None):
            trial.outcomes.append(bench.try_once(trial.attempt, first, batch.time_limit - trial.spent))
    except Exception as error:
        # One engine that breaks on one scene must not lose the others' results.
        trial.status, trial.message = failure(error)
    trial.last = time.perf_counter() - start
    trial.spent += trial.last


def failure(error: Exception) -> tuple[str, str]:
    """Return the status and the message of an attempt that ended in an exception."""
    if isinstance(error, gpx.BackendMissing):
        return MISSING, str(error)
    if isinstance(error, gpx.SettingsError):
        return REFUSED, str(error)
    if isinstance(error, GaveUp):
        return GAVE_UP, str(error)
    if isinstance(error, Diverged):
        return DIVERGED, str(error)
    return ERROR, f"{type(error).__name__}: {error}"


@contextmanager
def no_collection() -> Iterator[None]:
    """Keep the garbage collector out of the timed calls, as timeit does."""
    gc.collect()
    gc.disable()
    try:
        yield
    finally:
        gc.enable()


@contextmanager
def peak_memory(trial: Trials | None) -> Iterator[None]:
    """Note the largest resident size of the process inside the block; nothing where the system does not tell."""
    try:
        if trial is not None:
            # 5 sets the mark back to the present size.
            Path("/proc/self/clear_refs").write_text("5", encoding="ascii")
    except OSError:
        trial = None
    yield
    if trial is not None:
        for line in Path("/proc/self/status").read_text(encoding="ascii", errors="replace").splitlines():
            if line.startswith("VmHWM:"):
                trial.peak_memory = 1024 * int(line.split()[1])


@cache
def where() -> dict[str, str]:
    """Return the columns that are the same for every row measured by this process."""
    return {**machine.describe(), "host": platform.node()}


def _record(trial: Trials, case: str, answers: list[Answer]) -> Record:
    """Return one row; the answer behind it is appended to `answers`."""
    now = datetime.now(UTC).isoformat(timespec="seconds")
    row = Record(
        **asdict(trial.attempt),
        case=case,
        status=trial.status,
        message=trial.message,
        peak_memory=trial.peak_memory,
        where={**where(), "measured_at": now},
    )
    outcomes = [outcome for trial in trial.outcomes for outcome in trial if outcome.case == case]
    if not outcomes:
        # What was asked of an attempt that failed was not reached; of one that was not made, nobody knows.
        judged = trial.status != INTERRUPTED and trial.attempt.tolerance is not None
        return replace(row, reached=False) if judged else row
    first = outcomes[0]
    if first.answer is not None:
        answers.append(first.answer)
        row = replace(row, answer=str(len(answers) - 1))
    made = [outcome for outcome in outcomes if len(outcome.step_seconds)]
    timed = [outcome.step_seconds for outcome in made[1:] or made]
    row = replace(
        row,
        status=trial.status or first.status,
        message="; ".join(filter(None, (trial.message, first.message))),
        reached=first.reached,
        method=first.method,
        fallbacks=" ".join(first.fallbacks),
        bodies=first.bodies,
        contacts=first.contacts,
        repeats=len(made),
        steps=len(first.step_seconds) if first.steps is None else first.steps,
        steps_asked=first.steps_asked,
        iterations=first.iterations,
        factorisations=first.factorisations,
        certificate=certificate_columns(first.certificate) if first.certificate else {},
        figures={name: v.item() if isinstance(v, np.generic) else v for name, v in first.figures.items()},
    )
    if timed:
        middle, low, high = step_times(timed)
        row = replace(row, step_seconds=middle, step_seconds_low=low, step_seconds_high=high)
    if setting_up := _told([outcome.setup_seconds for outcome in outcomes]):
        row = replace(row, setup_seconds=statistics.median(setting_up))
    if solving := _told([outcome.solve_seconds for outcome in outcomes]):
        middle = max(statistics.median(solving), TICK)
        row = replace(row, solve_seconds=middle, solve_seconds_low=min(solving), solve_seconds_high=max(solving))
    return row


def step_times(trials: Sequence[Sequence[float]]) -> tuple[float, float, float]:
    """Return the mean over steps of each step's median, fastest and slowest time over the trials, s.

    The median at each step drops a hiccup of the machine, and the mean keeps the cost of steps that are really dearer.
    A step that only some trials reached counts with those that did.
    """
    longest = max(len(trial) for trial in trials)
    table: Array = np.full((len(trials), longest), np.nan)
    for row, trial in zip(table, trials, strict=True):
        row[: len(trial)] = trial
    middle, low, high = (float(f(table, axis=0).mean()) for f in (np.nanmedian, np.nanmin, np.nanmax))
    return middle, low, high


def _told(seconds: Sequence[float | None]) -> list[float]:
    """Return what the trials tell of a part of their time, without the first one where others tell, too."""
    known = [value for value in seconds if value is not None]
    return known[1:] or known

"""A suite whose attempts take no time: what the harness does is looked at, not what is measured."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

import gpx_lcp as gpx
from benchmarks.attempts import Answer, Attempt, Outcome


@dataclass(frozen=True)
class FakeBatch:
    """One contact under a load; the setting says how wrong the impulse is. `before(attempt)` may misbehave."""

    name: str
    attempts: Sequence[Attempt]
    before: Callable[[Attempt], None] | None = None
    repeats: int = 2
    time_limit: float = 10.0
    cases: Sequence[str] = ("cold",)

    def open(self) -> FakeBench:
        return FakeBench(self)

    def only(self, attempts: Sequence[Attempt]) -> FakeBatch:
        return replace(self, attempts=attempts)


class FakeBench:
    def __init__(self, batch: FakeBatch) -> None:
        self._batch = batch
        self._system = gpx.StackedSystem(np.eye(3), [1.0, 0.0, 0.0], [0.5])

    def try_once(self, attempt: Attempt, first: bool, seconds_left: float) -> Sequence[Outcome]:
        if self._batch.before:
            self._batch.before(attempt)
        impulse = np.array([[1.0 + attempt.effort, 0.0, 0.0]])
        certificate = gpx.certify(self._system, impulse)
        return (
            Outcome(
                step_seconds=(1e-3,),
                solve_seconds=time.get_clock_info("perf_counter").resolution,
                status="solved" if attempt.effort == 0.0 else "stalled",
                contacts=1,
                certificate=certificate,
                reached=certificate.natural_map <= attempt.tolerance,
                answer=Answer(self._system, impulse, "coulomb", 8),
                figures={"of its own": attempt.effort},
            ),
        )


class FakeSuite:
    name, summary, not_shown = "fake", "made of nothing", "What this does not show: anything."

    def __init__(self, scenes: int, attempts: int, before: Callable[[Attempt], None] | None = None) -> None:
        self.size, self.before = (scenes, attempts), before

    def scenes(self):
        return {f"scene-{n}": "one contact" for n in range(self.size[0])}

    def add_arguments(self, parser):
        pass

    def batches(self, asked, folder):
        return [
            FakeBatch(scene, [attempt(scene, n) for n in range(self.size[1])], self.before) for scene in self.scenes()
        ]

    def batch_tables(self, records):
        return ()

    def tables(self, records, folder):
        return ()

    def draw(self, records, folder, out, footer):
        return ()


def attempt(scene: str, number: int) -> Attempt:
    return Attempt("fake", scene, f"solver-{number}", "coulomb", "as is", 0.5 * (number % 2), 1e-8)


@dataclass(frozen=True)
class Kills:
    """Kills the process that makes an attempt on a scene: the first time, or every time."""

    scene: str
    mark: Path
    always: bool = False

    def __call__(self, attempt: Attempt) -> None:
        if attempt.scene == self.scene and (self.always or not self.mark.exists()):
            self.mark.touch()
            os.kill(os.getpid(), signal.SIGKILL)

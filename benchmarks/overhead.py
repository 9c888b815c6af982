"""The suite `overhead`: what the harness adds to the steps that it measures.

    bias  = step time that the harness states / the same statistic of a loop of nothing but steps and a clock - 1
    share = wall time of the harness / wall time of such loops of as many simulations - 1

The first is what matters for a comparison. The second counts all that an attempt costs beside its steps: judging (which
takes longer than most steps), the certificate, collecting garbage, making rows.
"""

from __future__ import annotations

import argparse
import gc
import statistics
import time
from collections.abc import Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path

from rich.table import Table
from rich.text import Text

import gpx_lcp as gpx
from benchmarks import stacks
from benchmarks.arguments import chosen, positive
from benchmarks.attempts import COLD, OWN, Attempt, Outcome
from benchmarks.engines import ENGINES
from benchmarks.interface import Setting
from benchmarks.measuring import measure, no_collection, step_times
from benchmarks.records import Record
from benchmarks.simulating import STEPPED, SceneBatch
from benchmarks.tables import new_table

NAME = "overhead"
SCENES = ("tower-5", "tower-10", "tower-30", "wall-10")
SWEEPS = 50
# Of each simulation, as in the suite stacks.
STEPS, REPEATS = 240, 4
ROUNDS = 5


@dataclass(frozen=True)
class OverheadBatch:
    """One scene, with the harness and without it, in turns."""

    name: str
    attempts: Sequence[Attempt]
    rounds: int
    repeats: int = 1
    time_limit: float = 600.0
    cases: Sequence[str] = (COLD,)

    def open(self) -> OverheadBatch:
        """Return itself: every simulation is made afresh."""
        return self

    def only(self, attempts: Sequence[Attempt]) -> OverheadBatch:
        """Return the batch with these of its attempts."""
        return replace(self, attempts=attempts)

    def try_once(self, attempt: Attempt, first: bool, seconds_left: float) -> Sequence[Outcome]:
        """Run the same simulations with the harness and without it."""
        setting = ENGINES[OWN].sweeping(SWEEPS)[0]
        scene = SceneBatch(self.name, [attempt], {attempt.key: setting}, REPEATS, STEPS, self.time_limit)
        made = stacks.SCENES[self.name].make()
        bias, share, stated = [], [], []
        for _ in range(self.rounds):
            # As the harness does, so that what it saves in collections is no gain over the loops.
            gc.freeze()
            start = time.perf_counter()
            loops = [_bare(made, setting)[scene.settled_from + 1 :] for _ in range(REPEATS)]
            # The harness judges the first one, and times the others.
            bare, _, _ = step_times(loops[1:])
            between = time.perf_counter()
            gc.unfreeze()
            rows = measure(scene, lambda text: None).records
            end = time.perf_counter()
            (step,) = (row.step_seconds for row in rows if row.case == STEPPED)
            assert step is not None  # no time limit is near
            stated.append(step)
            bias.append(step / bare - 1.0)
            share.append((end - between) / (between - start) - 1.0)
        return (
            Outcome(
                step_seconds=(statistics.median(stated),),
                contacts=rows[0].contacts,
                figures={"bias": statistics.median(bias), "share": statistics.median(share)},
            ),
        )


def _bare(scene: gpx.Scene, setting: Setting) -> list[float]:
    """Return the wall time of each step, s, in a loop of nothing else."""
    seconds = []
    with no_collection(), closing(ENGINES[OWN].simulate(scene, stacks.TIME_STEP, setting, 600.0)) as simulation:
        for _ in range(STEPS + 1):
            tick = time.perf_counter()
            simulation.step()
            seconds.append(time.perf_counter() - tick)
    return seconds


class Overhead:
    """The row of the suite in the table."""

    name = NAME
    summary = "what the harness itself adds to the steps that it measures"
    not_shown = (
        "What this does not show: engines other than gpx-lcp; what other programs on the machine add, which is why "
        "bare loops and the harness take turns, and medians are stated."
    )

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Add the suite's arguments."""
        parser.add_argument(
            "--scene", action="append", metavar="NAME", help="only this scene; * and ? are wildcards (may be repeated)"
        )
        parser.add_argument("--rounds", type=positive, default=ROUNDS, metavar="N", help=f"turns ({ROUNDS})")

    def scenes(self) -> Mapping[str, str]:
        """Return the scenes, which are those of the suite stacks."""
        return {name: stacks.SCENES[name].title for name in SCENES}

    def batches(self, asked: argparse.Namespace, folder: Path) -> Sequence[OverheadBatch]:
        """Return a batch for each scene."""
        setting = ENGINES[OWN].sweeping(SWEEPS)[0]
        version = ENGINES[OWN].version()
        return [
            OverheadBatch(
                name,
                [Attempt(NAME, name, setting.solver, setting.formulation, setting.label, engine_version=version)],
                asked.rounds,
            )
            for name in chosen(SCENES, asked.scene)
        ]

    def batch_tables(self, records: Sequence[Record]) -> Sequence[Table]:
        """Return nothing: a scene is one line of the table at the end."""
        return ()

    def tables(self, records: Sequence[Record], folder: Path) -> Sequence[Table | Text]:
        """Return the table of scenes."""
        table = new_table(f"What the harness adds, {SWEEPS} sweeps of pgs a step: medians of turns with bare loops")
        table.add_column("scene")
        for column in ("step µs", "stated step time", "wall time of all"):
            table.add_column(column, justify="right")
        for record in records:
            parts = [record.figure(name) for name in ("bias", "share")]
            cells = ["" if part is None else f"{100 * part:+.1f} %" for part in parts]
            table.add_row(record.scene, "" if record.step_ms is None else f"{1e3 * record.step_ms:.0f}", *cells)
        return [table]

    def draw(self, records: Sequence[Record], folder: Path, out: Path, footer: str) -> Sequence[Path]:
        """Draw nothing."""
        return ()

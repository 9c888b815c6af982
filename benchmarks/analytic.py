"""The suite `analytic`: single motions whose end is known on paper, and how far from it each engine ends.

Every case is run at several time steps, so that the error can be seen to follow the step, or not to: what remains when
steps are short is what a method models otherwise. The error is relative to the way, the speed or the load that the case
is about; where a body has to stay, to the way it would have gone without friction, or to its own length. The
certificate is that of the last step.
"""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from matplotlib.ticker import LogLocator, NullLocator
from rich.table import Table
from rich.text import Text

import gpx_lcp as gpx
from benchmarks.arguments import add_effort, add_filters, chosen
from benchmarks.asked import add_peers, engines_asked, missing_peers, wanted
from benchmarks.attempts import COLD, DIVERGED, MISSING, OWN, Answer, Attempt, Outcome
from benchmarks.bodies import Bodies
from benchmarks.charts import look_of
from benchmarks.drawing import Entry, draw_legends, label_figure, panel_grid, plain_decades, save, title_panel
from benchmarks.engines import ENGINES, as_shipped, require_installed
from benchmarks.interface import Setting, scientific
from benchmarks.measures import contact_system
from benchmarks.motions import CASES, Course
from benchmarks.records import Record
from benchmarks.simulating import of_facts
from benchmarks.style import house_style
from benchmarks.tables import missing_notes, new_table

NAME = "analytic"
RATES, QUICK_RATES = (60, 240, 960), (240,)
REPEATS, QUICK_REPEATS = 2, 1
TIME_LIMIT, QUICK_TIME_LIMIT = 10.0, 2.0
# Errors below are rounding, and drawn there.
FLOOR = 1e-13


def settings(names: Sequence[str]) -> list[Setting]:
    """Return gpx-lcp's exact solver and its sweeps, and each of the named engines as it is shipped."""
    own = [("newton", 1e-10), ("pgs", 1e-6)]
    return [
        *(
            Setting(OWN, name, "coulomb", f"tolerance {scientific(bound)}", 0.0, {"tolerance": bound})
            for name, bound in own
        ),
        *as_shipped(names),
    ]


@dataclass(frozen=True)
class CaseBatch:
    """Every setting at every time step on one case."""

    name: str
    attempts: Sequence[Attempt]
    settings: Mapping[tuple[str, ...], Setting]
    repeats: int
    time_limit: float
    cases: Sequence[str] = (COLD,)

    def open(self) -> CaseBench:
        """Build the scene."""
        return CaseBench(self)

    def only(self, attempts: Sequence[Attempt]) -> CaseBatch:
        """Return the batch with these of its attempts."""
        return replace(self, attempts=attempts)


class CaseBench:
    """A case with its scene."""

    def __init__(self, batch: CaseBatch) -> None:
        self._batch, self._case = batch, CASES[batch.name]
        self._scene = self._case.make()
        self._bodies = Bodies.from_scene(self._scene)

    def try_once(self, attempt: Attempt, first: bool, seconds_left: float) -> Sequence[Outcome]:
        """Simulate the whole case, and compare its end with the truth; each step is timed."""
        require_installed(attempt.engine)
        setting, time_step = self._batch.settings[attempt.key], 1.0 / attempt.effort
        steps, seconds, heights = round(self._case.seconds / time_step), [], []
        begun = time.perf_counter()
        with closing(
            ENGINES[attempt.engine].simulate(self._scene, time_step, setting, self._batch.time_limit)
        ) as simulation:
            start = before = after = simulation.motion()
            for _ in range(steps):
                before = after
                tick = time.perf_counter()
                simulation.step()
                seconds.append(time.perf_counter() - tick)
                after = simulation.motion()
                heights.append(float(after.position[0, 2]))
                if time.perf_counter() - begun > seconds_left:
                    break
            course = Course(start, heights, after, simulation.contacts(), time_step)
            facts = simulation.facts()
        outcome = Outcome(step_seconds=seconds, steps=len(seconds), steps_asked=steps, bodies=len(self._scene.bodies))
        if len(seconds) < steps:
            return [replace(outcome, status="time limit", again=False)]
        if not np.isfinite(after.position).all():
            return [replace(outcome, status=DIVERGED, figures={"error": math.inf})]
        impulse, system = contact_system(self._bodies, before, course.contacts, time_step)
        return [
            replace(
                outcome,
                status=facts.status,
                method=facts.method,
                contacts=system.contacts,
                certificate=gpx.certify(system, impulse),
                answer=Answer(system, impulse),
                figures={"error": self._case.error(course)},
                **of_facts([facts]),
            )
        ]


class Analytic:
    """The row of the suite in the table."""

    name = NAME
    summary = "single motions whose end is known on paper: error against truth, at several time steps"
    not_shown = (
        "What this does not show: many bodies at once, which the suite stacks has, and how methods fail, which "
        "stability has; settings other than each engine's own. A truth here is of rigid bodies and Coulomb's law in "
        "continuous time; engines whose contacts give way, or whose friction creeps, were made to model something else."
    )

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Add the suite's arguments."""
        add_filters(parser)
        add_peers(parser)
        add_effort(parser, (REPEATS, QUICK_REPEATS), (TIME_LIMIT, QUICK_TIME_LIMIT))

    def scenes(self) -> Mapping[str, str]:
        """Return each case and its truth."""
        return {name: f"{case.title}: {case.truth}" for name, case in CASES.items()}

    def batches(self, asked: argparse.Namespace, folder: Path) -> Sequence[CaseBatch]:
        """Return a batch for each case."""
        run = wanted(asked, settings(engines_asked(asked)))
        if not run:
            return []
        rates = QUICK_RATES if asked.quick else RATES
        return [
            CaseBatch(
                name,
                [*(attempt for attempt, _ in asking), *missing_peers(asked, NAME, name)],
                {attempt.key: setting for attempt, setting in asking},
                asked.repeats or (QUICK_REPEATS if asked.quick else REPEATS),
                asked.time_limit or (QUICK_TIME_LIMIT if asked.quick else TIME_LIMIT),
            )
            for name in chosen(CASES, asked.scene)
            for asking in [[(_attempt(name, setting, rate), setting) for setting in run for rate in rates]]
        ]

    def batch_tables(self, records: Sequence[Record]) -> Sequence[Table]:
        """Return nothing: a case is one column of the table at the end."""
        return ()

    def tables(self, records: Sequence[Record], folder: Path) -> Sequence[Table | Text]:
        """Return the errors at each time step, a line for each case."""
        known = [row for row in records if row.scene in CASES]
        rates = sorted({row.effort for row in known if row.status != MISSING})
        refused = {f"{row.engine}: {row.message}" for row in records if row.status == "refused"}
        return [
            *(_table_at(rate, known) for rate in rates),
            *(Text(text, style="yellow") for text in sorted(refused)),
            *missing_notes(records),
        ]

    def draw(self, records: Sequence[Record], folder: Path, out: Path, footer: str) -> Sequence[Path]:
        """Draw error over time per simulated second, a panel for each case."""
        shown = [row for row in records if row.scene in CASES and row.figure("error") is not None]
        if not shown:
            return []
        with house_style():
            return _chart(shown, footer, out / "analytic")


def _attempt(name: str, setting: Setting, rate: int) -> Attempt:
    return Attempt(
        suite=NAME,
        scene=name,
        solver=setting.solver,
        formulation=setting.formulation,
        setting=f"{setting.label}, 1/{rate} s",
        effort=float(rate),
        engine=setting.engine,
        engine_version=ENGINES[setting.engine].version(),
    )


def _label(row: Record) -> str:
    return row.solver if row.engine == OWN else row.engine


def _table_at(rate: float, records: Sequence[Record]) -> Table:
    here = [row for row in records if row.effort == rate]
    labels = list(dict.fromkeys(map(_label, here)))
    table = new_table(f"Error against truth, time step 1/{rate:g} s")
    table.add_column("case")
    table.add_column("truth", overflow="fold")
    for label in labels:
        table.add_column(label, justify="right", no_wrap=True)
    for name in dict.fromkeys(row.scene for row in here):
        found = {_label(row): row for row in here if row.scene == name}
        cells = [found[label] if label in found else None for label in labels]
        table.add_row(CASES[name].title, CASES[name].truth, *map(_cell, cells))
    return table


def _cell(row: Record | None) -> str:
    if row is None:
        return ""
    error = row.figure("error")
    return row.status if error is None else f"{error:.1e}"


def _chart(records: Sequence[Record], footer: str, stem: Path) -> list[Path]:
    names = [name for name in CASES if any(row.scene == name for row in records)]
    figure, panels, legend, axes = panel_grid(len(names), 4.1, 2.9)
    entries: dict[str, Entry] = {}
    for ax, name in zip(axes, names, strict=True):
        here = [row for row in records if row.scene == name]
        ax.set_xscale("log")
        ax.set_yscale("log")
        plain_decades(ax.xaxis)
        ax.yaxis.set_major_locator(LogLocator(base=1000.0, numticks=12))
        ax.yaxis.set_minor_locator(NullLocator())
        title_panel(ax, CASES[name].title, "")
        for label in dict.fromkeys(map(_label, here)):
            line = sorted((row for row in here if _label(row) == label), key=lambda row: row.effort)
            look = look_of(line[0])
            (drawn,) = ax.plot(
                [1e3 * (row.step_seconds or 0.0) * row.effort for row in line],
                [min(max(row.figure("error") or 0.0, FLOOR), 10.0) for row in line],
                color=look.colour,
                marker=look.marker or "o",
                markersize=0.8 * look.size,
                markeredgecolor="white",
            )
            entries.setdefault(label, (drawn, label))
        ax.set_ylim(0.3 * FLOOR, 30.0)
    draw_legends(legend, [("each line: longer to\nshorter time steps", list(entries.values()))])
    label_figure(
        figure,
        panels,
        "wall time of a simulated second, ms",
        "error against truth, relative",
        "Motions known on paper",
        footer,
    )
    return save(figure, stem)

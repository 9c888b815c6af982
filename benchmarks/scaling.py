"""The suite `scaling`: what a time step costs as scenes grow, of gpx-lcp on one thread and two, and of its peers.

    time per step ∝ bodies^α

α is the slope of a straight line through log(time) over log(bodies), by least squares. Every setting keeps its effort
at all sizes: a fixed number of sweeps costs in proportion to the contacts and says nothing about accuracy, which is why
the certificate of the last step stands beside the time.
"""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patheffects import withStroke
from rich.table import Table
from rich.text import Text

import gpx_lcp as gpx
from benchmarks import stacks
from benchmarks.arguments import add_effort, add_filters, chosen
from benchmarks.asked import add_peers, engines_asked, missing_peers, wanted
from benchmarks.attempts import COLD, OWN, Answer, Attempt, Outcome
from benchmarks.bodies import Bodies
from benchmarks.charts import Look, look_of
from benchmarks.drawing import Entry, draw_legends, label_figure, panel_grid, plain_decades, save, title_panel
from benchmarks.engines import ENGINES, as_shipped, require_installed
from benchmarks.interface import Diverged, GaveUp, Setting, scientific
from benchmarks.measures import measure
from benchmarks.measuring import failure
from benchmarks.records import Record
from benchmarks.simulating import of_facts
from benchmarks.style import house_style
from benchmarks.tables import missing_notes, new_table

NAME = "scaling"
SIZES, QUICK_SIZES = (10, 30, 100, 300, 1000, 3000, 10000), (10, 30)
REPEATS, QUICK_REPEATS = 2, 1
TIME_LIMIT, QUICK_TIME_LIMIT = 15.0, 1.0
SWEEPS = 50
THREADS = 2
# Steps that are timed, after those that bring a scene into the state that is meant.
STEPS = 10
# Of the height of a panel.
LINE_OF_TEXT = 0.05
SOLVER_TOLERANCE = 1e-8


@dataclass(frozen=True)
class Family:
    """Scenes of one kind: what they are, the one with about so many bodies, and warm steps before those timed."""

    title: str
    make: Callable[[int], gpx.Scene]
    warm_steps: int
    largest: int


def _rows(bodies: int) -> int:
    """Return the rows of a wall of about so many bricks, rows (rows + 1)/2."""
    return max(1, round(math.sqrt(2.0 * bodies + 0.25) - 0.5))


FAMILIES: Mapping[str, Family] = {
    "tower": Family("Towers", lambda n: stacks.pressed(gpx.scenes.tower(n)), 5, 1000),
    "wall": Family("Brick walls", lambda n: stacks.pressed(gpx.scenes.wall(_rows(n))), 5, 10000),
    # Half a second: the lower layers lie, the upper ones still come down.
    "pile": Family("Balls in a pit", lambda n: gpx.scenes.sphere_pile(n), 120, 10000),
}
SCENES: Mapping[str, tuple[Family, int]] = {
    f"{name}-{size}": (family, size) for name, family in FAMILIES.items() for size in SIZES if size <= family.largest
}


def settings(names: Sequence[str]) -> list[Setting]:
    """Return gpx-lcp's sweeps on one thread and two, its newton, and each of the named engines as it is shipped."""
    sweeps = ENGINES[OWN].sweeping(SWEEPS)[0]
    threaded = replace(
        sweeps, label=f"{SWEEPS} sweeps, {THREADS} threads", options={**sweeps.options, "threads": THREADS}
    )
    newton = Setting(
        OWN, "newton", "coulomb", f"tolerance {scientific(SOLVER_TOLERANCE)}", 8.0, {"tolerance": SOLVER_TOLERANCE}
    )
    return [sweeps, threaded, newton, *as_shipped(names)]


@dataclass(frozen=True)
class ScalingBatch:
    """Every setting on one scene."""

    name: str
    attempts: Sequence[Attempt]
    settings: Mapping[tuple[str, ...], Setting]
    repeats: int
    time_limit: float
    cases: Sequence[str] = (COLD,)

    def open(self) -> ScalingBench:
        """Build the scene."""
        return ScalingBench(self)

    def only(self, attempts: Sequence[Attempt]) -> ScalingBatch:
        """Return the batch with these of its attempts."""
        return replace(self, attempts=attempts)


class ScalingBench:
    """A scene that was built."""

    def __init__(self, batch: ScalingBatch) -> None:
        self._batch = batch
        self._family, size = SCENES[batch.name]
        self._scene = self._family.make(size)
        self._bodies = Bodies.from_scene(self._scene)

    def try_once(self, attempt: Attempt, first: bool, seconds_left: float) -> Sequence[Outcome]:
        """Simulate until the timed steps are done or time is up, and judge the last of them."""
        require_installed(attempt.engine)
        setting = self._batch.settings[attempt.key]
        count, start = len(self._scene.bodies), time.perf_counter()
        seconds: list[float] = []
        with closing(
            ENGINES[attempt.engine].simulate(self._scene, stacks.TIME_STEP, setting, seconds_left)
        ) as simulation:
            for step in range(self._family.warm_steps + STEPS):
                if time.perf_counter() - start > seconds_left:
                    break
                before = simulation.motion() if first and step >= self._family.warm_steps else None
                tick = time.perf_counter()
                simulation.step()
                if step >= self._family.warm_steps:
                    seconds.append(time.perf_counter() - tick)
            outcome = Outcome(step_seconds=seconds, steps=len(seconds), steps_asked=STEPS, bodies=count)
            if not seconds:
                message = f"{self._family.warm_steps} steps and one more took longer than {seconds_left:g} s"
                return [replace(outcome, status="time limit", message=message, again=False)]
            if before is None:
                return [outcome]
            try:
                contacts, facts = simulation.contacts(), simulation.facts()
                judged = measure(self._bodies, before, simulation.motion(), contacts, stacks.TIME_STEP)
            except (GaveUp, Diverged) as error:
                # Its times are measured all the same.
                status, message = failure(error)
                return [replace(outcome, status=status, message=message)]
        certificate = judged.certificate
        return [
            replace(
                outcome,
                status=facts.status,
                method=facts.method,
                contacts=contacts.gap.size,
                **of_facts([facts]),
                certificate=certificate,
                answer=Answer(certificate.system, certificate.impulse),
                figures={"penetration": judged.penetration},
            )
        ]


class Scaling:
    """The row of the suite in the table."""

    name = NAME
    summary = "what a time step costs as scenes grow, with the exponents"
    not_shown = (
        "What this does not show: other machines and more threads; how accurate equal effort is at each size (the "
        "natural map of the last step stands beside its time, and for engines with springs at contacts it says that "
        "they pose another problem); scenes whose contacts come and go faster than those of a pile."
    )

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Add the suite's arguments."""
        add_filters(parser)
        add_peers(parser)
        add_effort(parser, (REPEATS, QUICK_REPEATS), (TIME_LIMIT, QUICK_TIME_LIMIT))

    def scenes(self) -> Mapping[str, str]:
        """Return each scene and what it is."""
        return {name: f"{family.title}, about {size} bodies" for name, (family, size) in SCENES.items()}

    def batches(self, asked: argparse.Namespace, folder: Path) -> Sequence[ScalingBatch]:
        """Return a batch for each scene."""
        run = wanted(asked, settings(engines_asked(asked)))
        if not run:
            return []
        usual = [name for name, (_, size) in SCENES.items() if not asked.quick or size in QUICK_SIZES]
        names = chosen(SCENES, asked.scene) if asked.scene else usual
        return [
            ScalingBatch(
                name,
                [*attempts.values(), *missing_peers(asked, NAME, name)],
                {attempts[setting.label, setting.line].key: setting for setting in run},
                asked.repeats or (QUICK_REPEATS if asked.quick else REPEATS),
                asked.time_limit or (QUICK_TIME_LIMIT if asked.quick else TIME_LIMIT),
            )
            for name in names
            if (attempts := {(setting.label, setting.line): _attempt(name, setting) for setting in run})
        ]

    def batch_tables(self, records: Sequence[Record]) -> Sequence[Table]:
        """Return nothing: a scene is one point of each line."""
        return ()

    def tables(self, records: Sequence[Record], folder: Path) -> Sequence[Table | Text]:
        """Return a table for each family: the exponent of each setting, and its times."""
        tables = [_table(family, found) for name, family in FAMILIES.items() if (found := _lines(name, records))]
        return [*tables, *missing_notes(records)]

    def draw(self, records: Sequence[Record], folder: Path, out: Path, footer: str) -> Sequence[Path]:
        """Draw time per step over bodies, a panel for each family."""
        found = {name: lines for name in FAMILIES if (lines := _lines(name, records))}
        if not found:
            return []
        with house_style():
            return _chart(found, footer, out / "scaling")


def exponent(records: Sequence[Record]) -> float | None:
    """Return α of time ∝ bodies^α; None of fewer than two sizes."""
    points = [(row.bodies, row.step_seconds) for row in records if row.bodies and row.step_seconds]
    if len({bodies for bodies, _ in points}) < 2:
        return None
    bodies, seconds = np.log(np.array(points)).T
    return float(np.polyfit(bodies, seconds, 1)[0])


def _attempt(scene: str, setting: Setting) -> Attempt:
    return Attempt(
        suite=NAME,
        scene=scene,
        solver=setting.solver,
        formulation=setting.formulation,
        setting=setting.label,
        effort=setting.effort,
        engine=setting.engine,
        engine_version=ENGINES[setting.engine].version(),
    )


Line = tuple[str, str, str, str]


def _lines(family: str, records: Sequence[Record]) -> dict[Line, list[Record]]:
    """Return the measured rows of a family by engine, solver, formulation and setting, by rising size."""
    lines: dict[Line, list[Record]] = {}
    for row in records:
        if row.scene.rpartition("-")[0] == family and row.measured and row.bodies:
            lines.setdefault((*row.line, row.setting), []).append(row)
    return {line: sorted(rows, key=lambda row: row.bodies or 0) for line, rows in lines.items()}


def _table(family: Family, lines: Mapping[Line, Sequence[Record]]) -> Table:
    sizes = sorted({row.bodies for rows in lines.values() for row in rows if row.bodies})
    table = new_table(f"{family.title}: ms per step by number of bodies, and the exponent")
    table.add_column("engine, solver, program, setting", overflow="fold", min_width=30)
    for column in (*map(str, sizes), "exponent", "nat. map of the largest"):
        table.add_column(column, justify="right", no_wrap=True)
    for line, rows in lines.items():
        times = {row.bodies: row.step_ms for row in rows}
        alpha, certified = exponent(rows), rows[-1].natural_map
        table.add_row(
            ", ".join(line),
            *("" if (ms := times.get(size)) is None else f"{ms:.3g}" for size in sizes),
            "" if alpha is None else f"{alpha:.2f}",
            "" if certified is None else f"{certified:.1e}",
        )
    return table


def _look(rows: Sequence[Record]) -> tuple[Look, str]:
    """Return how a line is drawn: threads are dashed."""
    return look_of(rows[0]), "--" if "threads" in rows[0].setting else "-"


def _write_exponents(ax: Axes, lines: Mapping[Line, Sequence[Record]]) -> None:
    """Write α at the end of each line, moved up where it would cover that of another line of the same length."""
    found = [
        (math.log(rows[-1].step_ms), rows, alpha)
        for rows in lines.values()
        if rows[-1].step_ms and (alpha := exponent(rows)) is not None
    ]
    low, high = map(math.log, ax.get_ylim())
    lowest: dict[int, float] = {}
    for end, rows, alpha in sorted(found, key=lambda each: each[0]):
        place = rows[-1].bodies or 0
        lowest[place] = max(end, lowest.get(place, -math.inf) + LINE_OF_TEXT * (high - low))
        at = (place, math.exp(lowest[place]))
        ax.annotate(
            f"{alpha:.2f}",
            at,
            (8, 0),
            textcoords="offset points",
            va="center",
            fontsize=11,
            color=_look(rows)[0].colour,
            path_effects=[withStroke(linewidth=3.0, foreground="white")],
            zorder=6,
        )


def _chart(found: Mapping[str, Mapping[Line, Sequence[Record]]], footer: str, stem: Path) -> list[Path]:
    figure, panels, legend, axes = panel_grid(len(found), width=4.6, height=4.4, shared=False)
    entries: dict[str, Entry] = {}
    for ax, (name, lines) in zip(axes, found.items(), strict=True):
        ax.set_xscale("log")
        ax.set_yscale("log")
        plain_decades(ax.xaxis)
        plain_decades(ax.yaxis)
        title_panel(ax, FAMILIES[name].title, "")
        for rows in lines.values():
            look, dashes = _look(rows)
            marker = look.marker or "o"
            (drawn,) = ax.plot(
                [row.bodies or 0 for row in rows],
                [row.step_ms or 0.0 for row in rows],
                color=look.colour,
                linestyle=dashes,
                marker=marker,
                markersize=0.75 * look.size,
                markeredgecolor="white",
            )
            entries.setdefault(f"{rows[0].engine if look.marker else rows[0].solver},\n{rows[0].setting}", (drawn, ""))
        ax.margins(x=0.2)
        _write_exponents(ax, lines)
    blocks = [
        ("", [(handle, label) for label, (handle, _) in entries.items()]),
        ("α, at the right:\ntime ∝ bodies$^{α}$", [(Line2D([], [], linestyle=""), "")]),
    ]
    draw_legends(legend, blocks)
    label_figure(figure, panels, "bodies", "wall time of a step, ms", "What a step costs as scenes grow", footer)
    return save(figure, stem)

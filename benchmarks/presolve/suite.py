"""The suite `presolve`: its table and its chart."""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from pathlib import Path

from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.ticker import FuncFormatter, NullLocator
from rich.table import Table
from rich.text import Text

import gpx_lcp as gpx
from benchmarks.arguments import add_effort, add_filters, chosen
from benchmarks.attempts import COLD
from benchmarks.drawing import save
from benchmarks.presolve.batches import AS_ASKED, NAME, REDUCED, STEPPED, THREADED, SceneBatch, scene_batch
from benchmarks.presolve.scenes import QUICK, SCENES
from benchmarks.records import Record
from benchmarks.style import INK, PALETTE, QUIET, house_style
from benchmarks.tables import new_table

SOLVERS = ("newton", "pgs")
REPEATS, QUICK_REPEATS = 5, 2
TIME_LIMIT, QUICK_TIME_LIMIT = 6.0, 1.0
STEPS, QUICK_STEPS = 30, 5

BARS = {
    (COLD, REDUCED): ("from nothing", PALETTE["blue"]),
    (COLD, THREADED): ("from nothing, two threads", PALETTE["purple"]),
    (STEPPED, REDUCED): ("from the last step", PALETTE["orange"]),
}


class Presolve:
    """The row of the suite in the table."""

    name = NAME
    summary = "what presolve gains: steps of the same scene as it was asked and made smaller"
    not_shown = (
        "What this does not show: other machines, where detection and solution may weigh otherwise; other solvers "
        "than those named, and other tolerances than 1e-8, or 1e-4 of sweeps. All settings go on from the same "
        "state, but to 1e-4 each on a way of its own, with more sweeps or fewer: compare iterations before times. "
        "Times are whole steps, detection of contacts and motion included, which presolve does not touch; a scene "
        "at rest that starts from its own impulses is hardly more than that. The first five steps of a world, which "
        "fill its memory and the caches, are not among them. 'As asked' gives every contact three rows and every "
        "body six velocities. Of rows, velocities and mean iterations, the table tells what is left of what there "
        "was. A solver that knows no Coulomb's law is asked for the frictionless law where a scene has no friction, "
        "else for the convex one; scenes that it can solve by neither are left out. On a shared machine times are "
        "good to 20-30 %."
    )

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Add the suite's arguments."""
        add_filters(parser)
        add_effort(parser, (REPEATS, QUICK_REPEATS), (TIME_LIMIT, QUICK_TIME_LIMIT))

    def scenes(self) -> Mapping[str, str]:
        """Return each scene and what it is."""
        return {name: scene.title for name, scene in SCENES.items()}

    def batches(self, asked: argparse.Namespace, folder: Path) -> Sequence[SceneBatch]:
        """Return a batch for each scene."""
        rows = gpx.solvers().values()
        solvers = [row.name for row in rows if row.installed and row.name in (asked.solver or SOLVERS)]
        names = QUICK if asked.quick and asked.scene is None else chosen(SCENES, asked.scene)
        steps = QUICK_STEPS if asked.quick else STEPS
        repeats = asked.repeats or (QUICK_REPEATS if asked.quick else REPEATS)
        limit = asked.time_limit or (QUICK_TIME_LIMIT if asked.quick else TIME_LIMIT)
        batches = [scene_batch(name, solvers, asked.formulation, steps, repeats, limit) for name in names]
        return [batch for batch in batches if batch.attempts]

    def batch_tables(self, records: Sequence[Record]) -> Sequence[Table]:
        """Return nothing: a scene is two lines of the table at the end."""
        return ()

    def tables(self, records: Sequence[Record], folder: Path) -> Sequence[Table | Text]:
        """Return a line for each scene, case and presolved setting."""
        table = new_table("Whole steps: as asked, and made smaller")
        for column in ("scene", "case", "method", "threads"):
            table.add_column(column, no_wrap=True)
        table.add_column("removed by")
        for column in ("rows", "velocities", "iterations", "asked ms", "ms", "gain"):
            table.add_column(column, justify="right", no_wrap=True)
        for record, plain in pairs(records):
            table.add_row(
                record.scene,
                record.case,
                f"{record.formulation}/{record.solver}",
                str(SCENES[record.scene].threads if record.setting == THREADED else 1),
                str(record.figures["reductions"]) or "nothing",
                _of(record.figures["rows_left"], plain.figures["rows_left"]),
                _of(record.figures["velocities_left"], plain.figures["velocities_left"]),
                f"{_count(record.figures['mean_iterations'])} of {_count(plain.figures['mean_iterations'])}",
                _ms(plain.step_seconds),
                _ms(record.step_seconds),
                f"{gain(record, plain):.2f}",
            )
        return [table]

    def draw(self, records: Sequence[Record], folder: Path, out: Path, footer: str) -> Sequence[Path]:
        """Draw the gain of each scene as bars, a chart for each solver."""
        found = pairs(records)
        charts: list[Path] = []
        with house_style():
            for solver in dict.fromkeys(row.solver for row, _ in found):
                own = [(row, plain) for row, plain in found if row.solver == solver]
                charts += _chart(own, f"{footer}, solver {solver}", out / f"gain-{solver}")
        return charts


def pairs(records: Sequence[Record]) -> list[tuple[Record, Record]]:
    """Return each row of a presolved setting with that of the same scene, case and solver as asked."""
    plain = {(row.scene, row.case, row.solver): row for row in records if row.setting == AS_ASKED and row.measured}
    rows = [row for row in records if row.setting != AS_ASKED and row.measured]
    return [(row, plain[key]) for row in rows if (key := (row.scene, row.case, row.solver)) in plain]


def gain(record: Record, plain: Record) -> float:
    """Return how many times quicker a step became."""
    assert record.step_seconds and plain.step_seconds
    return plain.step_seconds / record.step_seconds


def _chart(found: Sequence[tuple[Record, Record]], footer: str, stem: Path) -> list[Path]:
    bars = [(row, plain) for row, plain in found if (row.case, row.setting) in BARS]
    scenes = list(dict.fromkeys(row.scene for row, _ in bars))
    figure = Figure(figsize=(11.0, 1.6 + 0.62 * len(scenes)), layout=ConstrainedLayoutEngine())
    ax = figure.subplots()
    kinds = [kind for kind in BARS if any((row.case, row.setting) == kind for row, _ in bars)]
    height = 0.8 / len(kinds)
    for row, plain in bars:
        kind = (row.case, row.setting)
        where = scenes.index(row.scene) + (kinds.index(kind) - 0.5 * (len(kinds) - 1)) * height
        value = gain(row, plain)
        # Bars start at 1, where nothing is gained; to its left, something is lost.
        ax.barh(where, value - 1.0, left=1.0, height=0.9 * height, color=BARS[kind][1], label=BARS[kind][0])
        ax.annotate(
            f"{value:.2g}×",
            (max(value, 1.0), where),
            (5, 0),
            textcoords="offset points",
            va="center",
            fontsize=11,
            color=INK,
        )
    ax.axvline(1.0, color=QUIET, linewidth=1.0)
    ax.set_xscale("log")
    ax.margins(x=0.12)
    ax.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}×"))
    ax.xaxis.set_minor_locator(NullLocator())
    ax.set_yticks(range(len(scenes)), [SCENES[name].title for name in scenes])
    ax.invert_yaxis()
    ax.grid(visible=False, axis="y")
    ax.set_xlabel("how many times quicker a whole step is with presolve")
    handles, labels = ax.get_legend_handles_labels()
    entries = dict(zip(labels, handles, strict=True))
    names = [BARS[kind][0] for kind in kinds]
    ax.legend([entries[name] for name in names], names, loc="lower right")
    figure.suptitle("What presolve gains", x=0.01, ha="left", fontsize=17, fontweight="bold")
    figure.text(0.01, -0.02, footer, ha="left", va="top", fontsize=11, color=QUIET)
    return save(figure, stem)


def _count(mean: object) -> str:
    assert isinstance(mean, float)
    return f"{mean:.3g}" if mean < 1000 else f"{mean:.0f}"


def _of(left: object, before: object) -> str:
    return f"{left} of {before}"


def _ms(seconds: float | None) -> str:
    return "" if seconds is None else f"{1e3 * seconds:.3g}"

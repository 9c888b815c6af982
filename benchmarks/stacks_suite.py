"""The suite `stacks` in the table of suites: its arguments, batches, tables and charts."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from rich.table import Table
from rich.text import Text

import gpx_lcp as gpx
from benchmarks import stacks
from benchmarks.arguments import add_effort, add_filters, chosen, positive, tolerance
from benchmarks.asked import add_peers, engines_asked, missing_peers, of_named_peer, wanted
from benchmarks.attempts import COLD, Attempt, Batch
from benchmarks.charts import AXES, speed_accuracy
from benchmarks.engines import ENGINES
from benchmarks.forces import SCENES as PICTURED
from benchmarks.forces import force_chart
from benchmarks.interface import Setting, scientific
from benchmarks.records import Record
from benchmarks.simulating import STEPPED, SceneBatch
from benchmarks.sweep_costs import SCENES as SWEEP_SCENES
from benchmarks.sweep_costs import SWEEP, sweep_batch
from benchmarks.tables import certified_table, missing_notes, rate_table, ratio_table, reach_table, scene_table

REPEATS, QUICK_REPEATS = 3, 2
STEPS, QUICK_STEPS = 240, 20
TIME_LIMIT, QUICK_TIME_LIMIT = 0.7, 0.3

HEADINGS = {
    "cold": "Resting stacks, cold: the first step from touching rest",
    "stepped": "Resting stacks, settled: the last of the warm steps, where time sufficed for them",
    "swinging": "Towers while gravity swings by half of itself, five times a second",
}


class Stacks:
    """The row of the suite in the table."""

    name = stacks.NAME
    summary = "resting stacks, by gpx-lcp and its peers, as simulations"
    not_shown = stacks.NOT_SHOWN

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Add the suite's arguments."""
        add_filters(parser)
        add_peers(parser)
        parser.add_argument(
            "--tolerance",
            action="append",
            type=tolerance,
            metavar="T",
            help="only settings that ask for this tolerance (may be repeated)",
        )
        add_effort(parser, (REPEATS, QUICK_REPEATS), (TIME_LIMIT, QUICK_TIME_LIMIT))
        parser.add_argument(
            "--steps",
            type=positive,
            metavar="N",
            help=f"warm steps after the cold first one ({STEPS}; quick: {QUICK_STEPS})",
        )

    def scenes(self) -> Mapping[str, str]:
        """Return the scenes' titles; those that run only where they are named say so."""
        return {
            name: scene.title if scene.usual else f"{scene.title} (only where it is named)"
            for name, scene in stacks.SCENES.items()
        }

    def batches(self, asked: argparse.Namespace, folder: Path) -> Sequence[Batch]:
        """Return a batch for each scene, then those of the cost of a sweep."""
        names = (
            chosen(stacks.SCENES, asked.scene)
            if asked.scene
            else list(stacks.QUICK_SCENES if asked.quick else stacks.USUAL_SCENES)
        )
        installed = engines_asked(asked)
        settings = _of_tolerance(asked, [each for name in installed for each in ENGINES[name].settings(asked.quick)])
        settings = wanted(asked, settings)
        if not settings:
            return []
        batches: list[Batch] = [_scene_batch(name, settings, asked) for name in names]
        if not asked.quick:
            lines = list(dict.fromkeys(setting.line for setting in settings))
            batches += [sweep_batch(name, installed, lines) for name in SWEEP_SCENES if name in names]
        return [batch for batch in batches if batch.attempts]

    def batch_tables(self, records: Sequence[Record]) -> Sequence[Table]:
        """Return the table of a scene."""
        shown = [record for record in records if record.case in (COLD, STEPPED)]
        return [scene_table(stacks.SCENES[shown[0].scene].title, shown)] if shown else []

    def tables(self, records: Sequence[Record], folder: Path) -> Sequence[Table | Text]:
        """Return what was reached how fast, by whom."""
        charted = _titles(records, lambda scene: scene.charted)
        at_rest = _titles(records, lambda scene: scene.at_rest)
        large = _titles(records, lambda scene: scene.large)
        sweeps = [record for record in records if record.case == SWEEP and record.measured]
        tables = [
            *([reach_table(charted, records)] if charted else []),
            *([ratio_table(at_rest, records)] if at_rest else []),
            *([certified_table(large, records)] if large else []),
            *([rate_table(sweeps)] if sweeps else []),
        ]
        return [*tables, *missing_notes(records)]

    def draw(self, records: Sequence[Record], folder: Path, out: Path, footer: str) -> Sequence[Path]:
        """Draw speed against accuracy, for each case."""
        charted = _titles(records, lambda scene: scene.charted)
        swinging = _titles(records, lambda scene: scene.swings)
        footer = f"{footer}, dt = 1/240 s, sleeping off"
        measured = {record.scene for record in records if record.measured}
        pictured = tuple(name for name in PICTURED if name in measured)
        forces = force_chart(pictured, footer, out / "forces") if pictured else []
        return forces + [
            path
            for name, axis in AXES.items()
            for path in speed_accuracy(
                records,
                axis,
                swinging if name == "swinging" else charted,
                HEADINGS[name],
                footer,
                out / f"speed-accuracy-{name}",
            )
        ]


def _of_tolerance(asked: argparse.Namespace, settings: Sequence[Setting]) -> Sequence[Setting]:
    """Return the settings that ask for a tolerance that is asked for, and those of peers that are named.

    Raises
    ------
    SettingsError
        When none asks for one of them.
    """
    if asked.tolerance is None:
        return settings
    known = sorted({bound for setting in settings if (bound := setting.options.get("tolerance"))})
    for bound in asked.tolerance:
        if bound not in known:
            raise gpx.SettingsError(
                f"--tolerance is {scientific(bound)}: no setting asks for it; there are "
                f"{', '.join(map(scientific, known))}"
            )
    return [
        setting
        for setting in settings
        if of_named_peer(asked, setting) or setting.options.get("tolerance") in asked.tolerance
    ]


def _scene_batch(name: str, settings: Sequence[Setting], asked: argparse.Namespace) -> SceneBatch:
    """Return the batch of a scene."""
    scene = stacks.SCENES[name]
    run = [(_attempt(name, setting), setting) for setting in settings if scene.wants(setting)]
    gone = missing_peers(asked, stacks.NAME, name)
    limit = asked.time_limit or (QUICK_TIME_LIMIT if asked.quick else TIME_LIMIT)
    return SceneBatch(
        name=name,
        attempts=[*(attempt for attempt, _ in run), *gone],
        settings={attempt.key: setting for attempt, setting in run},
        repeats=asked.repeats or (QUICK_REPEATS if asked.quick else REPEATS),
        steps=asked.steps or (QUICK_STEPS if asked.quick else STEPS),
        time_limit=limit * scene.patience,
    )


def _attempt(scene: str, setting: Setting) -> Attempt:
    return Attempt(
        suite=stacks.NAME,
        scene=scene,
        solver=setting.solver,
        formulation=setting.formulation,
        setting=setting.label,
        effort=setting.effort,
        tolerance=setting.options.get("tolerance"),
        engine=setting.engine,
        engine_version=ENGINES[setting.engine].version(),
    )


def _titles(records: Sequence[Record], wanted: Callable[[stacks.StackScene], bool]) -> dict[str, str]:
    """Return the titles of the measured scenes that are of a kind, by name."""
    there = {record.scene for record in records}
    return {name: scene.title for name, scene in stacks.SCENES.items() if name in there and wanted(scene)}

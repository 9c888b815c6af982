"""The suite `stability` in the table of suites: its arguments, batches, tables and its map."""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path

from rich.table import Table
from rich.text import Text

from benchmarks.arguments import add_filters, chosen, seconds
from benchmarks.asked import add_peers, engines_asked, missing_peers, wanted
from benchmarks.attempts import Attempt
from benchmarks.engines import ENGINES
from benchmarks.interface import Setting
from benchmarks.records import Record
from benchmarks.stability import contestants
from benchmarks.stability.breaks import Break, breaks
from benchmarks.stability.climbing import SILENT, ModeBatch
from benchmarks.stability.map import SYMBOLS, draw_map
from benchmarks.stability.table import MODES, QUICK
from benchmarks.tables import missing_notes, new_table

NAME = "stability"
RUNG_LIMIT, QUICK_RUNG_LIMIT = 0.5, 0.2


class Stability:
    """The row of the suite in the table."""

    name = NAME
    summary = "where each solver breaks, and how: one ladder for each known failure mode"
    not_shown = (
        "What this does not show: how fast anybody is (suites stacks, fclib), and what lies between two rungs. A "
        "ladder ends at its last rung, and who stands there may break beyond. Peers have soft contacts, or laws of "
        "their own, and are held to the same rigid truth: 'wrong silently' says that the truth is missed by more than "
        "the rule allows and nothing reports it, not that the engine has a bug; games never ask for more. Their "
        "settings are the most careful of those in the suite stacks, which costs them time. What only a stacked system "
        "can show is not asked of peers, and scenes that their adapters cannot rebuild are left out. Where a peer "
        "poses another law, nobody has checked that it solves that one. Time limits make 'too slow' a matter of the "
        "machine."
    )

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Add the suite's arguments."""
        add_filters(parser)
        add_peers(parser)
        parser.add_argument(
            "--time-limit", type=seconds, metavar="S", help=f"of a rung ({RUNG_LIMIT:g}; quick: {QUICK_RUNG_LIMIT:g})"
        )

    def scenes(self) -> Mapping[str, str]:
        """Return the failure modes."""
        return {name: f"{mode.code}: {mode.title}, {mode.knob}" for name, mode in MODES.items()}

    def batches(self, asked: argparse.Namespace, folder: Path) -> Sequence[ModeBatch]:
        """Return a batch for each failure mode."""
        names = QUICK if asked.quick and asked.scene is None else chosen(MODES, asked.scene)
        batches = [_batch(name, asked) for name in names]
        return [batch for batch in batches if batch.attempts]

    def batch_tables(self, records: Sequence[Record]) -> Sequence[Table]:
        """Return the table of a failure mode."""
        return [_mode_table(records[0].scene, breaks(records))] if records else []

    def tables(self, records: Sequence[Record], folder: Path) -> Sequence[Table | Text]:
        """Return how often each solver broke in which way."""
        table = new_table("How often each stands to the end of its ladders, and how it breaks")
        table.add_column("engine, solver, program", overflow="fold")
        for outcome, symbol in SYMBOLS.items():
            table.add_column(f"{symbol} {outcome}", justify="right")
        counts: dict[str, Counter[str]] = {}
        for found in breaks(records):
            counts.setdefault(found.who, Counter())[found.outcome] += 1
        for who, counted in counts.items():
            cells = [Text(str(counted[name] or ""), "bold red" if name == SILENT else "") for name in SYMBOLS]
            table.add_row(who, *cells)
        return [table, *missing_notes(records)]

    def draw(self, records: Sequence[Record], folder: Path, out: Path, footer: str) -> Sequence[Path]:
        """Draw the map."""
        found = breaks(records)
        return draw_map(found, footer, out / "map") if found else []


def _batch(name: str, asked: argparse.Namespace) -> ModeBatch:
    mode = MODES[name]
    run: list[tuple[Attempt, Setting | None]] = [
        (_attempt(name, setting), setting)
        for setting in wanted(asked, contestants.settings(mode, engines_asked(asked)))
    ]
    if run and asked.solver is None and asked.formulation is None:
        run += [(attempt, None) for attempt in missing_peers(asked, NAME, name)]
    return ModeBatch(
        name,
        [attempt for attempt, _ in run],
        [setting for _, setting in run],
        asked.time_limit or (QUICK_RUNG_LIMIT if asked.quick else RUNG_LIMIT),
        stride=2 if asked.quick else 1,
    )


def _attempt(name: str, setting: Setting) -> Attempt:
    own = setting.options.get("tolerance") if setting.label == "" else None
    return Attempt(
        suite=NAME,
        scene=name,
        solver=setting.solver,
        formulation=setting.formulation,
        setting=setting.label,
        effort=setting.effort,
        tolerance=own,
        engine=setting.engine,
        engine_version=ENGINES[setting.engine].version(),
    )


def _mode_table(name: str, found: Sequence[Break]) -> Table:
    mode = MODES[name]
    table = new_table(f"{mode.code} {mode.title}: {mode.truth}. Stands: {mode.rule}")
    table.add_column("engine, solver, program", overflow="fold")
    table.add_column(f"stands up to ({mode.knob})", justify="right")
    table.add_column("breaks at", justify="right")
    table.add_column("how")
    table.add_column("error / allowed", justify="right")
    for one in found:
        style = "bold red" if one.outcome == SILENT else ""
        error = "" if one.error is None else f"{one.error:.2g}"
        table.add_row(one.who, one.stands, one.rung, Text(one.outcome, style), error)
    return table

"""`run SUITE`: measures what is asked for, or what an interrupted run has left, and shows, writes and draws it."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from rich.console import Console
from rich.text import Text

import gpx_lcp as gpx
from benchmarks import exit_codes, machine, store
from benchmarks.attempts import Attempt, Batch, Suite
from benchmarks.cluster import measure_on
from benchmarks.engines import ENGINES
from benchmarks.interrupts import remembered
from benchmarks.measuring import Measured, measure, not_measured
from benchmarks.pages import Pages
from benchmarks.records import Record


@dataclass
class Run:
    """A run as it goes on."""

    suite: Suite
    folder: store.Folder
    pages: Pages
    interrupted: bool = False

    def keep(self, batch: Batch, measured: Measured) -> None:
        """Store what a batch gave, and show it."""
        self.interrupted |= measured.interrupted
        records = self.folder.keep(batch.name, measured)
        for table in self.suite.batch_tables(records):
            self.pages.show(table)


def run(suite: Suite, asked: argparse.Namespace, arguments: Sequence[str], console: Console) -> int:
    """Run a suite.

    Parameters
    ----------
    asked : Namespace
        The arguments as understood; with `resume`, those of the run that is gone on with.
    arguments : sequence of str
        The arguments as given, kept for --resume.

    Raises
    ------
    SettingsError
        When they name what is not there.
    """
    path: Path = asked.out / suite.name
    store.make_folder(path)
    _require_names(suite, asked, path)
    wanted = suite.batches(asked, path)
    if not wanted:
        console.print("[red]nothing to run:[/] no solver that is installed solves such a formulation; see `list`.")
        return exit_codes.REFUSED
    known = store.read(path) if asked.resume and (path / store.ROWS).exists() else []
    if not asked.resume and (gone := store.clear(path)):
        console.print(f"[yellow]{gone} rows that were in {path} give way to new ones[/]", soft_wrap=True)
    keys = {attempt.key for batch in wanted for attempt in batch.attempts}
    # An unfinished row that nobody wants is that of a peer which is there by now.
    known = [record for record in known if record.finished or record.attempt_key in keys]
    state = Run(suite, store.Folder(path, known), Pages(console))
    if not asked.resume:
        store.write_asked(path, {"arguments": list(arguments)})
    missing = _missing(wanted, known)
    if asked.resume:
        left, total = (sum(len(batch.attempts) for batch in batches) for batches in (missing, wanted))
        console.print(f"{total - left} of {total} attempts are there; {left} are left")
    _measure(state, missing, asked.scheduler)
    records = state.folder.records
    footer = version_line(records)
    shown = [*suite.tables(records, path), Text(footer, style="dim"), Text(suite.not_shown, style="dim")]
    for what in shown:
        state.pages.show(what)
    state.pages.write(path / "tables.txt")
    written = [path / store.ROWS, path / store.CSV, path / "tables.txt", *suite.draw(records, path, path, footer)]
    console.print("written: " + ", ".join(map(str, written)), soft_wrap=True)
    if state.interrupted:
        console.print("[yellow]stopped by Ctrl-C: rows that were not measured say so, and --resume measures them.[/]")
        return exit_codes.INTERRUPTED
    return exit_codes.FAILED if any(record.failed for record in records) else exit_codes.OK


def _require_names(suite: Suite, asked: argparse.Namespace, path: Path) -> None:
    """See that each --solver and --formulation is that of an attempt, or of a peer that is missing.

    Raises
    ------
    SettingsError
        When there is none of that name.
    BackendMissing
        When the solver is known, and not installed.
    """
    filters = {name: given for name in ("solver", "formulation") if (given := getattr(asked, name, None))}

    def attempts(only: Mapping[str, Sequence[str] | None]) -> list[Attempt]:
        batches = suite.batches(argparse.Namespace(**{**vars(asked), **only}), path)
        return [attempt for batch in batches for attempt in batch.attempts]

    solvers, unfiltered = gpx.solvers(), dict.fromkeys(filters)
    gone = [setting for engine in ENGINES.values() if not engine.version() for setting in engine.settings(False)]
    for option, given in filters.items():
        for name in given:
            # With the other filter, which may bring a solver in, or without it, which may be what is wrong.
            if attempts({option: [name]}) or attempts({**unfiltered, option: [name]}):
                continue
            if any(getattr(setting, option) == name for setting in gone):
                continue
            if option == "solver" and name in solvers and not solvers[name].installed:
                raise gpx.BackendMissing(f"{name} is not installed: {solvers[name].install}")
            known = dict.fromkeys(getattr(attempt, option) for attempt in attempts(unfiltered))
            raise gpx.SettingsError(
                f"--{option} is {name}: nothing to run here has that name; there are {', '.join(filter(None, known))}"
            )


def _missing(wanted: Sequence[Batch], known: Sequence[Record]) -> list[Batch]:
    """Return the batches without the attempts whose rows are all there."""
    finished: dict[tuple[str, ...], bool] = {}
    for record in known:
        finished[record.attempt_key] = finished.get(record.attempt_key, True) and record.finished
    left = [
        (batch, [attempt for attempt in batch.attempts if not finished.get(attempt.key, False)]) for batch in wanted
    ]
    return [batch.only(attempts) for batch, attempts in left if attempts]


def _measure(state: Run, batches: Sequence[Batch], scheduler: str | None) -> None:
    """Measure batch by batch, each stored as it is done; Ctrl-C ends it early, and the rest is listed as left out."""
    left = {id(batch): batch for batch in batches}
    total = sum(len(batch.attempts) * batch.repeats for batch in batches)
    with remembered() as require_no_interrupt, state.pages.progress(total) as advance_bar:

        def advance(text: str) -> None:
            require_no_interrupt()
            advance_bar(text)

        try:
            shared = bool(scheduler and batches)
            for batch, measured in measure_on(scheduler, batches, advance) if shared else _here(batches, advance):
                state.keep(batch, measured)
                del left[id(batch)]
                if measured.interrupted:
                    break
        except KeyboardInterrupt:  # between two batches, or while a cluster measures them
            state.interrupted = True
    state.folder.add(record for batch in left.values() for record in not_measured(batch))


def _here(batches: Sequence[Batch], advance: Callable[[str], None]) -> Iterator[tuple[Batch, Measured]]:
    """Measure one batch after the other in this process."""
    return ((batch, measure(batch, advance)) for batch in batches)


def version_line(records: Sequence[Record]) -> str:
    """Return versions, processor, hosts and peers of the rows in one line."""
    known = [record.where for record in records if record.where]
    hosts = list(dict.fromkeys(where["host"] for where in known))
    engines = dict.fromkeys(f"{record.engine} {record.engine_version}" for record in records if record.engine_version)
    more = [engine for engine in engines if not engine.startswith("gpx-lcp ")]
    return machine.version_line(known[0], *more, *([f"{len(hosts)} hosts"] if len(hosts) > 1 else []))

"""The suite `impacts`: every impact law on every case, and the page about them."""

from __future__ import annotations

import argparse
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from rich.table import Table
from rich.text import Text

import gpx_lcp as gpx
from benchmarks import machine
from benchmarks.arguments import chosen
from benchmarks.attempts import COLD, Answer, Attempt, Outcome
from benchmarks.impacts.cases import CASES
from benchmarks.records import Record
from benchmarks.tables import new_table

NAME = "impacts"
PAGE = "impact-laws.md"


@dataclass(frozen=True)
class CaseBatch:
    """One case by several laws."""

    name: str
    attempts: Sequence[Attempt]
    repeats: int = 1
    time_limit: float = 60.0
    cases: Sequence[str] = (COLD,)

    def open(self) -> CaseBatch:
        """Return itself: a case makes its own scenes."""
        return self

    def only(self, attempts: Sequence[Attempt]) -> CaseBatch:
        """Return the batch with these of its attempts."""
        return replace(self, attempts=attempts)

    def try_once(self, attempt: Attempt, first: bool, seconds_left: float) -> Sequence[Outcome]:
        """Run the case by the attempt's law."""
        start = time.perf_counter()
        found = CASES[attempt.scene].run(attempt.solver)
        seconds = time.perf_counter() - start
        impact = found.impact
        return (
            Outcome(
                step_seconds=(seconds,),
                status="solved" if found.unsolved == 0 else f"{found.unsolved} unsolved",
                method="" if impact is None else impact.method,
                contacts=None if impact is None else impact.system.contacts,
                certificate=None if impact is None else impact.certificate,
                reached=found.right,
                answer=None if impact is None else Answer(impact.system, impact.impulse),
                figures={"shown": found.shown, "unsolved": found.unsolved, **found.figures},
            ),
        )


class Impacts:
    """The row of the suite in the table."""

    name = NAME
    summary = "impact laws on collisions whose answers or balances are known"
    not_shown = (
        "What this does not show: which law is nearest to real bodies, which only experiments could tell; impacts that "
        "last (soft bodies, waves within them); large scenes, where one program (newton) costs far less than many. "
        "Right and wrong are said of the case, not of the law: a law is wrong here where it does not promise what the "
        "case asks for."
    )

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Add the suite's arguments."""
        parser.add_argument(
            "--scene", action="append", metavar="NAME", help="only this case; * and ? are wildcards (may be repeated)"
        )
        parser.add_argument("--law", action="append", choices=list(gpx.LAWS), help="only this law (may be repeated)")

    def scenes(self) -> Mapping[str, str]:
        """Return the cases."""
        return {name: case.title for name, case in CASES.items()}

    def batches(self, asked: argparse.Namespace, folder: Path) -> Sequence[CaseBatch]:
        """Return a batch for each case."""
        laws = [name for name in gpx.LAWS if asked.law is None or name in asked.law]
        return [
            CaseBatch(name, [Attempt(NAME, name, law, "impact") for law in laws]) for name in chosen(CASES, asked.scene)
        ]

    def batch_tables(self, records: Sequence[Record]) -> Sequence[Table]:
        """Return nothing: a case is one line of the table at the end."""
        return ()

    def tables(self, records: Sequence[Record], folder: Path) -> Sequence[Table | Text]:
        """Return the table of cases and laws."""
        laws = _laws(records)
        table = new_table("What each impact law makes of it")
        for column in ("case", "known", *laws):
            table.add_column(column, overflow="fold")
        for name, row in _by_case(records).items():
            cells = [Text(_cell(row.get(law)), _colour(row.get(law))) for law in laws]
            table.add_row(CASES[name].title, CASES[name].known, *cells)
        return [table]

    def draw(self, records: Sequence[Record], folder: Path, out: Path, footer: str) -> Sequence[Path]:
        """Write the page: what the laws promise, and the table."""
        path = out / PAGE
        path.write_text(page(records, self.not_shown), encoding="utf-8")
        return [path]


def page(records: Sequence[Record], not_shown: str) -> str:
    """Return the page about the laws in Markdown."""
    laws = _laws(records)
    lines = [
        "# Impact laws",
        "",
        "`python -m benchmarks run impacts` writes this page to `results/impacts/impact-laws.md`. Use of a law:",
        "",
        "```python",
        "import gpx_lcp as gpx",
        "",
        'outcome = gpx.impact(gpx.scenes.cradle(5), "sequential")  # or a StackedSystem with B = -J v',
        "print(outcome.velocities[:, 0], outcome.method, outcome.energy_change)",
        "",
        'world = gpx.World(gpx.scenes.superball(), 1 / 240, impact_law="energy_safe")',
        "world.step()",
        "print(world.velocities, world.solution.method)",
        "```",
        "",
        "Elasticity is each body's: `gpx.Material(elasticity=..., tangential_elasticity=...)`, 1 plastic, 2 elastic.",
        "It acts in contacts that close faster than `impact_speed`, 2 g dt in a world unless given.",
        "",
        "| law | what it is | promises | does not promise |",
        "|--|--|--|--|",
    ]
    for law in (gpx.LAWS[name] for name in laws):
        lines.append(f"| `{law.name}` | {law.summary} | {law.promises} | {law.breaks} |")
    lines += [
        "",
        "What each makes of collisions whose outcome or balance is known; ✗ marks what differs from it, and (n) counts",
        "collisions or steps whose programs were not all solved to the tolerance:",
        "",
        "| case | known | " + " | ".join(f"`{law}`" for law in laws) + " |",
        "|--|--|" + "--|" * len(laws),
    ]
    for name, row in _by_case(records).items():
        cells = " | ".join(_cell(row.get(law)) for law in laws)
        lines.append(f"| {CASES[name].title} | {CASES[name].known} | {cells} |")
    lines += ["", not_shown, "", machine.version_line(records[0].where), ""]
    return "\n".join(lines)


def _laws(records: Sequence[Record]) -> list[str]:
    run = {record.solver for record in records}
    return [name for name in gpx.LAWS if name in run]


def _by_case(records: Sequence[Record]) -> dict[str, dict[str, Record]]:
    rows: dict[str, dict[str, Record]] = {}
    known = [record for record in records if record.scene in CASES]
    for record in sorted(known, key=lambda record: list(CASES).index(record.scene)):
        rows.setdefault(record.scene, {})[record.solver] = record
    return rows


def _cell(record: Record | None) -> str:
    if record is None or "shown" not in record.figures:
        return "" if record is None else record.status
    unsolved = int(record.figures.get("unsolved") or 0)
    return f"{'' if record.reached else '✗ '}{record.figures['shown']}{f' ({unsolved})' if unsolved else ''}"


def _colour(record: Record | None) -> str:
    return "" if record is None or record.reached else "red"

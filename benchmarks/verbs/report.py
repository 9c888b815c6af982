"""`report FOLDER…`: one self-contained HTML page of stored rows, and a Markdown twin."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console
from rich.table import Table

from benchmarks import exit_codes, store
from benchmarks.attempts import Suite
from benchmarks.page import Grid, Part, Picture, Section, as_html, as_markdown, grid
from benchmarks.records import Record
from benchmarks.suites import SUITES
from benchmarks.verbs.plot import by_suite
from benchmarks.verbs.run import version_line

TITLE = "Contact solvers compared"

HOW = (
    "Every row is an attempt: one scene, one engine, one solver with one setting, from nothing (cold) or as the steps "
    "of a simulation. Times are wall time from outside, of one call; repeats are interleaved, the median is stated, "
    "and the range of the repeats is in the rows. Success is judged from outside, by the same certificate against the "
    "exact Coulomb law and by what is known on paper; no solver is asked. Failures are rows, too. Every statement can "
    "be checked from the stored impulses: python -m benchmarks check FOLDER."
)

# Columns that say where rows were measured, worth a line of the report.
WHERE = (
    "cpu",
    "cores",
    "system",
    "python",
    "numpy",
    "scipy",
    "gpx_lcp",
    "build_profile",
    "revision",
    "threads",
    "host",
)


def report(folders: Sequence[Path], out: Path, console: Console) -> int:
    """Write report.html and report.md to `out`.

    Raises
    ------
    SettingsError
        When a folder holds no results.
    """
    found = by_suite(folders)
    every = [record for _, records in found.values() for record in records]
    sections = [Section("How this was measured", [HOW, _where(every), _engines(every)])]
    ends: list[Part] = []
    for name, (folder, records) in found.items():
        suite = SUITES[name]
        pictures = out / "pictures" / name
        store.make_folder(pictures)
        sections.append(_section(suite, records, folder, pictures))
        ends.append(f"{name}. {suite.not_shown.removeprefix('What this does not show: ')}")
    sections.append(Section("What this does not show", ends))
    (out / "report.html").write_text(as_html(TITLE, sections), encoding="utf-8")
    (out / "report.md").write_text(as_markdown(TITLE, sections, out), encoding="utf-8")
    console.print(f"written: {out / 'report.html'}, {out / 'report.md'}", soft_wrap=True)
    return exit_codes.OK


def _section(suite: Suite, records: Sequence[Record], folder: Path, pictures: Path) -> Section:
    statuses = Counter(record.status for record in records)
    counted = ", ".join(f"{count} {status}" for status, count in statuses.most_common())
    section = Section(f"{suite.name}: {suite.summary}", [f"{len(records)} rows: {counted}."])
    drawn = suite.draw(records, folder, pictures, version_line(records))
    section.parts += [Picture(path, _words(path)) for path in drawn if path.suffix == ".png"]
    for part in suite.tables(records, folder):
        section.parts.append(grid(part) if isinstance(part, Table) else part.plain)
    section.parts.append(_rows(records))
    return section


def _words(path: Path) -> str:
    return path.stem.replace("-", " ")


def _where(records: Sequence[Record]) -> Grid:
    """Return where and with what the rows were measured; several values where they differ."""
    rows = [(name, ", ".join(dict.fromkeys(record.where.get(name, "") for record in records))) for name in WHERE]
    return Grid("Where, and with what", ("", "value"), rows, (False, False))


def _engines(records: Sequence[Record]) -> Grid:
    lines: dict[str, tuple[str, dict[str, None]]] = {}
    for record in records:
        version = record.engine_version or f"missing: {record.message}"
        lines.setdefault(record.engine, (version, {}))[1][f"{record.solver} {record.formulation}".strip()] = None
    rows = [(name, version, ", ".join(filter(None, solvers))) for name, (version, solvers) in lines.items()]
    return Grid("Engines", ("engine", "version", "solver and program"), rows, (False, False, False))


def _rows(records: Sequence[Record]) -> Grid:
    header = ("scene", "engine", "solver", "program", "setting", "case", "status", "ms", "natural map", "reached")
    rows = [
        (
            record.scene,
            record.engine,
            record.solver,
            record.formulation,
            record.setting,
            record.case,
            record.status,
            "" if record.step_ms is None else f"{record.step_ms:.4g}",
            "" if record.natural_map is None else f"{record.natural_map:.1e}",
            "" if record.reached is None else "yes" if record.reached else "no",
        )
        for record in records
    ]
    right = tuple(name in ("ms", "natural map") for name in header)
    return Grid(f"Every row ({len(rows)})", header, rows, right, folded=True)

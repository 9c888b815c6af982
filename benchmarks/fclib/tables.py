"""The tables of the suite: each problem, each solver, and the ratio to the external baseline."""

from __future__ import annotations

from collections.abc import Sequence
from math import isfinite

from rich.table import Table
from rich.text import Text

from benchmarks.attempts import ERROR, REFUSED, UNREADABLE
from benchmarks.fclib.batches import Line
from benchmarks.fclib.profiles import shifted_mean
from benchmarks.fclib.scores import LARGE, Scores, Subject, against_baseline, line_of, name_of
from benchmarks.interface import scientific
from benchmarks.records import Record
from benchmarks.tables import new_table

# Added to every time before the geometric mean, s: what a call costs anyway should not decide.
SHIFT = 1e-4


def problem_table(scores: Scores) -> Table:
    """Return a line per problem at the reference tolerance: its size, who was fastest, and how good the answer is."""
    tolerance = scores.reference
    table = new_table(f"Each problem at {scientific(tolerance)}: the fastest solver whose certificate holds it")
    table.add_column("problem", overflow="fold")
    for column in ("contacts", "rows/rank", "fastest", "solve ms", "set-up ms", "natural map"):
        table.add_column(column, justify="left" if column == "fastest" else "right", no_wrap=True)
    if scores.baseline:
        table.add_column("peer ms", justify="right")
        table.add_column("ratio", justify="right")
    for subject in scores.subjects:
        best = scores.fastest(subject.name, tolerance)
        shown = best or scores.nearest(subject.name, tolerance)
        cells: list[str | Text] = [
            subject.name,
            f"{subject.contacts}{' (2-D)' if subject.dimension == 2 else ''}",
            "" if subject.rank_ratio is None else f"{subject.rank_ratio:.2f}",
            Text(line_of(best).label)
            if best
            else Text(f"none (nearest {line_of(shown).label})" if shown else "none", "red"),
            _ms(best.solve_seconds if best else None),
            _ms(best.setup_seconds if best else None),
            "" if shown is None or shown.natural_map is None else f"{shown.natural_map:.1e}",
        ]
        if scores.baseline:
            cells += _peer_cells(scores, subject, best)
        table.add_row(*cells)
    return table


def _peer_cells(scores: Scores, subject: Subject, best: Record | None) -> list[str]:
    peer = scores.peer(subject.name, scores.reference)
    if peer is None:
        return ["", ""]
    if not isfinite(peer):
        return ["unsolved", ""]
    return [_ms(peer), _ratio(best.solve_seconds / peer) if best and best.solve_seconds and peer else ""]


def solver_table(scores: Scores) -> Table:
    """Return, for each solver and tolerance, the share of problems solved and the mean time."""
    table = new_table(
        f"Each solver, {len(scores.subjects)} problems: share solved, and shifted geometric mean of solve times, ms "
        f"(shift {1e3 * SHIFT:g} ms; a failure is charged the time limit)"
    )
    table.add_column("solver")
    for tolerance in scores.tolerances:
        table.add_column(scientific(tolerance), justify="right")
        table.add_column("ms", justify="right")
    names = [subject.name for subject in scores.subjects]
    rows: list[tuple[str, Line | None]] = [(line.label, line) for line in scores.lines]
    if len(rows) > 1:
        rows.append(("fastest of each problem", None))
    for label, line in rows:
        cells = []
        for tolerance in scores.tolerances:
            group = [line] if line else scores.lines
            times = [min(scores.seconds(name, x, tolerance) for x in group) for name in names]
            cells += _share(times, scores.time_limit)
        table.add_row(label, *cells)
    if scores.baseline:
        cells = []
        for tolerance in scores.tolerances:
            peers = [peer for name in names if (peer := scores.peer(name, tolerance)) is not None]
            cells += [_count(sum(map(isfinite, peers)), len(peers)) or "not measured", ""]
        table.add_section()
        table.add_row(f"{scores.baseline.name}: best of each problem", *cells)
    return table


def _share(times: Sequence[float], limit: float) -> list[str]:
    if not times:
        return ["", ""]
    charged = [min(seconds, limit) for seconds in times]
    return [_count(sum(map(isfinite, times)), len(times)), _ms(shifted_mean(charged, SHIFT))]


def _count(solved: int, problems: int) -> str:
    return f"{solved}/{problems} {100 * solved / problems:.0f} %" if problems else ""


def ratio_table(scores: Scores) -> Table | None:
    """Return our time / the baseline's best, by family, at the reference tolerance; None without such problems."""
    assert scores.baseline is not None
    tolerance = scores.reference
    large = [subject for subject in scores.subjects if subject.contacts >= LARGE]
    known = [subject for subject in large if isfinite(scores.peer(subject.name, tolerance) or float("inf"))]
    if not known:
        return None
    table = new_table(
        f"Solve time / best solver of {scores.baseline.name} on each problem, at {scientific(tolerance)}, problems of "
        f"{LARGE} contacts or more: geometric mean; (solved of tried) where we missed one, charged the time limit"
    )
    table.add_column("family")
    table.add_column("problems", justify="right")
    for line in scores.lines:
        table.add_column(line.label, justify="right")
    table.add_column("fastest of each", justify="right")
    groups: list[tuple[str, list[Subject], bool]] = [
        (family, [subject for subject in known if subject.family == family], False) for family in scores.families()
    ]
    groups = [group for group in groups if group[1]]
    for title, subjects, setup in [*groups, ("all", known, False), ("all, set-up counted", known, True)]:
        if title == "all":
            table.add_section()
        cells = []
        for who in [*scores.lines, None]:
            found = against_baseline(scores, who, subjects, tolerance, setup)
            missed = f" ({found.solved} of {found.problems})" if found.solved < found.problems else ""
            cells.append("" if found.ratio is None else f"{_ratio(found.ratio)}{missed}")
        table.add_row(title, str(len(subjects)), *cells)
    return table


def remarks(records: Sequence[Record]) -> list[str]:
    """Return a sentence for each file that cannot be read and each kind of error or refusal."""
    unreadable = {name_of(r): r.message for r in records if r.status == UNREADABLE}
    found = [f"{name} cannot be read: {message}" for name, message in unreadable.items()]
    kinds: dict[tuple[str, str, str], dict[str, None]] = {}
    for record in records:
        if record.status in (ERROR, REFUSED):
            kind = (line_of(record).label, record.status, record.message)
            kinds.setdefault(kind, {})[name_of(record)] = None
    for (label, status, message), where in kinds.items():
        more = f" and {len(where) - 1} more" if len(where) > 1 else ""
        found.append(f"{label}: {status} on {next(iter(where))}{more}: {message}")
    return found


def _ratio(value: float) -> str:
    return f"{value:.2g}" if value < 10.0 else f"{value:.0f}"


def _ms(seconds: float | None) -> str:
    return "" if seconds is None else f"{1e3 * seconds:.3g}"

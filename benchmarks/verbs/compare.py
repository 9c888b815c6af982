"""`compare A B`: what got faster, slower, better or worse from one folder of results to another.

Times count as different only where the slowest repeat of one is faster than the fastest of the other: the spread of the
repeats is the noise. Errors count as different from a factor of 2 on, above rounding, or where a tolerance was reached
in one and missed in the other.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from rich.console import Console
from rich.table import Table
from rich.text import Text

from benchmarks import exit_codes, store
from benchmarks.records import Record
from benchmarks.tables import new_table

# Below this no error is told from another.
ROUNDING = 1e-12
FACTOR = 2.0

# So many of the changes are listed, largest first.
LISTED = 30


@dataclass(frozen=True)
class Change:
    """A row in both folders.

    Parameters
    ----------
    ratio : float or None
        Time of B over that of A, medians; None where one was not measured.
    speed : str
        "faster", "slower", "within noise", or "no spread": from a single timed trial nothing can be said.
    quality : str
        "better", "worse" or "same".
    why : str
        What changed in quality.
    """

    before: Record
    after: Record
    ratio: float | None
    speed: str
    quality: str
    why: str

    @property
    def size(self) -> float:
        """For sorting: how far the time has moved; a change of quality comes first."""
        return math.inf if self.quality != "same" else abs(math.log(self.ratio)) if self.ratio else 0.0


def compare(first: Path, second: Path, console: Console) -> int:
    """Print what changed, and return FAILED where anything got slower or worse.

    Raises
    ------
    SettingsError
        When a folder holds no results.
    """
    before, after = ({row.key: row for row in store.read(folder)} for folder in (first, second))
    changes = [change(row, after[key]) for key, row in before.items() if key in after]
    console.print(_counts(changes))
    listed = sorted(
        (c for c in changes if c.speed in ("faster", "slower") or c.quality != "same"), key=lambda c: -c.size
    )
    if listed:
        console.print(_listing(listed[:LISTED]))
        if len(listed) > LISTED:
            console.print(f"and {len(listed) - LISTED} more")
    for folder, rows, others in ((first, before, after), (second, after, before)):
        alone = len(rows.keys() - others.keys())
        if alone:
            console.print(f"{alone} rows are only in {folder}")
    console.print(
        Text(
            "Faster and slower: the ranges of the repeats do not overlap. Better and worse: a tolerance reached or "
            f"missed, or errors that differ by {FACTOR:g} or more.",
            style="dim",
        )
    )
    bad = any(c.speed == "slower" or c.quality == "worse" for c in changes)
    return exit_codes.FAILED if bad else exit_codes.OK


def change(before: Record, after: Record) -> Change:
    """Compare two rows of the same key."""
    (a, a_range), (b, b_range) = _time(before), _time(after)
    ratio = b / a if a and b else None
    speed = ""
    if a_range and b_range:
        # The first of several trials is not timed, so that three give a spread.
        if min(before.repeats, after.repeats) < 3:
            speed = "no spread"
        elif b_range[1] < a_range[0]:
            speed = "faster"
        elif b_range[0] > a_range[1]:
            speed = "slower"
        else:
            speed = "within noise"
    quality, why = _quality(before, after)
    return Change(before, after, ratio, speed, quality, why)


def _time(record: Record) -> tuple[float | None, tuple[float, float] | None]:
    """Return the median and the range of the repeats: of solving where the solver tells, else of the whole call."""
    for name in ("solve_seconds", "step_seconds"):
        middle, low, high = (getattr(record, f"{name}{end}") for end in ("", "_low", "_high"))
        if middle is not None:
            return middle, (low, high)
    return None, None


def _quality(before: Record, after: Record) -> tuple[str, str]:
    if before.failed != after.failed:
        return ("worse" if after.failed else "better"), f"{before.status} → {after.status}"
    if before.reached is not None and after.reached is not None and before.reached != after.reached:
        return ("better", "reaches its tolerance") if after.reached else ("worse", "misses its tolerance")
    old, new = before.natural_map, after.natural_map
    if old is None or new is None:
        return "same", ""
    # Both reach what was asked: how far below does not matter.
    if before.reached and after.reached:
        return "same", ""
    # Written without a quotient, so that infinite errors compare.
    if max(old, ROUNDING) > FACTOR * max(new, ROUNDING):
        return "better", f"natural map {old:.1e} → {new:.1e}"
    if max(new, ROUNDING) > FACTOR * max(old, ROUNDING):
        return "worse", f"natural map {old:.1e} → {new:.1e}"
    return "same", ""


def _counts(changes: Sequence[Change]) -> Table:
    table = new_table(f"From A to B, {len(changes)} rows in both")
    table.add_column("engine, solver, program")
    columns = ("faster", "slower", "within noise", "no spread", "better", "worse")
    for name in (*columns, "time B / A"):
        table.add_column(name, justify="right")
    for line in dict.fromkeys(change.before.line for change in changes):
        here = [change for change in changes if change.before.line == line]
        counts = Counter(word for change in here for word in (change.speed, change.quality))
        logs = [math.log(change.ratio) for change in here if change.ratio]
        mean = f"{math.exp(sum(logs) / len(logs)):.2f}" if logs else ""
        table.add_row(" ".join(line), *(str(counts[name] or "") for name in columns), mean)
    return table


def _listing(changes: Sequence[Change]) -> Table:
    table = new_table("What changed, the largest first")
    for name in ("scene", "who", "case"):
        table.add_column(name, overflow="fold")
    for name in ("A ms", "B ms", "B / A"):
        table.add_column(name, justify="right")
    table.add_column("")
    for change in changes:
        row = change.before
        (a, _), (b, _) = _time(change.before), _time(change.after)
        bad = change.speed == "slower" or change.quality == "worse"
        words = "; ".join(filter(None, (change.speed if change.speed in ("faster", "slower") else "", change.why)))
        table.add_row(
            row.scene,
            f"{row.engine} {row.solver} {row.formulation} {row.setting}",
            row.case,
            *("" if t is None else f"{1e3 * t:.3g}" for t in (a, b)),
            "" if change.ratio is None else f"{change.ratio:.2f}",
            Text(words, style="red" if bad else "green"),
        )
    return table

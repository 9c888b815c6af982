"""What presolve says that it did."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, TypeAlias

# As the core counts it: islands, size before, size after, and of each reduction its name, its islands, what it removed.
Counts: TypeAlias = tuple[int, int, int]
Counted: TypeAlias = tuple[int, Counts, Counts, Sequence[tuple[str, int, Counts]]]


class Size(NamedTuple):
    """How large a stacked system is.

    Attributes
    ----------
    contacts : int
    rows : int
        Of A, the unknown impulses.
    velocities : int
        Of the bodies, the columns of J.
    """

    contacts: int
    rows: int
    velocities: int


@dataclass(frozen=True)
class Reduction:
    """One way in which the system became smaller.

    Attributes
    ----------
    name : str
        See `gpx_lcp.presolve`.
    islands : int
        How many islands it changed.
    removed : Size
    """

    name: str
    islands: int
    removed: Size


@dataclass(frozen=True)
class Presolve:
    """What presolve made of a system.

    Attributes
    ----------
    islands : int
        Parts that no chain of moving bodies joins, solved apart.
    before, after : Size
        Of the system, and of all that is left for a solver.
    reductions : tuple of Reduction
        What lies between the two.
    """

    islands: int
    before: Size
    after: Size
    reductions: tuple[Reduction, ...]

    @classmethod
    def of(cls, counted: Counted) -> Presolve:
        """Return the report of what the core has counted."""
        islands, before, after, reductions = counted
        removed = tuple(Reduction(name, changed, Size(*size)) for name, changed, size in reductions)
        return cls(islands, Size(*before), Size(*after), removed)

    def __str__(self) -> str:
        """Return a table, one line a reduction."""
        rows: list[tuple[str, ...]] = [("", "islands", "contacts", "rows", "velocities")]
        rows.append(("before", str(self.islands), *map(str, self.before)))
        rows += [
            (item.name, str(item.islands), *(f"-{count}" if count else "" for count in item.removed))
            for item in self.reductions
        ]
        rows.append(("after", "", *map(str, self.after)))
        widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
        lines = []
        for name, *counts in rows:
            cells = (count.rjust(width) for count, width in zip(counts, widths[1:], strict=True))
            lines.append("  ".join((name.ljust(widths[0]), *cells)).rstrip())
        return "\n".join(lines)

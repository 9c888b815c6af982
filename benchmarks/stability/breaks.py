"""From rows to what the map shows: for each solver and failure mode, the rung that breaks it, and how."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from benchmarks.attempts import OWN
from benchmarks.records import Record
from benchmarks.stability.climbing import NOT_ASKED, NOT_CLIMBED, STANDS
from benchmarks.stability.modes import Mode
from benchmarks.stability.table import MODES


@dataclass(frozen=True)
class Break:
    """Where a solver's climb of one ladder ended.

    Parameters
    ----------
    mode : str
    engine, solver, formulation : str
    outcome : str
        How the rung ended that broke it; STANDS where none did.
    rung : str
        The rung that broke it; "" where none did.
    stands : str
        The last rung on which it stands; "" where there is none.
    error : float or None
        Of the last rung asked, in units of what its rule allows.
    """

    mode: str
    engine: str
    solver: str
    formulation: str
    outcome: str
    rung: str
    stands: str
    error: float | None

    @property
    def who(self) -> str:
        """Engine, solver and program in words."""
        engine = "" if self.engine == OWN else self.engine
        return " ".join(filter(None, (engine, self.solver, self.formulation)))

    @property
    def on_ladder(self) -> Mode:
        """The failure mode itself."""
        return MODES[self.mode]


def breaks(records: Sequence[Record]) -> list[Break]:
    """Return a break for each attempt that was made, in the order of the table of modes and of the rows.

    Rungs that this version does not have are left out.
    """
    climbs: dict[tuple[str, ...], list[Record]] = {}
    for record in records:
        here = record.scene in MODES and record.case in MODES[record.scene].labels
        if here and "outcome" in record.figures:
            climbs.setdefault(record.attempt_key, []).append(record)
    order = {name: place for place, name in enumerate(MODES)}
    ends = [_end(sorted(rungs, key=_place)) for rungs in climbs.values()]
    return sorted((end for end in ends if end is not None), key=lambda end: order[end.mode])


def _place(record: Record) -> int:
    return MODES[record.scene].labels.index(record.case)


def _end(rungs: Sequence[Record]) -> Break | None:
    outcomes = [str(rung.figures["outcome"]) for rung in rungs]
    if NOT_ASKED in outcomes:
        return None
    stood = [rung.case for rung, outcome in zip(rungs, outcomes, strict=True) if outcome == STANDS]
    broken = [pair for pair in zip(rungs, outcomes, strict=True) if pair[1] not in (STANDS, NOT_CLIMBED)]
    last, outcome = broken[0] if broken else (rungs[-1], STANDS)
    return Break(
        last.scene,
        last.engine,
        last.solver,
        last.formulation,
        outcome,
        last.case if broken else "",
        stood[-1] if stood else "",
        last.figure("error"),
    )

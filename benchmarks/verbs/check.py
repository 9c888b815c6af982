"""`check FOLDER`: certifies every stored answer again, in Python and from the stored system alone.

What a row claims must hold: each measure of its certificate; that its tolerance was reached; and, where the system kept
is the one that the solver was given, that what it called solved is a solution of its own program.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from rich.console import Console
from rich.text import Text

import gpx_lcp as gpx
from benchmarks import exit_codes, store
from benchmarks.answers import Archive, Kept
from benchmarks.attempts import PROGRAM_RESIDUAL
from benchmarks.records import CERTIFICATE, Record
from formulations import RESIDUALS

# Two evaluations of the same measure differ by rounding: of the sums, relative to B, and of products of another order.
RELATIVE, ABSOLUTE = 1e-6, 1e-12

# Angles of directions that are themselves rounding.
LOOSE = {"sliding_angle": 1e-5}

# Which contact is the worst is a choice among equals.
NOT_COMPARED = frozenset({"worst_contact"})


@dataclass(frozen=True)
class Breach:
    """A claim that does not hold."""

    record: Record
    claim: str


def check(folders: Sequence[Path], console: Console) -> int:
    """Certify every answer of the folders again; print each claim that does not hold.

    Raises
    ------
    SettingsError
        When a folder holds no results.
    """
    records, breaches = 0, 0
    for folder in folders:
        rows = store.read(folder)
        answered = sum(bool(row.answer) for row in rows)
        for breach in breaches_of(folder, rows):
            breaches += 1
            row = breach.record
            where = f"{row.scene}, {row.engine} {row.solver} {row.formulation} {row.setting} ({row.case}): "
            console.print(Text.assemble(("does not hold  ", "bold red"), where, breach.claim))
        records += answered
        console.print(f"{folder}: {answered} answers of {len(rows)} rows certified again")
    if breaches:
        console.print(f"[bold red]{breaches} claims do not hold[/]")
        return exit_codes.FAILED
    console.print(f"[green]every claim of {records} answers holds[/]")
    return exit_codes.OK


def breaches_of(folder: Path, records: Sequence[Record]) -> Iterator[Breach]:
    """Yield every claim of the rows that their stored answers do not bear out."""
    archives: dict[str, Archive] = {}
    for record in records:
        if not record.answer:
            # Without a tolerance, what was reached is no claim about impulses: an apex, or the balance of many.
            if record.certificate or (record.reached and record.tolerance is not None):
                yield Breach(record, "it states a certificate, but no impulses are kept")
            continue
        file, _, number = record.answer.rpartition(":")
        try:
            if file not in archives:
                archives[file] = Archive(folder / store.ANSWERS / file)
            kept = archives[file][int(number)]
        except (gpx.ProblemError, ValueError) as error:
            yield Breach(record, str(error))
            continue
        yield from (Breach(record, claim) for claim in _wrong(record, kept))


def _wrong(record: Record, kept: Kept) -> Iterator[str]:
    certificate = gpx.certify(kept.system, kept.impulse)
    for name in CERTIFICATE:
        stated, found = record.certificate.get(name), getattr(certificate, name)
        if name not in NOT_COMPARED and stated is not None and not _same(name, stated, found):
            yield f"{name} is stated as {stated:.3g}, and is {found:.3g}"
    by_program = record.figure(PROGRAM_RESIDUAL) is not None
    if (
        record.reached
        and not by_program
        and record.tolerance is not None
        and certificate.natural_map > _bound(record.tolerance)
    ):
        yield f"{record.tolerance:g} is said to be reached, but the natural map is {certificate.natural_map:.3g}"
    claimed = record.status == "solved" or (record.reached and by_program)
    if claimed and kept.program and record.tolerance is not None:
        residual = RESIDUALS[kept.program](kept.system, kept.impulse, kept.facets)
        if residual > _bound(record.tolerance):
            yield f"it is said to be solved to {record.tolerance:g}, but its program's residual is {residual:.3g}"


def _bound(tolerance: float) -> float:
    return tolerance * (1.0 + RELATIVE) + ABSOLUTE


def _same(name: str, stated: float, found: float | None) -> bool:
    if found is None:
        return False
    return stated == found or math.isclose(stated, found, rel_tol=RELATIVE, abs_tol=LOOSE.get(name, ABSOLUTE))

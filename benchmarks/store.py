"""Results on disk: a folder of rows (Parquet, and CSV for whoever wants it), answers, and what was asked."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import fields, replace
from pathlib import Path
from typing import Any, get_args, get_type_hints

import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet

import gpx_lcp as gpx
from benchmarks.measuring import Measured
from benchmarks.records import CERTIFICATE, Record

# Columns that are mappings in a Record and stand flat in a table; a column's metadata says which it came from.
GROUPS = ("certificate", "figures", "where")
TYPES = {str: pa.string(), int: pa.int64(), float: pa.float64(), bool: pa.bool_()}
ROWS, CSV, ASKED, ANSWERS = "rows.parquet", "rows.csv", "asked.json", "answers"


class Folder:
    """The results of one suite while they are measured: rows are written as batches end, each file in one move."""

    def __init__(self, path: Path, records: Iterable[Record] = ()) -> None:
        self.path = path
        self._records = {record.key: record for record in records}

    @property
    def records(self) -> list[Record]:
        """The rows so far, in the order in which their attempts were first made."""
        return list(self._records.values())

    def keep(self, name: str, measured: Measured) -> list[Record]:
        """Store what a batch gave; a row that was there under the same key is replaced. Return the rows as stored."""
        records = list(measured.records)
        if measured.answers:
            file = self._free_name(name)
            _write(self.path / ANSWERS / file, measured.answers)
            records = [replace(record, answer=record.answer and f"{file}:{record.answer}") for record in records]
        self._records |= {record.key: record for record in records}
        self.write()
        return records

    def add(self, records: Iterable[Record]) -> None:
        """Store rows without answers, where there is none of their key."""
        for record in records:
            self._records.setdefault(record.key, record)
        self.write()

    def write(self) -> None:
        """Write all rows."""
        table = as_table(self.records)
        self.path.mkdir(parents=True, exist_ok=True)
        partial = self.path / f"{ROWS}.partial"
        pyarrow.parquet.write_table(table, partial, compression="zstd")
        partial.replace(self.path / ROWS)
        partial = self.path / f"{CSV}.partial"
        pyarrow.csv.write_csv(table, partial)
        partial.replace(self.path / CSV)

    def _free_name(self, name: str) -> str:
        stem = re.sub(r"[^\w.-]+", "_", name)
        taken = {path.name for path in (self.path / ANSWERS).glob("*.npz")}
        return next(file for n in range(len(taken) + 1) if (file := f"{stem}-{n}.npz") not in taken)


def make_folder(path: Path) -> None:
    """Make a folder for results, with those above it.

    Raises
    ------
    SettingsError
        When it cannot be made or written to.
    """
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise gpx.SettingsError(f"--out: the folder {path} cannot be made ({error.strerror})") from error
    if not os.access(path, os.W_OK):
        raise gpx.SettingsError(f"--out: the folder {path} cannot be written to")


def clear(path: Path) -> int:
    """Take away the rows and answers of an earlier run, and return how many rows there were."""
    try:
        count = pyarrow.parquet.read_metadata(path / ROWS).num_rows
    except (OSError, pa.ArrowInvalid):
        count = 0
    for old in (path / ROWS, path / CSV, *(path / ANSWERS).glob("*.npz")):
        old.unlink(missing_ok=True)
    return count


def write_asked(path: Path, asked: Mapping[str, Any]) -> None:
    """Note what was asked for, for --resume."""
    _write(path / ASKED, json.dumps(asked, indent=1).encode())


def read_asked(path: Path) -> dict[str, Any]:
    """Return what was asked for.

    Raises
    ------
    SettingsError
        When nothing was, in this folder.
    """
    try:
        held = json.loads((path / ASKED).read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise gpx.SettingsError(f"--resume: {path} holds no run to go on with ({error})") from error
    assert isinstance(held, dict)
    return held


def as_table(records: Sequence[Record]) -> pa.Table:
    """Return the rows as a table: the columns of a Record, with its mappings flat."""
    hints = get_type_hints(Record)
    columns: list[tuple[str, pa.DataType, str, list[Any]]] = []
    for column in fields(Record):
        if column.name not in GROUPS:
            kind = next(k for k in (get_args(hints[column.name]) or (hints[column.name],)) if k in TYPES)
            columns.append((column.name, TYPES[kind], "", [getattr(r, column.name) for r in records]))
    for group in GROUPS:
        names = list(dict.fromkeys(name for record in records for name in getattr(record, group)))
        for name in CERTIFICATE if group == "certificate" else names:
            values = [getattr(record, group).get(name) for record in records]
            columns.append((name, _type_of(values), group, values))
    schema = pa.schema([pa.field(name, kind, metadata={"group": group}) for name, kind, group, _ in columns])
    return pa.Table.from_arrays(
        [pa.array(values, kind) for (_, kind, _, values) in columns],
        schema=schema,
    )


def read(folder: Path) -> list[Record]:
    """Read the rows of one folder.

    Raises
    ------
    SettingsError
        When it holds none.
    """
    path = folder / ROWS
    try:
        # In one go: a run that goes on may put another file in its place.
        table = pyarrow.parquet.read_table(pa.BufferReader(path.read_bytes()))
    except (OSError, pa.ArrowInvalid) as error:
        raise gpx.SettingsError(f"{folder} holds no results: {ROWS} cannot be read ({error})") from error
    groups = {column.name: (column.metadata or {}).get(b"group", b"").decode() for column in table.schema}
    records = []
    for line in table.to_pylist():
        parts: dict[str, dict[str, Any]] = {group: {} for group in ("", *GROUPS)}
        for name, value in line.items():
            group = groups[name]
            # A column that only some rows have is empty in the others.
            if group == "" or value is not None:
                parts[group][name] = value
        records.append(Record(**parts[""], **{group: parts[group] for group in GROUPS}))
    return records


def merged(runs: Iterable[Sequence[Record]]) -> list[Record]:
    """Return the rows of several runs as one; of two under the same key the finished one counts, or else the later."""
    found: dict[tuple[str, ...], Record] = {}
    for record in (record for run in runs for record in run):
        old = found.get(record.key)
        rank = (record.finished, record.where.get("measured_at", ""))
        if old is None or rank >= (old.finished, old.where.get("measured_at", "")):
            found[record.key] = record
    return list(found.values())


def _type_of(values: Sequence[Any]) -> pa.DataType:
    kinds = {type(value) for value in values if value is not None}
    if kinds <= {int, float}:
        return pa.float64() if float in kinds or not kinds else pa.int64()
    return TYPES[kinds.pop()] if len(kinds) == 1 and kinds <= set(TYPES) else pa.string()


def _write(path: Path, content: bytes) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_name(path.name + ".partial")
    partial.write_bytes(content)
    partial.replace(path)

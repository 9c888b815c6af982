"""`plot FOLDER…`: draws the charts of stored rows again; rows of several folders are merged."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from rich.console import Console

from benchmarks import exit_codes, store
from benchmarks.records import Record
from benchmarks.suites import SUITES
from benchmarks.verbs.run import version_line


def plot(folders: Sequence[Path], out: Path | None, console: Console) -> int:
    """Draw into `out`, or into the folder itself.

    Raises
    ------
    SettingsError
        When a folder holds no results.
    """
    for name, (folder, records) in by_suite(folders).items():
        target = folder if out is None else out / name
        store.make_folder(target)
        paths = SUITES[name].draw(records, folder, target, version_line(records))
        console.print(f"{name}: " + (", ".join(map(str, paths)) or "nothing to draw"), soft_wrap=True)
    return exit_codes.OK


def by_suite(folders: Sequence[Path]) -> dict[str, tuple[Path, list[Record]]]:
    """Return the rows of each suite, merged, and the first folder that has any of them.

    Raises
    ------
    SettingsError
        When a folder holds no results.
    """
    runs: dict[str, list[tuple[Path, list[Record]]]] = {}
    for folder in folders:
        records = store.read(folder)
        for name in dict.fromkeys(record.suite for record in records):
            runs.setdefault(name, []).append((folder, [record for record in records if record.suite == name]))
    found = {name: (parts[0][0], store.merged(rows for _, rows in parts)) for name, parts in runs.items()}
    # In the order of the table, and without suites that this version does not know.
    return {name: found[name] for name in SUITES if name in found}

"""A sweep of a thousand attempts in a process of its own, which real signals end: nothing is lost, nothing is twice."""

import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

import gpx_lcp as gpx
from benchmarks import exit_codes, store
from tests.benchmarks.test_harness import CHANCE

# 125 towers, thrown at random, by two solvers at four tolerances.
SEEDS, TOLERANCES = range(125), ("1e-4", "1e-6", "1e-8", "1e-10")
SWEEP = ["--scene", "ShakenTower-5", "--solver", "newton", "--solver", "interior_point"]
SWEEP += [word for seed in SEEDS for word in ("--seed", str(seed))]
SWEEP += [word for tolerance in TOLERANCES for word in ("--tolerance", tolerance)]
# A limit that no busy machine reaches.
SWEEP += ["--repeats", "1", "--time-limit", "60"]
ATTEMPTS = len(SEEDS) * 2 * len(TOLERANCES)


def start(folder: Path, *arguments: str) -> subprocess.Popen[bytes]:
    command = [sys.executable, "-m", "benchmarks", "run", "fclib", "--out", str(folder), *arguments]
    return subprocess.Popen(command, stdout=subprocess.DEVNULL)


def finished(folder: Path) -> int:
    try:
        return sum(row.finished for row in store.read(folder / "fclib"))
    except gpx.SettingsError:
        return 0  # nothing is stored yet


def ended(process: subprocess.Popen[bytes], folder: Path, more: int, by: signal.Signals) -> int:
    """Send a signal once so many more attempts are stored, and return the exit code."""
    enough, late = finished(folder) + more, time.monotonic() + 300.0
    while finished(folder) < enough:
        assert process.poll() is None and time.monotonic() < late, "it ended before it was interrupted"
        time.sleep(0.02)
    process.send_signal(by)
    return process.wait(timeout=120)


def steady(folder: Path) -> dict[tuple[str, ...], dict[str, object]]:
    """Return the rows by key, without what chance decides."""
    records = store.read(folder / "fclib")
    rows = store.as_table(records).to_pylist()
    kept = [{name: value for name, value in row.items() if not any(c in name for c in CHANCE)} for row in rows]
    found = {record.key: row for record, row in zip(records, kept, strict=True)}
    assert len(found) == len(rows)
    return found


@pytest.mark.slow
def test_a_thousand_attempts_interrupted_and_resumed_give_the_rows_of_one_run(tmp_path):
    whole, parts = tmp_path / "whole", tmp_path / "parts"
    assert start(whole, *SWEEP).wait(timeout=300) == exit_codes.OK
    stored = [0]
    # Killed outright it cannot even list what is left.
    for arguments, by, code in (
        (SWEEP, signal.SIGINT, exit_codes.INTERRUPTED),
        (["--resume"], signal.SIGINT, exit_codes.INTERRUPTED),
        (["--resume"], signal.SIGKILL, -signal.SIGKILL),
        (["--resume"], signal.SIGINT, exit_codes.INTERRUPTED),
    ):
        assert ended(start(parts, *arguments), parts, 150, by) == code
        stored.append(finished(parts))
        assert stored[-2] < stored[-1] < ATTEMPTS
    assert start(parts, "--resume").wait(timeout=300) == exit_codes.OK
    assert len(steady(parts)) == ATTEMPTS and finished(parts) == ATTEMPTS
    assert steady(parts) == steady(whole)
    check = [sys.executable, "-m", "benchmarks", "check", str(parts / "fclib")]
    assert subprocess.run(check, stdout=subprocess.DEVNULL).returncode == exit_codes.OK

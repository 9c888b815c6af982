"""The suite of inner loops: what bounds them, and that they are measured."""

import io

import pytest
from rich.console import Console

from benchmarks import cli, exit_codes, kernels, store
from tests.benchmarks.make_record import record

RATES = {"arithmetic": 1e-11, "division": 1e-9}


@pytest.mark.parametrize(
    ("operations", "divisions", "ns", "binds"),
    [(10, 0, 10.0, "memory"), (10_000, 0, 100.0, "arithmetic"), (10, 30, 30.0, "division")],
)
def test_the_slowest_of_memory_arithmetic_and_division_binds(operations, divisions, ns, binds):
    row = record(step_seconds=1e-6, bytes=100, operations=operations, divisions=divisions, byte_seconds=1e-10)
    assert kernels.bound(row, RATES) == (pytest.approx(ns), binds)


def test_what_was_not_counted_or_a_machine_not_measured_has_no_bound():
    row = record(step_seconds=1e-6, bytes=1, operations=1, divisions=1, byte_seconds=1e-10)
    assert kernels.bound(record(step_seconds=1e-6), RATES) is None
    assert kernels.bound(row, {"arithmetic": 1e-10}) is None


def test_moving_a_byte_takes_some_time_and_less_than_a_nanosecond_in_a_cache():
    assert 0.0 < kernels.byte_seconds(kernels.IN_CACHE) < 1e-9


def test_kernels_are_measured_and_drawn(tmp_path):
    page = io.StringIO()
    arguments = ["run", "kernels", "--quick", "--repeats", "1", "--scene", "[!s]*", "--scene", "sweep-tower-30"]
    assert cli.main([*arguments, "--out", str(tmp_path)], Console(file=page, width=200)) == exit_codes.OK
    rows = {row.scene: row for row in store.read(tmp_path / "kernels")}
    assert {"cache", "memory", "arithmetic", "division", "sweep-tower-30", "certificate-wall-20"} <= rows.keys()
    assert all(row.measured and row.figure("count") > 0 for row in rows.values())
    shares = [rows["sweep-tower-30"].figure(name) for name in ("open", "sliding")]
    assert all(0.0 <= share <= 1.0 for share in shares) and sum(shares) <= 1.0
    assert "times the bound" in page.getvalue()
    assert (tmp_path / "kernels" / "kernels.png").exists()

"""The suite of ways to spend sweeps: Anderson's mixing, and rows that are measured, drawn and certified again."""

import io

import numpy as np
from rich.console import Console

import gpx_lcp as gpx
from benchmarks import acceleration, cli, exit_codes, store


def test_anderson_solves_a_small_linear_fixed_point_where_iteration_crawls():
    """p ← M p + c on five unknowns: five mixed steps span the space, where plain steps gain a hundredth each."""
    rates = np.array([0.99, 0.9, 0.5, -0.5, 0.1])
    solution = 1.0 / (1.0 - rates)
    plain = solution * (1.0 - rates**12)
    mixed = acceleration.anderson(lambda p: rates * p + 1.0, np.zeros(5), 12)
    assert np.abs(plain - solution).max() > 80.0
    np.testing.assert_allclose(mixed, solution, rtol=1e-6)


def test_a_sweep_from_outside_is_a_sweep_of_the_solver():
    scene = acceleration.SCENES["column-50"].make()
    system = gpx.World(scene, 1 / 240).system()
    impulse = np.zeros((system.contacts, system.rows))
    for _ in range(3):
        impulse = acceleration.swept(system, impulse)
    asked = {"max_iterations": 3, "acceleration": False, "presolve": False, "tolerance": 1e-15}
    np.testing.assert_allclose(impulse, gpx.solve(system, solver="pgs", **asked).impulse, rtol=1e-12)


def test_ways_are_measured_drawn_and_certified_again(tmp_path):
    page = io.StringIO()
    arguments = ["run", "acceleration", "--quick", "--out", str(tmp_path)]
    assert cli.main(arguments, Console(file=page, width=200)) == exit_codes.OK
    rows = {row.setting: row for row in store.read(tmp_path / "acceleration")}
    assert len(rows) == len(acceleration.WAYS) * len(acceleration.QUICK_SWEEPS)
    assert all(row.measured and 0.0 < row.figure("load_error") <= 1.0 for row in rows.values())
    assert rows["momentum, 30 sweeps"].figure("load_error") < rows["plain, 30 sweeps"].figure("load_error")
    assert (tmp_path / "acceleration" / "acceleration.png").exists()
    assert cli.main(["check", str(tmp_path / "acceleration")], Console(file=page)) == exit_codes.OK

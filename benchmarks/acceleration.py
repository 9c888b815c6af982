"""How many sweeps momentum saves: `python -m benchmarks.acceleration`.

Both columns stop at the same residual of the exact Coulomb law, so that they compare at equal accuracy. The last two
columns are the residual after a fixed number of sweeps, as in a time step that can afford no more.
"""

from __future__ import annotations

from rich.console import Console
from rich.table import Table

import gpx_lcp as gpx

SCENES = {
    "column(50)": gpx.scenes.column(50),
    "heavy_on_light(10, 1000)": gpx.scenes.heavy_on_light(10, 1000),
    "tower(10)": gpx.scenes.tower(10),
    "wall(10)": gpx.scenes.wall(10),
}
TOLERANCES = (1e-2, 1e-4)
FIXED = 50
# Far above what they take, s.
TIME_LIMIT = 20.0


def sweeps(system: gpx.StackedSystem, tolerance: float, acceleration: bool) -> str:
    """Return how many sweeps, and ms, reach the tolerance."""
    solution = gpx.solve(
        system,
        solver="pgs",
        tolerance=tolerance,
        max_iterations=1_000_000,
        time_limit=TIME_LIMIT,
        acceleration=acceleration,
    )
    if solution.status is not gpx.Status.SOLVED:
        return f"{solution.status.name.lower()} at {solution.program_residual:.0e}"
    return f"{solution.iterations} ({1e3 * solution.solve_seconds:.2g})"


def residual(system: gpx.StackedSystem, acceleration: bool) -> str:
    """Return the residual after the fixed number of sweeps."""
    effort = {"max_iterations": FIXED, "acceleration": acceleration}
    return f"{gpx.solve(system, solver='pgs', tolerance=1e-12, **effort).program_residual:.1e}"


def main() -> None:
    """Print the table."""
    table = Table(title="Sweeps (ms) to a residual: without momentum | with it")
    for title in ("scene", *(f"{tolerance:.0e}" for tolerance in TOLERANCES), f"residual after {FIXED}"):
        table.add_column(title)
    for name, scene in SCENES.items():
        system = gpx.World(scene, 1 / 240).system()
        cells = [" | ".join(sweeps(system, tolerance, on) for on in (False, True)) for tolerance in TOLERANCES]
        table.add_row(name, *cells, " | ".join(residual(system, on) for on in (False, True)))
    Console(width=140).print(table)


if __name__ == "__main__":
    main()

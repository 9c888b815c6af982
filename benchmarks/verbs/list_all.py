"""`list`: suites, scenes, engines and solvers, and the command that gets what is missing."""

from __future__ import annotations

from rich.console import Console

import gpx_lcp as gpx
from benchmarks import exit_codes
from benchmarks.engines import ENGINES, OWN
from benchmarks.suites import SUITES
from benchmarks.tables import new_table


def list_all(console: Console) -> int:
    """Print what there is."""
    for suite in SUITES.values():
        table = new_table(f"Suite {suite.name}: {suite.summary}")
        table.add_column("scene")
        table.add_column("what it is")
        for name, text in suite.scenes().items():
            table.add_row(name, text)
        console.print(table)
    engines = new_table("Engines")
    for column in ("engine", "installed", "solvers", "how it is run, or how to get it"):
        engines.add_column(column)
    for engine in ENGINES.values():
        version = engine.version()
        engines.add_row(
            engine.name if engine.name == OWN else f"{engine.name} (peer)",
            version or "[red]missing[/]",
            ", ".join(dict.fromkeys(setting.solver for setting in engine.settings(quick=False))) if version else "",
            engine.note if version else engine.install,
        )
    console.print(engines)
    console.print("[bold]Solvers of gpx-lcp[/]")
    console.print(str(gpx.solvers()), markup=False)
    return exit_codes.OK

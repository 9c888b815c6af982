"""The table of solvers: one row each, and nowhere else a branch on a solver's name."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import cache
from typing import Final

from formulations import FORMULATIONS
from gpx_lcp.solvers import interior_point, lemke, newton, pgs, quadratic
from gpx_lcp.solvers._interface import Outcome, Request, Solver
from gpx_lcp.solvers._reduced import presolving

__all__ = ["Outcome", "Request", "Solver", "SolverTable", "solvers"]

NATIVE: Final = (lemke.SOLVER, interior_point.SOLVER, newton.SOLVER, pgs.SOLVER)


class SolverTable(Mapping[str, Solver]):
    """Every solver by its name; printed, it shows which one solves which formulation, and what is not installed."""

    def __init__(self, rows: Mapping[str, Solver]) -> None:
        self._rows = dict(rows)

    def __getitem__(self, name: str) -> Solver:
        return self._rows[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._rows)

    def __len__(self) -> int:
        return len(self._rows)

    def __repr__(self) -> str:
        rows: list[tuple[str, ...]] = [("solver", *FORMULATIONS, "warm start", "method")]
        for solver in (row for row in self._rows.values() if row.installed):
            solves = (solver.programs.get(formulation, "-") for formulation in FORMULATIONS)
            rows.append((solver.name, *solves, "yes" if solver.warm_starts else "-", solver.method))
        widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
        lines = ["  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in rows]
        missing = [solver.name for solver in self._rows.values() if not solver.installed]
        if missing:
            lines += ["", "not installed (pip install 'qpsolvers[NAME]'): " + ", ".join(missing)]
        return "\n".join(lines)


@cache
def solvers() -> SolverTable:
    """Return the table of solvers: which solves which formulation, posed as which program.

    Print it to read it, look a name up to get its row.
    """
    rows = (*NATIVE, *quadratic.backends())
    # The core presolves for its own.
    return SolverTable({row.name: row if row.native else presolving(row) for row in rows})

"""The native step: what the core is told before it takes whole steps of its own, and the Solution of the last of them.

The core runs the same stages, and the same kernels on the same numbers, as a world that is stepped stage by stage. It
holds its impulses to the tolerance by the residual of the program, evaluated on the stacked system after the solve; the
Solution that a user sees is judged once more by `gpx_lcp.solve`, on the system of that step.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from formulations import StackedSystem
from gpx_lcp import _core
from gpx_lcp.solution import Solution
from gpx_lcp.solve import judged, posed
from gpx_lcp.solvers import Request, Solver
from gpx_lcp.solvers._native import outcome_of
from gpx_lcp.staged import stacked_system


@dataclass(frozen=True)
class NativeSolver:
    """A solver that the core can run inside its own steps.

    Attributes
    ----------
    with_friction, without_friction : Request
        What is asked in steps whose contacts have friction, and in those whose contacts have none.
    """

    row: Solver
    with_friction: Request
    without_friction: Request

    @classmethod
    def of(cls, rows: int, effort: Mapping[str, Any]) -> NativeSolver | None:
        """Return what `gpx.solve(system, **effort)` runs where contacts have `rows` rows, or None if that is Python."""
        probe = np.eye(rows), np.eye(rows)[0]
        row, with_friction = posed(StackedSystem(*probe, [1.0]), False, **effort)
        _, without_friction = posed(StackedSystem(*probe, [0.0]), False, **effort)
        return None if row.native is None else cls(row, with_friction, without_friction)

    def settings(self) -> dict[str, Any]:
        """Return what the core needs to know."""
        assert self.row.native is not None
        return {
            "with_friction": self.row.native(self.with_friction),
            "without_friction": self.row.native(self.without_friction),
        }

    def solution(self, step: _core.Solved) -> Solution:
        """Return the judged Solution of a step."""
        system = stacked_system(step.stack)
        asked = self.without_friction if step.frictionless else self.with_friction
        request = replace(asked, system=system)
        outcome = outcome_of(request, step.found, step.found.setup_seconds)
        moved = {} if step.start_moved is None else {"warm_start_moved": step.start_moved}
        return judged(request, self.row, outcome, moved)

"""What comes back from a solver, always, also when it failed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum
from functools import cached_property
from typing import Any

from formulations import Certificate, StackedSystem, certify
from formulations.checks import Array
from gpx_lcp.presolved import Counted, Presolve


class Status(Enum):
    """Why a solver stopped. The value of each says what it means and what to do next."""

    SOLVED = "The residual of the program is within the tolerance."
    MAX_ITERATIONS = "The limit of iterations or of time was reached: raise it, warm-start, or take a direct solver."
    STALLED = "No further progress is possible here: accept the certificate's figure, or take another solver."
    INFEASIBLE = "No impulses satisfy the program: extras['infeasibility'] or extras['refutation'] proves it."
    NUMERICAL_ERROR = "The arithmetic broke down: check the scaling of the system; the best iterate is returned."

    def __repr__(self) -> str:
        return f"Status.{self.name}"


@dataclass(frozen=True)
class Solution:
    """The best impulses found, with what is true of them.

    Velocity and certificate are worked out when first asked for: time steps that nobody looks at pay for neither.

    Attributes
    ----------
    system : StackedSystem
        What was asked.
    impulse : (n, rows) array, N s
        Contact impulses on body b, normal first.
    velocity : (n, rows) array, m/s
        Contact velocities after the impulses, u = A p - B.
    status : Status
        SOLVED only where `program_residual` is within the tolerance, whatever the solver itself says.
    certificate : Certificate
        The impulses against the exact Coulomb law, whatever program was solved.
    program_residual : float
        The residual of the program that was solved (its own natural map, scale-free).
    method : str
        What really ran: program/solver, e.g. "coulomb/pgs".
    fallbacks : tuple of str
        What was tried before or after it, in order.
    iterations : int
    setup_seconds, solve_seconds : float
        Wall time of posing, scaling and factoring, and of solving.
    history : tuple of (int, float)
        Residual of the program after so many iterations, where the solver tells.
    extras : mapping
        The solver's own figures.
    presolved : tuple or None
        What `presolve` is made from.
    presolve : Presolve or None
        What presolve removed before the solver ran; None where it was off, or found nothing to remove.
    """

    system: StackedSystem
    impulse: Array
    status: Status
    program_residual: float
    method: str
    fallbacks: tuple[str, ...]
    iterations: int
    setup_seconds: float
    solve_seconds: float
    history: tuple[tuple[int, float], ...] = ()
    extras: Mapping[str, Any] = field(default_factory=dict)
    presolved: Counted | None = field(default=None, repr=False)

    @cached_property
    def velocity(self) -> Array:
        """The contact velocities after the impulses."""
        return self.system.velocity(self.impulse)

    @cached_property
    def certificate(self) -> Certificate:
        """The impulses against the exact Coulomb law."""
        return certify(self.system, self.impulse)

    @property
    def presolve(self) -> Presolve | None:
        """What presolve removed before the solver ran."""
        return None if self.presolved is None else Presolve.of(self.presolved)

    def __repr__(self) -> str:
        return (
            f"Solution({self.status.name}, {self.method}, natural_map {self.certificate.natural_map:.2g}, "
            f"{self.iterations} iterations, {1e3 * self.solve_seconds:.3g} ms)"
        )

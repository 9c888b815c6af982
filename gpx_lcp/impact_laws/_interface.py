"""What every impact law is given, and what it gives back: the types that keep laws apart from everything else."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Final

import numpy as np
import numpy.typing as npt
import scipy.sparse as sp
from numpy.linalg import norm

from formulations import StackedSystem
from formulations.checks import Array
from formulations.system import SMALL, Matrix
from gpx_lcp.solution import Solution
from gpx_lcp.solve import solve

# Closing speeds below this share of the fastest contact are rounding, however tightly the programs are solved.
ROUNDING: Final = 1e-13


@dataclass(frozen=True, eq=False)
class Collision:
    """What collides, checked: u = u⁻ + A p, with everything at rest but the n contacts' impulses p.

    Attributes
    ----------
    A : (rows n, rows n) matrix, 1/kg
    before : (n, rows) array, m/s
        Contact velocities u⁻ before the impact, normal first, negative when closing.
    friction : (n,) array
    restitution : (n, 2) array
        Elasticity - 1 of each contact, normal and tangential.
    impact_speed : float, m/s
        Elasticity acts where a contact closes faster.
    tolerance : float
        To which the programs of the law are solved.
    """

    A: Matrix
    before: Array
    friction: Array
    restitution: Array
    impact_speed: float
    tolerance: float

    @property
    def rows(self) -> int:
        """Rows of a contact."""
        return int(self.before.shape[1])

    @cached_property
    def normals(self) -> slice:
        """The normal rows among all."""
        return slice(0, self.before.size, self.rows)

    @cached_property
    def normal_diagonal(self) -> Array:
        """(A_nn)_ii, (n,), 1/kg: one over the local normal inertia of each contact."""
        return np.asarray(self.A.diagonal())[self.normals]

    @property
    def rounding(self) -> float:
        """The speed that is rounding, m/s: what the programs, solved to the tolerance, may leave."""
        return max(ROUNDING * float(np.abs(self.before).max(initial=0.0)), self.tolerance * float(norm(self.before)))

    def apply(self, impulse: Array) -> Array:
        """Return A p as (n, rows)."""
        return np.asarray(self.A @ impulse.reshape(-1)).reshape(self.before.shape)

    def energy(self, impulse: Array) -> float:
        """Return what the impulses change the kinetic energy by, p·u⁻ + ½ pᵀA p, J."""
        return float(np.vdot(impulse, self.before + 0.5 * self.apply(impulse)))

    def acting(self, speed: Array) -> Array:
        """Return the restitutions (n, 2) where contacts close with `speed`, (n,); zero at or below the impact speed."""
        return np.where((speed > max(self.impact_speed, self.rounding))[:, None], self.restitution, 0.0)

    def solve(self, B: Array, friction: Array | None = None, A: Matrix | None = None, **how: Any) -> Solution:
        """Solve A p = B with the default solver of `gpx.solve`; A and the friction are the collision's unless given."""
        friction = self.friction if friction is None else friction
        system = StackedSystem(self.A if A is None else A, B.reshape(-1), friction)
        return solve(system, **{"tolerance": self.tolerance, **how})

    def part(self, contacts: npt.NDArray[np.intp], before: Array) -> Collision:
        """Return the collision of some of the contacts, at other velocities."""
        at = (self.rows * contacts[:, None] + np.arange(self.rows)).ravel()
        return Collision(
            self.A[np.ix_(at, at)] if isinstance(self.A, np.ndarray) else self.A[at][:, at],
            before[contacts],
            self.friction[contacts],
            self.restitution[contacts],
            self.impact_speed,
            self.tolerance,
        )


@dataclass(frozen=True, eq=False)
class Impulses:
    """What a law found.

    Attributes
    ----------
    impulse : (n, rows) array, N s
    solutions : tuple of Solution
        Of the programs that it solved, in order, each judged by `gpx.solve`.
    finished : bool
        False where the law stopped at a limit of its own.
    extras : mapping
        The law's own figures.
    """

    impulse: Array
    solutions: tuple[Solution, ...]
    finished: bool = True
    extras: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class ImpactLaw:
    """A row of the table of impact laws.

    Attributes
    ----------
    summary : str
        The law in one line.
    promises, breaks : str
        What always holds, and what does not with the case that shows it; `python -m benchmarks run impacts` shows both.
    run : callable
    in_core : bool
        Whether the core's own time step has it; a world with any other law is stepped stage by stage.
    """

    name: str
    summary: str
    promises: str
    breaks: str
    run: Callable[[Collision], Impulses]
    in_core: bool = False


def dense_if_small(matrix: Matrix) -> Matrix:
    """Return a sparse matrix dense where that is quicker."""
    return matrix.toarray() if sp.issparse(matrix) and matrix.shape[0] <= SMALL else matrix

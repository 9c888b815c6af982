"""What every solver is given, and what it gives back: the two types that keep solvers apart from everything else."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Final

from formulations import StackedSystem
from formulations.checks import Array
from gpx_lcp.presolved import Counted
from gpx_lcp.solution import Status

# Of the parts of a system the worst is said.
SEVERITY: Final = (
    Status.SOLVED,
    Status.STALLED,
    Status.MAX_ITERATIONS,
    Status.NUMERICAL_ERROR,
    Status.INFEASIBLE,
)


@dataclass(frozen=True)
class Request:
    """A question that has been checked: at least one contact, B not zero, settings known to the solver.

    Attributes
    ----------
    tolerance : float
        Bound on the residual of the program that the solver solves (its scale-free natural map).
    max_iterations : int or None
        None stands for the solver's own limit.
    time_limit : float or None, s
    warm_start : (n, rows) array or None, N s
        Finite, of the right shape and inside the friction cones.
    facets : int
        Of the pyramids, where the formulation has any.
    presolve : bool
        Whether to solve the smallest system with the same answer.
    settings : mapping
        The solver's own settings, every one of them, defaults filled in.
    """

    system: StackedSystem
    formulation: str
    tolerance: float
    max_iterations: int | None
    time_limit: float | None
    warm_start: Array | None
    facets: int
    presolve: bool
    settings: Mapping[str, Any]


@dataclass(frozen=True)
class Outcome:
    """What a solver found; `gpx_lcp.solve` judges it and makes the Solution.

    Attributes
    ----------
    impulse : (n, rows) array, N s
        The best iterate, finite.
    status : Status
        Why the solver stopped, in its own opinion.
    program : str
        The program it solved, a key of `formulations.RESIDUALS`.
    presolved : tuple or None
        What presolve did, as the core counts it.
    """

    impulse: Array
    status: Status
    program: str
    iterations: int
    setup_seconds: float
    solve_seconds: float
    history: tuple[tuple[int, float], ...] = ()
    fallbacks: tuple[str, ...] = ()
    extras: Mapping[str, Any] = field(default_factory=dict)
    presolved: Counted | None = None


@dataclass(frozen=True)
class Solver:
    """A row of the table of solvers.

    Attributes
    ----------
    programs : mapping
        The formulations it solves, and as which program: {"pyramid": "Stewart-Trinkle LCP"}.
    defaults : mapping or None
        Its own settings and their defaults; any other setting is refused. None passes every setting on to the backend,
        which knows its own.
    native : callable or None
        What the core needs to know to run this solver inside its own time step, with no Python between the stages: its
        kernel and the kernel's settings, from a request whose system counts only by its rows. None steps a world stage
        by stage.
    apart : bool
        Whether it is given the parts that presolve leaves one by one: for methods whose time grows faster than the
        number of unknowns. The others take those of one shape together.
    installed : bool
    install : str
        The command that installs it where it is missing; empty for the solvers of gpx-lcp itself.
    """

    name: str
    method: str
    programs: Mapping[str, str]
    run: Callable[[Request], Outcome]
    warm_starts: bool = False
    defaults: Mapping[str, Any] | None = field(default_factory=dict)
    native: Callable[[Request], dict[str, Any]] | None = None
    apart: bool = False
    installed: bool = True
    install: str = ""

    def default_formulation(self, frictionless: bool) -> str:
        """Return the formulation meant where none is named: the closest to Coulomb's law that this solver solves."""
        if frictionless and "normal" in self.programs:
            return "normal"
        return next(name for name in ("coulomb", "pyramid", "cone", "box", "normal") if name in self.programs)

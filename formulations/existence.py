"""Whether Coulomb's law has a solution at all, in the plane: every way in which the contacts could behave, refuted.

With two rows a contact does one of four things, each of them linear in the impulses, u = A p - B:

    opens       p = 0,                 u_n ≥ 0
    sticks      u = 0,                 |p_t| ≤ μ p_n
    slides ±    u_n = 0,               p_t = ∓μ p_n,    p_n ≥ 0,    ±u_t ≥ 0

What all contacts do makes one linear program, and the law has a solution exactly where one of these programs has a
point. They are looked through as a tree: contact after contact is decided, and those still undecided are held to what
their ways have in common, p ∈ K_μ and u_n ≥ 0. Where that has no point, no way of the others gives it one.

Each program asks for the least t by which all its conditions can be met together, rows of A and B without units
(`StackedSystem.normalised`). A least t above zero refutes, and the least of all is the margin of the proof: no impulses
come closer to the law than that. Nothing here depends on a solver that failed; it is a proof, and it needs up to 4ⁿ
programs for n contacts, so that n must be small.

With friction Newton's law of impact, and the rigid bodies of Painlevé, have such systems where A is singular: the law
is not convex, and no single vector need exist that proves it.

Source: P. Painlevé, *Sur les lois du frottement de glissement*, C. R. Acad. Sci. 121 (1895), that there may be none;
V. Acary, F. Cadoux, C. Lemaréchal, J. Malick, *A formulation of the linear discrete Coulomb friction problem via convex
optimization*, Z. Angew. Math. Mech. 91 (2011), when there is one.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.optimize import linprog

from formulations.checks import Array
from formulations.errors import ProblemError
from formulations.system import StackedSystem

# A program that can be met to this share of B counts as one with a point: above the rounding of a linear program.
ROUNDING: Final = 1e-6
UNDECIDED, OPENS, STICKS, SLIDES, SLIDES_BACK = range(5)
WAYS: Final = (OPENS, STICKS, SLIDES, SLIDES_BACK)


@dataclass(frozen=True)
class Refutation:
    """Proof that Coulomb's law has no solution.

    Attributes
    ----------
    programs : int
        Linear programs without a point that together leave no way for the contacts to behave.
    margin : float
        The least violation among them, relative to B: how far any impulses are from the law, at least.
    """

    programs: int
    margin: float


def refutation(system: StackedSystem) -> Refutation | None:
    """Return the proof that no impulses obey Coulomb's law, or None where some do, to rounding.

    Parameters
    ----------
    system : StackedSystem
        Two rows a contact. The work grows as 4ⁿ at worst; some six contacts take a second.

    Raises
    ------
    ProblemError
        When contacts have other than two rows.
    """
    if system.rows != 2:
        raise ProblemError(
            f"system has {system.rows} rows a contact: the ways of a contact are counted for 2, in a plane"
        )
    if not system.B.any():
        return None
    normalised, _ = system.normalised()
    matrix = normalised.A if isinstance(normalised.A, np.ndarray) else normalised.A.toarray()
    parts = [
        [_Conditions.of(normalised, matrix, contact, way) for way in range(5)] for contact in range(system.contacts)
    ]
    refuted: list[float] = []
    waiting = [(UNDECIDED,) * system.contacts]
    while waiting:
        ways = waiting.pop()
        least = _least_violation([parts[contact][way] for contact, way in enumerate(ways)])
        if least > ROUNDING:
            refuted.append(least)
        elif UNDECIDED not in ways:
            return None
        else:
            next_one = ways.index(UNDECIDED)
            waiting += [(*ways[:next_one], way, *ways[next_one + 1 :]) for way in WAYS]
    return Refutation(len(refuted), min(refuted))


@dataclass(frozen=True)
class _Conditions:
    """Equations E p = f and inequalities G p ≥ h of one contact that behaves in one way."""

    equations: Array
    values: Array
    inequalities: Array
    bounds: Array

    @classmethod
    def of(cls, system: StackedSystem, matrix: Array, contact: int, way: int) -> _Conditions:
        normal, tangent = np.eye(2 * system.contacts)[2 * contact : 2 * contact + 2]
        (u_n, u_t), (b_n, b_t) = (part[2 * contact : 2 * contact + 2] for part in (matrix, system.B))
        mu = float(system.friction[contact])
        cone = [(mu * normal - tangent, 0.0), (mu * normal + tangent, 0.0)]
        sign = 1.0 if way == SLIDES else -1.0
        equations, inequalities = {
            UNDECIDED: ([], [*cone, (normal, 0.0), (u_n, b_n)]),
            OPENS: ([(normal, 0.0), (tangent, 0.0)], [(u_n, b_n)]),
            STICKS: ([(u_n, b_n), (u_t, b_t)], [*cone, (normal, 0.0)]),
        }.get(way, ([(u_n, b_n), (tangent + sign * mu * normal, 0.0)], [(normal, 0.0), (sign * u_t, sign * b_t)]))
        return cls(*_stacked(equations, normal.size), *_stacked(inequalities, normal.size))


def _stacked(conditions: list[tuple[Array, float]], width: int) -> tuple[Array, Array]:
    rows = np.array([row for row, _ in conditions]).reshape(len(conditions), width)
    return rows, np.array([value for _, value in conditions])


def _least_violation(parts: list[_Conditions]) -> float:
    """Return the least t with |E p - f| ≤ t and G p ≥ h - t."""
    equations = np.concatenate([part.equations for part in parts])
    values = np.concatenate([part.values for part in parts])
    inequalities = np.concatenate([part.inequalities for part in parts])
    bounds = np.concatenate([part.bounds for part in parts])
    rows = np.concatenate((equations, -equations, -inequalities))
    right = np.concatenate((values, -values, -bounds))
    found = linprog(
        np.eye(rows.shape[1] + 1)[-1],
        A_ub=np.column_stack((rows, -np.ones(len(rows)))),
        b_ub=right,
        bounds=[(None, None)] * rows.shape[1] + [(0.0, None)],
        method="highs",
    )
    # t as large as B meets everything with p = 0: there is always a least one, unless the arithmetic fails.
    return float(found.fun) if found.status == 0 else 0.0

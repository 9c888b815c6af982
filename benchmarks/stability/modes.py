"""What a failure mode is: a ladder of rungs, the question that each poses, its truth, and a rule to stand or fall by.

A question is a stacked system, which solvers of gpx-lcp alone can be asked, or a scene, which every engine steps. Its
`error` says how far an answer is from the truth in units of what the rule allows: up to 1 it stands.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, TypeAlias

import numpy as np

import gpx_lcp as gpx
from benchmarks.interface import Array, Contacts, Motion, scientific
from benchmarks.measures import Measures
from formulations import FORMULATIONS

TIME_STEP, GRAVITY = 1 / 240, 9.81

EVERY_PROGRAM = frozenset((*FORMULATIONS, "pyramid_qp"))
# The programs that let no contact open as it slides, and those that have Coulomb's law in every direction.
NO_DILATION = frozenset(("coulomb", "box", "pyramid"))
EXACT = frozenset(("coulomb",))


@dataclass(frozen=True)
class SystemQuestion:
    """A stacked system.

    Parameters
    ----------
    system : StackedSystem
    error : callable
        From the impulses, (n, rows) N s, and the contact velocities after them, (n, rows) m/s, to the error.
    feasible : bool
        False where there is no solution: then the right answer is the status INFEASIBLE, and `error` is not asked.
    settings : mapping
        The solver's own, where the ladder is one of them.
    """

    system: gpx.StackedSystem
    error: Callable[[Array, Array], float]
    feasible: bool = True
    settings: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Course:
    """What a simulation did.

    Parameters
    ----------
    path : (steps + 1, bodies, 3) array, m
        Positions from the start on.
    motion : Motion
        At the end.
    contacts : Contacts
        Of the last step.
    measures : Measures
        Of the last step, and of the way from the start.
    time : float, s
    """

    path: Array
    motion: Motion
    contacts: Contacts
    measures: Measures
    time: float


@dataclass(frozen=True)
class SceneQuestion:
    """A scene, stepped.

    Parameters
    ----------
    scene : Scene
    steps : int
    error : callable
        From the course that the bodies took to the error.
    time_step : float, s
    """

    scene: gpx.Scene
    steps: int
    error: Callable[[Course], float]
    time_step: float = TIME_STEP


Question: TypeAlias = SystemQuestion | SceneQuestion


@dataclass(frozen=True)
class Mode:
    """A failure mode.

    Parameters
    ----------
    code : str
        Its number in the list of `benchmarks.stability`.
    title : str
        For the map.
    knob : str
        What grows from rung to rung.
    rungs : sequence of float
        From the easiest on.
    build : callable
        From a rung to its question.
    truth, rule : str
        In words: what is true, and what is near enough.
    frictionless : bool
        Whether the program `normal` is posed, whichever a solver otherwise poses.
    programs : frozenset of str
        Those whose own law gives this truth. Another one that is solved and differs is not wrong, but another law.
    solvers : sequence of str
        Only these, where the ladder is a setting of theirs.
    """

    code: str
    title: str
    knob: str
    rungs: Sequence[float]
    build: Callable[[float], Question]
    truth: str
    rule: str
    frictionless: bool = False
    programs: frozenset[str] = EVERY_PROGRAM
    solvers: Sequence[str] = ()

    @property
    def labels(self) -> tuple[str, ...]:
        """The rungs in words."""
        return tuple(label(rung) for rung in self.rungs)


def label(rung: float) -> str:
    """Return a rung in words, the short way."""
    return f"{rung:g}" if rung == 0.0 or 1e-2 <= abs(rung) < 1e4 else scientific(rung)


def worst(*errors: float) -> float:
    """Return the largest error; infinity where one is not a number."""
    return float(max(np.inf if np.isnan(error) else error for error in errors))


def coulomb_error(system: gpx.StackedSystem, impulse: Array, velocity: Array) -> float:
    """Return how far impulses are from Coulomb's law, line by line of the law, relative to the largest |B|.

    u_n ≥ 0, p_n ≥ 0, one of the two zero; ‖p_t‖ ≤ μ p_n; and u_t zero or p_t = -μ p_n u_t/‖u_t‖. It is written apart
    from the certificate, whose natural map says the same in one expression.
    """
    p, u, mu = system.scale[:, None] * impulse, velocity, system.friction
    slip, hold = np.linalg.norm(u[:, 1:], axis=1), np.linalg.norm(p[:, 1:], axis=1)
    direction = u[:, 1:] / np.where(slip > 0.0, slip, 1.0)[:, None]
    against = np.linalg.norm(p[:, 1:] + (mu * p[:, 0])[:, None] * direction, axis=1)
    errors = (
        -u[:, 0],
        -p[:, 0],
        np.minimum(p[:, 0], u[:, 0]),
        hold - mu * p[:, 0],
        np.minimum(slip, against),
    )
    return worst(*(float(error.max(initial=0.0)) for error in errors)) / float(np.abs(system.B).max())

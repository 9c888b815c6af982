"""What an engine must offer to be compared: make a simulation of a scene, step it, and say what it did.

One engine, one file. Everything that is compared is computed outside the engines (`benchmarks.measures`) from the three
plain records below, so no engine grades itself.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

import gpx_lcp as gpx

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]


@dataclass(frozen=True)
class Setting:
    """One way to run an engine.

    Parameters
    ----------
    engine : str
        Name in the table of engines.
    solver, formulation : str
        What the engine is asked to run; the formulation is the mathematical program that its solver poses.
    label : str
        The knob that trades time for accuracy, in words, e.g. "50 sweeps" or "tolerance 1e-6".
    effort : float
        The knob's value; settings of one line in a chart are joined in the order of effort.
    options : mapping
        What the adapter passes on to the engine.
    first_step_only : bool
        Whether there is nothing to follow: a solver without a simulation around it, or one that costs too much there.
    careful : bool
        Whether it is the most careful of its solver's settings; where none is, that is the one of most effort.
    not_large : bool
        Whether it cannot be asked on scenes of thousands of contacts.
    """

    engine: str
    solver: str
    formulation: str
    label: str
    effort: float
    options: Mapping[str, Any] = field(default_factory=dict)
    first_step_only: bool = False
    careful: bool = False
    not_large: bool = False

    @property
    def line(self) -> tuple[str, str, str]:
        """The settings that differ in effort only."""
        return self.engine, self.solver, self.formulation


@dataclass(frozen=True)
class Motion:
    """Poses and velocities of the moving bodies, in the order in which the scene holds them.

    Parameters
    ----------
    position : (bodies, 3) array, m
    orientation : (bodies, 4) array
        Unit quaternions w, x, y, z.
    velocity : (bodies, 6) array, m/s and rad/s
        Linear, then angular, world frame.
    """

    position: Array
    orientation: Array
    velocity: Array


@dataclass(frozen=True)
class Contacts:
    """The contacts that an engine solved in its last step, with its own impulses.

    Parameters
    ----------
    body_a, body_b : (n,) int arrays
        Indices of moving bodies; -1 for a static one.
    point_a, point_b : (n, 3) arrays, m
        Where the impulse acts on each body: the arms of the engine's own Jacobian.
    normal : (n, 3) array
        Unit vectors from body a to body b.
    gap : (n,) array, m
        Signed distance at the start of the step; negative is penetration.
    friction : (n,) array
    impulse : (n, 3) array, N s
        World frame, on body b.
    """

    body_a: Indices
    body_b: Indices
    point_a: Array
    point_b: Array
    normal: Array
    gap: Array
    friction: Array
    impulse: Array


@dataclass(frozen=True)
class StepFacts:
    """What the engine itself says about its last step; empty where it says nothing.

    Parameters
    ----------
    status : str
        The engine's own word, e.g. "solved" or "max_iterations"; "ran" for an engine that reports no status.
    method : str
        What really ran, where that can be known.
    fallbacks : tuple of str
    iterations, factorisations : int or None
    setup_seconds, solve_seconds : float or None
        Parts of the step, where the engine tells them apart.
    """

    status: str = "ran"
    method: str = ""
    fallbacks: tuple[str, ...] = ()
    iterations: int | None = None
    factorisations: int | None = None
    setup_seconds: float | None = None
    solve_seconds: float | None = None


@dataclass(frozen=True)
class SystemAnswer:
    """What a solver of stacked systems gave.

    Parameters
    ----------
    impulse : (n, rows) array, N s
    seconds : float, s
        Wall time of the solver's call.
    facts : StepFacts
    """

    impulse: Array
    seconds: float
    facts: StepFacts


class GaveUp(Exception):
    """An engine says that it cannot make a step, or not what it did in it: an answer of it, and no error here."""


class Diverged(Exception):
    """What an engine gave is not finite."""


class Simulation(Protocol):
    """A scene inside an engine."""

    def set_gravity(self, gravity: Array) -> None:
        """Set the acceleration of free fall, (3,), m/s², for the steps to come."""

    def step(self) -> None:
        """Advance by one time step. This call, and nothing else, is timed.

        Raises
        ------
        GaveUp
            When the engine itself says that it cannot.
        """

    def motion(self) -> Motion:
        """Return where the moving bodies are now."""

    def contacts(self) -> Contacts:
        """Return the contacts and impulses of the last step.

        Raises
        ------
        GaveUp
            When the engine tells them in part only.
        """

    def facts(self) -> StepFacts:
        """Return what the engine says about the last step."""

    def close(self) -> None:
        """Free the engine's memory."""


class Engine(Protocol):
    """A row in the table of engines."""

    name: str
    install: str
    note: str

    def version(self) -> str:
        """Return the installed version, or "" when the engine is missing."""

    def settings(self, quick: bool) -> Sequence[Setting]:
        """Return the ways in which a suite runs this engine; a few of them when `quick`."""

    def sweeping(self, sweeps: int) -> Sequence[Setting]:
        """Return the settings that make exactly so many sweeps over the contacts; none without a sweeping solver."""

    def simulate(self, scene: gpx.Scene, time_step: float, setting: Setting, time_limit: float) -> Simulation:
        """Build the scene inside the engine; one step may take `time_limit` seconds where the engine can be told so.

        Raises
        ------
        SettingsError
            When the engine cannot be set up to solve this scene as it is.
        """


class SystemEngine(Engine, Protocol):
    """An engine that solves stacked systems, too, without a scene around them."""

    def answer(self, system: gpx.StackedSystem, setting: Setting, time_limit: float) -> SystemAnswer:
        """Solve a system from nothing; `time_limit`, s, holds where the engine can be told so.

        Raises
        ------
        SettingsError
            When the engine cannot be asked this system as it is.
        """


def scientific(value: float) -> str:
    """Return a small number the short way, "1e-6"."""
    mantissa, exponent = f"{value:e}".split("e")
    return f"{float(mantissa):g}e{int(exponent)}"

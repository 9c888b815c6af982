"""What a suite gives the harness, and gets back: attempts, in batches that are measured side by side, and outcomes.

A suite is one row of the table in `benchmarks.suites`. It says which batches there are; a batch, opened, makes one
attempt at a time and says what came out. Repeats, clocks, failures, Ctrl-C, rows, files, resuming and the cluster are
the harness's business and the same for all.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Protocol, TypeAlias

from rich.table import Table
from rich.text import Text

import gpx_lcp as gpx
from benchmarks.interface import Array

if TYPE_CHECKING:
    from benchmarks.records import Record

OWN = "gpx-lcp"
COLD = "cold"

# The figure of a suite that compares solvers of programs that are not the exact law: it judges by the program.
PROGRAM_RESIDUAL = "program_residual"

# What the status of a row may be besides the engine's own word.
INTERRUPTED, MISSING, REFUSED, ERROR, UNREADABLE = "interrupted", "missing", "refused", "error", "unreadable"
GAVE_UP, DIVERGED = "gave up", "diverged"

# A figure of a suite's own, a column of its rows.
Figure: TypeAlias = float | int | bool | str | None


@dataclass(frozen=True)
class Attempt:
    """One question: who is to solve what, and how well. Every attempt is answered by a row for each case.

    Parameters
    ----------
    suite, scene : str
        The scene's name says its size and its parameters.
    solver, formulation : str
    setting : str
        What sets it apart from other attempts of the same solver, in words, e.g. "50 sweeps" or "tolerance 1e-6".
    effort : float
        The setting's value: points of one line in a chart are joined in the order of effort.
    tolerance : float or None
        Bound on the natural map of the certificate, by which the attempt is judged, or on the residual of the program
        where the row has a figure `PROGRAM_RESIDUAL`; None for a setting that promises none.
    engine : str
    engine_version : str
    seed : int
        Of what is random in the scene; 0 where nothing is.
    """

    suite: str
    scene: str
    solver: str
    formulation: str
    setting: str = ""
    effort: float = 0.0
    tolerance: float | None = None
    engine: str = OWN
    engine_version: str = ""
    seed: int = 0

    @property
    def key(self) -> tuple[str, ...]:
        """What no two attempts share."""
        return (self.scene, str(self.seed), self.engine, self.solver, self.formulation, self.setting)

    @property
    def label(self) -> str:
        """The attempt in words, for the progress bar."""
        return f"{self.scene}: {self.engine} {self.solver} {self.formulation} {self.setting}"


@dataclass(frozen=True)
class FileRecipe:
    """A system that is kept as the problem file that holds it, and the file's SHA-256."""

    path: str
    sha256: str


@dataclass(frozen=True)
class Answer:
    """The impulses of an attempt and the system that they answer, kept so that `check` can certify them again.

    Parameters
    ----------
    system : StackedSystem or FileRecipe
        One object for all attempts on the same system: it is stored once.
    impulse : (n, rows) array, N s
    program : str
        The program that the solver solved on this very system, as in `formulations.RESIDUALS`; "" where the system was
        put together from outside, so that the solver's own word cannot be held against it.
    facets : int
    history : sequence of (int, float)
        Residual of the program after so many iterations, where the solver tells.
    """

    system: gpx.StackedSystem | FileRecipe
    impulse: Array
    program: str = ""
    facets: int = 0
    history: Sequence[tuple[int, float]] = ()


@dataclass(frozen=True)
class Outcome:
    """What one trial of an attempt gave, in one case.

    Parameters
    ----------
    step_seconds : sequence of float, s
        Wall time of each timed call, from outside; one for each time step, or a single one.
    setup_seconds, solve_seconds : float or None, s
        Parts of it, where the solver tells them apart.
    case : str
        One of the batch's cases, e.g. "cold".
    status : str
        The solver's own word.
    bodies, contacts : int or None
    steps, steps_asked : int
        Time steps made, unless given one for each timed call, and asked for.
    iterations, factorisations : float or None
        Mean per step.
    certificate : Certificate or None
        The one that the row states; of several steps, that with the largest natural map.
    reached : bool or None
        Whether what was asked for was reached, judged from outside; None where nothing was asked.
    answer : Answer or None
        What `certificate` judged.
    figures : mapping
        Columns of the suite's own.
    again : bool
        Whether repeats are worth their time.
    """

    step_seconds: Sequence[float] = ()
    setup_seconds: float | None = None
    solve_seconds: float | None = None
    case: str = COLD
    status: str = "ran"
    message: str = ""
    method: str = ""
    fallbacks: Sequence[str] = ()
    bodies: int | None = None
    contacts: int | None = None
    steps: int | None = None
    steps_asked: int = 1
    iterations: float | None = None
    factorisations: float | None = None
    certificate: gpx.Certificate | None = None
    reached: bool | None = None
    answer: Answer | None = None
    figures: Mapping[str, Figure] = field(default_factory=dict)
    again: bool = True


class Bench(Protocol):
    """A batch with its scene built or its file read."""

    def try_once(self, attempt: Attempt, first: bool, seconds_left: float) -> Sequence[Outcome]:
        """Make one trial and return an outcome for each case.

        Parameters
        ----------
        first : bool
            Only the first trial of an attempt is judged; of the others nothing is looked at but their times.
        seconds_left : float, s
            Of the attempt's time.

        Raises
        ------
        Exception
            Of any kind: it becomes the attempt's status, "refused" for a SettingsError, "gave up" and "diverged" for
            what an engine did itself, and "error" for others.
        """


class Batch(Protocol):
    """Attempts on one scene, whose repeats are interleaved on one machine: what is compared is measured side by side.

    A batch is pickled and sent to the process that measures it, so it holds names and numbers, not scenes.
    """

    name: str
    attempts: Sequence[Attempt]
    repeats: int
    # For all trials of one attempt, s; the first is always made.
    time_limit: float

    @property
    def cases(self) -> Sequence[str]:
        """The rows that each attempt gives."""

    def open(self) -> Bench:
        """Build the scene or read the file; an exception makes every attempt's status "unreadable"."""

    def only(self, attempts: Sequence[Attempt]) -> Batch:
        """Return the batch with these of its attempts."""


class Suite(Protocol):
    """A row in the table of suites.

    Attributes
    ----------
    name, summary : str
    not_shown : str
        The last words of every report: what its figures do not say.
    """

    name: str
    summary: str
    not_shown: str

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Add what this suite takes, beyond --resume, --out and --scheduler."""

    def scenes(self) -> Mapping[str, str]:
        """Return the name of each scene, and what it is."""

    def batches(self, asked: argparse.Namespace, folder: Path) -> Sequence[Batch]:
        """Return what the arguments ask for; none where nothing that is installed can do it.

        `folder` is where the results go: what tables and charts need besides the rows may be left there.

        Raises
        ------
        SettingsError
            When they name what is not there.
        """

    def batch_tables(self, records: Sequence[Record]) -> Sequence[Table]:
        """Return the tables to be shown as soon as a batch is measured; there may be none."""

    def tables(self, records: Sequence[Record], folder: Path) -> Sequence[Table | Text]:
        """Return the tables of all rows."""

    def draw(self, records: Sequence[Record], folder: Path, out: Path, footer: str) -> Sequence[Path]:
        """Write the charts of all rows to `out`, each as PNG and SVG, and return their paths."""

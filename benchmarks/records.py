"""One row per attempt and case, failures too: what was asked, what came out, and where it was measured."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields

import gpx_lcp as gpx
from benchmarks.attempts import COLD, ERROR, INTERRUPTED, MISSING, UNREADABLE, Figure

# The measures of the certificate, as columns.
CERTIFICATE = tuple(measure.name for measure in fields(gpx.Certificate) if measure.repr)

# A row of such a status is measured again by --resume.
UNFINISHED = frozenset({INTERRUPTED, MISSING})
FAILURES = frozenset({ERROR, UNREADABLE})


@dataclass(frozen=True)
class Record:
    """A row.

    Parameters
    ----------
    suite, scene, ..., tolerance
        As in `Attempt`.
    case : str
        "cold": from nothing. Others are the suite's own, e.g. "stepped": the warm steps after the first.
    status : str
        The solver's own word for the worst step ("ran" where it reports none); or "missing" (the engine), "unreadable"
        (the file), "refused" (by the solver's own error), "gave up" (the engine, by an exception of its own),
        "diverged" (to what is not finite), "error" (an unexpected exception), "interrupted" (by Ctrl-C; figures are
        those of the trials until then).
    reached : bool or None
        Whether what was asked for was reached, judged from outside.
    repeats : int
        Trials made. Of several the first is judged, and the others are timed.
    step_seconds : float, s
        Wall time of the timed call from outside: median over the timed trials of each step, then the mean over steps.
    setup_seconds, solve_seconds : float, s
        Parts of it as the solver reports them, medians over trials that tell; None where none does.
    ..._low, ..._high : float, s
        The same from the fastest and the slowest trial: the noise.
    iterations, factorisations : float
        Mean per step.
    peak_memory : int, bytes
        Largest resident size of the whole process during the first trial.
    answer : str
        Where the impulses are kept: "file:index"; "" where there are none.
    certificate : mapping
        The measures of `CERTIFICATE`; empty where nothing was certified.
    figures : mapping
        Columns of the suite's own.
    where : mapping
        Machine, versions, build profile, revision, host, time.
    """

    suite: str
    scene: str
    seed: int
    engine: str
    engine_version: str
    solver: str
    formulation: str
    setting: str
    effort: float
    tolerance: float | None
    case: str = COLD
    status: str = INTERRUPTED
    message: str = ""
    reached: bool | None = None
    method: str = ""
    fallbacks: str = ""
    bodies: int | None = None
    contacts: int | None = None
    repeats: int = 0
    steps: int = 0
    steps_asked: int = 0
    step_seconds: float | None = None
    step_seconds_low: float | None = None
    step_seconds_high: float | None = None
    setup_seconds: float | None = None
    solve_seconds: float | None = None
    solve_seconds_low: float | None = None
    solve_seconds_high: float | None = None
    iterations: float | None = None
    factorisations: float | None = None
    peak_memory: int | None = None
    answer: str = ""
    certificate: Mapping[str, float | int | None] = field(default_factory=dict)
    figures: Mapping[str, Figure] = field(default_factory=dict)
    where: Mapping[str, str] = field(default_factory=dict)

    @property
    def attempt_key(self) -> tuple[str, ...]:
        """The key of the attempt."""
        return (self.scene, str(self.seed), self.engine, self.solver, self.formulation, self.setting)

    @property
    def key(self) -> tuple[str, ...]:
        """What no two rows of one run share."""
        return (self.suite, *self.attempt_key, self.case)

    @property
    def measured(self) -> bool:
        """Whether the attempt came as far as a measured step."""
        return self.step_seconds is not None

    @property
    def finished(self) -> bool:
        """Whether there is no reason to measure it again."""
        return self.status not in UNFINISHED

    @property
    def failed(self) -> bool:
        """Whether it ended in an error."""
        return self.status in FAILURES

    @property
    def natural_map(self) -> float | None:
        """The natural map of the certificate."""
        return self.certificate.get("natural_map")

    @property
    def step_ms(self) -> float | None:
        """`step_seconds` in milliseconds."""
        return None if self.step_seconds is None else 1e3 * self.step_seconds

    @property
    def cut_short(self) -> bool:
        """Whether the time limit ended the simulation before it was settled."""
        return self.measured and self.steps < self.steps_asked

    @property
    def frictionless(self) -> bool:
        """Whether the program leaves friction out: an easier question, not to be ranked with the others."""
        return self.formulation == "normal"

    @property
    def line(self) -> tuple[str, str, str]:
        """The settings that differ in effort only."""
        return self.engine, self.solver, self.formulation

    def figure(self, name: str) -> float | None:
        """Return one of the suite's own numbers, or None where it was not measured."""
        value = self.figures.get(name)
        return None if value is None else float(value)


def certificate_columns(certificate: gpx.Certificate) -> dict[str, float | int | None]:
    """Return the measures of a certificate by name."""
    return {name: getattr(certificate, name) for name in CERTIFICATE}

"""Climbs ladders: one attempt is one solver on one failure mode, from the easiest rung up to the first that breaks it.

How a rung ends, judged from outside:

    stands            the answer is near the truth, and whoever gave it claims nothing less
    another law       the program posed is not Coulomb's law here, and the answer is off; for gpx-lcp that program's own
                      residual shows that it is solved, and the certificate says how far from Coulomb's law that is
    says so           the status admits the failure, or the question was answered by an error
    too slow          the time limit of the rung came first
    diverges          not finite, or far beyond every scale, without a word
    wrong silently    success is claimed (SOLVED; an engine that reports nothing claims it), and the rule is broken
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence, Set
from contextlib import closing
from dataclasses import dataclass, replace

import numpy as np

import gpx_lcp as gpx
from benchmarks import engines
from benchmarks.attempts import COLD, OWN, REFUSED, Answer, Attempt, Figure, Outcome
from benchmarks.bodies import Bodies
from benchmarks.interface import Setting, StepFacts
from benchmarks.measures import measure
from benchmarks.measuring import failure
from benchmarks.simulating import of_facts, worst_status
from benchmarks.stability.modes import Course, Mode, SceneQuestion, SystemQuestion
from benchmarks.stability.table import MODES
from formulations import DEFAULT_FACETS

STANDS, OTHER_LAW, SAYS_SO = "stands", "another law", "says so"
TOO_SLOW, DIVERGES, SILENT = "too slow", "diverges", "wrong silently"
NOT_CLIMBED, NOT_ASKED = "not climbed", REFUSED

SOLVED, INFEASIBLE, RAN = "solved", "infeasible", "ran"

# An answer that many times as far off as its rule allows is no answer to the question.
DIVERGED = 1e6


@dataclass(frozen=True)
class Told:
    """What came back from a rung, before it is judged.

    Parameters
    ----------
    status : str
        The solver's own word.
    error : float
        In units of what the rule allows; infinity where the answer is not finite.
    programs : set of str
        What was posed, as in `formulations.RESIDUALS`.
    late : bool
        Whether the time was up before the answer was there.
    """

    status: str
    error: float
    programs: Set[str]
    late: bool = False


def judge(mode: Mode, told: Told, feasible: bool = True) -> str:
    """Return how a rung ended."""
    if told.late:
        return TOO_SLOW
    if told.status == INFEASIBLE:
        # A proof that there is nothing, where there is something, is a false claim, too.
        return SILENT if feasible else STANDS
    if told.status not in (SOLVED, RAN):
        return SAYS_SO
    if told.error <= 1.0:
        return STANDS
    if math.isfinite(told.error) and not told.programs <= mode.programs:
        return OTHER_LAW
    return SILENT if told.error <= DIVERGED else DIVERGES


@dataclass(frozen=True)
class ModeBatch:
    """A failure mode, climbed by several solvers; each rung is a case.

    Parameters
    ----------
    settings : sequence of Setting or None
        One for each attempt; None for an engine that is missing.
    rung_limit : float, s
        Time of a rung.
    stride : int
        1 for every rung, 2 for every other one, up to the last.
    most : int or None
        So many rungs, from the easiest on.
    """

    name: str
    attempts: Sequence[Attempt]
    settings: Sequence[Setting | None]
    rung_limit: float
    stride: int = 1
    most: int | None = None
    repeats: int = 1

    @property
    def mode(self) -> Mode:
        """The failure mode."""
        return MODES[self.name]

    @property
    def rungs(self) -> Sequence[float]:
        """The rungs that are climbed, the last one always."""
        return self.mode.rungs[:: -self.stride][::-1][: self.most]

    @property
    def cases(self) -> Sequence[str]:
        """The rungs in words."""
        return self.mode.labels[:: -self.stride][::-1][: self.most]

    @property
    def time_limit(self) -> float:
        """Of the whole ladder, s."""
        return self.rung_limit * len(self.rungs)

    def open(self) -> Ladder:
        """Return the ladder; a question is made when first asked."""
        return Ladder(self)

    def only(self, attempts: Sequence[Attempt]) -> ModeBatch:
        """Return the batch with these of its attempts."""
        keys = {attempt.key for attempt in attempts}
        pairs = [pair for pair in zip(self.attempts, self.settings, strict=True) if pair[0].key in keys]
        return replace(self, attempts=[pair[0] for pair in pairs], settings=[pair[1] for pair in pairs])


class Ladder:
    """The questions of a mode, each made once: who answers the same system shares it."""

    def __init__(self, batch: ModeBatch) -> None:
        self._batch = batch
        self._questions: dict[float, SystemQuestion | SceneQuestion] = {}
        self._settings = {attempt.key: setting for attempt, setting in zip(batch.attempts, batch.settings, strict=True)}

    def try_once(self, attempt: Attempt, first: bool, seconds_left: float) -> Sequence[Outcome]:
        """Climb until a rung breaks, and return an outcome for each rung."""
        setting = self._settings[attempt.key]
        if setting is None:
            raise gpx.BackendMissing(engines.ENGINES[attempt.engine].install)
        outcomes: list[Outcome] = []
        broken = ""
        for rung, case in zip(self._batch.rungs, self._batch.cases, strict=True):
            if broken:
                outcomes.append(Outcome(case=case, status=NOT_CLIMBED, figures=_figures(broken, None)))
                continue
            outcome = self._ask(rung, setting)
            if outcome.figures["outcome"] != STANDS:
                broken = NOT_ASKED if outcome.figures["outcome"] == NOT_ASKED else NOT_CLIMBED
            outcomes.append(replace(outcome, case=case))
        return outcomes

    def _ask(self, rung: float, setting: Setting) -> Outcome:
        if rung not in self._questions:
            self._questions[rung] = self._batch.mode.build(rung)
        question = self._questions[rung]
        ask = solve if isinstance(question, SystemQuestion) else simulate
        try:
            return ask(self._batch.mode, question, setting, self._batch.rung_limit)  # type: ignore[operator]
        except gpx.SettingsError as error:
            # An adapter that cannot rebuild the scene: this engine is not asked.
            return Outcome(status=REFUSED, message=str(error), figures=_figures(NOT_ASKED, None))
        except Exception as error:
            # Nothing else may be lost because one solver breaks on one rung; an exception is a word of failure.
            status, message = failure(error)
            return Outcome(status=status, message=message, figures=_figures(SAYS_SO, None))


def solve(mode: Mode, question: SystemQuestion, setting: Setting, time_limit: float) -> Outcome:
    """Ask a solver for a system, from nothing."""
    system, engine = question.system, engines.SYSTEM_ENGINES[setting.engine]
    asked = replace(setting, options={**setting.options, **question.settings})
    answer = engine.answer(system, asked, time_limit)
    facts, impulse = answer.facts, answer.impulse
    program = facts.method.split("/")[0]
    error = question.error(impulse, system.velocity(impulse)) if np.isfinite(impulse).all() else math.inf
    # Backends look at their clocks now and then: what is solved soon after the limit counts.
    late = answer.seconds > (2.0 if facts.status == SOLVED else 0.9) * time_limit
    told = Told(facts.status, error, {program}, late)
    outcome = Outcome(
        step_seconds=(answer.seconds,),
        case=COLD,
        status=facts.status,
        method=facts.method,
        contacts=system.contacts,
        figures=_figures(judge(mode, told, question.feasible), error),
        **of_facts([facts]),
    )
    if not np.isfinite(impulse).all():
        return outcome
    certificate = gpx.certify(system, impulse)
    return replace(outcome, certificate=certificate, answer=Answer(system, impulse, program, DEFAULT_FACETS))


def simulate(mode: Mode, question: SceneQuestion, setting: Setting, time_limit: float) -> Outcome:
    """Let an engine step a scene; it ends at the first step beyond the time limit, or that is not finite.

    The limit is processor time: 'too slow' should not depend on what else the machine does.
    """
    bodies = Bodies.from_scene(question.scene)
    seconds: list[float] = []
    told_of: list[StepFacts] = []
    engine = engines.ENGINES[setting.engine]
    start = time.process_time()
    with closing(engine.simulate(question.scene, question.time_step, setting, time_limit)) as simulation:
        path = [bodies.start.position]
        before = after = simulation.motion()
        while len(seconds) < question.steps and (not seconds or time.process_time() - start <= time_limit):
            before = after
            tick = time.perf_counter()
            simulation.step()
            seconds.append(time.perf_counter() - tick)
            told_of.append(simulation.facts())
            after = simulation.motion()
            path.append(after.position)
            if not all(np.isfinite(part).all() for part in (after.position, after.velocity)):
                break
        contacts = simulation.contacts()
    status, methods = worst_status(told_of), [facts.method for facts in told_of]
    outcome = Outcome(
        step_seconds=seconds,
        status=status,
        method=methods[-1],
        bodies=bodies.count,
        contacts=contacts.gap.size,
        steps=len(seconds),
        steps_asked=question.steps,
        **of_facts(told_of),
    )
    programs = {method.split("/")[0] if setting.engine == OWN else setting.formulation for method in methods}
    whole = len(seconds) == question.steps
    motion = np.concatenate((after.position.ravel(), after.velocity.ravel(), contacts.impulse.ravel()))
    if not np.isfinite(motion).all():
        told = Told(status, math.inf, programs)
        return replace(outcome, figures=_figures(judge(mode, told), math.inf))
    measures = measure(bodies, before, after, contacts, question.time_step)
    error = math.inf
    if whole:
        course = Course(np.array(path), after, contacts, measures, question.steps * question.time_step)
        error = question.error(course)
    told = Told(status, error, programs, not whole)
    certificate = measures.certificate
    return replace(
        outcome,
        certificate=certificate,
        answer=Answer(certificate.system, certificate.impulse),
        figures=_figures(judge(mode, told), error),
    )


def _figures(outcome: str, error: float | None) -> dict[str, Figure]:
    return {"outcome": outcome, "error": error}

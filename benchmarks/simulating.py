"""Measures simulations: a scene, with every setting of every engine, is a batch of two cases.

**cold** is the first step of a fresh simulation; **stepped** the last quarter of the warm steps after it.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from benchmarks import engines, stacks
from benchmarks.attempts import COLD, Answer, Attempt, Outcome
from benchmarks.bodies import Bodies
from benchmarks.interface import Setting, StepFacts
from benchmarks.measures import Measures, measure
from benchmarks.measuring import failure

STEPPED = "stepped"

# Of the settled steps, about so many are judged: reading and judging contacts takes longer than most steps.
JUDGED = 12

# After some warm steps and a share of its time, a simulation is given up when at the pace of its warm steps it would
# take twice the time that is left: it would not end.
GIVE_UP_STEPS, GIVE_UP_SHARE, GIVE_UP_EXCESS = 3, 0.1, 2.0


@dataclass(frozen=True)
class SceneBatch:
    """Every setting on one scene of `benchmarks.stacks`.

    Parameters
    ----------
    name : str
        The scene.
    settings : mapping
        The setting of each attempt, by its key; none for an engine that is missing.
    repeats : int
        Fresh simulations of each setting.
    steps : int
        Warm steps after the cold first one. The last quarter of them are the settled ones, which are timed and judged
        as the case "stepped"; a simulation that the time limit ends earlier is timed over all its warm steps.
    time_limit : float
        Wall time for all repeats of one setting, s. A simulation stops at the first step that ends beyond it, and much
        earlier where it has no chance. The first step is always made.
    """

    name: str
    attempts: Sequence[Attempt]
    settings: Mapping[tuple[str, ...], Setting]
    repeats: int
    steps: int
    time_limit: float

    @property
    def cases(self) -> Sequence[str]:
        """The first step, and the settled ones."""
        return (COLD, STEPPED)

    @property
    def settled_from(self) -> int:
        """The last step before the settled ones."""
        return self.steps - max(1, self.steps // 4)

    def judges(self, step: int) -> bool:
        """Whether a step is judged."""
        stride = max(1, (self.steps - self.settled_from) // JUDGED)
        return step == 0 or (step > self.settled_from and (self.steps - step) % stride == 0)

    def open(self) -> SceneBench:
        """Build the scene."""
        return SceneBench(self)

    def only(self, attempts: Sequence[Attempt]) -> SceneBatch:
        """Return the batch with these of its attempts."""
        return replace(self, attempts=attempts)


@dataclass
class Trial:
    """One simulation: the wall time of each step, what the engine says of it, and what was judged, by step."""

    seconds: list[float] = field(default_factory=list)
    facts: list[StepFacts] = field(default_factory=list)
    judged: dict[int, Measures] = field(default_factory=dict)
    contacts: dict[int, int] = field(default_factory=dict)

    @property
    def made(self) -> int:
        """Warm steps made."""
        return max(0, len(self.seconds) - 1)


class SceneBench:
    """A scene that was built."""

    def __init__(self, batch: SceneBatch) -> None:
        self._batch = batch
        self._kind = stacks.SCENES[batch.name]
        self._scene = self._kind.make()
        self._bodies = Bodies.from_scene(self._scene)
        # Whether the first trial of an attempt made all its steps, so that the others are timed over the same ones.
        self._whole: dict[tuple[str, ...], bool] = {}

    def try_once(self, attempt: Attempt, first: bool, seconds_left: float) -> Sequence[Outcome]:
        """Run one simulation."""
        engines.require_installed(attempt.engine)
        setting, trial, failed = self._batch.settings[attempt.key], Trial(), ("", "")
        try:
            self._simulate(trial, setting, first, not self._whole.get(attempt.key, True), seconds_left)
        except Exception as error:
            # What was measured before an engine broke down is kept.
            if not trial.seconds:
                raise
            failed = failure(error)
        if first:
            self._whole[attempt.key] = trial.made == self._batch.steps
        warm = slice(self._batch.settled_from + 1 if self._whole[attempt.key] else 1, None)
        cold = self._outcome(trial, COLD, slice(0, 1), failed)
        return cold, self._stepped(trial, setting, warm, failed)

    def _simulate(self, trial: Trial, setting: Setting, judging: bool, cut: bool, limit: float) -> None:
        """Fill a trial: judged or timed alone, of all its steps or, where `cut`, of the first one."""
        batch, gravity = self._batch, self._kind.gravity()
        engine, bodies = engines.ENGINES[setting.engine], self._bodies
        # A setting that did not come to its settled steps once would not do so again.
        steps = 0 if setting.first_step_only or cut else batch.steps
        with closing(engine.simulate(self._scene, stacks.TIME_STEP, setting, batch.time_limit)) as simulation:
            start = warm_start = time.perf_counter()
            for step in range(steps + 1):
                now = time.perf_counter()
                warm_start = now if step == 1 else warm_start
                late = now - start > limit or _hopeless(now - warm_start, step - 1, steps, limit - (now - start), limit)
                if late and step == 1:
                    break  # the cold step alone took all there was: no stepped case
                last = late or step == steps
                if gravity is not None:
                    pull = gravity(step * stacks.TIME_STEP)
                    simulation.set_gravity(pull)
                    bodies = replace(bodies, gravity=pull)
                before = simulation.motion() if judging and (batch.judges(step) or last) else None
                tick = time.perf_counter()
                simulation.step()
                trial.seconds.append(time.perf_counter() - tick)
                if judging:
                    trial.facts.append(simulation.facts())
                if before is not None:
                    contacts = simulation.contacts()
                    trial.judged[step] = measure(bodies, before, simulation.motion(), contacts, stacks.TIME_STEP)
                    trial.contacts[step] = contacts.gap.size
                if last and step > 0:
                    break

    def _stepped(self, trial: Trial, setting: Setting, part: slice, failed: tuple[str, str]) -> Outcome:
        """Return the outcome of the warm steps, or why there is none."""
        if trial.made:
            outcome = self._outcome(trial, STEPPED, part, failed)
            short = trial.made < self._batch.steps
            note = f"time limit: {trial.made} of {self._batch.steps} steps" if short else ""
            return replace(
                outcome,
                message="; ".join(filter(None, (outcome.message, note))),
                steps=trial.made,
                steps_asked=self._batch.steps,
            )
        if failed[0]:
            return Outcome(case=STEPPED, status=failed[0], message=failed[1])
        if setting.first_step_only:
            return Outcome(case=STEPPED, status="first step only")
        limit = f"the cold step alone took {self._batch.time_limit:g} s"
        return Outcome(case=STEPPED, status="time limit", message=limit)

    def _outcome(self, trial: Trial, case: str, part: slice, failed: tuple[str, str]) -> Outcome:
        """Return the outcome of a part of the steps."""
        outcome = Outcome(case=case, step_seconds=trial.seconds[part], again=not failed[0])
        facts = trial.facts[part]
        if not facts:  # of a trial that is there for its times
            return outcome
        outcome = replace(outcome, status=failed[0] or worst_status(facts), message=failed[1], **of_facts(facts))
        judged = {step: found for step, found in trial.judged.items() if (step == 0) == (case == COLD)}
        if not judged:
            return outcome
        certificate = max((found.certificate for found in judged.values()), key=lambda c: c.natural_map)
        return replace(
            outcome,
            method=facts[-1].method,
            bodies=self._bodies.count,
            contacts=trial.contacts[max(judged)],
            certificate=certificate,
            answer=Answer(certificate.system, certificate.impulse),
            figures=self._worst(list(judged.values())),
        )

    def _worst(self, judged: Sequence[Measures]) -> dict[str, float | None]:
        """Return the largest value of each measure that has a truth here, and the time step."""
        figures = [found.figures() for found in judged]
        worst: dict[str, float | None] = {name: max(each[name] for each in figures) for name in figures[0]}
        worst["time_step"] = stacks.TIME_STEP
        if not self._kind.at_rest:
            worst |= dict.fromkeys(("load_error", "body_error", "drift"))
        return worst


def _hopeless(spent: float, made: int, steps: int, left: float, limit: float) -> bool:
    """Whether `made` warm steps of `steps`, in `spent` seconds, show that `left` seconds will not do for the rest."""
    if made < GIVE_UP_STEPS or spent < GIVE_UP_SHARE * limit:
        return False
    return spent / made * (steps - made) > GIVE_UP_EXCESS * left


def of_facts(facts: Sequence[StepFacts]) -> dict[str, Any]:
    """Return the fields of an Outcome that engines tell themselves: every fallback, and means over the steps."""
    means = ("setup_seconds", "solve_seconds", "iterations", "factorisations")
    return {
        "fallbacks": tuple(dict.fromkeys(name for fact in facts for name in fact.fallbacks)),
        **{name: _mean([getattr(fact, name) for fact in facts]) for name in means},
    }


def worst_status(facts: Sequence[StepFacts]) -> str:
    """Return the first status that is not a success, else the common one."""
    return next((fact.status for fact in facts if fact.status not in ("ran", "solved")), facts[-1].status)


def _mean(values: Sequence[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return float(np.mean(known)) if known else None

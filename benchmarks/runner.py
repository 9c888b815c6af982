"""Runs attempts: interleaved repeats, one timed call per step, one row per attempt and case, failures too."""

from __future__ import annotations

import gc
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime

import numpy as np

import gpx_lcp as gpx
from benchmarks.bodies import Bodies
from benchmarks.interface import Array, Engine, Setting, StepFacts
from benchmarks.measures import Measures, measure
from benchmarks.rows import Row

CASES = ("cold", "stepped")

# Of the settled steps, about so many are judged: reading and judging contacts takes longer than most steps.
JUDGED = 12

# After some warm steps and a share of its time, a simulation is given up when at the pace of its warm steps it would
# take twice the time that is left: it would not end.
GIVE_UP_STEPS, GIVE_UP_SHARE, GIVE_UP_EXCESS = 3, 0.1, 2.0


@dataclass(frozen=True)
class Plan:
    """How much is run.

    Parameters
    ----------
    time_step : float
        The same for every engine, s.
    repeats : int
        Fresh simulations of each setting, interleaved: every setting once, then every setting again.
    steps : int
        Warm steps after the cold first one. The last quarter of them are the settled ones, which are timed and judged
        as the case "stepped"; a simulation that the time limit ends earlier is timed over all its warm steps.
    time_limit : float
        Wall time for all repeats of one setting on one scene, s. A simulation stops at the first step that ends beyond
        it, and much earlier where it has no chance; a further repeat starts only when another like the last one would
        fit. The first step is always made.
    gravity : callable, optional
        Acceleration of free fall, (3,), m/s², in the step that starts at a time, s; unless given, that of the scene.
    at_rest : bool
        Whether nothing should move. Where bodies move on their own, loads, balance and drift have no truth to be held
        against, and only the certificate judges.
    """

    time_step: float
    repeats: int
    steps: int
    time_limit: float
    gravity: Callable[[float], Array] | None = None
    at_rest: bool = True

    @property
    def settled_from(self) -> int:
        """The last step before the settled ones."""
        return self.steps - max(1, self.steps // 4)

    def judges(self, step: int) -> bool:
        """Whether a step is judged."""
        stride = max(1, (self.steps - self.settled_from) // JUDGED)
        return step == 0 or (step > self.settled_from and (self.steps - step) % stride == 0)


@dataclass
class Trial:
    """One simulation: the wall time of each step call, and the measures of the first step and of the last ones.

    Only the first trial of an attempt is measured: the engines are deterministic, and reading contacts between timed
    steps costs time and warms caches.
    """

    seconds: list[float] = field(default_factory=list)
    facts: list[StepFacts] = field(default_factory=list)
    cold: Measures | None = None
    settled: list[Measures] = field(default_factory=list)
    contacts: list[int] = field(default_factory=list)


@dataclass
class Attempt:
    """Every trial of one setting on one scene."""

    setting: Setting
    trials: list[Trial] = field(default_factory=list)
    spent: float = 0.0
    last: float = 0.0
    status: str = ""
    message: str = ""

    def wants_more(self, plan: Plan) -> bool:
        """Whether another trial is due."""
        if self.status or len(self.trials) >= plan.repeats:
            return False
        return not self.trials or self.spent + self.last <= plan.time_limit


def run_scene(
    name: str,
    scene: gpx.Scene,
    engines: Mapping[str, Engine],
    settings: Sequence[Setting],
    plan: Plan,
    advance: Callable[[str], None],
) -> Iterator[list[Row]]:
    """Run every setting on one scene; yield the rows once, also when Ctrl-C stops the run, which is then raised again.

    `advance(text)` is called before each trial, `plan.repeats` times per setting.
    """
    bodies = Bodies.from_scene(scene)
    attempts = [Attempt(setting) for setting in settings]
    try:
        for _ in range(plan.repeats):
            for attempt in attempts:
                setting = attempt.setting
                advance(f"{name}: {setting.engine} {setting.solver} {setting.label}")
                if attempt.wants_more(plan):
                    _try_once(attempt, scene, bodies, engines[setting.engine], plan)
    except KeyboardInterrupt:
        yield rows_of(name, bodies, attempts, engines, plan)
        raise
    yield rows_of(name, bodies, attempts, engines, plan)


def _try_once(attempt: Attempt, scene: gpx.Scene, bodies: Bodies, engine: Engine, plan: Plan) -> None:
    """Run one trial; an engine's refusal or failure becomes the attempt's status, never an exception of the harness."""
    start = time.perf_counter()
    trial = Trial()
    try:
        _simulate(trial, scene, bodies, engine, attempt, plan)
    except Exception as error:
        # One engine that breaks on one scene must not lose the others' results.
        attempt.status, attempt.message = failure(error)
    if trial.seconds:
        attempt.trials.append(trial)
    attempt.last = time.perf_counter() - start
    attempt.spent += attempt.last


def _simulate(trial: Trial, scene: gpx.Scene, bodies: Bodies, engine: Engine, attempt: Attempt, plan: Plan) -> None:
    limit = plan.time_limit - attempt.spent
    measured = not attempt.trials
    # A setting that did not come to its settled steps once would not do so again.
    cut = not measured and len(attempt.trials[0].seconds) <= plan.steps
    steps = 0 if attempt.setting.first_step_only or cut else plan.steps
    with (
        closing(engine.simulate(scene, plan.time_step, attempt.setting, plan.time_limit)) as simulation,
        no_collection(),
    ):
        start = warm_start = time.perf_counter()
        for step in range(steps + 1):
            now = time.perf_counter()
            warm_start = now if step == 1 else warm_start
            late = now - start > limit or _hopeless(now - warm_start, step - 1, steps, limit - (now - start), limit)
            if late and step == 1:
                break  # the cold step alone took all there was: no stepped case
            last = late or step == steps
            if plan.gravity is not None:
                gravity = plan.gravity(step * plan.time_step)
                simulation.set_gravity(gravity)
                bodies = replace(bodies, gravity=gravity)
            judged = measured and (plan.judges(step) or last)
            before = simulation.motion() if judged else None
            tick = time.perf_counter()
            simulation.step()
            trial.seconds.append(time.perf_counter() - tick)
            trial.facts.append(simulation.facts())
            if before is not None:
                contacts = simulation.contacts()
                judgement = measure(bodies, before, simulation.motion(), contacts, plan.time_step)
                trial.contacts.append(contacts.gap.size)
                if step == 0:
                    trial.cold = judgement
                else:
                    trial.settled.append(judgement)
            if last and step > 0:
                break


def _hopeless(spent: float, made: int, steps: int, left: float, limit: float) -> bool:
    """Whether `made` warm steps of `steps`, in `spent` seconds, show that `left` seconds will not do for the rest."""
    if made < GIVE_UP_STEPS or spent < GIVE_UP_SHARE * limit:
        return False
    return spent / made * (steps - made) > GIVE_UP_EXCESS * left


def failure(error: Exception) -> tuple[str, str]:
    """Return the status and the message of an attempt that ended in an exception."""
    if isinstance(error, gpx.SettingsError | gpx.BackendMissing):
        return "refused", str(error)
    return "error", f"{type(error).__name__}: {error}"


@contextmanager
def no_collection() -> Iterator[None]:
    """Keep the garbage collector out of the timed calls, as timeit does."""
    gc.collect()
    gc.disable()
    try:
        yield
    finally:
        gc.enable()


def rows_not_run(
    name: str, scene: gpx.Scene, engines: Mapping[str, Engine], settings: Sequence[Setting], plan: Plan
) -> list[Row]:
    """Return the rows of a scene that Ctrl-C left out."""
    return rows_of(name, Bodies.from_scene(scene), [Attempt(setting) for setting in settings], engines, plan)


def rows_of(
    scene: str, bodies: Bodies, attempts: Sequence[Attempt], engines: Mapping[str, Engine], plan: Plan
) -> list[Row]:
    """Return the rows of every attempt, one per case."""
    return [
        _row(scene, bodies, attempt, engines[attempt.setting.engine], case, plan)
        for attempt in attempts
        for case in CASES
    ]


def _row(scene: str, bodies: Bodies, attempt: Attempt, engine: Engine, case: str, plan: Plan) -> Row:
    setting = attempt.setting
    row = Row(
        suite="stacks",
        scene=scene,
        case=case,
        bodies=bodies.count,
        engine=setting.engine,
        engine_version=engine.version(),
        solver=setting.solver,
        formulation=setting.formulation,
        setting=setting.label,
        effort=setting.effort,
        time_step=plan.time_step,
        # A row that holds no measure, and no reason of its own, is one that Ctrl-C left out.
        status=attempt.status or "interrupted",
        message=attempt.message,
        measured_at=datetime.now(UTC).isoformat(timespec="seconds"),
    )
    first = attempt.trials[0] if attempt.trials else Trial()
    made = max(0, len(first.seconds) - 1)
    whole = made == plan.steps
    part = slice(0, 1) if case == "cold" else slice(plan.settled_from + 1 if whole else 1, None)
    judgements = ([first.cold] if first.cold else []) if case == "cold" else first.settled
    if not judgements:
        if attempt.trials and not attempt.status:
            if setting.first_step_only:
                return replace(row, status="first step only", message="")
            return replace(row, status="time limit", message=f"the cold step alone took {plan.time_limit:g} s")
        return row
    worst = worst_of(judgements)
    timed = [trial.seconds[part] for trial in attempt.trials if trial.seconds[part]]
    facts = first.facts[part]
    middle, low, high = step_times(timed)
    short = case == "stepped" and not whole
    limit_note = f"time limit: {made} of {plan.steps} steps" if short else ""
    judged = worst.as_dict()
    if not plan.at_rest:
        judged |= dict.fromkeys(("load_error", "body_error", "drift"))
    return replace(
        row,
        status=_worst_status(facts) if not attempt.status else attempt.status,
        message="; ".join(filter(None, (attempt.message, limit_note))),
        method=facts[-1].method,
        fallbacks=" ".join(dict.fromkeys(name for fact in facts for name in fact.fallbacks)),
        contacts=first.contacts[0] if case == "cold" else first.contacts[-1],
        repeats=len(timed),
        steps=1 if case == "cold" else made,
        steps_asked=1 if case == "cold" else plan.steps,
        step_ms=1e3 * middle,
        step_ms_low=1e3 * low,
        step_ms_high=1e3 * high,
        setup_ms=_mean_ms([fact.setup_seconds for fact in facts]),
        solve_ms=_mean_ms([fact.solve_seconds for fact in facts]),
        iterations=_mean([fact.iterations for fact in facts]),
        **judged,
    )


def step_times(trials: Sequence[Sequence[float]]) -> tuple[float, float, float]:
    """Return the mean over steps of each step's median, fastest and slowest time over the trials, s.

    The median at each step drops a hiccup of the machine, and the mean keeps the cost of steps that are really dearer.
    A step that only some trials reached counts with those that did.
    """
    longest = max(len(trial) for trial in trials)
    table: Array = np.full((len(trials), longest), np.nan)
    for row, trial in zip(table, trials, strict=True):
        row[: len(trial)] = trial
    return tuple(float(f(table, axis=0).mean()) for f in (np.nanmedian, np.nanmin, np.nanmax))  # type: ignore[return-value]


def worst_of(judgements: Sequence[Measures]) -> Measures:
    """Return the largest value of each measure."""
    names = judgements[0].as_dict()
    return Measures(**{name: max(judgement.as_dict()[name] for judgement in judgements) for name in names})


def _worst_status(facts: Sequence[StepFacts]) -> str:
    """Return the first status that is not a success, else the common one."""
    return next((fact.status for fact in facts if fact.status not in ("ran", "solved")), facts[-1].status)


def _mean(values: Sequence[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return float(np.mean(known)) if known else None


def _mean_ms(values: Sequence[float | None]) -> float | None:
    mean = _mean(values)
    return None if mean is None else 1e3 * mean

"""A batch of the suite `stacks`: what one sweep costs, of every sweeping solver; see `benchmarks.rates`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from benchmarks import stacks
from benchmarks.attempts import Attempt, Outcome
from benchmarks.engines import ENGINES
from benchmarks.rates import FEW, measure_rates

SCENES = ("tower-30", "wall-10")
REPEATS = 7
SETTING = "cost of a sweep"
SWEEP = "sweep"


@dataclass(frozen=True)
class SweepBatch:
    """Every sweeping solver on one scene; `step_seconds` is the time per contact and sweep."""

    name: str
    scene: str
    attempts: Sequence[Attempt]
    repeats: int = REPEATS
    # Far above what they take, s.
    time_limit: float = 60.0

    @property
    def cases(self) -> Sequence[str]:
        """One row for each solver."""
        return (SWEEP,)

    def open(self) -> SweepBatch:
        """Return itself: a simulation is made for each measurement."""
        return self

    def only(self, attempts: Sequence[Attempt]) -> SweepBatch:
        """Return the batch with these of its attempts."""
        return replace(self, attempts=attempts)

    def try_once(self, attempt: Attempt, first: bool, seconds_left: float) -> Sequence[Outcome]:
        """Measure one solver once."""
        line = (attempt.engine, attempt.solver, attempt.formulation)
        (rate,) = measure_rates(
            self.scene,
            stacks.SCENES[self.scene].make(),
            {attempt.engine: ENGINES[attempt.engine]},
            stacks.TIME_STEP,
            1,
            lambda setting: setting.line == line,
            lambda text: None,
        )
        return (Outcome(case=SWEEP, step_seconds=(1e-9 * rate.median,), contacts=rate.contacts),)


def sweep_batch(scene: str, chosen: Sequence[str], wanted: Sequence[tuple[str, str, str]]) -> SweepBatch:
    """Return the batch of one scene, for those of the engines' sweeping lines that are wanted."""
    attempts = [
        Attempt(
            suite=stacks.NAME,
            scene=scene,
            solver=setting.solver,
            formulation=setting.formulation,
            setting=SETTING,
            engine=name,
            engine_version=ENGINES[name].version(),
        )
        for name in chosen
        for setting in ENGINES[name].sweeping(FEW)
        if setting.line in wanted
    ]
    return SweepBatch(f"{scene}-sweeps", scene, attempts)

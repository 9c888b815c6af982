"""The suite `acceleration`: what the same number of sweeps buys, by four ways of spending them.

The question is a step of 1/240 s from touching rest, where sweeps crawl: a load travels one contact a sweep. Everybody
has the same number of sweeps for it:

* **plain**: projected block Gauss-Seidel, p ← g(p);
* **momentum**: what `pgs` does unless told otherwise (Nesterov, restarted);
* **Anderson**: the last steps of p ← g(p), mixed so that their changes cancel best in the sense of least squares,
  p ← g_k - Σ γ_j (g_{j+1} - g_j), γ = argmin ‖f_k - Σ γ_j (f_{j+1} - f_j)‖ with f = g(p) - p; all memory is lost where
  ‖f‖ has doubled, and the law's cones are enforced by the sweep that follows. Source: H. F. Walker, P. Ni, *Anderson
  acceleration for fixed-point iterations*, SIAM J. Numer. Anal. 49 (2011).
* **sub-steps**: small time steps of one sweep each, warm, instead of many sweeps on a large one. Source: M. Macklin et
  al., *Small steps in physics simulation*, SCA 2019.

The load error is that of the first step (of sub-steps: of the last of them, when most of the fall is over), drift that
after a tenth of a second. Anderson runs from Python, on the first step alone: its sweeps compare, its time does not.

What it shows, and why momentum is what `pgs` has: with 300 sweeps, momentum leaves 2e-6 of a load on the column, 3e-6
on the tower and 2e-7 on the wall, Anderson 2e-5, 2e-7 and 4e-5, plain sweeps 0.9, 5e-4 and 9e-5. Under the thousandfold
weight Anderson is ahead at first (1e-3 after 100 sweeps, where momentum has 0.9) and behind in the end (2e-4 after
1000, where momentum has 2e-5). Sub-steps drift least, by a factor of ten to a thousand, but their loads are wrong (0.01
to 1 after 300 sweeps, 2e-4 on the wall), and each costs a whole step: 30 to 60 times the time of momentum's sweeps.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np
from rich.table import Table
from rich.text import Text

import gpx_lcp as gpx
from benchmarks import stacks
from benchmarks.arguments import add_effort, add_filters, chosen
from benchmarks.attempts import COLD, OWN, Answer, Attempt, Outcome
from benchmarks.bodies import Bodies
from benchmarks.drawing import draw_legends, label_figure, log_axes, panel_grid, save, title_panel
from benchmarks.engines import ENGINES
from benchmarks.engines.gpx import reported
from benchmarks.interface import Array, Setting
from benchmarks.machine import version_of
from benchmarks.measures import cut_load_errors, measure
from benchmarks.records import Record
from benchmarks.style import PALETTE, house_style
from benchmarks.tables import new_table

NAME = "acceleration"
SWEEPS, QUICK_SWEEPS = (10, 30, 100, 300, 1000), (10, 30)
REPEATS, QUICK_REPEATS = 3, 1
TIME_LIMIT, QUICK_TIME_LIMIT = 10.0, 2.0
# Steps after which drift is read.
STEPS = 24
# Out of reach, so that the sweeps asked for are the sweeps made.
TOLERANCE = 1e-15
# Steps that Anderson mixes.
MEMORY = 5


@dataclass(frozen=True)
class Problem:
    """A scene, and why it is here."""

    title: str
    make: Callable[[], gpx.Scene]


SCENES: Mapping[str, Problem] = {
    "column-50": Problem("50 masses above each other, without friction", lambda: gpx.scenes.column(50)),
    "heavy-1000": Problem("10 cubes, top × 1000", lambda: stacks.pressed(gpx.scenes.heavy_on_light(10, 1000.0))),
    "tower-10": Problem("Tower of 10", lambda: stacks.pressed(gpx.scenes.tower(10))),
    "wall-10": Problem("Wall, 10 rows", lambda: stacks.pressed(gpx.scenes.wall(10))),
}
QUICK_SCENES = ("column-50",)


@dataclass(frozen=True)
class Way:
    """A way to spend sweeps.

    Parameters
    ----------
    acceleration : bool
        Whether `pgs` has momentum.
    steps : callable
        How many steps 1/240 s is cut into, given the sweeps.
    stepped : bool
        Whether a world can be driven so.
    """

    acceleration: bool = False
    steps: Callable[[int], int] = lambda sweeps: 1
    stepped: bool = True


ANDERSON = "Anderson"
WAYS: Mapping[str, Way] = {
    "plain": Way(),
    "momentum": Way(acceleration=True),
    ANDERSON: Way(stepped=False),
    "sub-steps": Way(steps=lambda sweeps: sweeps),
}
COLOURS = dict(zip(WAYS, (PALETTE["blue"], PALETTE["vermillion"], PALETTE["green"], PALETTE["indigo"]), strict=True))


@dataclass(frozen=True)
class AccelerationBatch:
    """Every way on one scene."""

    name: str
    attempts: Sequence[Attempt]
    repeats: int
    time_limit: float
    cases: Sequence[str] = (COLD,)

    def open(self) -> AccelerationBench:
        """Build the scene."""
        return AccelerationBench(self.name)

    def only(self, attempts: Sequence[Attempt]) -> AccelerationBatch:
        """Return the batch with these of its attempts."""
        return replace(self, attempts=attempts)


class AccelerationBench:
    """A scene that was built."""

    def __init__(self, name: str) -> None:
        self._scene = SCENES[name].make()
        self._bodies = Bodies.from_scene(self._scene)

    def try_once(self, attempt: Attempt, first: bool, seconds_left: float) -> Sequence[Outcome]:
        """Spend the sweeps of an attempt on the first step, and on those after it where a world can."""
        way, sweeps = way_of(attempt.setting), int(attempt.effort)
        return [self._step(WAYS[way], sweeps, first) if WAYS[way].stepped else self._mix(sweeps)]

    def _step(self, way: Way, sweeps: int, judging: bool) -> Outcome:
        parts = way.steps(sweeps)
        options = {
            "tolerance": TOLERANCE,
            "iterations": sweeps // parts,
            "acceleration": way.acceleration,
            # Sweeps themselves are compared.
            "presolve": False,
        }
        setting, part, seconds = Setting(OWN, "pgs", "coulomb", "", 0.0, options), stacks.TIME_STEP / parts, []
        outcome = Outcome(bodies=self._bodies.count)
        with closing(ENGINES[OWN].simulate(self._scene, part, setting, TIME_LIMIT)) as simulation:
            for step in range(STEPS):
                spent = 0.0
                for _ in range(parts):
                    before = simulation.motion() if step == 0 else None
                    tick = time.perf_counter()
                    simulation.step()
                    spent += time.perf_counter() - tick
                seconds.append(spent)
                if before is not None and judging:
                    contacts = simulation.contacts()
                    judged = measure(self._bodies, before, simulation.motion(), contacts, part)
                    outcome = replace(
                        outcome,
                        contacts=contacts.gap.size,
                        certificate=judged.certificate,
                        answer=Answer(judged.certificate.system, judged.certificate.impulse),
                        figures={"load_error": judged.load_error},
                    )
            drift = np.linalg.norm(simulation.motion().position - self._bodies.start.position, axis=1)
        figures = {**outcome.figures, "drift": float(drift.max())}
        return replace(outcome, step_seconds=seconds, iterations=float(sweeps), figures=figures)

    def _mix(self, sweeps: int) -> Outcome:
        world = gpx.World(self._scene, stacks.TIME_STEP)
        system, contacts = world.system(), world.contacts
        tick = time.perf_counter()
        impulse = anderson(lambda p: swept(system, p), np.zeros((system.contacts, system.rows)), sweeps)
        seconds = time.perf_counter() - tick
        in_world = np.einsum("kr,krc->kc", impulse, contacts.frame[:, : system.rows])
        errors = cut_load_errors(self._bodies, reported(contacts, in_world), stacks.TIME_STEP)
        return Outcome(
            step_seconds=(seconds,),
            bodies=self._bodies.count,
            contacts=system.contacts,
            iterations=float(sweeps),
            certificate=gpx.certify(system, impulse),
            answer=Answer(system, impulse),
            figures={"load_error": float(errors.max())},
        )


def swept(system: gpx.StackedSystem, impulse: Array) -> Array:
    """Return g(p): the impulses after one plain sweep."""
    effort = {"max_iterations": 1, "acceleration": False, "presolve": False}
    return gpx.solve(system, solver="pgs", tolerance=TOLERANCE, warm_start=impulse, **effort).impulse


def anderson(g: Callable[[Array], Array], start: Array, count: int) -> Array:
    """Return the last g(p) of `count` evaluations of p ← g(p), mixed as the head of this file says."""
    point, values, changes = start, list[Array](), list[Array]()
    for _ in range(count):
        value = g(point)
        change = value - point
        if changes and np.linalg.norm(change) > 2.0 * np.linalg.norm(changes[-1]):
            values, changes = [], []
        values, changes = [*values[-MEMORY:], value], [*changes[-MEMORY:], change]
        point = value
        if len(changes) > 1:
            slopes = np.array([(after - before).ravel() for before, after in pairwise(changes)])
            gamma = np.linalg.lstsq(slopes.T, change.ravel(), rcond=None)[0]
            for weight, (before, after) in zip(gamma, pairwise(values), strict=True):
                point = point - weight * (after - before)
    return values[-1]


class Acceleration:
    """The row of the suite in the table."""

    name = NAME
    summary = "sweeps without momentum and with it, mixed by Anderson, and spent on sub-steps"
    not_shown = (
        "What this does not show: time of Anderson's way, which runs from Python; what sub-steps cost where contacts "
        "must be found (a step of a stack at rest finds its own again); loads that move, where momentum is lost. The "
        "certificate of sub-steps is that of the last of them."
    )

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Add the suite's arguments."""
        add_filters(parser)
        add_effort(parser, (REPEATS, QUICK_REPEATS), (TIME_LIMIT, QUICK_TIME_LIMIT))

    def scenes(self) -> Mapping[str, str]:
        """Return each scene and what it is."""
        return {name: problem.title for name, problem in SCENES.items()}

    def batches(self, asked: argparse.Namespace, folder: Path) -> Sequence[AccelerationBatch]:
        """Return a batch for each scene; none where another solver or formulation is asked for."""
        if "pgs" not in (asked.solver or ("pgs",)) or "coulomb" not in (asked.formulation or ("coulomb",)):
            return []
        names = chosen(SCENES, asked.scene) if asked.scene or not asked.quick else QUICK_SCENES
        budgets = QUICK_SWEEPS if asked.quick else SWEEPS
        return [
            AccelerationBatch(
                name,
                [_attempt(name, way, sweeps) for way in WAYS for sweeps in budgets],
                asked.repeats or (QUICK_REPEATS if asked.quick else REPEATS),
                asked.time_limit or (QUICK_TIME_LIMIT if asked.quick else TIME_LIMIT),
            )
            for name in names
        ]

    def batch_tables(self, records: Sequence[Record]) -> Sequence[Table]:
        """Return nothing: the tables at the end have all there is."""
        return ()

    def tables(self, records: Sequence[Record], folder: Path) -> Sequence[Table | Text]:
        """Return a table for each scene."""
        return [_table(SCENES[name].title, rows) for name, rows in _by_scene(records).items()]

    def draw(self, records: Sequence[Record], folder: Path, out: Path, footer: str) -> Sequence[Path]:
        """Draw the load error over sweeps, a panel for each scene."""
        found = _by_scene(records)
        if not found:
            return []
        with house_style():
            return _chart(found, footer, out / "acceleration")


def way_of(setting: str) -> str:
    """Return the name of the way, "momentum" of "momentum, 100 sweeps"."""
    return setting.partition(",")[0]


def _attempt(scene: str, way: str, sweeps: int) -> Attempt:
    setting, version = f"{way}, {sweeps} sweeps", version_of("gpx-lcp")
    return Attempt(NAME, scene, "pgs", "coulomb", setting, float(sweeps), engine_version=version)


def _by_scene(records: Sequence[Record]) -> dict[str, list[Record]]:
    """Return the measured rows of each scene."""
    found = {name: [row for row in records if row.scene == name and row.measured] for name in SCENES}
    return {name: rows for name, rows in found.items() if rows}


def _table(title: str, rows: Sequence[Record]) -> Table:
    table = new_table(f"{title}: load error | drift, m | ms per 1/240 s, by sweeps per 1/240 s")
    budgets = sorted({int(row.effort) for row in rows})
    table.add_column("way")
    for budget in budgets:
        table.add_column(str(budget), justify="right", no_wrap=True)
    for way in WAYS:
        cells = {int(row.effort): _cell(row) for row in rows if way_of(row.setting) == way}
        table.add_row(way, *(cells.get(budget, "") for budget in budgets))
    return table


def _cell(row: Record) -> str:
    error, drift = row.figure("load_error"), row.figure("drift")
    parts = ["" if error is None else f"{error:.1e}", "" if drift is None else f"{drift:.0e}"]
    return " | ".join([*parts, "" if row.step_ms is None or drift is None else f"{row.step_ms:.2g}"])


def _chart(found: Mapping[str, Sequence[Record]], footer: str, stem: Path) -> list[Path]:
    figure, panels, legend, axes = panel_grid(len(found))
    entries = {}
    for ax, (name, rows) in zip(axes, found.items(), strict=True):
        log_axes(ax)
        title_panel(ax, SCENES[name].title, "")
        for way, colour in COLOURS.items():
            here = sorted((row for row in rows if way_of(row.setting) == way), key=lambda row: row.effort)
            errors = [row.figure("load_error") or np.nan for row in here]
            (entries[way],) = ax.plot([row.effort for row in here], errors, color=colour, marker="o")
    draw_legends(legend, [("", [(line, way) for way, line in entries.items()])])
    heading = "Loads in the first step from rest, by what is done with the sweeps"
    label_figure(figure, panels, "sweeps per 1/240 s", "largest relative error of a load", heading, footer)
    return save(figure, stem)

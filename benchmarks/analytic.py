"""The suite `analytic`: single motions whose end is known on paper, and how far from it each engine ends.

Every case is run at several time steps, so that the error can be seen to follow the step, or not to: what remains when
steps are short is what a method models otherwise. The error is relative to the way, the speed or the load that the case
is about; where a body has to stay, to the way it would have gone without friction, or to its own length.
"""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np
from matplotlib.ticker import LogLocator, NullLocator
from rich.table import Table
from rich.text import Text

import gpx_lcp as gpx
from benchmarks.arguments import add_effort, add_filters, chosen
from benchmarks.asked import add_peers, engines_asked, missing_peers, wanted
from benchmarks.attempts import COLD, MISSING, OWN, Attempt, Outcome
from benchmarks.charts import look_of
from benchmarks.drawing import Entry, draw_legends, label_figure, panel_grid, plain_decades, save, title_panel
from benchmarks.engines import ENGINES, as_shipped, require_installed
from benchmarks.interface import Array, Contacts, Motion, Setting, scientific
from benchmarks.records import Record
from benchmarks.style import house_style
from benchmarks.tables import missing_notes, new_table

NAME = "analytic"
G: Final = 9.81
RATES, QUICK_RATES = (60, 240, 960), (240,)
REPEATS, QUICK_REPEATS = 2, 1
TIME_LIMIT, QUICK_TIME_LIMIT = 10.0, 2.0
# Errors below are rounding, and drawn there.
FLOOR = 1e-13


@dataclass(frozen=True)
class Course:
    """Where the bodies began, all heights of the first one, and the end."""

    start: Motion
    heights: Sequence[float]
    end: Motion
    contacts: Contacts
    time_step: float

    @property
    def way(self) -> Array:
        """How far the first body went, (3,), m."""
        way: Array = self.end.position[0] - self.start.position[0]
        return way


@dataclass(frozen=True)
class Case:
    """A motion: its scene, how long it takes, s, what is true of it, and the error of a course."""

    title: str
    truth: str
    make: Callable[[], gpx.Scene]
    seconds: float
    error: Callable[[Course], float]


def _turned(axis: tuple[float, float, float], angle: float) -> tuple[float, float, float, float]:
    x, y, z = (math.sin(0.5 * angle) * part for part in axis)
    return (math.cos(0.5 * angle), x, y, z)


def _on_ground(friction: float) -> tuple[gpx.Scene, gpx.Material]:
    scene, material = gpx.Scene(), gpx.Material(friction)
    scene.add_static(gpx.HalfSpace(), material=material)
    return scene, material


def _off(truth: Sequence[float], size: float) -> Callable[[Course], float]:
    """Return the error of the way of the first body, relative to a size."""
    return lambda course: float(np.linalg.norm(course.way - np.array(truth))) / size


def _flight() -> Case:
    def make() -> gpx.Scene:
        scene = gpx.Scene()
        scene.add_rigid(gpx.Sphere(0.5), 1.0, position=(0, 0, 100), velocity=(3, 1, 8))
        return scene

    return Case("Free flight", "a parabola", make, 1.0, _off((3.0, 1.0, 8.0 - 0.5 * G), 0.5 * G))


def _throw() -> Case:
    speed, friction, angle = 4.0, 0.5, math.radians(30.0)
    distance = speed**2 / (2.0 * friction * G)
    along = (math.cos(angle), math.sin(angle), 0.0)

    def make() -> gpx.Scene:
        scene, material = _on_ground(friction)
        velocity = (speed * along[0], speed * along[1], 0.0)
        scene.add_rigid(gpx.Box(1, 1, 0.2), 1.0, position=(0, 0, 0.1), velocity=velocity, material=material)
        return scene

    return Case(
        "Level throw at 30°",
        "stops after v²/(2 μ g), straight on",
        make,
        1.5,
        _off([distance * part for part in along], distance),
    )


def _slope(share: float) -> Case:
    """Return a cube on a slope askew to its sides, whose tangent is a share of the friction."""
    friction, azimuth = 0.5, math.radians(30.0)
    angle = math.atan(share * friction)
    acceleration = max(0.0, G * (math.sin(angle) - friction * math.cos(angle)))
    across = (math.cos(azimuth), math.sin(azimuth))
    down = np.array([math.cos(angle) * across[0], math.cos(angle) * across[1], -math.sin(angle)])

    def make() -> gpx.Scene:
        normal = (math.sin(angle) * across[0], math.sin(angle) * across[1], math.cos(angle))
        scene, material = gpx.Scene(), gpx.Material(friction)
        scene.add_static(gpx.HalfSpace(normal), material=material)
        x, y, z = (0.5 * part for part in normal)
        tilt = _turned((-across[1], across[0], 0.0), angle)
        scene.add_rigid(gpx.Box(1, 1, 1), 1.0, position=(x, y, z), orientation=tilt, material=material)
        return scene

    free = 0.5 * G * math.sin(angle)
    held = acceleration == 0.0
    title = "Askew slope that holds" if held else "Askew slope too steep"
    truth = "a cube stays" if held else "a cube slides with g (sin θ - μ cos θ)"
    return Case(title, truth, make, 1.0, _off(0.5 * acceleration * down, free if held else 0.5 * acceleration))


def _ball_down(grip: float) -> Case:
    angle = 0.5
    friction = grip * 2.0 / 7.0 * math.tan(angle)
    rolls = grip >= 1.0
    acceleration = 5.0 / 7.0 * G * math.sin(angle) if rolls else G * (math.sin(angle) - friction * math.cos(angle))

    def make() -> gpx.Scene:
        normal = (math.sin(angle), 0.0, math.cos(angle))
        scene, material = gpx.Scene(), gpx.Material(friction)
        scene.add_static(gpx.HalfSpace(normal), material=material)
        scene.add_rigid(gpx.Sphere(0.5), 1.0, position=tuple(0.5 * part for part in normal), material=material)
        return scene

    way = 0.5 * acceleration
    title = "Ball rolls down a slope" if rolls else "Ball slips down a slope"
    truth = "5/7 g sin θ" if rolls else "g (sin θ - μ cos θ)"
    return Case(title, truth, make, 1.0, _off((way * math.cos(angle), 0.0, -way * math.sin(angle)), way))


def _backspin() -> Case:
    speed, spin = 4.0, -40.0
    truth = (5.0 * speed + 2.0 * 0.5 * spin) / 7.0

    def error(course: Course) -> float:
        return abs(float(course.end.velocity[0, 0]) - truth) / abs(truth)

    return Case(
        "Ball with backspin",
        "comes back at (5 v + 2 r ω)/7",
        lambda: gpx.scenes.rolling_sphere(speed, spin),
        2.0,
        error,
    )


def _tall_box(friction: float) -> Case:
    topples = friction > 0.5

    def make() -> gpx.Scene:
        scene, material = _on_ground(friction)
        scene.add_rigid(gpx.Box(0.3, 0.3, 0.6), 1.0, position=(0, 0, 0.3), velocity=(5, 0, 0), material=material)
        return scene

    def upright(course: Course) -> float:
        _, x, y, _ = course.end.orientation[0]
        return abs(float(1.0 - 2.0 * (x * x + y * y)))

    distance = 25.0 / (2.0 * friction * G)
    if topples:
        return Case("Tall box, μ = 0.55", "goes over and lies", make, 2.0, upright)
    return Case("Tall box, μ = 0.45", "slides upright for v²/(2 μ g)", make, 2.0, _off((distance, 0.0, 0.0), distance))


def _ladder() -> Case:
    angle, length = math.radians(60.0), 2.0
    friction = 1.03 * 0.5 / math.tan(angle)

    def make() -> gpx.Scene:
        scene, material = _on_ground(friction)
        scene.add_static(gpx.HalfSpace((1, 0, 0)), material=gpx.Material(0.0), name="wall")
        tilt = angle - 0.5 * math.pi
        thickness = 0.01
        # Of the corner that is lowest and the one that is nearest to the wall, from the middle.
        x = 0.5 * (length * abs(math.sin(tilt)) + thickness * math.cos(tilt))
        z = 0.5 * (length * math.cos(tilt) + thickness * abs(math.sin(tilt)))
        scene.add_rigid(
            gpx.Box(thickness, 0.4, length),
            1.0,
            position=(x, 0.0, z),
            orientation=_turned((0.0, 1.0, 0.0), tilt),
            material=material,
        )
        return scene

    return Case("Ladder on a smooth wall", "stands: μ is 3 % above cot θ / 2", make, 1.0, _off((0, 0, 0), length))


def _bricks() -> Case:
    def error(course: Course) -> float:
        return float(np.linalg.norm(course.end.position - course.start.position, axis=1).max()) / 2.0

    title, truth = "Overhanging bricks", "four stand at 0.999 of Σ 1/(2k)"
    return Case(title, truth, lambda: gpx.scenes.bricks(4, 0.999), 1.0, error)


def _table() -> Case:
    def error(course: Course) -> float:
        found, load = course.contacts, np.zeros(4)
        for body, other, impulse in zip(found.body_a, found.body_b, found.impulse, strict=True):
            if min(body, other) < 0 <= max(body, other) < 4:
                load[max(body, other)] += abs(impulse[2]) / course.time_step
        return float(np.abs(load / (3.5 * G) - 1.0).max())

    return Case("Table on four legs", "each carries a quarter", lambda: gpx.scenes.table(4), 0.5, error)


def _turntable() -> Case:
    """Return a block on a heavy square table that turns on smooth ground; the table is the first body."""
    radius, friction = 0.5, 0.5
    spin = math.sqrt(0.9 * friction * G / radius)

    def make() -> gpx.Scene:
        scene, material = gpx.Scene(), gpx.Material(friction)
        scene.add_static(gpx.HalfSpace(), material=gpx.Material(0.0))
        table = {"position": (0, 0, 0.1), "angular_velocity": (0, 0, spin)}
        scene.add_rigid(gpx.Box(4, 4, 0.2), 1e5, material=material, **table)
        block = {"position": (radius, 0, 0.21), "velocity": (0, spin * radius, 0), "angular_velocity": (0, 0, spin)}
        scene.add_rigid(gpx.Box(0.1, 0.1, 0.02), 0.1, material=material, **block)
        return scene

    def error(course: Course) -> float:
        return abs(float(np.linalg.norm(course.end.position[1, :2])) / radius - 1.0)

    return Case("Block on a turntable", "goes round with it: ω² r is 0.9 μ g", make, 1.0, error)


def _bounce() -> Case:
    drop, restitution = 1.0, 0.8

    def make() -> gpx.Scene:
        scene, material = gpx.Scene(), gpx.Material(0.0, 1.0 + restitution)
        scene.add_static(gpx.HalfSpace(), material=material)
        scene.add_rigid(gpx.Sphere(0.5), 1.0, position=(0, 0, 0.5 + drop), material=material)
        return scene

    def error(course: Course) -> float:
        heights = np.array(course.heights)
        low = int(heights.argmin())
        return abs(float(heights[low:].max()) - 0.5 - restitution**2 * drop) / drop

    fall = math.sqrt(2.0 * drop / G)
    return Case("Bouncing ball", "comes back to e² h", make, fall * (1.0 + 1.5 * restitution), error)


CASES: Mapping[str, Case] = {
    "flight": _flight(),
    "throw": _throw(),
    "slope-holds": _slope(0.98),
    "slope-slides": _slope(1.2),
    "ball-rolls": _ball_down(1.05),
    "ball-slips": _ball_down(0.7),
    "backspin": _backspin(),
    "tall-box-slides": _tall_box(0.45),
    "tall-box-topples": _tall_box(0.55),
    "ladder": _ladder(),
    "turntable": _turntable(),
    "bricks": _bricks(),
    "table": _table(),
    "bounce": _bounce(),
}


def settings(names: Sequence[str]) -> list[Setting]:
    """Return gpx-lcp's exact solver and its sweeps, and each of the named engines as it is shipped."""
    own = [("newton", 1e-10), ("pgs", 1e-6)]
    return [
        *(
            Setting(OWN, name, "coulomb", f"tolerance {scientific(bound)}", 0.0, {"tolerance": bound})
            for name, bound in own
        ),
        *as_shipped(names),
    ]


@dataclass(frozen=True)
class CaseBatch:
    """Every setting at every time step on one case."""

    name: str
    attempts: Sequence[Attempt]
    settings: Mapping[tuple[str, ...], Setting]
    repeats: int
    time_limit: float
    cases: Sequence[str] = (COLD,)

    def open(self) -> CaseBench:
        """Build the scene."""
        return CaseBench(self)

    def only(self, attempts: Sequence[Attempt]) -> CaseBatch:
        """Return the batch with these of its attempts."""
        return replace(self, attempts=attempts)


class CaseBench:
    """A case with its scene."""

    def __init__(self, batch: CaseBatch) -> None:
        self._batch, self._case = batch, CASES[batch.name]
        self._scene = self._case.make()

    def try_once(self, attempt: Attempt, first: bool, seconds_left: float) -> Sequence[Outcome]:
        """Simulate the whole case, and compare its end with the truth; each step is timed."""
        require_installed(attempt.engine)
        setting, time_step = self._batch.settings[attempt.key], 1.0 / attempt.effort
        steps, seconds, heights = round(self._case.seconds / time_step), [], []
        begun = time.perf_counter()
        with closing(
            ENGINES[attempt.engine].simulate(self._scene, time_step, setting, self._batch.time_limit)
        ) as simulation:
            start = simulation.motion()
            for _ in range(steps):
                tick = time.perf_counter()
                simulation.step()
                seconds.append(time.perf_counter() - tick)
                heights.append(float(simulation.motion().position[0, 2]))
                if time.perf_counter() - begun > seconds_left:
                    break
            course = Course(start, heights, simulation.motion(), simulation.contacts(), time_step)
            facts = simulation.facts()
        outcome = Outcome(step_seconds=seconds, steps=len(seconds), steps_asked=steps, bodies=len(self._scene.bodies))
        if len(seconds) < steps:
            return [replace(outcome, status="time limit", again=False)]
        error = self._case.error(course) if np.isfinite(course.end.position).all() else math.inf
        return [replace(outcome, status=facts.status, method=facts.method, figures={"error": error})]


class Analytic:
    """The row of the suite in the table."""

    name = NAME
    summary = "single motions whose end is known on paper: error against truth, at several time steps"
    not_shown = (
        "What this does not show: many bodies at once, which the suite stacks has, and how methods fail, which "
        "stability has; settings other than each engine's own. A truth here is of rigid bodies and Coulomb's law in "
        "continuous time; engines whose contacts give way, or whose friction creeps, were made to model something else."
    )

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Add the suite's arguments."""
        add_filters(parser)
        add_peers(parser)
        add_effort(parser, (REPEATS, QUICK_REPEATS), (TIME_LIMIT, QUICK_TIME_LIMIT))

    def scenes(self) -> Mapping[str, str]:
        """Return each case and its truth."""
        return {name: f"{case.title}: {case.truth}" for name, case in CASES.items()}

    def batches(self, asked: argparse.Namespace, folder: Path) -> Sequence[CaseBatch]:
        """Return a batch for each case."""
        run = wanted(asked, settings(engines_asked(asked)))
        if not run:
            return []
        rates = QUICK_RATES if asked.quick else RATES
        return [
            CaseBatch(
                name,
                [*(attempt for attempt, _ in asking), *missing_peers(asked, NAME, name)],
                {attempt.key: setting for attempt, setting in asking},
                asked.repeats or (QUICK_REPEATS if asked.quick else REPEATS),
                asked.time_limit or (QUICK_TIME_LIMIT if asked.quick else TIME_LIMIT),
            )
            for name in chosen(CASES, asked.scene)
            for asking in [[(_attempt(name, setting, rate), setting) for setting in run for rate in rates]]
        ]

    def batch_tables(self, records: Sequence[Record]) -> Sequence[Table]:
        """Return nothing: a case is one column of the table at the end."""
        return ()

    def tables(self, records: Sequence[Record], folder: Path) -> Sequence[Table | Text]:
        """Return the errors at each time step, a line for each case."""
        rates = sorted({row.effort for row in records if row.status != MISSING})
        refused = {f"{row.engine}: {row.message}" for row in records if row.status == "refused"}
        return [
            *(_table_at(rate, records) for rate in rates),
            *(Text(text, style="yellow") for text in sorted(refused)),
            *missing_notes(records),
        ]

    def draw(self, records: Sequence[Record], folder: Path, out: Path, footer: str) -> Sequence[Path]:
        """Draw error over time per simulated second, a panel for each case."""
        shown = [row for row in records if row.measured and row.figure("error") is not None]
        if not shown:
            return []
        with house_style():
            return _chart(shown, footer, out / "analytic")


def _attempt(name: str, setting: Setting, rate: int) -> Attempt:
    return Attempt(
        suite=NAME,
        scene=name,
        solver=setting.solver,
        formulation=setting.formulation,
        setting=f"{setting.label}, 1/{rate} s",
        effort=float(rate),
        engine=setting.engine,
        engine_version=ENGINES[setting.engine].version(),
    )


def _label(row: Record) -> str:
    return row.solver if row.engine == OWN else row.engine


def _table_at(rate: float, records: Sequence[Record]) -> Table:
    here = [row for row in records if row.effort == rate]
    labels = list(dict.fromkeys(map(_label, here)))
    table = new_table(f"Error against truth, time step 1/{rate:g} s")
    table.add_column("case")
    table.add_column("truth", overflow="fold")
    for label in labels:
        table.add_column(label, justify="right", no_wrap=True)
    for name in dict.fromkeys(row.scene for row in here):
        found = {_label(row): row for row in here if row.scene == name}
        cells = [found[label] if label in found else None for label in labels]
        table.add_row(CASES[name].title, CASES[name].truth, *map(_cell, cells))
    return table


def _cell(row: Record | None) -> str:
    if row is None:
        return ""
    error = row.figure("error")
    return row.status if error is None else f"{error:.1e}"


def _chart(records: Sequence[Record], footer: str, stem: Path) -> list[Path]:
    names = [name for name in CASES if any(row.scene == name for row in records)]
    figure, panels, legend, axes = panel_grid(len(names), 4.1, 2.9)
    entries: dict[str, Entry] = {}
    for ax, name in zip(axes, names, strict=True):
        here = [row for row in records if row.scene == name]
        ax.set_xscale("log")
        ax.set_yscale("log")
        plain_decades(ax.xaxis)
        ax.yaxis.set_major_locator(LogLocator(base=1000.0, numticks=12))
        ax.yaxis.set_minor_locator(NullLocator())
        title_panel(ax, CASES[name].title, "")
        for label in dict.fromkeys(map(_label, here)):
            line = sorted((row for row in here if _label(row) == label), key=lambda row: row.effort)
            look = look_of(line[0])
            (drawn,) = ax.plot(
                [1e3 * (row.step_seconds or 0.0) * row.effort for row in line],
                [min(max(row.figure("error") or 0.0, FLOOR), 10.0) for row in line],
                color=look.colour,
                marker=look.marker or "o",
                markersize=0.8 * look.size,
                markeredgecolor="white",
            )
            entries.setdefault(label, (drawn, label))
        ax.set_ylim(0.3 * FLOOR, 30.0)
    draw_legends(legend, [("each line: longer to\nshorter time steps", list(entries.values()))])
    label_figure(
        figure,
        panels,
        "wall time of a simulated second, ms",
        "error against truth, relative",
        "Motions known on paper",
        footer,
    )
    return save(figure, stem)

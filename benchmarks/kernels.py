"""The suite `kernels`: what the inner loops cost, against what this machine's memory and arithmetic allow.

    bound = max(bytes / bandwidth, operations / arithmetic, divisions / rate of division)

Bandwidth is that of numpy's a ← s c, a ← a + b on arrays that are together as large as what a kernel goes through, so
that they lie in the same caches, or in none; arithmetic that of a product of matrices, and division that of numpy's in
the second-level cache. All are what a program gets on one thread, not what a data sheet says.

What a sweep has to do for a contact depends on what the contact does; the answer of the sweeps tells how many there are
of each kind. The states of two bodies, a line of the cache each, are read and written once for the contacts of a patch,
four in these scenes, which also share their frame and the masses and inertias of the bodies (9 + 2 × 7 numbers).

* One that is open, p = 0, needs no more than to be found open: u_n ≥ 0, from its two arms, the normal and B_n.
* One that sticks reads its arms, what it shares, and 13 numbers of its own beside (impulse, B, half of the inverse of
  A_ii, μ), and writes the impulse back. It multiplies and adds for u from the bodies' velocities, for what dp makes of
  these (see `arms.rs`), for dp = -A_ii⁻¹ u and for the cone.
* One that slides, by Coulomb's law, finds out that it does not stick, and reads the half of A_ii and the direction it
  slid in last, which it writes back. b = u - A_ii p, one Newton step on the direction (`heading.rs`) and the ray it
  leads to: two divisions, one of them for the new direction alone, and no root. Without friction on a cone (the box)
  what slides is counted as what sticks.

None waits for another in this count, so that the bound is one from below.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np
from matplotlib.figure import Figure as Chart
from matplotlib.layout_engine import ConstrainedLayoutEngine
from rich.table import Table
from rich.text import Text

import gpx_lcp as gpx
from benchmarks import stacks
from benchmarks.arguments import add_effort, add_filters, chosen
from benchmarks.attempts import COLD, OWN, Attempt, Figure, Outcome
from benchmarks.drawing import plain_decades, save
from benchmarks.engines import ENGINES
from benchmarks.machine import version_of
from benchmarks.rates import measure_rates
from benchmarks.records import Record
from benchmarks.style import FRONT, INK, PALETTE, QUIET, house_style
from benchmarks.tables import new_table

NAME = "kernels"
MACHINE = "machine"
REPEATS, QUICK_REPEATS = 7, 2
TIME_LIMIT, QUICK_TIME_LIMIT = 30.0, 5.0

NUMBER: Final = 8
LINE: Final = 64
# Multiplications and additions of one Newton step on the direction of a slide, by Coulomb's law, without its checks.
SLIDE_OPERATIONS: Final = 75
SHARED: Final = 4
# Of one contact and sweep; see above.
STATE_BYTES: Final = 2 * 2 * LINE / SHARED
ARM_BYTES: Final = 2 * 3 * NUMBER
PATCH_BYTES: Final = (9 + 2 * 7) * NUMBER / SHARED
# Open, sticking, and what sliding needs more.
SWEEP_BYTES: Final = (
    ARM_BYTES + 3 * NUMBER / SHARED + 2 * NUMBER,
    ARM_BYTES + PATCH_BYTES + (13 + 3) * NUMBER,
    (6 + 2 + 2) * NUMBER,
)
# v + ω × r of two bodies and what is between them, and one entry of it along an axis.
MOTION_OPERATIONS: Final = 2 * 12 + 3
AXIS_OPERATIONS: Final = 2 * 3
# Of one body: f/m, r × f and I⁻¹ (r × f).
PUSH_OPERATIONS: Final = 2 * 3 + 3 * 3 + 2 * 9
# Sticking: u, Eᵀ dp and what it does to both bodies, A_ii⁻¹ u, p + dp, the cone. Sliding: A_ii p; the step itself, as
# `heading.rs` has it.
SWEEP_OPERATIONS: Final = (
    MOTION_OPERATIONS + AXIS_OPERATIONS,
    MOTION_OPERATIONS + 2 * 3 * AXIS_OPERATIONS + 2 * PUSH_OPERATIONS + 2 * 3 * 3 + 3 + 4,
    2 * 3 * 3 + SLIDE_OPERATIONS,
)
SWEEP_DIVISIONS: Final = (0, 0, 2)
# What the machine's own lines in the table go through, bytes: within the second-level cache of any machine of today,
# and beyond the last. In fewer bytes than the first, calls of numpy would be measured.
IN_CACHE, IN_MEMORY = 200_000, 200_000_000
ARRAYS, TRIAD_BYTES = 3, 5 * NUMBER
MATRIX = 384
MACHINE_UNITS: Final = {"arithmetic": "G operations/s", "division": "G divisions/s"}


@dataclass(frozen=True)
class Kernel:
    """A loop, what one pass of it is counted by, and how it is measured.

    Parameters
    ----------
    measure : callable
        Returns the seconds of one unit and the figures of the row.
    """

    title: str
    solver: str
    formulation: str
    unit: str
    measure: Callable[[], tuple[float, dict[str, Figure]]]
    quick: bool = True


def _sweep(scene: gpx.Scene, title: str, formulation: str, quick: bool = True) -> Kernel:
    def measure() -> tuple[float, dict[str, Figure]]:
        engines = {OWN: ENGINES[OWN]}
        (rate,) = measure_rates(
            title, scene, engines, stacks.TIME_STEP, 1, lambda each: each.formulation == formulation, lambda text: None
        )
        slides = rate.sliding if formulation == "coulomb" else 0.0

        def mean(kinds: Sequence[float]) -> float:
            is_open, sticks, more = kinds
            return rate.open * is_open + (1.0 - rate.open) * sticks + slides * more

        moved = STATE_BYTES + mean(SWEEP_BYTES)
        work = {"operations": mean(SWEEP_OPERATIONS), "divisions": mean(SWEEP_DIVISIONS)}
        figures = {"bytes": moved, **work, "open": rate.open, "sliding": rate.sliding, "count": rate.contacts}
        extent = max(IN_CACHE, int(rate.contacts * moved))
        return 1e-9 * rate.median, {**figures, "byte_seconds": byte_seconds(extent)}

    return Kernel(f"Sweep, {formulation}, {title}", "pgs", formulation, "contact", measure, quick)


def _factorisation(rows: int, quick: bool = True) -> Kernel:
    def measure() -> tuple[float, dict[str, Figure]]:
        system = gpx.World(gpx.scenes.wall(rows), time_step=stacks.TIME_STEP).system()
        solution = gpx.solve(system, "coulomb", "newton", tolerance=1e-8, presolve=False)
        fill, times = solution.extras["fill"], solution.extras["factorisations"]
        if not times:
            raise gpx.SettingsError(f"wall of {rows} rows was solved without a factorisation")
        return solution.extras["factor_seconds"] / (times * fill), {"count": fill}

    return Kernel(
        f"Factorisation, wall of {rows} rows", "interior_point", "coulomb", "value of the factor", measure, quick
    )


def _certificate() -> Kernel:
    def measure() -> tuple[float, dict[str, Figure]]:
        system = gpx.World(gpx.scenes.wall(20), time_step=stacks.TIME_STEP).system()
        impulse = np.zeros((system.contacts, 3))
        tick = time.perf_counter()
        gpx.certify(system, impulse)
        return (time.perf_counter() - tick) / system.contacts, {"count": system.contacts}

    return Kernel("Certificate, wall of 20 rows", "certify", "coulomb", "contact", measure)


def byte_seconds(extent: int) -> float:
    """Return the time to move a byte, s, of arrays that are together so many bytes large."""
    size = max(1, extent // (ARRAYS * NUMBER))
    a, b, c = np.zeros(size), np.ones(size), np.ones(size)
    seconds = []
    for _ in range(max(4, min(100, 2_000_000 // size))):
        tick = time.perf_counter()
        np.multiply(c, 0.5, out=a)
        np.add(a, b, out=a)
        seconds.append(time.perf_counter() - tick)
    return min(seconds) / (TRIAD_BYTES * size)


def _bandwidth(extent: int, title: str) -> Kernel:
    return Kernel(title, MACHINE, "", "byte", lambda: (byte_seconds(extent), {"count": extent}))


def _matrix_product() -> Kernel:
    def measure() -> tuple[float, dict[str, Figure]]:
        a = np.random.default_rng(0).random((MATRIX, MATRIX))
        out = np.empty_like(a)
        seconds = []
        for _ in range(5):
            tick = time.perf_counter()
            np.matmul(a, a, out=out)
            seconds.append(time.perf_counter() - tick)
        return min(seconds) / (2.0 * MATRIX**3), {"count": MATRIX}

    return Kernel("Product of matrices", MACHINE, "", "operation", measure)


def _division() -> Kernel:
    def measure() -> tuple[float, dict[str, Figure]]:
        size = IN_CACHE // (ARRAYS * NUMBER)
        a, b, out = np.ones(size), np.full(size, 3.0), np.empty(size)
        seconds = []
        for _ in range(100):
            tick = time.perf_counter()
            np.divide(a, b, out=out)
            seconds.append(time.perf_counter() - tick)
        return min(seconds) / size, {"count": size}

    return Kernel("Division", MACHINE, "", "division", measure)


KERNELS: Mapping[str, Kernel] = {
    "cache": _bandwidth(IN_CACHE, "Second-level cache"),
    "memory": _bandwidth(IN_MEMORY, "Memory"),
    "arithmetic": _matrix_product(),
    "division": _division(),
    "sweep-tower-30": _sweep(gpx.scenes.tower(30), "tower of 30", "coulomb"),
    "sweep-wall-10": _sweep(gpx.scenes.wall(10), "wall of 10 rows", "coulomb"),
    "sweep-box-wall-10": _sweep(gpx.scenes.wall(10), "wall of 10 rows", "box"),
    "sweep-wall-30": _sweep(gpx.scenes.wall(30), "wall of 30 rows", "coulomb", False),
    "sweep-wall-100": _sweep(gpx.scenes.wall(100), "wall of 100 rows", "coulomb", False),
    "factorisation-wall-10": _factorisation(10),
    "factorisation-wall-30": _factorisation(30, False),
    "certificate-wall-20": _certificate(),
}


@dataclass(frozen=True)
class KernelBatch:
    """One kernel; it is its own bench."""

    name: str
    attempts: Sequence[Attempt]
    repeats: int
    time_limit: float
    cases: Sequence[str] = (COLD,)

    def open(self) -> KernelBatch:
        """Return itself: every trial makes what it needs."""
        return self

    def only(self, attempts: Sequence[Attempt]) -> KernelBatch:
        """Return the batch with these of its attempts."""
        return replace(self, attempts=attempts)

    def try_once(self, attempt: Attempt, first: bool, seconds_left: float) -> Sequence[Outcome]:
        """Measure once; `step_seconds` is the time of one unit."""
        seconds, figures = KERNELS[self.name].measure()
        return (Outcome(step_seconds=(seconds,), figures=figures),)


class Kernels:
    """The row of the suite in the table."""

    name = NAME
    summary = "what inner loops cost, against this machine's memory and arithmetic"
    not_shown = (
        "What this does not show: two threads; other machines, whose caches are larger or smaller. Bounds count what a "
        "sweep must at least move, multiply and divide, not what waiting for one contact before the next costs, nor "
        "that contacts that go abreast wait for the one that has most to do."
    )

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Add the suite's arguments."""
        add_filters(parser)
        add_effort(parser, (REPEATS, QUICK_REPEATS), (TIME_LIMIT, QUICK_TIME_LIMIT))

    def scenes(self) -> Mapping[str, str]:
        """Return each kernel and what it is counted by."""
        return {name: f"{kernel.title}, per {kernel.unit}" for name, kernel in KERNELS.items()}

    def batches(self, asked: argparse.Namespace, folder: Path) -> Sequence[KernelBatch]:
        """Return a batch for each kernel."""
        usual = [name for name, kernel in KERNELS.items() if kernel.quick or not asked.quick]
        return [
            KernelBatch(
                name,
                [Attempt(NAME, name, kernel.solver, kernel.formulation, engine_version=version_of("gpx-lcp"))],
                asked.repeats or (QUICK_REPEATS if asked.quick else REPEATS),
                asked.time_limit or (QUICK_TIME_LIMIT if asked.quick else TIME_LIMIT),
            )
            for name in (chosen(KERNELS, asked.scene) if asked.scene else usual)
            for kernel in (KERNELS[name],)
            if asked.solver is None or kernel.solver in asked.solver
            if asked.formulation is None or kernel.formulation in asked.formulation
        ]

    def batch_tables(self, records: Sequence[Record]) -> Sequence[Table]:
        """Return nothing: a kernel is one line of the table at the end."""
        return ()

    def tables(self, records: Sequence[Record], folder: Path) -> Sequence[Table | Text]:
        """Return the machine's rates, and each kernel beside its bound."""
        rates = _rates(records)
        machine = new_table("What this machine gives one thread")
        machine.add_column("")
        machine.add_column("", justify="right")
        for name, seconds in rates.items():
            unit = MACHINE_UNITS.get(name, "GB/s")
            machine.add_row(KERNELS[name].title, f"{1e-9 / seconds:.1f} {unit}")
        table = new_table("Inner loops, ns per unit")
        table.add_column("kernel")
        table.add_column("unit")
        for column in ("ns", "bound", "times the bound"):
            table.add_column(column, justify="right", no_wrap=True)
        table.add_column("what binds")
        for row in loops(records):
            found = bound(row, rates)
            ns = 1e9 * (row.step_seconds or 0.0)
            cells = ("", "", "") if found is None else (f"{found[0]:.2g}", f"{ns / found[0]:.1f}", found[1])
            table.add_row(KERNELS[row.scene].title, KERNELS[row.scene].unit, f"{ns:.3g}", *cells)
        return [*([machine] if rates else []), *([table] if loops(records) else [])]

    def draw(self, records: Sequence[Record], folder: Path, out: Path, footer: str) -> Sequence[Path]:
        """Draw each kernel's time as a bar, with its bound."""
        found = loops(records)
        if not found:
            return []
        with house_style():
            return _chart(found, _rates(records), footer, out / "kernels")


def loops(records: Sequence[Record]) -> list[Record]:
    """Return the measured rows that are not the machine's own."""
    return [row for row in records if row.measured and row.scene in KERNELS and row.solver != MACHINE]


def _rates(records: Sequence[Record]) -> dict[str, float]:
    """Return seconds per byte and per operation as the machine has them, by kernel."""
    own = [row for row in records if row.scene in KERNELS and row.solver == MACHINE]
    return {row.scene: row.step_seconds for row in own if row.step_seconds}


def bound(row: Record, rates: Mapping[str, float]) -> tuple[float, str] | None:
    """Return the least ns per unit that the machine allows, and what binds; None where nothing was counted.

    `rates` has the seconds per operation of "arithmetic" and per "division"; the seconds per byte are the row's own.
    """
    moved, operations, divisions, each = (
        row.figure(name) for name in ("bytes", "operations", "divisions", "byte_seconds")
    )
    if (
        moved is None
        or operations is None
        or divisions is None
        or each is None
        or not MACHINE_UNITS.keys() <= rates.keys()
    ):
        return None
    times = {
        "memory": moved * each,
        "arithmetic": operations * rates["arithmetic"],
        "division": divisions * rates["division"],
    }
    binds = max(times, key=lambda name: times[name])
    return 1e9 * times[binds], binds


def _chart(found: Sequence[Record], rates: Mapping[str, float], footer: str, stem: Path) -> list[Path]:
    figure = Chart(figsize=(10.5, 1.8 + 0.5 * len(found)), layout=ConstrainedLayoutEngine())
    ax = figure.subplots()
    for place, row in enumerate(found):
        ns = 1e9 * (row.step_seconds or 0.0)
        ax.barh(place, ns, height=0.62, color=PALETTE["blue"])
        least = bound(row, rates)
        if least is not None:
            ax.plot([least[0], least[0]], [place - 0.4, place + 0.4], color=PALETTE["vermillion"], linewidth=3)
        label = f"{ns:.3g}" + ("" if least is None else f", bound {least[0]:.2g} ({least[1]})")
        ax.annotate(label, (ns, place), (6, 0), textcoords="offset points", va="center", fontsize=11, color=INK)
    ax.set_xscale("log")
    plain_decades(ax.xaxis)
    ax.margins(x=0.45)
    ax.set_yticks(range(len(found)), [f"{KERNELS[r.scene].title}, per {KERNELS[r.scene].unit}" for r in found])
    ax.invert_yaxis()
    ax.grid(visible=False, axis="y")
    ax.axvline(1.0, color=FRONT, linewidth=1.0)
    ax.set_xlabel("ns")
    figure.suptitle("Inner loops, and what the machine allows (red)", x=0.01, ha="left", fontsize=17, fontweight="bold")
    figure.text(0.01, -0.03, footer, ha="left", va="top", fontsize=11, color=QUIET)
    return save(figure, stem)

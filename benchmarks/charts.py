"""Charts of measured rows: time against error, one small panel per scene, with the Pareto front."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import matplotlib
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from benchmarks.drawing import (
    draw_front,
    draw_legends,
    front_entry,
    label_figure,
    log_axes,
    panel_grid,
    pareto_front,
    save,
    swatch,
    title_panel,
)
from benchmarks.engines import OWN
from benchmarks.records import Record
from benchmarks.style import PALETTE, QUIET, SOLVERS, house_style


@dataclass(frozen=True)
class Axis:
    """What is drawn upwards: a measure of the rows and the range in which it says something.

    Parameters
    ----------
    case : str
        Which rows: "cold" or "stepped".
    measure : str
        Column of the rows.
    label : str
    floor, ceiling : float
        Values outside are drawn on the edge: below the floor is rounding, above the ceiling nothing stands.
    """

    case: str
    measure: str
    label: str
    floor: float
    ceiling: float

    def value(self, row: Record) -> float:
        """Return the row's measure, moved inside the range."""
        return min(max(row.figure(self.measure) or 0.0, self.floor), self.ceiling)


LOAD = "load error: worst |force across a cut / weight above it − 1|"

# At rest any engine's loads are right in the end, so the settled steps are told apart by how far the stack has moved.
# Where gravity swings, loads change in every step.
AXES: Mapping[str, Axis] = {
    "cold": Axis("cold", "load_error", LOAD, 1e-15, 3.0),
    "stepped": Axis("stepped", "drift", "drift: farthest that a body has moved from its place, m", 1e-15, 3.0),
    "swinging": Axis("stepped", "load_error", LOAD, 1e-15, 3.0),
}


@dataclass(frozen=True)
class Look:
    """How a solver of gpx-lcp, or a peer, is drawn."""

    label: str
    colour: str
    marker: str = ""
    size: float = 8.5


LOOKS: Mapping[str, Look] = {name: Look(name, colour) for name, colour in SOLVERS.items()}
OTHER_BACKEND = Look("other QP backend", QUIET)

# A marker of its own tells each peer also where colours do not.
PEER_LOOKS: Mapping[str, Look] = {
    "pybullet": Look("pybullet", PALETTE["vermillion"], "X", 10.0),
    "mujoco": Look("mujoco", PALETTE["purple"], "*", 14.0),
    "rapier": Look("rapier", PALETTE["black"], "P", 10.0),
    "dart": Look("dart", PALETTE["olive"], "<", 10.0),
    "drake": Look("drake", PALETTE["wine"], "h", 11.0),
    "pinocchio": Look("pinocchio", PALETTE["brown"], ">", 10.0),
}

SHAPES: Mapping[str, str] = {"coulomb": "o", "cone": "^", "pyramid": "D", "box": "s", "normal": "v"}
SHAPE_LABELS: Mapping[str, str] = {"normal": "normal: no friction,\nnot in the front"}


def look_of(row: Record) -> Look:
    """Return how the row is drawn."""
    return LOOKS.get(row.solver, OTHER_BACKEND) if row.engine == OWN else PEER_LOOKS[row.engine]


def speed_accuracy(
    rows: Sequence[Record], axis: Axis, titles: Mapping[str, str], heading: str, footer: str, stem: Path
) -> list[Path]:
    """Draw step time against error, one panel per scene, and write stem.png and stem.svg.

    Parameters
    ----------
    rows : sequence of Record
        Rows without a measured step, of another case, or with fewer steps than the others are left out.
    axis : Axis
        One of `AXES`.
    titles : mapping
        Panel title of each scene, in the order of the panels.
    heading, footer : str
        Lines above and below the panels.
    stem : Path
        Where to write, without the suffix.

    Returns
    -------
    The paths written; none when no row of this case was measured.
    """
    # A stack that was followed for a few steps only has had no time to drift.
    drawn = [
        row for row in rows if row.scene in titles and row.case == axis.case and row.measured and not row.cut_short
    ]
    scenes = [scene for scene in titles if any(row.scene == scene for row in drawn)]
    if not scenes:
        return []
    with house_style():
        figure, panels, legend, axes = panel_grid(len(scenes))
        for ax, scene in zip(axes, scenes, strict=True):
            _panel(ax, [row for row in drawn if row.scene == scene], axis)
            # Engines that blew up, or see a corner that lifts, report other numbers later: the first step's counts.
            contacts = next(
                (row.contacts for row in rows if row.scene == scene and row.case == "cold" and row.measured), 0
            )
            title_panel(ax, titles[scene], f"{contacts} contacts")
        label_figure(figure, panels, "wall time per step, ms", axis.label, heading, footer)
        _legend(legend, drawn)
        return save(figure, stem)


def _panel(ax: Axes, rows: Sequence[Record], axis: Axis) -> None:
    draw_front(ax, ((float(row.step_ms or 0.0), axis.value(row)) for row in rows if not row.frictionless))
    own = [row for row in rows if row.engine == OWN]
    for line in dict.fromkeys(row.line for row in own):
        members = sorted((row for row in own if row.line == line), key=lambda row: row.effort)
        look, hollow = look_of(members[0]), members[0].frictionless
        ax.plot(
            [float(row.step_ms or 0.0) for row in members],
            [axis.value(row) for row in members],
            color=look.colour,
            marker=SHAPES.get(members[0].formulation, "o"),
            markerfacecolor="white" if hollow else look.colour,
            markeredgecolor=look.colour if hollow else "white",
            markeredgewidth=1.4 if hollow else 0.8,
            linewidth=0.9 if hollow else None,
            clip_on=False,
            zorder=3 if hollow else 4,
        )
    for engine, look in PEER_LOOKS.items():
        # Of a peer, the settings that none of its others beats in both: a dozen settings would hide each other.
        best = pareto_front((float(row.step_ms or 0.0), axis.value(row)) for row in rows if row.engine == engine)
        if not best:
            continue  # a line without points has no extent, which the layout cannot bear
        ax.plot(
            [time for time, _ in best],
            [error for _, error in best],
            color=look.colour,
            marker=look.marker,
            markersize=look.size,
            linestyle="--",
            markeredgecolor="white",
            markeredgewidth=0.8,
            clip_on=False,
            zorder=5,
        )
    log_axes(ax)
    ax.set_ylim(axis.floor / 3, 3 * axis.ceiling)


def _legend(figure: matplotlib.figure.FigureBase, rows: Sequence[Record]) -> None:
    """Draw the legends beside the panels: colour says the solver, shape says the program it solves."""
    present = dict.fromkeys(look_of(row) for row in rows)
    own = [look for look in [*LOOKS.values(), OTHER_BACKEND] if look in present]
    peers = [look for look in PEER_LOOKS.values() if look in present]
    shapes = [name for name in SHAPES if any(row.formulation == name and row.engine == OWN for row in rows)]
    blocks = [
        ("gpx-lcp, by solver", [(swatch(look.colour), look.label) for look in own]),
        ("and by program", [(_shape(name), SHAPE_LABELS.get(name, name)) for name in shapes]),
        ("peers, their best settings", [(_peer(look), look.label) for look in peers]),
        ("", [front_entry()]),
    ]
    draw_legends(figure, blocks)


def _shape(name: str) -> Line2D:
    face = "white" if name == "normal" else QUIET
    return Line2D([], [], color=QUIET, marker=SHAPES[name], linestyle="", markerfacecolor=face)


def _peer(look: Look) -> Line2D:
    return Line2D(
        [], [], color=look.colour, marker=look.marker, markersize=look.size, linestyle="--", markeredgecolor="white"
    )

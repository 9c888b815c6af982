"""The stability map: solvers along the top, failure modes down the side, and where and how each climb ended."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Final

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from benchmarks.attempts import OWN
from benchmarks.drawing import FOOTER_SIZE, save, wrapped
from benchmarks.engines import ENGINES
from benchmarks.stability.breaks import Break
from benchmarks.stability.climbing import DIVERGES, OTHER_LAW, SAYS_SO, SILENT, STANDS, TOO_SLOW
from benchmarks.stability.contestants import FRICTIONLESS
from benchmarks.style import INK, PALETTE, QUIET, house_style

SYMBOLS: Final = {STANDS: "✓", OTHER_LAW: "≠", SAYS_SO: "!", TOO_SLOW: "…", DIVERGES: "∞", SILENT: "✗"}
WORDS: Final = {
    STANDS: "stands to the last rung",
    OTHER_LAW: "poses another law,\nwhich differs here",
    SAYS_SO: "says that it failed",
    TOO_SLOW: "too slow",
    DIVERGES: "diverges",
    SILENT: "wrong, and nothing\nreports it",
}
# Light to dark with how bad it is, so that the map reads in grey, too; colour and symbol say the same.
FILL: Final = {
    STANDS: "#dbeeea",
    OTHER_LAW: "#e3e5e8",
    SAYS_SO: "#bfe0f5",
    TOO_SLOW: "#f5d58a",
    DIVERGES: PALETTE["purple"],
    SILENT: PALETTE["vermillion"],
}
LIGHT_INK: Final = frozenset((DIVERGES, SILENT))

# Of a cell, of the words left of the cells, and of a letter of a column's name, inches.
WIDTH, HEIGHT = 0.62, 0.4
LEFT, LETTER = 4.1, 0.083

Column = tuple[str, str, str]


def draw_map(found: Sequence[Break], footer: str, stem: Path) -> list[Path]:
    """Write stem.png and stem.svg: gpx-lcp's solvers above, the peers below, where there are any."""
    columns = columns_of(found)
    parts = [
        Part(title, [column for column in columns if (column[0] == OWN) == own], found)
        for title, own in (
            ("gpx-lcp, and the backends that it finds", True),
            ("Its peers, at their most careful", False),
        )
    ]
    parts = [part for part in parts if part.columns]
    with house_style():
        # The axes are cells and nothing else; words lie outside, and the picture is as large as they need.
        width = WIDTH * max(len(part.columns) for part in parts)
        height = sum(part.height for part in parts) - parts[0].head
        figure = Figure(figsize=(width, height))
        left, top = -LEFT / width, 1.0
        for place, part in enumerate(parts):
            top -= part.head / height if place else 0.0
            bottom = top - part.cells / height
            ax = figure.add_axes((0.0, bottom, WIDTH * len(part.columns) / width, part.cells / height))
            _draw(ax, part)
            at = top + (part.names + 0.05) / height
            figure.text(left, at, part.title, fontsize=14, fontweight="bold", va="bottom")
            top = bottom
        title = "Where each solver breaks, and how"
        figure.text(left, 1.0 + (0.55 + parts[0].names) / height, title, fontsize=17, fontweight="bold")
        handles = [Rectangle((0, 0), 1, 1, facecolor=FILL[name]) for name in WORDS]
        entries = [f"{SYMBOLS[name]}  {text}" for name, text in WORDS.items()]
        figure.legend(
            handles, entries, loc="upper left", bbox_to_anchor=(left, -0.1 / height), ncols=6, fontsize=12,
            borderaxespad=0.0,
        )  # fmt: skip
        note = (
            "A cell is the rung on which a solver breaks; the ladder of a failure mode is written beside it. Ladders "
            "without friction pose the program normal, whichever else a column stands for. Empty: not asked."
        )
        text = wrapped(f"{note}\n{footer}", width + LEFT)
        figure.text(left, -0.75 / height, text, va="top", fontsize=FOOTER_SIZE, color=QUIET)
        return save(figure, stem)


class Part:
    """Some of the columns, with the failure modes that any of them was asked.

    Attributes
    ----------
    cells, names, head : float, inches
        Height of the cells, of the columns' names, and of all that stands above the cells.
    """

    def __init__(self, title: str, columns: Sequence[Column], found: Sequence[Break]) -> None:
        self.title, self.columns = title, columns
        engines = {column[0] for column in columns}
        self.breaks = {(one.mode, one.engine, one.solver, one.formulation): one for one in found}
        self.modes = list(dict.fromkeys(one.mode for one in found if one.engine in engines))
        self.ladders = {one.mode: one.on_ladder for one in found}
        self.cells = HEIGHT * len(self.modes)
        self.names = LETTER * max((len(_words(column)) for column in columns), default=0)
        self.head = self.names + 0.7

    @property
    def height(self) -> float:
        """Of the part, inches."""
        return self.head + self.cells

    def at(self, mode: str, column: Column) -> Break | None:
        """Return where the climb of a column on a ladder ended; of gpx-lcp, maybe with the program `normal`."""
        engine, solver, formulation = column
        posed = FRICTIONLESS if self.ladders[mode].frictionless and engine == OWN else formulation
        return self.breaks.get((mode, engine, solver, posed))


def columns_of(found: Sequence[Break]) -> list[Column]:
    """Return engine, solver and program of each column; those of `normal` stand in those with friction, if any."""
    every = list(dict.fromkeys((one.engine, one.solver, one.formulation) for one in found))
    rough = {(engine, solver) for engine, solver, formulation in every if formulation != FRICTIONLESS}
    columns = [column for column in every if column[2] != FRICTIONLESS or column[:2] not in rough]
    engines = list(ENGINES)
    solvers = list(dict.fromkeys(column[:2] for column in columns))
    return sorted(columns, key=lambda column: (engines.index(column[0]), solvers.index(column[:2])))


def _cell(ax: Axes, place: int, row: int, one: Break) -> None:
    ax.add_patch(Rectangle((place - 0.48, row - 0.46), 0.96, 0.92, facecolor=FILL[one.outcome], linewidth=0))
    text = f"{SYMBOLS[one.outcome]} {one.rung}".strip()
    colour = "white" if one.outcome in LIGHT_INK else INK
    size = 12.0 if len(text) < 6 else 10.5 if len(text) < 8 else 9.0
    ax.text(place, row, text, ha="center", va="center", fontsize=size, color=colour)


def _draw(ax: Axes, part: Part) -> None:
    for row, mode in enumerate(part.modes):
        for place, column in enumerate(part.columns):
            if (one := part.at(mode, column)) is not None:
                _cell(ax, place, row, one)
    ax.set_xlim(-0.5, len(part.columns) - 0.5)
    ax.set_ylim(len(part.modes) - 0.5, -0.5)
    ax.grid(visible=False)
    for side in ax.spines.values():
        side.set_visible(False)
    ax.tick_params(length=0)
    ax.xaxis.tick_top()
    names = [_words(column) for column in part.columns]
    ax.set_xticks(range(len(names)), names, rotation=52, ha="left", rotation_mode="anchor", fontsize=12)
    ax.set_yticks([])
    for row, mode in enumerate(part.ladders[name] for name in part.modes):
        ladder = f"{mode.code} · {mode.knob} {mode.labels[0]} … {mode.labels[-1]}"
        ax.text(-0.7, row - 0.01, mode.title, ha="right", va="bottom", fontsize=12, color=INK)
        ax.text(-0.7, row + 0.01, ladder, ha="right", va="top", fontsize=9.5, color=QUIET)
    # Engines apart.
    for place in range(1, len(names)):
        if part.columns[place][0] != part.columns[place - 1][0]:
            ax.axvline(place - 0.5, color=QUIET, linewidth=1.0)


def _words(column: Column) -> str:
    engine, *rest = column
    return " ".join(filter(None, ("" if engine == OWN else engine, *rest)))

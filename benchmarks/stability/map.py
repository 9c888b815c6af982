"""The stability map: solvers along the top, failure modes down the side, and where and how each climb ended."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from benchmarks.attempts import OWN
from benchmarks.drawing import save
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
    """Write stem.png and stem.svg."""
    columns, modes = columns_of(found), list(dict.fromkeys(one.mode for one in found))
    cells = {(one.mode, one.engine, one.solver, one.formulation): one for one in found}
    with house_style():
        # The axes are the cells and nothing else; words lie outside, and the picture is as large as they need.
        width, height = WIDTH * len(columns), HEIGHT * len(modes)
        figure = Figure(figsize=(width, height))
        ax = figure.add_axes((0.0, 0.0, 1.0, 1.0))
        for row, mode in enumerate(modes):
            for place, (engine, solver, formulation) in enumerate(columns):
                posed = FRICTIONLESS if cells_without_friction(mode, found) and engine == OWN else formulation
                one = cells.get((mode, engine, solver, posed))
                if one is not None:
                    _cell(ax, place, row, one)
        _frame(ax, columns, [next(one for one in found if one.mode == mode) for mode in modes])
        left, names = -LEFT / width, LETTER * max(len(_words(column)) for column in columns)
        handles = [Rectangle((0, 0), 1, 1, facecolor=FILL[name]) for name in WORDS]
        entries = [f"{SYMBOLS[name]}  {text}" for name, text in WORDS.items()]
        ax.legend(
            handles, entries, loc="upper left", bbox_to_anchor=(left, -0.1 / height), ncols=6, fontsize=12,
            borderaxespad=0.0,
        )  # fmt: skip
        title = "Where each solver breaks, and how"
        figure.text(left, 1.0 + (0.4 + names) / height, title, fontsize=17, fontweight="bold")
        note = (
            "A cell is the rung on which a solver breaks; the ladder of a failure mode is written beside it. Ladders "
            "without friction pose the program normal, whichever else a column stands for. Empty: not asked."
        )
        text = "\n".join(textwrap.fill(part, max(100, int((width + LEFT) / 0.083))) for part in (note, footer))
        figure.text(left, -0.75 / height, text, va="top", fontsize=11, color=QUIET)
        return save(figure, stem)


def cells_without_friction(mode: str, found: Sequence[Break]) -> bool:
    """Whether a mode poses the program `normal`."""
    return next(one for one in found if one.mode == mode).on_ladder.frictionless


def columns_of(found: Sequence[Break]) -> list[Column]:
    """Return engine, solver and program of each column; those of `normal` stand in those with friction, if any."""
    every = list(dict.fromkeys((one.engine, one.solver, one.formulation) for one in found))
    rough = {(engine, solver) for engine, solver, formulation in every if formulation != FRICTIONLESS}
    columns = [column for column in every if column[2] != FRICTIONLESS or column[:2] not in rough]
    engines = list(dict.fromkeys(column[0] for column in columns))
    solvers = list(dict.fromkeys(column[:2] for column in columns))
    return sorted(columns, key=lambda column: (engines.index(column[0]), solvers.index(column[:2])))


def _cell(ax: Axes, place: int, row: int, one: Break) -> None:
    ax.add_patch(Rectangle((place - 0.48, row - 0.46), 0.96, 0.92, facecolor=FILL[one.outcome], linewidth=0))
    text = f"{SYMBOLS[one.outcome]} {one.rung}".strip()
    colour = "white" if one.outcome in LIGHT_INK else INK
    size = 12.0 if len(text) < 6 else 10.5 if len(text) < 8 else 9.0
    ax.text(place, row, text, ha="center", va="center", fontsize=size, color=colour)


def _frame(ax: Axes, columns: Sequence[Column], ladders: Sequence[Break]) -> None:
    ax.set_xlim(-0.55, len(columns) - 0.45)
    ax.set_ylim(len(ladders) - 0.45, -0.55)
    ax.grid(visible=False)
    for side in ax.spines.values():
        side.set_visible(False)
    ax.tick_params(length=0)
    ax.xaxis.tick_top()
    names = [_words(column) for column in columns]
    ax.set_xticks(range(len(columns)), names, rotation=52, ha="left", rotation_mode="anchor", fontsize=12)
    ax.set_yticks([])
    for row, one in enumerate(ladders):
        mode = one.on_ladder
        ladder = f"{mode.code} · {mode.knob} {mode.labels[0]} … {mode.labels[-1]}"
        ax.text(-0.7, row - 0.01, mode.title, ha="right", va="bottom", fontsize=12, color=INK)
        ax.text(-0.7, row + 0.01, ladder, ha="right", va="top", fontsize=9.5, color=QUIET)
    # Ours and the peers apart.
    for place in range(1, len(columns)):
        if (columns[place][0] == OWN) != (columns[place - 1][0] == OWN):
            ax.axvline(place - 0.5, color=INK, linewidth=1.2)


def _words(column: Column) -> str:
    engine, *rest = column
    return " ".join(filter(None, ("" if engine == OWN else engine, *rest)))

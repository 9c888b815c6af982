"""The one house style of every chart: type sizes that survive halving, a colour-blind safe palette, quiet axes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any, Final

import matplotlib

INK: Final = "#22252a"
QUIET: Final = "#6b7079"
GRID: Final = "#e3e5e8"
FRONT: Final = "#c9ccd1"

# Okabe & Ito's eight colours, told apart under every common colour blindness; yellow is left out, as it fades on white.
PALETTE: Final[Mapping[str, str]] = {
    "blue": "#0072b2",
    "sky": "#56b4e9",
    "green": "#009e73",
    "orange": "#e69f00",
    "vermillion": "#d55e00",
    "purple": "#cc79a7",
    "black": "#22252a",
    # From Paul Tol's muted scheme, and a brown, as eight are not enough.
    "indigo": "#332288",
    "olive": "#999933",
    "wine": "#882255",
    "brown": "#7f5539",
}

# One colour for each solver of gpx-lcp, in every chart.
SOLVERS: Final[Mapping[str, str]] = {
    "pgs": PALETTE["blue"],
    "interior_point": PALETTE["green"],
    "newton": PALETTE["indigo"],
    "lemke": PALETTE["sky"],
    "osqp": PALETTE["orange"],
}

STYLE: Final[Mapping[str, Any]] = {
    "figure.facecolor": "white",
    "savefig.facecolor": "white",
    "font.family": "DejaVu Sans",
    "font.size": 13,
    "axes.titlesize": 14.5,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.labelsize": 13,
    "axes.labelcolor": INK,
    "axes.edgecolor": QUIET,
    "axes.linewidth": 0.9,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.axisbelow": True,
    "text.color": INK,
    "xtick.color": QUIET,
    "ytick.color": QUIET,
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
    "xtick.labelsize": 12,
    "ytick.labelsize": 12,
    "axes.grid": True,
    "grid.color": GRID,
    "grid.linewidth": 0.9,
    "legend.frameon": False,
    "legend.fontsize": 12.5,
    "lines.linewidth": 1.8,
    "lines.markersize": 8.5,
    "svg.fonttype": "path",
}


@contextmanager
def house_style() -> Iterator[None]:
    """Draw inside this block in the house style, and leave matplotlib as it was."""
    with matplotlib.rc_context(dict(STYLE)):
        yield

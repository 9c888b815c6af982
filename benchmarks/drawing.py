"""What every chart shares: the Pareto front, logarithmic axes, legends beside the panels, and the files."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Sequence
from pathlib import Path

from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure, SubFigure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator
from matplotlib.transforms import blended_transform_factory

from benchmarks.style import FRONT, INK, QUIET

# Of a figure, inches.
LEAST_HEIGHT = 6.9
# How far below the top of the figure the legends begin, inches.
LEGEND_TOP = 0.85
# Of the line below the panels, points, and of one of its letters, inches.
FOOTER_SIZE, FOOTER_LETTER = 11, 0.083

# A line of a legend: what is drawn, and what it means.
Entry = tuple[Artist, str]


def pareto_front(points: Iterable[tuple[float, float]]) -> list[tuple[float, float]]:
    """Return, by rising time, the points (time, error) that no other one beats in both."""
    front: list[tuple[float, float]] = []
    for time, error in sorted(points):
        if not front or error < front[-1][1]:
            front.append((time, error))
    return front


def panel_grid(
    count: int, width: float = 4.1, height: float = 3.6, shared: bool = True
) -> tuple[Figure, SubFigure, SubFigure, list[Axes]]:
    """Return a figure, its part for the panels, its part for the legend, and `count` panels, three in a row at most.

    A panel is `width` by `height` inches; all share their axes, unless told otherwise.
    """
    columns = min(3, count)
    lines = -(-count // columns)
    # With air below the heading and between the panels.
    layout = ConstrainedLayoutEngine(h_pad=0.11, w_pad=0.09)
    # The legend, and the label beside a single row of panels, need some height of their own.
    size = (width * columns + 3.3, max(height * lines + 1.9, LEAST_HEIGHT))
    figure = Figure(figsize=size, layout=layout)
    panels, legend = figure.subfigures(1, 2, squeeze=False, width_ratios=(width * columns, 3.1))[0]
    axes = list(panels.subplots(lines, columns, squeeze=False, sharey=shared, sharex=shared).flat)
    for ax in axes[count:]:
        ax.set_visible(False)
    return figure, panels, legend, axes[:count]


def title_panel(ax: Axes, title: str, size: str) -> None:
    """Write what the panel shows, and on the right how large that is; a long title is set smaller."""
    ax.set_title(title, fontsize=14.5 * min(1.0, 16 / max(1, len(title))))
    ax.set_title(size, loc="right", fontsize=11.5, fontweight="normal", color=QUIET)


def label_figure(figure: Figure, panels: SubFigure, time: str, error: str, heading: str, footer: str) -> None:
    """Write the labels of the shared axes, and the lines above and below the panels."""
    panels.supxlabel(time, color=INK, fontsize=13)
    panels.supylabel(error, color=INK, fontsize=13)
    figure.suptitle(heading, x=0.01, ha="left", fontsize=17, fontweight="bold")
    text = wrapped(footer, figure.get_figwidth())
    figure.text(0.01, -0.012, text, ha="left", va="top", fontsize=FOOTER_SIZE, color=QUIET)


def wrapped(footer: str, inches: float) -> str:
    """Return the footer in lines no longer than the picture is wide, or the picture would grow with them."""
    return "\n".join(textwrap.fill(line, max(60, int(inches / FOOTER_LETTER))) for line in footer.splitlines())


def draw_front(ax: Axes, points: Iterable[tuple[float, float]]) -> None:
    """Draw the front of (time, error) behind everything else."""
    front = pareto_front(points)
    # A staircase: between two points, nothing reaches the lower error in less than the later time.
    ax.step([t for t, _ in front], [e for _, e in front], where="post", color=FRONT, linewidth=7, zorder=1)


def front_entry() -> Entry:
    """Return what the legend says of the front."""
    line = Line2D([], [], color=FRONT, linewidth=7)
    return line, "Pareto front: nothing\nelse is both faster\nand more accurate"


def swatch(colour: str) -> Line2D:
    """Return a bar of colour for a legend."""
    return Line2D([], [], color=colour, linewidth=6)


def log_axes(ax: Axes) -> None:
    """Make both axes logarithmic: time in plain numbers along x, errors by the thousand along y."""
    ax.set_xscale("log")
    ax.set_yscale("log")
    ax.yaxis.set_major_locator(LogLocator(base=1000.0, numticks=12))
    ax.yaxis.set_minor_locator(NullLocator())
    plain_decades(ax.xaxis)


def plain_decades(axis: Axis) -> None:
    """Label a logarithmic axis with plain numbers, one for each power of ten."""
    axis.set_major_locator(LogLocator(base=10.0, numticks=12))
    axis.set_minor_locator(NullLocator())
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))


def draw_legends(figure: SubFigure, blocks: Sequence[tuple[str, Sequence[Entry]]]) -> None:
    """Draw blocks of (title, entries) below each other, from the top left; an empty one is left out."""
    # Each block starts where the one above it ends, in heights of the whole figure: how much of it the part for the
    # legend gets is known only when the figure is drawn.
    root = figure.get_figure(root=True)
    renderer = FigureCanvasAgg(root).get_renderer()
    inch = 1.0 / root.get_figheight()
    place = blended_transform_factory(figure.transSubfigure, root.transFigure)
    top = 1.0 - LEGEND_TOP * inch
    for title, entries in blocks:
        if not entries:
            continue
        handles, labels = zip(*entries, strict=True)
        drawn = figure.legend(
            handles,
            labels,
            title=title,
            loc="upper left",
            bbox_to_anchor=(0.0, top),
            bbox_transform=place,
            alignment="left",
            handlelength=2.0,
        )
        drawn.get_title().set_fontweight("bold")
        top -= drawn.get_window_extent(renderer).height / root.dpi * inch


def save(figure: Figure, stem: Path) -> list[Path]:
    """Write stem.png and stem.svg and return their paths."""
    stem.parent.mkdir(parents=True, exist_ok=True)
    paths = [stem.with_name(f"{stem.name}.{kind}") for kind in ("png", "svg")]
    FigureCanvasAgg(figure).print_figure(paths[0], dpi=150, bbox_inches="tight", pad_inches=0.15)
    FigureCanvasSVG(figure).print_figure(paths[1], bbox_inches="tight", pad_inches=0.15)
    return paths

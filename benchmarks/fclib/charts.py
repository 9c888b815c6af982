"""Charts of the suite: a performance profile for each tolerance, and time against accuracy on the largest problems."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import inf, isfinite
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.ticker import PercentFormatter

from benchmarks.drawing import (
    Entry,
    draw_front,
    draw_legends,
    front_entry,
    label_figure,
    log_axes,
    panel_grid,
    pareto_front,
    plain_decades,
    save,
    swatch,
    title_panel,
)
from benchmarks.fclib.batches import AUTOMATIC, Line
from benchmarks.fclib.profiles import performance_ratios, profile
from benchmarks.fclib.scores import Scores, Subject
from benchmarks.interface import Array, scientific
from benchmarks.style import FRONT, INK, PALETTE, QUIET, SOLVERS, house_style

PEER = PALETTE["vermillion"]
# For the peers that are told apart by name; the others are drawn thin and grey.
PEERS = (PALETTE["purple"], PALETTE["orange"], PALETTE["sky"], "#999933")
NAMED_IN_A_PANEL = 2

# For lines without a colour of their own, in the order in which they come.
MORE = (PALETTE["sky"], PALETTE["orange"], PALETTE["purple"], QUIET)

PANELS = 9
FLOOR, CEILING = 1e-16, 3.0

# Ratios beyond are not drawn.
FARTHEST = 1e5


@dataclass(frozen=True)
class Curve:
    """A line of a profile: whose, and its ratios to the best on every problem of the panel."""

    label: str
    ratios: Array

    @property
    def strength(self) -> tuple[float, float]:
        """For ranking: the share solved, then how near to the best."""
        solved = self.ratios[np.isfinite(self.ratios)]
        return solved.size / self.ratios.size, -float(np.log(solved).mean()) if solved.size else -inf


@dataclass(frozen=True)
class Panel:
    """The curves over one set of problems."""

    title: str
    problems: int
    own: Sequence[Curve]
    peers: Sequence[Curve]
    best_peer: Curve | None


def colours(lines: Sequence[Line]) -> dict[str, str]:
    """Return the colour of each line by its label."""
    spare = iter(MORE * len(lines))
    chosen = {AUTOMATIC: INK, **SOLVERS}
    exact = {line.label: chosen[line.solver] for line in lines if line.label in chosen}
    return {line.label: exact.get(line.label) or next(spare) for line in lines}


def panels_at(scores: Scores, tolerance: float) -> list[Panel]:
    """Return a panel for problems in space and one for those in the plane, where there are any.

    With a baseline that measures this tolerance only the problems that it knows are counted, so that every curve is
    over the same problems. A peer is drawn where it was tried at least once; an untried problem counts as failed.
    """
    baseline = scores.peers_at(tolerance)
    found = []
    for dimension in (3, 2):
        subjects = [subject for subject in scores.subjects if subject.dimension == dimension]
        if baseline:
            subjects = [subject for subject in subjects if subject.name in baseline.problems]
        if subjects:
            found.append(_panel(scores, subjects, tolerance, f"in {dimension}-D"))
    return found


def _panel(scores: Scores, subjects: Sequence[Subject], tolerance: float, title: str) -> Panel:
    names = [subject.name for subject in subjects]
    own = {line.label: [scores.seconds(name, line, tolerance) for name in names] for line in scores.lines}
    peers: dict[str, list[float]] = {}
    best: list[list[float]] = []
    baseline = scores.peers_at(tolerance)
    if baseline:
        held = [baseline.problems[name] for name in names]
        peers = {solver: [p.seconds(solver, tolerance) for p in held] for solver in baseline.solvers(names)}
        best = [[p.best(tolerance) for p in held]]
    ratios = performance_ratios(np.array([*own.values(), *peers.values(), *best]).T).T
    curves = [Curve(label, row) for label, row in zip([*own, *peers, "best of each problem"], ratios, strict=False)]
    return Panel(
        title, len(names), curves[: len(own)], curves[len(own) : len(own) + len(peers)], curves[-1] if best else None
    )


def profile_chart(scores: Scores, tolerance: float, footer: str, stem: Path) -> list[Path]:
    """Draw the performance profile at one tolerance; write stem.png and stem.svg, or nothing without a problem."""
    panels = panels_at(scores, tolerance)
    if not panels:
        return []
    own = colours(scores.lines)
    named: dict[str, str] = {}
    for panel in panels:
        strongest = sorted(panel.peers, key=lambda curve: curve.strength, reverse=True)
        for curve in strongest[:NAMED_IN_A_PANEL]:
            named.setdefault(curve.label, PEERS[len(named) % len(PEERS)])
    every = np.concatenate([c.ratios for p in panels for c in (*p.own, *p.peers)])
    farthest = min(FARTHEST, 10.0 ** np.ceil(np.log10(np.max(every, where=np.isfinite(every), initial=10.0))))
    with house_style():
        width = 7.4 if len(panels) == 1 else 5.6
        figure, parts, legend, axes = panel_grid(len(panels), width, 4.9)
        for ax, panel in zip(axes, panels, strict=True):
            _draw_profile(ax, panel, own, named, farthest)
            title_panel(ax, f"Problems {panel.title}", f"{panel.problems} problems")
        heading = f"Performance profile at {scientific(tolerance)}"
        label_figure(
            figure,
            parts,
            "solve time / that of the fastest solver on the problem",
            "share of the problems solved within it",
            heading,
            footer,
        )
        others = len({curve.label for panel in panels for curve in panel.peers} - set(named))
        entries: list[Entry] = [(_dashed(colour), label) for label, colour in named.items()]
        if any(panel.best_peer for panel in panels):
            entries.insert(0, (_dashed(PEER, 2.6), "best of each problem"))
        if others:
            entries.append((_dashed(FRONT, 1.1), f"{others} others"))
        draw_legends(
            legend,
            [
                ("gpx-lcp", [(swatch(colour), label) for label, colour in own.items()]),
                (scores.baseline.name if scores.baseline else "", entries),
            ],
        )
        return save(figure, stem)


def _draw_profile(ax: Axes, panel: Panel, own: Mapping[str, str], named: Mapping[str, str], farthest: float) -> None:
    ax.set_xscale("log")
    for curve in panel.peers:
        colour = named.get(curve.label)
        _draw_curve(
            ax, curve, farthest, color=colour or FRONT, linestyle="--", linewidth=1.6 if colour else 0.9, zorder=2
        )
    if panel.best_peer:
        _draw_curve(ax, panel.best_peer, farthest, color=PEER, linestyle="--", linewidth=2.6, zorder=3)
    for curve in panel.own:
        chosen = curve.label == AUTOMATIC
        width = 4.5 if chosen else 2.4
        _draw_curve(ax, curve, farthest, color=own[curve.label], linewidth=width, zorder=4 if chosen else 5)
    ax.set_xlim(0.93, farthest)
    ax.set_ylim(-0.02, 1.03)
    ax.yaxis.set_major_formatter(PercentFormatter(1.0))
    plain_decades(ax.xaxis)


def _draw_curve(ax: Axes, curve: Curve, farthest: float, **style: Any) -> None:
    tau, share = profile(curve.ratios)
    inside = tau <= farthest
    # From the left edge to the right one: nothing is solved below τ = 1, and a curve ends flat.
    x = np.concatenate(([1.0], tau[inside], [farthest]))
    y = np.concatenate(([0.0], share[inside], [share[inside][-1] if inside.any() else 0.0]))
    ax.step(x, y, where="post", solid_joinstyle="round", **style)


def accuracy_chart(scores: Scores, footer: str, stem: Path) -> list[Path]:
    """Draw solve time against the natural map on the largest problem of each family; nothing without a problem."""
    largest = {s.family: s for s in sorted(scores.subjects, key=lambda s: s.contacts)}
    subjects = [largest[family] for family in scores.families()][:PANELS]
    if not subjects:
        return []
    own = colours(scores.lines)
    with house_style():
        figure, parts, legend, axes = panel_grid(len(subjects))
        for ax, subject in zip(axes, subjects, strict=True):
            _draw_accuracy(ax, scores, subject, own)
            title_panel(ax, subject.family, f"{subject.contacts} contacts")
        label_figure(
            figure,
            parts,
            "solve time, ms",
            "natural map of the certificate",
            "Time against accuracy, on the largest problem of each family",
            footer,
        )
        marks: list[Entry] = [
            (Line2D([], [], color=QUIET, marker="o", linestyle=""), "tolerance held"),
            (_hollow(QUIET), "tolerance missed"),
        ]
        peer: list[Entry] = [(_peer_points(), "one run"), (_dashed(PEER), "its front")]
        draw_legends(
            legend,
            [
                ("gpx-lcp", [(swatch(colour), label) for label, colour in own.items()]),
                ("", marks),
                (scores.baseline.name, peer) if scores.baseline else ("", []),
                ("", [front_entry()]),
            ],
        )
        return save(figure, stem)


def _draw_accuracy(ax: Axes, scores: Scores, subject: Subject, own: Mapping[str, str]) -> None:
    points: list[tuple[float, float]] = []
    for line in scores.lines:
        tried = (scores.attempt(subject.name, line, tolerance) for tolerance in scores.tolerances)
        rows = [row for row in tried if row and row.solve_seconds is not None and row.natural_map is not None]
        x = [1e3 * (row.solve_seconds or 0.0) for row in rows]
        y = [_inside(row.natural_map or 0.0) for row in rows]
        points += zip(x, y, strict=True)
        chosen = line.solver == AUTOMATIC
        colour, size = own[line.label], 12.0 if chosen else 7.5
        ax.plot(x, y, color=colour, linewidth=4.5 if chosen else 1.8, zorder=3 if chosen else 4)
        for a, b, row in zip(x, y, rows, strict=True):
            face = colour if row.reached else "white"
            edge = "white" if row.reached else colour
            ax.plot(
                [a], [b], marker="o", color=colour, markerfacecolor=face, markeredgecolor=edge, markersize=size,
                markeredgewidth=0.8 if row.reached else 1.6, zorder=3.5 if chosen else 5, clip_on=False,
            )  # fmt: skip
    held = scores.baseline.problems.get(subject.name) if scores.baseline else None
    if held:
        finished = [run for run in held.runs if isfinite(run.seconds) and isfinite(run.natural_map)]
        runs = [(1e3 * run.seconds, _inside(run.natural_map)) for run in finished]
        ax.plot(*zip(*runs, strict=True) if runs else ([], []), **PEER_STYLE, zorder=2)
        front = pareto_front(runs)
        ax.step([t for t, _ in front], [e for _, e in front], where="post", color=PEER, linestyle="--", zorder=2)
        points += runs
    draw_front(ax, points)
    log_axes(ax)
    ax.set_ylim(FLOOR / 3, 3 * CEILING)


PEER_STYLE: Mapping[str, Any] = {"color": PEER, "marker": "x", "linestyle": "", "markersize": 5.0, "alpha": 0.75}


def _inside(natural_map: float) -> float:
    return min(max(natural_map, FLOOR), CEILING)


def _peer_points() -> Line2D:
    return Line2D([], [], **PEER_STYLE)


def _hollow(colour: str) -> Line2D:
    return Line2D([], [], color=colour, marker="o", linestyle="", markerfacecolor="white", markeredgewidth=1.6)


def _dashed(colour: str, width: float = 1.6) -> Line2D:
    return Line2D([], [], color=colour, linestyle="--", linewidth=width)

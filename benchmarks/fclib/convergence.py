"""The chart of convergence: the residual of the program over the iterations of each solver, as the solvers tell it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TypeAlias

from benchmarks import store
from benchmarks.answers import Archive
from benchmarks.drawing import draw_legends, label_figure, log_axes, panel_grid, save, swatch, title_panel
from benchmarks.fclib.batches import Line
from benchmarks.fclib.charts import CEILING, FLOOR, PANELS, colours
from benchmarks.fclib.scores import Scores
from benchmarks.interface import Array, scientific
from benchmarks.style import house_style

Histories: TypeAlias = Mapping[tuple[str, Line], Array]


def histories(scores: Scores, folder: Path) -> Histories:
    """Return what the stored answers tell of the tightest tolerance, by problem and line; those in `folder` alone."""
    found: dict[tuple[str, Line], Array] = {}
    archives: dict[str, Archive] = {}
    for subject in scores.subjects:
        for line in scores.lines:
            row = scores.attempt(subject.name, line, scores.tolerances[-1])
            if row is None or not row.answer:
                continue
            file, _, number = row.answer.rpartition(":")
            path = folder / store.ANSWERS / file
            if file not in archives and path.is_file():
                archives[file] = Archive(path)
            history = archives[file].history(int(number)) if file in archives else None
            if history is not None and len(history) > 1:
                found[subject.name, line] = history
    return found


def convergence_chart(scores: Scores, told: Histories, footer: str, stem: Path) -> list[Path]:
    """Draw the largest problem of each family; write stem.png and stem.svg, or nothing where no solver told any."""
    largest = {s.family: s for s in sorted(scores.subjects, key=lambda s: s.contacts)}
    subjects = [largest[family] for family in scores.families()]
    subjects = [s for s in subjects if any(name == s.name for name, _ in told)][:PANELS]
    if not subjects:
        return []
    own = colours(scores.lines)
    with house_style():
        figure, parts, legend, axes = panel_grid(len(subjects))
        for ax, subject in zip(axes, subjects, strict=True):
            for (name, line), history in told.items():
                if name == subject.name:
                    # The start, before any iteration, has no place on a logarithmic axis but at its edge.
                    iterations = history[:, 0].clip(min=0.7)
                    ax.plot(
                        iterations, history[:, 1].clip(FLOOR, CEILING), color=own[line.label], drawstyle="steps-post"
                    )
            log_axes(ax)
            ax.set_ylim(FLOOR / 3, 3 * CEILING)
            title_panel(ax, subject.family, f"{subject.contacts} contacts")
        label_figure(
            figure,
            parts,
            "iterations: sweeps of pgs, steps of the others",
            "residual of the program",
            f"Convergence to {scientific(scores.tolerances[-1])}, on the largest problem of each family",
            footer,
        )
        drawn = {line.label for _, line in told}
        draw_legends(legend, [("gpx-lcp", [(swatch(own[label]), label) for label in own if label in drawn])])
        return save(figure, stem)

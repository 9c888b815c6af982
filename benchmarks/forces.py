"""The picture of a stack: its bodies from the side, each contact force as an arrow, and the load at each interface."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Polygon

import gpx_lcp as gpx
from benchmarks import stacks
from benchmarks.bodies import Bodies, rotation_matrices
from benchmarks.drawing import draw_legends, panel_grid, save, swatch, title_panel, wrapped
from benchmarks.interface import Array
from benchmarks.measures import layers
from benchmarks.style import INK, PALETTE, QUIET, house_style

# Of the suite stacks, those that tell the most and are small enough to be read.
SCENES = ("tower-5", "wall-5", "heavy-on-light")

# Length of the longest arrow, in units of a body's height.
LONGEST = 0.75

FORCE = PALETTE["vermillion"]


def force_chart(scenes: tuple[str, ...], footer: str, stem: Path) -> list[Path]:
    """Draw the first step of each scene, solved by newton to 1e-10; write stem.png and stem.svg."""
    with house_style():
        figure, _, legend, axes = panel_grid(len(scenes), 5.4, 6.0, shared=False)
        for ax, name in zip(axes, scenes, strict=True):
            kind = stacks.SCENES[name]
            scene = kind.make()
            world = gpx.World(scene, stacks.TIME_STEP, solver="newton", tolerance=1e-10)
            bodies = Bodies.from_scene(scene)
            world.step()
            right = _draw_bodies(ax, scene)
            _draw_forces(ax, world.contacts)
            _write_loads(ax, right, bodies, world.contacts)
            title_panel(ax, kind.title, f"{len(scene.bodies)} bodies")
            ax.set_aspect("equal", anchor="S")
            ax.margins(0.12, 0.04)
            ax.axis("off")
        figure.suptitle(
            "Contact forces of stacks at rest, first step, from the side",
            x=0.01, ha="left", fontsize=17, fontweight="bold",
        )  # fmt: skip
        width = figure.get_size_inches()[0]
        note = (
            "An arrow is the force of one contact on the body above it; contacts behind each other are drawn as their "
            "sum. Numbers: vertical force through the interface / weight above it."
        )
        text = wrapped(f"{note}\n{footer}", width)
        figure.text(0.01, -0.012, text, ha="left", va="top", fontsize=11, color=QUIET)
        draw_legends(legend, [("", [(swatch(FORCE), "contact force;\nthe longest arrow of\na panel is its largest")])])
        return save(figure, stem)


def _draw_bodies(ax: Axes, scene: gpx.Scene) -> float:
    """Draw the boxes, and the ground below them; return how far they reach to the right, m."""
    sides = []
    turn = rotation_matrices(np.array([body.orientation for body in scene.bodies]))
    signs = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)])
    for body, rotation in zip(scene.bodies, turn, strict=True):
        assert isinstance(body.shape, gpx.Box)
        half = np.asarray(body.shape.numbers())
        corners = np.column_stack((signs[:, 0] * half[0], np.zeros(4), signs[:, 1] * half[2])) @ rotation.T
        outline = (corners + body.position)[:, [0, 2]]
        sides += [*outline[:, 0]]
        ax.add_patch(Polygon(outline, closed=True, facecolor="#f4f5f6", edgecolor=QUIET, linewidth=1.2, zorder=2))
    ax.plot([min(sides) - 0.3, max(sides) + 0.3], [0.0, 0.0], color=INK, linewidth=2.0, zorder=1)
    return max(sides)


def _draw_forces(ax: Axes, contacts: gpx.Contacts) -> None:
    """Draw the forces, those behind each other added up, on the body above."""
    sign = np.where(contacts.force[:, 2] < 0.0, -1.0, 1.0)
    places, index = np.unique(np.round(contacts.point[:, [0, 2]], 6), axis=0, return_inverse=True)
    total = np.zeros((len(places), 2))
    np.add.at(total, index.ravel(), (sign[:, None] * contacts.force)[:, [0, 2]])
    largest = float(np.linalg.norm(total, axis=1).max(initial=0.0))
    if largest == 0.0:
        return
    arrows = LONGEST * total / largest
    ax.quiver(
        places[:, 0], places[:, 1], arrows[:, 0], arrows[:, 1],
        angles="xy", scale_units="xy", scale=1.0, color=FORCE, width=0.007, zorder=4, headwidth=4.0, headlength=5.0,
    )  # fmt: skip


def _write_loads(ax: Axes, right: float, bodies: Bodies, contacts: gpx.Contacts) -> None:
    """Write, beside each interface, what it carries against the weight above it."""
    layer = layers(bodies.start.position[:, 2])
    for cut in range(int(layer.max()) + 1):
        carried, height = _through(cut, layer, contacts)
        weight = float(bodies.mass[layer >= cut].sum() * np.linalg.norm(bodies.gravity))
        ax.plot([right + 0.4, right + 0.6], [height, height], color=QUIET, linewidth=1.0, zorder=1)
        ax.text(right + 0.7, height, f"{carried:.5g} / {weight:.5g} N", va="center", fontsize=11, color=INK)
    # Room for the words, which matplotlib does not count.
    ax.set_xlim(right=right + 0.7 + 0.35 * (right - ax.get_xlim()[0]) + 0.8)


def _through(cut: int, layer: Array, contacts: gpx.Contacts) -> tuple[float, float]:
    """Return the vertical force through the cut below a layer, N, and the height of its contacts, m."""
    below = np.where(contacts.body_a < 0, -1, layer[contacts.body_a])
    above = np.where(contacts.body_b < 0, -1, layer[contacts.body_b])
    up, down = (below < cut) & (above >= cut), (above < cut) & (below >= cut)
    carried = float(contacts.force[up, 2].sum() - contacts.force[down, 2].sum())
    return carried, float(contacts.point[up | down, 2].mean())

"""Rows in pictures."""

import re

import matplotlib
import numpy as np
import pytest
from matplotlib.image import imread

from benchmarks.charts import AXES, speed_accuracy
from benchmarks.drawing import pareto_front
from benchmarks.engines import PEERS
from tests.benchmarks.make_record import record as row

TITLES = {"tower-5": "Tower of 5", "wall-5": "Wall, 5 rows", "tower-10": "not measured"}


ROWS = [
    row(step_ms=1.0, load_error=1e-3, contacts=20),
    row(step_ms=2.0, load_error=1e-6, contacts=20),
    row(step_ms=0.5, load_error=1e-9, formulation="normal", contacts=20),
    row(step_ms=0.2, load_error=float("inf"), engine="pybullet", solver="SI", formulation="box", contacts=20),
    row("wall-5", step_ms=9.0, load_error=0.0, solver="a backend of tomorrow", formulation="pyramid", contacts=100),
    row("wall-5", case="stepped", step_ms=9.0, drift=1e-6, load_error=1e-9, contacts=100),
    *(row("tower-5", engine=engine, step_ms=1.0, load_error=1e-4, contacts=20) for engine in PEERS),
    row("wall-5"),
]


def test_pareto_front_keeps_what_nothing_beats_in_both():
    points = [(1.0, 0.1), (2.0, 0.2), (3.0, 0.01), (3.0, 0.02), (0.5, 0.5), (4.0, 0.01)]
    assert pareto_front(points) == [(0.5, 0.5), (1.0, 0.1), (3.0, 0.01)]
    assert pareto_front([]) == []


@pytest.mark.parametrize("case", list(AXES))
def test_chart_is_written_as_png_and_svg(tmp_path, case):
    before = dict(matplotlib.rcParams)
    paths = speed_accuracy(ROWS, AXES[case], TITLES, "A heading", "a footer", tmp_path / "docs" / "picture")
    assert [path.name for path in paths] == ["picture.png", "picture.svg"]
    pixels = imread(paths[0])
    height, width, _ = pixels.shape
    assert width > 900 and height > 500
    assert 0.02 < (pixels[:, :, :3].min(axis=2) < 0.95).mean() < 0.6  # neither blank nor black
    assert re.match(r"<\?xml", paths[1].read_text())
    assert dict(matplotlib.rcParams) == before


def test_a_simulation_that_was_cut_short_is_not_drawn(tmp_path):
    whole = row(case="stepped", step_ms=1.0, drift=1e-3, steps=60, steps_asked=60)
    short = row(case="stepped", step_ms=2.0, drift=1e-9, steps=2, steps_asked=60, solver="osqp")
    with_short, alone = (
        imread(speed_accuracy(rows, AXES["stepped"], TITLES, "A heading", "a footer", tmp_path / name)[0])
        for name, rows in (("a", [whole, short]), ("b", [whole]))
    )
    np.testing.assert_array_equal(with_short, alone)


def test_values_outside_the_range_are_drawn_on_its_edge():
    axis = AXES["cold"]
    assert axis.value(ROWS[3]) == axis.ceiling
    assert axis.value(ROWS[4]) == axis.floor


def test_without_a_measured_row_no_chart_is_drawn(tmp_path):
    assert speed_accuracy([row()], AXES["cold"], TITLES, "A heading", "a footer", tmp_path / "picture") == []
    assert not list(tmp_path.iterdir())

"""The suite of motions known on paper: our answers meet them, and a wrong end is an error."""

import io
from dataclasses import replace

import numpy as np
import pytest
from rich.console import Console

from benchmarks import analytic, cli, exit_codes, store
from benchmarks.attempts import OWN
from benchmarks.engines import ENGINES

# Errors that follow the time step: where a step ends within the motion's own change.
OF_FIRST_ORDER = {"throw": 1e-4, "tall-box-slides": 1e-4, "bounce": 2e-3, "turntable": 0.05}


@pytest.fixture(scope="module")
def rows(tmp_path_factory):
    folder = tmp_path_factory.mktemp("analytic")
    arguments = ["run", "analytic", "--quick", "--solver", "newton", "--out", str(folder)]
    assert cli.main(arguments, Console(file=io.StringIO())) == exit_codes.OK
    assert (folder / "analytic" / "analytic.png").exists()
    return [row for row in store.read(folder / "analytic") if row.engine == OWN]


def test_newton_meets_every_truth(rows):
    assert [row.scene for row in rows] == list(analytic.CASES)
    for row in rows:
        assert row.figure("error") <= OF_FIRST_ORDER.get(row.scene, 1e-9), row.scene
        assert row.natural_map <= 1e-9 and row.answer, row.scene


@pytest.mark.parametrize(
    "name", [name for name in analytic.CASES if name not in ("table", "tall-box-topples", "bounce")]
)
def test_an_end_elsewhere_is_an_error(name):
    """Whatever ends a tenth of a metre away, or a tenth slower, is off by far more than what is accepted above."""
    case, setting = analytic.CASES[name], analytic.settings([])[0]
    simulation = ENGINES[OWN].simulate(case.make(), 1 / 240, setting, 10.0)
    start = simulation.motion()
    for _ in range(round(case.seconds * 240)):
        simulation.step()
    end = simulation.motion()
    moved = replace(end, position=end.position + np.array([0.1, 0.0, 0.0]), velocity=0.9 * end.velocity)
    wrong, right = (analytic.Course(start, [], motion, simulation.contacts(), 1 / 240) for motion in (moved, end))
    assert case.error(wrong) > 2.0 * case.error(right) + 1e-3
    assert np.isfinite(case.error(wrong))

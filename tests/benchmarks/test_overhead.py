"""What the harness adds is measured by itself, as rows."""

import io

from matplotlib.image import imread
from rich.console import Console

from benchmarks import cli, exit_codes, overhead, store
from benchmarks.forces import force_chart


def test_the_harness_is_held_against_bare_loops(tmp_path, monkeypatch):
    monkeypatch.setattr(overhead, "STEPS", 8)
    page = Console(file=io.StringIO(), width=200)
    arguments = ["run", "overhead", "--out", str(tmp_path), "--scene", "tower-5", "--rounds", "1"]
    assert cli.main(arguments, page) == exit_codes.OK
    (row,) = store.read(tmp_path / "overhead")
    assert row.measured and row.contacts == 20
    assert row.figure("bias") > -1.0 and row.figure("share") > -1.0
    assert "stated step time" in page.file.getvalue()


def test_forces_are_drawn_with_the_load_of_each_interface(tmp_path):
    paths = force_chart(("heavy-on-light",), "a footer", tmp_path / "forces")
    assert [path.name for path in paths] == ["forces.png", "forces.svg"]
    pixels = imread(paths[0])[:, :, :3]
    assert 0.02 < (pixels.min(axis=2) < 0.95).mean() < 0.6
    # The colour of the arrows, #d55e00.
    arrows = abs(pixels - [0xD5 / 255, 0x5E / 255, 0.0]).max(axis=2) < 0.03
    assert arrows.mean() > 1e-3

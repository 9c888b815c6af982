"""The suite from the command line: rows, tables, the map, and every stored claim certified again."""

import csv
import io

import pytest
from rich.console import Console

from benchmarks import cli, exit_codes, store
from benchmarks.stability.breaks import breaks
from benchmarks.stability.climbing import NOT_CLIMBED, OTHER_LAW, STANDS
from benchmarks.stability.map import columns_of


def call(*arguments):
    page = io.StringIO()
    return cli.main(list(arguments), Console(file=page, width=200)), page.getvalue()


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    out = tmp_path_factory.mktemp("results")
    asked = ("--scene", "painleve", "--scene", "jam", "--scene", "glide", "--solver", "newton")
    code, page = call("run", "stability", "--quick", "--time-limit", "5", "--out", str(out), *asked)
    assert code == 0 and "Painlevé's rod" in page
    return out / "stability"


def test_every_rung_has_a_row(folder):
    with (folder / "rows.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    rungs = {name: {row["case"] for row in rows if row["scene"] == name} for name in ("painleve", "jam", "glide")}
    assert rungs == {
        "painleve": {"0.5", "1.3", "2", "10"},
        "jam": {"2", "10", "100"},
        "glide": {"0.01", "1", "100"},
    }
    # What lies above the rung that breaks a solver is not climbed, and no hole either.
    cone = [row["outcome"] for row in rows if (row["scene"], row["solver"]) == ("glide", "newton")
            and row["formulation"] == "cone"]  # fmt: skip
    assert cone == [STANDS, OTHER_LAW, NOT_CLIMBED]


def test_the_map_has_a_cell_for_each_climb(folder):
    found = breaks(store.read(folder))
    ends = {(one.mode, one.solver, one.formulation): (one.outcome, one.rung, one.stands) for one in found}
    assert ends["painleve", "newton", "coulomb"] == (STANDS, "", "10")
    assert ends["jam", "newton", "normal"] == (STANDS, "", "100")
    assert ends["glide", "newton", "cone"] == (OTHER_LAW, "1", "0.01")
    # The program without friction stands in the columns of the others.
    assert ("gpx-lcp", "newton", "normal") not in columns_of(found)
    assert {path.name for path in folder.glob("map.*")} == {"map.png", "map.svg"}


def test_it_is_checked_and_reported(folder, tmp_path):
    code, page = call("check", str(folder))
    assert code == 0 and "every claim of" in page
    code, _ = call("report", str(folder), "--out", str(tmp_path))
    assert code == 0 and (tmp_path / "pictures" / "stability" / "map.png").exists()
    assert "stands to the end of its ladders" in (tmp_path / "report.md").read_text(encoding="utf-8")


def test_unknown_names_are_refused(tmp_path):
    assert call("run", "stability", "--scene", "bogus", "--out", str(tmp_path))[0] == 2
    assert call("run", "stability", "--solver", "bogus", "--out", str(tmp_path))[0] == exit_codes.USAGE

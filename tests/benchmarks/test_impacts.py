"""The suite of impact laws: its cases, its rows and its page."""

import csv
import io
from pathlib import Path

import pytest
from rich.console import Console

import gpx_lcp as gpx
from benchmarks import cli
from benchmarks.impacts import cases
from benchmarks.impacts.suite import PAGE

DOCUMENT = Path(__file__).resolve().parents[2] / "docs" / PAGE


@pytest.fixture(autouse=True)
def few_collisions(monkeypatch):
    monkeypatch.setattr(cases, "COLLISIONS", 12)


def run(folder: Path, *arguments: str) -> tuple[int, list[dict[str, str]], str]:
    page = io.StringIO()
    code = cli.main(["run", "impacts", "--out", str(folder), *arguments], Console(file=page, width=200))
    rows = (folder / "impacts" / "rows.csv").read_text(encoding="utf-8").splitlines()
    return code, list(csv.DictReader(rows)), (folder / "impacts" / PAGE).read_text(encoding="utf-8")


def test_every_law_meets_every_case(tmp_path):
    code, rows, page = run(tmp_path, "--scene", "[!sb]*", "--scene", "b*k-shot", "--scene", "superball")
    assert code == 0
    names = [name for name in cases.CASES if name not in ("stack", "bouncing-ball")]
    assert {(row["scene"], row["solver"]) for row in rows} == {(name, law) for name in names for law in gpx.LAWS}
    right = {(row["scene"], row["solver"]): row["reached"].lower() == "true" for row in rows}
    assert [law for law in gpx.LAWS if right["cradle", law]] == ["sequential"]
    assert [law for law in gpx.LAWS if not right["double-pendulum", law]] == ["newton"]
    for name in ("superball", "rocking-block", "observer"):
        assert all(right[name, law] for law in gpx.LAWS), name
    assert right["random", "energy_safe"] and right["linkages", "energy_safe"]
    for law in gpx.LAWS.values():
        assert f"| `{law.name}` | {law.summary} | {law.promises} | {law.breaks} |" in page
    assert "✗ +58.7 %" in page and "What this does not show" in page


@pytest.mark.parametrize("case", ["bouncing-ball", "stack"])
def test_worlds_bounce_and_stand_as_they_should(case):
    assert all(cases.CASES[case].run(law).right for law in ("newton", "energy_safe"))


def test_a_case_that_is_not_there_is_a_usage_error(tmp_path):
    page = io.StringIO()
    assert cli.main(["run", "impacts", "--out", str(tmp_path), "--scene", "bogus"], Console(file=page)) == 2
    assert "there is none of that name" in page.getvalue()


def test_the_page_in_docs_says_what_the_laws_say():
    page = DOCUMENT.read_text(encoding="utf-8")
    for law in gpx.LAWS.values():
        assert f"| `{law.name}` | {law.summary} | {law.promises} | {law.breaks} |" in page
    for case in cases.CASES.values():
        assert f"| {case.title} | {case.known} |" in page


def test_what_is_right_without_impulses_of_its_own_claims_nothing_about_them(tmp_path):
    run(tmp_path, "--scene", "observer", "--scene", "superball")
    assert cli.main(["check", str(tmp_path / "impacts")], Console(file=io.StringIO())) == 0

"""The report: what the page holds, and what it does when it is clicked in a real browser."""

import base64
import io
import re
import shutil

import pytest
from matplotlib.image import imread
from rich.console import Console
from rich.table import Table

from benchmarks import cli, exit_codes, store
from benchmarks.page import Grid, Picture, Section, as_html, as_markdown, grid
from benchmarks.suites import SUITES
from tests.benchmarks.make_record import record

CHROMIUM = shutil.which("chromium") or shutil.which("google-chrome")
DRIVER = shutil.which("chromedriver")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A report of a few rows of the suite stacks."""
    out = tmp_path_factory.mktemp("report")
    where = {"host": "here", "cpu": "a CPU", "gpx_lcp": "1", "build_profile": "release", "revision": "abc"}
    where |= {"python": "3", "numpy": "2", "threads": "1"}
    known = {"where": where, "steps": 1, "steps_asked": 1, "contacts": 20, "drift": 1e-9, "body_error": 1e-9}
    rows = [
        record(solver=solver, step_ms=ms, load_error=error, natural_map=error, setting=f"<{ms}>", **known)
        for solver, ms, error in (("pgs", 10.0, 1e-3), ("newton", 9.0, 1e-9), ("lemke", 100.0, 1e-12))
    ]
    rows += [record(case="stepped", solver=row.solver, setting=row.setting, **known) for row in rows]
    rows.append(record(solver="osqp", status="error", message="it broke", where=where))
    rows.append(record(case="stepped", solver="osqp", status="error", message="it broke", where=where))
    store.Folder(out / "stacks", rows).write()
    page = io.StringIO()
    code = cli.main(["report", str(out / "stacks"), "--out", str(out)], Console(file=page, width=200))
    assert code == exit_codes.OK, page.getvalue()
    return out


def test_the_page_needs_nothing_else_and_holds_the_pictures(folder):
    page = (folder / "report.html").read_text(encoding="utf-8")
    assert not re.search(r"""(src|href)=["'](?!data:|#)""", page)
    pictures = re.findall(r'src="data:image/png;base64,([^"]+)"', page)
    assert pictures
    for content in pictures:
        pixels = imread(io.BytesIO(base64.b64decode(content)))
        assert 0.02 < (pixels[:, :, :3].min(axis=2) < 0.95).mean() < 0.6
    assert "&lt;10.0&gt;" in page and "<10.0>" not in page


def test_both_end_with_what_they_do_not_show(folder):
    page = (folder / "report.html").read_text(encoding="utf-8")
    assert page.rindex("<h2>What this does not show</h2>") == page.rindex("<h2>")
    text = (folder / "report.md").read_text(encoding="utf-8")
    assert text.rindex("## What this does not show") == text.rindex("\n## ") + 1
    for name in re.findall(r"!\[.*?\]\((.*?)\)", text):
        assert (folder / name).is_file()
    assert "| scene | engine |" in text


def test_failures_are_in_the_report(folder):
    page = (folder / "report.html").read_text(encoding="utf-8")
    assert "2 error" in page and '<td class="text">error</td>' in page


@pytest.fixture(scope="module")
def browser():
    """A headless Chromium."""
    selenium = pytest.importorskip("selenium.webdriver", reason="selenium is not installed: pip install selenium")
    if not (CHROMIUM and DRIVER):
        pytest.skip("no chromium and chromedriver here: on Debian, apt-get install chromium chromium-driver")
    options = selenium.ChromeOptions()
    options.binary_location = CHROMIUM
    for flag in ("--headless", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage", "--window-size=1280,1000"):
        options.add_argument(flag)
    driver = selenium.Chrome(options=options, service=selenium.ChromeService(DRIVER))
    yield driver
    driver.quit()


def test_tables_sort_at_a_click_in_a_browser(folder, browser):
    browser.get((folder / "report.html").as_uri())
    every = browser.find_element("tag name", "details")
    every.find_element("tag name", "summary").click()
    head = next(h for h in every.find_elements("tag name", "th") if h.text.startswith("ms"))

    def times():
        rows = every.find_elements("css selector", "tbody tr")
        return [row.find_elements("tag name", "td")[7].text for row in rows]

    unsorted = times()
    assert [t for t in unsorted if t] == ["10", "9", "100"]
    head.click()
    assert times() == ["9", "10", "100", *[""] * (len(unsorted) - 3)]  # as numbers, and empty cells last
    head.click()
    assert times() == ["100", "10", "9", *[""] * (len(unsorted) - 3)]
    assert head.get_attribute("aria-sort") == "descending"


def test_every_link_leads_somewhere_and_every_picture_is_shown(folder, browser):
    browser.get((folder / "report.html").as_uri())
    for link in browser.find_elements("css selector", "nav a"):
        link.click()
        target = browser.execute_script("return document.querySelector(location.hash).textContent")
        assert link.text in target
    widths = browser.execute_script("return [...document.images].map(image => image.naturalWidth)")
    assert widths and min(widths) > 500
    image = browser.find_element("tag name", "img")
    image.click()
    assert "whole" in image.get_attribute("class")
    assert browser.get_log("browser") == []


def test_a_page_fits_a_narrow_screen(folder, browser):
    browser.set_window_size(500, 900)
    browser.get((folder / "report.html").as_uri())
    assert browser.execute_script("return document.documentElement.scrollWidth <= window.innerWidth")


@pytest.mark.parametrize("suite", list(SUITES))
def test_rows_of_a_scene_that_this_version_does_not_have_are_listed_and_not_drawn(tmp_path, suite):
    where = {"host": "here", "gpx_lcp": "1", "build_profile": "release", "revision": "", "python": "3"}
    where |= {"numpy": "2", "cpu": "a CPU", "threads": "1"}
    known = {"suite": suite, "tolerance": 1e-6, "steps": 1, "steps_asked": 1, "bodies": 3, "where": where}
    figures = {"error": 1.0, "outcome": "stands", "shown": "1", "program_residual": 1e-9, "bias": 0.0, "share": 0.0}
    rows = [record(scene="of another time", step_ms=1.0, natural_map=1e-9, **known, **figures)]
    rows.append(record(scene=next(iter(SUITES[suite].scenes())), case="nowhere", status="error", **known))
    store.Folder(tmp_path / suite, rows).write()
    code = cli.main(["report", str(tmp_path / suite), "--out", str(tmp_path)], Console(file=io.StringIO()))
    assert code == exit_codes.OK
    assert "of another time" in (tmp_path / "report.html").read_text(encoding="utf-8")


def test_a_terminals_table_becomes_plain_text():
    table = Table("name", title="[bold]A title[/]")
    table.add_column("time", justify="right")
    table.add_row("[red]one[/]", "1.0")
    assert grid(table) == Grid("A title", ["name", "time"], [("one", "1.0")], [False, True])


def test_markdown_says_the_same(tmp_path):
    table = Grid("T", ("a|b", "c"), [("1", "2")], (True, False))
    section = Section("S", ["words", table, Picture(tmp_path / "p" / "x.png", "a chart")])
    text = as_markdown("R", [section], tmp_path)
    assert "| a\\|b | c |\n| ---: | --- |\n| 1 | 2 |" in text and "![a chart](p/x.png)" in text
    assert "<th" in as_html("R", [Section("S", ["words", table])])

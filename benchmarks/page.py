"""A report as one self-contained HTML page, whose tables sort at a click, and as Markdown that says the same."""

from __future__ import annotations

import base64
import html
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from rich.table import Table
from rich.text import Text


@dataclass(frozen=True)
class Grid:
    """A table as plain text.

    Parameters
    ----------
    right : sequence of bool
        Which columns hold numbers.
    folded : bool
        Whether a reader opens it first: it is long.
    """

    title: str
    header: Sequence[str]
    rows: Sequence[Sequence[str]]
    right: Sequence[bool]
    folded: bool = False


@dataclass(frozen=True)
class Picture:
    """A chart, and what it shows in words for those who cannot see it."""

    path: Path
    words: str


Part = str | Grid | Picture


@dataclass
class Section:
    """A heading and what stands below it: paragraphs, tables and pictures."""

    heading: str
    parts: list[Part] = field(default_factory=list)


def grid(table: Table) -> Grid:
    """Return a terminal's table as plain text."""
    columns = [[_plain(cell) for cell in column.cells] for column in table.columns]
    return Grid(
        title=_plain(table.title or ""),
        header=[_plain(column.header) for column in table.columns],
        rows=list(zip(*columns, strict=True)) if columns else [],
        right=[column.justify == "right" for column in table.columns],
    )


def _plain(cell: object) -> str:
    text = cell if isinstance(cell, Text) else Text.from_markup(str(cell))
    return text.plain


def as_html(title: str, sections: Sequence[Section]) -> str:
    """Return the page, with everything that it needs inside."""
    links = "".join(f'<a href="#s{n}">{html.escape(s.heading)}</a>' for n, s in enumerate(sections))
    body = "".join(
        f'<section id="s{n}"><h2>{html.escape(section.heading)}</h2>{"".join(map(_html, section.parts))}</section>'
        for n, section in enumerate(sections)
    )
    return (
        f'<!doctype html><html lang="en"><head><meta charset="utf-8"><title>{html.escape(title)}</title>'
        f'<meta name="viewport" content="width=device-width"><style>{STYLE}</style></head>'
        f"<body><header><h1>{html.escape(title)}</h1><nav>{links}</nav></header><main>{body}</main>"
        f"<script>{SCRIPT}</script></body></html>\n"
    )


def _html(part: Part) -> str:
    if isinstance(part, str):
        return f"<p>{html.escape(part)}</p>"
    if isinstance(part, Picture):
        content = base64.b64encode(part.path.read_bytes()).decode()
        return f'<figure><img alt="{html.escape(part.words)}" src="data:image/png;base64,{content}"></figure>'
    kinds = ["number" if right else "text" for right in part.right]
    head = "".join(
        f'<th class="{kind}" tabindex="0" aria-sort="none">{html.escape(name)}</th>'
        for kind, name in zip(kinds, part.header, strict=True)
    )
    rows = "".join(
        "<tr>"
        + "".join(f'<td class="{kind}">{html.escape(cell)}</td>' for kind, cell in zip(kinds, row, strict=True))
        + "</tr>"
        for row in part.rows
    )
    table = f'<div class="wide"><table><thead><tr>{head}</tr></thead><tbody>{rows}</tbody></table></div>'
    if part.folded:
        return f"<details><summary>{html.escape(part.title)}</summary>{table}</details>"
    return f"<h3>{html.escape(part.title)}</h3>{table}"


def as_markdown(title: str, sections: Sequence[Section], folder: Path) -> str:
    """Return the same as Markdown, whose pictures are files below `folder`; long tables are left to the page."""
    lines = [f"# {title}", ""]
    for section in sections:
        lines += [f"## {section.heading}", ""]
        for part in section.parts:
            lines += [*_markdown(part, folder), ""]
    return "\n".join(lines)


def _markdown(part: Part, folder: Path) -> list[str]:
    if isinstance(part, str):
        return [part]
    if isinstance(part, Picture):
        return [f"![{part.words}]({part.path.relative_to(folder).as_posix()})"]
    if part.folded:
        return [f"*{part.title}: {len(part.rows)} lines, in the page.*"]
    cells = [[cell.replace("|", "\\|").replace("\n", " ") for cell in row] for row in (part.header, *part.rows)]
    rule = ["---:" if right else "---" for right in part.right]
    table = [f"| {' | '.join(row)} |" for row in (cells[0], rule, *cells[1:])]
    return [f"**{part.title}**", "", *table]


STYLE = """
:root{color-scheme:light;--ink:#22252a;--quiet:#6b7079;--line:#e3e5e8;--accent:#0072b2}
*{box-sizing:border-box}body{margin:0;font:16px/1.5 system-ui,sans-serif;color:var(--ink);background:#fff}
header,main{max-width:1180px;margin:0 auto;padding:0 24px}header{padding-top:32px}h1{margin:0 0 8px;font-size:1.8rem}
nav{display:flex;flex-wrap:wrap;gap:4px 20px;padding:8px 0;border-bottom:1px solid var(--line)}
a{color:var(--accent);text-decoration:none}a:hover{text-decoration:underline}
h2{margin:40px 0 8px;font-size:1.35rem}h3{margin:24px 0 6px;font-size:1rem;max-width:60em}p{max-width:60em}
.wide{overflow-x:auto;margin:0 0 16px}table{border-collapse:collapse;font-size:.86rem;font-variant-numeric:tabular-nums}
th,td{padding:4px 12px 4px 0;text-align:left;vertical-align:top;border-bottom:1px solid var(--line)}
th{cursor:pointer;white-space:nowrap;border-bottom:2px solid var(--quiet)}th:hover{color:var(--accent)}
.number{text-align:right;white-space:nowrap}th::after{content:" \\2195";color:var(--line)}
th[aria-sort=ascending]::after{content:" \\2191";color:var(--accent)}
th[aria-sort=descending]::after{content:" \\2193";color:var(--accent)}
tbody tr:hover{background:#f5f7f9}figure{margin:16px 0}img{max-width:100%;height:auto;cursor:zoom-in}
img.whole{max-width:none;cursor:zoom-out}summary{cursor:pointer;margin:16px 0;font-weight:600}
@media print{nav{display:none}}
"""

# A click on a heading sorts by its column, a second one the other way round; empty cells stay last.
SCRIPT = """
for (const table of document.querySelectorAll("table")) {
  const heads = [...table.tHead.rows[0].cells], body = table.tBodies[0];
  heads.forEach((head, column) => {
    const sort = () => {
      const sign = head.getAttribute("aria-sort") === "ascending" ? -1 : 1;
      heads.forEach(other => other.setAttribute("aria-sort", "none"));
      head.setAttribute("aria-sort", sign > 0 ? "ascending" : "descending");
      const text = row => row.cells[column].textContent.trim();
      const order = (a, b) => {
        const x = text(a), y = text(b);
        if (!x || !y) return x ? -1 : y ? 1 : 0;
        const p = parseFloat(x), q = parseFloat(y);
        if (!isNaN(p) && !isNaN(q)) return sign * (p - q);
        if (isNaN(p) !== isNaN(q)) return isNaN(p) ? 1 : -1;
        return sign * x.localeCompare(y);
      };
      body.append(...[...body.rows].sort(order));
    };
    head.addEventListener("click", sort);
    head.addEventListener("keydown", event => { if (event.key === "Enter") sort(); });
  });
}
for (const image of document.images) image.addEventListener("click", () => image.classList.toggle("whole"));
"""

"""Where a run is shown while it goes on: the terminal, and a book of the same tables that is kept as text."""

from __future__ import annotations

import io
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.table import Table
from rich.text import Text

WIDTH = 140


class Pages:
    """The terminal and the book: what scrolled away on one is read in the other."""

    def __init__(self, console: Console) -> None:
        self.console = console
        self._book = Console(record=True, width=WIDTH, file=io.StringIO(), highlight=False)

    def show(self, what: Table | Text) -> None:
        """Print on both."""
        for page in (self.console, self._book):
            page.print(what)

    def write(self, path: Path) -> None:
        """Write the book."""
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(self._book.export_text(), encoding="utf-8")

    @contextmanager
    def progress(self, total: int) -> Iterator[Callable[[str], None]]:
        """Show a bar with the time left while the block runs; yield the function that advances it."""
        columns = (TextColumn("{task.description:<46.46}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
        with Progress(*columns, TimeRemainingColumn(), console=self.console, transient=True) as bar:
            task = bar.add_task("", total=total)

            def advance(text: str) -> None:
                bar.update(task, advance=1, description=text)

            yield advance

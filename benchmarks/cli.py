"""The command line, `python -m benchmarks VERB`: arguments, and which verb does what."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.text import Text

import gpx_lcp as gpx
from benchmarks import exit_codes, store
from benchmarks.suites import SUITES
from benchmarks.verbs.check import check
from benchmarks.verbs.compare import compare
from benchmarks.verbs.list_all import list_all
from benchmarks.verbs.plot import plot
from benchmarks.verbs.report import report
from benchmarks.verbs.run import run

# With --resume, the arguments that may differ from those of the run that is gone on with.
NOT_KEPT = ("resume", "out", "scheduler")


def parser() -> argparse.ArgumentParser:
    """Return the parser of the command line."""
    shape: dict[str, Any] = {
        "epilog": exit_codes.TEXT,
        "formatter_class": argparse.RawDescriptionHelpFormatter,
    }
    top = argparse.ArgumentParser(
        prog="python -m benchmarks",
        description="Compare contact solvers: speed against accuracy, measured from outside.",
        **shape,
    )
    verbs = top.add_subparsers(dest="verb", required=True, metavar="VERB")
    verbs.add_parser("list", help="suites, scenes, solvers and peers; what is installed and how to get the rest")
    suites = verbs.add_parser("run", help="run a suite", **shape).add_subparsers(
        dest="suite", required=True, metavar="SUITE"
    )
    for name, suite in SUITES.items():
        own = suites.add_parser(name, help=suite.summary, **shape)
        suite.add_arguments(own)
        own.add_argument(
            "--out", type=Path, default=Path("results"), metavar="DIR", help=f"results go to DIR/{name} (results)"
        )
        own.add_argument(
            "--resume",
            action="store_true",
            help="go on with the run in DIR, with what it was asked: only attempts without a finished row are made",
        )
        own.add_argument(
            "--scheduler",
            metavar="WHERE",
            help="measure on a Dask cluster: 'local', or the address of a scheduler whose workers have one thread each",
        )
    plotting = verbs.add_parser("plot", help="draw the charts of stored rows again", **shape)
    _add_folders(plotting)
    plotting.add_argument("--out", type=Path, metavar="DIR", help="charts go to DIR/SUITE (where the rows are)")
    reporting = verbs.add_parser("report", help="one HTML page of stored rows, and a Markdown twin", **shape)
    _add_folders(reporting)
    reporting.add_argument(
        "--out", type=Path, default=Path("results"), metavar="DIR", help="report.html and report.md go to DIR (results)"
    )
    comparing = verbs.add_parser("compare", help="what got faster, slower, better or worse from A to B", **shape)
    for name in "AB":
        comparing.add_argument(name.lower(), type=Path, metavar=name, help="a folder of results, e.g. results/stacks")
    _add_folders(verbs.add_parser("check", help="certify the stored impulses again", **shape))
    return top


def _add_folders(verb: argparse.ArgumentParser) -> None:
    verb.add_argument(
        "folder", type=Path, nargs="+", help="results of a suite, e.g. results/stacks; those of several runs are merged"
    )


def main(arguments: Sequence[str] | None = None, console: Console | None = None) -> int:
    """Run the command and return its exit code."""
    given = sys.argv[1:] if arguments is None else list(arguments)
    asked = parser().parse_args(given)
    console = console or _console()
    try:
        return _do(asked, given, console)
    except gpx.SettingsError as error:
        console.print(Text.assemble(("not understood: ", "bold red"), str(error)))
        return exit_codes.USAGE
    except KeyboardInterrupt:  # while it draws, or outside of a run
        console.print("[yellow]stopped by Ctrl-C[/]")
        return exit_codes.INTERRUPTED
    except gpx.BackendMissing as error:
        console.print(Text.assemble(("refused: ", "bold red"), str(error)))
        return exit_codes.REFUSED


def _do(asked: argparse.Namespace, given: Sequence[str], console: Console) -> int:
    if asked.verb == "list":
        return list_all(console)
    if asked.verb == "plot":
        return plot(asked.folder, asked.out, console)
    if asked.verb == "report":
        return report(asked.folder, asked.out, console)
    if asked.verb == "compare":
        return compare(asked.a, asked.b, console)
    if asked.verb == "check":
        return check(asked.folder, console)
    if gpx.BUILD_PROFILE == "debug":
        console.print(
            "[bold red]refused:[/] gpx_lcp._core is a debug build, whose times mean nothing. "
            "Install a release build: [bold]make setup[/], or pip install --editable '.\\[bench]'."
        )
        return exit_codes.REFUSED
    return run(SUITES[asked.suite], _resumed(asked), given, console)


def _resumed(asked: argparse.Namespace) -> argparse.Namespace:
    """Return the arguments to run with: with --resume, those of the run that is gone on with.

    Raises
    ------
    SettingsError
        When there is no such run, or an argument differs from what it was asked.
    """
    if not asked.resume:
        return asked
    kept = parser().parse_args(store.read_asked(asked.out / asked.suite)["arguments"])
    plain = parser().parse_args(["run", asked.suite])
    for name, value in vars(asked).items():
        if name not in NOT_KEPT and value not in (getattr(plain, name), getattr(kept, name)):
            option = "--" + name.replace("_", "-")
            raise gpx.SettingsError(f"--resume goes on with what the run was asked: leave out {option}, or start anew")
    for name in NOT_KEPT:
        setattr(kept, name, getattr(asked, name))
    return kept


def _console() -> Console:
    """Return the terminal, or a wide page where the output goes to a file or a pipe."""
    console = Console(highlight=False)
    return console if console.is_terminal else Console(highlight=False, width=140)

"""The command line: `python -m benchmarks list` and `python -m benchmarks run stacks`."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console

import gpx_lcp as gpx
from benchmarks import stacks
from benchmarks.command import Request, list_all, run_stacks
from benchmarks.engines import ENGINES, PEERS

# What the exit codes mean; they are part of the interface and shown by --help.
OK, FAILED, USAGE, REFUSED, INTERRUPTED = 0, 1, 2, 3, 130

EXIT_CODES = """exit codes:
  0    every attempt was made (a missing peer is listed, and is no failure)
  1    an attempt ended in an error; its row says which
  2    the command was not understood
  3    refused: the core is a debug build, or nothing that was asked for is installed
  130  stopped by Ctrl-C; what was measured so far is written"""


def parser() -> argparse.ArgumentParser:
    """Return the parser of the command line."""
    top = argparse.ArgumentParser(
        prog="python -m benchmarks",
        description="Compare contact solvers: speed against accuracy, measured from outside.",
        epilog=EXIT_CODES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    verbs = top.add_subparsers(dest="verb", required=True, metavar="VERB")
    verbs.add_parser("list", help="suites, scenes, solvers and peers; what is installed and how to get the rest")
    run = verbs.add_parser(
        "run", help="run a suite", epilog=EXIT_CODES, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    run.add_argument("suite", choices=[stacks.NAME], help="what to run")
    run.add_argument("--scene", action="append", choices=list(stacks.SCENES), help="only this scene (may be repeated)")
    run.add_argument("--solver", action="append", metavar="NAME", help="only this solver, of gpx-lcp or a peer")
    run.add_argument("--formulation", action="append", metavar="NAME", help="only this formulation")
    run.add_argument(
        "--peer", action="append", choices=[*PEERS, "none"], help="only this peer; 'none' for gpx-lcp alone"
    )
    run.add_argument(
        "--repeats", type=_positive, metavar="N", help="fresh simulations per setting, interleaved (5; quick: 2)"
    )
    run.add_argument("--steps", type=_positive, metavar="N", help="warm steps after the cold first one (30; quick: 20)")
    run.add_argument(
        "--time-limit", type=_seconds, metavar="S", help="per setting and scene, all repeats (0.7; quick: 0.3)"
    )
    run.add_argument(
        "--out", type=Path, default=Path("results"), metavar="DIR", help="results go to DIR/stacks (results)"
    )
    run.add_argument(
        "--picture", type=Path, metavar="PATH", help="also write the cold-start chart to PATH.png and PATH.svg"
    )
    run.add_argument("--quick", action="store_true", help="few scenes and settings, to see that everything works")
    return top


def main(arguments: Sequence[str] | None = None, console: Console | None = None) -> int:
    """Run the command and return its exit code."""
    asked = parser().parse_args(arguments)
    console = console or _console()
    if asked.verb == "list":
        list_all(console)
        return OK
    if gpx.BUILD_PROFILE == "debug":
        console.print(
            "[bold red]refused:[/] gpx_lcp._core is a debug build, whose times mean nothing. "
            "Install a release build: [bold]make setup[/], or pip install --editable '.\\[bench]'."
        )
        return REFUSED
    request = Request(
        scenes=tuple(asked.scene or (stacks.QUICK_SCENES if asked.quick else stacks.SCENES)),
        solvers=_chosen(asked.solver),
        formulations=_chosen(asked.formulation),
        engines=_engines(asked.peer),
        repeats=asked.repeats or (2 if asked.quick else 5),
        steps=asked.steps or (20 if asked.quick else 30),
        time_limit=asked.time_limit or (0.3 if asked.quick else 0.7),
        quick=asked.quick,
        out=asked.out / stacks.NAME,
        picture=asked.picture,
    )
    results = run_stacks(request, console)
    if results is None:
        return REFUSED
    if results.interrupted:
        return INTERRUPTED
    return FAILED if results.errors else OK


def _console() -> Console:
    """Return the terminal, or a wide page where the output goes to a file or a pipe."""
    console = Console(highlight=False)
    return console if console.is_terminal else Console(highlight=False, width=140)


def _chosen(names: Sequence[str] | None) -> frozenset[str] | None:
    return None if names is None else frozenset(names)


def _engines(peers: Sequence[str] | None) -> tuple[str, ...]:
    """Return the engines to run: gpx-lcp always, and the peers asked for."""
    wanted = set(PEERS if peers is None else peers)
    return tuple(name for name in ENGINES if name not in PEERS or name in wanted)


def _positive(text: str) -> int:
    value = int(text)
    if value < 1:
        raise argparse.ArgumentTypeError(f"{text} is not a whole number above zero")
    return value


def _seconds(text: str) -> float:
    value = float(text)
    if not value > 0:
        raise argparse.ArgumentTypeError(f"{text} is not a time above zero")
    return value

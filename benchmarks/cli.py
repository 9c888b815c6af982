"""The command line: `python -m benchmarks list`, `run stacks` and `run fclib`."""

from __future__ import annotations

import argparse
import math
from collections.abc import Sequence
from pathlib import Path
from typing import TypeAlias

from rich.console import Console
from rich.text import Text

import gpx_lcp as gpx
from benchmarks import stacks
from benchmarks.command import Request, Results, list_all, run_stacks
from benchmarks.engines import ENGINES, PEERS
from benchmarks.fclib import suite as fclib
from benchmarks.fclib.attempts import Plan
from benchmarks.fclib.baseline import read_baseline
from benchmarks.interface import scientific

Suites: TypeAlias = "argparse._SubParsersAction[argparse.ArgumentParser]"

# What the exit codes mean; they are part of the interface and shown by --help.
OK, FAILED, USAGE, REFUSED, INTERRUPTED = 0, 1, 2, 3, 130

EXIT_CODES = """exit codes:
  0    every attempt was made (a missing peer is listed, and is no failure)
  1    an attempt ended in an error, or a file cannot be read; its row says which
  2    the command was not understood, or names a folder, file or problem that is not there
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
    suites = run.add_subparsers(dest="suite", required=True, metavar="SUITE")
    _add_stacks(suites)
    _add_fclib(suites)
    return top


def _add_suite(suites: Suites, name: str, summary: str) -> argparse.ArgumentParser:
    """Add a suite with the arguments that all have."""
    suite = suites.add_parser(
        name, help=summary, epilog=EXIT_CODES, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    suite.add_argument("--solver", action="append", metavar="NAME", help="only this solver (may be repeated)")
    suite.add_argument("--formulation", action="append", metavar="NAME", help="only this formulation")
    suite.add_argument(
        "--out", type=Path, default=Path("results"), metavar="DIR", help=f"results go to DIR/{name} (results)"
    )
    return suite


def _add_stacks(suites: Suites) -> None:
    suite = _add_suite(suites, stacks.NAME, "resting stacks, by gpx-lcp and its peers, as simulations")
    suite.add_argument(
        "--scene",
        action="append",
        choices=list(stacks.SCENES),
        help="only this scene (repeatable); the large ones run only where they are named",
    )
    suite.add_argument(
        "--peer", action="append", choices=[*PEERS, "none"], help="only this peer; 'none' for gpx-lcp alone"
    )
    suite.add_argument(
        "--repeats", type=_positive, metavar="N", help="fresh simulations per setting, interleaved (3; quick: 2)"
    )
    suite.add_argument(
        "--steps", type=_positive, metavar="N", help="warm steps after the cold first one (240; quick: 20)"
    )
    suite.add_argument(
        "--time-limit", type=_seconds, metavar="S", help="per setting and scene, all repeats (1.5; quick: 0.3)"
    )
    suite.add_argument(
        "--picture", type=Path, metavar="PATH", help="also write the cold-start chart to PATH.png and PATH.svg"
    )
    suite.add_argument("--quick", action="store_true", help="few scenes and settings, to see that everything works")


def _add_fclib(suites: Suites) -> None:
    suite = _add_suite(suites, fclib.NAME, "FCLIB problem files, by every solver at several tolerances")
    suite.add_argument(
        "--data", type=Path, metavar="FOLDER", help="problems: every *.hdf5 below it (without: problems of our own)"
    )
    suite.add_argument(
        "--problem", action="append", metavar="NAME", help="only this problem; * and ? are wildcards (may be repeated)"
    )
    suite.add_argument(
        "--tolerance",
        action="append",
        type=_tolerance,
        metavar="T",
        help=f"only this tolerance ({_listed(fclib.TOLERANCES)}; quick: {_listed(fclib.QUICK_TOLERANCES)})",
    )
    suite.add_argument("--repeats", type=_positive, metavar="N", help="solutions per attempt (5; quick: 3)")
    suite.add_argument("--time-limit", type=_seconds, metavar="S", help="for one solution (20; quick: 2)")
    suite.add_argument(
        "--baseline", type=Path, metavar="FILE", help="JSON of another library's times, drawn as peers (dashed)"
    )
    suite.add_argument("--quick", action="store_true", help="the smallest problem of each family, and few tolerances")


def _listed(tolerances: Sequence[float]) -> str:
    return ", ".join(map(scientific, tolerances))


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
    try:
        results = _run_fclib(asked, console) if asked.suite == fclib.NAME else _run_stacks(asked, console)
    except gpx.SettingsError as error:
        console.print(Text.assemble(("not understood: ", "bold red"), str(error)))
        return USAGE
    if results is None:
        return REFUSED
    if results.interrupted:
        return INTERRUPTED
    return FAILED if results.errors else OK


def _run_stacks(asked: argparse.Namespace, console: Console) -> Results | None:
    request = Request(
        scenes=tuple(asked.scene or (stacks.QUICK_SCENES if asked.quick else stacks.USUAL_SCENES)),
        solvers=_chosen(asked.solver),
        formulations=_chosen(asked.formulation),
        engines=_engines(asked.peer),
        repeats=asked.repeats or (2 if asked.quick else 3),
        steps=asked.steps or (20 if asked.quick else 240),
        time_limit=asked.time_limit or (0.3 if asked.quick else 1.5),
        quick=asked.quick,
        out=asked.out / stacks.NAME,
        picture=asked.picture,
    )
    return run_stacks(request, console)


def _run_fclib(asked: argparse.Namespace, console: Console) -> fclib.Results | None:
    usual = fclib.QUICK_TOLERANCES if asked.quick else fclib.TOLERANCES
    request = fclib.Request(
        data=asked.data,
        solvers=asked.solver,
        formulations=asked.formulation,
        problems=asked.problem,
        baseline=read_baseline(asked.baseline) if asked.baseline else None,
        plan=Plan(
            tolerances=tuple(dict.fromkeys(asked.tolerance or usual)),
            repeats=asked.repeats or (3 if asked.quick else 5),
            time_limit=asked.time_limit or (2.0 if asked.quick else 20.0),
        ),
        quick=asked.quick,
        out=asked.out / fclib.NAME,
    )
    return fclib.run_fclib(request, console)


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
    return _above_zero(text, "time")


def _tolerance(text: str) -> float:
    return _above_zero(text, "tolerance")


def _above_zero(text: str, what: str) -> float:
    value = float(text)
    if not 0 < value < math.inf:
        raise argparse.ArgumentTypeError(f"{text} is not a {what} above zero")
    return value

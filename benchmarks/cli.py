"""The command line, `python -m benchmarks VERB`: arguments, and which verb does what."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TypeAlias

from rich.console import Console
from rich.text import Text

import gpx_lcp as gpx
from benchmarks import stacks, store
from benchmarks.arguments import positive, seconds
from benchmarks.command import Request, Results, list_all, run_stacks
from benchmarks.engines import ENGINES, PEERS
from benchmarks.exit_codes import FAILED, INTERRUPTED, OK, REFUSED, USAGE
from benchmarks.exit_codes import TEXT as EXIT_CODES
from benchmarks.suites import SUITES
from benchmarks.verbs.run import run

Suites: TypeAlias = "argparse._SubParsersAction[argparse.ArgumentParser]"

# With --resume, the arguments that may differ from those of the run that is gone on with.
NOT_KEPT = ("resume", "out")


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
    for name, row in SUITES.items():
        suite = suites.add_parser(
            name, help=row.summary, epilog=EXIT_CODES, formatter_class=argparse.RawDescriptionHelpFormatter
        )
        row.add_arguments(suite)
        suite.add_argument(
            "--out", type=Path, default=Path("results"), metavar="DIR", help=f"results go to DIR/{name} (results)"
        )
        suite.add_argument(
            "--resume",
            action="store_true",
            help="go on with the run in DIR, with what it was asked: only attempts without a finished row are made",
        )
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
        "--repeats", type=positive, metavar="N", help="fresh simulations per setting, interleaved (3; quick: 2)"
    )
    suite.add_argument(
        "--steps", type=positive, metavar="N", help="warm steps after the cold first one (240; quick: 20)"
    )
    suite.add_argument(
        "--time-limit", type=seconds, metavar="S", help="per setting and scene, all repeats (1; quick: 0.3)"
    )
    suite.add_argument(
        "--picture", type=Path, metavar="PATH", help="also write the cold-start chart to PATH.png and PATH.svg"
    )
    suite.add_argument("--quick", action="store_true", help="few scenes and settings, to see that everything works")


def main(arguments: Sequence[str] | None = None, console: Console | None = None) -> int:
    """Run the command and return its exit code."""
    given = sys.argv[1:] if arguments is None else list(arguments)
    asked = parser().parse_args(given)
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
        if asked.suite in SUITES:
            return run(SUITES[asked.suite], _resumed(asked), given, console)
        results = _run_stacks(asked, console)
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
        time_limit=asked.time_limit or (0.3 if asked.quick else 1.0),
        quick=asked.quick,
        out=asked.out / stacks.NAME,
        picture=asked.picture,
    )
    return run_stacks(request, console)


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


def _chosen(names: Sequence[str] | None) -> frozenset[str] | None:
    return None if names is None else frozenset(names)


def _engines(peers: Sequence[str] | None) -> tuple[str, ...]:
    """Return the engines to run: gpx-lcp always, and the peers asked for."""
    wanted = set(PEERS if peers is None else peers)
    return tuple(name for name in ENGINES if name not in PEERS or name in wanted)

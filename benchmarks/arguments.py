"""Arguments that several suites take, under one name and with one meaning."""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterable, Sequence
from fnmatch import fnmatchcase

import gpx_lcp as gpx
from benchmarks.interface import scientific


def add_filters(parser: argparse.ArgumentParser) -> None:
    """Add --scene, --solver and --formulation, and --quick."""
    parser.add_argument(
        "--scene", action="append", metavar="NAME", help="only this scene; * and ? are wildcards (may be repeated)"
    )
    parser.add_argument("--solver", action="append", metavar="NAME", help="only this solver (may be repeated)")
    parser.add_argument("--formulation", action="append", metavar="NAME", help="only this formulation")
    parser.add_argument("--quick", action="store_true", help="few scenes and settings, to see that everything works")


def add_tolerance(parser: argparse.ArgumentParser, usual: Sequence[float], quick: Sequence[float]) -> None:
    """Add --tolerance; `tolerances` reads it."""
    parser.add_argument(
        "--tolerance",
        action="append",
        type=tolerance,
        metavar="T",
        help=f"only this tolerance ({_listed(usual)}; quick: {_listed(quick)})",
    )


def add_effort(parser: argparse.ArgumentParser, repeats: tuple[int, int], limit: tuple[float, float]) -> None:
    """Add --repeats and --time-limit, each with what it is usually and with --quick."""
    parser.add_argument(
        "--repeats",
        type=positive,
        metavar="N",
        help=f"trials of each attempt, interleaved ({repeats[0]}; quick: {repeats[1]})",
    )
    parser.add_argument(
        "--time-limit",
        type=seconds,
        metavar="S",
        help=f"for all trials of one attempt, the first is always made ({limit[0]:g}; quick: {limit[1]:g})",
    )


def add_seed(parser: argparse.ArgumentParser) -> None:
    """Add --seed; 0 unless given."""
    parser.add_argument(
        "--seed", action="append", type=_whole, metavar="N", help="of what is random in the scenes (0; may be repeated)"
    )


def chosen(names: Iterable[str], patterns: Sequence[str] | None) -> list[str]:
    """Return the names that fit a pattern, all of them where none is given.

    Raises
    ------
    SettingsError
        When a pattern fits none.
    """
    known = list(names)
    for pattern in patterns or ():
        if not any(fnmatchcase(name, pattern) for name in known):
            raise gpx.SettingsError(f"--scene is {pattern}: there is none of that name; there are {', '.join(known)}")
    return [name for name in known if patterns is None or any(fnmatchcase(name, pattern) for pattern in patterns)]


def positive(text: str) -> int:
    """Read a whole number above zero."""
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"{text} is not a whole number above zero")
    return int(text)


def seconds(text: str) -> float:
    """Read a time above zero."""
    return _above_zero(text, "time")


def tolerance(text: str) -> float:
    """Read a tolerance above zero."""
    return _above_zero(text, "tolerance")


def _whole(text: str) -> int:
    if not text.isdecimal():
        raise argparse.ArgumentTypeError(f"{text} is not a whole number from zero on")
    return int(text)


def _above_zero(text: str, what: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not 0 < value < math.inf:
        raise argparse.ArgumentTypeError(f"{text} is not a {what} above zero")
    return value


def _listed(tolerances: Sequence[float]) -> str:
    return ", ".join(map(scientific, tolerances))

"""Which engines, and which of their settings, a suite is asked to run."""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Sequence

from benchmarks.attempts import Attempt
from benchmarks.engines import ENGINES, OWN, PEERS
from benchmarks.interface import Setting


def add_peers(parser: argparse.ArgumentParser) -> None:
    """Add --peer; `engines_asked` and `missing_peers` read it."""
    parser.add_argument(
        "--peer",
        action="append",
        choices=[*PEERS, "none"],
        help="only this peer, with all its settings whatever else is filtered; 'none' for gpx-lcp alone",
    )


def engines_asked(asked: argparse.Namespace) -> list[str]:
    """Return gpx-lcp and the installed ones of the peers that are asked for."""
    return [name for name in ENGINES if (name == OWN or name in _peers(asked)) and ENGINES[name].version()]


def missing_peers(asked: argparse.Namespace, suite: str, scene: str) -> list[Attempt]:
    """Return an attempt for each missing one of the peers that are asked for, so that it is no hole in the results."""
    return [
        Attempt(suite, scene, "", "", engine=name)
        for name in PEERS
        if name in _peers(asked) and not ENGINES[name].version()
    ]


def _peers(asked: argparse.Namespace) -> Sequence[str]:
    return PEERS if asked.peer is None else asked.peer


def wanted(asked: argparse.Namespace, settings: Iterable[Setting]) -> list[Setting]:
    """Return the settings whose solver and formulation are asked for, and those of peers that are named."""
    return [
        setting
        for setting in settings
        if of_named_peer(asked, setting)
        or (
            (asked.solver is None or setting.solver in asked.solver)
            and (asked.formulation is None or setting.formulation in asked.formulation)
        )
    ]


def of_named_peer(asked: argparse.Namespace, setting: Setting) -> bool:
    """Whether a setting is of a peer that --peer names: our solvers are set beside it, so no filter leaves it out."""
    return setting.engine in (asked.peer or ())

"""An external baseline: what another solver library needed for the same problems, measured elsewhere and kept as JSON.

    {"problem": {"runs": {"solver tolerance": {"seconds": 0.1 or null, "natural_map_scaled": 1e-9 or null, ...}, ...},
                 "best_scaled_1e-8_s": 0.1 or null, ...}, ...}

`natural_map_scaled` is the natural map of our certificate; `best_scaled_<tolerance>_s` is the time of the fastest run
that the baseline's own author counts as solved at that tolerance. Other keys are left alone.
"""

from __future__ import annotations

import json
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from math import inf
from pathlib import Path
from typing import Any

import gpx_lcp as gpx
from benchmarks.interface import scientific


@dataclass(frozen=True)
class PeerRun:
    """One run of one solver on one problem: what was asked, its time, infinite if it gave up, and what it reached."""

    solver: str
    tolerance: float
    seconds: float
    natural_map: float


@dataclass(frozen=True)
class PeerProblem:
    """Every run on one problem, and the best times that the file states, by tolerance as text ("1e-8")."""

    runs: tuple[PeerRun, ...]
    stated: Mapping[str, float]

    def seconds(self, solver: str, tolerance: float) -> float:
        """Return the solver's fastest run that holds the tolerance by our natural map, whatever it was asked for."""
        return min((r.seconds for r in self.runs if r.solver == solver and r.natural_map <= tolerance), default=inf)

    def best(self, tolerance: float) -> float:
        """Return the time to beat: the one that the file states, or else that of the fastest solver."""
        stated = self.stated.get(scientific(tolerance))
        if stated is not None:
            return stated
        return min((self.seconds(solver, tolerance) for solver in self.solvers), default=inf)

    @property
    def solvers(self) -> tuple[str, ...]:
        """The solvers that were tried on this problem."""
        return tuple(dict.fromkeys(run.solver for run in self.runs))


@dataclass(frozen=True)
class Baseline:
    """A baseline by problem, under the name of its file."""

    name: str
    problems: Mapping[str, PeerProblem]

    def measures(self, tolerance: float) -> bool:
        """Whether any run asked for this tolerance: at another one its times would not be fair to it."""
        return any(run.tolerance == tolerance for problem in self.problems.values() for run in problem.runs)

    def solvers(self, problems: Collection[str]) -> tuple[str, ...]:
        """Return the solvers that were tried on at least one of the problems."""
        held = (self.problems[name] for name in problems if name in self.problems)
        return tuple(dict.fromkeys(solver for problem in held for solver in problem.solvers))


def read_baseline(path: Path) -> Baseline:
    """Read a baseline.

    Raises
    ------
    SettingsError
        When the file cannot be read or holds something else; the message says where.
    """
    try:
        held = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise gpx.SettingsError(f"--baseline is {path}: it cannot be read as JSON ({error})") from error
    if not isinstance(held, dict):
        raise gpx.SettingsError(f"--baseline is {path}: an object is needed, with a key for each problem")
    return Baseline(path.name, {name: _problem(f"{path}: {name}", value) for name, value in held.items()})


def _problem(where: str, value: Any) -> PeerProblem:
    runs = value.get("runs") if isinstance(value, dict) else None
    if not isinstance(runs, dict):
        raise gpx.SettingsError(f"{where}: an object with the key 'runs' is needed")
    prefix, suffix = "best_scaled_", "_s"
    stated = {
        key.removeprefix(prefix).removesuffix(suffix): _seconds(f"{where}: {key}", value[key])
        for key in value
        if key.startswith(prefix) and key.endswith(suffix)
    }
    return PeerProblem(tuple(_run(f"{where}: runs: {key}", key, run) for key, run in runs.items()), stated)


def _run(where: str, key: str, run: Any) -> PeerRun:
    if not isinstance(run, dict):
        raise gpx.SettingsError(f"{where} is {run!r}: an object is needed")
    solver, _, text = key.rpartition(" ")
    try:
        tolerance = float(text)
    except ValueError:
        solver = ""
    if not solver:
        raise gpx.SettingsError(f"{where}: a run is named 'solver tolerance', as in 'nsgs 1e-08'")
    return PeerRun(
        solver,
        tolerance,
        _seconds(f"{where}: seconds", run.get("seconds")),
        _number(f"{where}: natural_map_scaled", run.get("natural_map_scaled")),
    )


def _number(where: str, value: Any) -> float:
    """Return a number that is not negative; null, a run that gave up, is infinite."""
    if value is None:
        return inf
    if isinstance(value, bool) or not isinstance(value, int | float) or not value >= 0.0:
        raise gpx.SettingsError(f"{where} is {value!r}: a number that is not negative, or null, is needed")
    return float(value)


def _seconds(where: str, value: Any) -> float:
    """Return a time, which others are divided by."""
    seconds = _number(where, value)
    if seconds == 0.0:
        raise gpx.SettingsError(f"{where} is {value!r}: a time above zero, or null, is needed")
    return seconds

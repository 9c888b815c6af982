"""Every attempt and the external baseline by problem, solver and tolerance: what tables and charts are made of."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from math import inf, isfinite

from benchmarks.attempts import INTERRUPTED, UNREADABLE
from benchmarks.fclib.baseline import Baseline
from benchmarks.fclib.batches import Line
from benchmarks.fclib.profiles import geometric_mean
from benchmarks.records import Record

# From here on a problem counts in the means of ratios: below, both sides measure a call rather than a method.
LARGE = 20


@dataclass(frozen=True)
class Subject:
    """A problem that was read, as its attempts describe it."""

    name: str
    family: str
    dimension: int
    contacts: int
    rank_ratio: float | None


def name_of(record: Record) -> str:
    """Return the problem's name, with the seed where it is not the usual one."""
    return f"{record.scene} #{record.seed}" if record.seed else record.scene


def line_of(record: Record) -> Line:
    """Return who tried."""
    return Line(record.solver, record.formulation)


def _subject(name: str, record: Record) -> Subject:
    return Subject(
        name,
        str(record.figures.get("family", "")),
        int(record.figure("dimension") or 0),
        record.contacts or 0,
        record.figure("rank_ratio"),
    )


@dataclass(frozen=True)
class Scores:
    """The rows of a run, looked up. Problems that Ctrl-C left unfinished and files that cannot be read are left out."""

    records: Sequence[Record]
    baseline: Baseline | None

    @cached_property
    def subjects(self) -> list[Subject]:
        """The problems, in the order in which they were run."""
        left_out = {name_of(r) for r in self.records if r.status in (INTERRUPTED, UNREADABLE)}
        found: dict[str, Subject] = {}
        for record in self.records:
            name = name_of(record)
            # An attempt that ended in an error knows nothing of the problem.
            if name not in left_out and (name not in found or not found[name].dimension):
                found[name] = _subject(name, record)
        return list(found.values())

    @cached_property
    def lines(self) -> list[Line]:
        """Who tried."""
        return list(dict.fromkeys(map(line_of, self.records)))

    @cached_property
    def tolerances(self) -> list[float]:
        """The tolerances, from loose to tight."""
        return sorted({r.tolerance for r in self.records if r.tolerance is not None}, reverse=True)

    @property
    def reference(self) -> float:
        """The tolerance of the tables per problem: 1e-8, what a reference needs, or else the tightest."""
        return 1e-8 if 1e-8 in self.tolerances else self.tolerances[-1]

    @cached_property
    def time_limit(self) -> float:
        """What a failure is charged, s."""
        return max((r.figure("time_limit") or 0.0 for r in self.records), default=0.0)

    @cached_property
    def _by_key(self) -> dict[tuple[str, Line, float | None], Record]:
        return {(name_of(r), line_of(r), r.tolerance): r for r in self.records}

    def attempt(self, problem: str, line: Line, tolerance: float) -> Record | None:
        """Return one row; None where it was not tried."""
        return self._by_key.get((problem, line, tolerance))

    def attempts(self, problem: str, tolerance: float) -> list[Record]:
        """Return the rows of every line."""
        rows = (self.attempt(problem, line, tolerance) for line in self.lines)
        return [row for row in rows if row is not None]

    def seconds(self, problem: str, line: Line, tolerance: float, setup: bool = False) -> float:
        """Return the time to the tolerance, infinite where it was not reached; with `setup`, that of posing, too."""
        attempt = self.attempt(problem, line, tolerance)
        if attempt is None or not attempt.reached or attempt.solve_seconds is None:
            return inf
        return attempt.solve_seconds + ((attempt.setup_seconds or 0.0) if setup else 0.0)

    def fastest(self, problem: str, tolerance: float) -> Record | None:
        """Return the row of the fastest line that reached the tolerance, or None."""
        reached = [row for row in self.attempts(problem, tolerance) if row.reached]
        return min(reached, key=lambda row: row.solve_seconds or inf, default=None)

    def nearest(self, problem: str, tolerance: float) -> Record | None:
        """Return the row with the smallest natural map, or None where every attempt broke down."""
        known = [row for row in self.attempts(problem, tolerance) if row.natural_map is not None]
        return min(known, key=lambda row: row.natural_map or 0.0, default=None)

    def peers_at(self, tolerance: float) -> Baseline | None:
        """Return the baseline where it measures this tolerance."""
        return self.baseline if self.baseline and self.baseline.measures(tolerance) else None

    def peer(self, problem: str, tolerance: float) -> float | None:
        """Return the baseline's best time, infinite where it has none; None where it did not try."""
        baseline = self.peers_at(tolerance)
        held = baseline.problems.get(problem) if baseline else None
        return None if held is None else held.best(tolerance)

    def families(self) -> list[str]:
        """Return the families, by their largest problem, largest first."""
        size = {s.family: s.contacts for s in sorted(self.subjects, key=lambda s: s.contacts)}
        return sorted(size, key=lambda family: (-size[family], family))


@dataclass(frozen=True)
class Against:
    """A line against the baseline's best solver of each problem.

    Parameters
    ----------
    ratio : float or None
        Geometric mean of our time / the baseline's best time, over the problems that the baseline solved; one that we
        did not solve is charged the time limit. None without any.
    solved, problems : int
        How many of those problems we solved, and how many there are.
    """

    ratio: float | None
    solved: int
    problems: int


def against_baseline(
    scores: Scores, line: Line | None, subjects: Iterable[Subject], tolerance: float, setup: bool = False
) -> Against:
    """Compare a line, or with None the fastest line of each problem, with the baseline's best solver."""
    ratios, solved = [], 0
    for subject in subjects:
        peer = scores.peer(subject.name, tolerance)
        if peer is None or not isfinite(peer):
            continue
        own = min(scores.seconds(subject.name, x, tolerance, setup) for x in ([line] if line else scores.lines))
        solved += isfinite(own)
        ratios.append(min(own, scores.time_limit) / peer)
    return Against(geometric_mean(ratios) if ratios else None, solved, len(ratios))

"""gpx-lcp against the fastest peer of the same run, at equal measured error.

A setting meets a bound on a scene when, in every judged step, the load across each interface and the balance of each
body are right to the bound, nothing has drifted by 1 mm, and nothing overlaps by 1 mm. gpx-lcp is held to the same.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from benchmarks.engines import OWN
from benchmarks.records import Record

BOUNDS = (1e-2, 1e-4, 1e-8)
COLD_BOUND = 1e-10

# m; what sank or wandered further does not stand, whatever its loads are.
PENETRATION_LIMIT, DRIFT_LIMIT = 1e-3, 1e-3

# What a cold exact step and the steps of large scenes are held against: pybullet as it is usually run, with Bullet's
# settings. Large scenes are held against pybullet as it is shipped, too.
USUAL_PEER, USUAL_SETTING = "pybullet", "50 sweeps"
USUAL_SOLVER, SHIPPED_SOLVER = "SI", "SI (as shipped)"


@dataclass(frozen=True)
class Ratio:
    """The fastest of gpx-lcp beside the fastest of its peers.

    Parameters
    ----------
    own, peer : Record or None
        None where no setting meets the bound.
    unfinished : int
        How many of the peers' settings that might have met it were stopped by the time limit.
    """

    own: Record | None
    peer: Record | None
    unfinished: int = 0

    @property
    def value(self) -> float | None:
        """Own time over the peer's; None unless both meet the bound."""
        if self.own is None or self.peer is None:
            return None
        return _ms(self.own) / _ms(self.peer)


def standing(rows: Sequence[Record], scene: str, bound: float) -> Ratio:
    """Return the ratio of the settled steps of a scene at a bound."""
    here = _ranked(rows, scene, "stepped")

    def meets(row: Record) -> bool:
        return not row.cut_short and _error(row) <= bound and _stands(row)

    return Ratio(
        _fastest(here, lambda row: row.engine == OWN and meets(row)),
        _fastest(here, lambda row: row.engine != OWN and meets(row)),
        sum(row.engine != OWN and row.cut_short for row in here),
    )


def cold(rows: Sequence[Record], scene: str) -> Ratio:
    """Return the ratio of our exact first step (1e-10) to pybullet's with its usual 50 sweeps, whatever its error."""
    here = _ranked(rows, scene, "cold")
    exact = _fastest(here, lambda row: row.engine == OWN and _error(row) <= COLD_BOUND)
    return Ratio(exact, _fastest(here, lambda row: _usual(row, USUAL_SOLVER)))


def certified(rows: Sequence[Record], scene: str, solver: str = USUAL_SOLVER) -> Ratio:
    """Return the ratio of our fastest step that is no less accurate, by the certificate, than pybullet's usual one."""
    here = [row for row in _ranked(rows, scene, "stepped") if not row.cut_short]
    usual = _fastest(here, lambda row: _usual(row, solver))
    bound = 0.0 if usual is None or usual.natural_map is None else usual.natural_map
    own = _fastest(here, lambda row: row.engine == OWN and row.natural_map is not None and row.natural_map <= bound)
    return Ratio(own, usual)


def _ranked(rows: Sequence[Record], scene: str, case: str) -> list[Record]:
    return [row for row in rows if row.scene == scene and row.case == case and row.measured and not row.frictionless]


def _usual(row: Record, solver: str) -> bool:
    return (row.engine, row.solver, row.setting) == (USUAL_PEER, solver, USUAL_SETTING)


def _error(row: Record) -> float:
    errors = (row.figure("load_error"), row.figure("body_error"))
    return max(float("inf") if error is None else error for error in errors)


def _stands(row: Record) -> bool:
    limits = {"penetration": PENETRATION_LIMIT, "drift": DRIFT_LIMIT}
    return all((value := row.figure(name)) is not None and value < limit for name, limit in limits.items())


def _fastest(rows: Sequence[Record], wanted: Callable[[Record], bool]) -> Record | None:
    return min(filter(wanted, rows), key=_ms, default=None)


def _ms(row: Record) -> float:
    assert row.step_ms is not None  # _ranked takes measured rows only
    return row.step_ms

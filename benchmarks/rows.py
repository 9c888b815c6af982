"""One row per attempt, failures too, as CSV."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any


@dataclass(frozen=True)
class Row:
    """What was asked, what came out, and where it was measured.

    Parameters
    ----------
    case : str
        "cold": the first step from touching rest, of a fresh simulation each time. "stepped": a simulation from rest.
    status : str
        The engine's own word for the worst step ("ran" where it reports none); or "missing", "refused" (the engine does
        not take this setting, by its own error), "error" (an unexpected exception), "interrupted". Only rows with
        `measured` hold measures.
    steps, steps_asked : int
        Steps made and asked for; fewer were made where the time limit struck, and `message` says so.
    step_ms : float
        Median over repeats of each step's wall time, then the mean over the steps: the first one, or the settled ones.
    step_ms_low, step_ms_high : float
        The same from the fastest and the slowest repeat of each step.
    setup_ms, solve_ms : float
        Parts of the step as the engine reports them, same mean; empty where it does not.
    iterations : float
        Mean per step, as reported.
    """

    suite: str
    scene: str
    case: str
    bodies: int
    engine: str
    engine_version: str
    solver: str
    formulation: str
    setting: str
    effort: float
    time_step: float
    status: str
    message: str = ""
    method: str = ""
    fallbacks: str = ""
    contacts: int | None = None
    repeats: int = 0
    steps: int = 0
    steps_asked: int = 0
    step_ms: float | None = None
    step_ms_low: float | None = None
    step_ms_high: float | None = None
    setup_ms: float | None = None
    solve_ms: float | None = None
    iterations: float | None = None
    load_error: float | None = None
    body_error: float | None = None
    penetration: float | None = None
    drift: float | None = None
    unexplained: float | None = None
    natural_map: float | None = None
    cone_violation: float | None = None
    penetration_velocity: float | None = None
    complementarity: float | None = None
    dissipation: float | None = None
    sliding_angle: float | None = None
    energy_change: float | None = None
    cpu: str = ""
    cores: str = ""
    system: str = ""
    python: str = ""
    numpy: str = ""
    scipy: str = ""
    gpx_lcp: str = ""
    build_profile: str = ""
    revision: str = ""
    threads: str = ""
    measured_at: str = ""

    @property
    def measured(self) -> bool:
        """Whether the attempt came as far as a measured step."""
        return self.step_ms is not None

    @property
    def cut_short(self) -> bool:
        """Whether the time limit ended the simulation before it was settled."""
        return self.measured and self.steps < self.steps_asked

    @property
    def frictionless(self) -> bool:
        """Whether the program leaves friction out: an easier question, not to be ranked with the others."""
        return self.formulation == "normal"

    @property
    def line(self) -> tuple[str, str, str]:
        """The settings that differ in effort only."""
        return self.engine, self.solver, self.formulation


def write_csv(path: Path, kind: type[Any], rows: Iterable[Any], where: Mapping[str, str] | None = None) -> None:
    """Write rows of one dataclass, with a header; a file that was there is replaced only once the new one is complete.

    Parameters
    ----------
    kind : type
        The dataclass, whose fields are the columns, also when there is no row.
    where : mapping, optional
        Columns to add that are the same in every row: where it was measured.
    """
    where = where or {}
    columns = [field.name for field in fields(kind)]
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_suffix(path.suffix + ".partial")
    with partial.open("w", encoding="utf-8", newline="") as stream:
        writer = csv.writer(stream)
        writer.writerow([*columns, *where])
        for row in rows:
            cells = ["" if (value := getattr(row, name)) is None else value for name in columns]
            writer.writerow([*cells, *where.values()])
    partial.replace(path)

"""Where the problems come from: a folder of FCLIB files, or scenes of our own written as such files."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

import gpx_lcp as gpx

# Beyond this many rows the eigenvalues of A take longer than most attempts.
RANK_LIMIT = 2000
# Eigenvalues below this share of the largest count as zero: files often carry few digits.
RANK_TOLERANCE = 1e-7

# Largest random speed of a body in the shaken scenes, m/s and rad/s.
SHAKE = 1.0


@dataclass(frozen=True)
class ProblemFile:
    """A file and the name it goes by: its stem, or its path below the folder where another file has the same stem."""

    name: str
    path: Path

    @property
    def family(self) -> str:
        """The leading letters of the file's name, "Capsules" of Capsules-i100-1090; the whole name without any."""
        stem = self.path.stem
        letters = re.match(r"[^\W\d_]+", stem)
        return letters.group() if letters else stem


def find(folder: Path) -> list[ProblemFile]:
    """Return every *.hdf5 below the folder, by name.

    Raises
    ------
    SettingsError
        When there is no such folder, or no such file in it.
    """
    if not folder.is_dir():
        raise gpx.SettingsError(f"--data is {folder}: there is no such folder")
    paths = sorted(folder.rglob("*.hdf5"))
    if not paths:
        raise gpx.SettingsError(f"--data is {folder}: it holds no *.hdf5 file")
    stems = Counter(path.stem for path in paths)
    return sorted(
        (
            ProblemFile(path.stem if stems[path.stem] == 1 else str(path.relative_to(folder).with_suffix("")), path)
            for path in paths
        ),
        key=lambda problem: problem.name,
    )


def smallest_of_each_family(problems: Sequence[ProblemFile]) -> list[ProblemFile]:
    """Return the smallest file of each family."""
    by_size = sorted(problems, key=lambda problem: (problem.path.stat().st_size, problem.name))
    chosen = {problem.family: problem for problem in reversed(by_size)}
    return sorted(chosen.values(), key=lambda problem: problem.name)


def rank_ratio(system: gpx.StackedSystem) -> float | None:
    """Return rows of A / rank of A: above 1, impulses are not unique; None beyond `RANK_LIMIT` rows or without rank."""
    size = system.contacts * system.rows
    if not 0 < size <= RANK_LIMIT:
        return None
    A = system.A if isinstance(system.A, np.ndarray) else system.A.toarray()
    eigenvalues = np.linalg.eigvalsh(0.5 * (A + A.T))  # of the symmetric part: files are asymmetric by rounding
    rank = int((eigenvalues > RANK_TOLERANCE * eigenvalues[-1]).sum()) if eigenvalues[-1] > 0.0 else 0
    return size / rank if rank else None


SCENES: Mapping[str, Callable[[], gpx.Scene]] = {
    "Tower-5": partial(gpx.scenes.tower, 5),
    "Tower-20": partial(gpx.scenes.tower, 20),
    "Tower-50": partial(gpx.scenes.tower, 50),
    "Wall-5": partial(gpx.scenes.wall, 5),
    "Wall-8": partial(gpx.scenes.wall, 8),
    "HeavyOnLight-2-1e3": partial(gpx.scenes.heavy_on_light, 2, 1e3),
    "HeavyOnLight-10-1e6": partial(gpx.scenes.heavy_on_light, 10, 1e6),
}


def own_systems() -> Iterator[tuple[str, gpx.StackedSystem]]:
    """Yield each scene of the suite's own at rest, and again as Shaken...: its bodies with random velocities."""
    for seed, (name, scene) in enumerate(SCENES.items()):
        system = gpx.World(scene(), time_step=1 / 240).system()
        yield name, system
        yield f"Shaken{name}", shaken(system, seed)


def shaken(system: gpx.StackedSystem, seed: int) -> gpx.StackedSystem:
    """Return the system of the same touching bodies with velocities uniform in ±SHAKE added: B - J v."""
    assert system.jacobian is not None  # a World always gives it
    velocity = np.random.default_rng(seed).uniform(-SHAKE, SHAKE, system.jacobian.shape[1])
    return gpx.StackedSystem(system.A, system.B - system.jacobian @ velocity, system.friction)


def write_own(folder: Path) -> None:
    """Write the suite's own problems as FCLIB files."""
    for name, system in own_systems():
        gpx.write_fclib(folder / f"{name}.hdf5", system)

"""Where the problems come from: a folder of FCLIB files, or scenes of our own written as such files."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
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
SHAKEN = "Shaken"


@dataclass(frozen=True)
class ProblemFile:
    """A file and the name it goes by: its stem, or its path below the folder where another file has the same stem.

    Parameters
    ----------
    path : Path or None
        None for a problem of our own, made from its name.
    size : int
        Bytes of the file; of our own, the place in the list.
    """

    name: str
    path: Path | None
    size: int

    @property
    def family(self) -> str:
        """The leading letters of the file's name, "Capsules" of Capsules-i100-1090; the whole name without any."""
        stem = self.path.stem if self.path else self.name
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

    def name(path: Path) -> str:
        return path.stem if stems[path.stem] == 1 else str(path.relative_to(folder).with_suffix(""))

    files = [ProblemFile(name(path), path, path.stat().st_size) for path in paths]
    return sorted(files, key=lambda problem: problem.name)


def own_problems() -> list[ProblemFile]:
    """Return the suite's own: each scene at rest, and again as Shaken...: its bodies with random velocities."""
    names = [f"{shake}{name}" for shake in ("", SHAKEN) for name in SCENES]
    return [ProblemFile(name, None, place) for place, name in enumerate(names)]


def smallest_of_each_family(problems: Sequence[ProblemFile]) -> list[ProblemFile]:
    """Return the smallest problem of each family."""
    by_size = sorted(problems, key=lambda problem: (problem.size, problem.name))
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


def own_system(name: str, seed: int) -> gpx.StackedSystem:
    """Return a problem of our own by its name; the seed is that of the velocities of a Shaken one."""
    system = gpx.World(SCENES[name.removeprefix(SHAKEN)](), time_step=1 / 240).system()
    return shaken(system, seed) if name.startswith(SHAKEN) else system


def shaken(system: gpx.StackedSystem, seed: int) -> gpx.StackedSystem:
    """Return the system of the same touching bodies with velocities uniform in ±SHAKE added: B - J v."""
    assert system.jacobian is not None  # a World always gives it
    velocity = np.random.default_rng(seed).uniform(-SHAKE, SHAKE, system.jacobian.shape[1])
    return gpx.StackedSystem(system.A, system.B - system.jacobian @ velocity, system.friction)

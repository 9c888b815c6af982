"""Impulses and the systems that they answer, packed so that they can be certified again."""

from __future__ import annotations

import hashlib
import io
import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp

import gpx_lcp as gpx
from benchmarks.attempts import Answer, FileRecipe
from benchmarks.interface import Array


def pack(answers: Sequence[Answer]) -> bytes:
    """Return the answers as one compressed numpy archive, each system once; nothing without answers."""
    if not answers:
        return b""
    arrays: dict[str, Any] = {}
    systems: dict[int, int] = {}
    index: list[dict[str, Any]] = []
    for number, answer in enumerate(answers):
        if id(answer.system) not in systems:
            systems[id(answer.system)] = len(systems)
            arrays |= {f"system{len(systems) - 1}_{name}": value for name, value in _system(answer.system).items()}
        arrays[f"impulse{number}"] = answer.impulse
        if answer.history:
            arrays[f"history{number}"] = np.array(answer.history, dtype=np.float64)
        index.append({"system": systems[id(answer.system)], "program": answer.program, "facets": answer.facets})
    stream = io.BytesIO()
    np.savez_compressed(stream, index=np.array(json.dumps(index)), **arrays)
    return stream.getvalue()


@dataclass(frozen=True)
class Kept:
    """An answer read back."""

    system: gpx.StackedSystem
    impulse: Array
    program: str
    facets: int
    history: Array


class Archive:
    """The answers of one file; systems are remade once, when first asked for."""

    def __init__(self, path: Path) -> None:
        """Open the file.

        Raises
        ------
        ProblemError
            When it is not there or holds something else.
        """
        try:
            with np.load(path, allow_pickle=False) as held:
                self._arrays = dict(held)
            self._index = json.loads(str(self._arrays["index"]))
        except (OSError, ValueError, KeyError) as error:
            raise gpx.ProblemError(f"{path} cannot be read as stored answers: {error}") from error
        self._path = path
        self._systems: dict[int, gpx.StackedSystem] = {}

    def __getitem__(self, number: int) -> Kept:
        """Return one answer.

        Raises
        ------
        ProblemError
            When there is none of that number, or the problem file that it needs is gone or has changed.
        """
        if not 0 <= number < len(self._index):
            raise gpx.ProblemError(f"{self._path} holds {len(self._index)} answers: there is no number {number}")
        entry = self._index[number]
        which = entry["system"]
        if which not in self._systems:
            prefix = f"system{which}_"
            arrays = {name.removeprefix(prefix): a for name, a in self._arrays.items() if name.startswith(prefix)}
            self._systems[which] = _remade(arrays)
        return Kept(
            self._systems[which],
            self._arrays[f"impulse{number}"],
            entry["program"],
            entry["facets"],
            self.history(number),
        )

    def history(self, number: int) -> Array:
        """Return the residual after so many iterations, (k, 2), of one answer; no rows where the solver told none."""
        return self._arrays.get(f"history{number}", np.zeros((0, 2)))


def file_recipe(path: Path) -> FileRecipe:
    """Return the recipe of a problem file."""
    return FileRecipe(str(path.resolve()), _sha256(path))


def _sha256(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def _system(system: gpx.StackedSystem | FileRecipe) -> dict[str, Any]:
    if isinstance(system, FileRecipe):
        return {name: np.array(value) for name, value in asdict(system).items()}
    arrays = {"B": system.B, "friction": system.friction}
    if system.jacobian is None:
        return {**arrays, **_matrix("A", system.A)}
    if system.free_velocity is not None:
        arrays["free_velocity"] = system.free_velocity
    return {**arrays, **_matrix("jacobian", system.jacobian), "inverse_mass": system.inverse_mass}


def _matrix(name: str, matrix: Any) -> dict[str, Any]:
    if isinstance(matrix, np.ndarray):
        return {name: matrix}
    rows = sp.csr_array(matrix)
    parts = {"data": rows.data, "indices": rows.indices, "indptr": rows.indptr, "shape": np.array(rows.shape)}
    return {f"{name}_{part}": array for part, array in parts.items()}


def _remade(arrays: dict[str, Any]) -> gpx.StackedSystem:
    if "path" in arrays:
        return _read_again(Path(str(arrays["path"])), str(arrays["sha256"]))
    if "inverse_mass" not in arrays:
        return gpx.StackedSystem(_unpacked("A", arrays), arrays["B"], arrays["friction"])
    return gpx.StackedSystem.from_jacobian(
        _unpacked("jacobian", arrays),
        arrays["inverse_mass"],
        arrays["B"],
        arrays["friction"],
        free_velocity=arrays.get("free_velocity"),
    )


def _unpacked(name: str, arrays: dict[str, Any]) -> Any:
    if name in arrays:
        return arrays[name]
    data, indices, indptr, shape = (arrays[f"{name}_{part}"] for part in ("data", "indices", "indptr", "shape"))
    return sp.csr_array((data, indices, indptr), shape=tuple(int(side) for side in shape))


def _read_again(path: Path, sha256: str) -> gpx.StackedSystem:
    if not path.is_file():
        raise gpx.ProblemError(f"the problem file {path} is gone: its impulses cannot be certified without it")
    if _sha256(path) != sha256:
        raise gpx.ProblemError(f"the problem file {path} has changed since its impulses were computed")
    return gpx.read_fclib(path)

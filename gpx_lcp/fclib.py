"""Problem files of the FCLIB collection: local friction problems in HDF5, in the plane and in space.

FCLIB states u = W r + q with K ∋ r ⟂ u + μ‖u_t‖ n ∈ K*, components normal first, so that A = W and B = -q.
W is stored as compressed rows (nz = -2), compressed columns (nz = -1) or triplets (nz ≥ 0, `p` holding the columns, as
in CSparse).

Source: V. Acary, M. Brémond, T. Koziara, F. Pérignon, *FCLIB: a collection of discrete 3D frictional contact problems*,
INRIA RT-0444 (2014).
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import h5py
import numpy as np
import numpy.typing as npt
import scipy.sparse as sp

from formulations import ProblemError, StackedSystem
from formulations.checks import Array, as_array, freeze

LOCAL: Final = "fclib_local"
COMPRESSED_ROWS: Final = -2
COMPRESSED_COLUMNS: Final = -1


class FclibProblem(StackedSystem):
    """A stacked system that came from a file, with what else the file carries.

    Attributes
    ----------
    guesses : tuple of (n, rows) arrays, N s
        Starting impulses. Those of wild files need not be feasible.
    reference : (n, rows) array or None, N s
        The impulses that the file calls its solution; certify them before you rely on them.
    title, description, math_info : str
    """

    def __init__(
        self,
        A: npt.ArrayLike | sp.sparray | sp.spmatrix,
        B: npt.ArrayLike,
        friction: npt.ArrayLike,
        *,
        guesses: Sequence[npt.ArrayLike] = (),
        reference: npt.ArrayLike | None = None,
        title: str = "",
        description: str = "",
        math_info: str = "",
    ) -> None:
        super().__init__(A, B, friction)
        shape = (self.contacts, self.rows)
        self.guesses: tuple[Array, ...] = tuple(
            freeze(as_array(f"guesses[{index}]", guess, shape)) for index, guess in enumerate(guesses)
        )
        self.reference: Array | None = None if reference is None else freeze(as_array("reference", reference, shape))
        self.title, self.description, self.math_info = title, description, math_info


def read_fclib(path: str | os.PathLike[str]) -> FclibProblem:
    """Read a local friction problem.

    Parameters
    ----------
    path : path of an HDF5 file

    Raises
    ------
    FileNotFoundError
        When there is no such file.
    ProblemError
        When the file is broken, truncated or no local FCLIB problem; the message names the file and the dataset.
    """
    name = Path(path)
    if not name.is_file():
        raise FileNotFoundError(f"{name}: no such file")
    try:
        with h5py.File(name, "r") as file:
            return _Reader(name, file).problem()
    except OSError as error:
        raise ProblemError(f"{name}: not a readable HDF5 file ({error})") from error


def write_fclib(path: str | os.PathLike[str], system: StackedSystem) -> None:
    """Write a system as a local friction problem; reading it back gives the same numbers, bit by bit.

    A is written in compressed rows. A FclibProblem is written with its guesses, its reference solution and its texts.
    An existing file is replaced, and only once the new one is complete.

    Raises
    ------
    ProblemError
        When the contacts have one row: FCLIB knows two and three.
    """
    if system.rows == 1:
        raise ProblemError("system has 1 row per contact: an FCLIB problem has 2 or 3")
    problem = system if isinstance(system, FclibProblem) else FclibProblem(system.A, system.B, system.friction)
    name = Path(path)
    partial = name.with_name(name.name + ".partial")
    try:
        with h5py.File(partial, "w") as file:
            _write(file, problem)
        partial.replace(name)
    finally:
        partial.unlink(missing_ok=True)


class _Reader:
    """Reads datasets with errors that name the file and the dataset."""

    def __init__(self, name: Path, file: h5py.File) -> None:
        self.name = name
        self.file = file

    def problem(self) -> FclibProblem:
        if LOCAL not in self.file:
            held = ", ".join(self.file) or "nothing"
            raise ProblemError(f"{self.name}: no group {LOCAL}; the file holds {held}")
        for group in ("V", "R"):
            if f"{LOCAL}/{group}" in self.file:
                raise ProblemError(f"{self.name}: {LOCAL}/{group} holds bilateral constraints, which are not supported")
        dimension = self.integer(f"{LOCAL}/spacedim")
        if dimension not in (2, 3):
            raise ProblemError(f"{self.name}: {LOCAL}/spacedim is {dimension}: it must be 2 or 3")
        matrix = self.matrix(f"{LOCAL}/W")
        friction = self.array(f"{LOCAL}/vectors/mu")
        q = self.array(f"{LOCAL}/vectors/q")
        if q.size != dimension * friction.size:
            raise ProblemError(
                f"{self.name}: {LOCAL}/vectors/q has length {q.size}, but {LOCAL}/vectors/mu has "
                f"{friction.size} contacts of {dimension} rows"
            )
        shape = (friction.size, dimension)
        try:
            return FclibProblem(
                matrix,
                -q,
                friction,
                guesses=self.guesses(shape),
                reference=self.array("solution/r").reshape(shape) if "solution/r" in self.file else None,
                title=self.text(f"{LOCAL}/info/title"),
                description=self.text(f"{LOCAL}/info/description"),
                math_info=self.text(f"{LOCAL}/info/math_info"),
            )
        except ProblemError as error:
            raise ProblemError(f"{self.name}: {error} (A is {LOCAL}/W, B is -{LOCAL}/vectors/q)") from error
        except ValueError as error:
            raise ProblemError(f"{self.name}: solution/r does not hold {shape[0]} x {shape[1]} numbers") from error

    def matrix(self, group: str) -> sp.csr_array:
        rows, columns, storage = (self.integer(f"{group}/{key}") for key in ("m", "n", "nz"))
        values, indices, pointers = self.array(f"{group}/x"), self.indices(f"{group}/i"), self.indices(f"{group}/p")
        if storage >= 0:
            self.require(f"{group}/i", indices, storage, rows)
            self.require(f"{group}/p", pointers, storage, columns)
            self.require_length(f"{group}/x", values.size, storage)
            triplets = sp.coo_array((values[:storage], (indices[:storage], pointers[:storage])), shape=(rows, columns))
            return sp.csr_array(triplets)
        if storage not in (COMPRESSED_ROWS, COMPRESSED_COLUMNS):
            raise ProblemError(f"{self.name}: {group}/nz is {storage}: it must be -2, -1 or a number of triplets")
        major, minor = (rows, columns) if storage == COMPRESSED_ROWS else (columns, rows)
        if pointers.size != major + 1 or pointers[0] != 0 or (np.diff(pointers) < 0).any():
            raise ProblemError(f"{self.name}: {group}/p must hold {major + 1} pointers that start at 0 and never fall")
        stored = int(pointers[-1])
        self.require(f"{group}/i", indices, stored, minor)
        self.require_length(f"{group}/x", values.size, stored)
        kind = sp.csr_array if storage == COMPRESSED_ROWS else sp.csc_array
        return sp.csr_array(kind((values[:stored], indices[:stored], pointers), shape=(rows, columns)))

    def guesses(self, shape: tuple[int, int]) -> list[Array]:
        if "guesses" not in self.file:
            return []
        guesses = []
        for number in range(1, self.integer("guesses/number_of_guesses") + 1):
            values = self.array(f"guesses/{number}/r")
            if values.size != shape[0] * shape[1]:
                raise ProblemError(
                    f"{self.name}: guesses/{number}/r has length {values.size}: {shape[0]} x {shape[1]} are needed"
                )
            guesses.append(values.reshape(shape))
        return guesses

    def require(self, dataset: str, indices: npt.NDArray[np.int64], count: int, bound: int) -> None:
        self.require_length(dataset, indices.size, count)
        wrong = np.flatnonzero((indices[:count] < 0) | (indices[:count] >= bound))
        if wrong.size:
            raise ProblemError(
                f"{self.name}: {dataset}[{wrong[0]}] is {indices[wrong[0]]}: indices must lie between 0 and {bound - 1}"
            )

    def require_length(self, dataset: str, length: int, count: int) -> None:
        if length < count:
            raise ProblemError(f"{self.name}: {dataset} has length {length}: {count} entries are needed")

    def dataset(self, dataset: str) -> Any:
        if not isinstance(self.file.get(dataset), h5py.Dataset):
            raise ProblemError(f"{self.name}: dataset {dataset} is missing")
        try:
            return self.file[dataset][()]
        except (OSError, TypeError, ValueError) as error:
            raise ProblemError(f"{self.name}: dataset {dataset} cannot be read ({error})") from error

    def integer(self, dataset: str) -> int:
        value = np.asarray(self.dataset(dataset))
        if value.size != 1 or value.dtype.kind not in "iu":
            raise ProblemError(f"{self.name}: {dataset} must be one integer, not {value.dtype} of shape {value.shape}")
        return int(value.reshape(-1)[0])

    def indices(self, dataset: str) -> npt.NDArray[np.int64]:
        value = np.asarray(self.dataset(dataset))
        if value.ndim != 1 or value.dtype.kind not in "iu":
            raise ProblemError(f"{self.name}: {dataset} must be a list of integers, not {value.dtype} {value.shape}")
        return value.astype(np.int64)

    def array(self, dataset: str) -> Array:
        value = np.asarray(self.dataset(dataset))
        if value.dtype.kind not in "iuf":
            raise ProblemError(f"{self.name}: {dataset} must hold numbers, not {value.dtype}")
        return value.astype(np.float64).reshape(-1)

    def text(self, dataset: str) -> str:
        if dataset not in self.file:
            return ""
        value = self.dataset(dataset)
        return value.decode("utf-8", "replace") if isinstance(value, bytes) else str(value)


def _write(file: h5py.File, problem: FclibProblem) -> None:
    matrix = _every_entry(problem.A) if isinstance(problem.A, np.ndarray) else problem.A
    file[f"{LOCAL}/spacedim"] = np.array([problem.rows], dtype=np.int32)
    group = file.create_group(f"{LOCAL}/W")
    for key, value in (("m", matrix.shape[0]), ("n", matrix.shape[1]), ("nz", COMPRESSED_ROWS), ("nzmax", matrix.nnz)):
        group[key] = np.array([value], dtype=np.int32)
    group["p"], group["i"], group["x"] = matrix.indptr.astype(np.int32), matrix.indices.astype(np.int32), matrix.data
    file[f"{LOCAL}/vectors/q"] = -problem.B
    file[f"{LOCAL}/vectors/mu"] = problem.friction
    for key in ("title", "description", "math_info"):
        file[f"{LOCAL}/info/{key}"] = np.bytes_(getattr(problem, key).encode() or b"\0")
    if problem.guesses:
        file["guesses/number_of_guesses"] = np.array([len(problem.guesses)], dtype=np.int32)
    for number, guess in enumerate(problem.guesses, start=1):
        _write_impulse(file, f"guesses/{number}", problem, guess)
    if problem.reference is not None:
        _write_impulse(file, "solution", problem, problem.reference)


def _write_impulse(file: h5py.File, group: str, problem: FclibProblem, impulse: Array) -> None:
    file[f"{group}/r"] = impulse.reshape(-1)
    file[f"{group}/u"] = problem.velocity(impulse).reshape(-1)


def _every_entry(matrix: Array) -> sp.csr_array:
    """Return a dense matrix as CSR with its zeros stored, so that it comes back entry by entry."""
    size = matrix.shape[0]
    indices, pointers = np.tile(np.arange(size), size), size * np.arange(size + 1)
    return sp.csr_array((matrix.reshape(-1), indices, pointers), shape=matrix.shape)

"""The native core; every name here is wrapped by a public one in `gpx_lcp`."""

from collections.abc import Sequence
from typing import Any, final

import numpy as np
import numpy.typing as npt

__all__ = [
    "BUILD_PROFILE",
    "Bodies",
    "Contacts",
    "ExactReport",
    "Stack",
    "State",
    "Step",
    "System",
    "exact",
    "gauss_seidel",
    "take_steps",
]

_Floats = npt.NDArray[np.float64]
_Indices = npt.NDArray[np.int32] | npt.NDArray[np.int64]
# Islands; contacts, rows and velocities before and after; each reduction: its name, islands, and the three removed.
_Counts = tuple[int, int, int]
_Presolve = tuple[int, _Counts, _Counts, list[tuple[str, int, _Counts]]]

BUILD_PROFILE: str

@final
class ExactReport:
    @property
    def impulse(self) -> npt.NDArray[np.float64]: ...
    @property
    def residual(self) -> float: ...
    @property
    def status(self) -> str: ...
    @property
    def iterations(self) -> int: ...
    @property
    def factorisations(self) -> int: ...
    @property
    def fill(self) -> int: ...
    @property
    def history(self) -> list[tuple[int, float]]: ...
    @property
    def fallbacks(self) -> list[str]: ...
    @property
    def infeasibility(self) -> npt.NDArray[np.float64] | None: ...
    @property
    def solve_seconds(self) -> float: ...
    @property
    def presolve(self) -> _Presolve | None: ...

@final
class System:
    @staticmethod
    def from_dense(delassus: _Floats, target: _Floats, friction: _Floats) -> System: ...
    @staticmethod
    def from_compressed_rows(
        starts: _Indices, columns: _Indices, values: _Floats, target: _Floats, friction: _Floats
    ) -> System: ...
    @staticmethod
    def from_factor(
        starts: _Indices,
        columns: _Indices,
        blocks: _Floats,
        jacobian: _Floats,
        block_columns: int,
        target: _Floats,
        friction: _Floats,
    ) -> System: ...
    def presolve(self, law: str) -> _Presolve | None: ...
    def residual(self, law: str, impulse: _Floats) -> float: ...

def exact(system: System, settings: dict[str, Any], start: _Floats | None) -> ExactReport: ...
def gauss_seidel(
    matrix: dict[str, Any], question: dict[str, Any], effort: dict[str, Any]
) -> tuple[npt.NDArray[np.float64], str, int, npt.NDArray[np.int64], npt.NDArray[np.float64], float]: ...

@final
class Bodies:
    def __new__(
        cls,
        moving: int,
        shapes: Sequence[tuple[str, _Floats]],
        materials: Sequence[tuple[float, int, tuple[float, float], int]],
        masses: _Floats,
        inertias: _Floats,
        fixed_poses: _Floats,
    ) -> Bodies: ...
    def free_velocities(
        self, state: State, forces: _Floats, gravity: tuple[float, float, float], time_step: float
    ) -> _Floats: ...
    def detect(self, state: State, free_velocities: _Floats, time_step: float) -> Contacts: ...
    def match_impulses(self, contacts: Contacts, previous: Contacts, impulses: _Floats) -> _Floats: ...
    def stack(
        self,
        state: State,
        contacts: Contacts,
        free_velocities: _Floats,
        time_step: float,
        impact_speed: float,
        rows: int,
        columns: int,
    ) -> Stack: ...
    def moved(
        self,
        state: State,
        contacts: Contacts,
        stack: Stack,
        forces: _Floats,
        impulse: _Floats,
        time_step: float,
    ) -> State: ...

@final
class State:
    def __new__(cls, positions: _Floats, orientations: _Floats, velocities: _Floats) -> State: ...
    @property
    def positions(self) -> _Floats: ...
    @property
    def orientations(self) -> _Floats: ...
    @property
    def velocities(self) -> _Floats: ...

@final
class Contacts:
    def __new__(
        cls,
        among: Bodies,
        bodies: npt.NDArray[np.uint32],
        features: npt.NDArray[np.uint32],
        points: _Floats,
        frames: _Floats,
        gaps: _Floats,
    ) -> Contacts: ...
    def __len__(self) -> int: ...
    @property
    def body_a(self) -> npt.NDArray[np.int64]: ...
    @property
    def body_b(self) -> npt.NDArray[np.int64]: ...
    @property
    def pairs(self) -> npt.NDArray[np.uint32]: ...
    @property
    def features(self) -> npt.NDArray[np.uint32]: ...
    @property
    def points(self) -> _Floats: ...
    @property
    def frames(self) -> _Floats: ...
    @property
    def gaps(self) -> _Floats: ...
    @property
    def friction(self) -> _Floats: ...

@final
class Stack:
    def jacobian(self) -> tuple[npt.NDArray[np.int32], npt.NDArray[np.int32], _Floats, _Floats]: ...
    def inverse_mass(self) -> _Floats: ...
    @property
    def free_velocities(self) -> _Floats: ...
    @property
    def target(self) -> _Floats: ...
    @property
    def friction(self) -> _Floats: ...
    @property
    def restitution(self) -> _Floats: ...
    @property
    def impacts(self) -> npt.NDArray[np.bool_]: ...

@final
class Step:
    @property
    def state(self) -> State: ...
    @property
    def contacts(self) -> Contacts: ...
    @property
    def stack(self) -> Stack: ...
    @property
    def frictionless(self) -> bool: ...
    @property
    def start_moved(self) -> float | None: ...
    @property
    def steps(self) -> int: ...
    @property
    def unsolved(self) -> int: ...
    @property
    def impulse(self) -> _Floats: ...
    @property
    def status(self) -> str: ...
    @property
    def residual(self) -> float: ...
    @property
    def iterations(self) -> int: ...
    @property
    def setup_seconds(self) -> float: ...
    @property
    def solve_seconds(self) -> float: ...
    @property
    def history(self) -> list[tuple[int, float]]: ...
    @property
    def fallbacks(self) -> list[str]: ...
    @property
    def presolve(self) -> _Presolve | None: ...
    @property
    def extras(self) -> dict[str, Any]: ...

def take_steps(
    bodies: Bodies, state: State, contacts: Contacts | None, impulse: _Floats, asked: dict[str, Any], count: int
) -> tuple[Step | None, int | None, BaseException | None]: ...

"""The native core; every name here is wrapped by a public one in `gpx_lcp`."""

from collections.abc import Sequence
from typing import Any, final

import numpy as np
import numpy.typing as npt

__all__ = ["BUILD_PROFILE", "Bodies", "Contacts", "State", "gauss_seidel"]

_Floats = npt.NDArray[np.float64]

BUILD_PROFILE: str

def gauss_seidel(
    matrix: dict[str, Any], question: dict[str, Any], effort: dict[str, Any]
) -> tuple[npt.NDArray[np.float64], str, int, npt.NDArray[np.int64], npt.NDArray[np.float64], float]: ...

@final
class Bodies:
    def __new__(
        cls,
        moving: int,
        shapes: Sequence[tuple[str, _Floats]],
        materials: Sequence[tuple[float, int, float, int]],
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
        gravity: float,
        rows: int,
        columns: int,
    ) -> tuple[npt.NDArray[np.int32], npt.NDArray[np.int32], _Floats, _Floats]: ...
    def inverse_mass(self, state: State, columns: int) -> _Floats: ...

@final
class State:
    def __new__(cls, positions: _Floats, orientations: _Floats, velocities: _Floats) -> State: ...
    def advanced(self, velocities: _Floats, pose_velocities: _Floats, time_step: float) -> State: ...
    @property
    def positions(self) -> _Floats: ...
    @property
    def orientations(self) -> _Floats: ...
    @property
    def velocities(self) -> _Floats: ...

@final
class Contacts:
    def __len__(self) -> int: ...
    @property
    def body_a(self) -> npt.NDArray[np.int64]: ...
    @property
    def body_b(self) -> npt.NDArray[np.int64]: ...
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
    @property
    def sizes(self) -> _Floats: ...

"""Snapshots: all that a world is at one instant, as the bytes of an `.npz` file.

Numbers are kept bit by bit, in arrays; what is not a table of numbers (names, shapes, materials, the solver's settings)
stands in one JSON text beside them, whose numbers read back as the same doubles.
"""

from __future__ import annotations

import io
import json
import zipfile
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from os import PathLike
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from formulations.checks import Array, freeze, require_finite
from gpx_lcp.errors import ProblemError, SettingsError
from gpx_lcp.inhabitants import table
from gpx_lcp.materials import Material
from gpx_lcp.scene import Body
from gpx_lcp.shapes import Box, Capsule, ConvexHull, Cylinder, HalfSpace, Shape, Sphere

FORMAT: Final = "gpx_lcp.World"
VERSION: Final = 2
_SHAPES: Final[Mapping[str, type[Shape]]] = {
    shape.kind: shape for shape in (Sphere, Box, Capsule, Cylinder, HalfSpace, ConvexHull)
}
# What a body was added with, besides mass and inertia, side by side.
_VECTORS: Final = {"position": 3, "orientation": 4, "velocity": 3, "angular_velocity": 3, "force": 3, "torque": 3}


@dataclass(frozen=True)
class ContactArrays:
    """The contacts of the last step as the core keeps them, and their impulses, (n, rows).

    The next step starts from `start`, (n, 3); for so many steps, `kept`, (n,), impulses were what they started from.
    """

    pairs: npt.NDArray[np.uint32]
    features: npt.NDArray[np.uint32]
    points: Array
    frames: Array
    gaps: Array
    impulse: Array
    start: Array
    kept: npt.NDArray[np.uint32]


@dataclass(frozen=True)
class Snapshot:
    """What a World is made of; `options` are what it was made with, apart from scene and time step."""

    options: Mapping[str, Any]
    bodies: tuple[Body, ...]
    fixed: tuple[Body, ...]
    steps: int
    unsolved: int
    time_step: float
    last_time_step: float
    clock: tuple[float, int]
    gravity: Array
    forces: Array
    positions: Array
    orientations: Array
    velocities: Array
    contacts: ContactArrays | None

    def to_bytes(self) -> bytes:
        """Return the bytes of an `.npz` file.

        Raises
        ------
        SettingsError
            When an option of the world cannot be written down.
        """
        everybody = self.bodies + self.fixed
        shapes, shape_of = _distinct([body.shape for body in everybody])
        materials, material_of = _distinct([body.material for body in everybody])
        text = {
            "format": FORMAT,
            "version": VERSION,
            "options": dict(self.options),
            "steps": self.steps,
            "unsolved": self.unsolved,
            "clock": self.clock,
            "names": [body.name for body in everybody],
            "shapes": [None if shape is None else _written(shape) for shape in shapes],
            "materials": [asdict(material) for material in materials],
        }
        contacts = {} if self.contacts is None else {f"contact_{k}": v for k, v in vars(self.contacts).items()}
        file = io.BytesIO()
        np.savez(
            file,
            world=np.array(json.dumps(text, default=_as_python)),
            time_steps=np.array([self.time_step, self.last_time_step]),
            body_masses=np.array([body.mass for body in everybody], dtype=np.float64),
            body_inertias=np.array([body.inertia for body in everybody], dtype=np.float64).reshape(-1, 3, 3),
            body_vectors=np.hstack([table(everybody, name, width=width) for name, width in _VECTORS.items()]),
            body_shapes=np.array(shape_of, dtype=np.int64),
            body_materials=np.array(material_of, dtype=np.int64),
            gravity=self.gravity,
            forces=self.forces,
            positions=self.positions,
            orientations=self.orientations,
            velocities=self.velocities,
            **contacts,
        )
        return file.getvalue()

    @classmethod
    def read(cls, source: bytes | str | PathLike[str]) -> Snapshot:
        """Return the snapshot in these bytes, or in the file of this name.

        Raises
        ------
        ProblemError
            When they are no snapshot, damaged, or of another version.
        """
        data = source if isinstance(source, bytes) else Path(source).read_bytes()
        try:
            with zipfile.ZipFile(io.BytesIO(data)) as archive:
                arrays = {
                    name.removesuffix(".npy"): np.load(io.BytesIO(archive.read(name))) for name in archive.namelist()
                }
            text = json.loads(str(arrays["world"]))
        except (ValueError, OSError, EOFError, KeyError, zipfile.BadZipFile) as error:
            raise ProblemError(f"{len(data)} bytes are no snapshot of a World, or a damaged one: {error}") from error
        if text.get("format") != FORMAT or text.get("version") != VERSION:
            raise ProblemError(
                f"the snapshot is of format {text.get('format')!r}, version {text.get('version')!r}: "
                f"{FORMAT!r}, version {VERSION} is needed"
            )
        return _Reader(arrays, text).snapshot()


class _Reader:
    """Arrays of a snapshot, checked as they are taken out."""

    def __init__(self, arrays: Mapping[str, npt.NDArray[Any]], text: Mapping[str, Any]) -> None:
        self._arrays, self._text = arrays, text

    def snapshot(self) -> Snapshot:
        time_step, last_time_step = self._numbers("time_steps", 2).tolist()
        if time_step <= 0 or last_time_step <= 0:
            raise ProblemError(
                f"time_steps of the snapshot are {time_step:g}, {last_time_step:g}: both must be positive"
            )
        positions = self._numbers("positions", None, 3)
        n = len(positions)
        everybody = self._everybody(n)
        since, steps = self._word("clock")
        return Snapshot(
            options=self._word("options"),
            bodies=everybody[:n],
            fixed=everybody[n:],
            steps=self._word("steps"),
            unsolved=self._word("unsolved"),
            time_step=time_step,
            last_time_step=last_time_step,
            clock=(since, steps),
            gravity=self._numbers("gravity", 3),
            forces=self._numbers("forces", n, 6),
            positions=positions,
            orientations=self._numbers("orientations", n, 4),
            velocities=self._numbers("velocities", n, 6),
            contacts=self._contacts(),
        )

    def _everybody(self, moving: int) -> tuple[Body, ...]:
        names = self._word("names")
        n = len(names)
        if n < moving:
            raise ProblemError(f"the snapshot names {n} bodies, but {moving} move")
        masses = self._array("body_masses", np.float64, n)
        if not (masses > 0).all() or not np.isfinite(masses[:moving]).all():
            raise ProblemError("body_masses of the snapshot: those of moving bodies must be positive and finite")
        inertias = self._numbers("body_inertias", n, 3, 3)
        vectors = self._numbers("body_vectors", n, sum(_VECTORS.values()))
        ends = np.cumsum(list(_VECTORS.values()))[:-1]
        split = dict(zip(_VECTORS, np.split(vectors, ends, axis=1), strict=True))
        shapes = [None if shape is None else _read_shape(shape) for shape in self._word("shapes")]
        materials = [Material(**material) for material in self._word("materials")]
        shape_of = self._places("body_shapes", n, len(shapes))
        material_of = self._places("body_materials", n, len(materials))
        return tuple(
            Body(
                index=k if k < moving else -1,
                name=names[k],
                shape=shapes[shape_of[k]],
                material=materials[material_of[k]],
                mass=float(masses[k]),
                inertia=freeze(inertias[k].copy()),
                **{name: freeze(rows[k].copy()) for name, rows in split.items()},
            )
            for k in range(n)
        )

    def _contacts(self) -> ContactArrays | None:
        if "contact_gaps" not in self._arrays:
            return None
        gaps = self._numbers("contact_gaps", None)
        n = len(gaps)
        impulse = self._numbers("contact_impulse", n, None)
        if impulse.shape[1] not in (1, 3):
            raise ProblemError(f"contact_impulse of the snapshot has shape {impulse.shape}: it has 1 or 3 columns")
        return ContactArrays(
            pairs=self._array("contact_pairs", np.uint32, n, 2),
            features=self._array("contact_features", np.uint32, n, 2),
            points=self._numbers("contact_points", n, 3),
            frames=self._numbers("contact_frames", n, 3, 3),
            gaps=gaps,
            impulse=impulse,
            start=self._numbers("contact_start", n, 3),
            kept=self._array("contact_kept", np.uint32, n),
        )

    def _word(self, name: str) -> Any:
        if name not in self._text:
            raise ProblemError(f"the snapshot lacks {name!r}")
        return self._text[name]

    def _array(self, name: str, dtype: type[np.generic], *shape: int | None) -> npt.NDArray[Any]:
        if name not in self._arrays:
            raise ProblemError(f"the snapshot lacks the array {name!r}")
        array = self._arrays[name]
        fits = len(array.shape) == len(shape) and all(
            want in (None, have) for have, want in zip(array.shape, shape, strict=True)
        )
        if array.dtype != dtype or not fits:
            wanted = ", ".join("n" if want is None else str(want) for want in shape)
            raise ProblemError(
                f"{name} of the snapshot is {array.dtype} of shape {array.shape}: "
                f"{np.dtype(dtype)} of shape ({wanted}) is needed"
            )
        return array

    def _numbers(self, name: str, *shape: int | None) -> Array:
        array = self._array(name, np.float64, *shape)
        require_finite(f"{name} of the snapshot", array)
        return array

    def _places(self, name: str, n: int, count: int) -> list[int]:
        places = self._array(name, np.int64, n)
        if n and not (0 <= places.min() and places.max() < count):
            raise ProblemError(f"{name} of the snapshot: every entry must be from 0 to {count - 1}")
        return [int(place) for place in places]


def _distinct(things: list[Any]) -> tuple[list[Any], list[int]]:
    """Return each different object once, and for every one its place among them."""
    places: dict[int, int] = {}
    distinct: list[Any] = []
    for thing in things:
        if id(thing) not in places:
            places[id(thing)] = len(distinct)
            distinct.append(thing)
    return distinct, [places[id(thing)] for thing in things]


def _written(shape: Shape) -> dict[str, Any]:
    values = {field.name: getattr(shape, field.name) for field in fields(shape)}  # type: ignore[arg-type]
    return {"kind": shape.kind, **values}


def _read_shape(values: Mapping[str, Any]) -> Shape:
    """Make the shape as a user would, which checks it, and give it the very numbers that it had."""
    values = dict(values)
    kind = values.pop("kind", None)
    if kind not in _SHAPES:
        raise ProblemError(f"a shape of the snapshot is of kind {kind!r}: it must be one of {', '.join(_SHAPES)}")
    made = _SHAPES[kind]
    known = {field.name: field for field in fields(made)}  # type: ignore[arg-type]
    if values.keys() != known.keys():
        raise ProblemError(f"a {kind} of the snapshot has {', '.join(values)}: {', '.join(known)} are needed")
    shape = made(**{name: value for name, value in values.items() if known[name].init})
    for name, value in values.items():
        like = getattr(shape, name)
        exact = freeze(np.array(value, dtype=np.float64)) if isinstance(like, np.ndarray) else type(like)(value)
        object.__setattr__(shape, name, exact)
    return shape


def _as_python(value: Any) -> Any:
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    raise SettingsError(f"a snapshot cannot hold the setting {value!r}: numbers, texts and lists of them are needed")

"""Scenes: bodies with shapes and materials, gravity and forces, as they are before the first step."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from formulations.checks import Array, as_array, freeze
from gpx_lcp.errors import ProblemError
from gpx_lcp.materials import Material
from gpx_lcp.shapes import HalfSpace, Shape

GRAVITY: Final = (0.0, 0.0, -9.81)
# How far from 1 the length of a given quaternion may be; it is brought to 1 exactly.
UNIT_TOLERANCE: Final = 1e-6


@dataclass(frozen=True, eq=False)
class Body:
    """One body of a scene, as it was added.

    A moving body stands for its index: `world.positions[body]` is its position.

    Attributes
    ----------
    index : int
        Of a moving body, its row in the arrays of a World; -1 for a body that never moves.
    name : str
    shape : Shape or None
        None collides with nothing.
    material : Material
    mass : float, kg
        Infinite for a body that never moves.
    inertia : (3, 3) array, kg m²
        In the body's frame, about its centre of mass; zero for a body that does not rotate.
    position : (3,) array, m
        Of the centre of mass, world frame.
    orientation : (4,) array
        Unit quaternion w, x, y, z, from the body's frame to the world's.
    velocity : (3,) array, m/s
    angular_velocity : (3,) array, rad/s
        World frame.
    force : (3,) array, N
        Acts at the centre of mass in every step, world frame.
    torque : (3,) array, N m
    """

    index: int
    name: str
    shape: Shape | None
    material: Material
    mass: float
    inertia: Array
    position: Array
    orientation: Array
    velocity: Array
    angular_velocity: Array
    force: Array
    torque: Array

    def __index__(self) -> int:
        if self.index < 0:
            raise TypeError(f"{self.name} never moves: it has no row in the arrays of a World")
        return self.index

    def __repr__(self) -> str:
        return f"Body({self.name!r}, {self.shape!r}, {'fixed' if self.index < 0 else f'{self.mass:g} kg'})"


class Scene:
    """Bodies and the field of gravity that they are in.

    Parameters
    ----------
    gravity : (3,) array, m/s²
        World frame.

    Examples
    --------
    >>> scene = Scene()
    >>> ground = scene.add_static(HalfSpace(), material=Material(friction=0.8))
    >>> ball = scene.add_rigid(Sphere(0.5), mass=1.0, position=(0, 0, 0.5), velocity=(4, 0, 0))
    >>> World(scene, time_step=1 / 240).positions[ball]
    array([0. , 0. , 0.5])
    """

    def __init__(self, gravity: npt.ArrayLike = GRAVITY) -> None:
        self.gravity: Array = freeze(as_array("gravity", gravity, (3,)))
        self._bodies: list[Body] = []
        self._fixed: list[Body] = []

    @property
    def bodies(self) -> tuple[Body, ...]:
        """Those that move, in the order they were added: the order of a World's arrays."""
        return tuple(self._bodies)

    @property
    def fixed(self) -> tuple[Body, ...]:
        """Those that never move."""
        return tuple(self._fixed)

    def add_rigid(
        self,
        shape: Shape | None,
        mass: float,
        *,
        position: npt.ArrayLike = (0.0, 0.0, 0.0),
        orientation: npt.ArrayLike = (1.0, 0.0, 0.0, 0.0),
        velocity: npt.ArrayLike = (0.0, 0.0, 0.0),
        angular_velocity: npt.ArrayLike = (0.0, 0.0, 0.0),
        material: Material | None = None,
        inertia: npt.ArrayLike | None = None,
        force: npt.ArrayLike = (0.0, 0.0, 0.0),
        torque: npt.ArrayLike = (0.0, 0.0, 0.0),
        name: str | None = None,
    ) -> Body:
        """Add a body that moves and rotates.

        Parameters
        ----------
        shape : Shape or None
            None collides with nothing and needs an inertia.
        mass : float, kg
            Positive.
        position, orientation, velocity, angular_velocity, material, force, torque
            As in `Body`; the material is `Material()` unless given.
        inertia : (3, 3) or (3,) array, kg m², optional
            The tensor about the centre of mass in the body's frame, or its diagonal; symmetric and positive definite.
            Unless given, that of the shape at uniform density.
        name : str, optional
            For messages; "body 3" unless given.

        Raises
        ------
        ProblemError
            When a value is not what is needed; the message names body and value.
        """
        name = name or f"body {len(self._bodies)}"
        mass = _positive(f"mass of {name}", mass)
        if isinstance(shape, HalfSpace):
            raise ProblemError(f"{name} is a HalfSpace, which cannot move: use add_static")
        if inertia is not None:
            tensor = _checked_inertia(name, inertia)
        elif shape is None:
            raise ProblemError(f"{name} has no shape to take its inertia from: give inertia, or use add_point_mass")
        else:
            tensor = _checked_shape(name, shape).inertia(mass)
        return self._add_moving(
            name, shape, mass, tensor, position, orientation, velocity, angular_velocity, material, force, torque
        )

    def add_point_mass(
        self,
        mass: float,
        *,
        position: npt.ArrayLike = (0.0, 0.0, 0.0),
        velocity: npt.ArrayLike = (0.0, 0.0, 0.0),
        shape: Shape | None = None,
        orientation: npt.ArrayLike = (1.0, 0.0, 0.0, 0.0),
        material: Material | None = None,
        force: npt.ArrayLike = (0.0, 0.0, 0.0),
        name: str | None = None,
    ) -> Body:
        """Add a material object in translational motion: it moves and never rotates.

        It collides with nothing unless it has a shape, which says how near others come and keeps its orientation.

        Raises
        ------
        ProblemError
            As `add_rigid`.
        """
        name = name or f"body {len(self._bodies)}"
        mass = _positive(f"mass of {name}", mass)
        if isinstance(shape, HalfSpace):
            raise ProblemError(f"{name} is a HalfSpace, which cannot move: use add_static")
        rest = (0.0, 0.0, 0.0)
        return self._add_moving(
            name, shape, mass, np.zeros((3, 3)), position, orientation, velocity, rest, material, force, rest
        )

    def add_static(
        self,
        shape: Shape,
        *,
        position: npt.ArrayLike = (0.0, 0.0, 0.0),
        orientation: npt.ArrayLike = (1.0, 0.0, 0.0, 0.0),
        material: Material | None = None,
        name: str | None = None,
    ) -> Body:
        """Add a body that never moves.

        Raises
        ------
        ProblemError
            As `add_rigid`.
        """
        name = name or f"fixed body {len(self._fixed)}"
        zero = freeze(np.zeros(3))
        body = Body(
            index=-1,
            name=name,
            shape=_checked_shape(name, shape),
            material=_checked_material(name, material),
            mass=np.inf,
            inertia=freeze(np.zeros((3, 3))),
            position=freeze(as_array(f"position of {name}", position, (3,))),
            orientation=checked_orientation(name, orientation),
            velocity=zero,
            angular_velocity=zero,
            force=zero,
            torque=zero,
        )
        self._fixed.append(body)
        return body

    def _add_moving(
        self,
        name: str,
        shape: Shape | None,
        mass: float,
        inertia: Array,
        position: npt.ArrayLike,
        orientation: npt.ArrayLike,
        velocity: npt.ArrayLike,
        angular_velocity: npt.ArrayLike,
        material: Material | None,
        force: npt.ArrayLike,
        torque: npt.ArrayLike,
    ) -> Body:
        body = Body(
            index=len(self._bodies),
            name=name,
            shape=None if shape is None else _checked_shape(name, shape),
            material=_checked_material(name, material),
            mass=mass,
            inertia=freeze(inertia),
            position=freeze(as_array(f"position of {name}", position, (3,))),
            orientation=checked_orientation(name, orientation),
            velocity=freeze(as_array(f"velocity of {name}", velocity, (3,))),
            angular_velocity=freeze(as_array(f"angular_velocity of {name}", angular_velocity, (3,))),
            force=freeze(as_array(f"force of {name}", force, (3,))),
            torque=freeze(as_array(f"torque of {name}", torque, (3,))),
        )
        self._bodies.append(body)
        return body

    def __repr__(self) -> str:
        return f"Scene({len(self._bodies)} moving bodies, {len(self._fixed)} fixed)"


def _positive(name: str, value: float) -> float:
    number = float(as_array(name, value, ()))
    if number <= 0:
        raise ProblemError(f"{name} is {number:g}: it must be positive")
    return number


def _checked_shape(name: str, shape: object) -> Shape:
    if not isinstance(shape, Shape):
        raise ProblemError(f"shape of {name} is a {type(shape).__name__}: a shape such as Box(1, 1, 1) is needed")
    return shape


def _checked_material(name: str, material: object) -> Material:
    if material is None:
        return Material()
    if not isinstance(material, Material):
        raise ProblemError(f"material of {name} is a {type(material).__name__}: a Material is needed")
    return material


def checked_orientation(name: str, value: npt.ArrayLike) -> Array:
    """Return the unit quaternion of the body of this name, of length 1 to rounding."""
    orientation = as_array(f"orientation of {name}", value, (4,))
    length = float(np.linalg.norm(orientation))
    if abs(length - 1.0) > UNIT_TOLERANCE:
        raise ProblemError(
            f"orientation of {name} has length {length:g}: it must be a unit quaternion in the order w, x, y, z"
        )
    return freeze(orientation / length)


def _checked_inertia(name: str, value: npt.ArrayLike) -> Array:
    diagonal = np.ndim(value) == 1
    inertia = as_array(f"inertia of {name}", value, (3,) if diagonal else (3, 3))
    if diagonal:
        inertia = np.diag(inertia)
    if np.abs(inertia - inertia.T).max() > 1e-9 * np.abs(inertia).max():
        raise ProblemError(f"inertia of {name} is not symmetric")
    inertia = 0.5 * (inertia + inertia.T)
    lowest, middle, highest = np.linalg.eigvalsh(inertia)
    if lowest <= 1e-12 * highest:
        raise ProblemError(f"inertia of {name} has the principal value {lowest:g}: all three must be positive")
    if highest > (lowest + middle) * (1 + 1e-6):
        raise ProblemError(
            f"inertia of {name} has the principal values {lowest:g}, {middle:g}, {highest:g}: no body has one that is "
            "larger than the sum of the two others"
        )
    return inertia

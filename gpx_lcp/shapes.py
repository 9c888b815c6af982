"""The shapes of bodies. Each stands in the frame of its body, whose origin is the shape's centre of mass.

A shape knows its numbers, checks them, and gives the inertia of a solid of uniform density.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt
from scipy.spatial import ConvexHull as QuickHull
from scipy.spatial import QhullError

from formulations.checks import Array, as_array, freeze
from gpx_lcp.errors import ProblemError


class Shape(ABC):
    """What a body collides with."""

    kind: ClassVar[str]

    @abstractmethod
    def numbers(self) -> Sequence[float] | Array:
        """Return the numbers that describe the shape to the core."""

    @abstractmethod
    def inertia(self, mass: float) -> Array:
        """Return the inertia tensor about the centre of mass at uniform density, (3, 3), kg m²."""

    def _check_lengths(self, **lengths: float) -> None:
        for name, value in lengths.items():
            number = float(as_array(f"{name} of a {type(self).__name__}", value, ()))
            if number <= 0:
                raise ProblemError(f"{name} of a {type(self).__name__} is {number:g}: it must be positive")
            object.__setattr__(self, name, number)


@dataclass(frozen=True)
class Sphere(Shape):
    """A ball of `radius`, m."""

    radius: float
    kind: ClassVar[str] = "sphere"

    def __post_init__(self) -> None:
        self._check_lengths(radius=self.radius)

    def numbers(self) -> Sequence[float]:
        """Return the radius."""
        return (self.radius,)

    def inertia(self, mass: float) -> Array:
        """Return 2/5 m r² on the diagonal."""
        return 0.4 * mass * self.radius**2 * np.eye(3)


@dataclass(frozen=True)
class Box(Shape):
    """A block with sides of length `x`, `y` and `z`, m."""

    x: float
    y: float
    z: float
    kind: ClassVar[str] = "box"

    def __post_init__(self) -> None:
        self._check_lengths(x=self.x, y=self.y, z=self.z)

    def numbers(self) -> Sequence[float]:
        """Return half the sides."""
        return (0.5 * self.x, 0.5 * self.y, 0.5 * self.z)

    def inertia(self, mass: float) -> Array:
        """Return m/12 (y² + z², z² + x², x² + y²) on the diagonal."""
        x2, y2, z2 = self.x**2, self.y**2, self.z**2
        return np.diag([y2 + z2, z2 + x2, x2 + y2]) * (mass / 12)


@dataclass(frozen=True)
class Capsule(Shape):
    """A cylinder along z of `radius` and `length` with a half-ball at either end: length + 2 radius long in all, m."""

    radius: float
    length: float
    kind: ClassVar[str] = "capsule"

    def __post_init__(self) -> None:
        self._check_lengths(radius=self.radius, length=self.length)

    def numbers(self) -> Sequence[float]:
        """Return the radius and half the length."""
        return (self.radius, 0.5 * self.length)

    def inertia(self, mass: float) -> Array:
        """Return the sum of the cylinder's and of the half-balls' inertia, each about the common centre."""
        r, length = self.radius, self.length
        cylinder = length / (length + 4 * r / 3) * mass
        ball = mass - cylinder
        axial = cylinder * r**2 / 2 + ball * 0.4 * r**2
        # A half-ball's own centre is 3/8 r from its flat side.
        across = cylinder * (r**2 / 4 + length**2 / 12) + ball * (0.4 * r**2 + length**2 / 4 + 0.375 * r * length)
        return np.diag([across, across, axial])


@dataclass(frozen=True)
class Cylinder(Shape):
    """A cylinder along z of `radius` and `length`, m.

    It touches flat surfaces with eight points of the rim, or with the two ends of a line along its side.
    """

    radius: float
    length: float
    kind: ClassVar[str] = "cylinder"

    def __post_init__(self) -> None:
        self._check_lengths(radius=self.radius, length=self.length)

    def numbers(self) -> Sequence[float]:
        """Return the radius and half the length."""
        return (self.radius, 0.5 * self.length)

    def inertia(self, mass: float) -> Array:
        """Return m (r²/4 + l²/12) across the axis and m r²/2 about it."""
        across = mass * (self.radius**2 / 4 + self.length**2 / 12)
        return np.diag([across, across, mass * self.radius**2 / 2])


@dataclass(frozen=True)
class HalfSpace(Shape):
    """Everything below a plane: the plane goes through the body's position, `normal` points out of the solid.

    Only for bodies that never move. The normal is in the body's frame and brought to length 1.
    """

    normal: Sequence[float] = (0.0, 0.0, 1.0)
    kind: ClassVar[str] = "half_space"

    def __post_init__(self) -> None:
        normal = as_array("normal of a HalfSpace", self.normal, (3,))
        length = float(np.linalg.norm(normal))
        if length == 0:
            raise ProblemError("normal of a HalfSpace is zero: it must point out of the solid")
        object.__setattr__(self, "normal", tuple(float(n) for n in normal / length))

    def numbers(self) -> Sequence[float]:
        """Return the normal."""
        return self.normal

    def inertia(self, mass: float) -> Array:
        """Refuse: it has no bounds."""
        raise ProblemError("a HalfSpace cannot move: use it with add_static")


@dataclass(frozen=True, eq=False)
class ConvexHull(Shape):
    """The convex hull of points.

    The points are moved so that the hull's centre of mass (uniform density) is the origin of the body's frame:
    `centroid` is what was subtracted, so that a body at position = centroid has its corners where they were given.

    Parameters
    ----------
    points : (n, 3) array, m
        At least four, not all in one plane.

    Attributes
    ----------
    points : (m, 3) array, m
        The corners of the hull, about its centre of mass.
    centroid : (3,) array, m
    volume : float, m³

    Raises
    ------
    ProblemError
        When the points are not finite or span no volume.
    """

    points: npt.ArrayLike
    centroid: Array = field(init=False)
    volume: float = field(init=False)
    kind: ClassVar[str] = "hull"

    def __post_init__(self) -> None:
        points = as_array("points of a ConvexHull", self.points, (None, 3))
        try:
            # Scaled to unit size, because Qhull's tolerances are meant for it.
            size = float(np.ptp(points, axis=0).max(initial=0.0)) or 1.0
            hull = QuickHull((points - points.mean(axis=0)) / size)
        except (QhullError, ValueError) as error:
            raise ProblemError(
                f"the {len(points)} points of a ConvexHull span no volume: four that are not in one plane are needed"
            ) from error
        corners = points[np.sort(hull.vertices)]
        unit, volume, first, _ = _moments(points, hull.simplices)
        centroid = np.array([entry / (4 * volume * unit) for entry in first])
        self._set(points=freeze(corners - centroid), centroid=freeze(centroid), volume=volume / (6 * unit**3))

    def _set(self, **values: Any) -> None:
        for name, value in values.items():
            object.__setattr__(self, name, value)

    def numbers(self) -> Array:
        """Return the corners, one after the other."""
        return np.asarray(self.points, dtype=np.float64).ravel()

    def inertia(self, mass: float) -> Array:
        """Return the sum over the tetrahedra between the surface and the centre of mass."""
        points = np.asarray(self.points, dtype=np.float64)
        size = float(np.ptp(points, axis=0).max())
        unit, volume, _, second = _moments(points, QuickHull(points / size).simplices)
        moments = mass * np.array([[entry / (20 * volume * unit**2) for entry in row] for row in second])
        return np.asarray(np.trace(moments) * np.eye(3) - moments)


def _moments(points: Array, triangles: npt.NDArray[np.int32]) -> tuple[int, int, list[int], list[list[int]]]:
    """Return a unit u and, as whole numbers, u³ 6 V, u⁴ 24 ∫ x dV and u⁵ 120 ∫ x xᵀ dV of the solid between triangles.

    A tetrahedron with corners 0, a, b, c has, with 6 V = det (a, b, c) and s = a + b + c,
    24 ∫ x dV = 6 V s and 120 ∫ x xᵀ dV = 6 V (s sᵀ + a aᵀ + b bᵀ + c cᵀ).

    Nothing is rounded: rounded sums depend on how faces are cut into triangles, and put the centre and the axes of what
    is its own mirror image a last bit beside the plane of symmetry. What is built of that leaves the plane.
    """
    ratios = [[entry.as_integer_ratio() for entry in point] for point in points.tolist()]
    # Denominators of floats are powers of two: the largest is a multiple of all.
    unit = max(below for point in ratios for _, below in point)
    whole = np.array([[above * (unit // below) for above, below in point] for point in ratios], dtype=object)
    # Qhull lists triangles either way round; seen from inside all are to run the same way.
    inside = (points - points.mean(axis=0)) / np.ptp(points, axis=0).max()
    signs = np.sign(np.linalg.det(inside[triangles])).astype(int).astype(object)
    a, b, c = whole[triangles].transpose(1, 2, 0)
    volumes = signs * (a * np.cross(b, c, axis=0)).sum(axis=0)
    s = a + b + c
    second = sum((volumes * x) @ x.T for x in (s, a, b, c))
    return unit, volumes.sum(), (s @ volumes).tolist(), np.asarray(second).tolist()

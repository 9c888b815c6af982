"""The moving bodies of a scene as arrays: what the measures must know of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

import gpx_lcp as gpx
from benchmarks.interface import Array, Motion


@dataclass(frozen=True)
class Bodies:
    """Masses, inertias and starting motion of the moving bodies, in the order of the scene.

    Parameters
    ----------
    mass : (bodies,) array, kg
    inertia : (bodies, 3, 3) array, kg m²
        Body frame; zero where a body does not rotate.
    start : Motion
    gravity : (3,) array, m/s²
    """

    mass: Array
    inertia: Array
    start: Motion
    gravity: Array

    @classmethod
    def from_scene(cls, scene: gpx.Scene) -> Bodies:
        """Read a scene.

        Raises
        ------
        ProblemError
            When nothing moves, or a body has a force or a torque of its own: the measures know gravity alone.
        """
        if not scene.bodies:
            raise gpx.ProblemError("the scene has no moving body: there is nothing to compare")
        for body in scene.bodies:
            if body.force.any() or body.torque.any():
                raise gpx.ProblemError(f"{body.name} has a force or a torque of its own: only gravity is compared")
        motion = [np.concatenate((body.velocity, body.angular_velocity)) for body in scene.bodies]
        return cls(
            mass=np.array([body.mass for body in scene.bodies]),
            inertia=np.array([body.inertia for body in scene.bodies]),
            start=Motion(
                position=np.array([body.position for body in scene.bodies]),
                orientation=np.array([body.orientation for body in scene.bodies]),
                velocity=np.array(motion),
            ),
            gravity=scene.gravity,
        )

    @property
    def count(self) -> int:
        """How many bodies move."""
        return self.mass.size

    def inverse_mass(self, orientation: Array) -> Array:
        """Return the blocks diag(1/m, R I⁻¹ Rᵀ) for the given orientations, (bodies, 6, 6)."""
        rotation = rotation_matrices(orientation)
        # The pseudoinverse keeps a body that does not rotate from rotating.
        inverse = np.linalg.pinv(self.inertia, hermitian=True)
        blocks = np.zeros((self.count, 6, 6))
        blocks[:, :3, :3] = np.eye(3) / self.mass[:, None, None]
        blocks[:, 3:, 3:] = rotation @ inverse @ rotation.transpose(0, 2, 1)
        return blocks


def rotation_matrices(orientation: Array) -> Array:
    """Return the rotation matrices (n, 3, 3) of unit quaternions w, x, y, z, (n, 4)."""
    w, x, y, z = orientation.T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), 2, 0)

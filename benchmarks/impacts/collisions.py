"""Collisions given by their numbers: what has no scene, and the random ones."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

import gpx_lcp as gpx
from benchmarks.measures import Array, contact_frames


@dataclass(frozen=True)
class Momenta:
    """The momenta of free bodies: linear and angular about the origin, and the sums of their sizes.

    Attributes
    ----------
    total : (6,) array, N s and N m s
    size : (2,) array
        Σ ‖m v‖ and Σ ‖x × m v + I ω‖: what a change of the total is measured against.
    """

    total: Array
    size: Array

    def changed_from(self, before: Momenta) -> float:
        """Return the largest of the changes of linear and of angular momentum, relative to their sizes before."""
        change = (self.total - before.total).reshape(2, 3)
        return float((np.linalg.norm(change, axis=1) / before.size).max())


@dataclass(frozen=True)
class FreeBodies:
    """Bodies in space that touch in points: a collision with everything to judge its outcome by.

    Attributes
    ----------
    system : StackedSystem
        Six velocities a body.
    elasticity, tangential_elasticity : (n,) arrays
    position : (bodies, 3) array, m
    mass : (bodies,) array, kg
    inertia : (bodies, 3, 3) array, kg m²
    """

    system: gpx.StackedSystem
    elasticity: Array
    tangential_elasticity: Array
    position: Array
    mass: Array
    inertia: Array

    def impact(self, law: str) -> gpx.Impact:
        """Let the bodies collide."""
        return gpx.impact(
            self.system, law, elasticity=self.elasticity, tangential_elasticity=self.tangential_elasticity
        )

    def energy(self, velocities: Array) -> float:
        """Return the kinetic energy, J."""
        v = velocities.reshape(-1, 6)
        spin = np.einsum("bi,bij,bj->", v[:, 3:], self.inertia, v[:, 3:])
        return 0.5 * float(self.mass @ (v[:, :3] ** 2).sum(axis=1) + spin)

    def momenta(self, velocities: Array) -> Momenta:
        """Return the momenta of all bodies together."""
        v = velocities.reshape(-1, 6)
        linear = self.mass[:, None] * v[:, :3]
        angular = np.cross(self.position, linear) + np.einsum("bij,bj->bi", self.inertia, v[:, 3:])
        size = np.array([np.linalg.norm(linear, axis=1).sum(), np.linalg.norm(angular, axis=1).sum()])
        return Momenta(np.concatenate((linear.sum(axis=0), angular.sum(axis=0))), size)

    def moving_with(self, velocity: Array) -> FreeBodies:
        """Return the same collision with a velocity, (3,), added to every body."""
        assert self.system.free_velocity is not None and self.system.jacobian is not None
        v = self.system.free_velocity.reshape(-1, 6).copy()
        v[:, :3] += velocity
        system = gpx.StackedSystem.from_jacobian(
            self.system.jacobian,
            self.system.inverse_mass,
            -(self.system.jacobian @ v.ravel()),
            self.system.friction,
            free_velocity=v.ravel(),
        )
        return FreeBodies(system, self.elasticity, self.tangential_elasticity, self.position, self.mass, self.inertia)


def random_bodies(seed: int, *, friction: bool = True, reversal: bool = True) -> FreeBodies:
    """Return 2 to 6 bodies of random masses, inertias and velocities that touch in 1 to 8 points, all at once.

    A contact joins two bodies at a point between their centres, up to 0.3 m beside the line, with a normal up to some
    30° off it. Elasticity is random in 1 to 2 for each contact, friction in 0 to 1, tangential elasticity 1 in half of
    the cases and random in 1 to 2 in the others.
    """
    rng = np.random.default_rng(seed)
    bodies, n = int(rng.integers(2, 7)), int(rng.integers(1, 9))
    position = rng.normal(size=(bodies, 3))
    mass = np.exp(rng.uniform(-1.5, 1.5, bodies))
    turn = np.linalg.qr(rng.normal(size=(bodies, 3, 3)))[0]
    # Two principal values between 1 and 1.8 and one of 1 are the moments of some body: none exceeds the others' sum.
    principal = 0.1 * mass[:, None] * np.column_stack((np.ones(bodies), rng.uniform(1.0, 1.8, (bodies, 2))))
    inertia = np.einsum("bij,bj,bkj->bik", turn, principal, turn)
    velocity = rng.normal(size=(bodies, 6))
    pairs = np.array([rng.choice(bodies, 2, replace=False) for _ in range(n)])
    first, second = position[pairs[:, 0]], position[pairs[:, 1]]
    along = (second - first) / np.linalg.norm(second - first, axis=1, keepdims=True)
    point = 0.5 * (first + second) + rng.uniform(-0.17, 0.17, (n, 3))
    normal = along + rng.uniform(-0.35, 0.35, (n, 3))
    frames = contact_frames(normal / np.linalg.norm(normal, axis=1, keepdims=True))
    jacobian = np.zeros((n, 3, bodies, 6))
    for side, sign in ((0, -1.0), (1, 1.0)):
        body = pairs[:, side]
        arm = point - position[body]
        blocks = sign * np.concatenate((frames, np.cross(arm[:, None, :], frames)), axis=2)
        jacobian[np.arange(n), :, body] = blocks
    inverse = np.zeros((bodies, 6, 6))
    inverse[:, :3, :3] = np.eye(3) / mass[:, None, None]
    inverse[:, 3:, 3:] = np.linalg.inv(inertia)
    inverse = 0.5 * (inverse + inverse.transpose(0, 2, 1))
    flat = jacobian.reshape(3 * n, 6 * bodies)
    mu = rng.uniform(0.0, 1.0, n) if friction else np.zeros(n)
    system = gpx.StackedSystem.from_jacobian(
        flat, inverse, -flat @ velocity.ravel(), mu, free_velocity=velocity.ravel()
    )
    elasticity = rng.uniform(1.0, 2.0, n)
    tangential = rng.uniform(1.0, 2.0, n) if reversal and seed % 2 else np.ones(n)
    return FreeBodies(system, elasticity, tangential, position, mass, inertia)


@dataclass(frozen=True)
class DoublePendulum:
    """Kane's double pendulum, whose end strikes a rough floor.

    Two uniform rods of 1 kg and 1 m hang one from the other, the first from a fixed pivot, at 20° and 30° to the
    vertical, and turn with -0.1 and -0.2 rad/s. In these two coordinates the system has a 2 × 2 mass matrix and one
    contact in the plane.

    Source: T. R. Kane, D. A. Levinson, *Dynamics: Theory and Applications* (1985), after Kane's note of 1984: Newton's
    law of restitution with friction gains energy. Ch. Glocker, Multibody System Dynamics 32 (2014).
    """

    mass: Array
    system: gpx.StackedSystem

    @classmethod
    def striking(cls, friction: float = 0.5) -> DoublePendulum:
        """Return it at the instant before the impact."""
        first, second = np.radians((20.0, 30.0))
        coupling = 0.5 * np.cos(second - first)
        mass = np.array([[4.0 / 3.0, coupling], [coupling, 1.0 / 3.0]])
        # The end is at (sin, -cos) summed over both rods: its upward and its sideward velocity.
        jacobian = np.array([[np.sin(first), np.sin(second)], [np.cos(first), np.cos(second)]])
        spin = np.array([-0.1, -0.2])
        inverse = np.linalg.inv(mass)
        system = gpx.StackedSystem.from_jacobian(
            jacobian, 0.5 * (inverse + inverse.T), -jacobian @ spin, [friction], free_velocity=spin
        )
        return cls(mass, system)

    def energy(self, spin: Array) -> float:
        """Return the kinetic energy, J."""
        return 0.5 * float(spin @ self.mass @ spin)


def random_linkage(seed: int) -> tuple[gpx.StackedSystem, Array, Array]:
    """Return a random linkage that strikes in 2 to 4 rough points at once, with their elasticities.

    It has 2 to 4 coordinates with a unit mass matrix, and J of normal numbers: a linkage of bodies on joints has such
    systems, in which every contact moves every other. All contacts close.
    """
    rng = np.random.default_rng(seed)
    n, coordinates = int(rng.integers(2, 5)), int(rng.integers(2, 5))
    jacobian = rng.normal(size=(n, 2, coordinates))
    velocity = rng.normal(size=coordinates)
    jacobian *= np.where(jacobian[:, 0] @ velocity > 0.0, -1.0, 1.0)[:, None, None]
    flat = jacobian.reshape(2 * n, coordinates)
    system = gpx.StackedSystem.from_jacobian(
        flat, np.ones(coordinates), -flat @ velocity, rng.uniform(0.0, 1.0, n), free_velocity=velocity
    )
    return system, rng.uniform(1.0, 2.0, n), rng.uniform(1.0, 2.0, n)

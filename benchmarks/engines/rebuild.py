"""What the adapters share: which scenes other engines can rebuild without changing the problem."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

import gpx_lcp as gpx
from benchmarks.bodies import rotation_matrices
from benchmarks.interface import Array

# Half the side of the box that stands in for a plane, m: wide enough that no scene falls off, and not so wide that the
# box-box test loses digits. Its half height is 1 m.
GROUND_HALF_SIDE = 50.0


def one_friction(scene: gpx.Scene, engine: str) -> float:
    """Return the friction coefficient that every pair of the scene has.

    Engines combine the values of two bodies by different rules, which agree where all bodies have the same value and
    the scene's own rule keeps it.

    Raises
    ------
    SettingsError
        When bodies differ, when their rule would change the value, or when a body bounces, which each engine models in
        a way of its own.
    """
    values = set()
    for body in (*scene.fixed, *scene.bodies):
        material = body.material
        if material.friction_rule == "product":
            raise gpx.SettingsError(f"{body.name} combines friction by product: {engine} has no such rule here")
        if material.elasticity != 1.0:
            raise gpx.SettingsError(f"{body.name} bounces: {engine} is compared on plastic contacts only")
        values.add(material.friction)
    if len(values) > 1:
        raise gpx.SettingsError(
            f"bodies have different friction ({', '.join(f'{value:g}' for value in sorted(values))}): {engine} "
            "combines two values by another rule, so it is compared where all are the same"
        )
    return values.pop() if values else 0.0


def require_shapes(scene: gpx.Scene, engine: str) -> None:
    """Raise SettingsError for a shape that the adapters do not rebuild, and for an inertia off the body's axes."""
    for body in (*scene.fixed, *scene.bodies):
        if not isinstance(body.shape, gpx.Box | gpx.Sphere | gpx.HalfSpace):
            raise gpx.SettingsError(
                f"{body.name} is a {type(body.shape).__name__}: for {engine} only boxes, spheres and half-spaces are "
                "rebuilt"
            )
    for body in scene.bodies:
        if np.any(body.inertia != np.diag(np.diag(body.inertia))):
            raise gpx.SettingsError(f"the inertia of {body.name} is not along its axes, as {engine} is given it")


def half_space_normal(body: gpx.Body) -> Array:
    """Return the outward normal of a half-space, world frame."""
    assert isinstance(body.shape, gpx.HalfSpace)
    normal: Array = rotation_matrices(body.orientation[None])[0] @ np.array(body.shape.numbers())
    return normal


def half_space_turn(body: gpx.Body) -> Array:
    """Return a unit quaternion w, x, y, z that turns +z into the normal of a half-space."""
    normal = half_space_normal(body)
    # The half-way quaternion (1 + z · n, z x n), or any half turn where n = -z.
    turn = np.array([1.0 + normal[2], -normal[1], normal[0], 0.0])
    length = float(np.linalg.norm(turn))
    return turn / length if length > 0.0 else np.array([0.0, 1.0, 0.0, 0.0])


def box_of(body: gpx.Body) -> tuple[Sequence[float], Array, Array]:
    """Return half sides, position and orientation of a box, or of the box whose top stands in for a half-space."""
    if isinstance(body.shape, gpx.HalfSpace):
        half_sides = (GROUND_HALF_SIDE, GROUND_HALF_SIDE, 1.0)
        return half_sides, body.position - half_space_normal(body), half_space_turn(body)
    assert isinstance(body.shape, gpx.Box)
    return body.shape.numbers(), body.position, body.orientation

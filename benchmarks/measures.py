"""The measures, taken from outside: the same few functions judge every engine, from its own contacts and impulses.

At rest the truth is known on paper. A horizontal cut through a stack carries exactly the weight above it, and each body
is in balance; how a wall shares a load between neighbours is not determined, so nothing finer is checked.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
import scipy.sparse as sp

import gpx_lcp as gpx
from benchmarks.bodies import Bodies
from benchmarks.interface import Array, Contacts, Diverged, Indices, Motion


@dataclass(frozen=True)
class Measures:
    """How well one step was solved, and where the bodies are after it.

    Parameters
    ----------
    load_error : float
        Largest relative difference, over all horizontal cuts, between the vertical force that the engine's impulses
        carry across the cut and the weight above it. 1 means that a cut carries nothing, or twice what it should.
    body_error : float
        Largest acceleration, in units of g, that the engine's impulses and gravity together leave in a body.
    penetration : float
        Deepest overlap among the contacts that the engine reported, m.
    drift : float
        Largest distance of a body from where it started, m.
    unexplained : float
        Largest difference between the velocity that the engine gave a body and the one that its reported impulses give
        it, in units of g dt. Near zero, the impulses are the whole truth about the step; if not, the measures above
        judge something that the engine did not do.
    certificate : Certificate
        Of the engine's impulses against the exact Coulomb law.
    """

    load_error: float
    body_error: float
    penetration: float
    drift: float
    unexplained: float
    certificate: gpx.Certificate

    def figures(self) -> dict[str, float]:
        """Return the measures beside the certificate by name."""
        names = (field.name for field in fields(self) if field.name != "certificate")
        return {name: getattr(self, name) for name in names}


def measure(bodies: Bodies, before: Motion, after: Motion, contacts: Contacts, time_step: float) -> Measures:
    """Return every measure of the step that led from `before` to `after`.

    Raises
    ------
    Diverged
        When a place, a velocity or an impulse is not finite: there is nothing to measure.
    """
    numbers = (before.position, before.velocity, after.position, after.velocity, contacts.impulse, contacts.gap)
    if not all(np.isfinite(each).all() for each in numbers):
        raise Diverged("places, velocities or impulses are not finite")
    weight = bodies.mass[:, None] * bodies.gravity
    force = net_force(contacts, bodies.count, time_step)
    gravity = float(np.linalg.norm(bodies.gravity))
    with np.errstate(all="ignore"):  # an engine that blew up gives an infinite error, not a warning
        rest = np.linalg.norm(force + weight, axis=1) / (bodies.mass * gravity)
        predicted = predicted_velocity(bodies, before, contacts, time_step)
        unexplained = np.abs(predicted - after.velocity).max(initial=0.0) / (gravity * time_step)
        drift = np.linalg.norm(after.position - bodies.start.position, axis=1)
    impulse, system = contact_system(bodies, before, contacts, time_step)
    return Measures(
        load_error=float(np.max(cut_load_errors(bodies, contacts, time_step), initial=0.0)),
        body_error=float(rest.max(initial=0.0)),
        penetration=float(np.max(-contacts.gap, initial=0.0)),
        drift=float(drift.max(initial=0.0)),
        unexplained=float(unexplained),
        certificate=gpx.certify(system, impulse),
    )


def layers(height: Array) -> Indices:
    """Return the layer of each body, counted from the lowest, where centres at the same height share one."""
    _, layer = np.unique(np.round(height, 6), return_inverse=True)
    return layer.astype(np.int64)


def cut_load_errors(bodies: Bodies, contacts: Contacts, time_step: float) -> Array:
    """Return |carried / weight above - 1| for the cut below each layer of the scene as it started.

    carried = Σ p · (-g/‖g‖) / dt over the contacts that cross the cut, counted on the body above.
    """
    up = -bodies.gravity / np.linalg.norm(bodies.gravity)
    layer = layers(bodies.start.position @ up)
    count = int(layer.max(initial=-1)) + 1
    # A static body lies below every cut.
    layer_a = np.where(contacts.body_a < 0, -1, layer[contacts.body_a])
    layer_b = np.where(contacts.body_b < 0, -1, layer[contacts.body_b])
    upward = contacts.impulse @ up / time_step
    # A contact between the layers a < b crosses the cuts a + 1 ... b, and the other way round where a > b: what it
    # carries starts to count at one of its layers and stops at the other.
    change = np.zeros(count + 1)
    np.add.at(change, layer_a + 1, upward)
    np.add.at(change, layer_b + 1, -upward)
    carried = np.cumsum(change)[:count]
    above = np.cumsum(np.bincount(layer, bodies.mass, minlength=count)[::-1])[::-1]
    weight = above * np.linalg.norm(bodies.gravity)
    errors: Array = np.abs(carried / weight - 1.0)
    return np.where(np.isfinite(errors), errors, np.inf)


def net_force(contacts: Contacts, count: int, time_step: float) -> Array:
    """Return the sum of the contact forces on each moving body, (bodies, 3), N."""
    force = np.zeros((count, 3))
    for body, sign in ((contacts.body_b, 1.0), (contacts.body_a, -1.0)):
        moving = body >= 0
        np.add.at(force, body[moving], sign * contacts.impulse[moving] / time_step)
    return force


def predicted_velocity(bodies: Bodies, before: Motion, contacts: Contacts, time_step: float) -> Array:
    """Return v + M⁻¹ (f dt + Jᵀ p), (bodies, 6), with the engine's impulses p.

    The gyroscopic torque is left out, as it is second order in the spin of a body that should not move at all.
    """
    velocity = free_velocity(bodies, before, time_step)
    inverse = bodies.inverse_mass(before.orientation)
    for body, point, sign in (
        (contacts.body_b, contacts.point_b, 1.0),
        (contacts.body_a, contacts.point_a, -1.0),
    ):
        moving = body >= 0
        impulse = sign * contacts.impulse[moving]
        arm = point[moving] - before.position[body[moving]]
        wrench = np.hstack((impulse, np.cross(arm, impulse)))
        np.add.at(velocity, body[moving], np.einsum("cde,ce->cd", inverse[body[moving]], wrench))
    return velocity


def free_velocity(bodies: Bodies, before: Motion, time_step: float) -> Array:
    """Return the velocities after gravity but before any contact, (bodies, 6)."""
    velocity = before.velocity.copy()
    velocity[:, :3] += bodies.gravity * time_step
    return velocity


def contact_system(
    bodies: Bodies, before: Motion, contacts: Contacts, time_step: float
) -> tuple[Array, gpx.StackedSystem]:
    """Return an engine's impulses in contact frames, (n, 3), and the stacked system that they should solve.

    J is built from the engine's own contact points and normals and the poses before the step, and

        B = -J v_free,        B_n = -(J v_free)_n - gap/dt for an open gap,

    so a contact may close its gap within the step but must not overlap. The push that an engine adds to undo an overlap
    is left out: engines differ in it, and the law that is certified does not need it.
    """
    n = contacts.gap.size
    frames = contact_frames(contacts.normal)
    rows = np.arange(3 * n).reshape(n, 3)
    velocity = free_velocity(bodies, before, time_step)
    data, row, column = [], [], []
    for body, point, sign in (
        (contacts.body_b, contacts.point_b, 1.0),
        (contacts.body_a, contacts.point_a, -1.0),
    ):
        at = np.flatnonzero(body >= 0)
        arm = point[at] - before.position[body[at]]
        angular = np.cross(arm[:, None, :], frames[at])  # t · (ω x r) = (r x t) · ω for every frame row t
        blocks = sign * np.concatenate((frames[at], angular), axis=2)
        columns = 6 * body[at][:, None] + np.arange(6)
        data.append(blocks.ravel())
        row.append(np.broadcast_to(rows[at][:, :, None], blocks.shape).ravel())
        column.append(np.broadcast_to(columns[:, None, :], blocks.shape).ravel())
    jacobian = sp.csr_array(
        (np.concatenate(data), (np.concatenate(row), np.concatenate(column))), shape=(3 * n, 6 * bodies.count)
    )
    B = -(jacobian @ velocity.ravel()).reshape(n, 3)
    B[:, 0] -= np.maximum(contacts.gap, 0.0) / time_step
    system = gpx.StackedSystem.from_jacobian(
        jacobian,
        bodies.inverse_mass(before.orientation),
        B.ravel(),
        contacts.friction,
        free_velocity=velocity.ravel(),
    )
    impulse = np.einsum("crd,cd->cr", frames, contacts.impulse)
    return impulse, system


def contact_frames(normal: Array) -> Array:
    """Return right-handed frames (n, 3, 3) with rows normal, tangent, tangent.

    The tangents start from the axis that is farthest from the normal; friction is isotropic, so their turn is free.
    """
    axis = np.eye(3)[np.argmin(np.abs(normal), axis=1)]
    first = np.cross(normal, axis)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    return np.stack((normal, first, np.cross(normal, first)), axis=1)

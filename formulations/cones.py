"""The cones that say which impulses are allowed, as functions over all contacts at once.

A contact vector x = (x_n, x_t) has its normal first. The friction cone of contact i and its dual are

    K  = {‖x_t‖ ≤ μ_i x_n},        K* = {μ_i ‖x_t‖ ≤ x_n},

its polyhedral approximations {x_t ∈ μ_i x_n P} for a polygon P of tangent directions. With one row per contact every
one of them is {x_n ≥ 0}.
"""

from __future__ import annotations

import numpy as np

from formulations.checks import Array, freeze


def project_friction_cone(x: Array, friction: Array) -> Array:
    """Project each contact vector onto its friction cone K, exactly.

    P_K(x) is x inside K, zero inside the polar cone (μ‖x_t‖ ≤ -x_n scaled to its own side), and otherwise the point
    of the boundary ray through x_t:  λ (1, μ x_t/‖x_t‖)  with  λ = (x_n + μ‖x_t‖)/(1 + μ²).

    Parameters
    ----------
    x : (n, rows) array
    friction : (n,) array

    Returns
    -------
    (n, rows) array
    """
    normal, tangent = x[:, 0], x[:, 1:]
    length = _lengths(tangent)
    outside = (length > friction * normal) | (normal < 0.0)
    projected = x.copy()
    ray = np.maximum(normal + friction * length, 0.0) / (1.0 + friction * friction)
    shrink = friction * ray / (length + (length == 0.0))
    np.copyto(projected[:, 0], ray, where=outside)
    np.multiply(tangent, shrink[:, None], out=projected[:, 1:], where=outside[:, None])
    return projected


def project_dual_cone(x: Array, friction: Array) -> Array:
    """Project each contact vector onto the dual cone K*: by Moreau's theorem x + P_K(-x)."""
    return x + project_friction_cone(-x, friction)


def friction_cone_derivative(x: Array, friction: Array) -> Array:
    """Return an element of the generalised (Clarke) derivative of the projection onto K, (n, rows, rows).

    The identity inside K, zero inside the polar cone, and on the rest, with t = x_t/‖x_t‖ and λ as in the projection,

        1/(1 + μ²) [1, μ tᵀ; μ t, μ² t tᵀ] + [0, 0; 0, μ λ/‖x_t‖ (1 - t tᵀ)].

    It is the derivative wherever that exists, symmetric and with eigenvalues in [0, 1] everywhere.
    """
    contacts, rows = x.shape
    normal, tangent = x[:, 0], x[:, 1:]
    length = _lengths(tangent)
    inside = (length <= friction * normal) & (normal >= 0.0)
    on_ray = ~inside & (friction * length > -normal)
    direction = tangent / np.where(length > 0.0, length, 1.0)[:, None]
    generator = np.column_stack((np.ones(contacts), friction[:, None] * direction))
    derivative = generator[:, :, None] * generator[:, None, :] / (1.0 + friction**2)[:, None, None]
    ray = (normal + friction * length) / (1.0 + friction**2)
    turn = friction * ray / np.where(length > 0.0, length, 1.0)
    across = np.eye(rows - 1) - direction[:, :, None] * direction[:, None, :]
    derivative[:, 1:, 1:] += turn[:, None, None] * across
    derivative[~on_ray] = 0.0
    derivative[inside] = np.eye(rows)
    return derivative


def de_saxce(velocity: Array, friction: Array) -> Array:
    """Return û = u + (μ‖u_t‖, 0, 0), (n, rows), m/s: with it Coulomb's law reads K ∋ p ⟂ û ∈ K*.

    Source: G. De Saxcé and Z.-Q. Feng, *The bipotential method*, Math. Comput. Modelling 28 (1998).
    """
    corrected = velocity.copy()
    corrected[:, 0] += friction * _lengths(velocity[:, 1:])
    return corrected


def pyramid_directions(rows: int, facets: int) -> Array:
    """Return the corners of the regular polygon that the unit disc circumscribes, (facets, rows - 1).

    With two rows per contact the disc is an interval and its two ends are returned whatever `facets` says.
    """
    if rows == 1:
        return freeze(np.zeros((0, 0)))
    if rows == 2:
        return freeze(np.array([[1.0], [-1.0]]))
    angle = 2.0 * np.pi * np.arange(facets) / facets
    return freeze(np.column_stack((np.cos(angle), np.sin(angle))))


def box_directions(rows: int) -> Array:
    """Return the corners of the square [-1, 1]² (the interval with two rows), (2^(rows - 1), rows - 1), in order."""
    if rows < 3:
        return pyramid_directions(rows, 2)
    return freeze(np.array([[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]]))


def project_polygon(x_t: Array, radius: Array, corners: Array) -> Array:
    """Project tangent vectors onto `radius` times the convex polygon of the given corners, exactly.

    Parameters
    ----------
    x_t : (n, rows - 1) array
    radius : (n,) array, not negative
    corners : (k, rows - 1) array, in order round the polygon
    """
    if corners.shape[0] == 0:
        return x_t.copy()
    if corners.shape[1] == 1:
        return np.clip(x_t, -radius[:, None], radius[:, None])
    start = radius[:, None, None] * corners
    edge = radius[:, None, None] * (np.roll(corners, -1, axis=0) - corners)
    outward = np.stack((edge[..., 1], -edge[..., 0]), axis=-1)
    offset = x_t[:, None, :] - start
    outside = (np.einsum("nkd,nkd->nk", outward, offset) > 0.0).any(axis=1) | (radius <= 0.0)
    return np.where(outside[:, None], _nearest_on_segments(x_t, start, edge), x_t)


def project_polyhedral_cone(x: Array, friction: Array, corners: Array) -> Array:
    """Project each contact vector onto {x_t ∈ μ x_n P}, P the convex polygon of the given corners, exactly.

    The nearest point lies inside, on a facet between two neighbouring generators (1, μ corner), on a generator or at
    the apex; every facet and generator is tried and the nearest admissible candidate is kept.
    """
    contacts, rows = x.shape
    if rows == 1:
        return np.maximum(x, 0.0)
    generators = np.empty((contacts, corners.shape[0], rows))
    generators[:, :, 0] = 1.0
    generators[:, :, 1:] = friction[:, None, None] * corners
    squares = np.einsum("nkd,nkd->nk", generators, generators)
    along = np.maximum(np.einsum("nkd,nd->nk", generators, x) / squares, 0.0)
    candidates = along[:, :, None] * generators
    if rows == 3:
        candidates = np.concatenate((candidates, _facet_candidates(x, generators)), axis=1)
    distance = np.square(x[:, None, :] - candidates).sum(axis=2)
    nearest = candidates[np.arange(contacts), distance.argmin(axis=1)]
    inside = _in_polyhedral_cone(x, friction, corners)
    return np.where(inside[:, None], x, nearest)


def _facet_candidates(x: Array, generators: Array) -> Array:
    """Return the nearest points on the facets' cones, (n, k, 3); the apex where a facet's own plane has none."""
    first, second = generators, np.roll(generators, -1, axis=1)
    ff, ss = np.einsum("nkd,nkd->nk", first, first), np.einsum("nkd,nkd->nk", second, second)
    fs = np.einsum("nkd,nkd->nk", first, second)
    fx, sx = np.einsum("nkd,nd->nk", first, x), np.einsum("nkd,nd->nk", second, x)
    determinant = ff * ss - fs**2
    flat = determinant <= 1e-14 * ff * ss
    safe = np.where(flat, 1.0, determinant)
    a, b = (ss * fx - fs * sx) / safe, (ff * sx - fs * fx) / safe
    admissible = ~flat & (a >= 0.0) & (b >= 0.0)
    return np.where(admissible[:, :, None], a[:, :, None] * first + b[:, :, None] * second, 0.0)


def _in_polyhedral_cone(x: Array, friction: Array, corners: Array) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    radius = friction * x[:, 0]
    if corners.shape[1] == 1:
        return np.asarray((x[:, 0] >= 0.0) & (np.abs(x[:, 1]) <= radius))
    edge = np.roll(corners, -1, axis=0) - corners
    outward = np.column_stack((edge[:, 1], -edge[:, 0]))
    support = np.einsum("kd,kd->k", outward, corners)
    return np.asarray((x[:, 0] >= 0.0) & (x[:, 1:] @ outward.T <= radius[:, None] * support).all(axis=1))


def _nearest_on_segments(x_t: Array, start: Array, edge: Array) -> Array:
    squares = np.einsum("nkd,nkd->nk", edge, edge)
    along = np.einsum("nkd,nkd->nk", x_t[:, None, :] - start, edge) / np.where(squares > 0.0, squares, 1.0)
    points = start + np.clip(along, 0.0, 1.0)[:, :, None] * edge
    distance = np.square(x_t[:, None, :] - points).sum(axis=2)
    return np.asarray(points[np.arange(len(x_t)), distance.argmin(axis=1)])


def _lengths(tangent: Array) -> Array:
    if tangent.shape[1] == 2:
        first, second = tangent[:, 0], tangent[:, 1]
        # Not hypot, which rounds differently: a warm start projected here and in the core is the same to the last bit.
        return np.asarray(np.sqrt(first * first + second * second))
    return np.asarray(np.abs(tangent).sum(axis=1))

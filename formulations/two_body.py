"""The founding formula: the impulse of two material objects in translational motion.

Two bodies of masses m1, m2 meet along a direction n that points from the first to the second. The impulse of magnitude
F dt takes momentum from the first and gives it to the second, p1' = p1 - F dt n, p2' = p2 + F dt n, and

    F dt (1/m1 + 1/m2) = e1 p1/m1 + e2 p2/m2                                                            (1.3)

with p1, p2 the momenta *towards each other* and e the elasticity of each body: 2 perfectly elastic, 1 perfectly
inelastic. In general form F dt (a1 + a2) = b1 + b2, that is A F dt = B (1.4, 1.5).

| elasticity | meaning | here |
|--|--|--|
| 2 | perfectly elastic, energy conserved (1.1) | |
| (1, 2) | in between | |
| 1 | perfectly inelastic, velocities equalised (1.2) | |
| (0, 1) | the bodies tunnel through each other | only with allow="tunnelling", and warned about |
| 0 | as if there had been no collision | |
| above 2 | the system gains energy | only with allow="energy_gain", and warned about |
| below 0 | reverses the force | refused |

Two bodies that do not close are not colliding: the impulse is zero, since contacts do not pull.

With e1 ≠ e2 the literal rule depends on the observer: a velocity added to both bodies changes e1 v1 - e2 v2. The
default rule therefore takes the velocities of (1.3) relative to the pair's centre of mass, which gives

    B = (e1 m2 + e2 m1)/(m1 + m2) × closing speed:

the paper's rule wherever e1 = e2, and the same in every frame. A body of infinite mass is the frame, and the other
body's elasticity alone counts.

Source: M. Policht, *General formula for collision impulse of two material objects in translational motion*,
eqs. 1.1-1.5.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from typing import Final

import numpy as np
import numpy.typing as npt

from formulations.checks import Array, as_array
from formulations.errors import ProblemError, SettingsError

RULES: Final = ("centre_of_mass", "paper")
ALLOWANCES: Final = ("tunnelling", "energy_gain")


class ElasticityWarning(UserWarning):
    """An elasticity that was asked for by name, outside 1 … 2."""


def two_body_impulse(
    mass: Sequence[float],
    velocity: Sequence[float],
    *,
    elasticity: Sequence[float] = (1.0, 1.0),
    rule: str = "centre_of_mass",
    allow: str | None = None,
) -> float:
    """Return the impulse magnitude F dt of a collision along one axis, N s.

    The first body is behind the second on the axis: they close while v1 > v2. Afterwards v1' = v1 - F dt/m1 and
    v2' = v2 + F dt/m2.

    Parameters
    ----------
    mass : (m1, m2), kg
        Positive; infinity stands for a body that nothing moves.
    velocity : (v1, v2), m/s
        Along the axis.
    elasticity : (e1, e2)
        Of each body, see the table above.
    rule : "centre_of_mass" or "paper"
        The frame-independent rule, or (1.3) to the letter in the frame of the given velocities.
    allow : "tunnelling", "energy_gain" or None
        Permits elasticities in (0, 1), or above 2, with an ElasticityWarning.

    Raises
    ------
    ProblemError
        When a mass is not positive, both are infinite, a value is not finite or an elasticity is refused.
    SettingsError
        When the rule or the allowance has no such name.
    """
    m = _masses(mass)
    v = as_array("velocity", velocity, (2,))
    e = checked_elasticity("elasticity", elasticity, allow=allow)
    if rule not in RULES:
        raise SettingsError(f"rule is {rule!r}: it must be one of {', '.join(map(repr, RULES))}")
    if v[0] <= v[1]:
        return 0.0
    inverse = 1.0 / m
    A = float(inverse.sum())
    if rule == "paper":
        return float(e[0] * v[0] - e[1] * v[1]) / A
    return float(pair_elasticity(m, e) * (v[0] - v[1])) / A


def two_body_impulse_along(
    mass: Sequence[float],
    velocity: npt.ArrayLike,
    basis: npt.ArrayLike,
    *,
    elasticity: npt.ArrayLike = 1.0,
    rule: str = "centre_of_mass",
    allow: str | None = None,
) -> Array:
    """Return the impulse on the second body, component by component along a basis, N s.

    The formula holds along every direction, so that a basis of the contact normal and its tangents gives separate
    impulses for bounciness and friction: tangential elasticity 0 is a frictionless row, 1 stops the sliding, 2 reverses
    it. No friction cone bounds them here. Nothing happens unless the bodies close along the first direction.

    Parameters
    ----------
    mass : (m1, m2), kg
    velocity : (2, d) array, m/s
        Of the two bodies.
    basis : (d, d) array
        Orthonormal directions in its rows, the contact normal from body 1 to body 2 first.
    elasticity : scalar, (d,) or (2, d) array
        For both bodies and all directions, by direction, or by body and direction.
    rule, allow
        As in `two_body_impulse`; tangential elasticities in [0, 1) brake the sliding partly and need no allowance.

    Returns
    -------
    (d,) array
        F dt along each row of the basis; the momenta change by -impulse @ basis and +impulse @ basis.

    Raises
    ------
    ProblemError
        As `two_body_impulse`, and when the basis is not orthonormal.
    """
    v = as_array("velocity", velocity, (2, None))
    directions = as_array("basis", basis, (v.shape[1], v.shape[1]))
    if np.abs(directions @ directions.T - np.eye(len(directions))).max() > 1e-9:
        raise ProblemError("basis is not orthonormal: its rows must be perpendicular unit vectors")
    try:
        e = np.broadcast_to(np.asarray(elasticity, dtype=np.float64), v.shape)
    except (TypeError, ValueError) as error:
        raise ProblemError(f"elasticity does not fit two bodies in {v.shape[1]} directions: {error}") from error
    checked_elasticity("elasticity", e[:, 0], allow=allow)
    for axis in range(1, v.shape[1]):
        checked_elasticity("elasticity", e[:, axis], allow=allow, partial=True)
    m = _masses(mass)
    if rule not in RULES:
        raise SettingsError(f"rule is {rule!r}: it must be one of {', '.join(map(repr, RULES))}")
    along = v @ directions.T
    if along[0, 0] <= along[1, 0]:
        return np.zeros(v.shape[1])
    if rule == "paper":
        B = e[0] * along[0] - e[1] * along[1]
    else:
        B = pair_elasticity(m, e) * (along[0] - along[1])
    return np.asarray(B / (1.0 / m).sum())


def pair_elasticity(mass: Array, elasticity: Array) -> Array:
    """Return (e1 m2 + e2 m1)/(m1 + m2), the frame-independent elasticity of a pair; e1 where m2 is infinite."""
    inverse = 1.0 / mass
    return np.asarray((elasticity[0] * inverse[0] + elasticity[1] * inverse[1]) / inverse.sum())


def checked_elasticity(name: str, value: npt.ArrayLike, *, allow: str | None, partial: bool = False) -> Array:
    """Return elasticities after the table above, warning of those that were asked for by name.

    With `partial`, values in (0, 1) are ordinary: along a tangent they brake and do not tunnel.

    Raises
    ------
    ProblemError
        With the index and the value of the first elasticity that is refused.
    SettingsError
        When the allowance has no such name.
    """
    if allow is not None and allow not in ALLOWANCES:
        raise SettingsError(f"allow is {allow!r}: it must be None or one of {', '.join(map(repr, ALLOWANCES))}")
    e = as_array(name, value, (None,))
    for index, one in enumerate(e):
        if one < 0.0:
            raise ProblemError(
                f"{name}[{index}] is {one:g}: below 0 the force would be reversed; 1 is plastic, 2 elastic"
            )
        if 0.0 < one < 1.0 and not partial:
            if allow != "tunnelling":
                raise ProblemError(
                    f"{name}[{index}] is {one:g}: between 0 and 1 the bodies tunnel through each other; "
                    "ask for it with allow='tunnelling'"
                )
            warnings.warn(f"{name}[{index}] is {one:g}: the bodies will tunnel", ElasticityWarning, stacklevel=3)
        if one > 2.0:
            if allow != "energy_gain":
                raise ProblemError(
                    f"{name}[{index}] is {one:g}: above 2 the collision gains energy; "
                    "ask for it with allow='energy_gain'"
                )
            warnings.warn(f"{name}[{index}] is {one:g}: the collision gains energy", ElasticityWarning, stacklevel=3)
    return e


def _masses(mass: npt.ArrayLike) -> Array:
    m = np.asarray(mass, dtype=np.float64)
    if m.shape != (2,):
        raise ProblemError(f"mass has shape {m.shape}, but (2,) is needed")
    for index, one in enumerate(m):
        if not one > 0.0:
            raise ProblemError(f"mass[{index}] is {one:g}: it must be positive")
    if np.isinf(m).all():
        raise ProblemError("mass is infinite for both bodies: at least one must be able to move")
    return m

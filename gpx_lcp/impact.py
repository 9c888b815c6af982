"""Impacts: the velocities that a collision leaves, by the law of one's choice.

Time stands still in an impact, so that only the contacts' impulses count: v⁺ = v⁻ + M⁻¹ Jᵀ p. Which p, is what the laws
of `gpx_lcp.impact_laws` disagree about. Inside a time step a `World` asks them the same question.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np
import numpy.typing as npt

from formulations import StackedSystem
from formulations.checks import Array, as_array, freeze
from gpx_lcp.errors import ProblemError, SettingsError
from gpx_lcp.impact_laws import Impact, checked_impact_speed, collide, law_named
from gpx_lcp.scene import Scene
from gpx_lcp.world import World

# How far from -J v the B of a system may be, relative to its largest entry.
SAME_VELOCITY: Final = 1e-9


def impact(
    collision: Scene | StackedSystem,
    law: str = "newton",
    *,
    elasticity: npt.ArrayLike | None = None,
    tangential_elasticity: npt.ArrayLike | None = None,
    impact_speed: float = 0.0,
    tolerance: float = 1e-10,
) -> Impact:
    """Return the impulses and velocities of a collision by an impact law.

    Parameters
    ----------
    collision : Scene or StackedSystem
        A scene, whose bodies collide where they touch now, as they move now, with the elasticities of their materials;
        gravity and forces have no part. Or a stacked system whose B is that of a plastic collision, B = -u⁻, minus the
        contact velocities before; where it carries J and the velocities before as `free_velocity`, B = -J v.
    law : str
        "newton", "poisson", "energy_safe" or "sequential": see `gpx_lcp.impact_laws`.
    elasticity, tangential_elasticity : scalar or (n,) array, optional
        Of the contacts of a system, each 1 (plastic, the default) to 2 (elastic).
    impact_speed : float, m/s
        Elasticity acts in contacts that close faster.
    tolerance : float
        As in `gpx.solve`, for every program of the law.

    Raises
    ------
    ProblemError
        When the collision or an elasticity is not what is needed.
    SettingsError
        When the law has no such name, or a setting is out of range.
    """
    row = law_named("law", law)
    speed = checked_impact_speed(impact_speed)
    if not (isinstance(tolerance, int | float) and 0.0 < tolerance < np.inf):
        raise SettingsError(f"tolerance is {tolerance!r}: it must be a positive number")
    if isinstance(collision, Scene):
        if elasticity is not None or tangential_elasticity is not None:
            raise ProblemError("elasticity is given beside a scene, whose materials say what theirs is: leave it out")
        world = World(collision, time_step=1.0)
        system, restitution = world.collision()
        found = collide(row, system, restitution, speed, tolerance)
        assert found.velocities is not None
        velocities = world.velocities.copy()
        columns = found.velocities.size // max(len(velocities), 1)
        velocities[:, :columns] = found.velocities.reshape(len(velocities), columns)
        return replace(found, velocities=freeze(velocities))
    if not isinstance(collision, StackedSystem):
        raise ProblemError(f"collision is a {type(collision).__name__}: a Scene or a StackedSystem is needed")
    _require_plastic(collision)
    restitution = np.column_stack(
        [
            _restitution("elasticity", elasticity, collision.contacts),
            _restitution("tangential_elasticity", tangential_elasticity, collision.contacts),
        ]
    )
    return collide(row, collision, restitution, speed, tolerance)


def _require_plastic(system: StackedSystem) -> None:
    """Refuse a system whose B is not that of a plastic collision, where it carries the velocities to tell."""
    if system.jacobian is None or system.free_velocity is None:
        return
    plastic = -np.asarray(system.jacobian @ system.free_velocity)
    wrong = np.abs(system.B - plastic) > SAME_VELOCITY * np.abs(plastic).max(initial=0.0)
    if wrong.any():
        row = int(np.argmax(wrong))
        raise ProblemError(
            f"B[{row}] is {system.B[row]:g}, but -J v is {plastic[row]:g}: an impact needs the B of a plastic "
            "collision, without gaps, gravity or elasticity"
        )


def _restitution(name: str, value: npt.ArrayLike | None, contacts: int) -> Array:
    """Return elasticity - 1 of each contact."""
    if value is None:
        return np.zeros(contacts)
    shape = () if np.ndim(value) == 0 else (contacts,)
    elasticity = np.broadcast_to(as_array(name, value, shape), (contacts,))
    wrong = (elasticity < 1.0) | (elasticity > 2.0)
    if wrong.any():
        at = int(np.argmax(wrong))
        raise ProblemError(f"{name}[{at}] is {elasticity[at]:g}: it must lie between 1 (plastic) and 2 (elastic)")
    return np.asarray(elasticity - 1.0)

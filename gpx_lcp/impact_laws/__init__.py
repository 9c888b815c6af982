"""The table of impact laws: one file and one row each, and nowhere else a branch on a law's name."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

import numpy as np

from gpx_lcp.errors import SettingsError
from gpx_lcp.impact_laws import energy_safe, newton, poisson, sequential
from gpx_lcp.impact_laws._interface import Collision, ImpactLaw, Impulses
from gpx_lcp.impact_laws.outcome import Impact, Stage, collide, impact_stage

__all__ = [
    "LAWS",
    "Collision",
    "Impact",
    "ImpactLaw",
    "Impulses",
    "Stage",
    "checked_impact_speed",
    "collide",
    "impact_stage",
    "law_named",
]

LAWS: Final[Mapping[str, ImpactLaw]] = MappingProxyType(
    {law.name: law for law in (newton.LAW, poisson.LAW, energy_safe.LAW, sequential.LAW)}
)


def law_named(argument: str, name: object) -> ImpactLaw:
    """Return the row of a law.

    Raises
    ------
    SettingsError
        When there is none of that name.
    """
    if name not in LAWS:
        raise SettingsError(f"{argument} is {name!r}: it must be one of {', '.join(map(repr, LAWS))}")
    return LAWS[str(name)]


def checked_impact_speed(value: object) -> float:
    """Return a closing speed, m/s.

    Raises
    ------
    SettingsError
        When it is not a number, negative or not finite.
    """
    if isinstance(value, bool) or not isinstance(value, int | float | np.floating) or not 0.0 <= value < np.inf:
        raise SettingsError(f"impact_speed is {value!r}: it must be a number of m/s, not negative")
    return float(value)

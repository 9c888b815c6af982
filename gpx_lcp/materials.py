"""What bodies are made of: friction, elasticity, and how the coefficients of two bodies become the pair's."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from formulations.checks import as_array
from gpx_lcp.errors import ProblemError, SettingsError

# In the order of the core's table: of two materials that name different rules, the later one counts.
COMBINE_RULES: Final = ("centre_of_mass", "geometric_mean", "average", "minimum", "product", "maximum")


@dataclass(frozen=True)
class Material:
    """The surface of a body.

    Parameters
    ----------
    friction : float
        Coulomb's coefficient μ, not negative.
    elasticity : float
        1 (perfectly inelastic) to 2 (perfectly elastic): one more than Newton's coefficient of restitution. Below 1
        the founding formula lets bodies tunnel, above 2 they gain energy: a scene refuses both, and
        `two_body_impulse` computes them where they are asked for by name.
    tangential_elasticity : float
        The same along the surface: 1 stops the sliding and 2 reverses it, both as far as friction can. A ball of 2 is a
        superball. What slides more easily has less friction, not less elasticity: below 1 is refused.
    friction_rule : str
        Makes the pair's friction: "geometric_mean" √(μ1 μ2), "average", "minimum", "product" or "maximum".
    elasticity_rule : str
        Makes the pair's restitutions e - 1: those, or "centre_of_mass", the founding formula in the frame of the pair's
        centre of mass, (e1 m2 + e2 m1)/(m1 + m2); against a body that never moves, the moving body's own.

    Notes
    -----
    Elasticity acts in impacts only, above a closing speed that the world states (`World.impact_speed`).

    Where two materials name different rules, the one that stands later in the list centre_of_mass, geometric_mean,
    average, minimum, product, maximum is used.

    Raises
    ------
    ProblemError
        When a coefficient is not a finite number in its range.
    SettingsError
        When a rule has no such name.
    """

    friction: float = 0.5
    elasticity: float = 1.0
    friction_rule: str = "geometric_mean"
    elasticity_rule: str = "centre_of_mass"
    tangential_elasticity: float = 1.0

    def __post_init__(self) -> None:
        friction = float(as_array("friction", self.friction, ()))
        if friction < 0:
            raise ProblemError(f"friction is {friction:g}: it must not be negative")
        elasticity = float(as_array("elasticity", self.elasticity, ()))
        if not 1.0 <= elasticity <= 2.0:
            raise ProblemError(
                f"elasticity is {elasticity:g}: it must lie between 1 (plastic) and 2 (elastic); a body that is to "
                "touch nothing has no shape"
            )
        tangential = float(as_array("tangential_elasticity", self.tangential_elasticity, ()))
        if not 1.0 <= tangential <= 2.0:
            raise ProblemError(
                f"tangential_elasticity is {tangential:g}: it must lie between 1 (stops the sliding) and 2 (reverses "
                "it); less friction is what friction says"
            )
        for name, rule, rules in (
            ("friction_rule", self.friction_rule, COMBINE_RULES[1:]),
            ("elasticity_rule", self.elasticity_rule, COMBINE_RULES),
        ):
            if rule not in rules:
                raise SettingsError(f"{name} is {rule!r}: it must be one of {', '.join(map(repr, rules))}")
        object.__setattr__(self, "friction", friction)
        object.__setattr__(self, "elasticity", elasticity)
        object.__setattr__(self, "tangential_elasticity", tangential)

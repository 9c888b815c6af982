"""The bodies of a world: how the core sees them, what follows from them, and how they are found."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from formulations.checks import Array
from gpx_lcp import _core
from gpx_lcp.errors import ProblemError
from gpx_lcp.materials import COMBINE_RULES
from gpx_lcp.scene import Body
from gpx_lcp.shapes import Sphere


@dataclass(frozen=True)
class Inhabitants:
    """The bodies of a world; they are changed by making another one.

    Attributes
    ----------
    bodies, fixed : tuple of Body
        Those that move, each in the row of its index, and those that never do.
    core : _core.Bodies
        The same for the core, which numbers those that never move after the moving ones.
    rows : int
        Of each contact: 1 where no material has friction, or 3.
    columns : int
        Velocities of each body: 3 where no contact turns any of them, or 6.
    """

    bodies: tuple[Body, ...]
    fixed: tuple[Body, ...]
    core: _core.Bodies
    rows: int
    columns: int

    @classmethod
    def of(cls, bodies: tuple[Body, ...], fixed: tuple[Body, ...]) -> Inhabitants:
        """Return these bodies with what follows from them."""
        rows = 3 if any(body.material.friction for body in bodies + fixed) else 1
        return cls(
            bodies,
            fixed,
            core=_core_bodies(bodies, fixed),
            rows=rows,
            columns=6 if any(_is_turned(body, rows > 1) for body in bodies) else 3,
        )

    def with_body(self, body: Body) -> tuple[Inhabitants, Body]:
        """Return them with one more, and that one in its row."""
        if body.index < 0:
            added = replace(body)
            return Inhabitants.of(self.bodies, (*self.fixed, added)), added
        added = replace(body, index=len(self.bodies))
        return Inhabitants.of((*self.bodies, added), self.fixed), added

    def without_body(self, number: int) -> Inhabitants:
        """Return them without the one of this number; moving bodies behind it move up."""
        place = number - len(self.bodies)
        if place >= 0:
            return Inhabitants.of(self.bodies, self.fixed[:place] + self.fixed[place + 1 :])
        behind = tuple(replace(body, index=body.index - 1) for body in self.bodies[number + 1 :])
        return Inhabitants.of(self.bodies[:number] + behind, self.fixed)

    def number(self, body: Body | str | int) -> int:
        """Return the core's number of a body that is meant by itself, by its name or, if it moves, by its row.

        Raises
        ------
        ProblemError
            When it is none of these bodies, or more than one has the name.
        """
        everybody = self.bodies + self.fixed
        if isinstance(body, Body):
            # A moving body stands in its row, if it is here at all.
            places = range(len(self.bodies), len(everybody)) if body.index < 0 else (body.index,)
            for place in places:
                if place < len(everybody) and everybody[place] is body:
                    return place
            raise ProblemError(
                f"{body.name} is not in world.bodies or world.fixed: after add and remove take bodies from there"
            )
        if isinstance(body, str):
            named = [number for number, other in enumerate(everybody) if other.name == body]
            if len(named) != 1:
                raise ProblemError(f"{len(named)} bodies of the world are named {body!r}: one is needed")
            return named[0]
        if isinstance(body, bool) or not isinstance(body, int | np.integer):
            raise ProblemError(f"body is {body!r}: a Body, its name or its row is needed")
        if not 0 <= body < len(self.bodies):
            raise ProblemError(f"body is {body}: the rows of the world's moving bodies are 0 to {len(self.bodies) - 1}")
        return int(body)

    def moving(self, body: Body | str | int) -> Body:
        """Return a body as `number` finds it, if it moves.

        Raises
        ------
        ProblemError
            When it is not there, or never moves.
        """
        number = self.number(body)
        if number >= len(self.bodies):
            name = self.fixed[number - len(self.bodies)].name
            raise ProblemError(f"{name} never moves: remove it, and add it where it is to be")
        return self.bodies[number]


def table(bodies: tuple[Body, ...], *names: str, width: int = 3) -> Array:
    """Return the vectors of these names side by side, one body a row."""
    rows = [np.concatenate([getattr(body, name) for name in names]) for body in bodies]
    return np.array(rows, dtype=np.float64).reshape(len(bodies), width * len(names))


def _is_turned(body: Body, friction: bool) -> bool:
    """Return whether contacts can turn a body: none turns a point mass, and none without friction a ball."""
    centred = body.shape is None or isinstance(body.shape, Sphere)
    return bool(body.inertia.any()) and (friction or not centred)


def _core_bodies(moving: tuple[Body, ...], fixed: tuple[Body, ...]) -> _core.Bodies:
    def shape(body: Body) -> tuple[str, Array]:
        if body.shape is None:
            return "none", np.zeros(0)
        return body.shape.kind, np.ascontiguousarray(body.shape.numbers(), dtype=np.float64)

    def material(body: Body) -> tuple[float, int, tuple[float, float], int]:
        m = body.material
        elasticity = (m.elasticity, m.tangential_elasticity)
        return m.friction, COMBINE_RULES.index(m.friction_rule), elasticity, COMBINE_RULES.index(m.elasticity_rule)

    everybody = moving + fixed
    return _core.Bodies(
        len(moving),
        [shape(body) for body in everybody],
        [material(body) for body in everybody],
        np.array([body.mass for body in moving], dtype=np.float64),
        np.array([body.inertia.ravel() for body in moving], dtype=np.float64).reshape(-1, 9),
        np.hstack((table(fixed, "position"), table(fixed, "orientation", width=4))),
    )

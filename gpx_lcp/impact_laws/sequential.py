"""Generalised reflections: impacts that propagate and break away, one wave of closing contacts after the other.

    while a contact closes (u_n < 0) in which elasticity acts:
        V = all contacts that close now
        u ← u + A r,  r the impulses of Poisson's law for the contacts of V alone, at u
    if a contact still closes: stop it plastically, all contacts at once

Without friction and at e = 2 a pass takes the velocities to their mirror image at the contacts of V: r is twice what
stops them, v goes to 2 v_c - v with v_c the nearest velocity that closes none of V, and the kinetic energy stays.
Contacts that do not close bear nothing in a pass, so that an impulse runs through a row of balls and leaves with the
last. All contacts that close are taken together, so that what is symmetric stays symmetric.

Without friction it ends. At e = 2 a velocity is reflected finitely often in a cone with finitely many faces. At one
common e < 2 a pass in which a contact closes with w loses at least e (2 - e) w²/(2 A_ii) of energy, and only speeds
above the impact speed count; with impact_speed = 0 rounding is the end (inelastic collapse). With friction neither
argument holds, and PASSES is the limit.

Source: B. Smith, D. M. Kaufman, E. Vouga, R. Tamstorf, E. Grinspun, *Reflections on simultaneous impact*, ACM Trans.
Graph. 31 (2012); E. Vouga et al., *All's well that ends well*, ACM Trans. Graph. 36 (2017) for the end. Departures: (1)
elasticity acts in every pass, so that each contact has its own; (2) friction within each pass.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from gpx_lcp.impact_laws import poisson
from gpx_lcp.impact_laws._interface import Collision, ImpactLaw, Impulses
from gpx_lcp.solution import Solution

PASSES: Final = 1000


def run(collision: Collision) -> Impulses:
    """Reflect until nothing closes."""
    velocity = collision.before
    impulse = np.zeros_like(velocity)
    solutions: list[Solution] = []
    passes = 0
    while passes < PASSES and collision.acting(-velocity[:, 0]).any():
        closing = np.flatnonzero(velocity[:, 0] < -collision.rounding)
        reflected = poisson.run(collision.part(closing, velocity))
        impulse[closing] += reflected.impulse
        solutions += reflected.solutions
        velocity = collision.before + collision.apply(impulse)
        passes += 1
    finished = passes < PASSES or not collision.acting(-velocity[:, 0]).any()
    if (velocity[:, 0] < -collision.rounding).any():
        rest = collision.solve(-velocity)
        impulse += rest.impulse
        solutions.append(rest)
    return Impulses(impulse, tuple(solutions), finished, {"passes": passes})


LAW = ImpactLaw(
    name="sequential",
    summary="reflection after reflection of the contacts that close, until none does",
    promises="Impulses propagate and break away: a cradle of equal balls gives (0, ..., 0, 1). What is symmetric stays "
    "symmetric. Without friction no energy is gained, and none is lost at elasticity 2.",
    breaks="With friction neither its end nor its energy is proved: see the linkages. A contact that does not close "
    "bears nothing in a pass, and lends no friction.",
    run=run,
)

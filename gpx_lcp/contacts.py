"""The contacts of a step as a user reads them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from formulations.checks import Array


@dataclass(frozen=True)
class Contacts:
    """The contacts of one step, as arrays over the n contacts.

    Attributes
    ----------
    body_a, body_b : (n,) int array
        Indices of the bodies; -1 is a body that never moves, which is always body a.
    point : (n, 3) array, m
        World frame, halfway between the surfaces.
    normal : (n, 3) array
        Unit, from body a to body b.
    frame : (n, 3, 3) array
        Rows: the normal and two tangents, the axes of `impulse`.
    gap : (n,) array, m
        At the start of the step; negative is penetration.
    friction : (n,) array
    impulse : (n, 3) array, N s
        On body b, in the contact frame; zero before the first step.
    force : (n, 3) array, N
        On body b, world frame: the impulse over the length of the step.
    """

    body_a: npt.NDArray[np.int64]
    body_b: npt.NDArray[np.int64]
    point: Array
    normal: Array
    frame: Array
    gap: Array
    friction: Array
    impulse: Array
    force: Array

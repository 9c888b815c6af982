"""Turns what a user passes into checked float64 arrays, with errors that name the argument, the index and the value."""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from formulations.errors import ProblemError

Array = npt.NDArray[np.float64]


def as_array(name: str, value: npt.ArrayLike, shape: Sequence[int | None]) -> Array:
    """Return `value` as a new finite float64 array of the given shape; None stands for any length.

    Raises
    ------
    ProblemError
        When the value is not numeric, has another shape or holds a NaN or an infinity.
    """
    try:
        array = np.array(value, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise ProblemError(f"{name} is not an array of numbers: {error}") from error
    if array.ndim != len(shape) or any(
        want is not None and have != want for have, want in zip(array.shape, shape, strict=True)
    ):
        wanted = (
            "("
            + ", ".join("n" if want is None else str(want) for want in shape)
            + ("," if len(shape) == 1 else "")
            + ")"
        )
        raise ProblemError(f"{name} has shape {array.shape}, but {wanted} is needed")
    require_finite(name, array)
    return array


def require_finite(name: str, array: Array) -> None:
    """Raise ProblemError with the first index that holds a NaN or an infinity."""
    if not np.isfinite(array).all():
        index = tuple(int(i) for i in np.argwhere(~np.isfinite(array))[0])
        raise ProblemError(f"{name}{list(index)} is {array[index]}: every entry must be finite")


def require_at_least(name: str, array: Array, least: float) -> None:
    """Raise ProblemError with the first index that is below `least`."""
    if (array < least).any():
        index = tuple(int(i) for i in np.argwhere(array < least)[0])
        raise ProblemError(f"{name}{list(index)} is {array[index]:g}: it must be at least {least:g}")


def freeze(array: Array) -> Array:
    """Make an array read-only and return it."""
    array.flags.writeable = False
    return array

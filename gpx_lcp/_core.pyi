"""The native core; every name here is wrapped by a public one in `gpx_lcp`."""

from typing import Any

import numpy as np
import numpy.typing as npt

__all__ = ["BUILD_PROFILE", "gauss_seidel"]

BUILD_PROFILE: str

def gauss_seidel(
    matrix: dict[str, Any], question: dict[str, Any], effort: dict[str, Any]
) -> tuple[npt.NDArray[np.float64], str, int, npt.NDArray[np.int64], npt.NDArray[np.float64], float]: ...

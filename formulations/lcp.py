"""The linear complementarity problem  0 ≤ z ⟂ w = M z + q ≥ 0,  the form that pivoting methods take.

Source: R. W. Cottle, J.-S. Pang, R. E. Stone, *The Linear Complementarity Problem* (1992).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from formulations.checks import Array, as_array, freeze
from formulations.errors import ProblemError


@dataclass(frozen=True)
class LCP:
    """Find z with 0 ≤ z ⟂ M z + q ≥ 0; immutable and checked when made.

    Attributes
    ----------
    M : (n, n) array
        Any square matrix.
    q : (n,) array

    Raises
    ------
    ProblemError
        When M is not square, does not fit q, or an entry is not finite.
    """

    M: Array
    q: Array

    def __init__(self, M: npt.ArrayLike, q: npt.ArrayLike) -> None:
        vector = as_array("q", q, (None,))
        matrix = as_array("M", M, (None, None))
        if matrix.shape != (vector.size, vector.size):
            raise ProblemError(
                f"M has shape {matrix.shape} but q has length {vector.size}: M must be {vector.size} x {vector.size}"
            )
        object.__setattr__(self, "M", freeze(matrix))
        object.__setattr__(self, "q", freeze(vector))

    def residual(self, z: Array) -> float:
        """Return ‖min(z/s, w)‖ / ‖q‖ with s_i the size of row i's diagonal, zero exactly at a solution.

        Rows without a diagonal (the friction rows of Stewart and Trinkle) are scaled by their largest entry.
        """
        if self.q.size == 0:
            return 0.0
        diagonal = np.abs(np.diag(self.M))
        largest = np.abs(self.M).max(axis=1)
        scale = np.where(diagonal > 0.0, diagonal, np.where(largest > 0.0, largest, 1.0))
        norm = float(np.linalg.norm(np.minimum(scale * z, self.M @ z + self.q)))
        size = float(np.linalg.norm(self.q))
        return norm / size if size > 0.0 else norm

    def proves_infeasible(self, y: Array, tolerance: float = 1e-9) -> bool:
        """Tell whether y is a Farkas certificate: y ≥ 0, Mᵀ y ≤ 0 and qᵀ y < 0 leave no z ≥ 0 with M z + q ≥ 0.

        For then 0 ≤ yᵀ(M z + q) = (Mᵀ y)ᵀ z + qᵀ y < 0, a contradiction. Signs hold to `tolerance`, relative to ‖y‖
        and to the entries of M and q.
        """
        size = float(np.abs(y).max(initial=0.0))
        if size == 0.0 or not np.isfinite(y).all():
            return False
        y = y / size
        matrix_size, vector_size = float(np.abs(self.M).max(initial=0.0)), float(np.abs(self.q).max(initial=0.0))
        return bool(
            (y >= -tolerance).all()
            and (self.M.T @ y <= tolerance * matrix_size).all()
            and self.q @ y < -1e3 * tolerance * vector_size
        )

"""The convex quadratic program that QP backends take:  min ½ xᵀ P x + qᵀ x  over  G x ≤ 0  and  x ≥ lower."""

from __future__ import annotations

from dataclasses import dataclass

import scipy.sparse as sp

from formulations.checks import Array
from formulations.system import Matrix


@dataclass(frozen=True)
class QP:
    """A QP over a cone of impulses; sparse, with the symmetric part of the Delassus matrix as P.

    Attributes
    ----------
    P : (m, m) sparse array
    q : (m,) array
    G : (k, m) sparse array or None
        The facets of the cone, G x ≤ 0.
    lower : (m,) array or None
    """

    P: sp.csc_array
    q: Array
    G: sp.csc_array | None
    lower: Array | None

    @classmethod
    def from_matrix(
        cls, matrix: Matrix, q: Array, *, facets: sp.sparray | None = None, lower: Array | None = None
    ) -> QP:
        """Make the QP from a Delassus matrix, whose antisymmetric rounding no QP can see."""
        symmetric = sp.csc_array(0.5 * (matrix + matrix.T))
        return cls(symmetric, q, None if facets is None else sp.csc_array(facets), lower)

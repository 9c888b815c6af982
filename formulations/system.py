"""The stacked system A F dt = B: every contact of a scene, or of a problem file, in one linear relation.

With the stacked contact impulses p = F dt and the stacked contact velocities u,

    u = A p - B,        A = J M⁻¹ Jᵀ,        B = -(J v_free + elasticity, gap and stabilisation terms)

(M. Policht, *General formula for collision impulse*, eq. 1.5, with bodies that also rotate). Each contact owns `rows`
consecutive rows, its normal first: one row without friction, two in the plane, three in space. Which impulses are
allowed is not said here: that is the formulation's business.
"""

from __future__ import annotations

from functools import cached_property
from typing import Any, Final, TypeAlias

import numpy as np
import numpy.typing as npt
import scipy.sparse as sp

from formulations.checks import Array, as_array, freeze, require_at_least, require_finite
from formulations.errors import ProblemError

# Dense, or scipy.sparse in compressed rows.
Matrix: TypeAlias = Any

# Real problem files carry six digits, which makes their A asymmetric by up to 2.5e-3; beyond this it is a mistake.
ASYMMETRY_LIMIT: Final = 1e-2
# A pivot of M⁻¹ below this share of its diagonal entry is zero.
DEPENDENT: Final = 1e-13
# Up to so many rows and columns a dense product takes less time than scipy needs to begin a sparse one, some 10 µs.
SMALL: Final = 64


class StackedSystem:
    """One contact problem, immutable and checked when made.

    Parameters
    ----------
    A : (rows n, rows n) array or scipy.sparse matrix or array, 1/kg
        The Delassus matrix, impulse to velocity; positive semidefinite up to rounding. Kept as given (a dense array, or
        CSR for every sparse format), also where it is slightly asymmetric.
    B : (rows n,) array, m/s
        The velocities that the impulses must cancel or reverse.
    friction : (n,) array
        Coulomb coefficient of each contact, not negative. Its length is the number of contacts n.

    Raises
    ------
    ProblemError
        When shapes do not fit each other, an entry is not finite, a friction coefficient or a diagonal entry of A is
        negative, or A differs from its transpose by more than 1e-2 of its largest entry.

    See Also
    --------
    from_jacobian : the same system from J and M⁻¹, which never forms A unless asked to.
    """

    def __init__(self, A: npt.ArrayLike | sp.sparray | sp.spmatrix, B: npt.ArrayLike, friction: npt.ArrayLike) -> None:
        self._start(B, friction)
        self._start_by_delassus(_checked_delassus(A, self.B.size))

    @classmethod
    def from_jacobian(
        cls,
        jacobian: npt.ArrayLike | sp.sparray | sp.spmatrix,
        inverse_mass: npt.ArrayLike | sp.sparray | sp.spmatrix,
        B: npt.ArrayLike,
        friction: npt.ArrayLike,
        *,
        free_velocity: npt.ArrayLike | None = None,
        whitened_blocks: npt.ArrayLike | None = None,
    ) -> StackedSystem:
        """Make the system from its factors, A = J M⁻¹ Jᵀ.

        Parameters
        ----------
        jacobian : (rows n, nv) array or scipy.sparse matrix
            J: body velocities to contact velocities of body b relative to body a, normal first and positive when
            separating. In SI units: rows are 1 for translations, m for rotations.
        inverse_mass : (nv,), (bodies, D, D) or (nv, nv) array or scipy.sparse matrix, 1/kg and 1/(kg m²)
            M⁻¹: its diagonal, or its blocks body by body, or the whole block-diagonal matrix; symmetric and positive
            semidefinite. A zero row locks that degree of freedom.
        B : (rows n,) array, m/s
        friction : (n,) array
        free_velocity : (nv,) array, m/s and rad/s, optional
            The body velocities before any contact impulse. Only the certificate's energy balance needs them.
        whitened_blocks : (blocks, rows, D) array, 1/√kg, optional
            The blocks of Ĵ = J L, M⁻¹ = L Lᵀ, in the order of those of J, where the caller has them; worked out
            otherwise.

        Raises
        ------
        ProblemError
            As the constructor, when M⁻¹ is not symmetric positive semidefinite, and when the rows of Ĵ have not the
            lengths that J and M⁻¹ give.
        """
        self = cls.__new__(cls)
        self._start(B, friction)
        self._A = None
        self.inverse_mass = freeze(_checked_inverse_mass(inverse_mass))
        bodies, body_size, _ = self.inverse_mass.shape
        self.jacobian = _checked_jacobian(jacobian, self.B.size, bodies * body_size, (self.rows, body_size))
        size = (bodies * body_size,)
        self.free_velocity = None if free_velocity is None else freeze(as_array("free_velocity", free_velocity, size))
        if whitened_blocks is not None:
            whitened_blocks = _checked_whitening(self.jacobian, self.inverse_mass, whitened_blocks)
        self._whitened_blocks = whitened_blocks
        return self

    @classmethod
    def from_checked(cls, A: Matrix, B: npt.ArrayLike, friction: npt.ArrayLike) -> StackedSystem:
        """Make the system from an A that was checked before it was scaled or cut, dense or CSR; it is kept, not copied.

        Small blocks of it may differ from their transpose by more than is allowed of the largest entry of all.
        """
        self = cls.__new__(cls)
        self._start(B, friction)
        if sp.issparse(A):
            A.sum_duplicates()
        freeze(A.data if sp.issparse(A) else A)
        self._start_by_delassus(A)
        return self

    def _start(self, B: npt.ArrayLike, friction: npt.ArrayLike) -> None:
        self.B: Array = freeze(as_array("B", B, (None,)))
        self.friction: Array = freeze(as_array("friction", friction, (None,)))
        require_at_least("friction", self.friction, 0.0)
        contacts, size = self.friction.size, self.B.size
        if size not in ((0,) if contacts == 0 else (contacts, 2 * contacts, 3 * contacts)):
            raise ProblemError(
                f"B has length {size} but friction has {contacts} contacts: B must hold 1, 2 or 3 rows per contact"
            )
        self.rows: int = size // contacts if contacts else 3

    def _start_by_delassus(self, A: Matrix) -> None:
        self._A: Matrix | None = A
        self.jacobian: sp.bsr_array | None = None
        self.inverse_mass: Array | None = None
        self.free_velocity: Array | None = None
        self._whitened_blocks: Array | None = None

    def __setattr__(self, name: str, value: object) -> None:
        """Refuse to change what has been set once: solvers and certificates rely on it."""
        if name in self.__dict__:
            raise AttributeError(f"a StackedSystem is immutable: {name} cannot be set")
        super().__setattr__(name, value)

    def __repr__(self) -> str:
        form = "A" if self.jacobian is None else f"J, M⁻¹ of {self.jacobian.shape[1]} velocities"
        return f"StackedSystem({self.contacts} contacts × {self.rows} rows, {form})"

    @property
    def contacts(self) -> int:
        """The number of contacts n."""
        return int(self.friction.size)

    @cached_property
    def A(self) -> Matrix:
        """The Delassus matrix, dense or CSR, 1/kg; formed on first use where the system carries J and M⁻¹."""
        if self._A is not None:
            return self._A
        assert self.whitened_jacobian is not None
        product = sp.csr_array(self.whitened_jacobian @ self._whitened_transpose)
        product.data.flags.writeable = False
        return product

    @cached_property
    def whitened_jacobian(self) -> sp.bsr_array | None:
        """Ĵ = J L with M⁻¹ = L Lᵀ, so that A = Ĵ Ĵᵀ; None where the system carries A alone. Unit: 1/√kg."""
        if self.jacobian is None or self.inverse_mass is None:
            return None
        data = self._whitened_blocks
        if data is None:
            factors = _semidefinite_factors(self.inverse_mass)
            data = np.einsum("krd,kde->kre", self.jacobian.data, factors[self.jacobian.indices])
        return sp.bsr_array((data, self.jacobian.indices, self.jacobian.indptr), shape=self.jacobian.shape)

    @cached_property
    def _whitened_transpose(self) -> sp.bsr_array:
        """Ĵᵀ, kept: scipy works a transpose out anew each time."""
        assert self.whitened_jacobian is not None
        return self.whitened_jacobian.T

    @cached_property
    def _operators(self) -> tuple[Matrix, ...]:
        """The matrices whose product is A, the first to be applied first; small ones dense, being quicker so."""
        factor = self.whitened_jacobian
        matrices = (self.A,) if factor is None else (self._whitened_transpose, factor)
        if self.B.size > SMALL or matrices[0].shape[0] > SMALL:
            return matrices
        return tuple(matrix.toarray() if sp.issparse(matrix) else matrix for matrix in matrices)

    @cached_property
    def scale(self) -> Array:
        """d_i = max diag(A_ii) of each contact, (n,), 1/kg: the contact's own measure of impulse to velocity."""
        return freeze(self.diagonal.reshape(self.contacts, self.rows).max(axis=1, initial=0.0))

    @cached_property
    def size(self) -> float:
        """‖B‖, m/s: the measure of velocity that makes residuals relative."""
        return float(np.linalg.norm(self.B))

    @cached_property
    def diagonal(self) -> Array:
        """The diagonal of A, (rows n,), 1/kg, without forming A."""
        if self.whitened_jacobian is None:
            return freeze(np.array(self.A.diagonal(), dtype=np.float64))
        factor = self.whitened_jacobian
        squares = np.square(factor.data).sum(axis=2)
        owner = np.repeat(np.arange(self.contacts), np.diff(factor.indptr))
        diagonal = np.zeros((self.contacts, self.rows))
        np.add.at(diagonal, owner, squares)
        return freeze(diagonal.ravel())

    def apply(self, impulse: Array) -> Array:
        """Return A p as (n, rows), m/s, for impulses of shape (n, rows), N s, without forming A."""
        product = impulse.reshape(-1)
        for matrix in self._operators:
            product = matrix @ product
        return np.asarray(product).reshape(self.contacts, self.rows)

    def velocity(self, impulse: Array) -> Array:
        """Return the contact velocities u = A p - B after the impulses, (n, rows), m/s."""
        return self.apply(impulse) - self.B.reshape(self.contacts, self.rows)

    def normalised(self) -> tuple[StackedSystem, Array]:
        """Return the same problem without units, and the factors (n,) that turn its impulses back into N s.

        With S = diag(1/√d_i), contact by contact, the problem A' = S A S, B' = S B / ‖S B‖ has unit diagonals and data
        of size one; p = ‖S B‖ S p'. The friction cones stay as they are. B must not be zero.
        """
        largest = float(self.scale.max())
        factors: Array = 1.0 / np.sqrt(np.where(self.scale > 0.0, self.scale, largest if largest > 0.0 else 1.0))
        rows = np.repeat(factors, self.rows)
        right = rows * self.B
        size = float(np.linalg.norm(right))
        if isinstance(self.A, np.ndarray):
            matrix: Matrix = rows[:, None] * self.A * rows
        else:
            weights = sp.dia_array((rows[None, :], [0]), shape=self.A.shape)
            matrix = sp.csr_array(weights @ self.A @ weights)
        return StackedSystem.from_checked(matrix, right / size, self.friction), size * factors

    def restricted(self, contacts: npt.NDArray[np.integer[Any]]) -> StackedSystem:
        """Return the system of these contacts alone, by its A: the impulses of the others are zero, and free."""
        rows = (self.rows * contacts[:, None] + np.arange(self.rows)).ravel()
        return StackedSystem.from_checked(self.A[np.ix_(rows, rows)], self.B[rows], self.friction[contacts])

    def body_velocity_change(self, impulse: Array) -> Array:
        """Return M⁻¹ Jᵀ p, (nv,), m/s and rad/s; needs the form with J and M⁻¹."""
        if self.jacobian is None or self.inverse_mass is None:
            raise ProblemError("the system carries A alone: body velocities need StackedSystem.from_jacobian")
        bodies, body_size, _ = self.inverse_mass.shape
        wrench = np.asarray(self.jacobian.T @ impulse.reshape(-1)).reshape(bodies, body_size)
        return np.asarray(np.einsum("bde,be->bd", self.inverse_mass, wrench)).reshape(-1)


def _checked_delassus(A: Any, size: int) -> Matrix:
    matrix: Matrix
    if sp.issparse(A):
        matrix = sp.csr_array(A, dtype=np.float64, copy=True)
        matrix.sum_duplicates()
        entries = matrix.data
    else:
        matrix = as_array("A", A, (None, None))
        entries = matrix
    if matrix.shape != (size, size):
        raise ProblemError(f"A has shape {matrix.shape} but B has length {size}: A must be {size} x {size}")
    if sp.issparse(A) and not np.isfinite(entries).all():
        coo = matrix.tocoo()
        at = int(np.argmin(np.isfinite(coo.data)))
        raise ProblemError(f"A[{coo.row[at]}, {coo.col[at]}] is {coo.data[at]}: every entry must be finite")
    diagonal = matrix.diagonal()
    if (diagonal < 0).any():
        at = int(np.argmax(diagonal < 0))
        raise ProblemError(f"A[{at}, {at}] is {diagonal[at]:g}: the diagonal of a Delassus matrix is not negative")
    largest = float(np.abs(entries).max(initial=0.0))
    skew = abs(matrix - matrix.T)
    asymmetry = float(skew.max()) if size else 0.0
    if asymmetry > ASYMMETRY_LIMIT * largest:
        row, column = divmod(int((skew.toarray() if sp.issparse(skew) else skew).argmax()), size)
        raise ProblemError(
            f"A is not symmetric: A[{row}, {column}] and A[{column}, {row}] differ by {asymmetry:g}, "
            f"more than {ASYMMETRY_LIMIT:g} of the largest entry {largest:g}"
        )
    freeze(entries)
    return matrix


def _checked_inverse_mass(value: Any) -> Array:
    """Return M⁻¹ as (bodies, D, D) blocks; D is the smallest block size that the matrix has."""
    if sp.issparse(value):
        matrix = sp.coo_array(value)
        if matrix.shape[0] != matrix.shape[1]:
            raise ProblemError(f"inverse_mass has shape {matrix.shape}: it must be square")
        size = matrix.shape[0]
        require_finite("inverse_mass.data", matrix.data)
        block = _block_size(matrix.row, matrix.col, size)
        blocks = np.zeros((size // block, block, block))
        np.add.at(blocks, (matrix.row // block, matrix.row % block, matrix.col % block), matrix.data)
    else:
        array = np.asarray(value)
        if array.ndim == 1:
            blocks = as_array("inverse_mass", value, (None,)).reshape(-1, 1, 1)
        elif array.ndim == 3:
            blocks = as_array("inverse_mass", value, (None, array.shape[1], array.shape[1]))
        else:
            dense = as_array("inverse_mass", value, (None, array.shape[0] if array.ndim else None))
            return _checked_inverse_mass(sp.coo_array(dense))
    diagonal = np.einsum("bdd->bd", blocks)
    if (diagonal < 0).any():
        body, axis = (int(i) for i in np.argwhere(diagonal < 0)[0])
        raise ProblemError(
            f"inverse_mass of block {body}, axis {axis} is {diagonal[body, axis]:g}: masses must not be negative"
        )
    scale = np.abs(blocks).max(axis=(1, 2), initial=0.0)
    asymmetry = np.abs(blocks - blocks.transpose(0, 2, 1)).max(axis=(1, 2), initial=0.0)
    if (asymmetry > 1e-9 * scale).any():
        body = int(np.argmax(asymmetry > 1e-9 * scale))
        raise ProblemError(f"inverse_mass of block {body} differs from its transpose by {asymmetry[body]:g}")
    blocks = 0.5 * (blocks + blocks.transpose(0, 2, 1))
    if blocks.shape[1] > 1 and blocks.size:
        lowest = np.linalg.eigvalsh(blocks)[:, 0]
        if (lowest < -1e-9 * scale).any():
            body = int(np.argmax(lowest < -1e-9 * scale))
            raise ProblemError(
                f"inverse_mass of block {body} has the eigenvalue {lowest[body]:g}: it must be positive semidefinite"
            )
    return blocks


def _block_size(row: npt.NDArray[Any], column: npt.NDArray[Any], size: int) -> int:
    return next(
        (block for block in range(1, size) if size % block == 0 and (row // block == column // block).all()),
        max(size, 1),
    )


def _checked_jacobian(jacobian: Any, rows: int, columns: int, blocksize: tuple[int, int]) -> sp.bsr_array:
    if not sp.issparse(jacobian):
        jacobian = as_array("jacobian", jacobian, (None, None))
    if jacobian.shape != (rows, columns):
        raise ProblemError(
            f"jacobian has shape {jacobian.shape}, but B has length {rows} and inverse_mass {columns} velocities: "
            f"it must be {rows} x {columns}"
        )
    if rows == 0 or columns == 0:
        nothing = (np.zeros((0, *blocksize)), np.zeros(0, np.int32), np.zeros(rows // blocksize[0] + 1, np.int32))
        return sp.bsr_array(nothing, shape=(rows, columns))
    blocks = sp.bsr_array(jacobian, dtype=np.float64, blocksize=blocksize, copy=True)
    blocks.sum_duplicates()
    if not np.isfinite(blocks.data).all():
        block, row, column = (int(i) for i in np.argwhere(~np.isfinite(blocks.data))[0])
        contact = int(np.searchsorted(blocks.indptr, block, side="right")) - 1
        at = (contact * blocksize[0] + row, int(blocks.indices[block]) * blocksize[1] + column)
        raise ProblemError(
            f"jacobian[{at[0]}, {at[1]}] is {blocks.data[block, row, column]}: every entry must be finite"
        )
    blocks.data.flags.writeable = False
    return blocks


def _checked_whitening(jacobian: sp.bsr_array, inverse_mass: Array, value: npt.ArrayLike) -> Array:
    if not jacobian.data.size:
        return freeze(np.zeros(jacobian.data.shape))
    blocks = as_array("whitened_blocks", value, jacobian.data.shape)
    wanted = np.einsum("krd,kde,kre->kr", jacobian.data, inverse_mass[jacobian.indices], jacobian.data)
    found = np.einsum("kre,kre->kr", blocks, blocks)
    wrong = np.abs(found - wanted) > 1e-9 * wanted.max(initial=0.0)
    if wrong.any():
        block, row = (int(i) for i in np.argwhere(wrong)[0])
        raise ProblemError(
            f"row {row} of whitened_blocks[{block}] has the square {found[block, row]:g}, "
            f"but J and M⁻¹ give {wanted[block, row]:g}"
        )
    return freeze(blocks)


def _semidefinite_factors(blocks: Array) -> Array:
    """Return the lower L of each symmetric positive semidefinite block, block = L Lᵀ; a locked axis gives zeros.

    Cholesky's, so that velocities that no mass couples, such as translations and rotations, are not mixed.
    """
    factors, rest = np.zeros_like(blocks), blocks.copy()
    for k in range(blocks.shape[1]):
        pivot = rest[:, k, k]
        # What is left of a row that depends on those before it is rounding.
        left = pivot > DEPENDENT * blocks[:, k, k]
        factors[left, k:, k] = rest[left, k:, k] / np.sqrt(pivot[left])[:, None]
        rest -= factors[:, :, k, None] * factors[:, None, :, k]
    return factors

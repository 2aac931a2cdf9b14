"""Linearised equations: a matrix and its factors, or products and GMRES."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from scipy import linalg
from scipy.sparse.linalg import LinearOperator, gmres

from .problem import Lost

# GMRES: residual relative to the right side, vectors kept, restarts.
KRYLOV, KEPT, RESTARTS = 1e-8, 200, 3


class Dense:
    """Equations as a matrix (n, n + 1)."""

    def __init__(self, matrix: np.ndarray):
        self.matrix, self.rows = matrix, len(matrix)

    def bordered(self, row: np.ndarray) -> DenseBorder:
        """See `problem.Linear`."""
        return DenseBorder(self.matrix, row)

    def mixed(self, others: Sequence[Any], weights: Sequence[float]) -> Dense:
        """See `problem.Linear`."""
        return Dense(np.tensordot(weights, [other.matrix for other in others], 1))


class Factors:
    """LU factors of a square matrix.

    Attributes
    ----------
    sign : float
        Of the determinant.

    Raises
    ------
    Lost
        If it is singular.
    """

    def __init__(self, matrix: np.ndarray):
        self._factors, self._exchanged, singular = linalg.lapack.dgetrf(matrix)
        if singular:
            raise Lost(f"solutions are not isolated: pivot {singular} of {len(matrix)} is zero")
        # each exchange of rows turns the determinant
        turned = (self._exchanged != np.arange(len(matrix))).sum() + (np.diagonal(self._factors) < 0.0).sum()
        self.sign: float | None = -1.0 if turned % 2 else 1.0

    def solve(self, right: np.ndarray) -> np.ndarray:
        """The inverse times a right side."""
        return linalg.lapack.dgetrs(self._factors, self._exchanged, right)[0]


class DenseBorder(Factors):
    """LU factors of a bordered matrix, whose border is made as large as the other rows."""

    def __init__(self, matrix: np.ndarray, row: np.ndarray):
        self.size = float(np.abs(matrix).max(initial=0.0)) / max(float(np.abs(row).max()), 1e-300) or 1.0
        super().__init__(np.vstack([matrix, self.size * row]))

    def solve(self, right: np.ndarray) -> np.ndarray:
        """See `problem.Border`."""
        right = right.copy()
        right[-1] *= self.size
        return super().solve(right)


class Krylov:
    """Equations as products: along the first n unknowns, with a column for the last one.

    Parameters
    ----------
    products : callable
        (n,) -> (n,).
    column : (n,) array
    nearby : callable
        (n,) -> (n,): the inverse of products that are near these, for preconditioning.
    size : float
        Unit of the first unknowns over that of a border's value.
    """

    def __init__(
        self,
        products: Callable[[np.ndarray], np.ndarray],
        column: np.ndarray,
        nearby: Callable[[np.ndarray], np.ndarray],
        size: float,
    ):
        self.products, self.column, self.nearby, self.size = products, column, nearby, size
        self.rows = len(column)

    def bordered(self, row: np.ndarray) -> KrylovBorder:
        """See `problem.Linear`."""
        return KrylovBorder(self, self.size * row)

    def mixed(self, others: Sequence[Any], weights: Sequence[float]) -> Krylov:
        """See `problem.Linear`."""
        return self


class KrylovBorder:
    """GMRES on bordered products, preconditioned by the bordered inverse nearby."""

    sign: float | None = None

    def __init__(self, linear: Krylov, row: np.ndarray):
        self.linear, self.row = linear, row
        self.column = linear.nearby(linear.column)

    def solve(self, right: np.ndarray) -> np.ndarray:
        """See `problem.Border`."""
        n, row, linear = self.linear.rows, self.row, self.linear
        right = np.append(right[:-1], linear.size * right[-1])

        def near(r: np.ndarray) -> np.ndarray:
            x = linear.nearby(r[:n])
            last = (r[n] - row[:n] @ x) / (row[n] - row[:n] @ self.column)
            return np.append(x - last * self.column, last)

        def product(r: np.ndarray) -> np.ndarray:
            z = near(r)
            return np.append(linear.products(z[:n]) + z[n] * linear.column, row @ z)

        operator = LinearOperator((n + 1, n + 1), product)
        found, failed = gmres(operator, right, rtol=KRYLOV, restart=min(n + 1, KEPT), maxiter=RESTARTS)
        if failed:
            raise Lost("the linear system of Newton's method was not solved")
        return near(found)


class Cyclic:
    """Equations D_k x_k - x_(k+1) + c_k v, cyclic in k, of n unknowns x_k each and a last one, v.

    Parameters
    ----------
    blocks : (count, n, n) array
        D_k.
    column : (count, n) array
        c_k.
    """

    def __init__(self, blocks: np.ndarray, column: np.ndarray):
        self.blocks, self.column, self.rows = blocks, column, column.size

    def bordered(self, row: np.ndarray) -> CyclicBorder:
        """See `problem.Linear`."""
        return CyclicBorder(self, row)

    def mixed(self, others: Sequence[Any], weights: Sequence[float]) -> Cyclic:
        """See `problem.Linear`."""
        return Cyclic(
            np.tensordot(weights, [other.blocks for other in others], 1),
            np.tensordot(weights, [other.column for other in others], 1),
        )


class CyclicBorder:
    """Condensed to the first block's unknowns and the last one by orthogonal transformations, which multiply
    no derivatives (S. J. Wright, SIAM J. Sci. Stat. Comput. 13, 742, 1992).
    """

    def __init__(self, linear: Cyclic, row: np.ndarray):
        self.shape = count, n = linear.column.shape
        self.size = float(np.abs(linear.blocks).max()) / max(float(np.abs(row).max()), 1e-300)
        border = self.size * row
        # A x_0 + B x_k + c v = f for the blocks up to k; one after the other x_k is eliminated
        first, last, column = linear.blocks[0], -np.eye(n), linear.column[0]
        self._kept: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = []
        for block, beside in zip(linear.blocks[1:], linear.column[1:]):
            q, r = np.linalg.qr(np.concatenate([last, block]), mode="complete")
            rows = np.zeros((2 * n, 2 * n + 1))
            rows[:n, :n], rows[:n, -1] = first, column
            rows[n:, n:-1], rows[n:, -1] = -np.eye(n), beside
            rows = q.T @ rows
            # x_k = -r^-1 (of x_0 and v, of x_(k+1))
            self._kept.append((q, r[:n], rows[:n]))
            first, last, column = rows[n:, :n], rows[n:, n:-1], rows[n:, -1]
        # all unknowns by x_0 and v
        following = np.eye(n, n + 1)
        self._shares = np.zeros((count, n, n + 1))
        self._shares[0] = following
        for k in range(count - 1, 0, -1):
            _, upper, rows = self._kept[k - 1]
            of_first = np.column_stack([rows[:, :n], rows[:, -1]])
            following = linalg.solve_triangular(upper, -of_first - rows[:, n:-1] @ following)
            self._shares[k] = following
        self._blocks = border[:-1].reshape(count, n)
        whole = np.zeros((n + 1, n + 1))
        whole[:n, :n], whole[:n, n] = first + last, column
        whole[n] = np.einsum("ki,kij->j", self._blocks, self._shares)
        whole[n, n] += border[-1]
        self._condensed = Factors(whole)
        # the transformations' own determinants are the same for all matrices of these sizes
        turned = sum(int((np.diagonal(upper) < 0.0).sum()) for _, upper, _ in self._kept)
        self.sign: float | None = (self._condensed.sign or 1.0) * (-1.0) ** turned

    def solve(self, right: np.ndarray) -> np.ndarray:
        """See `problem.Border`."""
        count, n = self.shape
        missed, result = right[:-1].reshape(count, n), np.zeros((count, n))
        carried, kept = missed[0], []
        for (q, _, _), miss in zip(self._kept, missed[1:]):
            turned = q.T @ np.append(carried, miss)
            kept.append(turned[:n])
            carried = turned[n:]
        for k in range(count - 1, 0, -1):
            _, upper, rows = self._kept[k - 1]
            following = result[k + 1] if k + 1 < count else 0.0 * carried
            result[k] = linalg.solve_triangular(upper, kept[k - 1] - rows[:, n:-1] @ following)
        told = self.size * right[-1] - float((self._blocks * result).sum())
        found = self._condensed.solve(np.append(carried, told))
        return np.append((result + self._shares @ found).ravel(), found[-1])

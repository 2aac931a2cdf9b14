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

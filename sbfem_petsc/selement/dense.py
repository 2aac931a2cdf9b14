"""LAPACK on small dense matrices without SciPy's checks, which cost more than the factorisations of an
S-element.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.linalg import lapack

from .coefficients import SElementError

_BLOCK = 24
ADVICE = "use a lower order, fewer terms or split the cell"


def _require(info: int, what: str) -> None:
    """`SElementError` where LAPACK has failed."""
    if info != 0:
        raise SElementError(f"{what}; {ADVICE}")


def cholesky(matrix: np.ndarray, what: str) -> np.ndarray:
    """Lower Cholesky factor, or an `SElementError` that names what is not positive definite (round-off: a
    wrong model).
    """
    factor, info = lapack.dpotrf(matrix, lower=1, clean=1)
    _require(info, f"the {what} is not positive definite")
    return factor


def is_definite(matrix: np.ndarray) -> bool:
    """Whether a Cholesky factor exists."""
    return bool(lapack.dpotrf(matrix, lower=1, clean=0)[1] == 0)


def cholesky_solve(factor: np.ndarray, right: np.ndarray) -> np.ndarray:
    """(L L^T)^-1 right."""
    return lapack.dpotrs(factor, right, lower=1)[0]


def lower_solve(factor: np.ndarray, right: np.ndarray, transposed: bool = False) -> np.ndarray:
    """L^-1 right, or L^-T right."""
    return lapack.dtrtrs(factor, right, lower=1, trans=int(transposed))[0]


def upper_factor(matrix: np.ndarray, what: str) -> np.ndarray:
    """Upper triangular X with X X^T = matrix, or an `SElementError` as by `cholesky`."""
    return np.asfortranarray(cholesky(matrix[::-1, ::-1], what)[::-1, ::-1])


def upper_solve(triangle: np.ndarray, right: np.ndarray) -> np.ndarray:
    """X^-1 right, X upper triangular."""
    return lapack.dtrtrs(triangle, right)[0]


def solve(matrix: np.ndarray, right: np.ndarray) -> np.ndarray:
    """matrix^-1 right."""
    _, _, solution, info = lapack.dgesv(matrix, right)
    _require(info, "a linear system of the S-element is singular")
    return solution


class SchurForm(NamedTuple):
    """Real Schur form of Q T Q^T: T (n, n) quasi upper triangular, Q (n, n) orthogonal."""

    triangle: np.ndarray
    vectors: np.ndarray


def schur(matrix: np.ndarray) -> SchurForm:
    """Real Schur form of a matrix."""
    triangle, _, _, _, vectors, _, info = lapack.dgees(lambda re, im: False, matrix)
    _require(info, "the Schur form of the S-element did not converge")
    return SchurForm(triangle, vectors)


def reordered(form: SchurForm, chosen: np.ndarray) -> tuple[SchurForm, int]:
    """A real Schur form whose chosen eigenvalues (n,) bool stand first, and their number."""
    triangle, vectors, _, _, count, _, _, info = lapack.dtrsen(chosen, *form, job="N")
    _require(info, "radial modes of the S-element are too close to be told apart")
    return SchurForm(triangle, vectors), int(count)


def growing_subspace(matrix: np.ndarray) -> tuple[np.ndarray, int]:
    """Schur vectors ordered with Re(eigenvalue) > 0 first, and the number of these eigenvalues."""
    _, count, _, _, vectors, _, info = lapack.dgees(lambda re, im: re > 0.0, matrix, sort_t=1)
    if info != len(matrix) + 2:  # which tells of rounding alone
        _require(info, f"the ordered Schur form of the S-element failed (LAPACK info {info})")
    return vectors, int(count)


def lyapunov(triangle: np.ndarray, shift: float, right: np.ndarray) -> np.ndarray:
    """Symmetric Y with (T + shift I) Y + Y (T + shift I)^T = right, T quasi upper triangular."""
    shifted = triangle.copy(order="F")
    shifted.reshape(-1, order="A")[:: len(shifted) + 1] += shift
    solution = np.array(right)
    _solve_triangular(shifted, solution)
    return symmetric(solution)


def _solve_triangular(triangle: np.ndarray, right: np.ndarray) -> None:
    """Symmetric Y with T Y + Y T^T = right in the place of `right`, T quasi upper triangular.

    LAPACK's dtrsyl works entry by entry and knows no symmetry: halves leave it three small blocks and the
    rest to products.
    """
    n = len(triangle)
    if n <= _BLOCK:
        right[:] = _sylvester(triangle, triangle, right)
        return
    k = n // 2
    if triangle[k, k - 1] != 0.0:  # not between the rows of a complex pair
        k += 1
    upper, lower, mixed = triangle[:k, :k], triangle[k:, k:], triangle[:k, k:]
    _solve_triangular(lower, right[k:, k:])
    corner = _sylvester(upper, lower, right[:k, k:] - mixed @ right[k:, k:])
    right[:k, k:], right[k:, :k] = corner, corner.T
    product = mixed @ corner.T
    right[:k, :k] -= product + product.T
    _solve_triangular(upper, right[:k, :k])


def _sylvester(first: np.ndarray, second: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Y with first Y + Y second^T = right, both quasi upper triangular."""
    solution, scale, info = lapack.dtrsyl(first, second, right, tranb="T")
    _require(info, "a Lyapunov equation of the S-element is singular")
    return solution / scale


def separation(first: np.ndarray, second: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Y with first Y - Y second = right, both quasi upper triangular with eigenvalues of their own."""
    solution, scale, info = lapack.dtrsyl(first, second, right, isgn=-1)
    _require(info, "the singular modes of the S-element do not separate from the others")
    return solution / scale


def symmetric_eigen(matrix: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Ascending eigenvalues and orthonormal eigenvectors of a symmetric matrix."""
    values, vectors, info = lapack.dsyevd(matrix)
    _require(info, "an eigenvalue problem of the S-element did not converge")
    return values, vectors


def turned(matrix: np.ndarray) -> np.ndarray:
    """The transpose of a matrix, or of each of many."""
    return matrix.swapaxes(-1, -2)


def symmetric(matrix: np.ndarray) -> np.ndarray:
    """(matrix + matrix^T) / 2 of a matrix, or of each of many."""
    result = matrix + turned(matrix)
    result *= 0.5
    return result


def largest(matrix: np.ndarray) -> float:
    """Largest absolute entry."""
    return float(np.abs(matrix).max())

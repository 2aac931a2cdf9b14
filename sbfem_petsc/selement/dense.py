"""LAPACK on small dense matrices without SciPy's checks, which cost more than the factorisations of an
S-element.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import lapack

from .coefficients import SElementError

ADVICE = "use a lower order, fewer terms or split the cell"


def cholesky(matrix: np.ndarray, what: str) -> np.ndarray:
    """Lower Cholesky factor, or an `SElementError` that names what is not positive definite (round-off: a
    wrong model).
    """
    factor, info = lapack.dpotrf(matrix, lower=1, clean=1)
    if info != 0:
        raise SElementError(f"the {what} is not positive definite; {ADVICE}")
    return factor


def cholesky_solve(factor: np.ndarray, right: np.ndarray) -> np.ndarray:
    """(L L^T)^-1 right."""
    return lapack.dpotrs(factor, right, lower=1)[0]


def lower_solve(factor: np.ndarray, right: np.ndarray) -> np.ndarray:
    """L^-1 right."""
    return lapack.dtrtrs(factor, right, lower=1)[0]


def solve(matrix: np.ndarray, right: np.ndarray) -> np.ndarray:
    """matrix^-1 right."""
    _, _, solution, info = lapack.dgesv(matrix, right)
    if info != 0:
        raise SElementError(f"a linear system of the S-element is singular; {ADVICE}")
    return solution


def schur(matrix: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Real Schur form (T, Q), matrix = Q T Q^T."""
    triangle, _, _, _, vectors, _, info = lapack.dgees(lambda re, im: False, matrix)
    if info != 0:
        raise SElementError(f"the Schur form of the S-element did not converge; {ADVICE}")
    return triangle, vectors


def growing_subspace(matrix: np.ndarray) -> tuple[np.ndarray, int]:
    """Schur vectors ordered with Re(eigenvalue) > 0 first, and the number of these eigenvalues."""
    _, count, _, _, vectors, _, info = lapack.dgees(lambda re, im: re > 0.0, matrix, sort_t=1)
    if info not in (0, len(matrix) + 2):
        raise SElementError(f"the ordered Schur form of the S-element failed (LAPACK info {info}); {ADVICE}")
    return vectors, int(count)


def lyapunov(schur_form: tuple[np.ndarray, np.ndarray], shift: float, right: np.ndarray) -> np.ndarray:
    """Symmetric Y with (U + shift I) Y + Y (U + shift I)^T = right, from the real Schur form (T, Q) of U."""
    triangle, basis = schur_form
    shifted = triangle.copy(order="F")
    shifted.reshape(-1, order="A")[:: len(shifted) + 1] += shift
    solution, scale, info = lapack.dtrsyl(shifted, shifted, basis.T @ right @ basis, tranb="T")
    if info != 0:
        raise SElementError(f"a Lyapunov equation of the S-element is singular; {ADVICE}")
    return symmetric(basis @ (solution / scale) @ basis.T)


def symmetric_eigen(matrix: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Ascending eigenvalues and orthonormal eigenvectors of a symmetric matrix."""
    values, vectors, info = lapack.dsyevd(matrix)
    if info != 0:
        raise SElementError(f"an eigenvalue problem of the S-element did not converge; {ADVICE}")
    return values, vectors


def orthogonal_complement(vectors: np.ndarray) -> np.ndarray:
    """Orthonormal basis (n, n - rank) of the complement of the two columns of `vectors` (n, 2)."""
    ordered = vectors if vectors[:, 0] @ vectors[:, 0] >= vectors[:, 1] @ vectors[:, 1] else vectors[:, ::-1]
    basis, triangle = np.linalg.qr(ordered, mode="complete")
    diagonal = np.abs(triangle.diagonal())
    return basis[:, int((diagonal > 1e-8 * max(diagonal[0], 1.0)).sum()) :]


def symmetric(matrix: np.ndarray) -> np.ndarray:
    """(matrix + matrix^T) / 2."""
    return 0.5 * (matrix + matrix.T)


def largest(matrix: np.ndarray) -> float:
    """Largest absolute entry."""
    return float(np.abs(matrix).max())

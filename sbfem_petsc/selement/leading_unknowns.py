"""Auxiliary unknowns of an S-element that matter up to a frequency."""

from __future__ import annotations

import numpy as np

from .dense import cholesky, lower_solve, symmetric_eigen
from .inertia import Moments
from .solution import SElement

# Tolerances of auxiliary unknowns down to which they are found from moments: squares lose half of the digits.
_BY_MOMENTS, _NOTHING = 1e-9, 1e-10


def reduced_fraction(
    solution: SElement, w2: float, tolerance: float, terms: int
) -> tuple[np.ndarray, np.ndarray]:
    """C (n, r) and J (r,) of the auxiliary unknowns that matter up to omega^2 rho h^2 / E = `w2`.

    Parameters
    ----------
    solution : SElement
        With its inertia.
    w2 : float
    tolerance : float
        What those left out contribute at most, relative to the strain and kinetic energy there; 0: none is.
    terms : int
        Of the continued fraction.
    """
    if tolerance >= _BY_MOMENTS and isinstance(solution.dynamics, Moments):
        return _leading(solution.stiffness, solution.dynamics, w2, tolerance)
    if tolerance > 0.0 and solution.coupling.shape[1]:
        return _project(solution, w2, tolerance, terms)
    return solution.coupling, solution.inertia


def _leading(
    stiffness: np.ndarray, dynamics: Moments, w2: float, tolerance: float
) -> tuple[np.ndarray, np.ndarray]:
    """As `_project`, of one term, from C C' and C J C': the left singular vectors are eigenvectors of
    w2^2 L^-1 C C' L^-T.
    """
    lower = cholesky(stiffness + w2 * dynamics.mass, "dynamic stiffness of an S-element")
    half = w2 * lower_solve(lower, dynamics.second)  # w2 L^-1 C C'
    values, vectors = _kept(w2 * lower_solve(lower, half.T), tolerance)
    if not len(values):
        return half[:, :0], values
    # one that is there for the even number alone may be nothing but round-off, which must have some mass
    scaled = vectors / np.sqrt(np.maximum(values, _NOTHING * values[-1]))
    weights = w2 * lower_solve(lower, scaled, transposed=True)
    inertia, modes = symmetric_eigen(weights.T @ dynamics.third @ weights)
    return half.T @ scaled @ modes, np.maximum(inertia, _NOTHING * inertia[-1])


def _kept(gram: np.ndarray, tolerance: float) -> tuple[np.ndarray, np.ndarray]:
    """Eigenvalues above a tolerance and their eigenvectors, an even number, as of displacements: matrices
    then consist of blocks of two.
    """
    if gram.trace() <= tolerance:
        return np.empty(0), np.empty((len(gram), 0))
    values, vectors = symmetric_eigen(gram)
    kept = int((values > tolerance).sum())
    first = len(values) - kept - kept % 2
    return values[first:], vectors[:, first:]


def _project(solution: SElement, w2: float, tolerance: float, terms: int) -> tuple[np.ndarray, np.ndarray]:
    """Coupling (n, r) and inertia (r,) of the auxiliary unknowns that matter up to omega^2 rho h^2 / E =
    `w2`.

    C touches the first term of the continued fraction alone; the later terms act through J. With w2 J = W the
    expansion C (1 - W)^-1 C' = C C' + C W C' + ... reaches term k by W^(k-1) C', so that many blocks are
    stacked before the singular vectors are taken.
    """
    lower = cholesky(solution.stiffness + w2 * solution.mass, "dynamic stiffness of an S-element")
    block = w2 * lower_solve(lower, solution.coupling)
    gram = block.T @ block
    for _ in range(terms - 1):
        block = block * (w2 * solution.inertia)
        gram = gram + block.T @ block
    _, basis = _kept(gram, tolerance)
    inertia, modes = (
        symmetric_eigen((basis.T * solution.inertia) @ basis)
        if basis.shape[1]
        else (solution.inertia[:0], np.zeros((0, 0)))
    )
    return solution.coupling @ (basis @ modes), inertia

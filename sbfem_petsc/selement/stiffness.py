"""Static stiffness of an S-element from its coefficient matrices.

With F = E0^-1 the stiffness K solves the Riccati equation ``(K - E1) F (K - E1^T) - E2 = 0`` such that the
radial modes grow with xi: all eigenvalues of ``A = F (K - E1^T)`` but the zeros of the two translations have
positive real parts. The translations R are deflated exactly (E1^T R = 0, E2 R = 0 and K R = 0); on their
complement P the equation is ``a^T X + X a - X g X + q = 0`` with X = P^T K P.

Structure-preserving doubling (Chu, Fan, Lin 2005) solves it by products and linear systems alone and keeps
the symmetry. Where it does not reach round-off the invariant subspace of an ordered real Schur form is taken,
never eigenvectors: the radial modes are nearly dependent.

Where polynomial modes are known (`polynomial_modes`), with K V = Y on an orthonormal basis V of them, the
same is done on their complement W, with K0 = Y V^T + V Y^T W W^T in the place of zero:
``a = -W^T F (K0 - E1^T) W`` and ``q = W^T (E2 - (K0 - E1) F (K0 - E1^T)) W``.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.linalg import lapack

from .coefficients import Coefficients, SElementError
from .dense import (
    ADVICE,
    cholesky_solve,
    growing_subspace,
    largest,
    norm,
    orthogonal_complement,
    solve,
    symmetric,
)
from .polynomial_modes import PolynomialModes

# Doubling converges quadratically: an increment below this is followed by one below round-off. From 1 to 400
# unknowns it takes 4 to 14 steps; its residual is 1e-15 to 1e-13, and beyond ACCEPTED the Schur form is
# asked.
_INCREMENT, _STEPS, ACCEPTED = 1e-9, 30, 1e-12


def static_stiffness(
    coefficients: Coefficients, factor: np.ndarray, translations: np.ndarray, method: str | None = None
) -> tuple[np.ndarray, float]:
    """K, and its relative asymmetry before the symmetrisation.

    Parameters
    ----------
    coefficients : Coefficients
    factor : (n, n) array
        Lower Cholesky factor of E0.
    translations : (n, 2) array
        The two translations, or their parts in an invariant subspace.
    method : {"doubling", "schur"}, optional
        Default: doubling, and the Schur form where the residual of doubling is not at round-off.

    Raises
    ------
    SElementError
        If the radial modes cannot be separated.
    """
    complement = orthogonal_complement(translations)
    inverse = cholesky_solve(factor, complement)  # F P
    inverse_e1 = cholesky_solve(factor, coefficients.e1.T @ complement)  # F E1' P
    a = complement.T @ inverse_e1
    g = complement.T @ inverse
    q = complement.T @ (coefficients.e2 @ complement - coefficients.e1 @ inverse_e1)
    reduced = None if method == "schur" else _doubling(a, symmetric(g), symmetric(q))
    if reduced is None:
        if method == "doubling":
            raise SElementError(f"structured doubling did not converge; {ADVICE}")
        reduced = _invariant_subspace(a, g, q)
    return complement @ symmetric(reduced) @ complement.T, largest(reduced - reduced.T) / largest(reduced)


def stiffness_beyond(
    coefficients: Coefficients, factor: np.ndarray, known: PolynomialModes
) -> tuple[np.ndarray, float] | None:
    """K, and its relative asymmetry, from what it does to the polynomial modes and by doubling on the rest;
    None where that does not reach round-off.
    """
    rest, forces = known.rest, known.forces
    if rest.shape[1] == 0:
        reduced, mixed = np.zeros((0, 0)), np.zeros((len(known.basis[0]), 0))
    else:
        mixed = forces.T @ rest  # V^T K W
        right = known.basis @ mixed - coefficients.e1.T @ rest  # (K0 - E1^T) W
        solved = cholesky_solve(factor, np.concatenate([rest, right], axis=1))
        inverse, inverse_right = solved[:, : rest.shape[1]], solved[:, rest.shape[1] :]
        q = rest.T @ (coefficients.e2 @ rest) - right.T @ inverse_right
        found = _doubling(-(rest.T @ inverse_right), symmetric(rest.T @ inverse), symmetric(q), True)
        if found is None:
            return None
        reduced = found
    half = known.basis.T @ forces  # V^T K V
    both = forces @ known.basis.T
    both += (known.basis @ mixed + rest @ reduced) @ rest.T
    return symmetric(both), largest(half - half.T) / largest(half)


def _doubling(a: np.ndarray, g: np.ndarray, q: np.ndarray, high: bool = False) -> np.ndarray | None:
    """X by structured doubling, or None where it fails or its residual is above round-off; `high`: the lowest
    radial exponents are none of the problem.
    """
    m = len(a)
    identity = np.eye(m)
    # The eigenvalues are the radial exponents, from 1/2 or 1 to a few times their root mean square, which
    # the trace of the squared Hamiltonian gives; the shift lies in the geometric middle, which is about that
    # mean without the lowest ones.
    mean_square = float(abs((a * a.T).sum() + (g * q).sum())) / m
    shift = math.sqrt(mean_square) if high else 2.0 * mean_square**0.25
    for _ in range(4):
        inverse, info = _inverse(a - shift * identity)
        # an eigenvalue of a near the shift costs digits though it is none of the problem
        if info == 0 and shift * largest(inverse) < 50.0:
            break
        shift *= 1.5
    gain = inverse @ g
    other, info = _inverse((a - shift * identity).T + q @ gain)
    if info != 0:
        return None
    # The transpose of the step is kept: what LAPACK is handed then lies column by column, and is not copied.
    turned = identity + (2.0 * shift) * other
    dual = symmetric((2.0 * shift) * (gain @ other))
    x = symmetric((2.0 * shift) * (other @ (q @ inverse)))
    for _ in range(_STEPS):
        both = np.concatenate([turned, dual])
        matrix = x @ dual
        matrix.reshape(-1)[:: m + 1] += 1.0
        _, _, solution, info = lapack.dgesv(matrix.T, both.T, overwrite_a=1, overwrite_b=1)
        if info != 0:
            return None
        half, rest = solution.T[:m], solution.T[m:]
        increment = (turned @ x) @ half.T
        x = x + increment
        if norm(increment) <= _INCREMENT * norm(x):
            break
        dual = dual + (turned.T @ rest.T) @ turned
        turned = half @ turned
    else:
        return None
    x = symmetric(x)
    product = x @ a
    residual = largest(product + product.T - x @ g @ x + q)
    return x if residual <= ACCEPTED * max(largest(q), largest(product)) else None


def _inverse(matrix: np.ndarray) -> tuple[np.ndarray, int]:
    """Inverse by LAPACK, and its info."""
    _, _, inverse, info = lapack.dgesv(matrix, np.eye(len(matrix)))
    return inverse, info


def _invariant_subspace(a: np.ndarray, g: np.ndarray, q: np.ndarray) -> np.ndarray:
    """X from the invariant subspace of the growing modes of the Hamiltonian [[-a, g], [q, a^T]]."""
    m = len(a)
    hamiltonian = np.empty((2 * m, 2 * m), order="F")
    hamiltonian[:m, :m], hamiltonian[:m, m:] = -a, g
    hamiltonian[m:, :m], hamiltonian[m:, m:] = q, a.T
    vectors, growing = growing_subspace(hamiltonian)
    if growing != m:
        raise SElementError(f"{growing} growing radial modes instead of {m}; {ADVICE}")
    return solve(vectors[:m, :m].T, vectors[m:, :m].T).T

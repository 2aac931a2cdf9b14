"""Eigenvalues of a product of matrices without the product, in whose rounding small ones are lost.

Orthogonal Q_k and triangular R_k with F_k Q_(k-1) = Q_k R_k are carried through all factors, and again from
the last Q: subspaces of eigenvalues of different moduli part (F. L. Bauer, Z. Angew. Math. Phys. 8, 214,
1957), and those in one of them are the eigenvalues of the product of the R_k's diagonal blocks there.
"""

from __future__ import annotations

import numpy as np

from ..errors import failed_solve

# Rounds until subspaces part, at most; what is left between subspaces that part; how many times as large as
# one another moduli of one subspace are at most, as in its product small ones lose as many digits; what is
# rounding in a factor.
ROUNDS, PARTED, SPREAD, ZERO = 300, 1e-10, 1e6, 1e-15


def product_eigenvalues(factors: np.ndarray) -> np.ndarray:
    """Eigenvalues of F_n ... F_2 F_1 by falling modulus.

    Each is that of factors which differ from the given ones by about 1e-15 of their norms: relative errors
    are that times the condition of the eigenvalue, whatever its size beside the largest.

    Parameters
    ----------
    factors : (n, s, s) array

    Raises
    ------
    SolveError
        If the factors are not finite, or the iteration does not end.
    """
    norms, size = np.abs(factors).max(axis=(1, 2)), factors.shape[1]
    if not np.isfinite(norms).all():
        raise failed_solve("Floquet multipliers: the derivative of a segment is not finite")
    if not norms.all():
        return np.zeros(size, dtype=complex)
    turned, triangles, enough, taken = np.eye(size), np.empty(factors.shape), 0, 0
    while not enough or taken < enough:
        taken += 1
        begin = turned
        for k, factor in enumerate(factors / norms[:, None, None]):
            turned, triangles[k] = np.linalg.qr(factor @ turned)
        closing = begin.T @ turned
        parted = [k for k in range(1, size) if np.abs(closing[k:, :k]).max() < PARTED]
        blocks = [slice(*ends) for ends in zip([0, *parted], [*parted, size])]
        # what is rounding in a factor is zero
        moduli = np.log(np.maximum(np.abs(np.einsum("kii->ki", triangles)), ZERO)).sum(axis=0)
        if not enough and max(float(np.ptp(moduli[block])) for block in blocks) < np.log(SPREAD):
            enough = 2 * taken if parted else taken  # in as many again what is left squares
        if not enough and taken == ROUNDS:
            raise failed_solve(
                f"Floquet multipliers: subspaces of {size} eigenvalues have not parted in {ROUNDS} "
                "rounds through the segments; take another number of them"
            )
    values = np.concatenate(
        [_of_block(closing[block, block], triangles[:, block, block]) for block in blocks]
    )
    with np.errstate(over="ignore", under="ignore"):
        values = values * np.exp(np.log(norms).sum())
    return values[np.argsort(-np.abs(values), kind="stable")]


def _of_block(closing: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Eigenvalues of the product of triangular matrices and an orthogonal one behind it."""
    product, logarithm = np.eye(len(closing)), 0.0
    for triangle in triangles:
        product = triangle @ product
        scale = float(np.abs(product).max()) or 1.0
        product, logarithm = product / scale, logarithm + np.log(scale)
    return np.linalg.eigvals(closing @ product) * np.exp(logarithm)

"""Mass and continued fraction of an S-element, (12)-(19) of Sepehry et al. (2020)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import linalg

from .coefficients import SElementError
from .dense import ADVICE, cholesky, cholesky_solve, lower_solve, lyapunov, schur, symmetric, symmetric_eigen

# The equations of a term are those of the first one in another basis; the way back costs as many digits as
# the square of the basis' condition, so beyond this a Schur form of its own is computed.
_CONDITION = 30.0


@dataclass(frozen=True, eq=False)
class Inertia:
    """Inertia of a non-dimensional S-element with n boundary unknowns and a auxiliary ones.

    Attributes
    ----------
    mass : (n, n) array
        M, symmetric.
    coupling : (n, a) array
        C.
    inertia : (a,) array
        J > 0, ascending; the auxiliary unknowns alone vibrate at w2 = 1 / J.
    """

    mass: np.ndarray
    coupling: np.ndarray
    inertia: np.ndarray


def continued_fraction(m0: np.ndarray, factor: np.ndarray, radial: np.ndarray, terms: int) -> Inertia:
    """Mass, coupling and inertia of the auxiliary unknowns, with S0 = I by the scaling X X^T = Z.

    Parameters
    ----------
    m0 : (n, n) array
        Coefficient matrix of the mass.
    factor : (n, n) array
        Lower Cholesky factor of E0.
    radial : (n, n) array
        A.
    terms : int

    Notes
    -----
    ``U' = X^-1 (U + 2 I) X`` from term to term. With T the product of the X so far, an equation
    ``(U' + s I) Y + Y (U' + s I)^T = R`` is ``(A^T + s' I) T Y T^T + ... = T R T^T`` with s' = s + 2 for each
    term, so that one Schur form serves all.

    Raises
    ------
    SElementError
        If a matrix that is positive definite in exact arithmetic is not.
    """
    n = len(radial)
    u = radial.T
    form = schur(u)
    mass = lyapunov(form, 1.0, m0)
    cholesky(mass, "mass")
    if terms == 0:
        return Inertia(mass, np.zeros((n, 0)), np.zeros(0))
    identity = np.eye(n)
    c = cholesky_solve(factor, identity)
    v = mass @ c
    a = symmetric(v @ mass)
    scalings, inertias = [], []
    basis: np.ndarray | None = None  # T
    shift = 0.0
    for i in range(1, terms + 1):
        z = _lyapunov_in(basis, form, shift + 2.0, a)
        x = cholesky(z, f"term {i} of the continued fraction")
        b1 = lower_solve(x, v @ x).T
        basis, shift = (x if basis is None else basis @ x), shift + 2.0
        u = lower_solve(x, u @ x) + 2.0 * identity
        diagonal = basis.diagonal()
        if diagonal.max() > _CONDITION * diagonal.min():
            form, basis, shift = schur(u), None, 0.0
        s1 = _lyapunov_in(basis, form, shift + 1.0, b1 + b1.T)
        scalings.append(x)
        inertias.append(s1)
        if i == terms:
            break
        next_c = symmetric(lower_solve(x, lower_solve(x, a).T))  # X^-1 a X^-T
        next_a = x.T @ c @ x
        v = s1 @ next_c - b1
        product = s1 @ b1.T
        a = symmetric(s1 @ next_c @ s1 - product - product.T + next_a)
        c = next_c
    pencil = inertias[0] if terms == 1 else linalg.block_diag(*inertias)
    for i, x in enumerate(scalings[1:], start=1):
        upper, lower = slice((i - 1) * n, i * n), slice(i * n, (i + 1) * n)
        pencil[upper, lower], pencil[lower, upper] = -x, -x.T
    inertia, modes = symmetric_eigen(pencil)
    if not inertia[0] > 0.0:
        raise SElementError(
            "the auxiliary mass of the continued fraction is not positive definite (smallest eigenvalue "
            f"{inertia[0]:.2g}); {ADVICE}"
        )
    return Inertia(mass, -scalings[0] @ modes[:n], inertia)


def _lyapunov_in(
    basis: np.ndarray | None, form: tuple[np.ndarray, np.ndarray], shift: float, right: np.ndarray
) -> np.ndarray:
    """Y of (T^-1 (U + shift I) T) Y + Y (...)^T = right with the Schur form of U and a lower triangular T."""
    if basis is None:
        return lyapunov(form, shift, right)
    whole = lyapunov(form, shift, basis @ right @ basis.T)
    return symmetric(lower_solve(basis, lower_solve(basis, whole).T))

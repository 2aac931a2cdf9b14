"""Mass and continued fraction of an S-element, (12)-(19) of Sepehry et al. (2020)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import linalg

from .coefficients import SElementError
from .dense import (
    ADVICE,
    cholesky,
    cholesky_solve,
    lyapunov,
    schur,
    symmetric,
    symmetric_eigen,
    upper_factor,
    upper_solve,
)


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


@dataclass(frozen=True, eq=False)
class Moments:
    """Inertia of a non-dimensional S-element by the series of its dynamic stiffness in w2 = omega^2,
    K - w2 M - w2^2 P - w2^3 S - ..., from which one term of the continued fraction follows: C C^T = P,
    C J C^T = S.

    Attributes
    ----------
    mass, second, third : (n, n) arrays
        M, P and S, symmetric.
    """

    mass: np.ndarray
    second: np.ndarray
    third: np.ndarray


def continued_fraction(
    m0: np.ndarray,
    factor: np.ndarray,
    radial: np.ndarray,
    terms: int,
    form: tuple[np.ndarray, np.ndarray] | None = None,
) -> Inertia:
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
    form : (T, Q), optional
        Real Schur form of A^T, if it is known.

    Notes
    -----
    In the basis of a real Schur form U = A^T is quasi upper triangular, and so is ``U' = X^-1 (U + 2 I) X``
    with an upper triangular X: one Schur form serves the Lyapunov equations of all terms.

    Raises
    ------
    SElementError
        If a matrix that is positive definite in exact arithmetic is not.
    """
    u, basis = schur(radial.T) if form is None else form
    n = len(u)
    v = lyapunov(u, 1.0, basis.T @ m0 @ basis)
    mass = symmetric(basis @ v @ basis.T)
    cholesky(mass, "mass")
    if terms == 0:
        return Inertia(mass, np.zeros((n, 0)), np.zeros(0))
    c = basis.T @ cholesky_solve(factor, basis)
    a = v
    v = v @ c
    a = symmetric(v @ a)
    scalings, inertias = [], []
    for i in range(1, terms + 1):
        x = upper_factor(lyapunov(u, 2.0, a), f"term {i} of the continued fraction")
        b1 = upper_solve(x, v @ x).T
        u = upper_solve(x, u @ x)
        u.reshape(-1, order="A")[:: n + 1] += 2.0
        s1 = lyapunov(u, 1.0, b1 + b1.T)
        scalings.append(x)
        inertias.append(s1)
        if i == terms:
            break
        next_c = symmetric(upper_solve(x, upper_solve(x, a).T))  # X^-1 a X^-T
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
    return Inertia(mass, -(basis @ (scalings[0] @ modes[:n])), inertia)

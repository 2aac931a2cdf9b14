"""Mass and continued fraction of an S-element, (12)-(19) of Sepehry et al. (2020)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import linalg
from scipy.linalg import lapack

from .coefficients import Coefficients, SElementError
from .dense import (
    ADVICE,
    cholesky,
    cholesky_solve,
    lyapunov,
    schur,
    symmetric,
    symmetric_eigen,
    turned,
    upper_factor,
    upper_solve,
)
from .polynomial_modes import PolynomialModes
from .stiffness import largest_of_each

# Of A: what it leaves of the polynomial modes to the rest is round-off up to here, relative to its largest
# entry; and modes that depend more on one another, as on flat cells, cost moments digits (2e-13 here).
_MIXED, _APART = 1e-12, 0.03


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

    Notes
    -----
    In the basis of a real Schur form U = A^T is quasi upper triangular, and so is ``U' = X^-1 (U + 2 I) X``
    with an upper triangular X: one Schur form serves the Lyapunov equations of all terms.

    Raises
    ------
    SElementError
        If a matrix that is positive definite in exact arithmetic is not.
    """
    u, basis = schur(radial.T)
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


def moments(
    c: Coefficients, known: PolynomialModes, stiffness: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """M, P and S (b, n, n), and where they could be told (b,).

    The Lyapunov equations (A^T + s) Y + Y (A + s) = R of s = 1, 2, 3 are solved in the basis X = [modes, W Z]
    with A X = X [[E, N], [0, U]]: the polynomial modes with their exponents E, a complement W and the Schur
    vectors Z of W^T A W. Blocks of Y among the modes are divisions.
    """
    basis, rest, triangle, exponents = known.basis, known.rest, known.triangle, known.exponents
    count, n, k = basis.shape
    flexibility = np.linalg.inv(c.e0)  # a third of the time of two solutions
    radial = flexibility @ (stiffness - turned(c.e1))
    good = largest_of_each(turned(rest) @ (radial @ basis)) <= _MIXED * largest_of_each(radial)
    sizes = np.abs(np.diagonal(triangle, axis1=1, axis2=2))
    good &= sizes.min(axis=1) >= _APART * sizes.max(axis=1)
    images = radial @ rest
    forms, vectors = np.empty((2, count, n - k, n - k))
    own = turned(rest) @ images
    for b in range(count):
        forms[b], _, _, _, vectors[b], _, info = lapack.dgees(lambda re, im: False, own[b])
        good[b] &= info == 0
    x = np.concatenate([basis @ triangle, rest @ vectors], axis=2)
    dual = np.concatenate([np.linalg.solve(triangle, turned(basis)), turned(rest @ vectors)], axis=1)  # X^-1
    mixed = dual[:, :k] @ images @ vectors
    gram = dual @ flexibility @ turned(dual)

    def lyapunov(right: np.ndarray, shift: float) -> np.ndarray:
        y = np.empty_like(right)
        y[:, :k, :k] = right[:, :k, :k] / (exponents[:, None] + exponents + 2.0 * shift)
        both = right[:, :k, k:] - y[:, :k, :k] @ mixed
        diagonal, away = np.diag(exponents + shift), shift * np.eye(n - k)
        for b in range(count):
            y[b, :k, k:], scale, info = lapack.dtrsyl(diagonal, forms[b] + away, both[b])
            good[b] &= info == 0 and scale == 1.0
        product = turned(mixed) @ y[:, :k, k:]
        corner = right[:, k:, k:] - product - turned(product)
        for b in range(count):
            form = forms[b] + away
            y[b, k:, k:], scale, info = lapack.dtrsyl(form, form, corner[b], trana="T")
            good[b] &= info == 0 and scale == 1.0
        y[:, k:, :k] = turned(y[:, :k, k:])
        return symmetric(y)

    first = lyapunov(turned(x) @ c.m0 @ x, 1.0)
    product = first @ gram
    second = lyapunov(symmetric(product @ first), 2.0)
    third = lyapunov(2.0 * symmetric(product @ second), 3.0)
    mass, second, third = (symmetric(turned(dual) @ y @ dual) for y in (first, second, third))
    return mass, second, third, good

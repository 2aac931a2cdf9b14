"""Radial modes of an S-element that are known beforehand: the polynomials in equilibrium.

On straight edges of order p, displacements that are polynomials of a degree k <= p and in equilibrium are
represented exactly, for every polygon of one material that is closed around its scaling centre. They are
radial modes with the exponent k: two translations and four modes of each degree from 1 on, 22 of the 40 of a
quadrilateral of order 5. With them the Riccati equation and the Schur form are left with the others alone.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass

import numpy as np
from scipy.linalg import lapack

from .coefficients import Coefficients
from .dense import largest, schur

# Modes that are nearly dependent on the outline, as those of flat cells are, would cost as many digits.
_DEPENDENT = 1e-3
# Of A: what it leaves of these modes to the rest is round-off up to here, relative to its largest entry.
_MIXED = 1e-12
# Translations and linear fields.
_FEWEST = 6


@dataclass(frozen=True, eq=False)
class PolynomialModes:
    """The space of the polynomial modes of an S-element with n unknowns, and the rest.

    Attributes
    ----------
    basis : (n, k) array
        Orthonormal; the modes of lower degree come first.
    rest : (n, n - k) array
        Orthonormal basis of the complement.
    forces : (n, k) array
        K basis.
    radial : (k, k) array
        A basis = basis radial, upper triangular with the exponents on the diagonal.
    """

    basis: np.ndarray
    rest: np.ndarray
    forces: np.ndarray
    radial: np.ndarray

    def schur_form(self, radial: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
        """Real Schur form (T, Q) of A^T, of which a part is known; None where A leaves more than round-off of
        these modes to the rest, or where there is no rest.
        """
        if not self.rest.size:
            return None
        k = self.basis.shape[1]
        images = radial @ self.rest
        own = self.rest.T @ images
        if largest(self.rest.T @ (radial @ self.basis)) > _MIXED * largest(radial):
            return None
        triangle, vectors = schur(own)
        whole = np.zeros(radial.shape)
        whole[:k, :k], whole[k:, k:] = self.radial, triangle
        whole[:k, k:] = (self.basis.T @ images) @ vectors
        basis = np.concatenate([self.basis, self.rest @ vectors], axis=1)
        # that of the transpose is the transpose in reverse order
        return np.asfortranarray(whole[::-1, ::-1].T), np.ascontiguousarray(basis[:, ::-1])


def polynomial_modes(
    coordinates: np.ndarray, order: int, elasticity: np.ndarray, coefficients: Coefficients
) -> PolynomialModes | None:
    """The polynomial modes of a closed S-element of one material, or None where its edges are curved or the
    modes nearly dependent.

    Parameters
    ----------
    coordinates : (nodes, 2) array
        Boundary nodes about the scaling centre, of unit size.
    order : int
    elasticity : (3, 3) array
    coefficients : Coefficients
    """
    if not coefficients.straight:
        return None
    modes, exponents = _evaluated(coordinates, order, elasticity)
    packed, reflectors, _, info = lapack.dgeqrf(modes)
    diagonal = np.abs(packed.diagonal())
    # of flat cells and at high orders the higher degrees are left out
    poor = np.flatnonzero(diagonal < _DEPENDENT * diagonal.max())
    count = int(np.searchsorted(exponents, exponents[poor[0]])) if len(poor) else len(exponents)
    if info != 0 or count < _FEWEST:
        return None
    n, modes, exponents = len(modes), modes[:, :count], exponents[:count]
    whole, triangle = np.zeros((n, n), order="F"), packed[:count, :count]
    whole[:, :count] = packed[:, :count]
    whole, _, _ = lapack.dorgqr(whole, np.concatenate([reflectors[:count], np.zeros(n - count)]))
    # K u = E0 u,xi + E1^T u at xi = 1, and u,xi = k u
    forces = coefficients.e0 @ (modes * exponents) + coefficients.e1.T @ modes
    right = np.concatenate([forces, np.triu(triangle) * exponents])
    solved = lapack.dtrtrs(triangle, right.T, trans=1)[0].T
    return PolynomialModes(whole[:, :count], whole[:, count:], solved[:n], np.triu(solved[n:]))


def _evaluated(coordinates: np.ndarray, order: int, elasticity: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Modes (n, k) at the nodes, in Fortran's order and of unit norm, and their exponents (k,)."""
    table, degrees = _tabulated(order, np.ascontiguousarray(elasticity).tobytes())
    powers = np.ones((2, order + 1, len(coordinates)))
    for k in range(1, order + 1):
        powers[:, k] = powers[:, k - 1] * coordinates.T
    first, second = _monomials(order)
    monomials = powers[0, first] * powers[1, second]
    values = (table @ monomials).reshape(len(degrees), 2, -1).transpose(0, 2, 1).reshape(len(degrees), -1)
    values /= np.sqrt((values * values).sum(axis=1))[:, None]
    return values.T, degrees


@functools.cache
def _monomials(order: int) -> tuple[np.ndarray, np.ndarray]:
    """Powers of x and y of the monomials up to a degree, those of lower degree first."""
    pairs = [(k - j, j) for k in range(order + 1) for j in range(k + 1)]
    first, second = np.array(pairs).T
    return first, second


@functools.lru_cache(maxsize=64)
def _tabulated(order: int, elasticity: bytes) -> tuple[np.ndarray, np.ndarray]:
    """Coefficients (2 modes, monomials) of the x and y displacements of the modes, in turn, and the degrees
    of the modes (modes,).
    """
    d = np.frombuffer(elasticity).reshape(3, 3)
    rows, degrees, first = [], [], 0
    for degree in range(order + 1):
        found = _in_equilibrium(degree, d)
        table = np.zeros((len(found), 2, len(_monomials(order)[0])))
        table[:, :, first : first + degree + 1] = found
        rows.append(table.reshape(2 * len(found), -1))
        degrees += [degree] * len(found)
        first += degree + 1
    return np.concatenate(rows), np.array(degrees, dtype=float)


def _in_equilibrium(degree: int, d: np.ndarray) -> np.ndarray:
    """(modes, 2, degree + 1): coefficients of x^(degree - j) y^j of an orthonormal set of homogeneous
    displacements in equilibrium.
    """
    weights = np.array([math.sqrt(math.comb(degree, j)) for j in range(degree + 1)])
    if degree < 2:
        return np.eye(2 * degree + 2).reshape(-1, 2, degree + 1) * weights
    # d/dx B^T and d/dy B^T of D (B u), with strains (xx, yy, 2 xy): second derivatives u,xx, u,xy, u,yy
    xx = d[np.ix_([0, 2], [0, 2])]
    yy = d[np.ix_([2, 1], [2, 1])]
    xy = d[np.ix_([0, 2], [2, 1])] + d[np.ix_([2, 1], [0, 2])]
    equations = np.zeros((2, degree - 1, 2, degree + 1))
    for j in range(degree + 1):
        i = degree - j
        if i >= 2:
            equations[:, j, :, j] += i * (i - 1) * weights[j] * xx
        if i >= 1 and j >= 1:
            equations[:, j - 1, :, j] += i * j * weights[j] * xy
        if j >= 2:
            equations[:, j - 2, :, j] += j * (j - 1) * weights[j] * yy
    _, _, right = np.linalg.svd(equations.reshape(2 * degree - 2, -1))
    return right[2 * degree - 2 :].reshape(-1, 2, degree + 1) * weights

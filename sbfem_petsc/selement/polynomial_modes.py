"""Radial modes of an S-element that are known beforehand: the polynomials in equilibrium.

On straight edges of order p, displacements that are polynomials of a degree k <= p and in equilibrium are
represented exactly, for every polygon of one material that is closed around its scaling centre. They are
radial modes with the exponent k: two translations and four modes of each degree from 1 on, 22 of the 40 of a
quadrilateral of order 5. With them the Riccati equation and the Schur form are left with the others alone.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from .coefficients import Coefficients
from .dense import turned

# Modes that are nearly dependent on the outline, as those of flat cells are, would cost as many digits.
_DEPENDENT = 1e-3
# Translations and linear fields.
_FEWEST = 6


@dataclass(frozen=True, eq=False)
class PolynomialModes:
    """The spaces of the polynomial modes of S-elements with n unknowns, and the rest, (b, ...) of b of them.

    Attributes
    ----------
    basis : (b, n, k) array
        Orthonormal; the modes of lower degree come first.
    rest : (b, n, n - k) array
        Orthonormal basis of the complement.
    forces : (b, n, k) array
        K basis.
    triangle : (b, k, k) array
        Upper triangular: the modes themselves are basis triangle.
    exponents : (k,) array
        Of the modes.
    """

    basis: np.ndarray
    rest: np.ndarray
    forces: np.ndarray
    triangle: np.ndarray
    exponents: np.ndarray


def polynomial_modes(
    coordinates: np.ndarray, order: int, elasticity: np.ndarray, coefficients: Coefficients
) -> Iterator[tuple[np.ndarray, PolynomialModes]]:
    """The polynomial modes of closed S-elements of one material: rows of those that have equally many, and
    their modes. Those whose modes are nearly dependent, or whose edges are curved, have none.

    Parameters
    ----------
    coordinates : (b, nodes, 2) array
        Boundary nodes about the scaling centres, of unit size.
    order : int
    elasticity : (3, 3) array
    coefficients : Coefficients
        (b, n, n)
    """
    if not coefficients.straight:
        return
    modes, exponents = _evaluated(coordinates, order, elasticity)
    whole, triangles = np.linalg.qr(modes, mode="complete")
    diagonals = np.abs(np.diagonal(triangles, axis1=1, axis2=2))
    # of flat cells and at high orders the higher degrees are left out
    poor = diagonals < _DEPENDENT * diagonals.max(axis=1, keepdims=True)
    lowest = np.where(poor.any(axis=1), exponents[poor.argmax(axis=1)], np.inf)
    counts = np.searchsorted(exponents, lowest)
    for count in np.unique(counts[counts >= _FEWEST]):
        rows = np.flatnonzero(counts == count)
        e0, e1 = coefficients.e0[rows], coefficients.e1[rows]
        own, powers, triangle = (
            modes[rows][:, :, :count],
            exponents[:count],
            triangles[rows][:, :count, :count],
        )
        # K u = E0 u,xi + E1^T u at xi = 1, and u,xi = k u
        right = e0 @ (own * powers) + turned(e1) @ own
        forces = turned(np.linalg.solve(turned(triangle), turned(right)))
        yield (
            rows,
            PolynomialModes(whole[rows][:, :, :count], whole[rows][:, :, count:], forces, triangle, powers),
        )


def _evaluated(coordinates: np.ndarray, order: int, elasticity: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Modes (b, n, k) at the nodes, of unit norm, and their exponents (k,)."""
    table, degrees = _tabulated(order, np.ascontiguousarray(elasticity).tobytes())
    count, nodes, _ = coordinates.shape
    powers = np.ones((2, order + 1, count, nodes))
    for k in range(1, order + 1):
        powers[:, k] = powers[:, k - 1] * coordinates.transpose(2, 0, 1)
    first, second = _monomials(order)
    monomials = (powers[0, first] * powers[1, second]).transpose(1, 0, 2)
    values = (table @ monomials).reshape(count, len(degrees), 2, nodes).swapaxes(2, 3)
    values = values.reshape(count, len(degrees), 2 * nodes)
    values /= np.sqrt((values * values).sum(axis=2, keepdims=True))
    return turned(values), degrees


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

"""Lagrange polynomials on Gauss-Lobatto-Legendre (GLL) nodes."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.polynomial import legendre


@lru_cache(maxsize=None)
def gll_nodes(order: int) -> np.ndarray:
    """GLL nodes of polynomial order `order` on [-1, 1], shape (order + 1,): the ends and the zeros of P'_order."""
    inner = np.sort(legendre.Legendre.basis(order).deriv().roots().real) if order > 1 else np.empty(0)
    # Newton on P' polishes the companion-matrix roots to round-off: matching meshes compare nodes to 1e-15.
    first, second = legendre.Legendre.basis(order).deriv(1), legendre.Legendre.basis(order).deriv(2)
    for _ in range(2):
        inner = inner - first(inner) / second(inner) if order > 1 else inner
    nodes = np.concatenate(([-1.0], 0.5 * (inner - inner[::-1]), [1.0]))
    nodes.setflags(write=False)
    return nodes


@lru_cache(maxsize=None)
def _barycentric_weights(order: int) -> np.ndarray:
    difference = gll_nodes(order)[:, None] - gll_nodes(order)[None, :]
    np.fill_diagonal(difference, 1.0)
    return 1.0 / difference.prod(axis=1)


def shape_functions(order: int, at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Lagrange polynomials on the GLL nodes and their derivatives.

    Parameters
    ----------
    order : int
    at : (q,) array
        Points in [-1, 1].

    Returns
    -------
    values, derivatives : (q, order + 1) arrays
    """
    nodes, weights = gll_nodes(order), _barycentric_weights(order)
    at = np.atleast_1d(np.asarray(at, dtype=float))
    values = np.empty((len(at), order + 1))
    for row, x in zip(values, at):
        distance = x - nodes
        hit = np.flatnonzero(distance == 0.0)
        if len(hit):
            row[:] = 0.0
            row[hit[0]] = 1.0
        else:
            row[:] = weights / distance
            row /= row.sum()
    # The derivative of an interpolant of degree p is the interpolant of its derivatives at the nodes.
    return values, values @ differentiation_matrix(order)


@lru_cache(maxsize=None)
def differentiation_matrix(order: int) -> np.ndarray:
    """(order + 1, order + 1): derivative of the interpolant at the GLL nodes from its nodal values."""
    nodes, weights = gll_nodes(order), _barycentric_weights(order)
    difference = nodes[:, None] - nodes[None, :]
    np.fill_diagonal(difference, 1.0)
    matrix = weights[None, :] / weights[:, None] / difference
    np.fill_diagonal(matrix, 0.0)
    np.fill_diagonal(matrix, -matrix.sum(axis=1))
    return matrix


@lru_cache(maxsize=None)
def gauss_rule(points: int) -> tuple[np.ndarray, np.ndarray]:
    """Gauss-Legendre points and weights on [-1, 1], exact for degree 2 * points - 1."""
    return legendre.leggauss(points)


@lru_cache(maxsize=None)
def tabulated(order: int, points: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Shape functions and derivatives (points, order + 1) at the Gauss points, and the weights (points,)."""
    at, weights = gauss_rule(points)
    return (*shape_functions(order, at), weights)

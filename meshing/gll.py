"""Gauss-Lobatto-Legendre (GLL) nodes of line elements and Lagrange interpolation on them."""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.polynomial import legendre


@cache
def gll_nodes(order: int) -> np.ndarray:
    """GLL nodes of a line element.

    Parameters
    ----------
    order : int
        Polynomial order p >= 1.

    Returns
    -------
    (p + 1,) array
        Nodes in [-1, 1], ascending and exactly symmetric about 0; read-only.
    """
    derivative = legendre.legder([0.0] * order + [1.0])
    inner = np.sort(legendre.legroots(derivative).real)
    second = legendre.legder(derivative)
    for _ in range(2):  # the companion matrix leaves a few units of round-off, two Newton steps remove them
        inner = inner - legendre.legval(inner, derivative) / legendre.legval(inner, second)
    inner = 0.5 * (inner - inner[::-1])
    nodes = np.concatenate([[-1.0], inner, [1.0]])
    nodes.flags.writeable = False
    return nodes


def lagrange_values(nodes: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Lagrange polynomials through `nodes` (n,) at `points` (m,): an (m, n) array."""
    nodes, points = np.asarray(nodes, float), np.asarray(points, float)
    values = np.ones((len(points), len(nodes)))
    for j, node in enumerate(nodes):
        for k, other in enumerate(nodes):
            if k != j:
                values[:, j] *= (points - other) / (node - other)
    return values


def lagrange_slopes(nodes: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Derivatives of the Lagrange polynomials through `nodes` (n,) at `points` (m,): an (m, n) array."""
    nodes = np.asarray(nodes, float)
    difference = nodes[:, None] - nodes[None, :]
    np.fill_diagonal(difference, 1.0)
    weight = 1.0 / difference.prod(axis=1)
    np.fill_diagonal(difference, np.inf)
    at_nodes = weight[None, :] / weight[:, None] / difference
    np.fill_diagonal(at_nodes, -at_nodes.sum(axis=1))
    return lagrange_values(nodes, points) @ at_nodes


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
    at = np.atleast_1d(np.asarray(at, dtype=float))
    return lagrange_values(gll_nodes(order), at), lagrange_slopes(gll_nodes(order), at)


@cache
def tabulated(order: int, points: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Shape functions and derivatives (points, order + 1) at the Gauss points, and the weights (points,)."""
    at, weights = legendre.leggauss(points)
    return (*shape_functions(order, at), weights)

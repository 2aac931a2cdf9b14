"""Lagrange polynomials on Gauss-Lobatto-Legendre (GLL) nodes, at points and at Gauss points."""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.polynomial import legendre

from meshing.gll import gll_nodes, lagrange_slopes, lagrange_values

__all__ = ["gll_nodes"]  # what is passed on


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

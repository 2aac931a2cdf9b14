"""Coefficient matrices E0, E1, E2, M0 of one S-element (eqs. (1)-(11) of Sepehry et al. 2020)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .basis import gll_nodes, tabulated


class SElementError(ValueError):
    """An S-element cannot be formed or fails one of its checks; the message says why."""


@dataclass(frozen=True, eq=False)
class Coefficients:
    """Coefficient matrices of one S-element with n degrees of freedom (x and y of each node in turn), all (n, n)."""

    e0: np.ndarray
    e1: np.ndarray
    e2: np.ndarray
    m0: np.ndarray


def edge_nodes(nodes: int, order: int, closed: bool) -> np.ndarray:
    """Local node numbers of each edge, (edges, order + 1), for `nodes` nodes numbered counter-clockwise."""
    edges = (nodes if closed else nodes - 1) // order
    return (np.arange(edges)[:, None] * order + np.arange(order + 1)) % nodes


def quadrature_points(coordinates: np.ndarray, order: int, connectivity: np.ndarray) -> int:
    """Gauss points an edge: order + 1 is exact on straight edges with evenly mapped nodes; curved edges get twice as many."""
    ends = coordinates[connectivity[:, [0, -1]]]
    fraction = 0.5 * (1.0 + gll_nodes(order))[None, :, None]
    straight = ends[:, :1] * (1.0 - fraction) + ends[:, 1:] * fraction
    deviation = np.abs(coordinates[connectivity] - straight).max()
    return order + 1 if deviation < 1e-12 * np.abs(coordinates).max() else 2 * order + 4


def coefficient_matrices(coordinates: np.ndarray, order: int, closed: bool, elasticity: np.ndarray) -> Coefficients:
    """E0, E1, E2 and M0 by Gauss quadrature.

    Parameters
    ----------
    coordinates : (nodes, 2) array
        Boundary nodes relative to the scaling centre, counter-clockwise, in units of the element's size.
    order : int
        Polynomial order of the edges.
    closed : bool
        Whether the last edge ends on the first node.
    elasticity : (3, 3) array
        Plane elasticity matrix D in units of the Young's modulus; the density is 1.

    Raises
    ------
    SElementError
        If the scaling centre does not see the whole boundary (|J| <= 0 at a quadrature point).
    """
    connectivity = edge_nodes(len(coordinates), order, closed)
    values, derivatives, weights = tabulated(order, quadrature_points(coordinates, order, connectivity))
    edge = coordinates[connectivity]
    x, y = np.moveaxis(values @ edge, 2, 0)
    dx, dy = np.moveaxis(derivatives @ edge, 2, 0)
    jacobian = x * dy - y * dx                                                       # (9), shape (edges, points)
    if not (jacobian > 0.0).all():
        worst = int(np.argmin(jacobian.min(axis=1)))
        raise SElementError(f"the scaling centre does not see edge {worst} (|J| = {jacobian.min():.3g} in units of the squared size)")
    edges, points, width = *jacobian.shape, order + 1
    # Rows of B1, B2 (10), (11), multiplied by sqrt(weight / |J|) so that one product gives each matrix.
    root = np.sqrt(weights / jacobian)[:, :, None]
    first = np.zeros((edges, points, 3, width, 2))
    second = np.zeros((edges, points, 3, width, 2))
    first[:, :, 0, :, 0] = first[:, :, 2, :, 1] = (root * dy[:, :, None]) * values
    first[:, :, 1, :, 1] = first[:, :, 2, :, 0] = -(root * dx[:, :, None]) * values
    second[:, :, 0, :, 0] = second[:, :, 2, :, 1] = -(root * y[:, :, None]) * derivatives
    second[:, :, 1, :, 1] = second[:, :, 2, :, 0] = (root * x[:, :, None]) * derivatives
    stack = (edges, points * 3, 2 * width)
    stress_first = (elasticity @ first.reshape(edges, points, 3, 2 * width)).reshape(stack)
    stress_second = (elasticity @ second.reshape(edges, points, 3, 2 * width)).reshape(stack)
    first, second = (b.reshape(stack).transpose(0, 2, 1) for b in (first, second))
    mass = np.zeros((edges, width, 2, width, 2))
    mass[:, :, 0, :, 0] = mass[:, :, 1, :, 1] = (values.T * (weights * jacobian)[:, None, :]) @ values
    blocks = (first @ stress_first, second @ stress_first, second @ stress_second, mass.reshape(edges, 2 * width, 2 * width))
    unknowns = (2 * connectivity[:, :, None] + np.arange(2)).reshape(edges, 2 * width)
    matrices = np.zeros((4, 2 * len(coordinates), 2 * len(coordinates)))
    for k, dofs in enumerate(unknowns):
        for matrix, block in zip(matrices, blocks):
            matrix[np.ix_(dofs, dofs)] += block[k]
    return Coefficients(*matrices)

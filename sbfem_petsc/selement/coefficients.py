"""Coefficient matrices E0, E1, E2, M0 of one S-element (eqs. (1)-(11) of Sepehry et al. 2020)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from meshing.gll import gll_nodes, tabulated


class SElementError(ValueError):
    """An S-element cannot be formed or fails one of its checks; the message says why."""


@dataclass(frozen=True, eq=False)
class Coefficients:
    """Coefficient matrices of one S-element with n degrees of freedom (x and y of each node in turn), all (n,
    n), or of many, (k, n, n), and whether all edges are straight with evenly mapped nodes.
    """

    e0: np.ndarray
    e1: np.ndarray
    e2: np.ndarray
    m0: np.ndarray
    straight: bool = False

    def of(self, rows: np.ndarray | None) -> Coefficients:
        """Those of some of many S-elements; None: of one, as of many."""
        return Coefficients(self.e0[rows], self.e1[rows], self.e2[rows], self.m0[rows], self.straight)


def edge_nodes(nodes: int, order: int, closed: bool) -> np.ndarray:
    """Local node numbers of each edge, (edges, order + 1), for `nodes` nodes numbered counter-clockwise."""
    edges = (nodes if closed else nodes - 1) // order
    return (np.arange(edges)[:, None] * order + np.arange(order + 1)) % nodes


def quadrature_points(coordinates: np.ndarray, order: int, connectivity: np.ndarray) -> int:
    """Gauss points an edge: order + 1 is exact on straight edges with evenly mapped nodes; curved edges get
    twice as many.
    """
    return order + 1 if straight_edges(coordinates, order, connectivity).all() else 2 * order + 4


def straight_edges(coordinates: np.ndarray, order: int, connectivity: np.ndarray) -> np.ndarray:
    """(...): whether the edges of outlines (..., nodes, 2) are straight with evenly mapped nodes."""
    edges = coordinates[..., connectivity, :]
    fraction = 0.5 * (1.0 + gll_nodes(order))[:, None]
    even = edges[..., :1, :] * (1.0 - fraction) + edges[..., -1:, :] * fraction
    deviation = np.abs(edges - even).max(axis=(-3, -2, -1))
    return np.asarray(deviation < 1e-12 * np.abs(coordinates).max(axis=(-2, -1)))


def strain_operators(
    edges: np.ndarray, values: np.ndarray, derivatives: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """B1 and B2 of (10), (11) and |J| of (9) at points of several edges.

    Parameters
    ----------
    edges : (e, p + 1, 2) array
        Nodes of the edges relative to the scaling centre.
    values, derivatives : (q, p + 1) arrays
        Shape functions at the points, or (e, q, p + 1), at points of each edge's own.

    Returns
    -------
    first, second : (e, q, 3, p + 1, 2) arrays
        Strain (xx, yy, 2 xy) is ``first u,xi + second u / xi``.
    jacobian : (e, q) array

    Raises
    ------
    SElementError
        If the scaling centre does not see the whole boundary (|J| <= 0 at a point).
    """
    x, y = np.moveaxis(values @ edges, 2, 0)
    dx, dy = np.moveaxis(derivatives @ edges, 2, 0)
    jacobian = x * dy - y * dx
    if not (jacobian > 0.0).all():
        worst = int(np.argmin(jacobian.min(axis=1)))
        raise SElementError(
            f"the scaling centre does not see edge {worst} (|J| = {jacobian.min():.3g} in units of the "
            "squared size)"
        )
    first = np.zeros((*jacobian.shape, 3, values.shape[-1], 2))
    second = np.zeros_like(first)
    first[:, :, 0, :, 0] = first[:, :, 2, :, 1] = (dy / jacobian)[:, :, None] * values
    first[:, :, 1, :, 1] = first[:, :, 2, :, 0] = -(dx / jacobian)[:, :, None] * values
    second[:, :, 0, :, 0] = second[:, :, 2, :, 1] = -(y / jacobian)[:, :, None] * derivatives
    second[:, :, 1, :, 1] = second[:, :, 2, :, 0] = (x / jacobian)[:, :, None] * derivatives
    return first, second, jacobian


def coefficient_matrices(
    coordinates: np.ndarray,
    order: int,
    closed: bool,
    elasticity: np.ndarray,
    *,
    density: np.ndarray | None = None,
) -> Coefficients:
    """E0, E1, E2 and M0 by Gauss quadrature.

    Parameters
    ----------
    coordinates : (nodes, 2) or (k, nodes, 2) array
        Boundary nodes relative to the scaling centre, counter-clockwise, in units of the element's size; of
        one S-element or of many.
    order : int
        Polynomial order of the edges.
    closed : bool
        Whether the last edge ends on the first node.
    elasticity : (3, 3) or (edges, 3, 3) array
        Plane elasticity matrix D in units of the modulus, or one for each sector that an edge spans with the
        scaling centre: interfaces run along the radii through vertices.
    density : (edges,) array, optional
        Densities of the sectors in units of the S-element's (default: 1).

    Raises
    ------
    SElementError
        If the scaling centre does not see the whole boundary.
    """
    nodes = coordinates.shape[-2]
    connectivity = edge_nodes(nodes, order, closed)
    quadrature = quadrature_points(coordinates, order, connectivity)
    values, derivatives, weights = tabulated(order, quadrature)
    # the edges of all S-elements in one row
    first, second, jacobian = strain_operators(
        coordinates[..., connectivity, :].reshape(-1, order + 1, 2), values, derivatives
    )
    edges, points, width = *jacobian.shape, order + 1
    if elasticity.ndim == 3:
        elasticity = elasticity[:, None]
    # one factor sqrt(weight |J|) in each operator, so that one product gives each matrix
    root = np.sqrt(weights * jacobian)[:, :, None, None, None]
    first, second = root * first, root * second
    stack = (edges, points * 3, 2 * width)
    stress_first = (elasticity @ first.reshape(edges, points, 3, 2 * width)).reshape(stack)
    stress_second = (elasticity @ second.reshape(edges, points, 3, 2 * width)).reshape(stack)
    first, second = (b.reshape(stack).transpose(0, 2, 1) for b in (first, second))
    mass = np.zeros((edges, width, 2, width, 2))
    weight = weights * jacobian if density is None else weights * jacobian * density[:, None]
    mass[:, :, 0, :, 0] = mass[:, :, 1, :, 1] = (values.T * weight[:, None, :]) @ values
    blocks = (
        first @ stress_first,
        second @ stress_first,
        second @ stress_second,
        mass.reshape(edges, 2 * width, 2 * width),
    )
    # The edges follow one another, so their blocks overlap at vertices only; a loop is assembled as a chain
    # and then closed.
    each = len(connectivity)
    size, step = 2 * (each * order + 1), 2 * order
    matrices = np.zeros((4, edges // each, size, size))
    stacked = np.stack(blocks).reshape(4, -1, each, 2 * width, 2 * width)
    for k in range(each):
        part = slice(k * step, k * step + 2 * width)
        matrices[..., part, part] += stacked[:, :, k]
    if closed:
        matrices[..., :2, :] += matrices[..., -2:, :]
        matrices[..., :2] += matrices[..., -2:]
        matrices = matrices[..., :-2, :-2]
    e0, e1, e2, m0 = matrices.reshape(4, *coordinates.shape[:-2], 2 * nodes, 2 * nodes)
    return Coefficients(e0, e1, e2, m0, straight=quadrature == order + 1)

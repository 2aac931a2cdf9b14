"""Displacement and stress at points anywhere in an S-element, as rows over its boundary displacements."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.polynomial import legendre

from meshing.gll import gll_nodes, shape_functions

from .coefficients import edge_nodes
from .face_tractions import FaceTractions
from .interior import Located, fields_at, in_chunks, in_own_frames, static_fields
from .sectors import Sectors

# A point this far outside the outline, relative to the size, counts as on it.
TOLERANCE = 1e-9
# Where the stress at the scaling centre of a closed S-element is taken: what varies there falls off like xi.
_CENTRE = 1e-4


def locate(shape: np.ndarray, order: int, closed: bool, points: np.ndarray, drawn: bool = False) -> Located:
    """Scaled boundary coordinates of points.

    Parameters
    ----------
    shape : (nodes, 2) array
        Boundary nodes about the scaling centre, counter-clockwise, in units of the size.
    order : int
    closed : bool
    points : (q, 2) array
        About the scaling centre, in units of the size.
    drawn : bool
        Points on the curves that edges stand for are on these edges, which leave them between their nodes.
    """
    points = np.atleast_2d(np.asarray(points, dtype=float))
    edges = edge_nodes(len(shape), order, closed)
    distance = np.hypot(*points.T)
    centre = distance <= TOLERANCE * 1e-3
    direction = points / np.where(centre, 1.0, distance)[:, None]
    across = np.stack([-direction[:, 1], direction[:, 0]], axis=1)
    # each edge turns counter-clockwise about the scaling centre, by less than half a turn
    first, last = shape[edges[:, 0]], shape[edges[:, -1]]
    sector = (across @ first.T <= TOLERANCE) & (across @ last.T >= -TOLERANCE)
    sector &= np.maximum(direction @ first.T, direction @ last.T) > 0.0
    sector[centre, 0] = True
    edge = np.where(sector.any(axis=1), sector.argmax(axis=1), -1)
    eta, level = np.zeros(len(points)), np.zeros(len(points))
    inside = np.flatnonzero((edge >= 0) & ~centre)
    eta[inside], reach = _meetings(shape[edges[edge[inside]]], order, direction[inside], across[inside])
    level[inside] = np.minimum(distance[inside] / reach, 1.0)
    beyond = TOLERANCE + (_left_of_curves(shape[edges], order) if drawn else np.zeros(len(edges)))
    edge[inside[distance[inside] > reach + beyond[edge[inside]]]] = -1
    return Located(edge, eta, level)


def _left_of_curves(nodes: np.ndarray, order: int) -> np.ndarray:
    """(edges,): how far curves may be from edges with nodes (edges, order + 1, 2) on them: four times the
    next of their Legendre coefficients, by the ratio of the last two; nothing of straight edges, as all of
    order 1 are.
    """
    table = np.linalg.inv(legendre.legvander(gll_nodes(order), order))
    before, last = np.linalg.norm(np.einsum("ka,eai->kei", table[-2:], nodes), axis=2)
    chord = nodes[:, -1] - nodes[:, 0]
    aside = np.abs(np.einsum("eai,ei->ea", nodes - nodes[:, :1], chord[:, ::-1] * (-1.0, 1.0))).max(axis=1)
    curved = (aside > TOLERANCE * (chord**2).sum(axis=1)) & (before > last)
    return 4.0 * last * np.divide(last, before, out=np.zeros_like(last), where=curved)


def _meetings(
    nodes: np.ndarray, order: int, direction: np.ndarray, across: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """eta and distances (q,) where rays from the scaling centre meet edges with nodes (q, order + 1, 2), by
    Newton's method between bounds; at once on straight edges.
    """
    sides = np.einsum("qai,qi->qa", nodes, across)
    low, high = np.full(len(nodes), -1.0), np.full(len(nodes), 1.0)
    eta = np.clip(-(sides[:, 0] + sides[:, -1]) / (sides[:, -1] - sides[:, 0]), -1.0, 1.0)
    for _ in range(60):
        values, slopes = shape_functions(order, eta)
        side = np.einsum("qa,qa->q", values, sides)
        low, high = np.where(side < 0.0, eta, low), np.where(side > 0.0, eta, high)
        following = eta - side / np.einsum("qa,qa->q", slopes, sides)
        outside = ~((following >= low) & (following <= high))
        following = np.where(outside, 0.5 * (low + high), following)
        moved = np.abs(following - eta)
        eta = following
        if len(eta) == 0 or moved.max() < 1e-15:
            break
    values = shape_functions(order, eta)[0]
    return eta, np.einsum("qa,qai,qi->q", values, nodes, direction)


@dataclass(frozen=True, eq=False)
class PointOperators:
    """Rows over (boundary displacements (n,) in m, face forces (m,) / (E thickness) in m).

    Attributes
    ----------
    displacement : (q, 2, n + m) array
        m.
    stress : (q, 3, n + m) array
        xx, yy, xy; times E / h gives Pa. nan at the scaling centre of an open S-element, where the stress of
        a tip has no limit.
    unknowns : int
        n.
    """

    displacement: np.ndarray
    stress: np.ndarray
    unknowns: int

    def turned(self, rotation: np.ndarray) -> PointOperators:
        """From the reference frame to that of an S-element placed with ``v_reference = rotation @ v``, for
        displacements of its own in the reference order of the nodes.
        """
        n = self.unknowns

        def columns(rows: np.ndarray) -> np.ndarray:
            nodal = rows[..., :n].reshape(*rows.shape[:2], -1, 2) @ rotation
            return np.concatenate([nodal.reshape(*rows.shape[:2], n), rows[..., n:]], axis=2)

        alike = np.broadcast_to(rotation, (self.stress.shape[2], 2, 2))
        found = in_own_frames(columns(self.displacement), columns(self.stress), alike)
        displacement, stress = (np.moveaxis(part, 0, 2) for part in found)
        return PointOperators(displacement, stress, n)


def point_operators(
    radial: np.ndarray,
    sectors: Sectors,
    *,
    located: Located,
    closed: bool,
    tractions: FaceTractions | None = None,
) -> PointOperators:
    """Rows for displacement and stress at points of one S-element, in its reference frame.

    Parameters
    ----------
    radial : (n, n) array
        A of the S-element.
    sectors : Sectors
    located : Located
        The points, from `locate`.
    closed : bool
    tractions : FaceTractions, optional
        Adds the columns of tractions on the faces of a tip element.

    Raises
    ------
    ValueError
        If a point lies outside.
    """
    if (located.edge < 0).any():
        missing = int(np.argmin(located.edge))
        raise ValueError(f"point {missing} lies outside the S-element; take only points that `locate` finds")
    n = len(radial)
    m = 0 if tractions is None else len(tractions.growth)
    faces = None if tractions is None else (tractions, np.eye(m, n + m, k=n))

    def of_some(some: Located) -> tuple[np.ndarray, np.ndarray]:
        # the stress of a closed S-element at its scaling centre is that next to it
        near = np.maximum(some.level, _CENTRE if closed else 0.0)
        fields = static_fields(radial, np.eye(n, n + m), some.level, near, faces)
        return fields_at(sectors, closed, some, fields, np.arange(len(near)))

    return PointOperators(*in_chunks(located, of_some), n)

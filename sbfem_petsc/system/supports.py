"""What supports do: their springs, and whether they hold every body."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from meshing.gll import tabulated

from ..selement.rigid_motions import rigid_motions
from ..supports import Support
from .layout.layout import Layout


def edge_metric(coordinates: np.ndarray, order: int) -> tuple[np.ndarray, np.ndarray]:
    """|dx/d eta| (edges, points) and outward unit normals (edges, points, 2) at the Gauss points.

    Parameters
    ----------
    coordinates : (edges, order + 1, 2) array
        m; the material lies on the left of an edge.
    order : int
    """
    _, derivatives, _ = tabulated(order, order + 2)
    tangent = derivatives @ coordinates
    length = np.sqrt((tangent**2).sum(axis=2))
    return length, np.stack([tangent[..., 1], -tangent[..., 0]], axis=-1) / length[..., None]


class Springs(NamedTuple):
    """An elastic support on this rank.

    Attributes
    ----------
    where : str
    nodes : (k, n) int array
        Rows of the part's nodes, an edge's in a row, or a point's.
    stiffness : (k, 2 n, 2 n) array
        N/m.
    """

    where: str
    nodes: np.ndarray
    stiffness: np.ndarray


def springs_of(layout: Layout, thickness: float, supports: Sequence[Support]) -> list[Springs]:
    """The elastic ones among supports; of a point on the lowest rank that has it. Collective."""
    part, order, found = layout.part, layout.order, []
    values, _, weights = tabulated(order, order + 2)
    for where, springs in ((support.where, np.array(support.springs)) for support in supports):
        if not springs.any():
            continue
        if where in layout.edge_sets:
            nodes = part.edge_sets[where]
            lengths, _ = edge_metric(part.coordinates[nodes], order)
            shares = np.einsum("eq,q,qa,qb->eab", lengths, weights, values, values)
            stiffness = np.kron(shares, np.diag(springs * thickness))
        else:
            mine = layout.comm.rank == min(layout.point_holders[where], default=-1)
            nodes = layout.node_of(where)[:mine, None]
            stiffness = np.tile(np.diag(springs), (len(nodes), 1, 1))
        found.append(Springs(where, nodes, stiffness))
    return found


def free_bodies(layout: Layout, supports: Sequence[Support]) -> list[int]:
    """Bodies of the structure that the supports leave a rigid-body motion. Collective."""
    held, directions = [np.empty((0, 2))], [np.empty((0, 2), dtype=bool)]
    bodies = [np.empty(0, dtype=int)]
    for support in supports:
        acts = np.array(support.fixed) | (np.array(support.springs) > 0)
        rows = layout.own_nodes_of(support.where)
        held.append(layout.part.coordinates[rows])
        bodies.append(layout.part.bodies[rows])
        directions.append(np.tile(acts, (len(rows), 1)))
    everything = layout.comm.allgather([np.concatenate(part) for part in (held, directions, bodies)])
    places, acts, body = (np.concatenate(part) for part in zip(*everything))
    lower, upper = layout.extent
    least = 1e-9 * float(np.linalg.norm(upper - lower))
    return [
        number
        for number in range(len(layout.bodies))
        if not _holds(places[body == number], acts[body == number], least)
    ]


def _holds(places: np.ndarray, acts: np.ndarray, least: float) -> bool:
    """Whether supports at places (n, 2) in some directions (n, 2) admit no rigid-body motion."""
    if len(places) == 0:
        return False
    # about the supports' own middle and in units of their own extent: a short clamped edge holds a long body;
    # where all stand on one point the rotation is free, whatever the unit
    size = max(float(np.linalg.norm(np.ptp(places, axis=0))), least)
    rows = rigid_motions((places - places.mean(axis=0)) / size).reshape(-1, 2, 3)[acts]
    gram = rows.T @ rows
    return bool(np.linalg.eigvalsh(gram)[0] > 1e-9 * max(np.trace(gram), 1.0))

"""What supports do: their springs, and whether they hold every body."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..selement.basis import tabulated
from ..supports import Support
from .layout.layout import Layout
from .solve.assembly import ElementBlocks


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


def spring_forces(layout: Layout, thickness: float, support: Support, field: np.ndarray) -> np.ndarray:
    """(m, 2): this rank's part of the forces on its nodes that elastic supports take up, N."""
    part, springs = layout.part, np.array(support.springs)
    forces = np.zeros_like(field)
    if not springs.any():
        return forces
    if support.where in layout.edge_sets:
        edges = part.edge_sets[support.where]
        if len(edges):
            values, _, weights = tabulated(layout.order, layout.order + 2)
            lengths, _ = edge_metric(part.coordinates[edges], layout.order)
            consistent = np.einsum("eq,q,qa,qb,ebi->eai", lengths, weights, values, values, field[edges])
            np.add.at(forces, edges, springs * thickness * consistent)
    elif layout.comm.rank == min(layout.point_holders[support.where], default=-1):
        node = layout.node_of(support.where)
        forces[node] = springs * field[node]
    return forces


def spring_blocks(layout: Layout, thickness: float, supports: Sequence[Support]) -> list[ElementBlocks]:
    """Blocks of the elastic supports."""
    blocks = []
    part, order = layout.part, layout.order
    values, _, weights = tabulated(order, order + 2)
    for support in supports:
        springs = np.array(support.springs)
        if not springs.any():
            continue
        if support.where in layout.edge_sets:
            edges = part.edge_sets[support.where]
            if len(edges) == 0:
                continue
            lengths, _ = edge_metric(part.coordinates[edges], order)
            stiffness = np.einsum(
                "eq,q,qa,qb,i,ij->eaibj",
                lengths,
                weights,
                values,
                values,
                springs * thickness,
                np.eye(2),
            )
            unknowns = part.unknowns[edges].reshape(len(edges), -1)
            stiffness = stiffness.reshape(len(edges), unknowns.shape[1], -1)
        elif layout.comm.rank == 0:
            unknowns = np.array(layout.points[support.where][1])[None, :]
            stiffness = np.diag(springs)[None]
        else:
            continue
        blocks.append(ElementBlocks(unknowns, unknowns, stiffness.__getitem__))
    return blocks


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
    x, y = ((places - places.mean(axis=0)) / size).T
    one, zero = np.ones(len(x)), np.zeros(len(x))
    rows = np.stack([np.stack([one, zero, -y], axis=1), np.stack([zero, one, x], axis=1)], axis=1)[acts]
    gram = rows.T @ rows
    return bool(np.linalg.eigvalsh(gram)[0] > 1e-9 * max(np.trace(gram), 1.0))

"""Forces of the supports on the structure, and its strain energy."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ...petsc import MPI
from ...selement.basis import tabulated
from ...supports import Support
from ..boundary import edge_metric

if TYPE_CHECKING:
    from ..structure import Structure


def reactions(model: Structure, field: np.ndarray, external: np.ndarray) -> dict[str, np.ndarray]:
    """Force of each support on the structure, (2,), N. Collective.

    Parameters
    ----------
    model : Structure
    field : (m, 2) array
        Displacements of this rank's nodes, m.
    external : (m, 2) array
        Loads and contact forces on this rank's nodes, N: sums over the ranks that share a node are the whole.

    Notes
    -----
    Where two supports hold one direction of a node, the force is counted for the first. The springs of an
    edge act on all its nodes, on one that another support holds too: what they do there is theirs.
    """
    part = model.part
    forces = -external.copy()
    for group in model.groups:
        moved = field[group.nodes].reshape(len(group.sizes), -1)
        inner = model.scales(group)[0] * np.einsum(
            "kij,kj->ki", group.turned_both(group.solution.stiffness), moved
        )
        np.add.at(forces, group.nodes, inner.reshape(*group.nodes.shape, 2))
    springs = [_spring_forces(model, support, field) for support in model.supports]
    forces += sum(springs)
    result: dict[str, np.ndarray] = {}
    taken = np.zeros(part.unknowns.shape, dtype=bool)
    for support, elastic in zip(model.supports, springs):
        nodes = _nodes_of(model, support.where)
        held = np.zeros_like(taken)
        held[nodes] = np.array(support.fixed)
        held &= ~taken
        taken |= held
        total = np.where(held, forces, 0.0).sum(axis=0) - elastic.sum(axis=0)
        model.comm.Allreduce(MPI.IN_PLACE, total)
        result[support.where] = result.get(support.where, np.zeros(2)) + total
    return result


def _nodes_of(model: Structure, where: str) -> np.ndarray:
    """This rank's nodes of an edge set or a point."""
    part = model.part
    if where in model.edge_set_names:
        # also nodes whose edge another rank holds: they are shared, and each rank has a part of the force
        numbers = [np.unique(part.nodes[part.edge_sets[where]])]
        everywhere = np.unique(np.concatenate(model.comm.allgather(numbers[0])))
        return np.flatnonzero(np.isin(part.nodes, everywhere))
    return np.flatnonzero(part.nodes == model.points[where][2])


def _spring_forces(model: Structure, support: Support, field: np.ndarray) -> np.ndarray:
    """(m, 2): this rank's part of the forces on its nodes that elastic supports take up, N."""
    part, springs = model.part, np.array(support.springs)
    forces = np.zeros_like(field)
    if not springs.any():
        return forces
    if support.where in model.edge_set_names:
        edges = part.edge_sets[support.where]
        if len(edges):
            values, _, weights = tabulated(model.order, model.order + 2)
            lengths, _ = edge_metric(part.coordinates[edges], model.order)
            consistent = np.einsum("eq,q,qa,qb,ebi->eai", lengths, weights, values, values, field[edges])
            np.add.at(forces, edges, springs * model.thickness * consistent)
    elif model.comm.rank == min(model.point_holders[support.where], default=-1):
        node = np.flatnonzero(part.nodes == model.points[support.where][2])
        forces[node] = springs * field[node]
    return forces

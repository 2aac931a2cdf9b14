"""Forces of the supports on the structure, and its strain energy."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ...petsc import MPI
from ..boundary import inner_forces, nodes_of, spring_forces

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
    forces = inner_forces(model, field) - external
    springs = [spring_forces(model, support, field) for support in model.supports]
    result: dict[str, np.ndarray] = {}
    taken = np.zeros(field.shape, dtype=bool)
    for support, elastic in zip(model.supports, springs):
        nodes = nodes_of(model, support.where)
        held = np.zeros_like(taken)
        held[nodes] = np.array(support.fixed)
        held &= ~taken
        taken |= held
        total = np.where(held, forces, 0.0).sum(axis=0) - elastic.sum(axis=0)
        model.comm.Allreduce(MPI.IN_PLACE, total)
        result[support.where] = result.get(support.where, np.zeros(2)) + total
    return result

"""Forces of the supports on the structure."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy import sparse

from ...petsc import MPI
from ..boundary import nodes_of, spring_forces

if TYPE_CHECKING:
    from ..structure import Structure


class SupportForces:
    """Forces of the supports as linear forms of the displacements and loads of the nodes. Collective.

    Parameters
    ----------
    model : Structure

    Notes
    -----
    Where two supports hold one direction of a node, the force is counted for the first. The springs of an
    edge act on all its nodes, on one that another support holds too: what they do there is theirs.
    """

    def __init__(self, model: Structure):
        self._model = model
        taken, held = np.zeros(model.part.unknowns.shape, dtype=bool), []
        for support in model.supports:
            mine = np.zeros_like(taken)
            mine[nodes_of(model, support.where)] = support.fixed
            held.append(mine & ~taken)
            taken |= mine
        self._held = np.array(held).reshape(len(held), *taken.shape)
        self._stiffness = self._rows()

    def _rows(self) -> sparse.csr_matrix:
        """(2 supports, 2 m): sums of the rows of this rank's S-elements' stiffness that supports hold."""
        model, none = self._model, np.empty(0, dtype=int)
        at, columns, values = [none], [none], [np.empty(0)]
        for group in model.groups:
            touched = np.flatnonzero(self._held[:, group.nodes].any(axis=(0, 2, 3)))
            if not len(touched):
                continue
            part = group.select(touched)
            matrices = model.scales(part)[0] * part.turned_both(part.solution.stiffness)
            rows = matrices.reshape(len(touched), -1, 2, matrices.shape[-1])
            sums = np.einsum("skai,kaij->sikj", self._held[:, part.nodes].astype(float), rows)
            numbers = np.arange(2 * len(self._held)).reshape(-1, 2, 1, 1)
            places = (2 * part.nodes[..., None] + [0, 1]).reshape(len(touched), -1)
            at.append(np.broadcast_to(numbers, sums.shape).ravel())
            columns.append(np.broadcast_to(places, sums.shape).ravel())
            values.append(sums.ravel())
        entries = np.concatenate(values), (np.concatenate(at), np.concatenate(columns))
        return sparse.coo_matrix(entries, shape=(2 * len(self._held), 2 * self._held.shape[1])).tocsr()

    def __call__(self, field: np.ndarray, external: np.ndarray) -> dict[str, np.ndarray]:
        """(2,) of each place that is supported, N. Collective.

        Parameters
        ----------
        field : (m, 2) array
            Displacements of this rank's nodes, m.
        external : (m, 2) array
            Loads and contact forces on this rank's nodes, N: sums over the ranks that share a node are the
            whole.
        """
        model = self._model
        springs = [spring_forces(model, support, field) for support in model.supports]
        resting = sum(springs, -external)
        total = (self._stiffness @ field.ravel()).reshape(-1, 2)
        for forces, held, elastic in zip(total, self._held, springs):
            forces += np.where(held, resting, 0.0).sum(axis=0) - elastic.sum(axis=0)
        model.comm.Allreduce(MPI.IN_PLACE, total)
        result: dict[str, np.ndarray] = {}
        for support, forces in zip(model.supports, total):
            result[support.where] = result.get(support.where, np.zeros(2)) + forces
        return result

"""Forces of the supports on the structure."""

from __future__ import annotations

import numpy as np
from scipy import sparse

from ...petsc import summed
from ..elements.elements import Elements
from ..elements.shapes import Group, add_forces
from ..solve.stiffness import Stiffness


class SupportForces:
    """Forces of the supports as linear forms of the displacements and loads of the nodes. Collective.

    Parameters
    ----------
    stiffness : Stiffness

    Attributes
    ----------
    names : tuple of str
        Places that are supported.

    Notes
    -----
    Where two supports hold one direction of a node, the force is counted for the first. The springs of an
    edge act on all its nodes, on one that another support holds too: what they do there is theirs.
    """

    def __init__(self, stiffness: Stiffness):
        self._statics, self._elements, self._layout = stiffness, stiffness.elements, stiffness.layout
        self._supports = stiffness.supports
        self.names = tuple(dict.fromkeys(support.where for support in self._supports))
        taken = np.zeros(self._layout.part.unknowns.shape, dtype=bool)
        self._held = np.zeros((len(self.names), *taken.shape), dtype=bool)
        for support in self._supports:
            mine = np.zeros_like(taken)
            mine[self._layout.nodes_of(support.where)] = support.fixed
            self._held[self.names.index(support.where)] |= mine & ~taken
            taken |= mine
        self._stiffness = self._rows()

    def _touched(self, group: Group) -> np.ndarray:
        """S-elements of a group with nodes that supports hold."""
        return np.flatnonzero(self._held[:, group.nodes].any(axis=(0, 2, 3)))

    def _rows(self) -> sparse.csr_matrix:
        """(2 names, 2 m): sums of the rows of this rank's S-elements' stiffness that supports hold."""
        elements, none = self._elements, np.empty(0, dtype=int)
        at, columns, values = [none], [none], [np.empty(0)]
        for group in elements.groups:
            touched = self._touched(group)
            if not len(touched):
                continue
            part = group.select(touched)
            matrices = elements.scales(part)[0] * part.turned_both(part.solution.stiffness)
            rows = matrices.reshape(len(touched), -1, 2, matrices.shape[-1])
            sums = np.einsum("skai,kaij->sikj", self._held[:, part.nodes].astype(float), rows)
            numbers = np.arange(2 * len(self._held)).reshape(-1, 2, 1, 1)
            places = (2 * part.nodes[..., None] + [0, 1]).reshape(len(touched), -1)
            at.append(np.broadcast_to(numbers, sums.shape).ravel())
            columns.append(np.broadcast_to(places, sums.shape).ravel())
            values.append(sums.ravel())
        entries = np.concatenate(values), (np.concatenate(at), np.concatenate(columns))
        return sparse.coo_matrix(entries, shape=(2 * len(self._held), 2 * self._held.shape[1])).tocsr()

    def _springs(self, field: np.ndarray) -> np.ndarray:
        """(names, m, 2): this rank's part of what elastic supports take up, N."""
        result = np.zeros((len(self.names), *field.shape))
        for spring in self._statics.springs:
            add_forces(result[self.names.index(spring.where)], spring.nodes, spring.stiffness, field)
        return result

    def _resting(self, springs: np.ndarray, external: np.ndarray | float) -> np.ndarray:
        """(names, 2): this rank's part of the forces, but for what S-elements pull with."""
        resting = springs.sum(axis=0) - external
        return np.where(self._held, resting, 0.0).sum(axis=1) - springs.sum(axis=1)

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
        total = (self._stiffness @ field.ravel()).reshape(-1, 2)
        total += self._resting(self._springs(field), external)
        return dict(zip(self.names, summed(self._layout.comm, total)))

    def of_modes(self, shapes: np.ndarray, omega: np.ndarray) -> np.ndarray:
        """(names, 2, n): in free vibrations of unit amplitude, inertia of what is held included, N.
        Collective.

        Parameters
        ----------
        shapes : (owned, n) array
            This rank's displacement unknowns of modes.
        omega : (n,) array
            rad/s.
        """
        layout = self._layout
        parts = [group.select(self._touched(group)) for group in self._elements.moving]
        parts = [part for part in parts if len(part.sizes)]
        rows = np.unique(np.concatenate([np.empty(0, dtype=int), *(part.nodes.ravel() for part in parts)]))
        total = np.zeros((len(self.names), 2, len(omega)))
        elastic = any(any(support.springs) for support in self._supports)
        fields = np.empty((len(rows), 2, len(omega)))
        for k, shape in enumerate(shapes.T):
            field = layout.nodal(shape)
            fields[:, :, k] = field[rows]
            if elastic:
                total[:, :, k] = self._resting(self._springs(field), 0.0)
        for part in parts:
            moved = fields[np.searchsorted(rows, part.nodes)].reshape(len(part.sizes), -1, len(omega))
            forces = dynamic_forces(self._elements, part, moved, omega)
            held = self._held[:, part.nodes].astype(float)
            total += np.einsum("skai,kain->sin", held, forces.reshape(*part.nodes.shape, 2, -1))
        return summed(layout.comm, total)

    def following(self) -> np.ndarray:
        """(m, 2, 2 names): static displacements of this rank's nodes where the ground of one support after
        the other moves by 1 along x and y; their products with forces on the nodes are what the support
        bears. Collective.
        """
        layout = self._layout
        shape = (*layout.part.unknowns.shape, 2 * len(self.names))
        forms, moved = self._stiffness.toarray().T.reshape(shape), np.zeros(shape)
        for k in range(shape[2]):
            name, axis = divmod(k, 2)
            moved[:, axis, k] = self._held[name, :, axis]
            whole = np.zeros(shape[:2])
            whole[:, axis] = 1.0
            forms[..., k] += self._springs(moved[..., k]).sum(axis=0) - self._springs(whole)[name]
        return moved + layout.nodal(self._statics.solver.columns(-layout.summed(forms), "reactions"))


def dynamic_forces(elements: Elements, part: Group, moved: np.ndarray, omega: np.ndarray) -> np.ndarray:
    """(k, unknowns, n): forces that S-elements take in harmonic motions of their boundaries, N.

    Parameters
    ----------
    part : Group
        Of `Elements.moving`.
    moved : (k, unknowns, n) array
        m.
    omega : (n,) array
        rad/s.
    """
    solution, (modulus, inertia) = part.solution, elements.scales(part)
    square = omega**2 * inertia[:, None, None] / modulus
    coupling = part.turned(solution.coupling)
    auxiliary = square**2 / (1.0 - square * solution.inertia[:, None]) * (coupling.transpose(0, 2, 1) @ moved)
    elastic = part.turned_both(solution.stiffness) @ moved - coupling @ auxiliary
    return modulus * (elastic - part.turned_both(solution.mass) @ (square * moved))

"""Loads of a structure: what they do to its nodes, its contact rows and its tips."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from meshing.gll import tabulated

from ..loads import Load, as_loads
from ..petsc import require_thread
from ..ranks.parallel import collective
from .contact.rows import Contact, rows_on
from .elements.elements import Elements
from .fields.tips import Tips
from .solve.stiffness import Stiffness
from .supports import edge_metric


class Lift(NamedTuple):
    """Displacements of what supports hold, while all else stands still, one column each.

    Attributes
    ----------
    nodal : (m, 2, k) array
        Of this rank's nodes, m.
    held : (h, k) array
        Of this rank's unknowns of `Layout.held`, m.
    forces : (owned, k) array
        What they pull at this rank's displacement unknowns with, N.
    gaps : (c, k) array
        Of the contact rows, m.
    points : (points, 2, k) array
        Of the named points, m.
    """

    nodal: np.ndarray
    held: np.ndarray
    forces: np.ndarray
    gaps: np.ndarray
    points: np.ndarray


@dataclass(frozen=True, eq=False)
class LoadColumns:
    """What loads do, one column each.

    Attributes
    ----------
    forces : (owned, k) array
        Nodal forces on this rank's displacement unknowns, N.
    gaps : (c, k) array
        Gaps of the contact rows that loads on the faces inside tip elements open at given displacements, m.
    tips : (2 tips, k) array
        Their share of K_I and K_II, Pa m^(1/2).
    flexibility : (k, k) array
        Their work on each other's displacements at given nodal displacements, J.
    nodal : (m, 2, k) array
        This rank's part of the forces on its nodes, also on those held fixed, N.
    tip_forces : dict of int to (modes, k) array
        Forces of the traction modes of the tips that this rank holds, N.
    acceleration : (2, k) array
        Of moving supports, m/s^2.
    lift : Lift or None
        Of edges with a prescribed displacement; its forces and gaps are among the others. None: all supports
        stand still.
    """

    forces: np.ndarray
    gaps: np.ndarray
    tips: np.ndarray
    flexibility: np.ndarray
    nodal: np.ndarray
    tip_forces: dict[int, np.ndarray]
    acceleration: np.ndarray
    lift: Lift | None = None

    def combined(self, amplitudes: np.ndarray) -> LoadColumns:
        """One column: the loads with their amplitudes (k,) together."""
        weights = np.asarray(amplitudes, dtype=float)[:, None]
        of_loads = {
            name: getattr(self, name) @ weights
            for name in ("forces", "gaps", "tips", "nodal", "acceleration")
        }
        return replace(
            self,
            flexibility=weights.T @ self.flexibility @ weights,
            tip_forces={number: table @ weights for number, table in self.tip_forces.items()},
            lift=None if self.lift is None else Lift(*(part @ weights for part in self.lift)),
            **of_loads,
        )


class NodalForces:
    """Collects what loads do that assemble themselves (`loads.LoadAssembler`).

    Parameters
    ----------
    stiffness : Stiffness
    tips : Tips
    """

    def __init__(self, stiffness: Stiffness, tips: Tips):
        self._layout, self._elements, self._tips = stiffness.layout, stiffness.elements, tips
        self.points, self.edge_sets = self._layout.points, self._layout.edge_sets
        self.inner_edges = self._layout.inner_edges
        self.supports = stiffness.supports
        # forces of the traction modes of the tips that this rank holds, and on its nodes
        self.tip_forces: dict[int, np.ndarray] = {}
        self.nodal = np.zeros((len(self._layout.part.nodes), 2))
        self.acceleration = np.zeros(2)
        self.lift = np.zeros((len(self._layout.part.nodes), 2))

    def point_force(self, point: str, force: tuple[float, float]) -> None:
        """Add a force (N) on a named point."""
        holders = self._layout.point_holders[point]
        if holders and holders[0] == self._layout.comm.rank:
            self._add(self._layout.node_of(point), np.array(force, dtype=float))

    def edge_traction(self, edge_set: str, traction: Callable[[np.ndarray], np.ndarray]) -> None:
        """Add a traction (Pa), a function of the outward normals, on the edges of a set.

        Of a crack's face the part inside a tip element belongs to the set.
        """
        part, order = self._layout.part, self._layout.order
        edges = part.edge_sets[edge_set]
        if len(edges):
            values, _, weights = tabulated(order, order + 2)
            length, normal = edge_metric(part.coordinates[edges], order)
            forces = np.einsum("q,eq,qa,eqi->eai", weights, length, values, traction(normal))
            self._add(edges, self._elements.thickness * forces)
        for faces in self._tips.faces.values():
            if edge_set in faces.sets:
                forces = faces.uniform(edge_set, traction, self._elements.thickness)
                self._add(faces.nodes, faces.rows.T @ forces)
                self.tip_forces[faces.number] = self.tip_forces.get(faces.number, 0.0) + forces

    def inertia(self, acceleration: tuple[float, float]) -> None:
        """Add the force -density * acceleration (m/s^2) on the whole body. Collective."""
        self.acceleration += acceleration
        self.nodal -= self._elements.inertia_forces(np.broadcast_to(acceleration, self.nodal.shape))

    def motion(self, where: str, displacement: tuple[float, float]) -> None:
        """Move what the supports of a place hold by a displacement (m). Collective."""
        part = self._layout.part
        mine = np.zeros((len(part.nodes), 2), dtype=bool)
        others: list[tuple[str, np.ndarray]] = []
        for support in self.supports:
            held = np.zeros_like(mine)
            held[self._layout.nodes_of(support.where)] = support.fixed
            if support.where == where:
                mine |= held
            else:
                others.append((support.where, held))
        mine &= np.array(displacement) != 0.0
        with collective(self._layout.comm):
            for name, held in others:
                if (mine & held).any():
                    row, k = np.argwhere(mine & held)[0]
                    x, y = part.coordinates[row]
                    raise ValueError(
                        f"EdgeMotion: at ({x:.6g}, {y:.6g}) m {where!r} is to move along {'xy'[k]}, which "
                        f"{name!r} holds there too; let one support alone hold it"
                    )
        self.lift += np.where(mine, displacement, 0.0)

    def _add(self, nodes: np.ndarray, forces: np.ndarray) -> None:
        """Forces (..., 2) or flat on rows of this rank's nodes."""
        np.add.at(self.nodal, nodes.ravel(), forces.reshape(-1, 2))


def load_columns(stiffness: Stiffness, contact: Contact, tips: Tips, loads: Sequence[Load]) -> LoadColumns:
    """What several constant, checked loads do. Collective."""
    require_thread()
    layout, elements = stiffness.layout, stiffness.elements
    count, factors, shape = len(loads), tips.intensities, layout.part.coordinates.shape
    nodal, lifts, accelerations = np.zeros((*shape, count)), np.zeros((*shape, count)), np.zeros((2, count))
    collected = []
    for k, load in enumerate(loads):
        assembler = NodalForces(stiffness, tips)
        for item in as_loads(load).parts:
            item.assemble(assembler)
        nodal[..., k], lifts[..., k] = assembler.nodal, assembler.lift
        accelerations[:, k] = assembler.acceleration
        collected.append(assembler.tip_forces)
    tip_forces: dict[int, np.ndarray] = {}
    gaps, intensities = np.zeros((len(contact), count)), np.zeros((len(factors.rows), count))
    flexibility = np.zeros((count, count))
    for faces in tips.faces.values():
        acting = [forces.get(faces.number) for forces in collected]
        if all(forces is None for forces in acting):
            continue
        table = np.stack([np.zeros(len(faces.flexibility)) if f is None else f for f in acting], axis=1)
        tip_forces[faces.number] = table
        means = faces.flexibility @ table
        faces.place(gaps.T, means.T)
        intensities[2 * faces.number : 2 * faces.number + 2] = factors.faces[faces.number] @ table
        flexibility += table.T @ means
    if accelerations.any():
        flexibility += accelerations.T @ _held_work(elements) @ accelerations
    gaps, intensities, flexibility = (
        layout.comm.allreduce(part) for part in (gaps, intensities, flexibility)
    )
    forces = layout.summed(nodal)
    found = LoadColumns(forces, gaps, intensities, flexibility, nodal, tip_forces, accelerations)
    if not layout.comm.allreduce(bool(lifts.any())):
        return found
    return _lifted(stiffness, tips, found, lifts)


def _lifted(stiffness: Stiffness, tips: Tips, columns: LoadColumns, nodal: np.ndarray) -> LoadColumns:
    """The loads with displacements (m, 2, k) of what supports hold, too. Collective."""
    layout, held = stiffness.layout, stiffness.layout.held
    inner = stiffness.inner_forces(nodal)
    forces = -layout.summed(inner)
    own = held.owned_values(nodal)
    lift = Lift(
        nodal,
        own,
        forces,
        rows_on(held, tips)(own),
        held.point_rows(own).reshape(len(layout.points), 2, own.shape[1]),
    )
    work = layout.comm.allreduce(np.einsum("nik,nil->kl", nodal, inner))
    return replace(
        columns,
        forces=np.asfortranarray(columns.forces + forces),
        gaps=columns.gaps + lift.gaps,
        tips=columns.tips + tips.intensities.rows_on(held)(own),
        flexibility=columns.flexibility + 0.5 * (work + work.T),
        lift=lift,
    )


def _held_work(elements: Elements) -> np.ndarray:
    """(2, 2), this rank's part: work of the inertia of unit accelerations on the displacements that it makes
    inside S-elements whose boundaries are held, J.
    """
    result = np.zeros((2, 2))
    for group in elements.moving:
        modulus, mass = elements.scales(group)
        # in the reference frame
        forces = group.solution.coupling.T @ np.tile(np.eye(2), (len(group.shape), 1))
        turned = forces @ group.rotations
        result += np.einsum("k,kai,kaj->ij", mass**2 / modulus, turned, turned)
    return result

"""Forces and springs on the boundary of this rank's S-elements, and forces of inertia."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..loads import Load, as_loads
from ..petsc import PETSc, free, require_thread
from ..ranks.parallel import collective
from ..selement.basis import tabulated
from ..supports import Support
from .solve.assembly import ElementBlocks

if TYPE_CHECKING:
    from .structure import Structure


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


class Lift(NamedTuple):
    """Displacements of what supports hold, while all else stands still, one column each.

    Attributes
    ----------
    nodal : (m, 2, k) array
        Of this rank's nodes, m.
    held : (h, k) array
        Of this rank's unknowns of `Structure.held`, m.
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
        flexibility = weights.T @ self.flexibility @ weights
        return LoadColumns(
            self.forces @ weights,
            self.gaps @ weights,
            self.tips @ weights,
            flexibility,
            self.nodal @ weights,
            {number: table @ weights for number, table in self.tip_forces.items()},
            self.acceleration @ weights,
            None if self.lift is None else Lift(*(part @ weights for part in self.lift)),
        )


class NodalForces:
    """Collects what loads do that assemble themselves (`loads.LoadAssembler`).

    Parameters
    ----------
    model : Structure
    vector : PETSc.Vec or None
        Over the displacement unknowns; the forces are added to it. None: for checks of places only.
    """

    def __init__(self, model: Structure, vector: PETSc.Vec | None):
        self._model, self._vector = model, vector
        self.points, self.edge_sets, self.supports = model.points, model.edge_set_names, model.supports
        # forces of the traction modes of the tips that this rank holds, and on its nodes
        self.tip_forces: dict[int, np.ndarray] = {}
        self.nodal = np.zeros((len(model.part.nodes), 2))
        self.acceleration = np.zeros(2)
        self.lift = np.zeros((len(model.part.nodes), 2))

    def point_force(self, point: str, force: tuple[float, float]) -> None:
        """Add a force (N) on a named point."""
        holders = self._model.point_holders[point]
        if holders and holders[0] == self._model.comm.rank:
            row = np.flatnonzero(self._model.part.nodes == self.points[point][2])
            self._add(row, np.array(force, dtype=float))

    def edge_traction(self, edge_set: str, traction: Callable[[np.ndarray], np.ndarray]) -> None:
        """Add a traction (Pa), a function of the outward normals, on the edges of a set.

        Of a crack's face the part inside a tip element belongs to the set.
        """
        part, order = self._model.part, self._model.order
        edges = part.edge_sets[edge_set]
        if len(edges):
            values, _, weights = tabulated(order, order + 2)
            length, normal = edge_metric(part.coordinates[edges], order)
            forces = np.einsum("q,eq,qa,eqi->eai", weights, length, values, traction(normal))
            self._add(edges, self._model.thickness * forces)
        for faces in self._model.tip_faces:
            if edge_set in faces.sets:
                forces = faces.uniform(edge_set, traction, self._model.thickness)
                self._add(faces.group.nodes[faces.member], faces.rows.T @ forces)
                self.tip_forces[faces.number] = self.tip_forces.get(faces.number, 0.0) + forces

    def inertia(self, acceleration: tuple[float, float]) -> None:
        """Add the force -density * acceleration (m/s^2) on the whole body. Collective."""
        model = self._model
        self.acceleration += acceleration
        for group in model.moving_groups:
            # of unit accelerations in the reference frame
            units = group.solution.mass @ np.tile(np.eye(2), (len(group.shape), 1))
            steady = -model.scales(group)[1][:, None, None] * (group.rotations @ acceleration)[:, :, None]
            self._add(group.nodes, np.matmul(group.turned(units), steady))

    def motion(self, where: str, displacement: tuple[float, float]) -> None:
        """Move what the supports of a place hold by a displacement (m). Collective."""
        part, mine = self._model.part, np.zeros((len(self._model.part.nodes), 2), dtype=bool)
        others: list[tuple[str, np.ndarray]] = []
        for support in self.supports:
            held = np.zeros_like(mine)
            held[nodes_of(self._model, support.where)] = support.fixed
            if support.where == where:
                mine |= held
            else:
                others.append((support.where, held))
        mine &= np.array(displacement) != 0.0
        with collective(self._model.comm):
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
        nodes, forces = nodes.ravel(), forces.reshape(-1, 2)
        np.add.at(self.nodal, nodes, forces)
        unknowns, values = self._model.part.unknowns[nodes].ravel(), forces.ravel()
        keep = unknowns >= 0
        assert self._vector is not None
        self._vector.setValues(unknowns[keep].astype(PETSc.IntType), values[keep], addv=True)


def load_columns(model: Structure, loads: Sequence[Load]) -> LoadColumns:
    """What several constant, checked loads do. Collective."""
    require_thread()
    columns, collected, nodal, lifts = [], [], [], []
    accelerations = np.zeros((2, len(loads)))
    vector = model.stiffness.createVecRight()
    try:
        for k, load in enumerate(loads):
            vector.set(0.0)
            assembler = NodalForces(model, vector)
            for item in as_loads(load).parts:
                item.assemble(assembler)
            vector.assemble()
            lifts.append(assembler.lift)
            columns.append(vector.array_r.copy())
            collected.append(assembler.tip_forces)
            nodal.append(assembler.nodal)
            accelerations[:, k] = assembler.acceleration
    finally:
        free(model.comm, vector)
    tip_forces: dict[int, np.ndarray] = {}
    count, gap, tips = len(columns), model.gap_operator, model.tips
    gaps, intensities, flexibility = (
        np.zeros((len(gap), count)),
        np.zeros((len(tips.rows), count)),
        np.zeros((count, count)),
    )
    for faces in model.tip_faces:
        acting = [forces.get(faces.number) for forces in collected]
        if all(forces is None for forces in acting):
            continue
        table = np.stack([np.zeros(len(faces.flexibility)) if f is None else f for f in acting], axis=1)
        tip_forces[faces.number] = table
        means = faces.flexibility @ table
        faces.place(gaps.T, means.T)
        intensities[2 * faces.number : 2 * faces.number + 2] = tips.faces[faces.number] @ table
        flexibility += table.T @ means
    if accelerations.any():
        flexibility += accelerations.T @ _held_work(model) @ accelerations
    gaps, intensities, flexibility = (model.comm.allreduce(part) for part in (gaps, intensities, flexibility))
    size = model.owned.stop - model.owned.start
    forces = np.asfortranarray(np.stack(columns, axis=1)) if columns else np.zeros((size, 0), order="F")
    on_nodes = np.stack(nodal, axis=2) if nodal else np.zeros((len(model.part.nodes), 2, 0))
    found = LoadColumns(forces, gaps, intensities, flexibility, on_nodes, tip_forces, accelerations)
    if not model.comm.allreduce(any(lift.any() for lift in lifts)):
        return found
    return _lifted(model, found, np.stack(lifts, axis=2))


def _lifted(model: Structure, columns: LoadColumns, nodal: np.ndarray) -> LoadColumns:
    """The loads with displacements (m, 2, k) of what supports hold, too. Collective."""
    held = model.held
    inner = np.stack([inner_forces(model, field) for field in np.moveaxis(nodal, 2, 0)], axis=2)
    forces = -np.stack([model.summed_nodal(part) for part in np.moveaxis(inner, 2, 0)], axis=1)
    own = owned_values(held, nodal)
    lift = Lift(
        nodal,
        own,
        forces,
        held.gap_operator.rows(own),
        held.point_rows(own).reshape(len(model.points), 2, own.shape[1]),
    )
    work = model.comm.allreduce(np.einsum("nik,nil->kl", nodal, inner))
    return replace(
        columns,
        forces=np.asfortranarray(columns.forces + forces),
        gaps=columns.gaps + lift.gaps,
        tips=columns.tips + held.tips.rows(own),
        flexibility=columns.flexibility + 0.5 * (work + work.T),
        lift=lift,
    )


def inner_forces(model: Structure, field: np.ndarray) -> np.ndarray:
    """(m, 2): this rank's part of the nodal forces that displacements (m, 2) of its nodes take, those of
    elastic supports included, N.
    """
    forces = np.zeros_like(field)
    for group in model.groups:
        moved = field[group.nodes].reshape(len(group.sizes), -1)
        inner = model.scales(group)[0] * np.einsum(
            "kij,kj->ki", group.turned_both(group.solution.stiffness), moved
        )
        np.add.at(forces, group.nodes, inner.reshape(*group.nodes.shape, 2))
    return forces + sum(spring_forces(model, support, field) for support in model.supports)


def inertia_forces(model: Structure, field: np.ndarray) -> np.ndarray:
    """(m, 2): this rank's part of the nodal forces of inertia under accelerations (m, 2) of its nodes that
    the insides of S-elements follow as they do at rest, N.
    """
    forces = np.zeros_like(field)
    for group in model.moving_groups:
        moved = field[group.nodes].reshape(len(group.sizes), -1, 1)
        inertia = model.scales(group)[1][:, None, None] * (group.turned_both(group.solution.mass) @ moved)
        np.add.at(forces, group.nodes, inertia.reshape(*group.nodes.shape, 2))
    return forces


def owned_values(model: Structure, field: np.ndarray) -> np.ndarray:
    """This rank's displacement unknowns (owned, ...) of a field (m, 2, ...) at its nodes."""
    owned, unknowns = model.owned, model.part.unknowns
    mine = (unknowns >= owned.start) & (unknowns < owned.stop)
    values = np.zeros((owned.stop - owned.start, *field.shape[2:]))
    values[unknowns[mine] - owned.start] = field[mine]
    return values


def nodes_of(model: Structure, where: str) -> np.ndarray:
    """This rank's nodes of an edge set or a point, as rows. Collective."""
    part = model.part
    if where in model.edge_set_names:
        # also nodes whose edge another rank holds: they are shared, and each rank has a part of the force
        numbers = np.unique(part.nodes[part.edge_sets[where]])
        everywhere = np.unique(np.concatenate(model.comm.allgather(numbers)))
        return np.flatnonzero(np.isin(part.nodes, everywhere))
    return np.flatnonzero(part.nodes == model.points[where][2])


def spring_forces(model: Structure, support: Support, field: np.ndarray) -> np.ndarray:
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


def _held_work(model: Structure) -> np.ndarray:
    """(2, 2), this rank's part: work of the inertia of unit accelerations on the displacements that it makes
    inside S-elements whose boundaries are held, J.
    """
    result = np.zeros((2, 2))
    for group in model.moving_groups:
        modulus, mass = model.scales(group)
        # in the reference frame
        forces = group.solution.coupling.T @ np.tile(np.eye(2), (len(group.shape), 1))
        turned = forces @ group.rotations
        result += np.einsum("k,kai,kaj->ij", mass**2 / modulus, turned, turned)
    return result


def spring_blocks(model: Structure) -> list[ElementBlocks]:
    """Blocks of the elastic supports."""
    blocks = []
    part, order = model.part, model.order
    values, _, weights = tabulated(order, order + 2)
    for support in model.supports:
        springs = np.array(support.springs)
        if not springs.any():
            continue
        if support.where in model.edge_set_names:
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
                springs * model.thickness,
                np.eye(2),
            )
            unknowns = part.unknowns[edges].reshape(len(edges), -1)
            stiffness = stiffness.reshape(len(edges), unknowns.shape[1], -1)
        elif model.comm.rank == 0:
            unknowns = np.array(model.points[support.where][1])[None, :]
            stiffness = np.diag(springs)[None]
        else:
            continue
        blocks.append(ElementBlocks(unknowns, unknowns, stiffness.__getitem__))
    return blocks


def free_bodies(model: Structure) -> list[int]:
    """Bodies of the structure that the supports leave a rigid-body motion. Collective."""
    held, directions = [np.empty((0, 2))], [np.empty((0, 2), dtype=bool)]
    bodies = [np.empty(0, dtype=int)]
    for support in model.supports:
        acts = np.array(support.fixed) | (np.array(support.springs) > 0)
        if support.where in model.edge_set_names:
            rows = np.unique(model.part.edge_sets[support.where])
        else:
            rows = np.flatnonzero(model.part.nodes == model.points[support.where][2])
        held.append(model.part.coordinates[rows])
        bodies.append(model.part.bodies[rows])
        directions.append(np.tile(acts, (len(rows), 1)))
    everything = model.comm.allgather([np.concatenate(part) for part in (held, directions, bodies)])
    places, acts, body = (np.concatenate(part) for part in zip(*everything))
    lower, upper = model.extent
    least = 1e-9 * float(np.linalg.norm(upper - lower))
    return [
        number
        for number in range(len(model.bodies))
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

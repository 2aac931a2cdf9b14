"""The layout of a structure over its ranks: places, names, numbered unknowns, and this rank's part."""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from meshing.mesh_arrays import ContactPairs, Crack, Tip

from ...errors import SolveError
from ...petsc import MPI, PETSc, require_thread
from ...ranks.parallel import alone
from .partition import Part
from .rows import Rows


class Ghosts(NamedTuple):
    """Scatter from the distributed displacement unknowns to those of this rank's nodes.

    Attributes
    ----------
    scatter : Scatter
    source, target : Vec
        All unknowns, and those of this rank's nodes.
    free : (m, 2) array
        False where held fixed.
    """

    scatter: PETSc.Scatter
    source: PETSc.Vec
    target: PETSc.Vec
    free: np.ndarray


@dataclass(eq=False)
class Layout:
    """Facts that every rank knows, and this rank's part of the mesh.

    Attributes
    ----------
    comm : Comm
    order, elements : int
    cracks : tuple of Crack
    tip_elements : tuple of Tip
        Those that have an S-element around them.
    material_names, edge_sets : tuple of str
    compositions : tuple of tuple of int
        Materials around S-elements in several of them; `Part.materials` counts on from the names.
    inner_edges : dict of str to int
        How many edges of each set have S-elements on both sides.
    pairs : ContactPairs
    points : dict of str to ((x, y), (2,) int tuple, int)
        Place, m, unknowns and node of each named point.
    pair_unknowns : (pairs, 2, 2) int array
        Unknowns of both nodes of each pair, -1 where held fixed.
    bodies : tuple of (x, y)
        Middle of each body, m; more than one where cracks cut through the structure.
    extent : ((2,) array, (2,) array)
        Least and greatest coordinates, m.
    area, perimeter : float
        m^2, m.
    ranges : (ranks + 1,) int array
        Rank r owns the unknowns ``ranges[r]`` to ``ranges[r + 1] - 1``.
    part : Part
    freed : bool
        Whether its PETSc objects, and those of all that is made on it, have been freed for good.
    """

    comm: MPI.Comm
    order: int
    elements: int
    cracks: tuple[Crack, ...]
    tip_elements: tuple[Tip, ...]
    material_names: tuple[str, ...]
    compositions: tuple[tuple[int, ...], ...]
    edge_sets: tuple[str, ...]
    inner_edges: dict[str, int]
    pairs: ContactPairs
    points: dict[str, tuple[tuple[float, float], tuple[int, int], int]]
    pair_unknowns: np.ndarray
    bodies: tuple[tuple[float, float], ...]
    extent: tuple[np.ndarray, np.ndarray]
    area: float
    perimeter: float
    ranges: np.ndarray
    part: Part
    freed: bool = field(default=False, init=False)
    _scatter: Ghosts | None = field(default=None, init=False, repr=False)

    @property
    def count(self) -> int:
        """Number of displacement unknowns, of all ranks."""
        return int(self.ranges[-1])

    @property
    def owned(self) -> slice:
        """Numbers of the displacement unknowns that this rank owns."""
        return slice(int(self.ranges[self.comm.rank]), int(self.ranges[self.comm.rank + 1]))

    def nodes_of(self, where: str) -> np.ndarray:
        """This rank's nodes of an edge set or a point, as rows. Collective."""
        part = self.part
        if where in self.edge_sets:
            # also nodes whose edge another rank holds: they are shared, and each rank has a part of the force
            numbers = np.unique(part.nodes[part.edge_sets[where]])
            everywhere = np.unique(np.concatenate(self.comm.allgather(numbers)))
            return np.flatnonzero(np.isin(part.nodes, everywhere))
        return self.node_of(where)

    def node_of(self, point: str) -> np.ndarray:
        """The row of a named point's node, where this rank has it."""
        return np.flatnonzero(self.part.nodes == self.points[point][2])

    def own_nodes_of(self, where: str) -> np.ndarray:
        """Nodes of this rank's edges of a set, or of a point, as rows."""
        if where in self.edge_sets:
            return np.unique(self.part.edge_sets[where]).astype(int)
        return self.node_of(where)

    @functools.cached_property
    def point_holders(self) -> dict[str, list[int]]:
        """Ranks whose S-elements touch each named point. Collective."""
        held = [name for name, (_, _, node) in self.points.items() if (self.part.nodes == node).any()]
        everywhere = self.comm.allgather(held)
        return {name: [r for r, names in enumerate(everywhere) if name in names] for name in self.points}

    @functools.cached_property
    def pair_rows(self) -> np.ndarray:
        """(pairs, 2): both nodes of each pair among this rank's, -1 where a lower rank touches them, or this
        one does not. Collective.
        """
        nodes, mine, comm = self.pairs.nodes.reshape(-1, 2), self.part.nodes, self.comm
        lowest = np.where(np.isin(nodes, mine), comm.rank, comm.size)
        comm.Allreduce(MPI.IN_PLACE, lowest, MPI.MIN)
        return np.where(lowest == comm.rank, np.searchsorted(mine, nodes), -1)

    @functools.cached_property
    def point_rows(self) -> Rows:
        """x and y displacement of each named point, two rows a point. Collective."""
        unknowns = np.array([place for _, place, _ in self.points.values()]).reshape(-1, 1)
        blocks = [(np.arange(len(unknowns)), unknowns, np.ones_like(unknowns, dtype=float))]
        own = blocks if self.comm.rank == 0 else []
        return Rows.gathered(self.comm, self.ranges, own, len(unknowns))

    @functools.cached_property
    def element_boxes(self) -> np.ndarray:
        """(elements, 4): least and greatest x and y of this rank's S-elements, their scaling centres
        included, m.
        """
        boxes = []
        for chain, centre in zip(self.part.chains, self.part.centres):
            places = np.vstack([self.part.coordinates[chain], centre])
            boxes.append([*places.min(axis=0), *places.max(axis=0)])
        return np.array(boxes).reshape(-1, 4)

    @functools.cached_property
    def held(self) -> Layout:
        """The same with what supports hold fixed in the place of the displacement unknowns: its rows are
        those of prescribed displacements. Collective.
        """
        part, comm = self.part, self.comm
        mine = np.argwhere(part.unknowns < 0)
        keys = [2 * part.nodes[row] + k for row, k in mine]
        # each belongs to the lowest rank that touches it
        owners: dict[int, int] = {}
        for rank, others in enumerate(comm.allgather(keys)):
            owners |= {key: rank for key in others if key not in owners}
        ordered = sorted(owners, key=lambda key: (owners[key], key))
        number = {key: k for k, key in enumerate(ordered)}
        counts = np.bincount(list(owners.values()), minlength=comm.size)
        unknowns = np.full_like(part.unknowns, -1)
        unknowns[tuple(mine.T)] = [number[key] for key in keys]

        def of(node: int) -> tuple[int, int]:
            return number.get(2 * node, -1), number.get(2 * node + 1, -1)

        pairs = [of(int(node)) for node in self.pairs.nodes.ravel()]
        return replace(
            self,
            ranges=np.concatenate([[0], np.cumsum(counts)]),
            part=replace(part, unknowns=unknowns),
            points={name: (at, of(node), node) for name, (at, _, node) in self.points.items()},
            pair_unknowns=np.array(pairs, dtype=int).reshape(-1, 2, 2),
        )

    # ------------------------------------------------------------------ fields
    def owned_values(self, field: np.ndarray) -> np.ndarray:
        """This rank's displacement unknowns (owned, ...) of a field (m, 2, ...) at its nodes."""
        owned, unknowns = self.owned, self.part.unknowns
        mine = (unknowns >= owned.start) & (unknowns < owned.stop)
        values = np.zeros((owned.stop - owned.start, *field.shape[2:]))
        values[unknowns[mine] - owned.start] = field[mine]
        return values

    def at_points(self, owned: np.ndarray) -> dict[str, np.ndarray]:
        """Displacement of every named point, on all ranks. Collective.

        Parameters
        ----------
        owned : (k,) or (k, n) array
            This rank's displacement unknowns, of one field or of n fields.

        Returns
        -------
        dict of str to (2,) or (n, 2) array
        """
        table = self.point_rows(owned).reshape(len(self.points), 2, *owned.shape[1:])
        return dict(zip(self.points, np.moveaxis(table, 1, -1)))

    @property
    def _ghosts(self) -> Ghosts:
        if self._scatter is None:
            self.require_unfreed()
            free = self.part.unknowns >= 0
            needed = self.part.unknowns[free].astype(PETSc.IntType)
            places = PETSc.IS().createGeneral(needed, comm=PETSc.COMM_SELF)
            target = PETSc.Vec().createSeq(len(needed))
            source = PETSc.Vec().createMPI((self.owned.stop - self.owned.start, self.count), comm=self.comm)
            self._scatter = Ghosts(PETSc.Scatter().create(source, places, target, None), source, target, free)
            places.destroy()
        return self._scatter

    def nodal(self, owned: np.ndarray) -> np.ndarray:
        """Displacements (m, 2, ...) of this rank's nodes from its displacement unknowns (owned, ...), of one
        field or of several; 0 where held fixed. Collective.
        """
        require_thread()
        scatter, source, target, free = self._ghosts
        columns = owned.reshape(len(owned), math.prod(owned.shape[1:])).T
        fields = np.zeros((len(columns), *free.shape))
        for column, one in zip(columns, fields):
            source.array = column
            scatter.scatter(source, target)
            one[free] = target.array_r
        return np.moveaxis(fields, 0, 2).reshape(*free.shape, *owned.shape[1:])

    def summed(self, forces: np.ndarray) -> np.ndarray:
        """(owned, ...): sums over the ranks of forces (m, 2, ...) on this rank's nodes, on its displacement
        unknowns. Collective.
        """
        require_thread()
        scatter, source, target, free = self._ghosts
        given = forces[free]
        columns = given.reshape(len(given), math.prod(given.shape[1:]))
        result = np.empty((source.getLocalSize(), columns.shape[1]), order="F")
        for k, column in enumerate(columns.T):
            target.array = column
            source.set(0.0)
            scatter.scatter(target, source, addv=True, mode=PETSc.ScatterMode.REVERSE)
            result[:, k] = source.array_r
        return result.reshape(len(result), *given.shape[1:])

    # ------------------------------------------------------------------ its end
    def require_unfreed(self) -> None:
        """Raise SolveError if it has been destroyed."""
        if self.freed:
            raise SolveError("Model: it has been destroyed; make it again, or use it inside its `with` block")

    def destroy(self) -> None:
        """Free the PETSc objects, unless this rank is alone at the end of the program."""
        if alone(self.comm):
            return
        self.freed = True
        made, self._scatter = self._scatter, None
        for item in (made or ())[:3]:
            item.destroy()

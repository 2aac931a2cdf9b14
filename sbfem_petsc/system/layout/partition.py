"""S-elements over ranks: recursive bisection, ownership of nodes, numbering, and the part each rank holds."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import connected_components

from meshing.boundary_mesh import BoundaryMesh


@dataclass(frozen=True, eq=False)
class Numbering:
    """Global numbers of the displacement unknowns.

    Attributes
    ----------
    assignment : (elements,) int array
        Rank of each S-element.
    unknowns : (nodes, 2) int array
        Number of the x and y unknown of each node, -1 where held fixed; contiguous per rank.
    ranges : (ranks + 1,) int array
        Rank r owns the unknowns ``ranges[r]`` to ``ranges[r + 1] - 1``.
    """

    assignment: np.ndarray
    unknowns: np.ndarray
    ranges: np.ndarray


@dataclass(frozen=True, eq=False)
class Part:
    """What one rank holds of a boundary mesh.

    Attributes
    ----------
    nodes : (m,) int array
        Global numbers of the nodes that the rank's S-elements touch.
    coordinates : (m, 2) array
        m.
    bodies : (m,) int array
        Body of each of these nodes, see `bodies`.
    unknowns : (m, 2) int array
        Global numbers of their displacement unknowns, -1 where held fixed.
    elements : (e,) int array
        Global numbers of the rank's S-elements.
    chains : list of int arrays
        Nodes of each S-element, counter-clockwise, as rows of `nodes`.
    centres : (e, 2) array
    closed : (e,) bool array
    materials : (e,) int array
        Index into the mesh's materials; beyond them, into its `compositions`.
    edge_sets : dict of str to (k, p + 1) int arrays
        Edges of the named sets that belong to the rank's S-elements (material on the left), as rows of
        `nodes`.
    """

    nodes: np.ndarray
    coordinates: np.ndarray
    bodies: np.ndarray
    unknowns: np.ndarray
    elements: np.ndarray
    chains: list[np.ndarray]
    centres: np.ndarray
    closed: np.ndarray
    materials: np.ndarray
    edge_sets: dict[str, np.ndarray]


def bisect(centroids: np.ndarray, weights: np.ndarray, ranks: int) -> np.ndarray:
    """Rank of each element by recursive coordinate bisection with balanced weights, shape (elements,)."""
    assignment = np.zeros(len(weights), dtype=int)

    def split(members: np.ndarray, first: int, count: int) -> None:
        if count == 1 or len(members) == 0:
            assignment[members] = first
            return
        lower = count // 2
        extent = np.ptp(centroids[members], axis=0)
        order = members[np.lexsort((members, np.round(centroids[members, int(np.argmax(extent))], 12)))]
        cumulative = np.cumsum(weights[order])
        cut = int(np.searchsorted(cumulative, cumulative[-1] * lower / count, side="right"))
        if len(order) >= count:
            cut = min(max(cut, lower), len(order) - (count - lower))
        split(order[:cut], first, lower)
        split(order[cut:], first + lower, count - lower)

    split(np.arange(len(weights)), 0, ranks)
    return assignment


def number_unknowns(mesh: BoundaryMesh, fixed: np.ndarray, ranks: int) -> Numbering:
    """Distribute the S-elements of a boundary mesh and number the free displacement unknowns.

    Parameters
    ----------
    mesh : BoundaryMesh
    fixed : (nodes, 2) bool array
    ranks : int
    """
    edges_of = np.diff(mesh.element_start)
    element_of = np.repeat(np.arange(mesh.elements), edges_of)
    ends = mesh.nodes[mesh.edges[mesh.element_edges][:, [0, -1]]].mean(axis=1)
    centroids = np.stack(
        [np.bincount(element_of, ends[:, k], mesh.elements) / edges_of for k in (0, 1)], axis=1
    )
    # the cost of an S-element grows with the cube of its unknowns
    assignment = bisect(centroids, (edges_of * mesh.order) ** 3.0, ranks)
    owner = np.full(len(mesh.nodes), ranks)
    touching = mesh.edges[mesh.element_edges]
    np.minimum.at(owner, touching, assignment[element_of][:, None])
    order = np.lexsort((np.arange(len(owner)), owner))
    free = ~fixed & (owner < ranks)[:, None]
    unknowns = np.full((len(owner), 2), -1)
    flags = free[order].ravel()
    numbers = np.full(flags.shape, -1)
    numbers[flags] = np.arange(flags.sum())
    unknowns[order] = numbers.reshape(-1, 2)
    counts = np.bincount(np.repeat(owner, free.sum(axis=1)), minlength=ranks)[:ranks]
    return Numbering(assignment, unknowns, np.concatenate([[0], np.cumsum(counts)]))


def bodies(mesh: BoundaryMesh) -> np.ndarray:
    """(nodes,): number of the body that each node belongs to; a crack through a structure cuts it into
    bodies, which contact alone joins. -1 of nodes without an S-element.
    """
    element_of = np.repeat(np.arange(mesh.elements), np.diff(mesh.element_start) * (mesh.order + 1))
    nodes = mesh.edges[mesh.element_edges].ravel()
    count = mesh.elements + len(mesh.nodes)
    links = sparse.coo_matrix(
        (np.ones(len(nodes)), (element_of, mesh.elements + nodes)), shape=(count, count)
    )
    _, label = connected_components(links, directed=False)
    _, body = np.unique(label[: mesh.elements], return_inverse=True)
    result = np.full(len(mesh.nodes), -1)
    result[nodes] = body[element_of]
    return result


def compositions(mesh: BoundaryMesh) -> tuple[tuple[int, ...], ...]:
    """The different sequences of materials around S-elements in several of them."""
    return tuple(sorted({tuple(part.tolist()) for part in mesh.sector_materials.values()}))


def _outlines(mesh: BoundaryMesh, element_of: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Nodes of all S-elements, one after the other as `BoundaryMesh.element_nodes` gives them, and where in
    them each S-element begins: of many S-elements at once a tenth of the time.

    Parameters
    ----------
    mesh : BoundaryMesh
    element_of : int array
        S-element of each entry of `element_edges`.
    """
    edges = mesh.edges[mesh.element_edges]
    edges = np.where(mesh.element_reversed[:, None], edges[:, ::-1], edges)
    lengths = np.diff(mesh.element_start) * mesh.order + ~mesh.closed
    starts = np.concatenate([[0], np.cumsum(lengths)])
    nodes = np.empty(starts[-1], dtype=int)
    within = np.arange(len(edges)) - mesh.element_start[element_of]
    nodes[(starts[element_of] + mesh.order * within)[:, None] + np.arange(mesh.order)] = edges[:, :-1]
    opened = np.flatnonzero(~mesh.closed)
    nodes[starts[opened + 1] - 1] = edges[mesh.element_start[opened + 1] - 1, -1]
    return nodes, starts


class Parts:
    """Cuts a boundary mesh into the parts of the ranks.

    Parameters
    ----------
    mesh : BoundaryMesh
    numbering : Numbering

    Attributes
    ----------
    bodies : (nodes,) int array
        See `bodies`.
    """

    def __init__(self, mesh: BoundaryMesh, numbering: Numbering):
        self._mesh, self._numbering, self.bodies = mesh, numbering, bodies(mesh)
        self._order = np.argsort(numbering.assignment, kind="stable")
        element_of = np.repeat(np.arange(mesh.elements), np.diff(mesh.element_start))
        # An edge of a set on an interface belongs to the lowest of its elements, which is written last.
        lowest = np.full(len(mesh.edges), -1)
        self._backwards = np.zeros(len(mesh.edges), dtype=bool)
        lowest[mesh.element_edges[::-1]] = element_of[::-1]
        self._backwards[mesh.element_edges[::-1]] = mesh.element_reversed[::-1]
        self._outlines, self._starts = _outlines(mesh, element_of)
        self._rank_of_edge = np.where(lowest >= 0, numbering.assignment[lowest], -1)
        self._materials = mesh.materials.copy()
        known = compositions(mesh)
        for element, sectors in mesh.sector_materials.items():
            self._materials[element] = len(mesh.material_names) + known.index(tuple(sectors.tolist()))

    def of(self, rank: int) -> Part:
        """The part that a rank holds."""
        mesh, assignment = self._mesh, self._numbering.assignment
        first, last = np.searchsorted(assignment, (rank, rank + 1), sorter=self._order)
        elements = self._order[first:last]
        starts, ends = self._starts[elements], self._starts[elements + 1]
        lasts = np.cumsum(ends - starts)
        firsts = lasts - (ends - starts)
        places = np.repeat(starts - firsts, ends - starts)
        places += np.arange(len(places))
        nodes, flat = np.unique(self._outlines[places], return_inverse=True)
        sets = {}
        for name, members in mesh.edge_sets.items():
            mine = np.asarray(members, dtype=int)
            mine = mine[self._rank_of_edge[mine] == rank]
            nodes_of = mesh.edges[mine]
            nodes_of = np.where(self._backwards[mine][:, None], nodes_of[:, ::-1], nodes_of)
            sets[name] = np.searchsorted(nodes, nodes_of)
        return Part(
            nodes,
            mesh.nodes[nodes],
            self.bodies[nodes],
            self._numbering.unknowns[nodes],
            elements,
            [flat[first:last] for first, last in zip(firsts, lasts)],
            mesh.scaling_centres[elements],
            mesh.closed[elements],
            self._materials[elements],
            sets,
        )

"""Cells separated along edges: every sector of cells around a vertex gets a vertex of its own."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

from scipy.cluster.hierarchy import DisjointSet

from meshing.cells.complex import CellComplex, Edge, edge_key, part_of_curve

Corner = tuple[int, int]  # a cell, and a place in its list of vertices


def split(cells: CellComplex, lines: Iterable[Edge]) -> dict[Edge, tuple[Edge, Edge]]:
    """Separate the cells at the two sides of lines of edges, in place.

    Lines may end inside, reach the outline, branch and cross.

    Parameters
    ----------
    cells : CellComplex
        Its sets and curves are carried over; a named vertex stays with the cells at the left of the first of
        its edges in `lines`.
    lines : iterable of (int, int)
        Directed edges, each with a cell at either side.

    Returns
    -------
    dict of (int, int) to ((int, int), (int, int))
        For each edge of `lines` the edge at its right and the one at its left, in its direction.
    """
    lines = list(lines)
    touched = {vertex for edge in lines for vertex in edge}
    users = _uses(cells, touched)
    corners = _sectors(cells, users, touched, {edge_key(edge) for edge in lines})
    # The cell that runs through an edge in its direction lies at its left.
    beside = {edge: sorted(users[edge_key(edge)], key=lambda use: use.edge == edge) for edge in lines}
    kept: dict[int, Corner] = {}
    for edge, (_, left) in beside.items():
        kept.setdefault(edge[0], left.start)
        kept.setdefault(edge[1], left.stop)
    before = [cell.edges() for cell in cells.cells]
    _renumber(cells, corners, {corners[corner]: vertex for vertex, corner in kept.items()}, touched)
    _carry_over(cells, before)

    def vertex(corner: Corner) -> int:
        return cells.cells[corner[0]].vertices[corner[1]]

    return {
        edge: ((vertex(right.stop), vertex(right.start)), (vertex(left.start), vertex(left.stop)))
        for edge, (right, left) in beside.items()
    }


class _Use(NamedTuple):
    """An edge as a cell runs through it, between two of the cell's corners."""

    edge: Edge
    start: Corner
    stop: Corner


def _uses(cells: CellComplex, touched: set[int]) -> dict[Edge, list[_Use]]:
    """Of the edges at some vertices."""
    users: dict[Edge, list[_Use]] = {}
    for number, cell in enumerate(cells.cells):
        count = len(cell.vertices)
        for place, edge in enumerate(cell.edges()):
            if edge[0] in touched or edge[1] in touched:
                use = _Use(edge, (number, place), (number, (place + 1) % count))
                users.setdefault(edge_key(edge), []).append(use)
    return users


def _sectors(
    cells: CellComplex, users: dict[Edge, list[_Use]], touched: set[int], walls: set[Edge]
) -> DisjointSet:
    """Corners at the vertices of the lines, one set for each sector between walls. An open cell ends in two
    corners, which may be one vertex.
    """
    corners = DisjointSet(
        (i, k) for i, cell in enumerate(cells.cells) for k, v in enumerate(cell.vertices) if v in touched
    )
    for key, uses in users.items():
        if key in walls or len(uses) != 2 or uses[0].edge == uses[1].edge:
            continue  # edges used twice in one direction are refused when the mesh is checked
        one, other = uses
        if one.edge[0] in touched:
            corners.merge(one.start, other.stop)
        if one.edge[1] in touched:
            corners.merge(one.stop, other.start)
    return corners


def _renumber(
    cells: CellComplex, corners: DisjointSet, vertex_of: dict[Corner, int], touched: set[int]
) -> None:
    """Give each sector its vertex, a new one where it has none."""
    for number, cell in enumerate(cells.cells):
        for place, vertex in enumerate(cell.vertices):
            if vertex in touched:
                sector = corners[number, place]
                if sector not in vertex_of:
                    vertex_of[sector] = cells.add_vertex(*cells.vertices[vertex])
                cell.vertices[place] = vertex_of[sector]


def _carry_over(cells: CellComplex, before: list[list[Edge]]) -> None:
    """Sets and curves to the edges that the cells have now, from those they had before."""
    now: dict[Edge, dict[Edge, bool]] = {}
    for cell, old_edges in zip(cells.cells, before):
        for old, new in zip(old_edges, cell.edges()):
            turned = (old == edge_key(old)) != (new == edge_key(new))
            now.setdefault(edge_key(old), {})[edge_key(new)] = turned
    cells.edge_sets = {
        name: [new for old in edges for new in now.get(edge_key(old), ())]
        for name, edges in cells.edge_sets.items()
    }
    cells.curves = {
        new: part_of_curve(curve, 1.0, 0.0) if turned else curve
        for old, curve in cells.curves.items()
        for new, turned in now.get(old, {}).items()
    }

"""Cells separated along edges: every sector of cells around a vertex gets a vertex of its own."""

from __future__ import annotations

from collections.abc import Iterable

from scipy.cluster.hierarchy import DisjointSet

from meshing.cells.complex import CellComplex, edge_key, reversed_curve

Edge = tuple[int, int]


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
    walls = {edge_key(edge) for edge in lines}
    touched = {vertex for edge in lines for vertex in edge}
    # A corner is a place in a cell's list of vertices. An open cell ends in two corners, which may be one
    # vertex.
    corners = DisjointSet(
        (number, place)
        for number, cell in enumerate(cells.cells)
        for place, vertex in enumerate(cell.vertices)
        if vertex in touched
    )
    users: dict[Edge, list[tuple[Edge, int, int, int]]] = {}
    for number, cell in enumerate(cells.cells):
        count = len(cell.vertices)
        for place, edge in enumerate(cell.edges()):
            if edge[0] in touched or edge[1] in touched:
                users.setdefault(edge_key(edge), []).append((edge, number, place, (place + 1) % count))
    for key, uses in users.items():
        if key in walls or len(uses) != 2:
            continue
        (edge, one, start, stop), (other_edge, other, other_start, other_stop) = uses
        if edge == other_edge:
            continue  # refused when the mesh is checked
        if edge[0] in touched:
            corners.merge((one, start), (other, other_stop))
        if edge[1] in touched:
            corners.merge((one, stop), (other, other_start))
    # The cell that runs through an edge in its direction lies at its left.
    kept: dict[int, tuple[int, int]] = {}
    for edge in lines:
        for directed, number, place, following in users[edge_key(edge)]:
            if directed == edge:
                kept.setdefault(edge[0], (number, place))
                kept.setdefault(edge[1], (number, following))
    vertex_of = {corners[corner]: vertex for vertex, corner in kept.items()}
    before = [cell.edges() for cell in cells.cells]
    for number, cell in enumerate(cells.cells):
        for place, vertex in enumerate(cell.vertices):
            if vertex not in touched:
                continue
            sector = corners[number, place]
            if sector not in vertex_of:
                vertex_of[sector] = cells.add_vertex(*cells.vertices[vertex])
            cell.vertices[place] = vertex_of[sector]
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
        new: reversed_curve(curve) if turned else curve
        for old, curve in cells.curves.items()
        for new, turned in now.get(old, {}).items()
    }
    sides = {}
    for edge in lines:
        found: dict[bool, Edge] = {}
        for directed, number, place, following in users[edge_key(edge)]:
            vertices = cells.cells[number].vertices
            new = (vertices[place], vertices[following])
            found[directed == edge] = new if directed == edge else new[::-1]
        sides[edge] = (found[False], found[True])
    return sides

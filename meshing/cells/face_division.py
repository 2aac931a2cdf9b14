"""Edges of cells divided into equal parts, e.g. where the faces of a crack want more contact pairs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from meshing.cells.complex import CellComplex, edge_key, part_of_curve

Edge = tuple[int, int]


def with_inserted(path: Sequence[int], inserted: dict[Edge, list[int]]) -> list[int]:
    """A chain of vertices with those that have been put between them."""
    result = [path[0]]
    for edge in zip(path, path[1:]):
        result += [*inserted.get(edge, ()), edge[1]]
    return result


def divide_faces(
    cells: CellComplex, faces: Sequence[Sequence[Edge]], counts: Sequence[int]
) -> dict[Edge, list[int]]:
    """Divide edges into equal parts, in place.

    Parameters
    ----------
    cells : CellComplex
    faces : sequence of sequence of (int, int)
        Edges that are divided alike.
    counts : sequence of int
        Number of parts for each item of `faces`.

    Returns
    -------
    dict of (int, int) to list of int
        New vertices between the ends of each divided edge, in both directions.
    """
    return divide_edges(
        cells,
        {
            edge: np.arange(1, count) / count
            for edges, count in zip(faces, counts)
            for edge in edges
            if count > 1
        },
    )


def divide_edges(cells: CellComplex, wanted: Mapping[Edge, np.ndarray]) -> dict[Edge, list[int]]:
    """Divide edges in place; only the cells that have them get more vertices.

    Parameters
    ----------
    cells : CellComplex
    wanted : mapping of (int, int) to array
        For each edge, in its direction, the places of its new vertices, ascending in (0, 1).

    Returns
    -------
    dict of (int, int) to list of int
        New vertices between the ends of each divided edge, in both directions.
    """
    inserted: dict[Edge, list[int]] = {}
    for (first, last), fractions in wanted.items():
        curve = cells.curve(first, last)
        ends = np.array([cells.vertices[first], cells.vertices[last]])
        inner = (
            (1.0 - fractions[:, None]) * ends[0] + fractions[:, None] * ends[1]
            if curve is None
            else curve(fractions)
        )
        new = [cells.add_vertex(*point) for point in inner]
        if curve is not None:
            chain, bounds = [first, *new, last], [0.0, *fractions.tolist(), 1.0]
            for part, low, high in zip(zip(chain, chain[1:]), bounds, bounds[1:]):
                cells.set_curve(*part, part_of_curve(curve, low, high))
        inserted[first, last], inserted[last, first] = new, new[::-1]
    for cell in cells.cells:
        edges = cell.edges()
        if not any(edge in inserted for edge in edges):
            continue
        loop = []
        for edge in edges:
            loop += [edge[0], *inserted.get(edge, ())]
        cell.vertices = loop if cell.closed else [*loop, cell.vertices[-1]]
    for name, edges in cells.edge_sets.items():
        cells.edge_sets[name] = [
            part
            for edge in edges
            for chain in [[edge[0], *inserted.get(edge, ()), edge[1]]]
            for part in zip(chain, chain[1:])
        ]
    for edge in list(cells.curves):
        if edge in inserted:
            del cells.curves[edge_key(edge)]
    return inserted

"""Edges of cells divided into equal parts, e.g. where the faces of a crack want more contact pairs."""

from __future__ import annotations

from collections.abc import Sequence

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
    """Divide edges in place; only the cells that have them get more vertices.

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
    inserted: dict[Edge, list[int]] = {}
    for edges, count in zip(faces, counts):
        if count < 2:
            continue
        for first, last in edges:
            curve = cells.curve(first, last)
            ends = np.array([cells.vertices[first], cells.vertices[last]])
            fractions = np.arange(1, count) / count
            inner = (
                (1.0 - fractions[:, None]) * ends[0] + fractions[:, None] * ends[1]
                if curve is None
                else curve(fractions)
            )
            new = [cells.add_vertex(*point) for point in inner]
            if curve is not None:
                chain = [first, *new, last]
                for i, part in enumerate(zip(chain, chain[1:])):
                    cells.set_curve(*part, part_of_curve(curve, i / count, (i + 1) / count))
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

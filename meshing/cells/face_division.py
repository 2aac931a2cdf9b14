"""Edges of cells divided into equal parts, e.g. where the faces of a crack want more contact pairs."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from meshing.cells.complex import CellComplex, Edge, divided, edge_key, edges_of, part_of_curve


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
        new = [cells.add_vertex(*point) for point in cells.along((first, last), fractions)]
        if curve is not None:
            chain, bounds = [first, *new, last], [0.0, *fractions.tolist(), 1.0]
            for part, low, high in zip(edges_of(chain), bounds, bounds[1:]):
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
        cells.edge_sets[name] = divided(edges, inserted)
    for edge in list(cells.curves):
        if edge in inserted:
            del cells.curves[edge_key(edge)]
    return inserted

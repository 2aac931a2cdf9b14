"""Cells mirrored in a horizontal line."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from meshing.cells.complex import CellComplex, CrackFaces, Curve, FacePath, TipCell

Edge = tuple[int, int]


def mirrored(cells: CellComplex, height: float, sets: Mapping[str, str]) -> CellComplex:
    """The cells with y replaced by height - y.

    Parameters
    ----------
    height : float
        m.
    sets : mapping of str to str
        New names of edge sets; the others keep theirs.
    """

    def place(point: tuple[float, float]) -> tuple[float, float]:
        return point[0], height - point[1]

    result = CellComplex([place(vertex) for vertex in cells.vertices], points=dict(cells.points))
    for cell in cells.cells:
        centre = None if cell.centre is None else place(cell.centre)
        result.add_cell(cell.vertices[::-1], centre, cell.closed, cell.material)
    result.curves = {edge: _mirrored_curve(curve, height) for edge, curve in cells.curves.items()}
    result.edge_sets = {sets.get(name, name): edges for name, edges in cells.edge_sets.items()}

    def tip(item: TipCell | None) -> TipCell | None:
        if item is None:
            return None
        return TipCell(place(item.position), (item.axis[0], -item.axis[1]), item.opening, item.cell)

    result.cracks = [
        CrackFaces(
            faces.name,
            [FacePath(path.left, path.right, tip(path.start), tip(path.end)) for path in faces.paths],
            faces.length,
        )
        for faces in cells.cracks
    ]
    return result


def _mirrored_curve(curve: Curve, height: float) -> Curve:
    return lambda at: curve(at) * [1.0, -1.0] + np.array([0.0, height])

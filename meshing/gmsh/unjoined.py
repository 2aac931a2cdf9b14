"""Surfaces of a user's model that were drawn over each other, or beside each other without being joined."""

from __future__ import annotations

import numpy as np
import shapely

from meshing.cells.complex import CellComplex, edge_key
from meshing.warnings import warn

_PLACES = np.array([0.25, 0.5, 0.75])  # of an edge, where it is looked for another one
_FINE = np.linspace(0.0, 1.0, 65)
_SAME = 1e-7  # distance of edges that coincide, relative to the model's extent
_SAG = 5e-5  # of the chords between _FINE from a curved edge, relative to its length
_WITHIN = 1e-3  # depth inside a cell that is no round-off, relative to the cell's extent


def check_joined(cells: CellComplex, origin: str) -> None:
    """Refuse surfaces that overlap; warn of outlines that lie on one another and are not joined.

    Parameters
    ----------
    cells : CellComplex
        Before its cracks are made: what lies on one of these is meant.
    origin : str
        For messages.

    Raises
    ------
    ValueError
        A piece of outline lies inside a cell.
    """
    faces = {edge_key(edge) for edges in cells.groups.values() for edge in edges}
    outline = [edge for edge, count in cells.edge_uses().items() if count == 1 and edge not in faces]
    if not outline:
        return
    lines = shapely.linestrings(
        np.concatenate([cells.along(edge, _FINE) for edge in outline]),
        indices=np.repeat(np.arange(len(outline)), len(_FINE)),
    )
    places = shapely.points(np.concatenate([cells.along(edge, _PLACES) for edge in outline]))
    _refuse_overlaps(cells, places, origin)
    extent = float(np.ptp(np.array(cells.vertices), axis=0).max())
    count = len(_PLACES)
    curved = np.array([edge in cells.curves for edge in outline])
    near = np.repeat(np.maximum(_SAME * extent, _SAG * curved * shapely.length(lines)), count)
    place, other = shapely.STRtree(lines).query(places, predicate="dwithin", distance=near)
    beside = np.zeros(len(places), dtype=bool)
    beside[place[place // count != other]] = True
    doubled = beside.reshape(-1, count).all(axis=1)
    if doubled.any():
        x, y = shapely.get_coordinates(places[np.flatnonzero(doubled)[0] * count + 1])[0]
        warn(
            origin,
            f"outlines lie on one another near ({x:.6g}, {y:.6g}) m and are not joined: nothing holds "
            "them together or keeps them from overlapping; join them (BooleanFragments, Coherence), or name "
            "the two sides crack:NAME:right and crack:NAME:left if they are in contact.",
        )


def _refuse_overlaps(cells: CellComplex, places: np.ndarray, origin: str) -> None:
    corners = [np.array([cells.vertices[vertex] for vertex in cell.vertices]) for cell in cells.cells]
    boxes = shapely.box(*np.array([[*c.min(axis=0), *c.max(axis=0)] for c in corners]).T)
    tree = shapely.STRtree(boxes)
    for number, place in zip(*tree.query(places)[::-1]):
        loop = [cells.along(edge, _FINE[:-1]) for edge in cells.cells[number].edges()]
        polygon = shapely.Polygon(np.concatenate(loop))
        point = places[place]
        depth = _WITHIN * float(np.ptp(corners[number], axis=0).max())
        if polygon.contains(point) and polygon.exterior.distance(point) > depth:
            raise ValueError(
                f"{origin}: surfaces overlap near ({point.x:.6g}, {point.y:.6g}) m, where area would "
                "count twice; cut one from the other (BooleanDifference) or join them (Coherence)."
            )

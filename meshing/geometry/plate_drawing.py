"""A plate's drawing: all of it is filled by gmsh."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from meshing.geometry.drawing import Drawing
from meshing.geometry.fill import draw_filled
from meshing.geometry.graph import Point, plane_graph
from meshing.shapes.plate_shape import PlateShape


def plate_drawing(plate: PlateShape, size: float, points: Mapping[str, Point]) -> Drawing:
    """Draw a plate with holes and cracks.

    Parameters
    ----------
    size : float
        Largest edge, m.
    points : mapping of str to (x, y)
        Named points, m.

    Raises
    ------
    ValueError
        Cracks or points come too close to something.
    """
    # From the tip, as everything that is numbered along a crack.
    lines = {name: np.array(crack.points[::-1]) for name, crack in zip(plate.crack_names(), plate.cracks)}
    holes = {f"hole{i}": ((hole.x, hole.y), hole.radius) for i, hole in enumerate(plate.holes, 1)}
    drawing = Drawing()
    graph = plane_graph(plate.outline, list(holes.values()), lines, points)
    draw_filled(drawing, graph, size, plate.side_names, list(holes))
    drawing.name_openings({name: crack.opening for name, crack in zip(lines, plate.cracks)})
    return drawing

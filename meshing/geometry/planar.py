"""Plane geometry of segments and polygons."""

from __future__ import annotations

import numpy as np
import shapely
from scipy.cluster.hierarchy import DisjointSet

_TOUCH = 1e-9  # distance of what meets, relative to the extent; sine of an angle that is none


def find_crossing(segments: np.ndarray, ends: np.ndarray) -> np.ndarray | None:
    """Where two segments that have no end in common cross or touch; gmsh may never return from such an
    outline.

    The two faces of a slit, and other segments that run along each other, are left alone.

    Parameters
    ----------
    segments : (n, 2, 2) array
        Ends of the segments, m.
    ends : (n, 2) int array
        Numbers of the ends.

    Returns
    -------
    (2,) array or None
        m.
    """
    steps = segments[:, 1] - segments[:, 0]
    unit = steps / np.maximum(np.hypot(*steps.T), np.finfo(float).tiny)[:, None]
    places = segments.reshape(-1, 2)
    reach = _TOUCH * np.ptp(places, axis=0).max()
    # ends of the faces of a slit are one end
    numbers = DisjointSet(ends.ravel().tolist())
    one, other = _near(shapely.points(places), reach)
    along = np.abs(_cross(unit[one // 2], unit[other // 2])) <= _TOUCH
    for pair in zip(ends.ravel()[one[along]].tolist(), ends.ravel()[other[along]].tolist()):
        numbers.merge(*pair)
    ends = np.array([numbers[end] for end in ends.ravel().tolist()]).reshape(-1, 2)
    lines = shapely.linestrings(segments)
    first, second = _near(lines, reach)
    common = (ends[first][:, :, None] == ends[second][:, None, :]).any(axis=(1, 2))
    met = np.flatnonzero(~common & (np.abs(_cross(unit[first], unit[second])) > _TOUCH))
    if not len(met):
        return None
    return shapely.get_coordinates(shapely.shortest_line(lines[first[met[0]]], lines[second[met[0]]]))[0]


def _near(shapes: np.ndarray, reach: float) -> tuple[np.ndarray, np.ndarray]:
    """Pairs of shapes within reach of each other, each pair once."""
    first, second = shapely.STRtree(shapes).query(shapes, predicate="dwithin", distance=reach)
    return first[first < second], second[first < second]


def _cross(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    return one[:, 0] * other[:, 1] - one[:, 1] * other[:, 0]


def polygon_area(polygon: np.ndarray) -> float:
    """Signed area of a polygon (n, 2), positive if counter-clockwise."""
    return 0.5 * float(_cross(polygon, np.roll(polygon, -1, axis=0)).sum())

"""Plane geometry of segments and polygons."""

from __future__ import annotations

import numpy as np
import shapely

from meshing.vectors import cross

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
    ahead = steps / np.maximum(np.hypot(*steps.T), np.finfo(float).tiny)[:, None]
    places = segments.reshape(-1, 2)
    reach = _TOUCH * np.ptp(places, axis=0).max()
    # ends of the faces of a slit are one end; SciPy's sets would take longer to load than gmsh
    numbers, ends = np.unique(ends, return_inverse=True)
    one, other = _near(shapely.points(places), reach)
    along = np.abs(cross(ahead[one // 2], ahead[other // 2])) <= _TOUCH
    joined, least = ends.ravel()[np.array([one[along], other[along]])], np.arange(len(numbers))
    while (least[joined[0]] != least[joined[1]]).any():
        np.minimum.at(least, joined.ravel(), np.tile(least[joined].min(axis=0), 2))
    ends = least[ends].reshape(-1, 2)
    lines = shapely.linestrings(segments)
    first, second = _near(lines, reach)
    common = (ends[first][:, :, None] == ends[second][:, None, :]).any(axis=(1, 2))
    met = np.flatnonzero(~common & (np.abs(cross(ahead[first], ahead[second])) > _TOUCH))
    if not len(met):
        return None
    return shapely.get_coordinates(shapely.shortest_line(lines[first[met[0]]], lines[second[met[0]]]))[0]


def _near(shapes: np.ndarray, reach: float) -> tuple[np.ndarray, np.ndarray]:
    """Pairs of shapes within reach of each other, each pair once."""
    first, second = shapely.STRtree(shapes).query(shapes, predicate="dwithin", distance=reach)
    return first[first < second], second[first < second]

"""Plane geometry of segments and polygons."""

from __future__ import annotations

import numpy as np
import shapely


def find_crossing(segments: np.ndarray) -> np.ndarray | None:
    """Where two segments cross or overlap each other, apart from shared ends; gmsh may never return from such
    an outline.

    Parameters
    ----------
    segments : (n, 2, 2) array
        Ends of the segments, m.

    Returns
    -------
    (2,) array or None
        m.
    """
    start, step = segments[:, 0], segments[:, 1] - segments[:, 0]
    first, second = _candidates(segments)
    gap = start[second] - start[first]
    one, other = step[first], step[second]
    across = one[:, 0] * other[:, 1] - one[:, 1] * other[:, 0]
    parallel = np.abs(across) <= 1e-12 * np.hypot(*one.T) * np.hypot(*other.T)
    safe = np.where(parallel, 1.0, across)
    inside_first, touches_first = _within((gap[:, 0] * other[:, 1] - gap[:, 1] * other[:, 0]) / safe)
    inside_second, touches_second = _within((gap[:, 0] * one[:, 1] - gap[:, 1] * one[:, 0]) / safe)
    crossing = ~parallel & (inside_first & touches_second | touches_first & inside_second)
    if not crossing.any():
        return None
    k = int(np.argmax(crossing))
    along = (gap[k, 0] * other[k, 1] - gap[k, 1] * other[k, 0]) / across[k]
    return start[first[k]] + along * one[k]


def _candidates(segments: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Pairs of segments whose bounding boxes meet, each pair once."""
    slack = 1e-9 * np.ptp(segments, axis=1).max(axis=1, keepdims=True)
    low, high = segments.min(axis=1) - slack, segments.max(axis=1) + slack
    boxes = shapely.box(*low.T, *high.T)
    first, second = shapely.STRtree(boxes).query(boxes)
    return first[first < second], second[first < second]


def find_meeting(segments: np.ndarray, ends: np.ndarray) -> np.ndarray | None:
    """Where two curves meet in nodes that lie at one place but are not one node; gmsh may never return from
    such an outline.

    The two faces of a slit lie on each other all along and are left alone.

    Parameters
    ----------
    segments : (n, 2, 2) array
        Ends of the segments, m.
    ends : (n, 2) int array
        Node tags of the ends.

    Returns
    -------
    (2,) array or None
        m.
    """
    places, tags = segments.reshape(-1, 2), ends.ravel()
    directions = np.repeat(segments[:, 1] - segments[:, 0], 2, axis=0)
    directions = directions / np.hypot(*directions.T)[:, None]
    reach = 1e-9 * np.ptp(places, axis=0).max()
    points = shapely.points(places)
    first, second = shapely.STRtree(points).query(points, predicate="dwithin", distance=reach)
    first, second = (end[(first < second) & (tags[first] != tags[second])] for end in (first, second))
    across = directions[first, 0] * directions[second, 1] - directions[first, 1] * directions[second, 0]
    slit = {
        int(tag)
        for i, j, turn in zip(first, second, across)
        if abs(turn) <= 1e-9
        for tag in (tags[i], tags[j])
    }
    met = sorted({int(tag) for tag in tags[np.concatenate([first, second])]} - slit)
    return places[tags == met[0]][0] if met else None


def _within(parameter: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Parameters on a segment without and with its ends."""
    return (parameter > 1e-9) & (parameter < 1 - 1e-9), (parameter > -1e-9) & (parameter < 1 + 1e-9)


def polygon_area(polygon: np.ndarray) -> float:
    """Signed area of a polygon (n, 2), positive if counter-clockwise."""
    following = np.roll(polygon, -1, axis=0)
    return 0.5 * float((polygon[:, 0] * following[:, 1] - polygon[:, 1] * following[:, 0]).sum())

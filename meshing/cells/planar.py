"""Plane geometry of segments and polygons."""

from __future__ import annotations

import numpy as np


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
    gap = start[None, :, :] - start[:, None, :]
    across = step[:, None, 0] * step[None, :, 1] - step[:, None, 1] * step[None, :, 0]
    lengths = np.hypot(*step.T)
    parallel = np.abs(across) <= 1e-12 * lengths[:, None] * lengths[None, :]
    safe = np.where(parallel, 1.0, across)
    along_first = (gap[..., 0] * step[None, :, 1] - gap[..., 1] * step[None, :, 0]) / safe
    along_second = (gap[..., 0] * step[:, None, 1] - gap[..., 1] * step[:, None, 0]) / safe
    inside_first, touches_first = _within(along_first)
    inside_second, touches_second = _within(along_second)
    crossing = ~parallel & (inside_first & touches_second | touches_first & inside_second)
    where = np.argwhere(crossing)
    return start[where[0, 0]] + along_first[tuple(where[0])] * step[where[0, 0]] if len(where) else None


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
    distance = np.abs(places[:, None] - places[None]).max(axis=2)
    same = (distance <= 1e-9 * np.ptp(places, axis=0).max()) & (tags[:, None] != tags[None])
    along = (
        np.abs(
            directions[:, None, 0] * directions[None, :, 1] - directions[:, None, 1] * directions[None, :, 0]
        )
        <= 1e-9
    )
    for one in np.unique(tags[np.argwhere(same)[:, 0]]):
        mine = tags == one
        others = same[mine].any(axis=0)
        if not along[np.ix_(mine, others)].any():
            return places[mine][0]
    return None


def _within(parameter: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Parameters on a segment without and with its ends."""
    return (parameter > 1e-9) & (parameter < 1 - 1e-9), (parameter > -1e-9) & (parameter < 1 + 1e-9)


def polygon_area(polygon: np.ndarray) -> float:
    """Signed area of a polygon (n, 2), positive if counter-clockwise."""
    following = np.roll(polygon, -1, axis=0)
    return 0.5 * float((polygon[:, 0] * following[:, 1] - polygon[:, 1] * following[:, 0]).sum())

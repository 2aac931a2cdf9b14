"""Vectors and polygons in the plane; the last axis holds x and y."""

from __future__ import annotations

import math
from typing import Any

import numpy as np


def cross(one: Any, other: Any) -> Any:
    """Product of the lengths and the sine of the angle from one vector to another."""
    one, other = np.asarray(one), np.asarray(other)
    return one[..., 0] * other[..., 1] - one[..., 1] * other[..., 0]


def unit(vectors: Any) -> np.ndarray:
    """Vectors of length one in the same directions."""
    vectors = np.asarray(vectors)
    return vectors / np.hypot(vectors[..., :1], vectors[..., 1:])


def turn(one: Any, other: Any) -> float:
    """Angle from one vector to another, radian."""
    return math.atan2(cross(one, other), float(np.dot(one, other)))


def line_length(points: Any) -> float:
    """Length of a line through points (n, 2)."""
    return float(np.hypot(*np.diff(points, axis=0).T).sum())


def on_circle(centre: Any, radius: float, angles: np.ndarray) -> np.ndarray:
    """Places on a circle at angles (n,), (n, 2)."""
    return centre + radius * np.stack([np.cos(angles), np.sin(angles)], axis=1)


def polygon_area(polygon: np.ndarray) -> Any:
    """Signed area of a polygon (n, 2), positive if counter-clockwise, or of several (m, n, 2)."""
    return 0.5 * cross(polygon, np.roll(polygon, -1, axis=-2)).sum(axis=-1)

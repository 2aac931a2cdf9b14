"""Boxes around a point (crack tip, hole, corner), their outlines, and rings that are scaled copies of the
outline.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from meshing.cells.complex import CellComplex

_NEAR_FACE = math.radians(12.0)
_NEAR_CORNER = math.radians(15.0)


@dataclass(frozen=True)
class Box:
    """A rectangle around a centre; its sides are absolute coordinates, so that a side on the beam's edge is
    there exactly.

    Attributes
    ----------
    centre : (x, y)
        m.
    left, right, bottom, top : float
        x or y of the sides, m.
    """

    centre: tuple[float, float]
    left: float
    right: float
    bottom: float
    top: float

    @property
    def largest(self) -> float:
        """Largest distance of a side from the centre, m."""
        x, y = self.centre
        return max(x - self.left, self.right - x, y - self.bottom, self.top - y)

    @property
    def smallest(self) -> float:
        """Smallest distance of a side from the centre, m."""
        x, y = self.centre
        return min(x - self.left, self.right - x, y - self.bottom, self.top - y)

    def corners(self) -> np.ndarray:
        """(4, 2) array, counter-clockwise from the lower left."""
        return np.array(
            [
                [self.left, self.bottom],
                [self.right, self.bottom],
                [self.right, self.top],
                [self.left, self.top],
            ]
        )

    def hit(self, angle: float) -> tuple[float, float]:
        """Where a ray from the centre leaves the box; exact on the side it hits."""
        x, y = self.centre
        cosine, sine = math.cos(angle), math.sin(angle)
        horizontal = (
            ((self.right if cosine > 0 else self.left) - x) / cosine if abs(cosine) > 1e-300 else math.inf
        )
        vertical = ((self.top if sine > 0 else self.bottom) - y) / sine if abs(sine) > 1e-300 else math.inf
        if horizontal < vertical:
            return (self.right if cosine > 0 else self.left), y + horizontal * sine
        return x + vertical * cosine, (self.top if sine > 0 else self.bottom)


def outline(
    box: Box,
    ends: tuple[tuple[float, float], tuple[float, float]] | None,
    widest: float,
    preferred: Callable[[tuple[float, float]], tuple[float, float]],
    keep_corners: bool,
) -> np.ndarray:
    """Vertices of a box's outline, counter-clockwise about its centre.

    Parameters
    ----------
    box : Box
    ends : ((x, y), (x, y)) or None
        Where the two faces of a notch leave the box, in counter-clockwise order through the material; None:
        the outline is a loop.
    widest : float
        Largest angle that a side may subtend at the centre, radian.
    preferred : callable
        Maps a vertex on a side that may slide to where it should go (to a vertex that is there already).
    keep_corners : bool
        False: corners close to a face are cut off.

    Returns
    -------
    (n, 2) array
        m. A loop starts at the lower left corner and does not repeat it.
    """
    x, y = box.centre

    def angle_of(point: tuple[float, float]) -> float:
        return math.atan2(point[1] - y, point[0] - x)

    if ends is None:
        start, sector, fixed = angle_of((box.left, box.bottom)), 2 * math.pi, []
    else:
        start = angle_of(ends[0])
        sector = (angle_of(ends[1]) - start) % (2 * math.pi) or 2 * math.pi
        # A closed crack: the two ends coincide and the sector is the full circle, which round-off may turn
        # into nothing.
        sector = sector if sector > math.pi / 18 else 2 * math.pi
        fixed = [(0.0, ends[0]), (sector, ends[1])]

    def turn(point: tuple[float, float]) -> float:
        return (angle_of(point) - start) % (2 * math.pi)

    margin = 1e-9 if keep_corners else _NEAR_FACE
    for corner in box.corners():
        position = turn(tuple(corner))
        if ends is None or margin < position < sector - margin:
            fixed.append((position, tuple(corner)))
    fixed.sort(key=lambda item: item[0])
    vertices = list(fixed)
    for foot in ((x, box.bottom), (box.right, y), (x, box.top), (box.left, y)):
        foot = preferred(foot)
        position = turn(foot)
        spacing = min(abs(position - other) for other, _ in fixed + [(fixed[0][0] + 2 * math.pi, None)])
        if (ends is None or position < sector) and spacing > _NEAR_CORNER:
            vertices.append((position, foot))
    vertices.sort(key=lambda item: item[0])
    last = [] if ends else [(vertices[0][0] + 2 * math.pi, vertices[0][1])]
    result: list[tuple[float, float]] = []
    for (here, point), (there, _) in zip(vertices, vertices[1:] + last):
        result.append(point)
        parts = math.ceil((there - here) / widest - 1e-6)
        result += [box.hit(start + here + (there - here) * i / parts) for i in range(1, parts)]
    if ends:
        result.append(vertices[-1][1])
    return np.array(result)


def ring_scales(innermost: float, grading: float) -> np.ndarray:
    """Geometric series from `innermost` < 1 to 1 in the fewest steps whose ratio is at most `grading`."""
    rings = max(1, math.ceil(math.log(1.0 / innermost) / math.log(grading) - 1e-9))
    scales = innermost ** (1.0 - np.arange(rings + 1) / rings)
    scales[-1] = 1.0
    return scales


def add_levels(
    make_vertex: Callable[[float, float], int],
    centre: tuple[float, float],
    points: np.ndarray,
    scales: Sequence[float] | np.ndarray,
    outer: Sequence[int],
) -> list[list[int]]:
    """Vertices of scaled copies of an outline.

    Parameters
    ----------
    make_vertex : callable
        Makes the vertex at (x, y) and returns its number.
    points : (n, 2) array
        The outline, m.
    scales : sequence of float
        Ascending; the last one, 1, is the outline itself.
    outer : sequence of int
        The outline's vertices, which exist already.

    Returns
    -------
    list of list of int
        Vertices of each level, from the innermost to `outer`.
    """
    direction = points - np.array(centre)
    levels = [
        [make_vertex(*map(float, np.array(centre) + scale * step)) for step in direction]
        for scale in scales[:-1]
    ]
    return levels + [list(outer)]


def add_rings(
    cells: CellComplex, levels: list[list[int]], loop: bool, chain: Callable[[list[int]], list[int]]
) -> None:
    """Cells between the levels of a star.

    Parameters
    ----------
    levels : list of list of int
        Vertices of each level, from the inside.
    loop : bool
        The outline closes on itself.
    chain : callable
        Inserts the hanging vertices of neighbours between vertices on a common line.
    """
    for inner, outer in zip(levels, levels[1:]):
        count = len(inner)
        for i in range(count if loop else count - 1):
            j = (i + 1) % count
            cells.add_cell(chain([inner[i], outer[i], outer[j], inner[j], inner[i]])[:-1])

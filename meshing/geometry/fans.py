"""Fans: cells around a vertex between a chain of vertices and scaled copies of it."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import shapely

from meshing.cells.complex import Point, around
from meshing.cells.vertex_rings import ring_scales
from meshing.geometry.blocks import Block
from meshing.geometry.drawing import Drawing
from meshing.shapes.beam_shape import BeamShape
from meshing.shapes.features import Hole, VNotch
from meshing.vectors import cross, unit

_WIDEST = math.radians(55.0)  # angle of an edge seen from the vertex
_FOOT = math.radians(15.0)  # least angle between a foot and a corner
_SLIDE = 0.12  # how far a vertex on a side moves to a neighbour's, relative to the fan's height
_LONGEST = 4.01  # largest extent of a fan, relative to its smallest
_WALL = 1.25  # smallest extent of a fan around a hole, in radii
_HOLE_RING = 1.6  # the same of the outline next to a hole
_TIP = 0.02  # half-size of the element on a notch's tip, relative to its depth


class Fan:
    """The fan of a lone notch or hole, from edge to edge of the beam.

    Parameters
    ----------
    beam : BeamShape
    block : Block
        With one feature.
    """

    def __init__(self, beam: BeamShape, block: Block) -> None:
        self.beam, self.feature = beam, block.features[0]
        shape = self.feature.shape
        assert isinstance(shape, (VNotch, Hole))
        x, y = beam.triangle(shape)[0] if isinstance(shape, VNotch) else (shape.x, shape.y)
        self.centre = (x, y)
        low, high, top = block.low, block.high, beam.height
        self.box = block.corners(top)
        self.feet = [(x, 0.0), (high, y), (x, top), (low, y)]
        extents = (x - low, high - x, y, top - y)
        self.smallest, self.largest = min(extents), max(extents)

    @staticmethod
    def suits(beam: BeamShape, block: Block) -> bool:
        """Whether a fan fits a block: one notch or hole, nearly as far from all sides, no points inside."""
        if len(block.features) > 1 or block.points or not isinstance(block.features[0].shape, (VNotch, Hole)):
            return False
        fan, shape = Fan(beam, block), block.features[0].shape
        wall = _WALL * shape.radius if isinstance(shape, Hole) else 0.0
        return fan.largest <= _LONGEST * fan.smallest and fan.smallest >= wall

    def draw(self, drawing: Drawing, points: Sequence[Point], tip_size: float | None, grading: float) -> None:
        """Add the fan's cells.

        Parameters
        ----------
        points : sequence of (x, y)
            Users' points, m.
        tip_size : float, optional
            Half-size of the element on a notch's tip, m.
        grading : float
            Largest ratio of neighbouring rings.
        """
        # what neighbours and users have put on the fan's sides already
        given = np.array([*drawing.vertices, *points], float).reshape(-1, 2)
        sides = shapely.Polygon(self.box).exterior
        given = given[shapely.dwithin(sides, shapely.points(given), 1e-9 * self.beam.height)]
        if isinstance(self.feature.shape, Hole):
            self._draw_hole(drawing, given, grading, self.feature.shape)
        else:
            self._draw_notch(drawing, given, tip_size, grading)

    def _draw_notch(
        self, drawing: Drawing, given: np.ndarray, tip_size: float | None, grading: float
    ) -> None:
        """Triangles from the tip to the sides; the rings around it come with the crack."""
        notch, name = self.feature.shape, self.feature.name
        assert isinstance(notch, VNotch)
        mouths = [tuple(corner) for corner in self.beam.triangle(notch)[1:]]
        turn = 3 if notch.edge == "top" else 1
        right, left = mouths if notch.edge == "top" else mouths[::-1]
        corners = [left, *self.box[turn:], *self.box[:turn], right]
        chain = outline(self.centre, corners, self.feet, given, _WIDEST)
        tip = drawing.add_vertex(*self.centre)
        rim = [drawing.add_vertex(*place) for place in chain]
        if notch.is_thin(self.beam.height):
            rim[-1] = rim[0]
            drawing.groups[f"crack:{name}"] = [(tip, rim[0])]
        else:
            drawing.groups[f"crack:{name}:right"] = [(tip, rim[-1])]
            drawing.groups[f"crack:{name}:left"] = [(tip, rim[0])]
        for a, b in zip(rim, rim[1:]):
            drawing.add_cell([tip, a, b])
        size = tip_size or min(_TIP * notch.depth, self.largest / grading)
        drawing.tip_sizes[tip] = size / self.largest * float(np.hypot(*(chain - self.centre).T).max())

    def _draw_hole(self, drawing: Drawing, given: np.ndarray, grading: float, hole: Hole) -> None:
        """Rings of quadrilaterals from the hole's edge to the sides."""
        wall = self.smallest / hole.radius - 1.0
        # An arc must stay inside the tangents at its ends by less than the wall, so that the cell keeps a
        # kernel.
        thin = 2 * math.acos(1.0 / (1.0 + 0.3 * wall))
        outer = outline(self.centre, self.box, self.feet, given, min(_WIDEST, thin))
        away = outer - self.centre
        scales = np.ones(1)
        if self.smallest >= _HOLE_RING * grading**0.5 * hole.radius:
            scales = ring_scales(min(1.0 - 1e-12, _HOLE_RING * hole.radius / self.smallest), grading)
        rims = [self.centre + hole.radius * unit(away)]
        rims += [self.centre + scale * away for scale in scales[:-1]] + [outer]
        rings = [[drawing.add_vertex(*place) for place in rim] for rim in rims]
        drawing.add_circle(rings[0], self.centre)
        drawing.edge_sets[self.feature.name] = around(rings[0])
        for inner, ring in zip(rings, rings[1:]):
            for (a, b), (c, d) in zip(around(inner), around(ring)):
                drawing.add_cell([a, c, d, b])


def outline(
    centre: Point, corners: Sequence[Point], feet: Sequence[Point], given: np.ndarray, widest: float
) -> np.ndarray:
    """Vertices of a fan's outer chain, counter-clockwise about its centre.

    Parameters
    ----------
    corners : sequence of (x, y)
        Of a rectangle, for a loop, else from the mouth at one flank of a notch to that at the other, m.
    feet : sequence of (x, y)
        Places on the sides that become vertices where they are far from corners, m.
    given : (n, 2) array
        Vertices on the sides that are there already, to which feet slide, m.
    widest : float
        Largest angle that an edge may subtend at the centre, radian.

    Returns
    -------
    (n, 2) array
        m. A loop does not repeat its first vertex.
    """
    loop = len(corners) == 4
    path = np.array([*corners, corners[0]] if loop else corners, float)
    turn = np.unwrap(np.arctan2(*(path - centre).T[::-1]))
    reach = _SLIDE * np.ptp(path[:, 1])

    def slid(place: Sequence[float]) -> np.ndarray:
        apart = np.hypot(*(given - place).T) if len(given) else np.array([math.inf])
        near = given[apart.argmin()] if apart.min() <= reach else place
        return np.array(place if (np.abs(path - near).max(axis=1) == 0.0).any() else near)

    marks = [*zip(turn.tolist(), path)]
    for foot in map(slid, feet):
        heading = math.atan2(foot[1] - centre[1], foot[0] - centre[0])
        at = turn[0] + (heading - turn[0]) % (2 * math.pi)
        if np.abs(turn - at).min() > _FOOT and turn[0] < at < turn[-1]:
            marks.append((at, foot))
    marks.sort(key=lambda mark: mark[0])
    result = []
    for (here, start), (there, stop) in zip(marks, marks[1:]):
        result.append(start)
        parts = math.ceil((there - here) / widest - 1e-6)
        for angle in here + (there - here) * np.arange(1, parts) / parts:
            result.append(_crossed(centre, angle, start, stop))
    return np.array(result if loop else [*result, marks[-1][1]])


def _crossed(centre: Point, angle: float, start: np.ndarray, stop: np.ndarray) -> np.ndarray:
    """Where a ray from the centre meets a line."""
    ray, step = np.array([math.cos(angle), math.sin(angle)]), stop - start
    return start + cross(ray, start - centre) / cross(step, ray) * step

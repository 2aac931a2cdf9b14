"""The vertices that cells share: on vertical lines through the beam and on its lower and upper edge."""

from __future__ import annotations

import math
from bisect import bisect_left, insort
from dataclasses import dataclass, field

import numpy as np

from meshing.cells.beam_layout import Block, Feature, MeshInputs
from meshing.cells.complex import CellComplex
from meshing.cells.stars import Box
from meshing.shapes.beam_shape import BeamShape

_GROWTH = 0.7  # of the edge length with the distance from a box


@dataclass
class Star:
    """A box with its outline and what has been made of it.

    Attributes
    ----------
    feature : Feature
    box : Box or None
        None for a hole without a ring of cells.
    points : (n, 2) array
        Outline, counter-clockwise, m; a notch's runs from the left face to the right one.
    vertices : list of int
        The outline's vertices.
    face_fraction : float
        Part of a notch's faces that lies in the box; 1: the box reaches the mouth.
    ring_ratio : float
        Size ratio of neighbouring rings around a tip.
    left, right : list of int
        Vertices of a notch's faces from the inside outwards.
    circle : list of int
        Vertices on a hole's edge, counter-clockwise about the hole.
    tip_cell : int
        Cell around the tip, -1 if there is none.
    """

    feature: Feature
    box: Box | None
    points: np.ndarray
    vertices: list[int]
    face_fraction: float = 1.0
    ring_ratio: float = 1.0
    left: list[int] = field(default_factory=list)
    right: list[int] = field(default_factory=list)
    circle: list[int] = field(default_factory=list)
    tip_cell: int = -1


class Skeleton:
    """Registry of shared vertices.

    Vertices are found again by their coordinates, which is safe because the faces of cracks, where two
    vertices may coincide, are never registered.
    """

    def __init__(self, beam: BeamShape, inputs: MeshInputs) -> None:
        self.beam = beam
        self.inputs = inputs
        self.cells = CellComplex()
        self.rows = 1
        self._tolerance = 1e-9 * beam.height
        # Each line: its sorted positions along the other axis with their vertices.
        self._vertical: dict[float, list[tuple[float, int]]] = {}
        self._horizontal: dict[float, list[tuple[float, int]]] = {0.0: [], beam.height: []}

    def add_line(self, x: float) -> None:
        """A vertical line over the beam's height."""
        if x not in self._vertical:
            self._vertical[x] = []
            self.vertex(x, 0.0)
            self.vertex(x, self.beam.height)

    def _registers(self, x: float, y: float) -> list[tuple[list[tuple[float, int]], float]]:
        found = [(self._vertical[x], y)] if x in self._vertical else []
        return found + ([(self._horizontal[y], x)] if y in self._horizontal else [])

    def vertex(self, x: float, y: float) -> int:
        """The vertex at a place on a line or edge, made if it is missing."""
        registers = self._registers(x, y)
        for register, position in registers:
            i = bisect_left(register, (position - self._tolerance, -1))
            if i < len(register) and register[i][0] <= position + self._tolerance:
                return register[i][1]
        vertex = self.cells.add_vertex(x, y)
        for register, position in registers:
            insort(register, (position, vertex))
        return vertex

    def vertex_or_new(self, x: float, y: float) -> int:
        """As `vertex`; a place on no line gets a vertex of its own."""
        return self.vertex(x, y) if self._registers(x, y) else self.cells.add_vertex(x, y)

    def between(self, first: int, last: int) -> list[int]:
        """Registered vertices strictly between two vertices of one line or edge, in order from the first;
        empty elsewhere.
        """
        (x1, y1), (x2, y2) = self.cells.vertices[first], self.cells.vertices[last]
        if x1 == x2 and x1 in self._vertical:
            register, start, stop = self._vertical[x1], y1, y2
        elif y1 == y2 and y1 in self._horizontal:
            register, start, stop = self._horizontal[y1], x1, x2
        else:
            return []
        low, high = sorted((start, stop))
        first_inside, first_beyond = (
            bisect_left(register, (low + self._tolerance, -1)),
            bisect_left(register, (high - self._tolerance, -1)),
        )
        found = [vertex for _, vertex in register[first_inside:first_beyond]]
        return found if start < stop else found[::-1]

    def add_polygon(self, corners: list[tuple[float, float]]) -> None:
        """A cell given by corners on lines, counter-clockwise, with the hanging vertices between them."""
        vertices = [self.vertex_or_new(*corner) for corner in corners]
        self.cells.add_cell(self.chain(vertices + vertices[:1])[:-1])

    def chain(self, vertices: list[int]) -> list[int]:
        """The vertices with the hanging ones between them."""
        result = []
        for first, last in zip(vertices, vertices[1:]):
            result += [first, *self.between(first, last)]
        return result + vertices[-1:]

    def preferred(self, point: tuple[float, float]) -> tuple[float, float]:
        """Where a vertex of an outline that may slide along its side should go: a registered vertex nearby,
        else it stays.
        """
        x, y = point
        vertical = x in self._vertical
        register = self._vertical[x] if vertical else self._horizontal.get(y, [])
        position, reach = (y if vertical else x), 0.12 * self.beam.height
        near = min((p for p, _ in register), key=lambda p: abs(p - position), default=math.inf)
        # Not onto the ends of a vertical side: those are corners.
        if abs(near - position) > reach or (vertical and near in (0.0, self.beam.height)):
            return point
        return (x, near) if vertical else (near, y)

    def add_circle(self, feature: Feature, towards: np.ndarray) -> list[int]:
        """Vertices of a hole's edge at the angles of the points `towards` (n, 2), joined by arcs and
        named.
        """
        (x, y), radius = feature.centre, feature.hole.radius
        vertices = []
        for angle in np.arctan2(towards[:, 1] - y, towards[:, 0] - x):
            vertices.append(self.cells.add_vertex(x + radius * math.cos(angle), y + radius * math.sin(angle)))
        edges = list(zip(vertices, vertices[1:] + vertices[:1]))
        for first, last in edges:
            self.cells.add_arc(first, last, (x, y), radius)
        self.cells.edge_sets[f"hole{feature.index + 1}"] = edges
        return vertices

    def divide_perimeter(self, block: Block, stars: list[Star]) -> None:
        """Register vertices on a filled block's sides, closer together near its boxes."""
        beam = self.beam
        near: list[np.ndarray] = []
        widths: list[np.ndarray] = []
        for star in stars:
            if star.box is None:
                near.append(np.array([self.cells.vertices[v] for v in star.circle]))
                widths.append(np.full(len(near[-1]), math.dist(*near[-1][:2])))
            else:
                near.append(star.points)
                lengths = np.hypot(*np.diff(star.points, axis=0).T)
                widths.append(np.append(lengths, lengths[-1]))
            if star.feature.is_notch:  # its faces beyond the box
                near.append(star.feature.outline)
                widths.append(np.full(len(near[-1]), np.median(widths[-1])))
        for name in block.inner_points:
            near.append(np.array([self.inputs.points[name]]))
            widths.append(np.array([self.edge_limit]))
        places, sizes = np.vstack(near), np.concatenate(widths)
        notches = [star.feature.notch for star in stars if star.feature.is_notch]
        boxes = [star.box for star in stars if star.box is not None]

        def divide(first: tuple[float, float], last: tuple[float, float]) -> None:
            length, middle = math.dist(first, last), (0.5 * (first[0] + last[0]), 0.5 * (first[1] + last[1]))
            wanted = min(self.edge_limit, float((sizes + _GROWTH * np.hypot(*(places - middle).T)).min()))
            if length > 1.3 * wanted:
                self.vertex(*middle)
                divide(first, middle)
                divide(middle, last)

        corners = [(block.low, 0.0), (block.high, 0.0), (block.high, beam.height), (block.low, beam.height)]
        mouths = {
            (notch.x + offset, beam.height)
            for notch in notches
            for offset in (notch.left_offset, notch.right_offset)
        }
        for first, last in zip(corners, corners[1:] + corners[:1]):
            positions = [
                self.cells.vertices[v] for v in self.chain([self.vertex(*first), self.vertex(*last)])
            ]
            on_top = first[1] == last[1] == beam.height
            if on_top:
                positions = sorted({*positions, *mouths}, reverse=True)
            for a, b in zip(positions, positions[1:]):
                in_mouth = on_top and any(
                    n.x + n.left_offset < 0.5 * (a[0] + b[0]) < n.x + n.right_offset for n in notches
                )
                if not in_mouth and not any(_touches(box, a, b) for box in boxes):
                    divide(a, b)

    @property
    def edge_limit(self) -> float:
        """Longest edge in a filled block, m."""
        return min(0.5 * self.beam.height, self.inputs.size)


def _touches(box: Box, first: tuple[float, float], last: tuple[float, float]) -> bool:
    """The segment lies on a side of the box."""
    tolerance = 1e-9 * (box.top - box.bottom)
    return all(
        box.left - tolerance <= x <= box.right + tolerance
        and box.bottom - tolerance <= y <= box.top + tolerance
        for x, y in (first, last)
    )

"""Wanted lengths of edges in a plane graph, and the rosettes around its tips, kinks and junctions."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
import shapely
from scipy.spatial import cKDTree

from meshing.cells.complex import neighbours
from meshing.geometry.drawing import RIM
from meshing.geometry.graph import Graph
from meshing.vectors import line_length, on_circle, turn

ARCS = 8  # of a hole, at least
_GROWTH = 0.45  # of edges with the distance
_ROSETTE = 0.4  # radius of a rosette, relative to the distance of the nearest other thing
_ROSETTE_SIZE = 0.6  # the same, relative to the largest edge
_KINK = math.radians(20.0)  # a kink from here on has a rosette
_NEARNESS = 0.6  # longest edge, relative to the distance of something else
_SLACK = 0.3  # of an edge that is left out
_MANY = 400  # nearest sources that are looked at
_TURN = np.linspace(0, 2 * math.pi, 65)


class Lengths:
    """Wanted lengths, which grow with the distance from sources.

    Parameters
    ----------
    graph : Graph
    largest : float
        Largest edge, m.
    across : mapping of int to int
        Mouth corners of notches that are cut out, from the one to the other: what is near to a flank through
        a notch is not near in the material.

    Attributes
    ----------
    rosettes : dict of int to float
        Radius of the rosette around a vertex, m.
    """

    def __init__(self, graph: Graph, largest: float, across: Mapping[int, int]) -> None:
        self.largest = largest
        self.rosettes: dict[int, float] = {}
        self._sources: list[tuple[np.ndarray, np.ndarray]] = []
        pairs = [pair for path in graph.sides for pair in zip(path, path[1:])] + graph.segments()
        rims = [on_circle(np.array(centre), radius, _TURN) for centre, radius in graph.holes.values()]
        straight = shapely.linestrings(graph.vertices[np.array(pairs)])
        lines = np.array([*straight, *map(shapely.LineString, rims)])
        ends = [{across.get(v, v) for v in pair} for pair in pairs] + [*map(set, graph.circles)]
        tree = shapely.STRtree(lines)
        self._plan_rosettes(graph, tree, ends)
        for pair, line in zip(pairs, lines):
            self._add(graph.vertices[list(pair)], line.length)
        for rim, (_, radius) in zip(rims, graph.holes.values()):
            self._add(rim, 2 * math.pi * radius / ARCS)
        self._add_nearness(tree, ends)
        places, sizes = (np.concatenate(part) for part in zip(*self._sources))
        self._sizes = sizes[sizes < largest]
        self._tree = cKDTree(places[sizes < largest]) if len(self._sizes) else None

    def __call__(self, points: np.ndarray) -> np.ndarray:
        """Wanted length at points (n, 2), m."""
        if self._tree is None:
            return np.full(len(points), self.largest)
        nearest = list(range(1, min(len(self._sizes), _MANY) + 1))
        distance, number = self._tree.query(points, k=nearest)
        return np.minimum(self.largest, (self._sizes[number] + _GROWTH * distance).min(axis=1))

    def _add(self, places: np.ndarray, sizes: np.ndarray | float) -> None:
        self._sources.append((places, np.broadcast_to(sizes, len(places))))

    def _plan_rosettes(self, graph: Graph, tree: shapely.STRtree, ends: list[set[int]]) -> None:
        """Rosettes that keep clear of lines they are not on, of other vertices and of named points."""
        vertices, outline = graph.vertices, graph.outline
        for v, others in neighbours(graph.segments()).items():
            arms = vertices[others] - vertices[v]
            if v in outline or (len(others) == 2 and abs(turn(-arms[0], arms[1])) <= _KINK):
                continue
            spot = shapely.Point(vertices[v])
            clear = [math.dist(vertices[v], vertices[w]) for w in {*others, *graph.points.values()} - {v}]
            close = tree.query(spot, "dwithin", min(clear))
            clear += [spot.distance(tree.geometries[i]) for i in close if v not in ends[i]]
            self.rosettes[v] = radius = min(_ROSETTE * min(clear), _ROSETTE_SIZE * self.largest)
            self._add(on_circle(vertices[v], radius, _TURN[::8]), RIM * radius)

    def _add_nearness(self, tree: shapely.STRtree, ends: list[set[int]]) -> None:
        """Sources where lines come close to others that they do not touch."""
        for number, line in enumerate(tree.geometries):
            count = int(np.clip(math.ceil(2 * line.length / self.largest), 3, 200))
            spots = shapely.line_interpolate_point(line, (np.arange(count) + 0.5) / count, normalized=True)
            place, other = tree.query(spots, predicate="dwithin", distance=self.largest / _NEARNESS)
            apart = np.array([not ends[number] & ends[k] and k != number for k in other], bool)
            gap = np.full(count, np.inf)
            distances = shapely.distance(spots[place[apart]], tree.geometries[other[apart]])
            np.minimum.at(gap, place[apart], distances)
            self._add(shapely.get_coordinates(spots), _NEARNESS * gap)


def divided(curve: np.ndarray, wanted: Lengths, least: int = 1) -> np.ndarray:
    """Fractions in (0, 1) that divide a curve as wanted.

    Parameters
    ----------
    curve : (n, 2) array
        Points at even fractions of it, m.
    least : int
        Number of parts, at least.
    """
    density = line_length(curve) / wanted(curve)
    total = np.concatenate([[0.0], np.cumsum(0.5 * (density[1:] + density[:-1]))]) / (len(curve) - 1)
    parts = max(least, math.ceil(total[-1] - _SLACK))
    even = np.arange(1, parts) / parts
    if np.ptp(density) <= 0.05 * density.min():
        return even
    return np.interp(even * total[-1], total, np.linspace(0, 1, len(curve)))


def divided_line(
    start: np.ndarray, stop: np.ndarray, wanted: Lengths, radii: tuple[float, float] = (0.0, 0.0)
) -> np.ndarray:
    """Fractions in (0, 1) that divide a line: at the rims of the rosettes at its ends and between them."""
    length = math.dist(start, stop)
    low, high = radii[0] / length, 1.0 - radii[1] / length
    span = np.linspace(low, high, 129)[:, None]
    inner = low + (high - low) * divided(start + span * (stop - start), wanted)
    return np.array([*([low] if radii[0] else []), *inner, *([high] if radii[1] else [])])

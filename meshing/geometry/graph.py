"""A body with holes and crack lines as a plane graph: what touches or crosses shares a vertex."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain

import numpy as np
import shapely
from scipy.spatial import cKDTree

from meshing.cells.complex import Point

SNAP = 1e-7  # distance that counts as touching, relative to the body's diagonal
_CLOSE = 1e-4  # least distance of features that do not touch, relative to the diagonal
Circle = tuple[Point, float]
# Pieces of cracks, and what is wrong with each.
Conflicts = Iterator[tuple[int, str]]


@dataclass
class Graph:
    """Vertices and lines of a body with cracks.

    Attributes
    ----------
    vertices : (n, 2) array
        m.
    sides : list of list of int
        For each side of the outline its vertices, from corner to corner.
    holes : mapping of str to ((x, y), radius)
        By the names of their edge sets.
    circles : list of list of int
        Vertices on each hole, in any order.
    cracks : dict of str to list of int
        Each crack's line by its vertices.
    points : dict of str to int
        Named vertices.
    """

    vertices: np.ndarray
    sides: list[list[int]]
    holes: Mapping[str, Circle]
    circles: list[list[int]]
    cracks: dict[str, list[int]]
    points: dict[str, int]

    @property
    def outline(self) -> set[int]:
        """Vertices on the outline or on holes."""
        return set().union(*self.sides, *self.circles)

    def segments(self) -> list[tuple[int, int]]:
        """Pieces of cracks."""
        return [pair for path in self.cracks.values() for pair in zip(path, path[1:])]

    @property
    def owners(self) -> list[str]:
        """Crack of each of these."""
        return [name for name, path in self.cracks.items() for _ in path[1:]]

    @property
    def inner(self) -> set[int]:
        """Vertices of cracks inside."""
        return {v for path in self.cracks.values() for v in path} - self.outline

    def at(self, vertex: int, sentence: str) -> tuple[int, str]:
        """The first piece of a crack that has a vertex, and the vertex' place ahead of what is said of it."""
        x, y = self.vertices[vertex]
        first = next(k for k, pair in enumerate(self.segments()) if vertex in pair)
        return first, f"its point ({x:.6g}, {y:.6g}) m {sentence}"


def plane_graph(
    corners: Sequence[Point],
    holes: Mapping[str, Circle],
    cracks: Mapping[str, np.ndarray],
    points: Mapping[str, Point],
) -> Graph:
    """Put cracks and points into a body.

    Parameters
    ----------
    corners : sequence of (x, y)
        Outline, counter-clockwise, a simple polygon, m.
    holes : mapping of str to ((x, y), radius)
        Circles inside it that touch nothing, m.
    cracks : mapping of str to (n, 2) array
        Corners of each line, m.
    points : mapping of str to (x, y)
        Named points, m.

    Raises
    ------
    ValueError
        A crack leaves the body, runs along its edge or over another crack, or comes too close to something
        without touching it; a point outside.
    """
    return _Body(np.array(corners, float), [*holes.values()]).graph(holes, cracks, points)


class _Body:
    """An outline with holes."""

    def __init__(self, corners: np.ndarray, holes: Sequence[Circle]) -> None:
        self.corners, self.holes = corners, holes
        self.snap = SNAP * float(np.hypot(*np.ptp(corners, axis=0)))
        self.least = _CLOSE / SNAP * self.snap
        self.sides = shapely.linestrings(np.stack([corners, np.roll(corners, -1, axis=0)], axis=1))
        self.area = shapely.Polygon(corners)

    def graph(
        self, holes: Mapping[str, Circle], cracks: Mapping[str, np.ndarray], points: Mapping[str, Point]
    ) -> Graph:
        """The plane graph; what touches is one vertex."""
        lines = {name: self.on_edge(line) for name, line in cracks.items()}
        for name, line in lines.items():
            self.check_line(name, line)
        ends = [np.stack([line[:-1], line[1:]], axis=1) for line in lines.values()]
        owner = [name for name, pieces in zip(lines, ends) for _ in pieces]
        segments = shapely.linestrings(np.concatenate([np.empty((0, 2, 2)), *ends]))
        met = _crossings(segments, owner, self.snap)
        named = self.on_edge(np.array([*points.values()], float).reshape(-1, 2))
        places = np.vstack([self.corners, *lines.values(), met, named])
        number = np.arange(len(places))
        for i, j in sorted(cKDTree(places).query_pairs(self.snap)):
            number[j] = min(number[j], number[i])
        kept, number = np.unique(number, return_inverse=True)
        vertices = places[kept]
        spots = shapely.points(vertices)

        def along(line: shapely.LineString) -> list[int]:
            near = np.flatnonzero(shapely.distance(spots, line) <= self.snap)
            return near[np.argsort(shapely.line_locate_point(line, spots[near]), kind="stable")].tolist()

        paths = {}
        first = len(self.corners)
        for name, line in lines.items():
            path = [int(number[first])]
            for segment, of in zip(segments, owner):
                if of == name:
                    path += [v for v in along(segment) if v != path[-1]]
            if len(path) < 2:
                raise ValueError(
                    f"crack {name!r}: its points lie within {self.snap:.3g} m near ({line[0, 0]:.6g}, "
                    f"{line[0, 1]:.6g}) m, where all counts as one place; make it longer or leave it out."
                )
            paths[name] = path
            first += len(line)
        sides = [along(side) for side in self.sides]
        on_holes = (np.abs(_gaps(vertices, hole)) <= self.snap for hole in self.holes)
        circles = [np.flatnonzero(near).tolist() for near in on_holes]
        own = dict(zip(points, number[len(places) - len(named) :].tolist()))
        graph = Graph(vertices, sides, holes, circles, paths, own)
        self.check_points(graph)
        self.check_clearances(graph)
        return graph

    def on_edge(self, places: np.ndarray) -> np.ndarray:
        """Places with those that touch the outline or a hole put there exactly."""
        result = places.copy()
        for k, place in enumerate(places):
            point = shapely.Point(place)
            side = self.sides[int(np.argmin(shapely.distance(self.sides, point)))]
            if side.distance(point) <= self.snap:
                ends = shapely.get_coordinates(side)
                foot = shapely.get_coordinates(side.interpolate(side.project(point)))[0]
                result[k] = np.where(ends[0] == ends[1], ends[0], foot)  # exactly on a side along an axis
            for centre, radius in self.holes:
                if abs(math.dist(place, centre) - radius) <= self.snap:
                    result[k] = centre + radius * (place - centre) / math.dist(place, centre)
        return result

    def check_line(self, name: str, line: np.ndarray) -> None:
        """ValueError for a crack that leaves the body or runs along its edge."""
        for x, y in line:
            if not self.area.dwithin(shapely.Point(x, y), self.snap):
                raise ValueError(
                    f"crack {name!r}: its point ({x:.6g}, {y:.6g}) m is outside the body; let the crack end "
                    "on the edge."
                )
            for i, (centre, radius) in enumerate(self.holes, 1):
                if math.dist((x, y), centre) < radius - self.snap:
                    raise ValueError(
                        f"crack {name!r}: its point ({x:.6g}, {y:.6g}) m is inside hole {i}; let the crack "
                        "end on the hole's edge."
                    )
        string = shapely.LineString(line)
        for i, side in enumerate(self.sides, 1):
            common = string.intersection(side)
            if common.length > self.snap:
                raise ValueError(
                    f"crack {name!r}: it runs along side {i} of the outline from ({common.bounds[0]:.6g}, "
                    f"{common.bounds[1]:.6g}) m; a crack runs through the inside."
                )
        outside = string.difference(self.area.buffer(2 * self.snap))
        if not outside.is_empty:
            x, y = shapely.get_coordinates(outside.representative_point())[0]
            raise ValueError(
                f"crack {name!r}: it leaves the body near ({x:.6g}, {y:.6g}) m; give each piece inside as a "
                "crack of its own."
            )

    def check_points(self, graph: Graph) -> None:
        """ValueError for a named point outside the body or beside a crack."""
        outline = graph.outline
        for name, vertex in graph.points.items():
            x, y = graph.vertices[vertex]
            place, inside = shapely.Point(x, y), vertex not in outline
            if inside and not (
                self.area.covers(place) and all(math.dist((x, y), c) >= r for c, r in self.holes)
            ):
                raise ValueError(f"point {name!r} at ({x:g}, {y:g}) m is outside the body; move it inside.")
            for crack, path in graph.cracks.items():
                beside = shapely.LineString(graph.vertices[path]).distance(place)
                if vertex in path or (inside and beside < self.least):
                    raise ValueError(
                        f"point {name!r} at ({x:g}, {y:g}) m is on or next to crack {crack!r} (a mouth's "
                        f"corners are {crack}_right and {crack}_left); move it into the material."
                    )

    def check_clearances(self, graph: Graph) -> None:
        """ValueError for the first crack that is close to what it does not touch."""
        if pairs := graph.segments():
            lines = shapely.linestrings(graph.vertices[np.array(pairs)])
            close = (self.close_holes, self.close_vertices, self.close_edge)
            for k, sentence in chain.from_iterable(found(graph, lines) for found in close):
                raise ValueError(f"crack {graph.owners[k]!r}: {sentence}.")

    def close_holes(self, graph: Graph, lines: np.ndarray) -> Conflicts:
        """Lines that cross holes, or pass close by."""
        expected = f"{self.least:.3g} m or an end on the hole was expected; move it or let it end there"
        for i, (centre, radius) in enumerate(self.holes, 1):
            gap = shapely.distance(lines, shapely.Point(centre)) - radius
            for k in np.flatnonzero(gap < self.least):
                if gap[k] < -self.snap:
                    yield k, f"it crosses hole {i}; give each piece outside the hole as a crack of its own"
                if not set(graph.segments()[k]) & set(graph.circles[i - 1]):
                    yield k, f"it passes hole {i} at {max(gap[k], 0.0):.3g} m, {expected}"

    def close_vertices(self, graph: Graph, lines: np.ndarray) -> Conflicts:
        """Lines close to corners, and to vertices of cracks, that are not on them."""
        expected = f"{self.least:.3g} m or a point on the corner was expected; move it or let it end there"
        spots, inner, pairs = shapely.points(graph.vertices), graph.inner, graph.segments()
        near = shapely.STRtree(lines).query(spots, predicate="dwithin", distance=self.least)
        for v, k in near.T.tolist():
            x, y = graph.vertices[v]
            if v in pairs[k]:
                continue
            if v < len(self.corners):
                gap = f"({x:.6g}, {y:.6g}) m at {spots[v].distance(lines[k]):.3g} m"
                yield k, f"it passes the outline's corner {gap}, {expected}"
            if v in inner:
                apart = "without touching it; join them or move them apart"
                yield graph.at(v, f"is too close to crack {graph.owners[k]!r} {apart}")

    def close_edge(self, graph: Graph, _: np.ndarray) -> Conflicts:
        """Vertices of cracks inside that are close to the edge."""
        expected = f"{self.least:.3g} m or touching was expected; end it on the edge or move it"
        inner = sorted(graph.inner)
        places = graph.vertices[inner]
        gaps = [shapely.distance(self.area.exterior, shapely.points(places))]
        gaps += [np.abs(_gaps(places, hole)) for hole in self.holes]
        for vertex, gap in zip(inner, np.min(gaps, axis=0)):
            if gap < self.least:
                yield graph.at(vertex, f"is {gap:.3g} m from the edge, {expected}")


def _gaps(places: np.ndarray, hole: Circle) -> np.ndarray:
    """Distances of places (n, 2) from a hole's edge, negative inside, m."""
    return np.hypot(*(places - hole[0]).T) - hole[1]


def _crossings(segments: np.ndarray, owner: Sequence[str], snap: float) -> np.ndarray:
    """(n, 2): where crack lines cross; ends that lie on a line are vertices already."""
    one, other = shapely.STRtree(segments).query(segments, predicate="intersects")
    one, other = (part[one < other] for part in (one, other))
    meet = shapely.intersection(segments[one], segments[other])
    for k in np.flatnonzero(shapely.length(meet) > snap):
        x, y = meet[k].bounds[:2]
        raise ValueError(
            f"crack {owner[one[k]]!r}: it runs along crack {owner[other[k]]!r} from ({x:.6g}, {y:.6g}) m; "
            "a piece of line belongs to one crack."
        )
    # an end that lies on the other line to the snapping distance is where they meet
    reached = np.zeros(len(meet), bool)
    for first, second in ((one, other), (other, one)):
        ends = shapely.get_coordinates(segments[first]).reshape(-1, 2, 2)
        for end in np.moveaxis(ends, 1, 0):
            reached |= shapely.distance(shapely.points(end), segments[second]) <= snap
    return shapely.get_coordinates(meet[(shapely.get_type_id(meet) == 0) & ~reached])

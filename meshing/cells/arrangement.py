"""Cracks in a plane body as a plane graph: ends put on what they touch, lines divided where they cross."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import shapely

Point = tuple[float, float]
SNAP = 1e-7  # distance that counts as touching, relative to the body's diagonal
_CLOSE = 1e-4  # least distance of features that do not touch, relative to the diagonal
_CIRCLE = 64  # sides of the polygon that stands for a hole in tests


@dataclass(frozen=True)
class CrackPath:
    """A crack's line: name and corners (n, 2), m."""

    name: str
    points: np.ndarray


@dataclass
class Arrangement:
    """Vertices and lines of a body with cracks.

    Attributes
    ----------
    vertices : list of (x, y)
        m.
    sides : list of list of int
        For each side of the outline its vertices, from corner to corner.
    circles : list of ((x, y), radius, list of int)
        Holes; the vertices on them so far, in any order.
    cracks : list of list of int
        For each crack its vertices.
    points : dict of str to int
        Named vertices.
    outline : set of int
        Vertices on the outline or on holes.
    """

    vertices: list[Point] = field(default_factory=list)
    sides: list[list[int]] = field(default_factory=list)
    circles: list[tuple[Point, float, list[int]]] = field(default_factory=list)
    cracks: list[list[int]] = field(default_factory=list)
    points: dict[str, int] = field(default_factory=dict)
    outline: set[int] = field(default_factory=set)

    def neighbours(self) -> dict[int, list[int]]:
        """For each vertex on a crack the next ones along all cracks."""
        near: dict[int, list[int]] = {}
        for path in self.cracks:
            for a, b in zip(path, path[1:]):
                near.setdefault(a, []).append(b)
                near.setdefault(b, []).append(a)
        return near


def arrange(
    corners: np.ndarray,
    holes: Sequence[tuple[Point, float]],
    cracks: Sequence[CrackPath],
    points: Mapping[str, Point],
) -> Arrangement:
    """Put cracks and points into a body.

    Parameters
    ----------
    corners : (n, 2) array
        Outline, counter-clockwise, a simple polygon, m.
    holes : sequence of ((x, y), radius)
        Circles inside it that touch nothing, m.
    cracks : sequence of CrackPath
    points : mapping of str to (x, y)
        Named points, m.

    Returns
    -------
    Arrangement

    Raises
    ------
    ValueError
        A crack leaves the body, runs along its edge or over another crack, or comes too close to something
        without touching it; a point outside.
    """
    builder = _Builder(np.asarray(corners, float), list(holes))
    lines = [builder.place_crack(crack) for crack in cracks]
    cuts = _crossings(lines, cracks, builder.snap)
    result = builder.result
    for line, cut in zip(lines, cuts):
        path: list[int] = []
        for number, (start, stop) in enumerate(zip(line, line[1:])):
            stations = [(0.0, start), *((t, p) for i, t, p in cut if i == number), (1.0, stop)]
            for _, point in sorted(stations, key=lambda item: item[0]):
                vertex = builder.vertex(tuple(point))
                if not path or path[-1] != vertex:
                    path.append(vertex)
        if len(path) < 2:
            x, y = result.vertices[path[0]]
            raise ValueError(
                f"crack {cracks[len(result.cracks)].name!r}: its points lie within {builder.snap:.3g} m near "
                f"({x:.6g}, {y:.6g}) m, where all counts as one place; make it longer or leave it out."
            )
        result.cracks.append(path)
    builder.check(cracks)
    for name, point in points.items():
        result.points[name] = builder.place_point(name, point)
    builder.finish()
    return result


class _Builder:
    """Vertices found by their place."""

    def __init__(self, corners: np.ndarray, holes: list[tuple[Point, float]]) -> None:
        self.result = Arrangement()
        self.diagonal = float(np.hypot(*np.ptp(corners, axis=0)))
        self.snap = SNAP * self.diagonal
        self.corners, self.holes = corners, holes
        self.sides = shapely.linestrings(np.stack([corners, np.roll(corners, -1, axis=0)], axis=1))
        self.side_tree = shapely.STRtree(self.sides)
        self.body = shapely.Polygon(corners)
        self.rings = [shapely.Point(centre).buffer(radius, _CIRCLE) for centre, radius in holes]
        self._grid: dict[tuple[int, int], list[int]] = {}
        first = [self.vertex(tuple(corner)) for corner in corners]
        self.on_side: list[dict[int, float]] = [
            {a: 0.0, b: 1.0} for a, b in zip(first, first[1:] + first[:1])
        ]
        self.on_circle: list[list[int]] = [[] for _ in holes]
        self.result.outline.update(first)

    def vertex(self, point: Point) -> int:
        """The vertex at a place, made if there is none within the snapping distance."""
        x, y = point
        home = (math.floor(x / (4 * self.snap)), math.floor(y / (4 * self.snap)))
        for i in (-1, 0, 1):
            for j in (-1, 0, 1):
                for number in self._grid.get((home[0] + i, home[1] + j), ()):
                    if math.dist(point, self.result.vertices[number]) <= self.snap:
                        return number
        self.result.vertices.append((float(x), float(y)))
        self._grid.setdefault(home, []).append(len(self.result.vertices) - 1)
        return len(self.result.vertices) - 1

    def on_edge(self, point: Point) -> int | None:
        """The vertex on the outline or on a hole if a point lies there, made if there is none."""
        place = shapely.Point(point)
        found = [int(i) for i in self.side_tree.query(place, predicate="dwithin", distance=self.snap)]
        for i in found:
            start, stop = self.corners[i], self.corners[(i + 1) % len(self.corners)]
            step = stop - start
            t = float(np.clip((np.subtract(point, start) @ step) / (step @ step), 0.0, 1.0))
            # Exactly on a side that is parallel to an axis.
            on = [start[k] if start[k] == stop[k] else float(start[k] + t * step[k]) for k in (0, 1)]
            number = self.vertex((on[0], on[1]))
            self.on_side[i].setdefault(number, t)
            self.result.outline.add(number)
        if found:
            return number
        for i, (centre, radius) in enumerate(self.holes):
            distance = math.dist(point, centre)
            if abs(distance - radius) <= self.snap:
                on = np.array(centre) + radius / distance * np.subtract(point, centre)
                number = self.vertex((float(on[0]), float(on[1])))
                if number not in self.on_circle[i]:
                    self.on_circle[i].append(number)
                self.result.outline.add(number)
                return number
        return None

    def place_crack(self, crack: CrackPath) -> np.ndarray:
        """Corners of a crack with those on the edge put there; refuses what leaves the body."""
        line = []
        for x, y in crack.points:
            number = self.on_edge((float(x), float(y)))
            line.append(self.result.vertices[number] if number is not None else (float(x), float(y)))
            if number is None and not self.body.contains(shapely.Point(x, y)):
                raise ValueError(
                    f"crack {crack.name!r}: its point ({x:.6g}, {y:.6g}) m is outside the body; let the "
                    "crack end on the edge."
                )
            for i, (centre, radius) in enumerate(self.holes, 1):
                if number is None and math.dist((x, y), centre) < radius:
                    raise ValueError(
                        f"crack {crack.name!r}: its point ({x:.6g}, {y:.6g}) m is inside hole {i}; let the "
                        "crack end on the hole's edge."
                    )
        string = shapely.LineString(line)
        for i in self.side_tree.query(string, predicate="intersects"):
            common = string.intersection(self.sides[i])
            if common.length > self.snap:
                raise ValueError(
                    f"crack {crack.name!r}: it runs along side {i + 1} of the outline from "
                    f"({common.bounds[0]:.6g}, {common.bounds[1]:.6g}) m; a crack runs through the inside."
                )
        allowed = self.body.buffer(2 * self.snap)
        if not allowed.contains(string):
            outside = string.difference(allowed).representative_point()
            raise ValueError(
                f"crack {crack.name!r}: it leaves the body near ({outside.x:.6g}, {outside.y:.6g}) m; give "
                "each piece inside as a crack of its own."
            )
        for i, ring in enumerate(self.rings, 1):
            if string.intersection(ring).length > 1e-3 * math.sqrt(ring.area):
                raise ValueError(
                    f"crack {crack.name!r}: it crosses hole {i}; give each piece outside the hole as a crack "
                    "of its own."
                )
        return np.array(line)

    def place_point(self, name: str, point: Point) -> int:
        """A named point, on a vertex, on the edge or inside."""
        number = self.on_edge(point)
        if number is not None:
            return number
        place = shapely.Point(point)
        if not self.body.contains(place) or any(math.dist(point, c) < r for c, r in self.holes):
            raise ValueError(
                f"point {name!r} at ({point[0]:g}, {point[1]:g}) m is outside the body; move it inside."
            )
        for number, path in enumerate(self.result.cracks, 1):
            line = shapely.LineString([self.result.vertices[v] for v in path])
            if line.distance(place) < _CLOSE * self.diagonal:
                raise ValueError(
                    f"point {name!r} at ({point[0]:g}, {point[1]:g}) m is on or next to crack {number}; move "
                    "it into the material."
                )
        return self.vertex(point)

    def check(self, cracks: Sequence[CrackPath]) -> None:
        """Vertices of cracks keep clear of the edge and of lines that they are not on."""
        vertices, least = self.result.vertices, _CLOSE * self.diagonal
        segments, owners = [], []
        for number, path in enumerate(self.result.cracks):
            for pair in zip(path, path[1:]):
                segments.append(pair)
                owners.append(number)
        if not segments:
            return
        lines = shapely.linestrings(np.array([[vertices[a], vertices[b]] for a, b in segments]))
        tree = shapely.STRtree(lines)
        self._check_passing(lines, segments, [cracks[owner].name for owner in owners], least)
        for number, path in enumerate(self.result.cracks):
            name = cracks[number].name
            for vertex in path:
                x, y = vertices[vertex]
                place = shapely.Point(x, y)
                if vertex not in self.result.outline:
                    gaps = [self.body.exterior.distance(place)]
                    gaps += [abs(math.dist((x, y), centre) - radius) for centre, radius in self.holes]
                    if min(gaps) < least:
                        raise ValueError(
                            f"crack {name!r}: its point ({x:.6g}, {y:.6g}) m is {min(gaps):.3g} m from the "
                            f"edge, {least:.3g} m or touching was expected; end it on the edge or move it."
                        )
                for i in tree.query(place, predicate="dwithin", distance=least):
                    if vertex not in segments[i]:
                        raise ValueError(
                            f"crack {name!r}: its point ({x:.6g}, {y:.6g}) m is too close to crack "
                            f"{cracks[owners[i]].name!r} without touching it; join them or move them apart."
                        )
        seen: dict[tuple[int, int], int] = {}
        for (a, b), owner in zip(segments, owners):
            key = (min(a, b), max(a, b))
            if key in seen:
                x, y = vertices[a]
                raise ValueError(
                    f"crack {cracks[owner].name!r}: it runs along crack {cracks[seen[key]].name!r} from "
                    f"({x:.6g}, {y:.6g}) m; a piece of line belongs to one crack."
                )
            seen[key] = owner

    def _check_passing(
        self, lines: np.ndarray, segments: list[tuple[int, int]], names: list[str], least: float
    ) -> None:
        """Lines between their vertices keep clear of holes and corners that they do not touch."""
        for i, (centre, radius) in enumerate(self.holes):
            gaps = shapely.distance(lines, shapely.Point(centre)) - radius
            for k in np.flatnonzero(gaps < least):
                if gaps[k] < -self.snap:
                    raise ValueError(
                        f"crack {names[k]!r}: it crosses hole {i + 1}; give each piece outside the hole as a "
                        "crack of its own."
                    )
                if not set(segments[k]) & set(self.on_circle[i]):
                    raise ValueError(
                        f"crack {names[k]!r}: it passes hole {i + 1} at {max(gaps[k], 0.0):.3g} m, "
                        f"{least:.3g} m or an end on the hole was expected; move it or let it end there."
                    )
        # the outline's corners are the first vertices
        for corner, (x, y) in enumerate(self.result.vertices[: len(self.corners)]):
            gaps = shapely.distance(lines, shapely.Point(x, y))
            for k in np.flatnonzero(gaps < least):
                if corner not in segments[k]:
                    raise ValueError(
                        f"crack {names[k]!r}: it passes the outline's corner ({x:.6g}, {y:.6g}) m at "
                        f"{gaps[k]:.3g} m, {least:.3g} m or a point on the corner was expected; move it or "
                        "let it end there."
                    )

    def finish(self) -> None:
        """Sides and circles with the vertices found on them."""
        for places in self.on_side:
            self.result.sides.append(sorted(places, key=places.__getitem__))
        for (centre, radius), numbers in zip(self.holes, self.on_circle):
            self.result.circles.append((centre, radius, numbers))


def _crossings(
    lines: Sequence[np.ndarray], cracks: Sequence[CrackPath], snap: float
) -> list[list[tuple[int, float, np.ndarray]]]:
    """For each crack (segment, parameter, point) of the places where it meets cracks."""
    cuts: list[list[tuple[int, float, np.ndarray]]] = [[] for _ in lines]
    segments = [(n, i) for n, line in enumerate(lines) for i in range(len(line) - 1)]
    if not segments:
        return cuts
    ends = np.array([[lines[n][i], lines[n][i + 1]] for n, i in segments])
    tree = shapely.STRtree(shapely.linestrings(ends))
    for one, other in tree.query(tree.geometries, predicate="dwithin", distance=snap).T:
        (n, i), (m, j) = segments[one], segments[other]
        if one >= other or (n == m and abs(i - j) == 1 and not _folds_back(ends[one], ends[other])):
            continue
        a, b = ends[one]
        c, d = ends[other]
        across = float((b - a)[0] * (d - c)[1] - (b - a)[1] * (d - c)[0])
        if abs(across) <= 1e-9 * math.dist(a, b) * math.dist(c, d):
            along = (b - a) / math.dist(a, b)
            low, high = sorted((float((c - a) @ along), float((d - a) @ along)))
            if min(high, math.dist(a, b)) - max(low, 0.0) > snap:
                x, y = a + max(low, 0.0) * along
                raise ValueError(
                    f"crack {cracks[n].name!r}: it runs along crack {cracks[m].name!r} from ({x:.6g}, "
                    f"{y:.6g}) m; a piece of line belongs to one crack."
                )
        # An end that lies on the other line is where they meet, free of round-off.
        for point, (target, place), (start, stop) in (
            (a, (m, j), (c, d)),
            (b, (m, j), (c, d)),
            (c, (n, i), (a, b)),
            (d, (n, i), (a, b)),
        ):
            t = float((point - start) @ (stop - start) / ((stop - start) @ (stop - start)))
            if -1e-9 < t < 1 + 1e-9 and math.dist(point, start + t * (stop - start)) <= snap:
                cuts[target].append((place, min(max(t, 0.0), 1.0), point))
                break
        else:
            if abs(across) > 0.0:
                t = float(((c - a)[0] * (d - c)[1] - (c - a)[1] * (d - c)[0]) / across)
                s = float(((c - a)[0] * (b - a)[1] - (c - a)[1] * (b - a)[0]) / across)
                if 0.0 <= t <= 1.0 and 0.0 <= s <= 1.0:
                    point = a + t * (b - a)
                    cuts[n].append((i, t, point))
                    cuts[m].append((j, s, point))
    return cuts


def _folds_back(first: np.ndarray, second: np.ndarray) -> bool:
    """Two segments that follow each other run back over each other."""
    one, other = first[1] - first[0], second[1] - second[0]
    across = one[0] * other[1] - one[1] * other[0]
    return bool(abs(across) <= 1e-9 * np.hypot(*one) * np.hypot(*other) and one @ other < 0)

"""A body with cracks filled with cells: sizes, divided lines, stars around tips, kinks and junctions."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from scipy.spatial import cKDTree

from meshing.cells.arrangement import Arrangement
from meshing.cells.complex import CellComplex
from meshing.cells.filling import Star, fill_polygon

_GROWTH = 0.45  # of edges with the distance
_STAR = 0.4  # radius of a star, relative to the distance of the nearest other thing
_RIM = 0.77  # edges of a star's rim, relative to its radius
_STAR_SIZE = 0.6  # relative to the largest edge
_SPOKE = math.radians(46.0)  # widest angle between spokes
_KINK = math.radians(20.0)  # a kink from here on has a star
_NEARNESS = 0.6  # longest edge, relative to the distance of something else
_ARCS = 8  # of a hole, at least
_MANY = 400  # nearest sources that are looked at


class SizeField:
    """Wanted length of edges: grows with the distance from sources."""

    def __init__(self, largest: float) -> None:
        self.largest = largest
        self._places: list[np.ndarray] = []
        self._sizes: list[np.ndarray] = []
        self._tree: cKDTree | None = None

    def add(self, places: np.ndarray, sizes: np.ndarray | float) -> None:
        """Sources at places (n, 2), m."""
        places = np.asarray(places, float).reshape(-1, 2)
        sizes = np.broadcast_to(np.asarray(sizes, float), len(places))
        useful = sizes < self.largest
        self._places.append(places[useful])
        self._sizes.append(sizes[useful])

    def __call__(self, points: np.ndarray) -> np.ndarray:
        """Wanted length at points (n, 2), m."""
        if self._tree is None:
            self._all, self._of_all = np.vstack(self._places), np.concatenate(self._sizes)
            self._tree = cKDTree(self._all) if len(self._all) else None
        if self._tree is None:
            return np.full(len(points), self.largest)
        count = len(self._all)
        distance, number = self._tree.query(points, k=list(range(1, min(count, _MANY) + 1)))
        return np.minimum(self.largest, (self._of_all[number] + _GROWTH * distance).min(axis=1))


@dataclass
class RegionPlan:
    """Stars and sizes of an arrangement.

    Attributes
    ----------
    stars : dict of int to float
        Radius of the star around a vertex, m.
    sizes : SizeField
    """

    stars: dict[int, float]
    sizes: SizeField


def plan_region(body: Arrangement, size: float) -> RegionPlan:
    """Choose the stars' radii and the lengths of edges.

    Parameters
    ----------
    size : float
        Largest edge, m.
    """
    vertices = np.array(body.vertices).reshape(-1, 2)
    near = body.neighbours()
    segments = [pair for path in [*body.sides, *body.cracks] for pair in zip(path, path[1:])]
    lines = shapely.linestrings(vertices[np.array(segments).reshape(-1, 2)])
    tree = shapely.STRtree(lines)
    sizes = SizeField(size)
    stars: dict[int, float] = {}
    for vertex, others in near.items():
        if vertex in body.outline or not _special(vertices, vertex, others):
            continue
        place = shapely.Point(vertices[vertex])
        clear = [math.dist(vertices[vertex], vertices[other]) for other in others]
        within = tree.query(place, predicate="dwithin", distance=min(clear))
        clear += [shapely.distance(place, lines[i]) for i in within if vertex not in segments[i]]
        clear += [math.dist(vertices[vertex], centre) - radius for centre, radius, _ in body.circles]
        clear += [math.dist(vertices[vertex], vertices[p]) for p in body.points.values() if p != vertex]
        stars[vertex] = min(_STAR * min(clear), _STAR_SIZE * size)
        turn = np.linspace(0, 2 * math.pi, 9)[:-1]
        rim = vertices[vertex] + stars[vertex] * np.stack([np.cos(turn), np.sin(turn)], axis=1)
        sizes.add(rim, _RIM * stars[vertex])
    lengths = np.array([math.dist(vertices[a], vertices[b]) for a, b in segments])
    for (a, b), length in zip(segments, lengths):
        sizes.add(vertices[[a, b]], max(length, 1e-300))
    _add_nearness(body, vertices, segments, tree, lengths, sizes)
    for centre, radius, _ in body.circles:
        turn = np.linspace(0, 2 * math.pi, 25)[:-1]
        rim = np.array(centre) + radius * np.stack([np.cos(turn), np.sin(turn)], axis=1)
        sizes.add(rim, 2 * math.pi * radius / _ARCS)
    return RegionPlan(stars, sizes)


def _special(vertices: np.ndarray, vertex: int, others: list[int]) -> bool:
    """A tip, a sharp kink or a junction."""
    if len(others) != 2:
        return True
    one, other = (vertices[end] - vertices[vertex] for end in others)
    turn = math.atan2(one[0] * other[1] - one[1] * other[0], float(one @ other))
    return math.pi - abs(turn) > _KINK


def _add_nearness(body, vertices, segments, tree, lengths, sizes: SizeField) -> None:
    """Sources where lines come close to others that they do not touch."""
    samples, owners = [], []
    for number, (a, b) in enumerate(segments):
        count = int(np.clip(math.ceil(2 * lengths[number] / sizes.largest), 3, 200))
        at = (np.arange(count) + 0.5)[:, None] / count
        samples.append(vertices[a] + at * (vertices[b] - vertices[a]))
        owners += [number] * count
    places, owner = np.vstack(samples), np.array(owners)
    reach = sizes.largest / _NEARNESS
    distance = np.full(len(places), np.inf)
    spots = shapely.points(places)
    ends = np.array(segments)
    for sample, line in tree.query(spots, predicate="dwithin", distance=reach).T:
        if not np.isin(ends[line], ends[owner[sample]]).any():
            distance[sample] = min(distance[sample], shapely.distance(spots[sample], tree.geometries[line]))
    for centre, radius, _ in body.circles:
        gap = np.abs(np.hypot(*(places - centre).T) - radius)
        near = gap < reach
        sizes.add(places[near], _NEARNESS * gap[near])
        if near.any():
            toward = places[near] - centre
            sizes.add(centre + radius * toward / np.hypot(*toward.T)[:, None], _NEARNESS * gap[near])
    for i, (centre, radius, _) in enumerate(body.circles):
        for other, other_radius, _ in body.circles[i + 1 :]:
            gap = math.dist(centre, other) - radius - other_radius
            step = np.subtract(other, centre) / math.dist(centre, other)
            sizes.add(np.array([centre + radius * step, other - other_radius * step]), _NEARNESS * gap)
    found = np.isfinite(distance)
    sizes.add(places[found], _NEARNESS * distance[found])


def divide_line(
    start: np.ndarray, stop: np.ndarray, sizes: SizeField, radii: tuple[float, float] = (0.0, 0.0)
) -> np.ndarray:
    """Points strictly between the ends of a line, at the rims of the stars at its ends and between them."""
    length = math.dist(start, stop)
    low, high = radii[0] / length, 1.0 - radii[1] / length
    at = np.linspace(low, high, 129)
    density = length * (high - low) / sizes(start + at[:, None] * (stop - start))
    total = np.concatenate([[0.0], np.cumsum(0.5 * (density[1:] + density[:-1]))]) / 128
    parts = max(1, math.ceil(total[-1] - 0.3))
    inner = np.interp(np.arange(1, parts) / parts * total[-1], total, at)
    if density.max() <= 1.05 * density.min():
        inner = low + np.arange(1, parts) / parts * (high - low)
    places = [*([low] if radii[0] else []), *inner, *([high] if radii[1] else [])]
    return start + np.array(places).reshape(-1, 1) * (stop - start)


def divide_circle(
    centre: tuple[float, float], radius: float, fixed: Sequence[tuple[float, float]], sizes: SizeField
) -> list[tuple[float, tuple[float, float] | None]]:
    """Angles of vertices on a circle, ascending; with the fixed points among them."""
    known = sorted((math.atan2(y - centre[1], x - centre[0]), (x, y)) for x, y in fixed)
    bounds: list[tuple[float, tuple[float, float] | None]] = list(known) or [(0.5 * math.pi / _ARCS, None)]
    result = []
    for i, (angle, point) in enumerate(bounds):
        following = bounds[i + 1][0] if i + 1 < len(bounds) else bounds[0][0] + 2 * math.pi
        at = np.linspace(angle, following, 65)
        spots = np.array(centre) + radius * np.stack([np.cos(at), np.sin(at)], axis=1)
        density = radius * (following - angle) / sizes(spots)
        total = np.concatenate([[0.0], np.cumsum(0.5 * (density[1:] + density[:-1]))]) / 64
        parts = max(
            1 if known else _ARCS,
            math.ceil(total[-1] - 0.1),
            math.ceil((following - angle) / (2 * math.pi / _ARCS) - 1e-6),
        )
        inner = np.interp(np.arange(1, parts) / parts * total[-1], total, at)
        result += [(angle, point), *((float(a), None) for a in inner)]
    return result


def fill_region(
    cells: CellComplex,
    loops: Sequence[list[int]],
    body: Arrangement,
    plan: RegionPlan,
    vertex_of: dict[int, int],
) -> list[list[int]]:
    """Fill what is inside loops of vertices with cells, cracks along their edges.

    Parameters
    ----------
    cells : CellComplex
        Has the loops' vertices; gets the others and the cells.
    loops : sequence of list of int
        Outer loop and those of holes, by vertices of `cells`.
    body : Arrangement
    plan : RegionPlan
    vertex_of : dict of int to int
        Vertices of `cells` for those vertices of `body` that are on the loops; completed here.

    Returns
    -------
    list of list of int
        Each crack's line by vertices of `cells`.
    """
    places = np.array(body.vertices).reshape(-1, 2)
    for vertex in [*(v for path in body.cracks for v in path), *body.points.values()]:
        if vertex not in vertex_of:
            vertex_of[vertex] = cells.add_vertex(*places[vertex])
    segments: list[tuple[int, int]] = []
    rays: dict[int, dict[float, int]] = {vertex: {} for vertex in plan.stars}
    paths = []
    for path in body.cracks:
        line = [vertex_of[path[0]]]
        for a, b in zip(path, path[1:]):
            radii = (plan.stars.get(a, 0.0), plan.stars.get(b, 0.0))
            inner = [cells.add_vertex(*p) for p in divide_line(places[a], places[b], plan.sizes, radii)]
            for vertex, rim in ((a, inner[:1]), (b, inner[-1:])):
                if vertex in rays:
                    x, y = np.subtract(cells.vertices[rim[0]], places[vertex])
                    rays[vertex][math.atan2(y, x)] = rim[0]
            line += [*inner, vertex_of[b]]
        segments += zip(line, line[1:])
        paths.append(line)
    for vertex, radius in plan.stars.items():
        segments += _star(cells, vertex_of[vertex], places[vertex], radius, rays[vertex])
    on_loops = {v for loop in loops for v in loop}
    numbers = [v for loop in loops for v in loop]
    inside = sorted(
        ({v for pair in segments for v in pair} | {vertex_of[p] for p in body.points.values()}) - on_loops
    )
    local = {v: i for i, v in enumerate([*numbers, *inside])}
    added, pieces = fill_polygon(
        [np.array([cells.vertices[v] for v in loop]) for loop in loops],
        np.array([cells.vertices[v] for v in inside]).reshape(-1, 2),
        plan.sizes.largest,
        [(local[a], local[b]) for a, b in segments],
        [Star(local[vertex_of[v]], radius, _RIM * radius) for v, radius in plan.stars.items()],
    )
    numbers += inside
    numbers += [cells.add_vertex(*point) for point in added]
    for piece in pieces:
        cells.add_cell([numbers[i] for i in piece])
    return paths


def _star(
    cells: CellComplex, middle: int, centre: np.ndarray, radius: float, rays: dict[float, int]
) -> list[tuple[int, int]]:
    """Rim and spokes of a star; the rays of cracks are there already."""
    angles = sorted(rays)
    rim, spokes = [], []
    for i, angle in enumerate(angles):
        following = angles[i + 1] if i + 1 < len(angles) else angles[0] + 2 * math.pi
        parts = math.ceil((following - angle) / _SPOKE)
        rim.append(rays[angle])
        for part in range(1, parts):
            turn = angle + (following - angle) * part / parts
            spokes.append(
                cells.add_vertex(centre[0] + radius * math.cos(turn), centre[1] + radius * math.sin(turn))
            )
            rim.append(spokes[-1])
    return [*zip(rim, rim[1:] + rim[:1]), *((middle, v) for v in spokes)]

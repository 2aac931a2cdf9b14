"""Polygons filled with cells by gmsh."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from meshing.cells.planar import find_crossing, polygon_area
from meshing.gmsh_session import gmsh_session

# Quadrilaterals or triangles, and gmsh's algorithm (6 frontal, 5 Delaunay, 1 adaptive): needles between lines
# that meet at a few degrees may be too much for one of them.
_WAYS = ((True, 6), (False, 6), (False, 5), (False, 1))
_FLATTEST = 0.05  # smallest sine of a corner of an acceptable quadrilateral
# Growth of cells with the distance from a star: K and T of cracks 400 to 1600 times smaller than a plate are
# within 2e-5 with 0.7 and less, as with 0.45; 3e-4 with 0.8, 2e-2 with 1.
_GROWTH = 0.6


class Star(NamedTuple):
    """Edges around a point in all directions.

    Attributes
    ----------
    point : int
        By the numbers of the loops' points, then of the embedded ones.
    radius, edge : float
        Of its rim, m.
    """

    point: int
    radius: float
    edge: float


def fill_polygon(
    loops: Sequence[np.ndarray],
    embedded: np.ndarray,
    size: float,
    segments: Sequence[tuple[int, int]] = (),
    stars: Sequence[Star] = (),
) -> tuple[np.ndarray, list[list[int]]]:
    """Quadrilaterals and triangles inside a polygon; its sides are kept whole.

    Parameters
    ----------
    loops : sequence of (n, 2) array
        The outer loop, then the loops of holes, any direction, m.
    embedded : (n, 2) array
        Points inside that become vertices, m.
    size : float
        Largest edge length, m.
    segments : sequence of (int, int)
        Straight lines that become edges of cells; their ends by the numbers of the loops' points, then of
        the embedded ones.
    stars : sequence of Star
        Around them cells grow no faster than by 0.6 of their distance: gmsh spreads the lengths of the loops'
        edges alone, and cells 30 times as long as the edges of a small crack may stand beside it.

    Returns
    -------
    inner : (n, 2) array
        New vertices, m.
    cells : list of list of int
        Counter-clockwise; numbers count the loops' points, then the embedded ones, then the new ones.

    Raises
    ------
    RuntimeError
        The sides cross each other, or gmsh fails.
    """
    given = np.vstack([*loops, embedded.reshape(-1, 2)])
    inner_lines = np.array(segments, int).reshape(-1, 2)
    sides = [np.stack([loop, np.roll(loop, -1, axis=0)], axis=1) for loop in loops]
    crossing = find_crossing(np.vstack([*sides, given[inner_lines]]))
    if crossing is not None:
        raise RuntimeError(
            f"the outline of what is to be filled by gmsh crosses itself near ({crossing[0]:.6g}, "
            f"{crossing[1]:.6g}) m."
        )
    wanted = abs(polygon_area(loops[0])) - sum(abs(polygon_area(loop)) for loop in loops[1:])
    for quadrilaterals, algorithm in _WAYS:
        inner, cells, coordinates = _filled(
            (loops, embedded, inner_lines), size, stars, quadrilaterals=quadrilaterals, algorithm=algorithm
        )
        covered = sum(abs(polygon_area(np.array([coordinates[v] for v in cell]))) for cell in cells)
        if abs(covered - wanted) <= 1e-9 * wanted:
            return inner, [piece for cell in cells for piece in _sound_pieces(cell, coordinates)]
    raise RuntimeError(
        f"gmsh's cells around ({loops[0][:, 0].mean():.6g}, {loops[0][:, 1].mean():.6g}) m overlap or leave "
        "gaps, as they may where lines meet at a few degrees or pass close to each other; give a smaller "
        "size, or move the lines."
    )


def _filled(
    given: tuple[Sequence[np.ndarray], np.ndarray, np.ndarray],
    size: float,
    stars: Sequence[Star],
    *,
    quadrilaterals: bool,
    algorithm: int,
) -> tuple[np.ndarray, list[list[int]], dict[int, np.ndarray]]:
    """gmsh's cells: new vertices, the corners of the cells, and where the corners are."""
    loops, embedded, inner_lines = given
    points = np.vstack([*loops, embedded.reshape(-1, 2)])
    lengths = [np.hypot(*(np.roll(loop, -1, axis=0) - loop).T) for loop in loops]
    scale = max(np.ptp(loops[0], axis=0).max(), 1e-300)
    with gmsh_session("polygon") as gmsh:
        try:
            geometry = gmsh.model.geo
            point_tags, curve_loops = [], []
            for loop, length in zip(loops, lengths):
                # Unit scale: gmsh's tolerances are absolute.
                near = 0.5 * (length + np.roll(length, 1)) / scale
                tags = [geometry.addPoint(x / scale, y / scale, 0.0, h) for (x, y), h in zip(loop, near)]
                lines = [geometry.addLine(a, b) for a, b in zip(tags, tags[1:] + tags[:1])]
                for line in lines:
                    geometry.mesh.setTransfiniteCurve(line, 2)
                point_tags += tags
                curve_loops.append(geometry.addCurveLoop(lines))
            surface = geometry.addPlaneSurface(curve_loops)
            wanted_size = _lengths_at_ends(inner_lines, points, len(point_tags), size)
            inside = [
                geometry.addPoint(x / scale, y / scale, 0.0, h / scale)
                for (x, y), h in zip(embedded, wanted_size)
            ]
            tags_of = point_tags + inside
            lines = [geometry.addLine(tags_of[a], tags_of[b]) for a, b in inner_lines]
            for line in lines:
                geometry.mesh.setTransfiniteCurve(line, 2)
            geometry.synchronize()
            free = sorted(set(inside) - {tags_of[i] for i in inner_lines.ravel()})
            if free:
                gmsh.model.mesh.embed(0, free, 2, surface)
            if lines:
                gmsh.model.mesh.embed(1, lines, 2, surface)
            _grade(
                gmsh,
                [(tags_of[star.point], star.radius / scale, star.edge / scale) for star in stars],
                size / scale,
            )
            gmsh.option.setNumber("Mesh.MeshSizeMax", size / scale)
            gmsh.option.setNumber("Mesh.ElementOrder", 1)
            gmsh.option.setNumber("Mesh.Algorithm", algorithm)
            # Blossom's repositioning may fold the cells around embedded points over each other.
            gmsh.option.setNumber("Mesh.RecombinationAlgorithm", 0)
            if quadrilaterals:
                gmsh.model.mesh.setRecombine(2, surface)
            gmsh.model.mesh.generate(2)
            number = {}
            for position, tag in enumerate(point_tags + inside):
                number[int(gmsh.model.mesh.getNodes(0, tag)[0][0])] = position
            coordinates = dict(zip(number.values(), points))
            tags, positions, _ = gmsh.model.mesh.getNodes(2, surface)
            inner = positions.reshape(-1, 3)[:, :2] * scale
            for i, tag in enumerate(tags):
                number[int(tag)] = len(point_tags) + len(inside) + i
            coordinates.update(zip(range(len(coordinates), len(coordinates) + len(inner)), inner))
            cells = []
            for kind, _, nodes in zip(*gmsh.model.mesh.getElements(2, surface)):
                for corners in np.asarray(nodes).reshape(-1, 3 if kind == 2 else 4):
                    cells.append([number[int(tag)] for tag in corners])
        except Exception as error:
            raise RuntimeError(
                f"gmsh could not fill the polygon around ({loops[0][:, 0].mean():.6g}, "
                f"{loops[0][:, 1].mean():.6g}) m: {error}"
            ) from error
    return inner, cells, coordinates


def _grade(gmsh, stars: list[tuple[int, float, float]], largest: float) -> None:
    """Bound the cells' growth around points by their tags, with the radii and edges of their stars."""
    field, bounds = gmsh.model.mesh.field, []
    for tag, radius, edge in stars:
        distance, bound = field.add("Distance"), field.add("Threshold")
        field.setNumbers(distance, "PointsList", [tag])
        for name, value in {
            "InField": distance,
            "SizeMin": edge,
            "DistMin": radius,
            "SizeMax": largest,
            "DistMax": radius + max(largest - edge, 0.0) / _GROWTH,
        }.items():
            field.setNumber(bound, name, value)
        bounds.append(bound)
    if bounds:
        least = field.add("Min")
        field.setNumbers(least, "FieldsList", bounds)
        field.setAsBackgroundMesh(least)


def _lengths_at_ends(segments: np.ndarray, points: np.ndarray, first: int, size: float) -> np.ndarray:
    """Mean length of the segments that end in each point from number `first` on; `size` without any, m."""
    total, count = np.zeros(len(points)), np.zeros(len(points))
    lengths = np.hypot(*(points[segments[:, 1]] - points[segments[:, 0]]).T)
    for end in segments.T:
        np.add.at(total, end, lengths)
        np.add.at(count, end, 1)
    return np.where(count > 0, total / np.maximum(count, 1), size)[first:]


def _sound_pieces(cell: list[int], coordinates: dict[int, np.ndarray]) -> list[list[int]]:
    """The cell counter-clockwise; a quadrilateral that is not safely convex in two triangles."""
    points = np.array([coordinates[v] for v in cell])
    ahead, behind = np.roll(points, -1, axis=0) - points, np.roll(points, 1, axis=0) - points
    turns = (
        (ahead[:, 0] * behind[:, 1] - ahead[:, 1] * behind[:, 0]) / np.hypot(*ahead.T) / np.hypot(*behind.T)
    )
    if polygon_area(points) < 0:
        return _sound_pieces(cell[::-1], coordinates)
    if len(cell) == 3 or turns.min() > _FLATTEST:
        return [cell]
    worst = int(turns.argmin())
    a, b, c, d = (cell[(worst + i) % 4] for i in range(4))
    return [[a, b, c], [a, c, d]]

"""What a block's boxes leave over, as polygons for gmsh."""

from __future__ import annotations

import math

import numpy as np

from meshing.cells.beam_layout import Block
from meshing.cells.filling import fill_polygon
from meshing.cells.planar import polygon_area
from meshing.cells.skeleton import Skeleton, Star

_MESHER_OPENING = math.radians(3.0)
_FACE_GROWTH = 1.6


def fill_block(skeleton: Skeleton, block: Block, stars: list[Star]) -> None:
    """Mesh the remainder of a block by gmsh and add its cells."""
    cells = skeleton.cells
    for star in stars:
        others = [other.feature.outline for other in stars if other is not star]
        if star.feature.is_notch:
            _extend_faces(skeleton, star, others)
    wanted = {name: skeleton.inputs.points[name] for name in block.inner_points}
    fixed = [cells.vertices[v] for v in _perimeter(skeleton, block)] + list(wanted.values())
    fixed += [(x, y) for x in (block.low, block.high) for y in np.linspace(0, skeleton.beam.height, 101)]
    seen = _opened_coordinates(skeleton, stars, np.array(fixed))
    for loops in _remainder(skeleton, block, stars, seen):
        polygons = [np.array([seen[v] for v in loop]) for loop in loops]
        inside = [
            name
            for name, point in wanted.items()
            if _contains(polygons[0], point) and not any(_contains(hole, point) for hole in polygons[1:])
        ]
        embedded = np.array([wanted[name] for name in inside]).reshape(-1, 2)
        inner, pieces = fill_polygon(polygons, embedded, skeleton.edge_limit)
        numbers = [v for loop in loops for v in loop]
        for name in inside:
            cells.points[name] = cells.add_vertex(*wanted[name])
        numbers += [cells.points[name] for name in inside]
        numbers += [cells.add_vertex(*point) for point in inner]
        for piece in pieces:
            cells.add_cell([numbers[i] for i in piece])
    for name in wanted:
        if name not in cells.points:
            x, y = wanted[name]
            raise ValueError(
                f"point {name!r} at ({x:g}, {y:g}) m is too close to a notch tip or a hole to be a node of "
                "its own; move it away."
            )


def _extend_faces(skeleton: Skeleton, star: Star, others: list[np.ndarray]) -> None:
    """Edges of a notch's faces from the box to the mouth, at equal fractions of both faces; they grow no
    faster than the rings.
    """
    if star.face_fraction == 1.0:
        return
    beam, notch, cells = skeleton.beam, star.feature.notch, skeleton.cells
    tip = np.array(star.feature.centre)
    mouths = {
        offset: np.array([tip[0] + offset, beam.height]) for offset in (notch.left_offset, notch.right_offset)
    }
    length = max(math.dist(tip, mouth) for mouth in mouths.values())
    clear = _clearance(star.feature.outline, np.vstack(others)) if others else math.inf
    longest = min(skeleton.edge_limit, 1.5 * clear) / length
    growth = min(_FACE_GROWTH, skeleton.inputs.grading)
    step = star.face_fraction * (1.0 - 1.0 / star.ring_ratio)
    steps: list[float] = []
    while sum(steps) < (1.0 - star.face_fraction) * (1 - 1e-9):
        step = min(step * growth, longest)
        steps.append(step)
    fractions = star.face_fraction + (1.0 - star.face_fraction) * np.cumsum(steps) / sum(steps)
    for face, mouth in zip(
        (star.left, star.right), mouths.values() if len(mouths) == 2 else [*mouths.values()] * 2
    ):
        face += [cells.add_vertex(*(tip + fraction * (mouth - tip))) for fraction in fractions[:-1]]
        face.append(cells.add_vertex(*mouth))


def _clearance(first: np.ndarray, second: np.ndarray) -> float:
    """Smallest distance between two sets of points (n, 2); infinite if one is empty."""
    return float(np.hypot(*(first[:, None, :] - second[None, :, :]).T).min(initial=math.inf))


def _perimeter(skeleton: Skeleton, block: Block) -> list[int]:
    """Vertices on the sides of a block, without those of mouths."""
    height = skeleton.beam.height
    corners = [
        skeleton.vertex(x, y)
        for x, y in ((block.low, 0.0), (block.high, 0.0), (block.high, height), (block.low, height))
    ]
    return skeleton.chain(corners + corners[:1])[:-1]


def _opened_coordinates(
    skeleton: Skeleton, stars: list[Star], fixed: np.ndarray
) -> list[tuple[float, float]]:
    """Coordinates for gmsh: it cannot mesh along coincident faces, so it sees every notch opened by a few
    degrees.

    Only vertices on faces move, by a few per cent of the edges there and never far towards other features or
    the `fixed` points (n, 2); the cells get the true coordinates afterwards.
    """
    seen = list(skeleton.cells.vertices)
    for star in stars:
        if star.feature.is_notch:
            others = np.vstack([other.feature.outline for other in stars if other is not star] + [fixed])
            most = 0.2 * _clearance(star.feature.outline, others)
            tip_y, tilt = star.feature.centre[1], math.radians(star.feature.notch.tilt)
            for right, left in zip(star.right, star.left):
                (xr, yr), (xl, yl) = seen[right], seen[left]
                wanted = math.tan(_MESHER_OPENING / 2) * (yr - tip_y) / math.cos(tilt) ** 2
                shift = min(most, max(0.0, wanted - 0.5 * (xr - xl)))
                seen[right], seen[left] = (xr + shift, yr), (xl - shift, yl)
    return seen


def _remainder(
    skeleton: Skeleton, block: Block, stars: list[Star], seen: list[tuple[float, float]]
) -> list[list[list[int]]]:
    """Loops of vertices around what the boxes leave over: for each piece the outer loop and the loops of its
    holes.
    """
    beam, chain = skeleton.beam, skeleton.chain
    corners = [
        skeleton.vertex(x, y)
        for x, y in ((block.low, 0.0), (block.high, 0.0), (block.high, beam.height), (block.low, beam.height))
    ]
    paths = [chain(corners[:3])]
    position = corners[2]
    for star in sorted((s for s in stars if s.feature.is_notch), key=lambda s: -seen[s.right[-1]][0]):
        inside = star.right.index(star.vertices[-1])
        paths.append(chain([position, star.right[-1]]))
        paths.append(
            star.right[: inside - 1 if inside else None : -1] if inside < len(star.right) - 1 else []
        )
        paths.append(star.left[inside:])
        position = star.left[-1]
    paths.append(chain([position, corners[3], corners[0]]))
    for star in stars:
        if star.box is None:
            paths.append([*star.circle, star.circle[0]][::-1])
        elif star.feature.is_notch:
            paths.append(chain(star.vertices)[::-1])
        else:
            paths.append(chain([*star.vertices, star.vertices[0]])[::-1])
    edges = {edge for path in paths for edge in zip(path, path[1:])}
    edges = {(a, b) for a, b in edges if (b, a) not in edges}
    loops = _loops(edges, seen)
    areas = [polygon_area(np.array([seen[v] for v in loop])) for loop in loops]
    pieces = [[loop] for loop, area in zip(loops, areas) if area > 0]
    for loop, area in zip(loops, areas):
        if area < 0:
            home = next(
                piece for piece in pieces if _contains(np.array([seen[v] for v in piece[0]]), seen[loop[0]])
            )
            home.append(loop)
    return pieces


def _loops(edges: set[tuple[int, int]], seen: list[tuple[float, float]]) -> list[list[int]]:
    """Directed edges, material at their left, joined to loops that do not cross themselves."""
    leaving: dict[int, list[int]] = {}
    for a, b in sorted(edges):
        leaving.setdefault(a, []).append(b)

    def heading(a: int, b: int) -> float:
        return math.atan2(seen[b][1] - seen[a][1], seen[b][0] - seen[a][0])

    loops = []
    while leaving:
        first = next(iter(leaving))
        loop, here = [first], leaving[first].pop()
        while here != first:
            loop.append(here)
            came = heading(loop[-2], here)
            # Where pieces touch in a vertex the sharpest left turn stays in the piece.
            here_next = max(leaving[here], key=lambda b: (heading(here, b) - came + math.pi) % (2 * math.pi))
            leaving[here].remove(here_next)
            here = here_next
        loops.append(loop)
        leaving = {a: targets for a, targets in leaving.items() if targets}
    return loops


def _contains(polygon: np.ndarray, point: tuple[float, float]) -> bool:
    """Whether a point lies in a polygon (even-odd rule)."""
    x, y = point
    (x1, y1), (x2, y2) = polygon.T, np.roll(polygon, -1, axis=0).T
    across = (y1 > y) != (y2 > y)
    rise = np.where(across, y2 - y1, 1.0)
    return bool((across & (x < x1 + (y - y1) / rise * (x2 - x1))).sum() % 2)

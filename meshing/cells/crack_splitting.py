"""Cracks in a mesh of cells: rings around tips, kinks and junctions, faces divided, cells separated along
lines of edges.
"""

from __future__ import annotations

import math

import numpy as np

from meshing.cells.complex import Cell, CellComplex, CrackFaces, Edge, FacePath, TipCell, divided, edge_key
from meshing.cells.crack_lines import crack_lines
from meshing.cells.crack_meshing import CrackMeshing
from meshing.cells.crack_opening import open_cracks
from meshing.cells.face_division import divide_edges
from meshing.cells.splitting import split
from meshing.cells.vertex_rings import Rings

_DEFAULT_TIP = 0.02  # of a crack's length
_DEFAULT_IN_STAR = 0.03  # of the cells around the tip
_KINK = math.radians(20.0)  # from here on there are rings around a kink
_INNERMOST = 0.02  # level around a kink or junction, relative to the cells there
_NEAR_CUT = math.radians(30.0)  # from a cell's edge at a tip to the direction wanted
_AT_MOST = 0.5  # half-size of a tip's element, relative to the cells there


def add_cracks(cells: CellComplex, meshing: CrackMeshing, origin: str) -> None:
    """Make the cracks of the groups of a complex, in place.

    Parameters
    ----------
    cells : CellComplex
        A crack without branches runs from its tip; one with two tips or none as its first edge does.
    meshing : CrackMeshing
    origin : str
        For messages.

    Raises
    ------
    ValueError
        A line lies on the outline, two cracks share an edge, faces do not meet in a tip, an edge set or point
        has the name of a face; a crack cannot be opened.
    """
    cracks, outline = crack_lines(cells, origin)
    _refine(cells, cracks, outline, meshing)
    _divide(cells, cracks, meshing)
    sides = split(cells, [edge for path in _paths(cracks) if path.embedded for edge in path.right])
    for crack in cracks:
        _record(cells, crack, sides)
    _drop_missing(cells, origin)
    open_cracks(cells)


def _paths(cracks: list[CrackFaces]) -> list[FacePath]:
    return [path for crack in cracks for path in crack.paths]


def _refine(
    cells: CellComplex,
    cracks: list[CrackFaces],
    outline: set[int],
    meshing: CrackMeshing,
) -> None:
    """Rings around tips, junctions and sharp kinks; the lines get the new vertices."""
    rings = Rings(cells)
    near: dict[int, list[int]] = {}
    for a, b in [edge for path in _paths(cracks) for edge in path.right]:
        near.setdefault(a, []).append(b)
        near.setdefault(b, []).append(a)
    done: set[int] = set()
    for crack in cracks:
        crack.drawn = sum(_length(cells, path) for path in crack.paths)
        for path in crack.paths:
            _refuse_one_edge(cells, crack, path, meshing)
            right, left = path.right, path.left
            for tip, vertex, ends in (
                (path.start, right[0][0], (left[0][1], right[0][1])),
                (path.end, right[-1][1], (right[-1][0], left[-1][0])),
            ):
                if tip is None:
                    continue
                _describe(cells, tip, vertex, ends)
                if meshing.tip_element:
                    _put_tip(rings, crack, tip, vertex, ends, meshing)
                    done |= {vertex, *ends}
    for vertex, others in near.items():
        sharp = len(others) > 2 or (len(others) == 2 and _bend(cells, vertex, others) > _KINK)
        found = None
        if sharp and vertex not in outline and not done & {vertex, *others}:
            found = rings.fan(vertex, others[0], others[0])
        if found is not None:
            reach = max(math.dist(cells.vertices[vertex], cells.vertices[v]) for v in found.chain)
            innermost = _INNERMOST * reach
            rings.refine(vertex, others, found, innermost=innermost, grading=meshing.grading, tip=False)
            done |= {vertex, *others}
    _follow_lines(cells, cracks, rings)


def _refuse_one_edge(cells: CellComplex, crack: CrackFaces, path: FacePath, meshing: CrackMeshing) -> None:
    if meshing.tip_element and path.start and path.end and len(path.right) == 1:
        (x, y), (u, v) = (cells.vertices[vertex] for vertex in path.right[0])
        raise ValueError(
            f"{crack.where}: its line from ({x:.6g}, {y:.6g}) to ({u:.6g}, {v:.6g}) m is one edge of cells, "
            "which both tips would divide; give smaller cells there, or pass tip_element=False."
        )


def _follow_lines(cells: CellComplex, cracks: list[CrackFaces], rings: Rings) -> None:
    """Give edge sets and lines the vertices of rings; lines leave out ends that are scaling centres now."""
    for name, edges in cells.edge_sets.items():
        cells.edge_sets[name] = divided(edges, rings.inserted)
    for path in _paths(cracks):
        first, last = (int(tip is not None and tip.cell >= 0) for tip in (path.start, path.end))
        for face in ("right", "left"):
            edges = divided(getattr(path, face), rings.inserted)
            setattr(path, face, edges[first : len(edges) - last])


def _length(cells: CellComplex, path: FacePath) -> float:
    """Length of a line, between the two faces where these exist already, m."""
    if path.embedded or not path.joined:
        return sum(cells.edge_length(*edge) for edge in path.right)
    places = np.array(cells.vertices)
    right, left = (places[[face[0][0], *(b for _, b in face)]] for face in (path.right, path.left))
    return float(np.hypot(*np.diff(0.5 * (right + left), axis=0).T).sum())


def _describe(cells: CellComplex, tip: TipCell, vertex: int, ends: tuple[int, int]) -> None:
    """Position, axis and opening of a tip from the vertices next to it on the left and right face."""
    position = np.array(cells.vertices[vertex])
    left, right = (_tangent(cells, vertex, end) for end in ends)
    opening = math.atan2(right[0] * left[1] - right[1] * left[0], float(right @ left))
    # A closed crack's faces coincide; round-off must not open it.
    tip.opening = opening if abs(opening) > 1e-12 else 0.0
    axis = (left + right) / np.hypot(*(left + right))
    tip.position = (float(position[0]), float(position[1]))
    tip.axis = (float(axis[0]), float(axis[1]))


def _tangent(cells: CellComplex, first: int, second: int) -> np.ndarray:
    """Unit vector from a vertex along the edge to another."""
    curved = edge_key((first, second)) in cells.curves
    start, stop = cells.along((first, second), (0.0, 1e-6 if curved else 1.0))
    return (stop - start) / np.hypot(*(stop - start))


def _bend(cells: CellComplex, vertex: int, others: list[int]) -> float:
    one, other = (_tangent(cells, vertex, end) for end in others)
    return math.pi - math.acos(float(np.clip(one @ other, -1.0, 1.0)))


def _put_tip(
    rings: Rings,
    crack: CrackFaces,
    tip: TipCell,
    vertex: int,
    ends: tuple[int, int],
    meshing: CrackMeshing,
) -> None:
    found = rings.fan(vertex, *ends)
    if found is None:
        raise ValueError(
            f"{crack.where}: the cells around its tip do not go from one face round to the other; check that "
            "the tip is inside the material."
        )
    away = np.array([rings.cells.vertices[v] for v in found.chain]) - tip.position
    reach = float(np.hypot(*away.T).max())
    size = rings.cells.tip_sizes.get(vertex)
    if size is None and meshing.tip_size is not None and meshing.tip_size > _AT_MOST * reach:
        raise ValueError(
            f"{crack.where}: tip_size {meshing.tip_size:g} m does not fit in the cells around the tip, "
            f"which reach {reach:g} m; make it smaller."
        )
    wanted = size or meshing.tip_size or min(_DEFAULT_TIP * crack.drawn, _DEFAULT_IN_STAR * reach)
    if meshing.sectors:
        rings.merge(vertex, found, _cuts(tip.axis, away), innermost=wanted, grading=meshing.grading)
    else:
        tip.cell = rings.refine(vertex, ends, found, innermost=wanted, grading=meshing.grading, tip=True)


def _cuts(axis: tuple[float, float], away: np.ndarray) -> list[int]:
    """Where the cells that meet in a tip part: at the vertices of its fan nearest to the directions of the
    coordinate axes but for that of the crack's faces.

    Parameters
    ----------
    axis : (x, y)
        From the tip along the crack.
    away : (n, 2) array
        From the tip to the vertices of the fan, counter-clockwise from the left face, m.
    """
    angle = np.unwrap(np.arctan2(*away.T[::-1]))
    faces = 0.5 * math.pi * round(math.atan2(axis[1], axis[0]) / (0.5 * math.pi))
    cuts = [0]
    for wanted in faces + 0.5 * math.pi * np.arange(1, 4):
        wanted += 2 * math.pi * round((angle.mean() - faces - math.pi) / (2 * math.pi))
        nearest = int(np.abs(angle - wanted).argmin())
        if abs(angle[nearest] - wanted) < _NEAR_CUT and cuts[-1] < nearest < len(angle) - 1:
            cuts.append(nearest)
    return cuts[1:]


def _divide(cells: CellComplex, cracks: list[CrackFaces], meshing: CrackMeshing) -> None:
    """Divide the edges on the faces."""
    wanted: dict[Edge, np.ndarray] = {}
    for crack in cracks:
        longest = meshing.face_size or crack.drawn / meshing.face_edges
        for path in crack.paths:
            for pair in zip(path.right, path.left):
                length = max(cells.edge_length(*edge) for edge in pair)
                count = max(1, math.ceil(length / longest - 1e-6))
                wanted |= {edge: np.arange(1, count) / count for edge in pair if count > 1}
    inserted = divide_edges(cells, wanted)
    for path in _paths(cracks):
        path.right, path.left = (divided(face, inserted) for face in (path.right, path.left))


def _record(cells: CellComplex, crack: CrackFaces, sides: dict[Edge, tuple[Edge, Edge]]) -> None:
    """Faces, edge sets and mouth corners."""
    corners: list[tuple[int, int]] = []
    for path in crack.paths:
        if path.embedded:
            pairs = [sides[edge] for edge in path.right]
            path.right, path.left = ([pair[side] for pair in pairs] for side in (0, 1))
        if path.mouths[0]:
            corners.append((path.left[0][0], path.right[0][0]))
        if path.mouths[1]:
            corners.append((path.right[-1][1], path.left[-1][1]))
    cells.cracks.append(crack)
    cells.edge_sets[f"{crack.name}_right"] = [edge for path in crack.paths for edge in path.right]
    cells.edge_sets[f"{crack.name}_left"] = [edge for path in crack.paths for edge in path.left]
    if len(corners) == 1:
        cells.points[f"{crack.name}_right"], cells.points[f"{crack.name}_left"] = corners[0]


def _drop_missing(cells: CellComplex, origin: str) -> None:
    """Remove cells that were merged away; named items that went with them are an error."""
    number_of = {}
    kept: list[Cell] = []
    for number, cell in enumerate(cells.cells):
        if cell.vertices:
            number_of[number] = len(kept)
            kept.append(cell)
    cells.cells = kept
    for crack in cells.cracks:
        for path in crack.paths:
            for tip in (path.start, path.end):
                if tip is not None:
                    tip.cell = number_of.get(tip.cell, -1)
    uses = cells.edge_uses()
    present = {vertex for cell in kept for vertex in cell.vertices}
    cells.curves = {edge: curve for edge, curve in cells.curves.items() if edge in uses}
    for name, edges in cells.edge_sets.items():
        cells.edge_sets[name] = [edge for edge in edges if edge_key(edge) in uses]
        if not cells.edge_sets[name]:
            raise ValueError(
                f"{origin}: all edges of {name!r} lie inside the element around a crack tip; refine the mesh "
                "or pass tip_element=False."
            )
    for name, vertex in cells.points.items():
        if vertex not in present:
            raise ValueError(
                f"{origin}: point {name!r} is a crack tip, which carries no node with tip_element=True; pass "
                "tip_element=False."
            )

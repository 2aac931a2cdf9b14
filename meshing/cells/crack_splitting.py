"""Cracks in a mesh of cells: rings around tips, kinks and junctions, faces divided, cells separated along
lines of edges.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from meshing.cells.complex import CellComplex, CrackFaces, Edge, FacePath, TipCell, edge_key, neighbours
from meshing.cells.crack_lines import crack_lines
from meshing.cells.crack_opening import open_cracks
from meshing.cells.splitting import split
from meshing.cells.vertex_rings import Rings
from meshing.input_checks import flag, integer, length, number
from meshing.vectors import line_length, turn, unit
from meshing.warnings import warn

_DEFAULT_TIP = 0.02  # of a crack's length
_DEFAULT_IN_STAR = 0.03  # of the cells around the tip
_KINK = math.radians(20.0)  # from here on there are rings around a kink
_INNERMOST = 0.02  # level around a kink or junction, relative to the cells there
_NEAR_CUT = math.radians(30.0)  # from a cell's edge at a tip to the direction wanted
_AT_MOST = 0.5  # half-size of a tip's element, relative to the cells there


@dataclass(frozen=True)
class CrackMeshing:
    """How cracks are meshed.

    Attributes
    ----------
    tip_element : bool
        Rings around each tip with an open cell in their middle.
    tip_size : float or None
        Half-size of that cell, m; None: 0.02 of the crack's length, or
        0.03 of the reach of the cells around the tip if that is less.
    grading : float
        Largest ratio of neighbouring rings.
    face_size : float or None
        Longest edge on the faces, m; None: `face_edges` of them along the crack.
    face_edges : int
    sectors : bool
        No rings around tips but closed cells that meet in the tip.
    """

    tip_element: bool = True
    tip_size: float | None = None
    grading: float = 2.5
    face_size: float | None = None
    face_edges: int = 12
    sectors: bool = False

    @classmethod
    def checked(
        cls, extent: float, given: Mapping[str, Any], sectors: bool = False, least_tip: float = 1e-7
    ) -> CrackMeshing:
        """What is given of it among the arguments of a function that meshes, checked.

        Parameters
        ----------
        extent : float
            The body's size, m; 0 where it is not known yet.
        given : mapping of str to object
            Arguments by their names.
        least_tip : float
            Smallest `tip_size` relative to the body's size.
        """
        sizes: dict[str, float | None] = {"tip_size": None, "face_size": None}
        for name, least in (("tip_size", least_tip), ("face_size", 1e-6)):
            if given.get(name) is not None:
                sizes[name] = size = length("mesh", name, given[name])
                if size < least * extent:
                    raise ValueError(
                        f"mesh: {name} {size:g} m is below {least:g} of the body's size {extent:g} m, "
                        "round-off would show; make it larger."
                    )
        grading = number("mesh", "grading", given["grading"])
        if not 1.1 <= grading <= 10:
            raise ValueError(f"mesh: grading is {grading:g}, a ratio from 1.1 to 10 was expected.")
        tip_element = flag("mesh", "tip_element", given.get("tip_element", True))
        face_edges = integer("mesh", "face_edges", given.get("face_edges", 12), least=1, most=1000)
        return cls(tip_element, sizes["tip_size"], grading, sizes["face_size"], face_edges, sectors)


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
    _warn_of_lost_edges(cells, origin)
    sides = split(cells, [edge for path in _paths(cracks) if path.embedded for edge in path.right])
    for crack in cracks:
        _record(cells, crack, sides)
    _drop_missing(cells, origin)
    open_cracks(cells)


def _paths(cracks: list[CrackFaces]) -> list[FacePath]:
    return [path for crack in cracks for path in crack.paths]


def _refine(cells: CellComplex, cracks: list[CrackFaces], outline: set[int], meshing: CrackMeshing) -> None:
    """Rings around tips, junctions and sharp kinks; the lines get the new vertices."""
    rings = Rings(cells, meshing.grading)
    near = neighbours(edge for path in _paths(cracks) for edge in path.right)
    done: set[int] = set()
    for crack in cracks:
        crack.drawn = sum(_length(cells, path) for path in crack.paths)
        for path in crack.paths:
            _refuse_one_edge(cells, crack, path, meshing)
            right, left = path.faces
            for tip, vertex, ends in (
                (path.start, right[0][0], (left[0][1], right[0][1])),
                (path.end, right[-1][1], (right[-1][0], left[-1][0])),
            ):
                if tip is not None:
                    _describe(cells, tip, vertex, ends)
                    if meshing.tip_element:
                        _put_tip(rings, crack, tip, vertex, ends, meshing)
                        done |= {vertex, *ends}
    for vertex, others in near.items():
        if vertex in outline or done & {vertex, *others} or not _sharp(cells, vertex, others):
            continue
        found = rings.fan(vertex, others[0], others[0])
        if found is not None:
            rings.refine(found, others, _INNERMOST * found.reach, tip=False)
            done |= {vertex, *others}
    cells.divide_sets(rings.inserted)
    for path in _paths(cracks):
        path.divide(rings.inserted)
        # lines leave out ends that are scaling centres now
        first, last = (int(tip is not None and tip.cell >= 0) for tip in (path.start, path.end))
        path.right, path.left = (face[first : len(face) - last] for face in path.faces)


def _refuse_one_edge(cells: CellComplex, crack: CrackFaces, path: FacePath, meshing: CrackMeshing) -> None:
    if meshing.tip_element and len(path.tips) == 2 and len(path.right) == 1:
        (x, y), (u, v) = (cells.vertices[vertex] for vertex in path.right[0])
        raise ValueError(
            f"{crack.where}: its line from ({x:.6g}, {y:.6g}) to ({u:.6g}, {v:.6g}) m is one edge of cells, "
            "which both tips would divide; give smaller cells there, or pass tip_element=False."
        )


def _length(cells: CellComplex, path: FacePath) -> float:
    """Length of a line, between the two faces where these exist already, m."""
    if path.embedded or not path.joined:
        return sum(cells.edge_length(*edge) for edge in path.right)
    places = np.array(cells.vertices)
    right, left = (places[[face[0][0], *(b for _, b in face)]] for face in path.faces)
    return line_length(0.5 * (right + left))


def _describe(cells: CellComplex, tip: TipCell, vertex: int, ends: tuple[int, int]) -> None:
    """Position, axis and opening of a tip from the vertices next to it on the left and right face."""
    left, right = (_tangent(cells, vertex, end) for end in ends)
    opening = turn(right, left)
    # A closed crack's faces coincide; round-off must not open it.
    tip.opening = opening if abs(opening) > 1e-12 else 0.0
    tip.position = cells.vertices[vertex]
    x, y = unit(left + right).tolist()
    tip.axis = (x, y)


def _tangent(cells: CellComplex, first: int, second: int) -> np.ndarray:
    """Unit vector from a vertex along the edge to another."""
    curved = edge_key((first, second)) in cells.curves
    start, stop = cells.along((first, second), (0.0, 1e-6 if curved else 1.0))
    return unit(stop - start)


def _sharp(cells: CellComplex, vertex: int, others: list[int]) -> bool:
    """Whether lines meet or turn sharply in a vertex."""
    if len(others) != 2:
        return len(others) > 2
    one, other = (_tangent(cells, vertex, end) for end in others)
    return abs(turn(-one, other)) > _KINK


def _put_tip(
    rings: Rings, crack: CrackFaces, tip: TipCell, vertex: int, ends: tuple[int, int], meshing: CrackMeshing
) -> None:
    found = rings.fan(vertex, *ends)
    if found is None:
        raise ValueError(
            f"{crack.where}: the cells around its tip do not go from one face round to the other; check that "
            "the tip is inside the material."
        )
    size = rings.cells.tip_sizes.get(vertex)
    if size is None and meshing.tip_size is not None and meshing.tip_size > _AT_MOST * found.reach:
        raise ValueError(
            f"{crack.where}: tip_size {meshing.tip_size:g} m does not fit in the cells around the tip, "
            f"which reach {found.reach:g} m; make it smaller."
        )
    wanted = size or meshing.tip_size or min(_DEFAULT_TIP * crack.drawn, _DEFAULT_IN_STAR * found.reach)
    if meshing.sectors:
        rings.merge(found, _cuts(tip.axis, found.away), wanted)
    else:
        tip.cell = rings.refine(found, ends, wanted, tip=True)


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
    inserted = cells.divide(wanted)
    for path in _paths(cracks):
        path.divide(inserted)


def _warn_of_lost_edges(cells: CellComplex, origin: str) -> None:
    """Warn of edges of sets between cells that have been merged around tips."""
    uses = cells.edge_uses()
    for name, edges in cells.edge_sets.items():
        lost = sum(cells.edge_length(*edge) for edge in edges if edge_key(edge) not in uses)
        if lost:
            warn(
                origin,
                f"{lost:.3g} m of {name!r} lie inside the elements around crack tips, which have no edges "
                "there: what acts on it lacks them; pass a smaller tip_size, or tip_element=False.",
            )


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
    for name, faces in (("right", 0), ("left", 1)):
        cells.edge_sets[f"{crack.name}_{name}"] = [e for path in crack.paths for e in path.faces[faces]]
        if len(corners) == 1:
            cells.points[f"{crack.name}_{name}"] = corners[0][faces]


def _drop_missing(cells: CellComplex, origin: str) -> None:
    """Remove cells that were merged away; named items that went with them are an error."""
    kept = [number for number, cell in enumerate(cells.cells) if cell.vertices]
    number_of = {number: place for place, number in enumerate(kept)}
    cells.cells = [cells.cells[number] for number in kept]
    for path in _paths(cells.cracks):
        for tip in path.tips:
            tip.cell = number_of.get(tip.cell, -1)
    uses = cells.edge_uses()
    present = {vertex for edge in uses for vertex in edge}
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

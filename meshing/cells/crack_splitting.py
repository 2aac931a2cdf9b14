"""Cracks in a mesh of cells: rings around tips, kinks and junctions, faces divided, cells separated along
lines of edges, existing faces recognised.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from meshing.cells.complex import Cell, CellComplex, CrackFaces, FacePath, TipCell, edge_key
from meshing.cells.contact_faces import FRACTION_TOLERANCE
from meshing.cells.crack_meshing import CrackMeshing
from meshing.cells.face_division import divide_faces, with_inserted
from meshing.cells.face_matching import match_faces
from meshing.cells.splitting import split
from meshing.cells.vertex_rings import Rings

Edge = tuple[int, int]
_DEFAULT_TIP = 0.02  # of a crack's length
_DEFAULT_IN_STAR = 0.03  # of the cells around the tip
_KINK = math.radians(20.0)  # from here on there are rings around a kink
_INNERMOST = 0.02  # level around a kink or junction, relative to the cells there
_AT_MOST = 0.5  # half-size of a tip's element, relative to the cells there


@dataclass
class _Line:
    """An unbranched piece of a crack by the vertices of its faces; one list for both until they are split.

    From a tip where there is one, between faces that are `joined`; faces of two bodies are not. `start` and
    `end` are coordinates and edges' directions.
    """

    right: list[int]
    left: list[int]
    embedded: bool
    start: TipCell | None = None
    end: TipCell | None = None
    mouths: tuple[bool, bool] = (False, False)
    joined: bool = True


@dataclass
class _CrackLines:
    name: str
    where: str
    lines: list[_Line] = field(default_factory=list)


def add_cracks(cells: CellComplex, groups: dict[str, list[Edge]], meshing: CrackMeshing, origin: str) -> None:
    """Give the cells their cracks, in place.

    Parameters
    ----------
    cells : CellComplex
        Without these cracks; edge sets and points by its present vertices.
    groups : dict of str to list of (int, int)
        Edges of "crack:NAME" (lines inside the material, which may end inside, reach the outline, branch and
        cross each other), or "crack:NAME:right" and "crack:NAME:left" (existing faces that share a tip, or
        faces of two bodies that face each other). A crack without branches runs from its tip; one with two
        tips or none as its first edge does.
    meshing : CrackMeshing
    origin : str
        For messages.

    Raises
    ------
    ValueError
        A line lies on the outline, two cracks share an edge, faces do not meet in a tip, an edge set or point
        has the name of a face.
    """
    cracks = []
    uses = cells.edge_uses()
    outline = {vertex for edge, count in uses.items() if count == 1 for vertex in edge}
    owner: dict[Edge, str] = {}
    for name, parts in _named_parts(groups, {*cells.edge_sets, *cells.points}, origin).items():
        crack = _CrackLines(name, f"{origin}: crack {name!r}")
        if "" in parts:
            edges = list(dict.fromkeys(edge_key(edge) for edge in parts[""]))
            for edge in edges:
                if uses[edge] != 2:
                    raise ValueError(
                        f"{crack.where}: part of its line lies on the outline, a line inside the material "
                        f"was expected; name existing faces crack:{name}:right and crack:{name}:left."
                    )
                if edge in owner:
                    x, y = cells.vertices[edge[0]]
                    raise ValueError(
                        f"{crack.where}: it shares the line near ({x:.6g}, {y:.6g}) m with crack "
                        f"{owner[edge]!r}; a piece of line belongs to one crack."
                    )
                owner[edge] = name
            crack.lines = [_Line(path, path, True) for path in _paths(parts[""])]
        else:
            crack.lines = [_recognise(cells, name, parts["right"], parts["left"], crack.where)]
        cracks.append(crack)
    degree: dict[int, int] = {}
    for edge in owner:
        for vertex in edge:
            degree[vertex] = degree.get(vertex, 0) + 1
    for crack in cracks:
        for line in crack.lines:
            _orient(line, degree, outline)
    _refine(cells, cracks, degree, outline, meshing)
    _divide(cells, cracks, meshing)
    lines = [edge for crack in cracks for line in crack.lines if line.embedded for edge in _edges(line.right)]
    sides = split(cells, lines)
    for crack in cracks:
        _record(cells, crack, sides)
    _drop_missing(cells, origin)


def _edges(path: Sequence[int]) -> list[Edge]:
    return list(zip(path, path[1:]))


def _named_parts(
    groups: dict[str, list[Edge]], taken: set[str], origin: str
) -> dict[str, dict[str, list[Edge]]]:
    cracks: dict[str, dict[str, list[Edge]]] = {}
    for group, edges in groups.items():
        _, name, *sides = group.split(":")
        side = sides[0] if sides else ""
        if not name or side not in ("", "right", "left") or not edges:
            raise ValueError(
                f"{origin}: physical curve {group!r} is empty or misnamed; crack:NAME, crack:NAME:right and "
                "crack:NAME:left are known."
            )
        cracks.setdefault(name, {})[side] = edges
    for name, parts in cracks.items():
        for face in (f"{name}_right", f"{name}_left"):
            if face in taken:
                raise ValueError(
                    f"{origin}: the name {face!r} is that of a face of crack {name!r} and is given to "
                    "something else too; choose another."
                )
        if set(parts) not in ({""}, {"right", "left"}):
            raise ValueError(
                f"{origin}: crack {name!r} has the parts {sorted(parts)}; "
                f"give either crack:{name} alone or both crack:{name}:right and crack:{name}:left."
            )
    return cracks


def _paths(edges: list[Edge]) -> list[list[int]]:
    """Unbranched chains that a set of edges falls into; the first edge's direction is kept where it can."""
    at: dict[int, list[int]] = {}
    for a, b in edges:
        at.setdefault(a, []).append(b)
        at.setdefault(b, []).append(a)
    at = {vertex: list(dict.fromkeys(near)) for vertex, near in at.items()}
    left_over = dict.fromkeys(edge_key(edge) for edge in edges)
    paths = []
    while left_over:
        # From an end or a branching point if any is left, else around a loop.
        first = next(
            (e for a, b in left_over for e in ((a, b), (b, a)) if len(at[e[0]]) != 2), next(iter(left_over))
        )
        path = list(first)
        del left_over[edge_key(first)]
        while len(at[path[-1]]) == 2:
            following = next((v for v in at[path[-1]] if edge_key((path[-1], v)) in left_over), None)
            if following is None:
                break
            del left_over[edge_key((path[-1], following))]
            path.append(following)
        paths.append(path)
    given = set(edges)
    return [
        path if sum(edge in given for edge in _edges(path)) * 2 >= len(path) - 1 else path[::-1]
        for path in paths
    ]


def _recognise(cells: CellComplex, name: str, right: list[Edge], left: list[Edge], where: str) -> _Line:
    """Two existing faces: of a notch, whose tip is the end they share, or of two bodies that share none;
    which is the right one of a notch follows from the cells.
    """
    paths = []
    for side, edges in (("right", right), ("left", left)):
        found = _paths(edges)
        if len(found) != 1 or found[0][0] == found[0][-1]:
            raise ValueError(
                f"{where}, {side} face: its edges do not form one line without branches; give one connected "
                "chain of curves."
            )
        paths.append(found[0])
    shared = {paths[0][0], paths[0][-1]} & {paths[1][0], paths[1][-1]}
    common = set(paths[0]) & set(paths[1])
    if len(shared) > 1 or common != shared:
        raise ValueError(
            f"{where}: its two faces share {len(common)} nodes; those of a notch share one end (the tip), "
            "those of two bodies none, not even where they touch."
        )
    if shared:
        tip = shared.pop()
        paths = [path if path[0] == tip else path[::-1] for path in paths]
    directed = {edge for cell in cells.cells for edge in cell.edges()}
    # Outwards along the left face the material is at the left.
    outwards = [[edge in directed for edge in _edges(path)] for path in paths]
    inwards = [[edge[::-1] in directed for edge in _edges(path)] for path in paths]
    if any(o and i for out, back in zip(outwards, inwards) for o, i in zip(out, back)):
        raise ValueError(
            f"{where}: its faces have cells on both sides; name an embedded line crack:{name} to have it "
            "split."
        )
    sides = [(all(out), all(back)) for out, back in zip(outwards, inwards)]
    if not all(out != back for out, back in sides):
        raise ValueError(f"{where}: its faces do not lie on the outline of the material.")
    if not common:
        # along the left face the material is at the left, along the right one at the right
        one, other = (path if side[k] else path[::-1] for path, side, k in zip(paths, sides, (1, 0)))
        return _Line(*match_faces(cells, one, other, where), False, joined=False)
    if sides[0][0] == sides[1][0]:
        raise ValueError(f"{where}: its faces do not lie on the outline of the material.")
    if sides[0][0]:
        paths.reverse()
    _check_match(cells, paths[0], paths[1], where)
    return _Line(paths[0], paths[1], False)


def _check_match(cells: CellComplex, right: list[int], left: list[int], where: str) -> None:
    """Two faces must have vertices at equal fractions of their lengths."""
    if len(right) != len(left):
        raise ValueError(
            f"{where}: the faces do not match, {len(right) - 1} edges on the right face and {len(left) - 1} "
            "on the left; divide both into edges of equal fractions of their lengths."
        )
    fractions = []
    for path in (right, left):
        along = np.cumsum([0.0, *(cells.edge_length(*edge) for edge in _edges(path))])
        fractions.append(along / along[-1])
    worst = int(np.abs(fractions[0] - fractions[1]).argmax())
    if abs(fractions[0][worst] - fractions[1][worst]) > FRACTION_TOLERANCE:
        raise ValueError(
            f"{where}: the faces do not match, node {worst} from the tip lies at {fractions[0][worst]:.6g} "
            f"of the right face and at {fractions[1][worst]:.6g} of the left one; divide both into edges of "
            "equal fractions of their lengths."
        )


def _orient(line: _Line, degree: dict[int, int], outline: set[int]) -> None:
    """Let a line run from its tip if it has one; mark tips and mouths."""
    if not line.joined:
        return
    if not line.embedded:
        line.start, line.mouths = TipCell((0.0, 0.0), (0.0, 0.0)), (False, True)
        return
    free = [degree[end] == 1 and end not in outline for end in (line.right[0], line.right[-1])]
    if free == [False, True]:
        line.right = line.left = line.right[::-1]
        free.reverse()
    line.start, line.end = (TipCell((0.0, 0.0), (0.0, 0.0)) if tip else None for tip in free)
    line.mouths = (line.right[0] in outline, line.right[-1] in outline)


def _refine(
    cells: CellComplex,
    cracks: list[_CrackLines],
    degree: dict[int, int],
    outline: set[int],
    meshing: CrackMeshing,
) -> None:
    """Rings around tips, junctions and sharp kinks; the lines get the new vertices."""
    rings = Rings(cells)
    near: dict[int, list[int]] = {}
    for crack in cracks:
        for line in crack.lines:
            if line.embedded:
                for a, b in _edges(line.right):
                    near.setdefault(a, []).append(b)
                    near.setdefault(b, []).append(a)
    done: set[int] = set()
    for crack in cracks:
        length = sum(cells.edge_length(*edge) for line in crack.lines for edge in _edges(line.right))
        for line in crack.lines:
            for tip, vertex, ends in (
                (line.start, line.right[0], (line.left[1], line.right[1])),
                (line.end, line.right[-1], (line.right[-2], line.left[-2])),
            ):
                if tip is None:
                    continue
                _describe(cells, tip, vertex, ends)
                if meshing.tip_element:
                    _put_tip(cells, rings, crack, tip, vertex, ends, length, meshing)
                    done |= {vertex, *ends}
    for vertex, others in near.items():
        sharp = len(others) > 2 or (len(others) == 2 and _bend(cells, vertex, others) > _KINK)
        if not sharp or vertex in outline or done & {vertex, *others}:
            continue
        found = rings.fan(vertex, others[0], others[0])
        if found is None:
            continue
        reach = max(math.dist(cells.vertices[vertex], cells.vertices[v]) for v in found[0])
        rings.refine(vertex, others, *found, innermost=_INNERMOST * reach, grading=meshing.grading, tip=False)
        done |= {vertex, *others}
    for name, edges in cells.edge_sets.items():
        chains = [with_inserted(edge, rings.inserted) for edge in edges]
        cells.edge_sets[name] = [part for chain in chains for part in _edges(chain)]
    for crack in cracks:
        for line in crack.lines:
            tips = [tip is not None and tip.cell >= 0 for tip in (line.start, line.end)]
            # Without the ends that have become scaling centres.
            line.right, line.left = (
                with_inserted(path, rings.inserted)[int(tips[0]) : None if not tips[1] else -1]
                for path in (line.right, line.left)
            )


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
    curve = cells.curve(first, second)
    start, stop = (
        (np.array(cells.vertices[first]), np.array(cells.vertices[second]))
        if curve is None
        else curve(np.array([0.0, 1e-6]))
    )
    return (stop - start) / np.hypot(*(stop - start))


def _bend(cells: CellComplex, vertex: int, others: list[int]) -> float:
    one, other = (_tangent(cells, vertex, end) for end in others)
    return math.pi - math.acos(float(np.clip(one @ other, -1.0, 1.0)))


def _put_tip(
    cells: CellComplex,
    rings: Rings,
    crack: _CrackLines,
    tip: TipCell,
    vertex: int,
    ends: tuple[int, int],
    length: float,
    meshing: CrackMeshing,
) -> None:
    found = rings.fan(vertex, *ends)
    if found is None:
        raise ValueError(
            f"{crack.where}: the cells around its tip do not go from one face round to the other; check that "
            "the tip is inside the material."
        )
    chain, members = found
    reach = max(math.dist(tip.position, cells.vertices[v]) for v in chain)
    if meshing.tip_size is not None and meshing.tip_size > _AT_MOST * reach:
        raise ValueError(
            f"{crack.where}: tip_size {meshing.tip_size:g} m does not fit in the cells around the tip, "
            f"which reach {reach:g} m; make it smaller."
        )
    wanted = meshing.tip_size or min(_DEFAULT_TIP * length, _DEFAULT_IN_STAR * reach)
    tip.cell = rings.refine(vertex, ends, chain, members, innermost=wanted, grading=meshing.grading, tip=True)


def _divide(cells: CellComplex, cracks: list[_CrackLines], meshing: CrackMeshing) -> None:
    """Divide the edges on the faces."""
    wanted, counts = [], []
    for crack in cracks:
        lengths = [[cells.edge_length(*edge) for edge in _edges(line.right)] for line in crack.lines]
        longest = meshing.face_size or sum(map(sum, lengths)) / meshing.face_edges
        for line, along in zip(crack.lines, lengths):
            for places in zip(_edges(line.right), _edges(line.left), along):
                wanted.append([edge for edge in dict.fromkeys(places[:2])])
                counts.append(max(1, math.ceil(places[2] / longest - 1e-6)))
    inserted = divide_faces(cells, wanted, counts)
    for crack in cracks:
        for line in crack.lines:
            line.right, line.left = (with_inserted(path, inserted) for path in (line.right, line.left))


def _record(cells: CellComplex, crack: _CrackLines, sides: dict[Edge, tuple[Edge, Edge]]) -> None:
    """Faces, edge sets and mouth corners."""
    paths = []
    corners: list[tuple[int, int]] = []
    for line in crack.lines:
        if line.embedded:
            pairs = [sides[edge] for edge in _edges(line.right)]
            right, left = ([pair[side] for pair in pairs] for side in (0, 1))
        else:
            right, left = _edges(line.right), _edges(line.left)
        paths.append(FacePath(right, left, line.start, line.end))
        if line.mouths[0]:
            corners.append((left[0][0], right[0][0]))
        if line.mouths[1]:
            corners.append((right[-1][1], left[-1][1]))
    cells.cracks.append(CrackFaces(crack.name, paths))
    cells.edge_sets[f"{crack.name}_right"] = [edge for path in paths for edge in path.right]
    cells.edge_sets[f"{crack.name}_left"] = [edge for path in paths for edge in path.left]
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

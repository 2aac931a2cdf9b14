"""Cracks as lines through a mesh of cells: named groups of edges put in order, existing faces recognised.

"crack:NAME" is a line inside the material, which may end inside, reach the outline, branch and cross others;
"crack:NAME:opening=DEGREES" the same with faces that stand apart by this angle at the mouth;
"crack:NAME:right" and "crack:NAME:left" are existing faces that share a tip, or faces of two bodies that face
each other.
"""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Mapping
from itertools import pairwise

import numpy as np

from meshing.cells.complex import CellComplex, CrackFaces, Edge, FacePath, TipCell, edge_key, neighbours
from meshing.cells.contact_faces import FRACTION_TOLERANCE
from meshing.cells.face_matching import match_faces
from meshing.shapes.features import WIDEST_OPENING

_GROUP = re.compile(r"crack:([^:]+)(?::(right|left)|:opening=([^:]+))?")


def crack_lines(cells: CellComplex, origin: str) -> tuple[list[CrackFaces], set[int]]:
    """The lines of each crack in a complex' groups, from their tips where they have one, and the vertices of
    the outline; see `crack_splitting.add_cracks`.
    """
    cracks = []
    uses = cells.edge_uses()
    outline = {vertex for edge, count in uses.items() if count == 1 for vertex in edge}
    owner: dict[Edge, str] = {}
    for name, (parts, opening) in _named_parts(cells, origin).items():
        crack = CrackFaces(name, f"{origin}: crack {name!r}", opening=opening)
        if "" in parts:
            for edge in dict.fromkeys(map(edge_key, parts[""])):
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
            crack.paths = [FacePath(line, line) for line in ([*pairwise(line)] for line in _paths(parts[""]))]
        else:
            crack.paths = [_recognise(cells, name, parts["right"], parts["left"], crack.where)]
        cracks.append(crack)
    degree = Counter(vertex for edge in owner for vertex in edge)
    for crack in cracks:
        for path in crack.paths:
            _orient(path, degree, outline)
    return cracks, outline


def _named_parts(cells: CellComplex, origin: str) -> dict[str, tuple[dict[str, list[Edge]], float]]:
    """Edges of each crack by their side, "" for both, and its opening, degrees."""
    cracks: dict[str, tuple[dict[str, list[Edge]], float]] = {}
    for group, edges in cells.groups.items():
        found = _GROUP.fullmatch(group)
        if not found or not edges:
            raise ValueError(
                f"{origin}: physical curve {group!r} is empty or misnamed; crack:NAME, "
                "crack:NAME:opening=DEGREES, crack:NAME:right and crack:NAME:left are known."
            )
        name, side, opening = found[1], found[2] or "", _degrees(found[3] or "0")
        if not 0.0 <= opening <= WIDEST_OPENING:
            raise ValueError(
                f"{origin}: physical curve {group!r} gives its crack the opening {found[3]}, 0 to "
                f"{WIDEST_OPENING:g} degrees were expected; draw a wider notch by its faces."
            )
        parts, known = cracks.get(name, ({}, 0.0))
        cracks[name] = parts | {side: parts.get(side, []) + edges}, max(known, opening)
    for name, (parts, _) in cracks.items():
        for face in (f"{name}_right", f"{name}_left"):
            if face in cells.edge_sets or face in cells.points:
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


def _degrees(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return math.nan


def _paths(edges: list[Edge]) -> list[list[int]]:
    """Unbranched chains that a set of edges falls into; the first edge's direction is kept where it can."""
    at = {vertex: list(dict.fromkeys(near)) for vertex, near in neighbours(edges).items()}
    left_over = dict.fromkeys(map(edge_key, edges))
    paths: list[list[int]] = []
    given = set(edges)
    while left_over:
        # From an end or a branching point if any is left, else around a loop.
        ends = (e for a, b in left_over for e in ((a, b), (b, a)) if len(at[e[0]]) != 2)
        first, last = next(ends, next(iter(left_over)))
        path, ahead = [first], [last]
        while ahead:
            del left_over[edge_key((path[-1], ahead[0]))]
            path.append(ahead[0])
            near = at[path[-1]]
            ahead = [v for v in near if len(near) == 2 and edge_key((path[-1], v)) in left_over]
        forward = sum(edge in given for edge in pairwise(path)) * 2 >= len(path) - 1
        paths.append(path if forward else path[::-1])
    return paths


def _recognise(cells: CellComplex, name: str, right: list[Edge], left: list[Edge], where: str) -> FacePath:
    """Two existing faces: of a notch, whose tip is the end they share, or of two bodies that share none;
    which is the right one of a notch follows from the cells.
    """
    paths = _faces(right, left, where)
    outwards = _outwards(cells, paths, name, where)
    if not set(paths[0]) & set(paths[1]):
        # along the left face the material is at the left, along the right one at the right
        one = paths[0][::-1] if outwards[0] else paths[0]
        other = paths[1] if outwards[1] else paths[1][::-1]
        one, other = match_faces(cells, one, other, where)
        return FacePath([*pairwise(one)], [*pairwise(other)], embedded=False, joined=False)
    if outwards[0] == outwards[1]:
        raise ValueError(f"{where}: its faces do not lie on the outline of the material.")
    if outwards[0]:
        paths.reverse()
    _check_match(cells, paths[0], paths[1], where)
    return FacePath([*pairwise(paths[0])], [*pairwise(paths[1])], embedded=False)


def _faces(right: list[Edge], left: list[Edge], where: str) -> list[list[int]]:
    """Vertices of the two faces in order, from the tip if they share one."""
    paths: list[list[int]] = []
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
    return paths


def _outwards(cells: CellComplex, paths: list[list[int]], name: str, where: str) -> list[bool]:
    """Whether the material is at the left of somebody who walks along each face."""
    directed = {edge for cell in cells.cells for edge in cell.edges()}
    uses = [[((a, b) in directed, (b, a) in directed) for a, b in pairwise(path)] for path in paths]
    if any(all(use) for face in uses for use in face):
        raise ValueError(
            f"{where}: its faces have cells on both sides; name an embedded line crack:{name} to have it "
            "split."
        )
    if any(len(set(face)) > 1 or not any(face[0]) for face in uses):
        raise ValueError(f"{where}: its faces do not lie on the outline of the material.")
    return [face[0][0] for face in uses]


def _check_match(cells: CellComplex, right: list[int], left: list[int], where: str) -> None:
    """Two faces must have vertices at equal fractions of their lengths."""
    if len(right) != len(left):
        raise ValueError(
            f"{where}: the faces do not match, {len(right) - 1} edges on the right face and {len(left) - 1} "
            "on the left; divide both into edges of equal fractions of their lengths."
        )
    fractions = []
    for path in (right, left):
        along = np.cumsum([0.0, *(cells.edge_length(*edge) for edge in pairwise(path))])
        fractions.append(along / along[-1])
    worst = int(np.abs(fractions[0] - fractions[1]).argmax())
    if abs(fractions[0][worst] - fractions[1][worst]) > FRACTION_TOLERANCE:
        raise ValueError(
            f"{where}: the faces do not match, node {worst} from the tip lies at {fractions[0][worst]:.6g} "
            f"of the right face and at {fractions[1][worst]:.6g} of the left one; divide both into edges of "
            "equal fractions of their lengths."
        )


def _orient(path: FacePath, degree: Mapping[int, int], outline: set[int]) -> None:
    """Let a line run from its tip if it has one; mark tips and mouths."""
    if not path.joined:
        return
    if not path.embedded:
        path.start, path.mouths = TipCell(), (False, True)
        return
    ends = [path.right[0][0], path.right[-1][1]]
    free = [degree[end] == 1 and end not in outline for end in ends]
    if free == [False, True]:
        path.right = path.left = [(b, a) for a, b in path.right[::-1]]
        free.reverse()
        ends.reverse()
    path.start, path.end = (TipCell() if tip else None for tip in free)
    path.mouths = (ends[0] in outline, ends[1] in outline)

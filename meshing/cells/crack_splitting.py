"""Cracks in a mesh of cells: faces split along a line of edges, existing faces recognised, cells around a tip
merged to one star.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from meshing.cells.complex import CellComplex, CrackFaces, Curve, edge_key

Edge = tuple[int, int]


@dataclass
class _Line:
    """A crack by vertices of the faces, from the tip to the mouth."""

    name: str
    right: list[int]
    left: list[int]


def add_cracks(cells: CellComplex, groups: dict[str, list[Edge]], tip_element: bool, origin: str) -> None:
    """Give the cells their cracks, in place.

    Parameters
    ----------
    cells : CellComplex
        Without cracks; edge sets and points by its present vertices.
    groups : dict of str to list of (int, int)
        Edges of "crack:NAME", or "crack:NAME:right" and "crack:NAME:left".
    tip_element : bool
        Merge the cells around each tip into an open cell.
    origin : str
        For messages.

    Raises
    ------
    ValueError
        A crack line is not a chain from the inside to the outline, or the faces do not meet in a tip.
    """
    before = [list(cell.vertices) for cell in cells.cells]
    uses = cells.edge_uses()
    lines = []
    for name, parts in _named_parts(groups, origin).items():
        where = f"{origin}: crack {name!r}"
        if "" in parts:
            lines.append(_split(cells, name, parts[""], uses, where))
        else:
            lines.append(_recognise(cells, name, parts["right"], parts["left"], where))
    _carry_over(cells, before)
    for line in lines:
        _record(cells, line, tip_element, f"{origin}: crack {line.name!r}")
    _drop_missing(cells, origin)


def _named_parts(groups: dict[str, list[Edge]], origin: str) -> dict[str, dict[str, list[Edge]]]:
    cracks: dict[str, dict[str, list[Edge]]] = {}
    for group, edges in groups.items():
        _, name, *side = group.split(":")
        side = side[0] if side else ""
        if not name or side not in ("", "right", "left") or not edges:
            raise ValueError(
                f"{origin}: physical curve {group!r} is empty or misnamed; crack:NAME, crack:NAME:right and "
                "crack:NAME:left are known."
            )
        cracks.setdefault(name, {})[side] = edges
    for name, parts in cracks.items():
        if set(parts) not in ({""}, {"right", "left"}):
            raise ValueError(
                f"{origin}: crack {name!r} has the parts {sorted(parts)}; "
                f"give either crack:{name} alone or both crack:{name}:right and crack:{name}:left."
            )
    return cracks


def _path(edges: list[Edge], where: str) -> list[int]:
    """Vertices of a chain of edges from one end to the other."""
    at: dict[int, list[int]] = {}
    for a, b in edges:
        at.setdefault(a, []).append(b)
        at.setdefault(b, []).append(a)
    ends = [vertex for vertex, near in at.items() if len(near) == 1]
    if len(ends) != 2 or any(len(near) > 2 for near in at.values()):
        raise ValueError(
            f"{where}: its edges do not form one line without branches; give one connected chain of curves."
        )
    path = [ends[0]]
    while len(path) <= len(edges):
        following = [v for v in at[path[-1]] if len(path) < 2 or v != path[-2]]
        if not following:
            raise ValueError(
                f"{where}: its edges do not form one line without branches; give one connected chain of "
                "curves."
            )
        path.append(following[0])
    return path


def _split(cells: CellComplex, name: str, edges: list[Edge], uses: dict[Edge, int], where: str) -> _Line:
    """Separate the cells at the two sides of an embedded line: those at its right get vertices of their
    own.
    """
    if any(uses[edge] != 2 for edge in edges):
        raise ValueError(
            f"{where}: part of its line lies on the outline, a line inside the material was expected; "
            f"name existing faces crack:{name}:right and crack:{name}:left."
        )
    outline = {vertex for edge, count in uses.items() if count == 1 for vertex in edge}
    path = _path(edges, where)
    inside = [end for end in (path[0], path[-1]) if end not in outline]
    if len(inside) != 1:
        what = "both ends inside the material" if inside else "both ends on the outline"
        raise ValueError(
            f"{where}: its line has {what}; one end (the tip) must be inside, the other (the mouth) on the "
            "outline."
        )
    if path[0] != inside[0]:
        path.reverse()
    if any(vertex in outline for vertex in path[1:-1]):
        raise ValueError(
            f"{where}: its line touches the outline or another crack between tip and mouth; end it where it "
            "meets the outline."
        )
    around: dict[int, list[int]] = {vertex: [] for vertex in path[1:]}
    for number, cell in enumerate(cells.cells):
        for vertex in cell.vertices:
            if vertex in around:
                around[vertex].append(number)
    duplicate: dict[int, int] = {}
    moves: list[tuple[int, int]] = []
    for vertex, previous, following in zip(path[1:], path, path[2:] + [-1]):
        right = _fan(cells, around[vertex], vertex, {previous, following}, start=previous)
        if len(right) == len(around[vertex]):
            raise ValueError(
                f"{where}: its line does not separate the cells at its mouth; end it on the outline."
            )
        moves += [(number, vertex) for number in right]
        duplicate[vertex] = cells.add_vertex(*cells.vertices[vertex])
    for number, vertex in moves:
        loop = cells.cells[number].vertices
        loop[loop.index(vertex)] = duplicate[vertex]
    return _Line(name, path[:1] + [duplicate[vertex] for vertex in path[1:]], path)


def _fan(cells: CellComplex, around: list[int], vertex: int, walls: set[int], start: int) -> set[int]:
    """Cells around a vertex at the right of the line from `start` to it, up to the walls or the outline."""
    fan, front = set(), []
    for number in around:
        loop = cells.cells[number].vertices
        if (
            loop[(loop.index(vertex) + 1) % len(loop)] == start
        ):  # runs back along the line: it lies at its right
            front.append(number)
    neighbours = {}
    for number in around:
        loop = cells.cells[number].vertices
        i = loop.index(vertex)
        neighbours[number] = {loop[i - 1], loop[(i + 1) % len(loop)]} - walls
    while front:
        number = front.pop()
        fan.add(number)
        front += [other for other in around if other not in fan and neighbours[number] & neighbours[other]]
    return fan


def _recognise(cells: CellComplex, name: str, right: list[Edge], left: list[Edge], where: str) -> _Line:
    """Two existing faces: the tip is the end they share; which is the right one follows from the cells."""
    paths = [_path(right, f"{where}, right face"), _path(left, f"{where}, left face")]
    shared = {paths[0][0], paths[0][-1]} & {paths[1][0], paths[1][-1]}
    if len(shared) != 1:
        raise ValueError(f"{where}: its two faces share {len(shared)} end nodes, one (the tip) was expected.")
    tip = shared.pop()
    paths = [path if path[0] == tip else path[::-1] for path in paths]
    directed = {edge for cell in cells.cells for edge in cell.edges()}
    # Outwards along the left face the material is at the left.
    outwards = [[(a, b) in directed for a, b in zip(path, path[1:])] for path in paths]
    inwards = [[(b, a) in directed for a, b in zip(path, path[1:])] for path in paths]
    if any(o and i for out, back in zip(outwards, inwards) for o, i in zip(out, back)):
        raise ValueError(
            f"{where}: its faces have cells on both sides; name an embedded line crack:{name} to have it "
            "split."
        )
    if all(outwards[1]) and all(inwards[0]):
        return _Line(name, paths[0], paths[1])
    if all(outwards[0]) and all(inwards[1]):
        return _Line(name, paths[1], paths[0])
    raise ValueError(f"{where}: its faces do not lie on the outline of the material.")


def _carry_over(cells: CellComplex, before: list[list[int]]) -> None:
    """Sets and curved edges after vertices have been duplicated."""
    now: dict[Edge, dict[Edge, bool]] = {}
    for cell, loop in zip(cells.cells, before):
        for old, new in zip(zip(loop, loop[1:] + loop[:1]), cell.edges()):
            turned = (old == edge_key(old)) != (new == edge_key(new))
            now.setdefault(edge_key(old), {})[edge_key(new)] = turned
    cells.edge_sets = {
        name: [new for old in edges for new in now[old]] for name, edges in cells.edge_sets.items()
    }
    cells.curves = {
        new: _reversed_curve(curve) if turned else curve
        for old, curve in cells.curves.items()
        for new, turned in now[old].items()
    }


def _reversed_curve(curve: Curve) -> Curve:
    return lambda at: curve(1.0 - np.asarray(at))


def _record(cells: CellComplex, line: _Line, tip_element: bool, where: str) -> None:
    tip, right_mouth, left_mouth = (
        np.array(cells.vertices[v]) for v in (line.right[0], line.right[-1], line.left[-1])
    )
    chords = [(mouth - tip) / np.hypot(*(mouth - tip)) for mouth in (right_mouth, left_mouth)]
    axis = (chords[0] + chords[1]) / np.hypot(*(chords[0] + chords[1]))
    first = [np.array(cells.vertices[face[1]]) - tip for face in (line.right, line.left)]
    opening = math.atan2(first[0][0] * first[1][1] - first[0][1] * first[1][0], float(first[0] @ first[1]))
    length = float(0.5 * (right_mouth + left_mouth - 2 * tip) @ axis)
    right, left = (list(zip(face, face[1:])) for face in (line.right, line.left))
    tip_cell = -1
    if tip_element:
        if len(right) < 2 or len(left) < 2:
            raise ValueError(
                f"{where}: its faces have a single edge, which the element around the tip takes up; refine "
                "the mesh there."
            )
        if any(edge_key(face[0]) in cells.curves for face in (right, left)):
            raise ValueError(
                f"{where}: its faces are curved at the tip, where the element needs straight ones; pass "
                "tip_element=False or straighten them."
            )
        tip_cell = _merge_around_tip(cells, line, where)
        right, left = right[1:], left[1:]
    # A closed crack's faces coincide; round-off must not open it.
    opening = opening if abs(opening) > 1e-12 else 0.0
    cells.cracks.append(
        CrackFaces(
            line.name, tuple(map(float, tip)), tuple(map(float, axis)), opening, length, right, left, tip_cell
        )
    )
    for side, face in (("right", line.right), ("left", line.left)):
        cells.edge_sets[f"{line.name}_{side}"] = right if side == "right" else left
        cells.points[f"{line.name}_{side}"] = face[-1]


def _merge_around_tip(cells: CellComplex, line: _Line, where: str) -> int:
    """Replace the cells around a tip by one open cell; it takes the place of one of them, so that the numbers
    of the others stay.
    """
    tip = line.left[0]
    fan = {}
    for number, cell in enumerate(cells.cells):
        if tip in cell.vertices and cell.closed:
            i = cell.vertices.index(tip)
            ordered = cell.vertices[i + 1 :] + cell.vertices[:i]
            fan[ordered[0]] = (number, ordered)
    chain, members = [line.left[1]], []
    while chain[-1] in fan and len(members) < len(fan):
        number, ordered = fan[chain[-1]]
        members.append(number)
        chain += ordered[1:]
    if chain[-1] != line.right[1] or len(members) != len(fan):
        raise ValueError(
            f"{where}: the cells around its tip do not go from one face round to the other; check that the "
            "tip is inside the material."
        )
    materials = {cells.cells[number].material for number in members}
    if len(materials) > 1:
        raise ValueError(
            f"{where}: its tip lies between different materials, the element around it can have only one; "
            "pass tip_element=False."
        )
    kept = cells.cells[members[0]]
    kept.vertices, kept.closed, kept.centre = chain, False, cells.vertices[tip]
    for number in members[1:]:
        cells.cells[number].vertices = []
    return members[0]


def _drop_missing(cells: CellComplex, origin: str) -> None:
    """Remove cells that were merged away; named items that went with them are an error."""
    number_of = {}
    kept = []
    for number, cell in enumerate(cells.cells):
        if cell.vertices:
            number_of[number] = len(kept)
            kept.append(cell)
    cells.cells = kept
    for crack in cells.cracks:
        crack.tip_cell = number_of.get(crack.tip_cell, -1)
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

"""Cracks that start open: faces moved apart, the cells around them follow."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
import shapely
from scipy import sparse
from scipy.sparse import csgraph
from scipy.sparse.linalg import spsolve

from meshing.cells.complex import CellComplex, CrackFaces, FacePath, TipCell, edge_key


def open_cracks(cells: CellComplex) -> None:
    """Move the faces of closed cracks apart by their `opening`, in place.

    Raises
    ------
    ValueError
        A crack without a tip, or one that branches or meets another one, is to be open; the faces run into
        other cells.
    """
    moved: dict[int, np.ndarray] = {}
    for faces in cells.cracks:
        if faces.opening:
            _add_moves(cells, faces, math.radians(faces.opening), moved)
    if not moved:
        return
    _follow(cells, moved)
    for cell in cells.cells:
        polygon = shapely.Polygon([cells.vertices[v] for v in cell.vertices])
        if cell.closed and not (polygon.is_valid and polygon.exterior.is_ccw):
            widest = max(faces.opening for faces in cells.cracks)
            x, y = np.mean([cells.vertices[v] for v in cell.vertices], axis=0)
            raise ValueError(
                f"crack opening: the faces of a crack that opens by up to {widest:g} degrees run into the "
                f"cells near ({x:.6g}, {y:.6g}) m; draw so wide a notch as part of the outline."
            )


def _add_moves(cells: CellComplex, faces: CrackFaces, angle: float, moved: dict[int, np.ndarray]) -> None:
    """Moves of the vertices on a crack's faces, and what it says of its length and opening."""
    path, start = _path_to_open(cells, faces)
    rights, lefts = ([face[0][0], *(edge[1] for edge in face)] for face in path.faces)
    line = np.array([cells.vertices[v] for v in rights])
    steps = np.diff(line, axis=0)
    length = math.dist(start.position, line[0]) + np.concatenate([[0.0], np.cumsum(np.hypot(*steps.T))])
    arc = length
    faces.length = float(arc[-1])  # that of the closed line
    if path.end is not None:
        faces.length += math.dist(path.end.position, line[-1])
        arc = np.minimum(arc, arc[-1] + math.dist(path.end.position, line[-1]) - arc)
    unit = steps / np.hypot(*steps.T)[:, None]
    for side, sign in ((rights, 1.0), (lefts, -1.0)):
        mouth = None
        if path.end is None:
            mouth = _along_edge(cells, side[-1], sign * arc[-1], unit[-1], angle)
        moves = _moves_of_face(sign * math.tan(angle / 2) * arc, length, unit, mouth)
        moved.update(zip(side, moves))
    for tip in path.tips:
        tip.opening = angle


def _path_to_open(cells: CellComplex, faces: CrackFaces) -> tuple[FacePath, TipCell]:
    """The only path of a crack's faces, and the tip from which it opens.

    Raises
    ------
    ValueError
        It has no tip or several paths, or meets another crack.
    """
    opening = f"crack {faces.name!r}: opening is {faces.opening:g} degrees"
    path = faces.paths[0] if len(faces.paths) == 1 else None
    if path is None or path.start is None:
        raise ValueError(f"{opening}, but it has no tip to open from; give 0.")
    foreign = [piece for crack in cells.cracks if crack is not faces for piece in crack.paths]
    others = {vertex for piece in foreign for face in piece.faces for edge in face for vertex in edge}
    for face in path.faces:
        broken = [a[1] for a, b in zip(face, face[1:]) if a[1] != b[0]]
        for vertex in [*broken, *(v for edge in face for v in edge if v in others)]:
            x, y = cells.vertices[vertex]
            raise ValueError(
                f"{opening}, but it meets a crack at ({x:.6g}, {y:.6g}) m; cracks that meet start closed, "
                "give 0."
            )
    return path, path.start


def _moves_of_face(
    shifts: np.ndarray, length: np.ndarray, unit: np.ndarray, mouth: np.ndarray | None
) -> np.ndarray:
    """Moves of the vertices of one face, (n, 2).

    Parameters
    ----------
    shifts : (n,) array
        Along the normal, m.
    length : (n,) array
        Way from the tip, m.
    unit : (n - 1, 2) array
        Directions of the edges.
    mouth : (2,) array, optional
        Move of the last vertex where it is not along the normal, m.
    """
    normal = np.stack([unit[:, 1], -unit[:, 0]], axis=1)
    turned = np.flatnonzero((normal[1:] * normal[:-1]).sum(axis=1) < 1 - 1e-12) + 1
    corners = [0, *turned.tolist(), len(shifts) - 1]
    # On the bisector of a kink, so that both sides keep their distance; at a mouth along the edge.
    at = {
        k: shifts[k] * (normal[k - 1] + normal[k]) / (1.0 + normal[k - 1] @ normal[k]) for k in corners[1:-1]
    }
    at |= {0: shifts[0] * normal[0], corners[-1]: shifts[-1] * normal[-1] if mouth is None else mouth}
    moves = np.zeros((len(shifts), 2))
    for first, last in zip(corners, corners[1:]):
        # Along the line more and more from a tip, so that nothing is passed by what moves beside a kink.
        low, high = (0.0 if first == 0 else length[first]), length[last]
        start, stop = (at[k] - shifts[k] * normal[first] for k in (first, last))
        part = slice(first, last + 1)
        share = (length[part, None] - low) / (high - low)
        moves[part] = shifts[part, None] * normal[first] + (1.0 - share) * start + share * stop
    return moves


def _along_edge(
    cells: CellComplex, vertex: int, length: float, direction: np.ndarray, angle: float
) -> np.ndarray:
    """Shift of a mouth's corner along the outline to where the opened face meets it."""
    faces = {edge_key(e) for crack in cells.cracks for p in crack.paths for face in p.faces for e in face}
    uses = cells.edge_uses()
    other = next(
        (a if b == vertex else b)
        for (a, b), count in uses.items()
        if count == 1 and vertex in (a, b) and (a, b) not in faces
    )
    here, there = np.array(cells.vertices[vertex]), np.array(cells.vertices[other])
    along = (there - here) / math.dist(there, here)
    turned = -math.copysign(angle / 2, length)
    cos, sin = math.cos(turned), math.sin(turned)
    face = np.array([[cos, -sin], [sin, cos]]) @ direction
    # The face through the point opposite, turned by half the angle: here - |length| direction + s face =
    # here + t along.
    t, _ = np.linalg.solve(np.stack([along, -face], axis=1), -abs(length) * direction)
    return t * along


def _follow(cells: CellComplex, moved: Mapping[int, np.ndarray]) -> None:
    """Move the other vertices inside by the mean of their neighbours' moves; the outline and named points
    stay.
    """
    uses, places = cells.edge_uses(), np.array(cells.vertices)
    first, second = np.array(list(uses)).T
    # Rings around a tip stretch with its faces: neighbours count by the inverse of their distance.
    weight = 1.0 / np.hypot(*(places[first] - places[second]).T)
    graph = sparse.coo_matrix((weight, (first, second)), (len(places), len(places)))
    laplace = csgraph.laplacian((graph + graph.T).tocsr()).tocsr()
    held = np.zeros(len(places), bool)
    held[[*cells.points.values(), *moved, *(v for edge, n in uses.items() if n == 1 for v in edge)]] = True
    shift = np.zeros(places.shape)
    shift[list(moved)] = list(moved.values())
    free = np.flatnonzero(~held & (laplace.diagonal() > 0))
    if len(free):
        shift[free] = spsolve(laplace[free][:, free].tocsc(), -laplace[free] @ shift)
    cells.vertices[:] = [(float(x), float(y)) for x, y in places + shift]

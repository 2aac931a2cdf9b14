"""Contact pairs: nodes beside each other on the two faces of a crack, their normals, gaps and lengths."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import fields, replace

import numpy as np

from meshing.cells.complex import CrackFaces, FacePath
from meshing.gll import gll_nodes, lagrange_slopes, lagrange_values
from meshing.mesh_arrays import ContactPairs
from meshing.vectors import turn

FRACTION_TOLERANCE = 1e-6
# Faces that turn by more in one node (degrees) get a pair for each side of it.
SHARP_KINK = 10.0

EdgeNodes = Callable[[tuple[int, int]], np.ndarray]


def crack_pairs(
    faces: CrackFaces, edge_nodes: EdgeNodes, nodes: np.ndarray, crack: int
) -> tuple[ContactPairs, float]:
    """Pairs of all lines of a crack, and its length; its tips are told their `arc`.

    Parameters
    ----------
    faces : CrackFaces
    edge_nodes : callable
        Nodes of a directed edge of cells, (p + 1,).
    nodes : (n_nodes, 2) array
        m.
    crack : int
        Index of the crack.

    Returns
    -------
    ContactPairs
        Line by line in the order of their first tips, and from these; a node that both faces share (a tip) is
        left out.
    length : float
        m.

    Raises
    ------
    ValueError
        The faces overlap.
    """
    parts, arc = [], 0.0
    for path in sorted(faces.paths, key=_first_tip):
        pairs, arc = _path_pairs(path, edge_nodes, nodes, crack, arc, faces.where)
        parts += pairs
    joined = join_pairs(parts)
    length = arc if faces.length is None else faces.length
    for tip in (tip for path in faces.paths for tip in path.tips):
        tip.arc = (tip.arc[0] / arc * length, tip.arc[1] / arc * length)
    fraction = joined.arc / arc
    return replace(joined, position=fraction, arc=fraction * length), length


def _first_tip(path: FacePath) -> tuple[float, float]:
    return min((tip.position for tip in path.tips), default=(math.inf, math.inf))


def _path_pairs(
    path: FacePath, edge_nodes: EdgeNodes, nodes: np.ndarray, crack: int, arc: float, where: str
) -> tuple[list[ContactPairs], float]:
    """Pairs of one line from its first tip, which has the arc coordinate given, and that at its other end."""
    right, left = (np.array([edge_nodes(edge) for edge in face]) for face in path.faces)
    inside = [
        0.5 * sum(math.dist(tip.position, nodes[face[i, j]]) for face in (right, left)) if tip else 0.0
        for tip, i, j in ((path.start, 0, 0), (path.end, -1, -1))
    ]
    along = [_distances(face, nodes) for face in (right, left)]
    from_start = inside[0] + 0.5 * (along[0] + along[1])
    extent = float(from_start[-1, -1])
    end = arc + extent + inside[1]
    backwards = path.end is not None and path.end.position == _first_tip(path)
    places = end - from_start if backwards else arc + from_start
    first, last = (path.end, path.start) if backwards else (path.start, path.end)
    if first is not None:
        first.arc = (arc, arc + inside[backwards])
    if last is not None:
        last.arc = (end, end - inside[not backwards])
    normals = _nodal_normals(nodes[right], nodes[left])
    parts, order = [], right.shape[1] - 1
    for run in _runs(right, left, nodes):
        one, other, at = (
            np.concatenate([table[run, :-1].ravel(), table[run[-1], -1:]]) for table in (right, left, places)
        )
        summed = np.zeros((len(one), 2))
        np.add.at(summed, order * np.arange(len(run))[:, None] + np.arange(order + 1), normals[run])
        normal, weight = _unit(summed, path)
        gap = np.einsum("ij,ij->i", normal, nodes[one] - nodes[other])
        separate = one != other
        _refuse_overlap(gap[separate], extent, path, where)
        # Faces of a closed crack coincide to round-off; a gap below that is no gap.
        gap = np.where(gap < 1e-12 * extent, 0.0, gap)
        pairs = np.stack([one, other], axis=1)
        found = ContactPairs(pairs, normal, gap, np.full(len(one), crack), at, at, weight)
        parts.append(chosen(found, separate))
    if backwards:
        parts = [chosen(pairs, np.arange(len(pairs))[::-1]) for pairs in reversed(parts)]
    return parts, end


def _unit(summed: np.ndarray, path: FacePath) -> tuple[np.ndarray, np.ndarray]:
    """Normals of length one and their weights; free of round-off along a straight crack."""
    weight = np.hypot(*summed.T)
    normal = summed / weight[:, None]
    if path.start is not None:
        straight = np.array([path.start.axis[1], -path.start.axis[0]])
        if np.abs(normal - straight).max() < 1e-9:
            normal = np.tile(straight, (len(normal), 1))
    return normal, weight


def _refuse_overlap(gap: np.ndarray, extent: float, path: FacePath, where: str) -> None:
    if gap.size and gap.min() < -1e-9 * extent:
        mend = "the two bodies may touch each other at most."
        if path.start:
            mend = "the right face must lie at the right hand of the left one, seen from the tip."
        raise ValueError(f"{where}: the faces overlap by {-gap.min():.3g} m; {mend}")


def _distances(face: np.ndarray, nodes: np.ndarray) -> np.ndarray:
    """Distance along the face, (edges, p + 1), of the nodes of its edges from its start."""
    steps = np.hypot(*np.moveaxis(np.diff(nodes[face], axis=1), -1, 0))
    inside = np.concatenate([np.zeros((len(face), 1)), np.cumsum(steps, axis=1)], axis=1)
    before = np.concatenate([[0.0], np.cumsum(inside[:, -1])[:-1]])
    return before[:, None] + inside


def _nodal_normals(right: np.ndarray, left: np.ndarray) -> np.ndarray:
    """Integral of each shape function times the normal along the mean of the two faces, (edges, p + 1, 2), m.

    The normal halves the angle between the faces. These are the nodal forces of a unit pressure.
    """
    order = right.shape[1] - 1
    at, weight = np.polynomial.legendre.leggauss(order + 2)
    values, slopes = (evaluate(gll_nodes(order), at) for evaluate in (lagrange_values, lagrange_slopes))
    tangents = [np.einsum("qn,eni->eqi", slopes, face) for face in (right, left)]
    lengths = [np.hypot(tangent[..., 0], tangent[..., 1])[..., None] for tangent in tangents]
    mean = tangents[0] / lengths[0] + tangents[1] / lengths[1]
    mean *= 0.5 * (lengths[0] + lengths[1]) / np.hypot(mean[..., 0], mean[..., 1])[..., None]
    normal = np.stack([mean[..., 1], -mean[..., 0]], axis=-1)
    return np.einsum("q,qn,eqi->eni", weight, values, normal)


def _runs(right: np.ndarray, left: np.ndarray, nodes: np.ndarray) -> list[list[int]]:
    """Edges between junctions and sharp kinks."""
    chords = nodes[right[:, -1]] - nodes[right[:, 0]] + nodes[left[:, -1]] - nodes[left[:, 0]]
    ends = [nodes[right[:, 1]] - nodes[right[:, 0]], nodes[right[:, -1]] - nodes[right[:, -2]]]
    runs = [[0]]
    for edge in range(1, len(right)):
        broken = right[edge, 0] != right[edge - 1, -1] or left[edge, 0] != left[edge - 1, -1]
        # Both the chords and the edges' ends turn: a coarse smooth bend is none.
        turns = min(abs(turn(chords[edge - 1], chords[edge])), abs(turn(ends[1][edge - 1], ends[0][edge])))
        if broken or turns > math.radians(SHARP_KINK):
            runs.append([])
        runs[-1].append(edge)
    return runs


def chosen(pairs: ContactPairs, rows: np.ndarray) -> ContactPairs:
    """Some of the pairs."""
    return ContactPairs(*(getattr(pairs, item.name)[rows] for item in fields(pairs)))


def join_pairs(parts: list[ContactPairs]) -> ContactPairs:
    """Pairs of several cracks one after the other."""
    pairs, row, number = np.zeros((0, 2)), np.zeros(0), np.zeros(0, int)
    none = ContactPairs(pairs.astype(int), pairs, row, number, row, row, row)
    columns = ([getattr(part, item.name) for part in (none, *parts)] for item in fields(none))
    return ContactPairs(*map(np.concatenate, columns))


def without_doubles(pairs: ContactPairs) -> ContactPairs:
    """Pairs of the same two nodes and nearly the same normal made one: where a line closes on itself, and
    where one crack goes on from another's end.
    """
    seen: dict[tuple[int, int], list[int]] = {}
    # the same sides may be right and left of one line and left and right of the next
    turned = np.where(pairs.nodes[:, :1] < pairs.nodes[:, 1:], 1.0, -1.0)
    normal, weight = turned * pairs.normal, pairs.weight.copy()
    kept = []
    for row, nodes in enumerate(np.sort(pairs.nodes, axis=1).tolist()):
        known = seen.setdefault((nodes[0], nodes[1]), [])
        first = next((k for k in known if abs(turn(normal[k], normal[row])) < math.radians(SHARP_KINK)), -1)
        if first < 0:
            known.append(row)
            kept.append(row)
            continue
        summed = weight[first] * normal[first] + weight[row] * normal[row]
        normal[first], weight[first] = summed / np.hypot(*summed), weight[first] + weight[row]
    if len(kept) == len(pairs):
        return pairs
    return chosen(replace(pairs, normal=turned * normal, weight=weight), np.array(kept))

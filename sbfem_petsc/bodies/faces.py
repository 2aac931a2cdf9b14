"""How the nodes of two faces meet: partners along a normal, or places between the other's nodes; gaps."""

from __future__ import annotations

import inspect
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from scipy import sparse

from ..checks import real, real_array, shown
from ..contact.law import ContactLaw, Unilateral
from .rows import Contact
from .units import tree_of

# Distance of partners in spacings of nodes; a row that is none, for a force of any size would press on it;
# weights that are none.
APART, ROUNDING, LITTLE = 1e-3, 1e-9, 1e-13
# How far beside a face, in sides of its elements, a node is still before it: straight sides miss .07 of their
# length of a circle of twelve.
BESIDE = 0.1
# Triangles between the nodes of a face, by their number; steps to a place in it, at most.
HATS = {
    1: ((0,),),
    3: ((0, 1, 2),),
    4: ((0, 1, 2), (0, 2, 3)),
    6: ((0, 3, 5), (3, 1, 4), (5, 4, 2), (3, 4, 5)),
}
HATS[8] = ((0, 4, 7), (1, 5, 4), (2, 6, 5), (3, 7, 6), (4, 5, 6), (4, 6, 7))
NEWTON = 60
# Nodes of a face, corners first, in its own coordinates, and the terms of its shape functions.
REFERENCE = {
    3: 0.5 * np.array([[0, 0], [2, 0], [0, 2], [1, 0], [1, 1], [0, 1]]),
    4: 0.5 * np.array([[0, 0], [2, 0], [2, 2], [0, 2], [1, 0], [2, 1], [1, 2], [0, 1]]),
}
TERMS = np.array([[0, 0], [1, 0], [0, 1], [1, 1], [2, 0], [0, 2], [2, 1], [1, 2]])
Faces = list[list[int]]


def partners(left: list[int], x: np.ndarray, y: np.ndarray, normal: np.ndarray) -> sparse.csr_matrix:
    """(left, right): 1 for the right node that faces each left one along the normal."""
    flat = np.eye(3) - np.outer(normal, normal)
    x, y = x @ flat, y @ flat
    far, nearest = tree_of(y).query(x)
    size = np.ptp(x, axis=0).max() if len(x) == 1 else np.median(tree_of(x).query(x, 2)[0][:, 1])
    away = far > APART * size + 1e-12
    if away.any():
        raise ValueError(
            f"contact: {away.sum()} of {len(left)} left nodes have no partner (node {left[away.argmax()]} is "
            f"{far[away.argmax()]:g} m off); if the faces' meshes do not match, say matching=False"
        )
    if len(set(nearest)) < len(left):
        raise ValueError("contact: two left nodes share a right one; the faces' meshes must match")
    return sparse.csr_matrix((np.ones(len(x)), (np.arange(len(x)), nearest)), (len(x), len(y)))


def between(
    places: tuple[np.ndarray, np.ndarray],
    normal: np.ndarray,
    faces: tuple[Faces, Faces],
    moves: np.ndarray,
) -> tuple[sparse.csr_matrix, sparse.csr_matrix]:
    """(left, left) and (left, right): means of displacements before each other about left nodes.

    Weights are hat functions, linear on triangles between the left nodes, over what is common to both faces,
    so that a constant or linear pressure has on each side the forces that its elements give it. Nodes of
    no face, as on a line, are points. Rows of nodes that have nothing before them are empty.

    Parameters
    ----------
    places : (left, 3), (right, 3) arrays
    normal : (3,) array
    faces : pair of lists of lists of int
        Nodes by their places in these arrays, corners first; without any, triangles that fill the nodes'
        convex hull.
    moves : (left,) array of bool
        Nodes that come apart; hats of others, such as a crack's front, are shared out to their neighbours.
    """
    along = np.linalg.svd(normal[None])[2][1:].T
    x, y = (part @ along for part in places)
    own, other = (given or _hull(part) for given, part in zip(faces, (x, y)))
    other = [face for face in other if _across(places[1][face[: _corners(face)]], normal)]
    if not other:
        raise ValueError(
            f"contact: the {len(y)} right nodes span no surface across the normal; give those of a face"
        )
    own = own + [[int(k)] for k in np.setdiff1d(np.arange(len(x)), [k for face in own for k in face])]
    none = np.zeros(1, dtype=int)
    entries = [[(none, none, np.zeros(1))] for _ in (x, y)]
    for nodes, *cells, points, weights in _common((x, y), own, other):
        kept, hats = moves[nodes], (weights[:, None] * _shapes(x[nodes], points)).T
        hats = hats[kept] + hats[~kept].sum(axis=0) / max(kept.sum(), 1)
        for part, cell, at in zip(entries, cells, (x, y)):
            rows, columns = np.meshgrid(np.array(nodes)[kept], cell, indexing="ij")
            part.append((rows.ravel(), columns.ravel(), (hats @ _shapes(at[cell], points)).ravel()))
    one, two = (
        sparse.csr_matrix((values, (rows, columns)), (len(x), len(at)))
        for (rows, columns, values), at in zip((map(np.concatenate, zip(*part)) for part in entries), (x, y))
    )
    shared = np.asarray(one.sum(axis=1)).ravel()
    for part in (one, two):
        part.data /= np.repeat(np.where(shared > 0.0, shared, 1.0), np.diff(part.indptr))
        part.data[np.abs(part.data) <= LITTLE] = 0.0
        part.eliminate_zeros()
    return one, two


def _common(
    places: tuple[np.ndarray, np.ndarray], own: Faces, other: Faces
) -> Iterator[tuple[list[int], list[int], list[int], np.ndarray, np.ndarray]]:
    """Nodes of a hat, its face, the other's face, points of what is common to them, and their weights."""
    import shapely

    x, y = places
    areas = shapely.area(right := [shapely.Polygon(y[face[: _corners(face)]]) for face in other])
    across = np.flatnonzero(areas > ROUNDING * areas.max(initial=0.0))
    near, tree = APART * np.sqrt(areas[across].min()), shapely.STRtree([right[k] for k in across])
    for face in own:
        for nodes in ([face[k] for k in hat] for hat in HATS[len(face)]):
            hat = shapely.Polygon(x[nodes]) if len(nodes) == 3 else shapely.Point(x[nodes]).buffer(near)
            found = across[tree.query(hat, predicate="intersects")]
            parts = [right[k].intersection(hat) for k in found]
            if sum(part.area for part in parts) > (1.0 + APART) * hat.area:
                raise ValueError("contact: right nodes lie behind each other; give those of one face")
            commons = [(k, part) for k, part in zip(found, parts) if part.area > ROUNDING * hat.area]
            if len(nodes) == 1 and not commons:
                point = shapely.Point(x[nodes[0]])
                k = across[tree.nearest(point)]
                line = shapely.shortest_line(right[k], point)
                if line.length < BESIDE * np.sqrt(areas[k]):
                    yield nodes, face, other[k], shapely.get_coordinates(line)[:1], np.ones(1)
            for k, common in commons:
                points, weights = _quadrature(shapely.get_coordinates(common)[:-1])
                if len(nodes) == 1:
                    points, weights = x[nodes], weights.sum(keepdims=True)
                yield nodes, face, other[k], points, weights


def _across(corners: np.ndarray, normal: np.ndarray) -> bool:
    """Whether a face, however small, lies across the normal, not along it."""
    from_first = corners[1:] - corners[0]
    area = np.cross(from_first[:-1], from_first[1:]).sum(axis=0)
    return bool(abs(area @ normal) > APART * np.linalg.norm(area))


def _hull(places: np.ndarray) -> Faces:
    """Triangles between nodes that fill their convex hull; none of nodes on a line."""
    from scipy.spatial import Delaunay, QhullError

    try:
        return Delaunay(places).simplices.tolist()
    except (QhullError, ValueError):
        return []


def _corners(face: Sequence[Any] | np.ndarray) -> int:
    return 3 if len(face) in (3, 6) else 4


def _quadrature(polygon: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Points and weights in a convex polygon, exact to the fourth degree."""
    at, weight = np.polynomial.legendre.leggauss(3)
    u, v = (grid.ravel() for grid in np.meshgrid((1.0 + at) / 2.0, (1.0 + at) / 2.0))
    shares = np.stack([1.0 - u, u * (1.0 - v), u * v], axis=1)
    weights = np.outer(weight, weight).ravel() * u / 4.0
    fans = np.stack([np.broadcast_to(polygon[0], polygon[2:].shape), polygon[1:-1], polygon[2:]], axis=1)
    areas = np.abs(np.linalg.det(fans[:, 1:] - fans[:, :1]))
    return (shares @ fans).reshape(-1, 2), np.outer(areas, weights).ravel()


def _shapes(nodes: np.ndarray, points: np.ndarray) -> np.ndarray:
    """(points, nodes): shape functions of a plane face of 3, 4, 6 or 8 nodes, which may stand beside the
    middles of its sides, or of one node.
    """
    if len(nodes) == 1:
        return np.ones((len(points), 1))
    points, nodes = points - nodes[0], nodes - nodes[0]
    corners, terms = _corners(nodes), TERMS[: len(nodes)]
    base = np.linalg.inv((REFERENCE[corners][: len(nodes), None] ** terms).prod(axis=2))
    lower, r = np.maximum(terms - np.eye(2, dtype=int)[:, None], 0), np.full(points.shape, 1.0 / 3.0)
    for _ in range(NEWTON):
        rates = [(terms[:, k] * (r[:, None] ** lower[k]).prod(axis=2)) @ base @ nodes for k in (0, 1)]
        missed = points - (r[:, None] ** terms).prod(axis=2) @ base @ nodes
        change = np.linalg.solve(np.stack(rates, axis=2), missed[..., None])[..., 0]
        r = r + change
        if np.abs(change).max() < LITTLE:
            break
    found = (r[:, None] ** terms).prod(axis=2) @ base
    # where nodes at quarters of sides make the map singular, r is known to the root of rounding
    apart = np.linalg.norm(points[:, None] - nodes, axis=2)
    at = apart.min(axis=1) < ROUNDING * np.ptp(nodes, axis=0).max()
    found[at] = np.eye(len(nodes))[apart[at].argmin(axis=1)]
    return found


def normal_of(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Of the plane through the left face, towards the right one."""
    vector = np.linalg.svd(x - x.mean(axis=0))[2][2]
    towards = (y.mean(axis=0) - x.mean(axis=0)) @ vector
    if len(x) < 3 or abs(towards) < 1e-9 * np.ptp(x, axis=0).max():
        raise ValueError("contact: coincident faces do not tell their side, nor does a wall; give a normal")
    return vector * np.sign(towards)


def moving_pairs(
    one: list[int], law: ContactLaw, rows: sparse.csr_matrix, slips: sparse.csr_matrix, distance: np.ndarray
) -> Contact:
    """The pairs of left nodes whose gaps a displacement moves."""
    moves, slides = (abs(part).max(axis=1).toarray().ravel() > ROUNDING for part in (rows, slips))
    if not moves.any():
        raise ValueError(
            "contact: no displacement moves a gap: all nodes are held, or both faces have the same"
        )
    if (slides & ~moves).any():
        raise ValueError(
            f"contact: law = {law!r} rubs, and node {one[(slides & ~moves).argmax()]} is held across the "
            "faces but slides: no contact force presses on it; free it, or leave it out"
        )
    laws = tuple(law if rubs else Unilateral() for rubs in slides) if law.rubs else (law,) * len(one)
    kept = tuple(law for law, gives in zip(laws, moves) if gives)
    return Contact(rows[moves], distance[moves], kept, sparse.csr_matrix(slips[moves]))


def given_gap(gap: Any, x: np.ndarray) -> np.ndarray:
    """(n,): a user's number, values or function at (n, 3) places."""
    if callable(gap):
        try:
            inspect.signature(gap).bind(*x.T)
        except (TypeError, ValueError):
            raise TypeError(f"contact: gap = {shown(gap)} must be a function of x, y and z") from None
        try:
            gap = gap(*x.T)
        except Exception as error:  # of any kind, in a user's function
            why = f"{type(error).__name__}: {error}"
            raise ValueError(
                f"contact: gap = {shown(gap)} fails with arrays of x, y and z ({why})"
            ) from error
    if not isinstance(gap, (list, tuple)) and not np.ndim(gap):
        return np.full(len(x), real("contact", "gap", gap, "m"))
    return real_array("contact", "gap", gap, (len(x),), "m")

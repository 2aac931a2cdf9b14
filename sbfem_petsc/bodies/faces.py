"""How the nodes of two faces meet: partners along a normal, or places between the other's nodes; gaps."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import scipy  # whose rooms are loaded where they are needed
from scipy import sparse

from meshing.input_checks import values_at

from ..checks import real, real_array, shown
from ..contact.law import ContactLaw, Unilateral
from ..errors import warn_of_mesh
from .cells import corners
from .rows import Contact

# Distance of partners in spacings of nodes; a row that is none, for a force of any size would press on it;
# weights that are none; what places are told apart by where faces are cut, of the largest coordinate.
APART, ROUNDING, LITTLE, GRID = 1e-3, 1e-9, 1e-13, 1e-12
# How far beside a face, in sides of its elements, a node is still before it: straight sides miss .07 of their
# length of a circle of twelve.
BESIDE = 0.1
# How far nodes stand off a plane that has a normal, in its shorter side.
FLAT = 0.1
# Area of a face that lies along the normal, seen along it, in squares of its circumference.
ALONG = 1e-4
# Triangles between the nodes of a face, by their number; steps to a place in it, at most.
HATS = {3: ((0, 1, 2),), 4: ((0, 1, 2), (0, 2, 3)), 6: ((0, 3, 5), (3, 1, 4), (5, 4, 2), (3, 4, 5))}
HATS[8] = ((0, 4, 7), (1, 5, 4), (2, 6, 5), (3, 7, 6), (4, 5, 6), (4, 6, 7))
NEWTON = 60
# Nodes of a face, corners first, in its own coordinates, and the terms of its shape functions.
REFERENCE = {
    3: 0.5 * np.array([[0, 0], [2, 0], [0, 2], [1, 0], [1, 1], [0, 1]]),
    4: 0.5 * np.array([[0, 0], [2, 0], [2, 2], [0, 2], [1, 0], [2, 1], [1, 2], [0, 1]]),
}
TERMS = np.array([[0, 0], [1, 0], [0, 1], [1, 1], [2, 0], [0, 2], [2, 1], [1, 2]])
# Where a place in a face is sought from, in these coordinates: the nearest of these.
STARTS = {4: np.stack(np.meshgrid(*2 * [np.linspace(0.1, 0.9, 5)]), axis=2).reshape(-1, 2)}
STARTS[3] = STARTS[4][STARTS[4].sum(axis=1) < 1.0]
Faces = list[list[int]]
# Nodes of a hat, those of its face and of the other one, points of what is common to them, and weights.
Common = tuple[list[int], list[int], list[int], np.ndarray, np.ndarray]


def partners(labels: np.ndarray, x: np.ndarray, y: np.ndarray, normal: np.ndarray) -> sparse.csr_matrix:
    """(left, left + right): 1 for the right node that faces each left one along the normal, -1 for itself."""
    flat = np.eye(3) - np.outer(normal, normal)
    x, y = x @ flat, y @ flat
    (far, second), (nearest, _) = (found.T for found in scipy.spatial.cKDTree(y).query(x, 2))
    # the distance of the one next to it; of a single node there is none
    size = np.median(scipy.spatial.cKDTree(x).query(x, 2)[0][:, 1]) if len(x) > 1 else 0.0
    away, behind = far > APART * size + 1e-12, second <= APART * size + 1e-12
    if behind.any():
        raise ValueError(
            f"contact: left node {labels[behind.argmax()]} has two right nodes before it, which lie behind "
            "each other, or in one place; give those of one face"
        )
    if away.any():
        raise ValueError(
            f"contact: {away.sum()} of {len(x)} left nodes have no partner (node {labels[away.argmax()]} is "
            f"{far[away.argmax()]:g} m off); if the faces' meshes do not match, say matching=False"
        )
    if len(set(nearest)) < len(x):
        raise ValueError("contact: two left nodes share a right one; the faces' meshes must match")
    return sparse.hstack([-sparse.identity(len(x)), sparse.identity(len(y), format="csr")[nearest]]).tocsr()


def between(
    nodes: tuple[np.ndarray, ...], normal: np.ndarray, faces: tuple[Faces, Faces], apart: Callable
) -> sparse.csr_matrix:
    """(left, left + right): means of what is before each other about left nodes, less those of themselves.

    Weights are hat functions, linear on triangles between the left nodes, over what is common to both faces,
    so that a constant or linear pressure has on each side the forces that its elements give it. Nodes of
    no face, as on a line, are points. Rows of nodes that have nothing before them are empty.

    Parameters
    ----------
    nodes : (left,), (left, 3), (right, 3) arrays
        Labels, places, and places of the other face.
    normal : (3,) array
    faces : pair of lists of lists of int
        Nodes by their places in these arrays, corners first; without any, triangles that fill the nodes'
        convex hull.
    apart : function
        Which left nodes come apart, (left,) array of bool, from such a matrix of what is before each by
        itself; hats of others, such as a crack's front, are shared out to their neighbours.

    Raises
    ------
    ValueError
        If nothing lies before the right face.

    Warns
    -----
    MeshWarning
        If some left nodes lie beside the right face, or on no face of their set.
    """
    import shapely

    labels, x, y = nodes
    flat, count = np.vstack([x, y]) @ np.linalg.svd(normal[None])[2][1:].T, len(x)
    own, other = (given or _hull(part) for given, part in zip(faces, np.split(flat, [count])))
    other = [[count + k for k in face] for face in other]
    right = np.array([shapely.Polygon(flat[face[: corners(face)]]) for face in other], dtype=object)
    across = np.flatnonzero(shapely.area(right) > ALONG * shapely.length(right) ** 2)
    if not len(across):
        raise ValueError(f"contact: {len(y)} right nodes span no surface across the normal; give a face")
    other, tree, points = [other[k] for k in across], shapely.STRtree(right[across]), shapely.points(flat)
    nearest = tree.geometries[before := tree.nearest(points[:count])]
    lines = shapely.shortest_line(nearest, points[:count])
    met = shapely.length(lines) < BESIDE * np.sqrt(shapely.area(nearest))
    ends, one = shapely.get_coordinates(lines)[::2, None], np.ones(1)
    alone: list[Common] = [([k], [k], other[before[k]], ends[k], one) for k in np.flatnonzero(met).tolist()]
    beside = sparse.diags((~met).astype(float), 0, (count, len(flat)))
    moves = apart(_means(alone, flat, np.ones(count, dtype=bool)) - beside)
    bound = np.isin(np.arange(count), [k for face in own for k in face])
    commons = [common for common in alone if not bound[common[0]]] + list(_common(flat, own, other, tree))
    means = _means(commons, flat, moves)
    paired = means.getnnz(axis=1) > 0
    for some, what in (
        (moves & ~paired, "beside the right face and make no pairs"),
        (paired & ~bound & bool(faces[0]), "on no outer face of their set, and are paired alone"),
    ):
        if some.any():
            label = labels[some.argmax()]
            said = f"contact: {some.sum()} of {count} left nodes, node {label} say, lie {what}"
            if not paired.any():
                raise ValueError(f"{said}; do these faces meet along this normal?")
            warn_of_mesh(f"{said}; are both sets right?")
    return means


def _common(places: np.ndarray, own: Faces, other: Faces, tree: Any) -> Iterator[Common]:
    """What the hats of faces have in common with the other's, whose polygons stand in a tree."""
    import shapely

    hats = [([face[k] for k in hat], face) for face in own for hat in HATS[len(face)]]
    left = np.array([shapely.Polygon(places[nodes]) for nodes, _ in hats], dtype=object)
    one, two = tree.query(left, predicate="intersects")
    # on a grid, for sides that lie on each other but for rounding give whole faces, or none, without one
    parts = shapely.intersection(left[one], tree.geometries[two], grid_size=GRID * np.abs(places).max())
    area, whole = shapely.area(parts), shapely.area(left)
    if (np.bincount(one, area, len(left)) > (1.0 + APART) * whole).any():
        raise ValueError("contact: right nodes lie behind each other; give those of one face")
    for k in np.flatnonzero(area > ROUNDING * whole[one]):
        yield (*hats[one[k]], other[two[k]], *_quadrature(shapely.get_coordinates(parts[k])[:-1]))


def _means(commons: list[Common], places: np.ndarray, moves: np.ndarray) -> sparse.csr_matrix:
    """See `between`."""
    means = np.zeros((len(moves), len(places)))
    for nodes, own, other, points, weights in commons:
        kept, hats = moves[nodes], (weights[:, None] * _shapes(places[nodes], points)).T
        hats, rows = hats[kept] + hats[~kept].sum(axis=0) / max(kept.sum(), 1), np.array(nodes)[kept]
        means[np.ix_(rows, own)] -= hats @ _shapes(places[own], points)
        means[np.ix_(rows, other)] += hats @ _shapes(places[other], points)
    shared = -means[:, : len(moves)].sum(axis=1, keepdims=True)
    means /= np.where(shared > 0.0, shared, 1.0)
    means[np.abs(means) <= LITTLE] = 0.0
    return sparse.csr_matrix(means)


def _hull(places: np.ndarray) -> Faces:
    """Triangles between nodes that fill their convex hull; none of nodes on a line."""
    try:
        return scipy.spatial.Delaunay(places).simplices.tolist()
    except (scipy.spatial.QhullError, ValueError):
        return []


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
    # where the map may be singular, as with nodes at quarters of sides at a crack's front, or several there
    apart = np.linalg.norm(points[:, None] - nodes, axis=2)
    at = apart.min(axis=1) < ROUNDING * np.ptp(nodes, axis=0).max()
    points[at] = nodes[: corners(nodes)].mean(axis=0)
    terms = TERMS[: len(nodes)]
    base = np.linalg.inv((REFERENCE[corners(nodes)][: len(nodes), None] ** terms).prod(axis=2))
    lower, begin = np.maximum(terms - np.eye(2, dtype=int)[:, None], 0), STARTS[corners(nodes)]
    ahead = points[:, None] - (begin[:, None] ** terms).prod(axis=2) @ base @ nodes
    r = begin[np.linalg.norm(ahead, axis=2).argmin(axis=1)]  # of curved sides, other roots lie near
    for _ in range(NEWTON):
        rates = [(terms[:, k] * (r[:, None] ** lower[k]).prod(axis=2)) @ base @ nodes for k in (0, 1)]
        missed = points - (r[:, None] ** terms).prod(axis=2) @ base @ nodes
        change = np.linalg.solve(np.stack(rates, axis=2), missed[..., None])[..., 0]
        r = r + change
        if np.abs(change).max() < LITTLE:
            break
    found = (r[:, None] ** terms).prod(axis=2) @ base
    found[at] = np.eye(len(nodes))[apart[at].argmin(axis=1)]
    return found


def normal_of(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Of the plane through the left face, towards the right one."""
    at = x - x.mean(axis=0)
    _, (length, width, depth), (*_, vector) = np.linalg.svd(np.vstack([at, np.zeros((3, 3))]), False)
    towards = (y.mean(axis=0) - x.mean(axis=0)) @ vector
    straight = width < ROUNDING * length
    if len(x) > 2 and (straight or depth > FLAT * width):
        place = "on a line" if straight else f"up to {np.abs(at @ vector).max():g} m off a plane"
        raise ValueError(
            f"contact: the {len(x)} left nodes lie {place}, and tell no normal; give normal, left to right"
        )
    if len(x) < 3 or abs(towards) < 1e-9 * np.ptp(x, axis=0).max():
        raise ValueError("contact: coincident faces do not tell their side, nor does a wall; give a normal")
    return vector * np.sign(towards)


def moved(rows: sparse.csr_matrix) -> np.ndarray:
    """(rows,) array of bool: those that a displacement changes."""
    return abs(rows).max(axis=1).toarray().ravel() > ROUNDING


def moving_pairs(labels: np.ndarray, law: ContactLaw, found: Contact) -> Contact:
    """Those whose gaps a displacement moves, of all left nodes, whose labels these are."""
    moves, slides = moved(found.rows), moved(found.slips)
    if not moves.any():
        raise ValueError("contact: no displacement moves a gap: all nodes are held, or both faces are one")
    if (slides & ~moves).any():
        raise ValueError(
            f"contact: law = {law!r} rubs, and node {labels[(slides & ~moves).argmax()]} is held across the "
            "faces but slides: no contact force presses on it; free it, or leave it out"
        )
    laws = tuple(law if rubs or not law.rubs else Unilateral() for rubs in slides[moves])
    return Contact(found.rows[moves], found.gap[moves], laws, found.slips[moves], found.body)


def given_gap(gap: Any, x: np.ndarray) -> np.ndarray:
    """(n,): a user's number, values or function at (n, 3) places."""
    if callable(gap):
        gap = values_at(f"contact: gap = {shown(gap)}", gap, x)
    if not isinstance(gap, (list, tuple)) and not np.ndim(gap):
        return np.full(len(x), real("contact", "gap", gap, "m"))
    return real_array("contact", "gap", gap, (len(x),), "m")

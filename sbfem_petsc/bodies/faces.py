"""How the nodes of two faces meet: partners along a normal, or places between the other's nodes; gaps."""

from __future__ import annotations

import inspect
from typing import Any

import numpy as np
from scipy import sparse

from ..checks import real, real_array, shown
from ..contact.law import ContactLaw, Unilateral
from .rows import Contact
from .units import tree_of

# Distance of partners in spacings of nodes; weights of a row that are none: a force of any size would press
# on it.
APART, ROUNDING = 1e-3, 1e-9


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
    left: list[int], x: np.ndarray, y: np.ndarray, normal: np.ndarray, face: np.ndarray
) -> sparse.csr_matrix:
    """(left, right): weights of the right nodes at the point before each left one.

    The triangles between the nodes fill their convex hull; those count that lie on the face, (k, 3, 3)
    triangles of the elements, if these are known.
    """
    from scipy.spatial import Delaunay, QhullError

    along = np.linalg.svd(normal[None])[2][1:].T
    x, y, face = x @ along, y @ along, face @ along
    try:
        triangles = Delaunay(y)
    except (QhullError, ValueError):
        raise ValueError(
            f"contact: the {len(y)} right nodes span no surface across the normal; give those of a face"
        ) from None
    inside = triangles.find_simplex(x, tol=APART)
    if len(face):
        inside[~_covered(y[triangles.simplices].mean(axis=1), face)[inside]] = -1
    if (inside < 0).any():
        raise ValueError(
            f"contact: {(inside < 0).sum()} of {len(left)} left nodes, node {left[inside.argmin()]} say, lie "
            "beside the right face; leave them out, or exchange the faces"
        )
    corners, forms = triangles.simplices[inside], triangles.transform[inside]
    weights = np.einsum("nij,nj->ni", forms[:, :2], x - forms[:, 2])
    weights = np.column_stack([weights, 1.0 - weights.sum(axis=1)])
    place = np.repeat(np.arange(len(x)), 3), corners.ravel()
    return sparse.csr_matrix((weights.ravel(), place), (len(x), len(y)))


def _covered(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Which (n, 2) points lie in any of (k, 3, 2) triangles."""
    found = np.zeros(len(points), dtype=bool)
    for a, b, c in triangles:
        shares = np.linalg.solve(np.column_stack([a - c, b - c]), (points - c).T)
        found |= (shares.min(axis=0) > -APART) & (shares.sum(axis=0) < 1.0 + APART)
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

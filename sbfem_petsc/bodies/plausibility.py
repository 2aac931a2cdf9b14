"""Whether the stiffness of a body is that of its nodes and has all its digits: both show where the body moves
as a whole.
"""

from __future__ import annotations

import numpy as np
from scipy import sparse

from meshing.warnings import MeshWarning

from ..errors import warn
from .units import tree_of

# Forces beside their parts that rounding of double precision leaves at most; the least that is divided by.
EXACT, TINY = 1e-11, 1e-300
# Forces beside their parts, unknowns of which some are too many, and bodies of which nothing is asked.
FORCED, NEARLY, FEW = 1e-2, 0.9, 200


def warn_of_order(
    owner: str,
    stiffness: sparse.csr_matrix,
    nodes: tuple[np.ndarray, np.ndarray],
    unknowns: tuple[np.ndarray, np.ndarray],
) -> None:
    """Warn where a body, turned as a whole, meets forces nearly everywhere but beside supports.

    Parameters
    ----------
    stiffness : (n, n) sparse matrix
    nodes : (m, 3) array and (m,) array of bool
        Places, m, and whether a node is held or has no unknown.
    unknowns : (n,), (n,) arrays of int
        Node of each, by its place among these, and direction.
    """
    (places, held), (rows, directions), about = nodes, unknowns, np.array([1.0, -0.6, 0.8])
    turned = np.cross(about, places[rows] - places[rows].mean(axis=0))
    rigid = np.hstack([turned, np.tile(about, (len(rows), 1))])[np.arange(len(rows)), directions]
    far = ~held
    if held.any():  # nor any of the nearest, as many as a node meets in its rows
        met = np.diff(stiffness.indptr).max() // 3 + 1
        near = tree_of(places).query(places, min(met, len(held)))[1].reshape(len(held), -1)
        far = ~held[near].any(axis=1)
    forced = np.abs(_forces(stiffness, rigid))[far[rows]] > FORCED
    if len(forced) >= FEW and forced.mean() > NEARLY:
        warn(
            f"{owner}: turned as a whole, the body meets forces at {forced.sum()} of {len(forced)} "
            "unknowns away from supports; are unknowns and nodes those of the matrices' rows, in order?",
            MeshWarning,
        )


def warn_of_rounding(
    owner: str, given: sparse.spmatrix, stiffness: sparse.csr_matrix, directions: np.ndarray
) -> None:
    """Warn where entries of few digits leave forces of a body that is shifted as a whole.

    Parameters
    ----------
    given, stiffness : (n, n) sparse matrices
        As it was given, and as it is used.
    directions : (n,) array of int
    """
    along, part = directions == np.arange(3)[:, None], _rounding(given)
    forces = np.concatenate([np.abs(_forces(stiffness, own.astype(float))[own]) for own in along])
    left = np.median(np.append(0.0, forces[forces < part]))
    if len(directions) >= FEW and left > EXACT:
        warn(
            f"{owner}: entries of stiffness are rounded, as in single precision: moved as a whole, the "
            f"body meets forces of {left:.2g} of their parts, which moves low frequencies by many times "
            "that; write them with all their digits",
            MeshWarning,
        )


def _forces(stiffness: sparse.csr_matrix, moved: np.ndarray) -> np.ndarray:
    """Forces that a motion meets, each beside the sum of its parts."""
    return (stiffness @ moved) / np.maximum(abs(stiffness) @ np.abs(moved), TINY)


def _rounding(matrix: sparse.spmatrix) -> float:
    """By which part of itself an entry is rounded at most: to single precision, or to 6 to 10 decimals."""
    values = np.abs(np.float64(sparse.coo_matrix(matrix).data))
    values = values[values > 0.0]
    units = [(2.0**-24, np.ldexp(np.frexp(values)[0], 24))]
    decimals = values / 10.0 ** np.floor(np.log10(values))
    units += [(5.0 * 10.0**-digits, 10.0 ** (digits - 1) * decimals) for digits in range(6, 11)]
    return next((part for part, whole in units if (abs(whole - np.round(whole)) < 1e-3).all()), 0.0)

"""Whether matrices are those of a solid and of its nodes: units by waves and weight, order and digits of the
stiffness where the body moves as a whole.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy  # whose rooms are loaded where they are needed
from scipy import sparse

from meshing.warnings import UnitWarning

from ..checks import real_array, require_symmetric, shown
from ..errors import warn, warn_of_mesh
from .cells import KINDS
from .rows import HELD

OWNER = "FiniteElementModel"
# m, N/m and kg in one unit of length, stiffness and mass.
UNITS = {"SI": (1.0, 1.0, 1.0), "mm-N-t": (1e-3, 1e3, 1e3), "mm-kg-mN": (1e-3, 1.0, 1.0)}
# Relative asymmetry that rounding of written files explains.
SYMMETRY = 1e-6
# m/s and kg/m^3: speeds of waves as the matrices tell them, within 1.5 of sqrt(E / density) of solid elements
# (50 to 18,000 m/s), and what no solid weighs.
SLOWEST, FASTEST, HEAVIEST = 10.0, 1e5, 3e4
# Forces beside their parts that rounding of double precision leaves at most; the least that is divided by.
EXACT, TINY = 1e-11, 1e-300
# By which part of itself a number is off that a few operations have made of a written one.
CLOSE = 4e-15
# Rounding from which a person may write entries, and the share of forces then that look backwards, which
# those of springs to the ground do not; that of two digits.
BY_HAND, BACKWARDS, COARSEST = 1e-2, 0.1, 0.05
# Forces beside their parts, unknowns of which some are too many, and bodies of whose order, and of whose
# digits, nothing is asked: they may be written by hand; one of solid elements is none of these.
FORCED, NEARLY, FEW, SMALL = 1e-2, 0.9, 200, 50
# Displacements of which no more are without a consistent mass, as those of springs and reference points.
LIGHT = 0.1


def whole(array: np.ndarray) -> bool:
    """Whether all are whole numbers that doubles tell apart."""
    return bool(((array == np.rint(array)) & (np.abs(array) <= 2.0**53)).all())


def si_matrix(name: str, value: Any, factor: float) -> sparse.csr_matrix:
    """Finite, symmetric, in SI; one triangle is completed."""
    if not sparse.issparse(value) or value.dtype.kind not in "iuf":
        raise TypeError(f"{OWNER}: {name} = {shown(value)} must be a real sparse matrix of SciPy")
    matrix = factor * sparse.csr_matrix(value, dtype=float)
    if matrix.shape[0] != matrix.shape[1] or not matrix.nnz:
        raise ValueError(f"{OWNER}: {name} of shape {matrix.shape} is not square, or is empty")
    real_array(OWNER, f"{name}.data", matrix.data, 1)
    lower, upper = sparse.tril(matrix, -1).tocsr(), sparse.triu(matrix, 1).tocsr()
    if bool(lower.count_nonzero()) != bool(upper.count_nonzero()):
        return (matrix + lower.T + upper.T).tocsr()
    require_symmetric(OWNER, name, matrix, SYMMETRY)
    return ((matrix + matrix.T) / 2.0).tocsr()


def warn_of_mass(body: Any, units: str, weight: float) -> None:
    """Warn of waves and densities that no solid has, by the kg that move, and of a mass that is cut.

    sqrt(K_ii / M_ii) is about 3 c over the spacing of nodes in elements of first and second order.
    """
    moves, heavy = body.unknowns[:, 1] < 3, body.mass.diagonal()
    stiffness, mass = (part[moves & (heavy > 0.0)] for part in (body.stiffness.diagonal(), heavy))
    far, said = scipy.spatial.cKDTree(body.places).query(body.places, 2)[0][:, 1], []
    far = far[np.isfinite(far) & (far > 0.0)]  # some lie in one place
    if len(far) and len(mass):
        speed = np.sqrt(np.median(stiffness / mass)) * np.median(far) / 3.0
        if not SLOWEST <= speed <= FASTEST:
            said.append(f"waves run at about {speed:.3g} m/s, {SLOWEST:g} to {FASTEST:g} m/s are usual")
    box = float(np.prod(np.ptp(body.places, axis=0)))
    if box > 0.0 and weight > HEAVIEST * box:
        said.append(f"a mass of {weight:.3g} kg in {box:.3g} m^3 is more than any solid's")
    if said:
        why = " and ".join(said)
        warn(f"{OWNER}: {why}; are units = {units!r} those of the matrices and nodes?", UnitWarning)
    light = np.count_nonzero(moves & (heavy == 0.0))
    if body.mass.count_nonzero() > np.count_nonzero(heavy) and light > LIGHT * moves.sum():
        warn_of_mesh(f"{OWNER}: mass couples unknowns, but {light} displacements have none; is it cut?")


def warn_of_order(body: Any) -> None:
    """Warn where a body, turned as a whole, meets forces nearly everywhere but beside supports."""
    moves, about = body.columns >= 0, np.array([1.0, -0.6, 0.8])
    turned = np.cross(about, body.places - body.places[moves.any(axis=1)].mean(axis=0))
    held = (body.columns == HELD).any(axis=1) | ~moves.any(axis=1)
    rigid = np.zeros(len(body.unknowns))
    rigid[body.columns[moves]] = np.hstack([turned, np.tile(about, (len(turned), 1))])[moves]
    solid = [cells for kind, cells in body.elements.items() if len(KINDS[kind][1]) > 1]
    # nor any of the nearest nodes, as many as one meets in its rows, is held, nor of one's elements
    met = min(np.diff(body.stiffness.indptr).max() // 3 + 1, len(body.places)) if held.any() else 1
    near = scipy.spatial.cKDTree(body.places).query(body.places, met)[1].reshape(len(body.places), -1)
    beside = held[near].any(axis=1)
    for own in solid:
        beside[own[held[own].any(axis=1)]] = True
    far = moves & ~beside[:, None]
    forced = np.abs(_forces(body.stiffness, rigid))[body.columns[far]] > FORCED
    if len(forced) >= (SMALL if solid else FEW) and forced.mean() > NEARLY:
        warn_of_mesh(
            f"{OWNER}: turned as a whole, the body meets forces at {forced.sum()} of {len(forced)} "
            "unknowns away from supports; are unknowns and nodes those of the matrices' rows, in order?"
        )


def warn_of_rounding(given: sparse.spmatrix, stiffness: sparse.csr_matrix, directions: np.ndarray) -> None:
    """Warn where entries of few digits leave forces of a body that is shifted as a whole.

    Parameters
    ----------
    given, stiffness : (n, n) sparse matrices
        As it was given, and as it is used.
    directions : (n,) array of int
    """
    entries = sparse.coo_matrix(given)
    part, beside = (_rounding(entries.data[own]) for own in (slice(None), entries.row != entries.col))
    # springs to the ground that are added by hand need digits of the diagonal alone
    all_alike, part = part == beside and part < BY_HAND, min(part, COARSEST)
    along = directions == np.arange(3)[:, None]
    forces = np.concatenate([_forces(stiffness, own.astype(float))[own] for own in along])
    forces = np.append(0.0, forces[np.abs(forces) < part])
    left = np.median(np.abs(forces))
    told = all_alike or (forces < 0.0).mean() > BACKWARDS
    if told and len(directions) >= SMALL and left > EXACT:
        warn_of_mesh(
            f"{OWNER}: entries of stiffness are rounded, as in single precision: moved as a whole, the body "
            f"meets forces of {left:.2g} of their parts, low frequencies are further off; write all digits"
        )


def _forces(stiffness: sparse.csr_matrix, moved: np.ndarray) -> np.ndarray:
    """Forces that a motion meets, each beside the sum of its parts."""
    return (stiffness @ moved) / np.maximum(abs(stiffness) @ np.abs(moved), TINY)


def _rounding(entries: np.ndarray) -> float:
    """By which part of itself an entry is rounded at most: to 1 to 10 decimals, or to single precision, which
    has whole numbers of few of them, too.
    """
    values = np.abs(np.float64(entries))
    values = values[values > 0.0]
    decimals = values / 10.0 ** np.floor(np.log10(values))
    units = [(5.0 * 10.0**-digits, 10.0 ** (digits - 1) * decimals) for digits in range(1, 11)]
    units.insert(5, (2.0**-24, np.ldexp(np.frexp(values)[0], 24)))
    return next((part for part, many in units if (abs(many - np.round(many)) <= CLOSE * many).all()), 0.0)

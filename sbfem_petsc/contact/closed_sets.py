"""Rows in contact, condensed: what contact does to a small disturbance of a history of time steps
(`marching.march`) at each of their instants, where switches are located inside their steps and nothing rubs.

Where no row changes sides a step is linear: with the set A of rows that keep their gaps at its end, the thin
contact forces p = U^T force obey dp = -K (V^T dq + ...) with the position dq before they act and
K = U_A^T W_AA^-1 U_A. With K_R = U_A^T R_AA^-1 U_A, which knows nothing of the step's length and is kept for
every set that has occurred, and M = V^T diag(cq) V, K = (K_R^-1 + M)^-1.

The modal forces of contact are then -B B^T dq. The columns of B are few: what moves the state by less than
rounding is left out, and of some twenty rows in contact about six directions remain.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy import linalg

from .law import RowLaws, rows_depend
from .tangent import Contacts, thin_axes

# Singular values of the gaps below this share of the largest are those of rounding.
ROUND_OFF = 1e-12
# Directions of contact that change the position by less than this share in a step are left out. Over 174
# instants of contact of the default mesh this changes the derivative by 1.5e-8 of its size, its multipliers
# by 6e-9; located switches change it by what the steps are in error, some 1e-3.
LEAST_LOCATED = 1e-10


def thin_factors(rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """U (pairs, r) and V (m, r) with rows = U V^T to round-off; V's columns are orthonormal.

    Rows of zeros stay so: those of pairs that supports hold, which have no flexibility to meet a gap of
    rounding with.
    """
    if rows.size == 0:
        return np.zeros((rows.shape[0], 0)), np.zeros((rows.shape[1], 0))
    left, values, right = linalg.svd(rows, full_matrices=False)
    rank = int((values > ROUND_OFF * values[:1]).sum())
    left[~rows.any(axis=1)] = 0.0
    return np.ascontiguousarray(left[:, :rank] * values[:rank]), np.ascontiguousarray(right[:rank].T)


class ClosedSet(NamedTuple):
    """Rows that keep their gaps, condensed.

    Attributes
    ----------
    operator : (r, r) array
        K_R.
    stiffness : (c,) array
        Diagonal of R_AA^-1 at its rows, N/m; zero at the others.
    """

    operator: np.ndarray
    stiffness: np.ndarray


class ClosedSets:
    """The closed sets that occur, each condensed once.

    Parameters
    ----------
    left : (c, r) array
        U.
    residual : (c, c) array
        R.
    laws : RowLaws
    """

    def __init__(self, left: np.ndarray, residual: np.ndarray, laws: RowLaws):
        self.left, self.residual, self.laws = left, residual, laws
        with np.errstate(divide="ignore", invalid="ignore"):
            self._weight = 1.0 / np.sqrt(np.diagonal(residual))
        self._known: dict[bytes, ClosedSet] = {}

    def __getitem__(self, closed: np.ndarray) -> ClosedSet:
        key = closed.tobytes()
        found = self._known.get(key)
        if found is None:
            if len(self._known) > 4096:
                self._known.clear()
            found = self._known[key] = self._condensed(closed)
        return found

    def _condensed(self, closed: np.ndarray) -> ClosedSet:
        """SolveError unless R is definite in these rows."""
        (rows,), stiffness, rank = closed.nonzero(), np.zeros(len(closed)), self.left.shape[1]
        if not len(rows):
            return ClosedSet(np.zeros((rank, rank)), stiffness)
        # rows of one size
        weight, scaled = self._weight[rows], self.residual[rows[:, None], rows]
        scaled *= weight
        scaled *= weight[:, None]
        # LAPACK itself: of matrices this small, the checks of its wrappers take most of the time
        factor, failed = linalg.lapack.dpotrf(scaled.T, lower=1)
        if failed:
            raise rows_depend()
        inverse = linalg.lapack.dtrtri(factor, lower=1)[0] * weight
        half = inverse @ self.left[rows]
        stiffness[rows] = np.einsum("ij,ij->j", inverse, inverse)
        return ClosedSet(half.T @ half, stiffness)


def located_contacts(
    sets: ClosedSets,
    right: np.ndarray,
    coefficients: np.ndarray,
    *,
    closed: np.ndarray,
    gaps: Callable[[np.ndarray, np.ndarray], np.ndarray],
    forces: np.ndarray,
) -> Contacts:
    """For the variational equation with each switch located inside its step, where nothing rubs.

    The steps hold a row's force at the mean of their ends, so a row acts over whole steps, and multipliers
    jump where a switch passes an instant of the grid. Here a switch stands where the gap without the row's
    own force, linear over the step, reaches the one that is kept; a step acts by the mean of K_R over the
    sets that it passes through, an instant by the mean of the steps beside it. What is left of the jumps is
    of second order in the step.

    Parameters
    ----------
    gaps : callable
        Of rows at instants, (k,) and (k,) int arrays.
    forces : (n + 1, c) array
    """
    steps = len(closed) - 1
    switched, switching = np.nonzero(closed[1:] != closed[:-1])
    opens = closed[switched, switching]
    at = np.where(opens, switched, switched + 1)
    held = [sets[touching].stiffness[row] for touching, row in zip(closed[switched + ~opens], switching)]
    acting = forces[at, switching]
    overlap = np.abs(acting) / np.array(held)
    gap = np.maximum(sets.laws.apart(gaps(2 * switched + 1 - at, switching), acting, switching), 0.0)
    moments = np.where(opens, overlap, gap) / (overlap + gap)
    # in the order of time a set follows from the one before by a row that switches
    order = np.lexsort((moments, switched))
    switched, switching, moments = switched[order], switching[order], moments[order]
    switches, first = np.unique(switched, return_index=True)
    following = np.zeros((len(switched), closed.shape[1]), dtype=bool)
    following[np.arange(len(switched)), switching] = True
    following = np.logical_xor.accumulate(following, axis=0) ^ closed[0]
    found = np.array([sets[touching].operator for touching in (closed[0], *following)])
    # each lasts until the next one, and until the end of its step
    last = np.append(first[1:], len(switched))[: len(first)] - 1
    ends = np.append(moments[1:], 1.0)[: len(moments)]
    ends[last] = 1.0
    # the operators of the sets between the steps with switches and, by turns, their means over these steps
    table = np.empty((2 * len(switches) + 1, *found.shape[1:]))
    table[0], table[2::2] = found[0], found[last + 1]
    if len(switches):
        shares = (ends - moments)[:, None, None] * found[1:]
        table[1::2] = moments[first][:, None, None] * table[:-1:2] + np.add.reduceat(shares, first)
    acting = 2 * np.searchsorted(switches, np.arange(steps))
    acting[switches] += 1
    pairs = np.stack([np.append(acting[:1], acting), np.append(acting, acting[-1:])], axis=1)
    instants = np.flatnonzero(table.any(axis=(1, 2))[pairs].any(axis=1))
    # two neighbours follow each other along the table: their numbers and their sum tell the pair
    key = 2 * pairs[instants].sum(axis=1) + (instants == 0)
    _, kinds, which = np.unique(key, return_index=True, return_inverse=True)
    kinds = instants[kinds]
    means = 0.5 * (table[pairs[kinds, 0]] + table[pairs[kinds, 1]])
    rows, ranks = _thin_rows(means, right, coefficients[4], kinds == 0)
    counts = ranks[which.ravel()]
    owner = np.repeat(np.arange(len(instants)), counts)
    place = np.arange(len(owner)) - np.repeat(np.cumsum(counts) - counts, counts)
    factors, nothing = rows[which.ravel()[owner], place], np.zeros((len(owner), 0))
    return Contacts(instants, counts, factors, nothing, factors, nothing, nothing)


def _thin_rows(
    operators: np.ndarray, right: np.ndarray, gain: np.ndarray, fixed: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """B^T (k, n, m) of operators K_R (k, r, r), and how many rows each has. Where `fixed`, K_R itself acts
    and not (K_R^-1 + M)^-1.

    With S^T K_R S = F F^T by Cholesky with pivots, up to columns that move the state by less than rounding,
    and 1 + F^T F = C C^T, B^T = C^-1 F^T S^-1 V^T.
    """
    scaled, unscaled = thin_axes(right.T, gain)  # S
    columns, ranks = pivoted_cholesky(_congruent(operators, scaled), LEAST_LOCATED)
    transposed = np.swapaxes(columns, 1, 2)
    moved = np.where(fixed[:, None, None], 0.0, transposed @ columns) + np.eye(columns.shape[2])
    return np.linalg.solve(np.linalg.cholesky(moved), transposed) @ (unscaled.T @ right.T), ranks


def _congruent(matrices: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """S^T K S of symmetric matrices (k, r, r), by products of large matrices."""
    count, size = matrices.shape[:2]
    for _ in range(2):
        half = matrices.reshape(count * size, size) @ columns
        matrices = np.ascontiguousarray(half.reshape(count, size, size).swapaxes(1, 2))
    return matrices


def pivoted_cholesky(matrices: np.ndarray, least: float) -> tuple[np.ndarray, np.ndarray]:
    """F (k, r, n) with F F^T = the semidefinite matrices (k, r, r) but for what is below `least`, and the
    number of columns of each (k,); the columns beyond are zero.
    """
    count, size = matrices.shape[:2]
    every = np.arange(count)
    left = np.einsum("kii->ki", matrices).copy()
    smallest = least * np.maximum(left.max(axis=1, initial=0.0), 1.0)
    columns, pivots = np.zeros((count, size, size)), np.zeros((count, size), dtype=int)
    ranks = np.zeros(count, dtype=int)
    for n in range(size):
        pivot = left.argmax(axis=1)
        largest = left[every, pivot]
        more = largest > smallest
        if not more.any():
            break
        column = matrices[every, :, pivot]
        column -= (columns[:, :, :n] @ columns[every, pivot, :n, None])[:, :, 0]
        column *= np.where(more, 1.0 / np.sqrt(np.where(more, largest, 1.0)), 0.0)[:, None]
        columns[:, :, n], pivots[:, n] = column, pivot
        # what has been a pivot is used up, and zero above the later ones
        left -= column**2
        left[every, pivot] = -1.0
        columns[every[:, None], pivots[:, :n], n] = 0.0
        ranks += more
    rank = int(ranks.max(initial=0))
    return columns[:, :, :rank], ranks

"""Linear complementarity problems of unilateral contact by a primal-dual active set."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import linalg

from ..errors import SolveError, on_all_ranks


@dataclass(frozen=True, eq=False)
class Complementarity:
    """Solution of ``0 <= force  _|_  W force + gap >= 0``.

    Attributes
    ----------
    force : (n,) array
        Contact forces, compression positive.
    gap : (n,) array
        ``W force + free gap``.
    active : (n,) bool array
        Pairs in contact.
    iterations : int
    """

    force: np.ndarray
    gap: np.ndarray
    active: np.ndarray
    iterations: int


def solve_complementarity(
    flexibility: np.ndarray, free_gap: np.ndarray, start: np.ndarray | None = None, maximum: int = 200
) -> Complementarity:
    """Primal-dual active set on the condensed contact problem.

    Parameters
    ----------
    flexibility : (n, n) array
        Delassus operator W = G K^-1 G^T, symmetric positive definite, m/N.
    free_gap : (n,) array
        Gaps without contact forces, m.
    start : (n,) bool array, optional
        First guess of the active set; default: the penetrating pairs.
    maximum : int
        Iterations before the fallback.

    Notes
    -----
    The primal-dual iteration takes W to be positive definite; where it runs into a cycle the problem is
    handed to a principal pivoting method with the least-index rule (Murty), which ends for every positive
    definite W.

    Raises
    ------
    SolveError
        If neither ends.
    """
    n = len(free_gap)
    active = (free_gap < 0.0) & (np.diag(flexibility) > 0.0 if n else True) if start is None else start.copy()
    # Forces and gaps have different units: the diagonal of W weighs one against the other.
    # A pair whose two nodes are held fixed has no flexibility and no say.
    diagonal = np.diag(flexibility) if n else np.empty(0)
    weight = np.divide(1.0, diagonal, out=np.zeros(n), where=diagonal > 0.0)
    seen = set()
    for iteration in range(1, maximum + 1):
        force = _forces(flexibility, free_gap, active)
        gap = flexibility @ force + free_gap
        gap[active] = 0.0
        following = force - weight * gap > 0.0
        if np.array_equal(following, active):
            return Complementarity(force, gap, active, iteration)
        key = following.tobytes()
        if key in seen:
            return _least_index(flexibility, free_gap, following, iteration)
        seen.add(key)
        active = following
    return _least_index(flexibility, free_gap, active, maximum)


def _forces(flexibility: np.ndarray, free_gap: np.ndarray, active: np.ndarray) -> np.ndarray:
    force = np.zeros(len(free_gap))
    if active.any():
        index = np.flatnonzero(active)
        force[index] = linalg.solve(flexibility[np.ix_(index, index)], -free_gap[index], assume_a="pos")
    return force


def _least_index(
    flexibility: np.ndarray, free_gap: np.ndarray, active: np.ndarray, done: int
) -> Complementarity:
    """Murty's least-index principal pivoting from a given basis."""
    active = active.copy()
    scale = np.abs(free_gap).max()
    for iteration in range(done + 1, done + 100 * len(free_gap) + 1):
        force = _forces(flexibility, free_gap, active)
        gap = flexibility @ force + free_gap
        gap[active] = 0.0
        wrong = np.flatnonzero((active & (force < 0.0)) | (~active & (gap < -1e-14 * scale)))
        if len(wrong) == 0:
            return Complementarity(force, gap, active, iteration)
        active[wrong[0]] = ~active[wrong[0]]
    raise on_all_ranks(
        SolveError(
            f"contact: neither the primal-dual active set nor principal pivoting ended after {iteration} "
            f"iterations for {len(free_gap)} pairs"
        )
    )


def one_pass_tie(flexibility: np.ndarray, free_gap: np.ndarray) -> Complementarity:
    """The paper's single correction (30)-(34): every penetrating pair is tied, and tension is not
    released.
    """
    active = free_gap < 0.0
    force = _forces(flexibility, free_gap, active)
    return Complementarity(force, flexibility @ force + free_gap, active, 1)

"""Contact problems condensed onto the contact rows, by a primal-dual active set."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import linalg

from ..errors import SolveError, on_all_ranks
from .law import ROUND_OFF, RowLaws


@dataclass(frozen=True, eq=False)
class Complementarity:
    """Solution of a contact problem: ``0 <= force  _|_  W force + free gap >= 0`` in unilateral rows,
    ``W force + free gap = 0`` in tied ones.

    Attributes
    ----------
    force : (n,) array
        Contact forces, N, compression positive.
    gap : (n,) array
        ``W force + free gap``.
    active : (n,) bool array
        Rows in contact.
    iterations : int
    """

    force: np.ndarray
    gap: np.ndarray
    active: np.ndarray
    iterations: int


def solve_complementarity(
    flexibility: np.ndarray,
    free_gap: np.ndarray,
    laws: RowLaws | None = None,
    *,
    start: np.ndarray | None = None,
    maximum: int = 200,
) -> Complementarity:
    """Primal-dual active set on the condensed contact problem.

    Parameters
    ----------
    flexibility : (n, n) array
        Delassus operator W = G K^-1 G^T, symmetric positive definite, m/N. A row of zeros (both nodes of the
        pair are held fixed) takes no part.
    free_gap : (n,) array
        Gaps without contact forces, m.
    laws : RowLaws, optional
        Default: unilateral contact.
    start : (n,) bool array, optional
        First guess of the active set; default: the rows that cannot do without a force.
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
    laws = RowLaws.unilateral(len(free_gap)) if laws is None else laws
    flexible = np.diag(flexibility) > 0.0
    active = flexible & (laws.touched(free_gap) if start is None else laws.tied | start)
    seen = set()
    for iteration in range(1, maximum + 1):
        force, gap = _closed(flexibility, free_gap, active)
        wrong = flexible & laws.wrong(active, force, gap)
        if not wrong.any():
            return Complementarity(force, gap, active, iteration)
        active = active ^ wrong
        key = active.tobytes()
        if key in seen:
            return _least_index(flexibility, free_gap, laws, active, iteration)
        seen.add(key)
    return _least_index(flexibility, free_gap, laws, active, maximum)


def _closed(
    flexibility: np.ndarray, free_gap: np.ndarray, active: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Forces that keep the active rows closed, and the gaps under them."""
    force = np.zeros(len(free_gap))
    if active.any():
        index = np.flatnonzero(active)
        block = flexibility[np.ix_(index, index)]
        # rows of different size or unit, nodal forces and resultants of pressure modes, weigh alike
        weight = 1.0 / np.sqrt(np.diag(block))
        scaled = weight[:, None] * block * weight
        force[index] = weight * linalg.solve(scaled, -weight * free_gap[index], assume_a="pos")
    gap = flexibility @ force + free_gap
    gap[active] = 0.0
    return force, gap


def _least_index(
    flexibility: np.ndarray, free_gap: np.ndarray, laws: RowLaws, active: np.ndarray, done: int
) -> Complementarity:
    """Murty's least-index principal pivoting from a given basis."""
    active, flexible = active.copy(), np.diag(flexibility) > 0.0
    for iteration in range(done + 1, done + 100 * len(free_gap) + 1):
        force, gap = _closed(flexibility, free_gap, active)
        # each row has a rounding of its own: rows may differ in unit and in size
        rounding = ROUND_OFF * (np.abs(flexibility) @ np.abs(force) + np.abs(free_gap))
        wrong = np.flatnonzero(flexible & laws.wrong(active, force, gap, rounding))
        if len(wrong) == 0:
            return Complementarity(force, gap, active, iteration)
        active[wrong[0]] = ~active[wrong[0]]
    raise on_all_ranks(
        SolveError(
            f"contact: neither the primal-dual active set nor principal pivoting ended after {iteration} "
            f"iterations for {len(free_gap)} rows"
        )
    )


def one_pass_tie(
    flexibility: np.ndarray, free_gap: np.ndarray, laws: RowLaws | None = None
) -> Complementarity:
    """The paper's single correction (30)-(34): every penetrating pair is tied, and tension is not
    released.
    """
    laws = RowLaws.unilateral(len(free_gap)) if laws is None else laws
    active = laws.touched(free_gap)
    force, _ = _closed(flexibility, free_gap, active)
    return Complementarity(force, flexibility @ force + free_gap, active, 1)

"""Contact problems of some rows: one primal-dual active set over what solves a set that is closed."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from scipy import linalg

from ..errors import failed_solve
from .law import FREE, ROUND_OFF, RowLaws, rows_depend


@dataclass(frozen=True, eq=False)
class Complementarity:
    """Solution of a contact problem, gap = W force + free gap: in unilateral rows ``0 <= force  _|_  gap >=
    0``, in tied ones ``gap = 0``.

    Attributes
    ----------
    force : (n,) array
        Contact forces, N, compression positive.
    gap : (n,) array
        ``W force + free gap``.
    state : (n,) int8 array
        See `law`.
    iterations : int
    kept : (k,) array
        Slips that tangential rows stick to or have slid from, m; empty where nothing rubs.
    """

    force: np.ndarray
    gap: np.ndarray
    state: np.ndarray
    iterations: int
    kept: np.ndarray = field(default_factory=lambda: np.empty(0))

    @property
    def active(self) -> np.ndarray:
        """(n,): rows in contact."""
        return self.state != FREE


class Backend(Protocol):
    """What solves a structure with some contact rows closed; collective where the structure is distributed.

    Attributes
    ----------
    flexible : (n,) bool array
        Rows that a force moves; the others take no part.
    maximum : int
        Sets before the iteration is given up.
    rounding : float
        Of forces and gaps, relative to the largest.
    """

    flexible: np.ndarray
    maximum: int
    rounding: float

    def closed(
        self, active: np.ndarray, gap: np.ndarray, force: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray] | None:
        """Forces that close these gaps of the active rows, from a first guess, and what they add to the gaps
        of all rows; None where they are not found.
        """

    def sharpen(self) -> bool:
        """Solve more exactly from here on; False where that is not possible."""


def active_set(
    backend: Backend, free_gap: np.ndarray, laws: RowLaws, start: np.ndarray | None = None
) -> tuple[Complementarity | None, np.ndarray]:
    """Primal-dual active set: the solution, None after a cycle or a set that is not solved, and the last
    states.

    Parameters
    ----------
    backend : Backend
    free_gap : (n,) array
        Gaps without contact forces, m.
    laws : RowLaws
    start : (n,) int8 array, optional
        First guess of the states; default: those without forces.
    """
    state = _flexible(backend, laws.touched(free_gap) if start is None else start.astype(np.int8))
    force, seen = np.zeros(len(free_gap)), set[bytes]()
    for iteration in range(1, backend.maximum + 1):
        found = _solved(backend, state, free_gap, laws, force)
        if found is None:
            break
        force, gap = found
        pull, overlap = (backend.rounding * np.abs(of).max(initial=0.0) for of in (force, free_gap))
        former, state = state, _flexible(backend, laws.following(state, force, gap, pull, overlap))
        settled = np.array_equal(state, former)
        if settled or state.tobytes() in seen:
            # what looks like a cycle may be the doing of loose solves
            if not backend.sharpen():
                force = laws.admissible(state, force)
                return Complementarity(force, gap, state, iteration) if settled else None, state
            seen.clear()
        seen.add(state.tobytes())
    return None, state


def _flexible(backend: Backend, state: np.ndarray) -> np.ndarray:
    """States, of rows that no force moves free ones."""
    return np.where(backend.flexible, state, FREE).astype(np.int8)


def _solved(
    backend: Backend, state: np.ndarray, free_gap: np.ndarray, laws: RowLaws, force: np.ndarray
) -> tuple[np.ndarray, np.ndarray] | None:
    """Forces that keep the gaps of rows in their states, from a first guess, and all gaps."""
    found = backend.closed(state != FREE, free_gap - laws.places(state), force)
    return None if found is None else (found[0], laws.placed(state, found[1] + free_gap))


class Condensed:
    """Rows with their flexibility as a matrix, a `Backend`.

    Parameters
    ----------
    flexibility : (n, n) array
    maximum : int
    """

    rounding = 0.0

    def __init__(self, flexibility: np.ndarray, maximum: int):
        self._flexibility, self.maximum = flexibility, maximum
        self.flexible = np.diag(flexibility) > 0.0

    def closed(self, active: np.ndarray, gap: np.ndarray, force: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """By Cholesky's factorisation."""
        index, force = np.flatnonzero(active), np.zeros(len(gap))
        if len(index):
            block = self._flexibility[np.ix_(index, index)]
            # rows of different size or unit, nodal forces and resultants of pressure modes, weigh alike
            weight = 1.0 / np.sqrt(np.diag(block))
            scaled = weight[:, None] * block * weight
            try:
                force[index] = weight * linalg.solve(scaled, -weight * gap[index], assume_a="pos")
            except linalg.LinAlgError:
                raise rows_depend() from None
        return force, self._flexibility @ force

    def sharpen(self) -> bool:
        """The solves are exact."""
        return False


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
    start : (n,) int8 array, optional
        First guess of the states; default: those without forces.
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
    backend = Condensed(flexibility, maximum)
    found, state = active_set(backend, free_gap, laws, start)
    if found is not None:
        return found
    last = maximum + 100 * len(free_gap)
    for iteration in range(maximum + 1, last + 1):
        solved = _solved(backend, state, free_gap, laws, free_gap)
        assert solved is not None
        force, gap = solved
        # each row has a rounding of its own: rows may differ in unit and in size
        rounding = ROUND_OFF * (np.abs(flexibility) @ np.abs(force) + np.abs(free_gap))
        following = _flexible(backend, laws.following(state, force, gap, overlap=rounding))
        wrong = np.flatnonzero(following != state)
        if len(wrong) == 0:
            return Complementarity(force, gap, state, iteration)
        state[wrong[0]] = following[wrong[0]]
    raise failed_solve(
        f"contact: neither the primal-dual active set nor principal pivoting ended after {last} "
        f"iterations for {len(free_gap)} rows"
    )

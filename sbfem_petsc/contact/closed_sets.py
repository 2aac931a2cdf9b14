"""Rows in contact, condensed: what sets of rows that keep their gaps or their slips make of a position.

The thin forces of contact are U^T E f = -(K y + L m) under the thin position y = V^T dq and the slips m
that sticking rows keep, with the forces f of the rows a that are held, E f of all rows (those that slip
pull by their share of the pressure beside them) and R_a E f = m - U_a y. With the residual flexibility R
alone K knows nothing of a step's length and is kept for every set that has occurred.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from scipy import linalg

from ..errors import SolveError, failed_solve
from .friction import AGAINST, ALONG, STICKS, Rubbing
from .law import FREE, rows_depend

# Singular values of the gaps, each row by its own size, below this share of the largest are rounding.
ROUND_OFF = 1e-12
# Condition of sets of which rows are held twice, which share their forces.
_TWICE = 1e13
# What rows that share their forces may differ in, of the most that the position moves any: 1e-15 where cracks
# meet; of the order of 1 where kept modes alone tell them apart, and no finite force holds both.
_DIFFERENT = 1e-6
# Numbers of all sets that are kept at most.
_MOST = 1 << 25


def thin_factors(rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """U (pairs, r) and V (m, r) with rows = U V^T to round-off; V's columns are orthonormal.

    Rows of zeros stay so: those of pairs that supports hold, which have no flexibility to meet a gap of
    rounding with.
    """
    if rows.size == 0:
        return np.zeros((rows.shape[0], 0)), np.zeros((rows.shape[1], 0))
    sizes = np.abs(rows).max(axis=1, keepdims=True)  # of masses and units far apart
    left, values, right = linalg.svd(rows / np.where(sizes > 0.0, sizes, 1.0), full_matrices=False)
    rank = int((values > ROUND_OFF * values[:1]).sum())
    return np.ascontiguousarray(sizes * left[:, :rank] * values[:rank]), np.ascontiguousarray(right[:rank].T)


class ClosedSet(NamedTuple):
    """Rows that keep their gaps or slips, condensed, of k that remember among n.

    Attributes
    ----------
    by_position, by_memory : (r, r), (r, k) arrays
        K and L.
    slips, kept : (2 k, r), (2 k, k) arrays
        Slips, and behind them gaps of the rows beside, m, under the position and under slips that are kept.
    stiffness : (n,) array
        Force of each row that is held under its own gap, N/m; zero of the others.
    pressing : (k,) array
        Force of the row beside under a slip that is kept, N/m.
    """

    by_position: np.ndarray
    by_memory: np.ndarray
    slips: np.ndarray
    kept: np.ndarray
    stiffness: np.ndarray
    pressing: np.ndarray


class ClosedSets:
    """The closed sets that occur, each condensed once; by the states of all rows, (n,) int8.

    Parameters
    ----------
    left : (n, r) array
        U.
    residual : (n, n) array
        R.
    rubbing : Rubbing
    """

    def __init__(self, left: np.ndarray, residual: np.ndarray, rubbing: Rubbing):
        self.left, self.residual, self.rubbing = left, residual, rubbing
        with np.errstate(divide="ignore", invalid="ignore"):
            self._weight = 1.0 / np.sqrt(np.diagonal(residual))
        self._most = _MOST // max((left.shape[1] + 2 * len(rubbing.rows)) ** 2, 1)
        self._known: dict[bytes, ClosedSet] = {}

    def __getstate__(self) -> dict[str, Any]:
        """What is pickled or copied: without the sets, which are found again."""
        return self.__dict__ | {"_known": {}}

    def __getitem__(self, state: np.ndarray) -> ClosedSet:
        key = state.tobytes()
        found = self._known.get(key)
        if found is None:
            if len(self._known) > self._most:
                self._known.clear()
            found = self._known[key] = self._condensed(state)
        return found

    def unsolved(self, what: str) -> Exception:
        """Why a contact problem of steps has no solution, and what may help."""
        try:
            self[np.isfinite(self._weight).astype(np.int8)]  # all that any force moves pressed and sticking
        except SolveError as depend:
            return depend
        return failed_solve(f"{what} was not solved; use shorter steps, or pairs of like size")

    def _condensed(self, state: np.ndarray) -> ClosedSet:
        """SolveError where rows depend on each other, see `_inverse`."""
        (rows, beside, kinetic, _), left, residual = self.rubbing, self.left, self.residual
        count, memory = len(beside), len(rows)
        along, place = state[count:], np.full(len(state), -1)
        sticks, shown = np.flatnonzero(along == STICKS), np.append(count + np.arange(memory), rows)
        members = np.append(np.flatnonzero(state[:count] != FREE), count + sticks)
        place[members] = np.arange(len(members))
        # a pressure whose row slips brings its friction
        slides = np.flatnonzero(((along == ALONG) | (along == AGAINST)) & (place[rows] >= 0))
        pull = kinetic[slides] * np.where(along[slides] == ALONG, 1.0, -1.0)
        columns, thin = residual[:, members], left[members]
        columns[:, place[rows[slides]]] += pull * residual[:, count + slides]
        thin[place[rows[slides]]] += pull[:, None] * left[count + slides]
        inverse = self._inverse(columns[members], self._weight[members], left[members])
        forces, memories = inverse @ left[members], inverse[:, place[count + sticks]]
        by_memory, kept = np.zeros((left.shape[1], memory)), np.zeros((2 * memory, memory))
        by_memory[:, sticks], kept[:, sticks] = -thin.T @ memories, columns[shown] @ memories
        stiffness, pressing = np.zeros(len(state)), np.zeros(memory)
        stiffness[members] = np.diagonal(inverse)
        pressing[sticks] = inverse[place[rows[sticks]], place[count + sticks]]
        slips = left[shown] - columns[shown] @ forces
        return ClosedSet(thin.T @ forces, by_memory, slips, kept, stiffness, pressing)

    def _inverse(self, acting: np.ndarray, weight: np.ndarray, left: np.ndarray) -> np.ndarray:
        """Of rows of one size, that weigh so much. Those that depend on each other share their forces where
        rows rub and what moves one moves the others alike; elsewhere they are refused.
        """
        if not np.isfinite(weight).all():
            raise rows_depend()
        scaled, seen = weight[:, None] * acting * weight, weight[:, None] * left
        try:
            inverse = np.linalg.inv(scaled)
        except np.linalg.LinAlgError:
            inverse = np.full_like(scaled, np.inf)
        if np.abs(inverse).max(initial=0.0) * np.abs(scaled).max(initial=0.0) > _TWICE:
            inverse = np.linalg.pinv(scaled, 1.0 / _TWICE)
            missed = np.abs(seen - scaled @ (inverse @ seen)).max(initial=0.0)
            if len(self.rubbing.rows) == 0 or missed > _DIFFERENT * np.abs(seen).max(initial=0.0):
                raise rows_depend()
        return weight[:, None] * inverse * weight

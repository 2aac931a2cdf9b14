"""What contact with friction does to a small disturbance of a history of time steps (`marching.march`).

While no row changes its state a step is linear in the position dq before contact acts and in what the rows
remember: the forces f of the rows a that keep a gap or stick, E f of all rows (those that slip pull by their
share of the pressure beside them), obey W_a E f = ds - U_a V^T dq with the slips ds that sticking rows keep.
What a row keeps is written at the last instant at which it has not stuck. The memory of a state is the slips
at the instant before it: from these a row either slips or sticks, from its slip at the same instant it might
do both, so that the derivative would have two values.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy import linalg

from .closed_sets import Contacts
from .friction import AGAINST, ALONG, STICKS
from .law import FREE
from .marching import StepConstants
from .rubbing import Rubbing

# Directions of contact that change the position in a step, in units of it, by less than this are left out.
LEAST = 1e-8


def written(states: np.ndarray, count: int) -> np.ndarray:
    """(n + 1, k): the instants at which the slips behind `count` normal rows are what is kept later on, or
    what is left to the next period.
    """
    sticks = states[:, count:] == STICKS
    result = np.zeros_like(sticks)
    result[:-1] = ~sticks[:-1] & sticks[1:]
    result[-2] = ~sticks[-2]
    return result


class RubbingSets:
    """The sets that occur, each condensed once, whatever the length of the steps.

    Parameters
    ----------
    left : (c + k, r) array
        U.
    residual : (c + k, c + k) array
        R.
    rubbing : Rubbing
    units : (k,) array
        Those of the slips in the state, m.
    moved : (r, r) array
        M = V^T diag(cq) V of a step, which tells what directions of contact count.
    """

    def __init__(
        self,
        left: np.ndarray,
        residual: np.ndarray,
        rubbing: Rubbing,
        units: np.ndarray,
        moved: np.ndarray,
    ):
        self.left, self.residual, self.rubbing, self.units = left, residual, rubbing, units
        values, axes = np.linalg.eigh(moved)
        root = np.sqrt(np.maximum(values, 1e-15 * values[-1:]))
        self.scaled, self.inverse = axes * root, axes / root
        self._known: dict[tuple[bytes, bytes], tuple[np.ndarray, ...]] = {}

    def __call__(self, state: np.ndarray, writes: np.ndarray) -> tuple[np.ndarray, ...]:
        """Of states of the rows and the slips that are written: what the directions of contact add to the
        thin forces (r, s), what they take from position (s, r), memory (s, k) and free gaps (s, c + k), and
        what the slips, in their units, miss of what they are to be, from the same.
        """
        key = state.tobytes(), writes.tobytes()
        if key not in self._known:
            if len(self._known) > 4096:
                self._known.clear()
            self._known[key] = self._condensed(state, writes)
        return self._known[key]

    def _condensed(self, state: np.ndarray, writes: np.ndarray) -> tuple[np.ndarray, ...]:
        left, count = self.left, self.rubbing.beside.size
        slips, units = count + writes, self.units[writes][:, None]
        index, spread = _spread(self.residual, self.rubbing, state)
        sticking = index >= count
        kept, rank = index[sticking] - count, left.shape[1]
        force = spread(np.concatenate([left, self.residual[slips].T], axis=1)).T
        gaps = np.zeros((len(force), len(left)))
        gaps[:, index] = force
        gaps[rank + np.arange(len(writes)), slips] -= 1.0
        memory = np.zeros((len(force), len(self.units)))
        memory[:, kept] = -force[:, sticking] * self.units[kept]
        memory[rank + np.arange(len(writes)), writes] += self.units[writes]
        position = force @ left[index]
        position[rank:] -= left[slips]
        whole = self.scaled.T @ np.concatenate([position[:rank] @ self.scaled, memory[:rank]], axis=1)
        base, triangle, _ = linalg.qr(whole, mode="economic", pivoting=True, check_finite=False)
        most = int((np.abs(np.diagonal(triangle)) > LEAST * max(abs(triangle[0, 0]), 1.0)).sum())
        chosen = base[:, :most].T @ self.scaled.T
        directions = (chosen @ part[:rank] for part in (position, memory, gaps))
        return (
            self.inverse @ base[:, :most],
            *directions,
            *(part[rank:] / units for part in (position, memory, gaps)),
        )


def rubbing_contacts(
    sets: RubbingSets, step: StepConstants, states: np.ndarray, gap_rates: np.ndarray
) -> Contacts:
    """Of steps as they are, of one length.

    Parameters
    ----------
    sets : RubbingSets
    step : StepConstants
    states : (n + 1, c + k) int8 array
        Of the rows at the steps' ends.
    gap_rates : (n + 1, c + k, e) array
        Rates of the free gaps and slips with e parameters.
    """
    moved = (step.right * step.coefficients[0, 4]) @ step.right.T
    writes = written(states, step.rubbing.beside.size)
    instants = np.flatnonzero((states != FREE).any(axis=1) | writes.any(axis=1))
    known: dict[tuple[bool, bytes, bytes], int] = {}
    parts: list[tuple[np.ndarray, ...]] = []
    which: list[int] = []
    for n in instants:
        key = (n == 0, states[n].tobytes(), writes[n].tobytes())
        if key not in known:
            known[key] = len(parts)
            # the first instant has no step before it
            reach = moved if n else np.zeros_like(moved)
            parts.append(_in_step(sets, states[n], np.flatnonzero(writes[n]), reach))
        which.append(known[key])
    sizes = np.array([len(part[0]) for part in parts], dtype=int)
    first, of = np.cumsum(sizes) - sizes, np.array(which, dtype=int)
    counts = sizes[of]
    owner = np.repeat(np.arange(len(instants)), counts)
    place = np.arange(len(owner)) + np.repeat(first[of] - np.cumsum(counts) + counts, counts)
    thin, memory, gaps = len(step.left), len(sets.units), step.left.shape[1]
    empty = [np.zeros((0, size)) for size in (thin, memory, gaps, thin, memory)]
    rows, reads, spread, pushes, changes = map(np.concatenate, zip(*parts, empty))
    shifts = np.zeros((len(owner), gap_rates.shape[2]))
    if shifts.size:
        shifts = np.einsum("sc,sce->se", spread[place], gap_rates[instants][owner])
    factors, pushes = rows @ step.right, pushes @ step.right
    return Contacts(instants, counts, factors[place], shifts, pushes[place], reads[place], changes[place])


def _in_step(
    sets: RubbingSets, state: np.ndarray, writes: np.ndarray, moved: np.ndarray
) -> tuple[np.ndarray, ...]:
    """Rows on the position before contact acts (s, r), on the memory (s, k) and on free gaps (s, c + k), and
    what they take from the thin forces (s, r) and the memory (s, k), for a step in which forces move the
    position by M.
    """
    push, *found = sets(state, writes)
    inside = np.eye(push.shape[1]) + found[0] @ moved @ push
    directions = np.split(
        np.linalg.solve(inside, np.concatenate(found[:3], axis=1)),
        np.cumsum([part.shape[1] for part in found[:2]]),
        axis=1,
    )
    behind = found[3] @ moved @ push
    rows = [np.concatenate([one, other - behind @ one]) for one, other in zip(directions, found[3:])]
    changes = np.zeros_like(rows[1])
    changes[push.shape[1] + np.arange(len(writes)), writes] = 1.0
    return *rows, np.concatenate([push.T, np.zeros((len(writes), len(push)))]), changes


def _spread(
    w: np.ndarray, rubbing: Rubbing, state: np.ndarray
) -> tuple[np.ndarray, Callable[[np.ndarray], np.ndarray]]:
    """Rows that keep a gap or stick (a,), and what turns columns (c + k, n) into (W_a E)^-T E^T of them."""
    count = rubbing.beside.size
    tangential = state[count:]
    pull = rubbing.kinetic * ((tangential == ALONG) * 1.0 - (tangential == AGAINST))
    slipping = np.flatnonzero(pull)
    pulled, pull = rubbing.rows[slipping], pull[slipping][:, None]
    free = (state != FREE) & np.append(np.ones(count, dtype=bool), tangential == STICKS)
    index = np.flatnonzero(free)

    def drawn(columns: np.ndarray) -> np.ndarray:
        """E^T of columns."""
        result = columns.copy()
        result[pulled] += pull * columns[count + slipping]
        return result[index]

    weight = 1.0 / np.sqrt(np.diagonal(w)[index])
    matrix = weight[:, None] * drawn(w[:, index]) * weight

    def spread(columns: np.ndarray) -> np.ndarray:
        if not len(matrix):  # LAPACK takes none; by itself, for the checks of its wrapper take longer
            return drawn(columns)
        _, _, solved, failed = linalg.lapack.dgesv(matrix, weight[:, None] * drawn(columns))
        if failed:
            raise np.linalg.LinAlgError("the flexibility of the rows in contact is singular")
        return weight[:, None] * solved

    return index, spread

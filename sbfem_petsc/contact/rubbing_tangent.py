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


def rubbing_contacts(
    step: StepConstants, units: np.ndarray, states: np.ndarray, gap_rates: np.ndarray
) -> Contacts:
    """Of steps as they are, of one length.

    Parameters
    ----------
    step : StepConstants
    units : (k,) array
        Those of the slips in the state, m.
    states : (n + 1, c + k) int8 array
        Of the rows at the steps' ends.
    gap_rates : (n + 1, c + k, e) array
        Rates of the free gaps and slips with e parameters.
    """
    condensing = _Condensing(step, units)
    writes = written(states, step.rubbing.beside.size)
    instants = np.flatnonzero((states != FREE).any(axis=1) | writes.any(axis=1))
    known: dict[tuple[bool, bytes, bytes], int] = {}
    sets: list[tuple[np.ndarray, ...]] = []
    which: list[int] = []
    for n in instants:
        key = (n == 0, states[n].tobytes(), writes[n].tobytes())
        if key not in known:
            known[key] = len(sets)
            sets.append(condensing(n == 0, states[n], np.flatnonzero(writes[n])))
        which.append(known[key])
    sizes = np.array([len(item[0]) for item in sets], dtype=int)
    first = np.cumsum(sizes) - sizes
    counts = sizes[which] if sets else sizes
    owner = np.repeat(np.arange(len(instants)), counts)
    place = np.arange(len(owner)) - np.repeat(np.cumsum(counts) - counts, counts)
    place += np.repeat(first[which] if sets else first, counts)
    size = step.right.shape[0], len(units), len(step.left[0])
    empty = [np.zeros((0, size[k])) for k in (0, 1, 0, 1, 2)]
    rows, reads, pushes, changes, spread = map(np.concatenate, zip(*sets, empty))
    shifts = np.einsum("sc,sce->se", spread[place], gap_rates[instants][owner])
    modes = step.right
    return Contacts(
        instants, counts, (rows @ modes)[place], shifts, (pushes @ modes)[place], reads[place], changes[place]
    )


class _Condensing:
    """Condenses sets; arguments are those of `rubbing_contacts`."""

    def __init__(self, step: StepConstants, units: np.ndarray):
        self.left, self.rubbing, self.units = step.left.T, step.rubbing, units
        self.flexibility = step.flexibility[0], step.residual
        values, axes = np.linalg.eigh((step.right * step.coefficients[0, 4]) @ step.right.T)
        root = np.sqrt(np.maximum(values, 1e-15 * values[-1:]))
        self.scaled, self.inverse = axes * root, axes / root

    def __call__(self, first: bool, state: np.ndarray, writes: np.ndarray) -> tuple[np.ndarray, ...]:
        """Rows on the thin position (s, r) and on the memory (s, k), what they add to the thin forces (s, r)
        and to the memory (s, k), and their rows on free gaps (s, c + k): all to be taken off.
        """
        w, left, count = self.flexibility[int(first)], self.left, self.rubbing.beside.size
        index, spread = _spread(w, self.rubbing, state)
        sticking = index >= count
        kept = index[sticking] - count
        force = spread(np.concatenate([left, w[count + writes].T], axis=1))
        thin, along = force[:, : left.shape[1]].T, force[:, left.shape[1] :].T  # (r, a), (writes, a)
        by_position = thin @ left[index]
        by_memory = np.zeros((len(thin), len(self.units)))
        by_memory[:, kept] = -thin[:, sticking] * self.units[kept]
        whole = self.scaled.T @ np.concatenate([by_position @ self.scaled, by_memory], axis=1)
        base, triangle, _ = linalg.qr(whole, mode="economic", pivoting=True, check_finite=False)
        rank = int((np.abs(np.diagonal(triangle)) > LEAST * max(abs(triangle[0, 0]), 1.0)).sum())
        pushes, chosen = self.inverse @ base[:, :rank], base[:, :rank].T @ self.scaled.T
        s = rank + len(writes)
        rows, reads, added = (
            np.zeros((s, len(thin))),
            np.zeros((s, len(self.units))),
            np.zeros((s, len(thin))),
        )
        changes, gaps = np.zeros_like(reads), np.zeros((s, len(w)))
        rows[:rank], reads[:rank], added[:rank] = chosen @ by_position, chosen @ by_memory, pushes.T
        gaps[:rank, index] = chosen @ thin
        number, units = np.arange(rank, s), self.units[writes][:, None]
        rows[rank:] = (along @ left[index] - left[count + writes]) / units
        reads[rank:, kept] = -along[:, sticking] * self.units[kept] / units
        reads[number, writes] += 1.0
        changes[number, writes] = 1.0
        gaps[rank:, index] = along / units
        gaps[number, count + writes] -= 1.0 / units[:, 0]
        return rows, reads, added, changes, gaps


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

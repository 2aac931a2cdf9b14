"""Compiled repetition of a period of steps until a motion repeats itself or comes near one that is known."""

from __future__ import annotations

import numpy as np

from .compiled import compiled
from .marching import _march, add_rows, contact_forces, products

# What a motion has come to; from 0 on the number of a known one.
UNSOLVED, UNSETTLED, REPEATS = -3, -2, -1


def settle(
    coefficients: np.ndarray,
    factors: tuple[np.ndarray, np.ndarray],
    flexibilities: tuple[np.ndarray, np.ndarray],
    tied: np.ndarray,
    *,
    free_gap: np.ndarray,
    state: tuple[np.ndarray, np.ndarray],
    weights: np.ndarray,
    known: tuple[np.ndarray, np.ndarray],
    longest: int,
    tolerance: float,
    limit: int,
) -> tuple[int, int, int]:
    """Repeat a period from a state.

    Parameters
    ----------
    coefficients : (10, m) array
        Of a step, see `marching.march`.
    factors : ((pairs, r), (m, r)) arrays
        C = U V^T.
    flexibilities : ((pairs, pairs), (pairs, pairs)) arrays
        W of a step, and the residual flexibility, which gives the forces at the beginning of a period.
    tied : (pairs,) bool array
    free_gap : (n + 1, pairs) array
        Over the period.
    state : ((m,), (m,)) arrays
        q, v; advanced in place.
    weights : (m,) array
        Of q in the norm of states, rad/s.
    known : ((k, 2 m), (k,)) arrays
        States (weights q, v) at the beginning of a period, and the distance at which each is reached.
    longest : int
        Most periods after which a motion may repeat itself.
    tolerance : float
        Change of the state below which it has.
    limit : int
        Periods at most.

    Returns
    -------
    outcome, periods, repeats : int
        Number of the known state that is reached, or REPEATS, UNSETTLED, UNSOLVED (a contact problem);
        periods done; periods after which the motion repeats itself, 0 unless it does.
    """
    left, right = factors
    arrays = (coefficients, left.T, right.T, *flexibilities, tied, free_gap)
    return _settle(
        *map(np.ascontiguousarray, arrays),
        np.zeros((1, 1)),
        *state,
        weights,
        *known,
        np.zeros((longest + 1, 2 * len(weights))),
        tolerance,
        limit,
    )


@compiled
def _settle(
    coefficients,
    left_rows,
    right_rows,
    flexibility,
    residual,
    tied,
    free_gap,
    unloaded,
    q,
    v,
    weights,
    known,
    radii,
    recent,
    tolerance,
    limit,
):
    steps, pairs = free_gap.shape[0] - 1, free_gap.shape[1]
    m, rank, kept = q.size, left_rows.shape[0], recent.shape[0]
    states, velocities, forces = np.empty((steps, m)), np.empty((steps, m)), np.empty((steps, pairs))
    gap, force, active = np.empty(pairs), np.zeros(pairs), np.zeros(pairs, dtype=np.bool_)
    thin, every = np.empty(rank), np.empty(rank, dtype=np.int64)
    for k in range(rank):
        every[k] = k
    factor, members = np.empty((pairs, pairs)), np.empty(pairs + 1, dtype=np.int64)
    loaded = unloaded[0, 0] != 0.0  # no literal, for which the steps would be compiled once more
    for done in range(limit + 1):
        place = done % kept
        for j in range(m):
            recent[place, j] = weights[j] * q[j]
            recent[place, m + j] = v[j]
        for k in range(radii.size):
            distance = 0.0
            for j in range(2 * m):
                distance += (recent[place, j] - known[k, j]) ** 2
            if distance <= radii[k] ** 2:
                return k, done, 0
        for n in range(1, min(done, kept - 1) + 1):
            change, other = 0.0, (done - n) % kept
            for j in range(2 * m):
                change += (recent[place, j] - recent[other, j]) ** 2
            if change <= tolerance**2:
                return -1, done, n
        if done == limit:
            break
        touches = False
        for i in range(pairs):
            gap[i] = free_gap[0, i]
            force[i] = 0.0
        products(right_rows, q, rank, m, thin)
        add_rows(left_rows, every, thin, rank, pairs, gap)
        for i in range(pairs):
            active[i] = tied[i] or gap[i] < 0.0
            touches |= active[i]
        if touches:
            members[pairs] = -1
            if contact_forces(residual, gap, tied, active, factor, members, force) < 0:
                return -3, done, 0
        reached, _ = _march(
            coefficients,
            left_rows,
            right_rows,
            flexibility,
            tied,
            unloaded,
            free_gap,
            loaded,
            q,
            v,
            force,
            active,
            states,
            velocities,
            forces,
        )
        if reached < steps:
            return -3, done, 0
    return -2, limit, 0

"""Compiled time steps of a reduced model with contact.

One step is linear in the modal forces: with per-mode coefficients the state advances as
q1 = aqq q + aqv v + bq p0 + dq p1 + cq (r0 + r1), v1 = avq q + avv v + bv p0 + dv p1 + cv (r0 + r1), where p
are the modal forces of the loads at both ends and r = C^T force those of contact. The gap at the step's end
is W force + free gap with the constant W = C diag(cq) C^T + R.

The kernels are plain loops over scalars of contiguous arrays: array expressions, slices and linear algebra in
them would take seconds to compile.
"""

from __future__ import annotations

import numpy as np
from scipy import linalg

from .compiled import compiled

# Full exchanges of the active set that may pass without fewer wrong signs before single exchanges by index
# take over; Judice and Pires (1994) show that this ends for every positive definite W.
PATIENCE = 5
# Singular values of C below this share of the largest are those of rounding.
ROUND_OFF = 1e-12


@compiled
def contact_forces(flexibility, gap, tied, active, factor, members, force):
    """Solve 0 <= force _|_ W force + gap >= 0, and W force + gap = 0 in tied rows, by block principal
    pivoting from the active set of the step before, which holds the tied rows.

    `active` and the Cholesky factor of W over its `members`, mirrored above the diagonal, are kept between
    steps; rows that join stand behind the others, so that those before the first one that leaves stay as they
    are. members (n + 1,) ends with their number, -1 where nothing is factorised. Returns the exchanges of the
    active set, -1 if the iteration did not end or W is not definite.
    """
    n = gap.size
    solved, free = np.empty(n), np.empty(n)
    count = members[n]
    kept = count
    if count < 0:
        count = kept = 0
        for i in range(n):
            if active[i]:
                members[count] = i
                count += 1
    best, patience, exchange = n + 1, PATIENCE, 0
    while exchange < 100 + 20 * n:
        for i in range(kept, count):
            for j in range(i + 1):
                factor[i, j] = flexibility[members[i], members[j]]
            for j in range(i):
                entry = factor[i, j] / factor[j, j]
                factor[i, j] = entry
                factor[j, i] = entry
                for k in range(j + 1, i + 1):
                    factor[i, k] -= entry * factor[j, k]
            if not factor[i, i] > 0.0:
                members[n] = -1
                return -1
            factor[i, i] = np.sqrt(factor[i, i])
        for i in range(count):
            solved[i] = -gap[members[i]]
        for k in range(count):
            entry = solved[k] / factor[k, k]
            solved[k] = entry
            for i in range(k + 1, count):
                solved[i] -= entry * factor[k, i]
        for k in range(count - 1, -1, -1):
            entry = solved[k] / factor[k, k]
            solved[k] = entry
            for i in range(k):
                solved[i] -= entry * factor[k, i]
        for i in range(n):
            force[i] = 0.0
            free[i] = gap[i]
        for k in range(count):
            entry = solved[k]
            force[members[k]] = entry
            for i in range(n):
                free[i] += entry * flexibility[members[k], i]
        # an exchange of all rows with a wrong sign; `last` is what a single one would exchange
        infeasible, last = 0, -1
        for i in range(n):
            if (force[i] < 0.0 and not tied[i]) if active[i] else free[i] < 0.0:
                active[i] = not active[i]
                infeasible += 1
                last = i
        if infeasible == 0:
            members[n] = count
            return exchange
        if infeasible < best:
            best, patience = infeasible, PATIENCE
        else:
            patience -= 1
        if patience <= 0:
            # back to where the exchange began, but for the last row: the members tell
            for i in range(n):
                if i != last:
                    active[i] = False
            for k in range(count):
                if members[k] != last:
                    active[members[k]] = True
        former, count, kept = count, 0, count
        for i in range(n):
            free[i] = 1.0
        for k in range(former):
            i = members[k]
            free[i] = 0.0
            if active[i]:
                members[count] = i
                count += 1
            elif kept > count:
                kept = count
        for i in range(n):
            if active[i] and free[i] > 0.0:
                members[count] = i
                count += 1
        exchange += 1
    members[n] = -1
    return -1


def thin_factors(rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """U (pairs, r) and V (m, r) with rows = U V^T to round-off; V's columns are orthonormal."""
    if rows.size == 0:
        return np.zeros((rows.shape[0], 0)), np.zeros((rows.shape[1], 0))
    left, values, right = linalg.svd(rows, full_matrices=False)
    rank = int((values > ROUND_OFF * values[:1]).sum())
    return np.ascontiguousarray(left[:, :rank] * values[:rank]), np.ascontiguousarray(right[:rank].T)


def march(
    coefficients: np.ndarray,
    factors: tuple[np.ndarray, np.ndarray],
    flexibility: np.ndarray,
    tied: np.ndarray,
    *,
    external: np.ndarray,
    free_gap: np.ndarray,
    state: tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray],
    history: tuple[np.ndarray, np.ndarray, np.ndarray],
) -> tuple[int, int]:
    """Advance a reduced model over several steps.

    Parameters
    ----------
    coefficients : (10, m) array
        aqq, aqv, bq, dq, cq, avq, avv, bv, dv, cv of each mode.
    factors : ((pairs, r), (m, r)) arrays
        C = U V^T, gaps of the modes, see `thin_factors`.
    flexibility : (pairs, pairs) array
        W.
    tied : (pairs,) bool array
        See `law.RowLaws`.
    external : (n + 1, m) array
        Modal forces of the loads at the steps' ends.
    free_gap : (n + 1, pairs) array
        Initial gaps and the residual flexibility's share of the loads.
    state : ((m,), (m,), (pairs,), (pairs,) bool) arrays
        q, v, contact forces and rows in contact, tied ones included; advanced in place.
    history : ((n, m), (n, m), (n, pairs)) contiguous arrays
        Filled with q, v and the contact forces after each step.

    Returns
    -------
    steps, exchanges : int
        Steps done (fewer than n: a contact problem was not solved) and exchanges of active sets in all.
    """
    left, right = factors
    arrays = (coefficients, left.T, right, right.T, flexibility, tied, external, free_gap)
    loaded = bool(external.any())
    steps, exchanges = _march(*map(np.ascontiguousarray, arrays), loaded, *state, *history)
    return steps, exchanges


@compiled
def _march(
    coefficients,
    left_rows,
    right,
    right_rows,
    flexibility,
    tied,
    external,
    free_gap,
    loaded,
    q,
    v,
    force,
    active,
    states,
    velocities,
    forces,
):
    # both layouts of V: the long index last where it is the inner one
    steps, m = states.shape
    rank, pairs = left_rows.shape
    factor, members = np.empty((pairs, pairs)), np.empty(pairs + 1, dtype=np.int64)
    members[pairs] = -1
    gap, thin, pull = np.empty(pairs), np.empty(rank), np.empty(m)
    exchanges, pulled = 0, True
    for step in range(-1, steps):
        if step >= 0:
            for j in range(m):
                position = (
                    coefficients[0, j] * q[j] + coefficients[1, j] * v[j] + coefficients[4, j] * pull[j]
                )
                v[j] = coefficients[5, j] * q[j] + coefficients[6, j] * v[j] + coefficients[9, j] * pull[j]
                q[j] = position
            if loaded:
                for j in range(m):
                    before, following = external[step, j], external[step + 1, j]
                    q[j] += coefficients[2, j] * before + coefficients[3, j] * following
                    v[j] += coefficients[7, j] * before + coefficients[8, j] * following
            for k in range(rank):
                thin[k] = 0.0
            for j in range(m):
                for k in range(rank):
                    thin[k] += right[j, k] * q[j]
            for i in range(pairs):
                gap[i] = free_gap[step + 1, i]
            for k in range(rank):
                for i in range(pairs):
                    gap[i] += left_rows[k, i] * thin[k]
            pulled = members[pairs] != 0
            for i in range(pairs):
                pulled |= gap[i] < 0.0
            if pulled:
                exchange = contact_forces(flexibility, gap, tied, active, factor, members, force)
                if exchange < 0:
                    return step, exchanges
                exchanges += exchange
        if pulled:
            # modal forces of contact; before the first step those of the state that is given
            for j in range(m):
                pull[j] = 0.0
            for k in range(rank):
                total = 0.0
                for i in range(pairs):
                    total += left_rows[k, i] * force[i]
                for j in range(m):
                    pull[j] += right_rows[k, j] * total
            if step >= 0:
                for j in range(m):
                    q[j] += coefficients[4, j] * pull[j]
                    v[j] += coefficients[9, j] * pull[j]
        if step >= 0:
            for j in range(m):
                states[step, j] = q[j]
                velocities[step, j] = v[j]
            for i in range(pairs):
                forces[step, i] = force[i]
    return steps, exchanges

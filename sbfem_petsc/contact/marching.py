"""Compiled time steps of a reduced model with unilateral contact.

One step is linear in the modal forces: with per-mode coefficients the state advances as
q1 = aqq q + aqv v + bq p0 + dq p1 + cq (r0 + r1), v1 = avq q + avv v + bv p0 + dv p1 + cv (r0 + r1), where p
are the modal forces of the loads at both ends and r = C^T force those of contact. The gap at the step's end
is W force + free gap with the constant W = C diag(cq) C^T + R.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from scipy import linalg

# Full exchanges of the active set that may pass without fewer wrong signs before single exchanges by index
# take over; Judice and Pires (1994) show that this ends for every positive definite W.
PATIENCE = 5
# Singular values of C below this share of the largest are those of rounding.
ROUND_OFF = 1e-15


@njit(cache=True)
def _factorise(flexibility, active, factor, members):
    """Cholesky factor of W over the active pairs, into `factor` and `members`; the number of them, or -1 if W
    is not definite.
    """
    count = 0
    for i in range(active.size):
        if active[i]:
            members[count] = i
            count += 1
    for i in range(count):
        for j in range(i + 1):
            total = flexibility[members[i], members[j]]
            for k in range(j):
                total -= factor[i, k] * factor[j, k]
            if i == j:
                if total <= 0.0:
                    return -1
                factor[i, i] = np.sqrt(total)
            else:
                factor[i, j] = total / factor[j, j]
    return count


@njit(cache=True)
def contact_forces(flexibility, gap, tied, active, factor, members, count, force):
    """Solve 0 <= force _|_ W force + gap >= 0, and W force + gap = 0 in tied rows, by block principal
    pivoting from the active set of the step before, which holds the tied rows.

    `active`, `factor`, `members` and `count` (of members, -1: nothing factorised) are kept between steps.
    Returns (count, exchanges); exchanges is -1 if the iteration did not end.
    """
    n = gap.size
    if count < 0:
        count = _factorise(flexibility, active, factor, members)
        if count < 0:
            return -1, -1
    best, patience = n + 1, PATIENCE
    wrong = np.empty(n, dtype=np.bool_)
    for exchange in range(100 + 20 * n):
        force[:] = 0.0
        for i in range(count):
            total = -gap[members[i]]
            for k in range(i):
                total -= factor[i, k] * force[members[k]]
            force[members[i]] = total / factor[i, i]
        for i in range(count - 1, -1, -1):
            total = force[members[i]]
            for k in range(i + 1, count):
                total -= factor[k, i] * force[members[k]]
            force[members[i]] = total / factor[i, i]
        infeasible, last = 0, -1
        for i in range(n):
            if active[i]:
                wrong[i] = force[i] < 0.0 and not tied[i]
            else:
                total = gap[i]
                for k in range(count):
                    total += flexibility[i, members[k]] * force[members[k]]
                wrong[i] = total < 0.0
            if wrong[i]:
                infeasible += 1
                last = i
        if infeasible == 0:
            return count, exchange
        if infeasible < best:
            best, patience = infeasible, PATIENCE
        else:
            patience -= 1
        if patience > 0:
            for i in range(n):
                if wrong[i]:
                    active[i] = not active[i]
        else:
            active[last] = not active[last]
        count = _factorise(flexibility, active, factor, members)
        if count < 0:
            return -1, -1
    return -1, -1


def thin_factors(rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """U (pairs, r) and V (m, r) with rows = U V^T to round-off; V's columns are orthonormal."""
    if rows.size == 0:
        return np.zeros((rows.shape[0], 0)), np.zeros((rows.shape[1], 0))
    left, values, right = linalg.svd(rows, full_matrices=False)
    rank = int((values > ROUND_OFF * values[:1]).sum())
    return np.ascontiguousarray(left[:, :rank] * values[:rank]), np.ascontiguousarray(right[:rank].T)


@njit(cache=True)
def march(
    coefficients,
    left,
    right,
    flexibility,
    tied,
    external,
    free_gap,
    q,
    v,
    force,
    active,
    states,
    velocities,
    forces,
):
    """Advance a reduced model over several steps.

    Parameters
    ----------
    coefficients : (10, m) array
        aqq, aqv, bq, dq, cq, avq, avv, bv, dv, cv of each mode.
    left, right : (pairs, r), (m, r) arrays
        C = left right^T, gaps of the modes, see `thin_factors`.
    flexibility : (pairs, pairs) array
        W.
    tied : (pairs,) bool array
        See `law.RowLaws`.
    external : (n + 1, m) array
        Modal forces of the loads at the steps' ends.
    free_gap : (n + 1, pairs) array
        Initial gaps and the residual flexibility's share of the loads.
    q, v : (m,) arrays
        State, advanced in place.
    force : (pairs,) array
        Contact forces, advanced in place.
    active : (pairs,) bool array
        Tied rows included.
    states, velocities : (n, m) arrays
    forces : (n, pairs) array
        Filled with the state after each step.

    Returns
    -------
    steps, exchanges : int
        Steps done (fewer than n: a contact problem was not solved) and exchanges of active sets in all.
    """
    steps, m = states.shape
    pairs, rank = left.shape
    aqq, aqv, bq, dq, cq, avq, avv, bv, dv, cv = coefficients
    factor = np.empty((pairs, pairs))
    members = np.empty(pairs, dtype=np.int64)
    gap = np.empty(pairs)
    # with the long index last, inner loops run on vector registers
    left_rows, right_rows = np.ascontiguousarray(left.T), np.ascontiguousarray(right.T)
    thin = np.zeros(rank)
    for i in range(pairs):
        for k in range(rank):
            thin[k] += left[i, k] * force[i]
    pull = np.zeros(m)
    for k in range(rank):
        for j in range(m):
            pull[j] += right_rows[k, j] * thin[k]
    count, exchanges = -1, 0
    for step in range(steps):
        thin[:] = 0.0
        for j in range(m):
            before, following = external[step, j], external[step + 1, j]
            position = aqq[j] * q[j] + aqv[j] * v[j] + bq[j] * before + dq[j] * following + cq[j] * pull[j]
            v[j] = avq[j] * q[j] + avv[j] * v[j] + bv[j] * before + dv[j] * following + cv[j] * pull[j]
            q[j] = position
            for k in range(rank):
                thin[k] += right[j, k] * position
        touching = count != 0
        gap[:] = free_gap[step + 1]
        for k in range(rank):
            for i in range(pairs):
                gap[i] += left_rows[k, i] * thin[k]
        for i in range(pairs):
            touching |= gap[i] < 0.0
        if touching:
            count, exchange = contact_forces(flexibility, gap, tied, active, factor, members, count, force)
            if exchange < 0:
                return step, exchanges
            exchanges += exchange
            thin[:] = 0.0
            for i in range(count):
                value = force[members[i]]
                for k in range(rank):
                    thin[k] += left[members[i], k] * value
            pull[:] = 0.0
            for k in range(rank):
                for j in range(m):
                    pull[j] += right_rows[k, j] * thin[k]
            for j in range(m):
                q[j] += cq[j] * pull[j]
                v[j] += cv[j] * pull[j]
        states[step] = q
        velocities[step] = v
        forces[step] = force
    return steps, exchanges

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

from .compiled import compiled, compiled_sums

# Full exchanges of the active set that may pass without fewer wrong signs before single exchanges by index
# take over; Judice and Pires (1994) show that this ends for every positive definite W.
PATIENCE = 5
# Numbers that a loop takes at a time at most: four vector registers of four.
WHOLE = 16


@compiled_sums
def products(rows, vector, count, width, result):
    """The first `count` rows, as far as `width`, times a vector."""
    for k in range(count):
        total = 0.0
        for i in range(width):
            total += rows[k, i] * vector[i]
        result[k] = total


@compiled
def add_rows(rows, chosen, factors, count, width, result):
    """Add `count` chosen rows as far as `width`, each times its factor: four at a time, so that the result is
    read and written less often.
    """
    for k in range(0, count - 3, 4):
        one, two, three, four = factors[k], factors[k + 1], factors[k + 2], factors[k + 3]
        first, second, third, fourth = chosen[k], chosen[k + 1], chosen[k + 2], chosen[k + 3]
        for i in range(width):
            result[i] = (
                result[i]
                + one * rows[first, i]
                + two * rows[second, i]
                + three * rows[third, i]
                + four * rows[fourth, i]
            )
    for k in range(count - count % 4, count):
        one, first = factors[k], chosen[k]
        for i in range(width):
            result[i] += one * rows[first, i]


@compiled
def contact_forces(flexibility, gap, tied, active, factor, members, force):
    """Solve 0 <= force _|_ W force + gap >= 0, and W force + gap = 0 in tied rows, by block principal
    pivoting from the active set of the step before, which holds the tied rows.

    `active` and L^-1, where W = L L^T over its `members`, are kept between steps; rows that join stand behind
    the others, so that those before the first one that leaves stay as they are. The inverse is applied
    without waiting for one unknown to find the next. members (n + 1,) ends with their number, -1 where
    nothing is factorised. Returns the exchanges of the active set, -1 if the iteration did not end or W is
    not definite.
    """
    n = gap.size
    solved, free, every = np.empty(n), np.empty(n), np.empty(n, dtype=np.int64)
    for i in range(n):
        every[i] = i
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
        # loops over whole vector registers: what stands beyond `count` is zero
        width = min(n, (count + WHOLE - 1) // WHOLE * WHOLE)
        for i in range(kept, count):
            row = members[i]
            for k in range(i):
                free[k] = flexibility[row, members[k]]
            for k in range(n):
                factor[i, k] = 0.0
            products(factor, free, i, i, solved)
            left = flexibility[row, row]
            for k in range(i):
                left -= solved[k] ** 2
            if not left > 0.0:
                members[n] = -1
                return -1
            scale = 1.0 / np.sqrt(left)
            for k in range(i):
                solved[k] *= -scale
            add_rows(factor, every, solved, i, i, factor[i])
            factor[i, i] = scale
        for i in range(count):
            free[i] = -gap[members[i]]
        for i in range(count, width):
            free[i] = 0.0
        for i in range(width):
            solved[i] = 0.0
        products(factor, free, count, width, force)
        add_rows(factor, every, force, count, width, solved)
        for i in range(n):
            force[i] = 0.0
            free[i] = gap[i]
        for k in range(count):
            force[members[k]] = solved[k]
        add_rows(flexibility, members, solved, count, n, free)
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
        C = U V^T, gaps of the modes, see `closed_sets.thin_factors`.
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
    arrays = (coefficients, left.T, right.T, flexibility, tied, external, free_gap)
    loaded = bool(external.any())
    steps, exchanges = _march(*map(np.ascontiguousarray, arrays), loaded, *state, *history)
    return steps, exchanges


@compiled
def _march(
    coefficients,
    left_rows,
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
    steps, m = states.shape
    rank, pairs = left_rows.shape
    factor, members = np.empty((pairs, pairs)), np.empty(pairs + 1, dtype=np.int64)
    members[pairs] = -1
    every = np.empty(rank, dtype=np.int64)
    for k in range(rank):
        every[k] = k
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
            products(right_rows, q, rank, m, thin)
            for i in range(pairs):
                gap[i] = free_gap[step + 1, i]
            add_rows(left_rows, every, thin, rank, pairs, gap)
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
            products(left_rows, force, rank, pairs, thin)
            for j in range(m):
                pull[j] = 0.0
            add_rows(right_rows, every, thin, rank, m, pull)
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

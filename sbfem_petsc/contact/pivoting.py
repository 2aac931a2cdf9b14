"""Compiled solve of the contact problem of a step by block principal pivoting, and loops that steps share.

The kernels are plain loops over scalars of contiguous arrays that are given: array expressions, slices,
linear algebra and new arrays in them would take seconds to compile.
"""

from __future__ import annotations

import math

import numpy as np

from .compiled import compiled_apart, inner_loops, inner_sums
from .law import FREE, PRESSED, PULLED, ROUND_OFF, Table
from .problem import Problem

# Full exchanges of the active set that may pass without fewer wrong signs before single exchanges by index
# take over; Judice and Pires (1994) show that this ends for every positive definite W.
PATIENCE = 5
# Numbers that a loop takes at a time at most: four vector registers of four.
WHOLE = 16


@inner_sums
def products(
    rows: np.ndarray, vector: np.ndarray, count: int, reach: tuple[int, int], result: np.ndarray
) -> None:
    """The first `count` rows times a vector, as far as `reach` = (first, width): that of the rows of a lower
    triangle grows from the first to the width of the last by whole registers.
    """
    first, width = reach
    for k in range(count):
        total = 0.0
        for i in range(min(first + k // WHOLE * WHOLE, width)):
            total += rows[k, i] * vector[i]
        result[k] = total


@inner_loops
def add_rows(
    rows: np.ndarray,
    chosen: np.ndarray,
    factors: np.ndarray,
    count: int,
    reach: tuple[int, int],
    result: np.ndarray,
) -> None:
    """Add `count` chosen rows, as far as `products` reads them, each times its factor: four at a time, so
    that the result is read and written less often.
    """
    first, width = reach
    for k in range(0, count - 3, 4):
        one, two, three, four = factors[k], factors[k + 1], factors[k + 2], factors[k + 3]
        a, b, c, d = chosen[k], chosen[k + 1], chosen[k + 2], chosen[k + 3]
        for i in range(min(first + (k + 3) // WHOLE * WHOLE, width)):
            result[i] = (
                result[i] + one * rows[a, i] + two * rows[b, i] + three * rows[c, i] + four * rows[d, i]
            )
    for k in range(count - count % 4, count):
        one, a = factors[k], chosen[k]
        for i in range(width):
            result[i] += one * rows[a, i]


@inner_loops
def _arrange(state: np.ndarray, members: np.ndarray, joins: np.ndarray) -> int:
    """Put the rows that are held in the order of the factor; returns how many are where they were, before
    the first one that left.
    """
    n = state.size
    kept, count = max(members[n], 0), 0
    for i in range(n):
        joins[i] = 1.0
    for k in range(kept):
        i = members[k]
        joins[i] = 0.0
        if state[i] != FREE:
            members[count] = i
            count += 1
        elif kept > count:
            kept = count
    for i in range(n):
        if state[i] != FREE and joins[i] > 0.0:
            members[count] = i
            count += 1
    members[n] = count
    return kept


@inner_loops
def caught(laws: Table, row: int, gap: float) -> int:
    """State that a free row with some gap goes on to."""
    if gap < laws.least[FREE, row]:
        return PRESSED
    return PULLED if gap > laws.most[FREE, row] else FREE


@inner_loops
def _factorise(problem: Problem) -> bool:
    """Factorise the rows that are held, as far as they are not; whether W is definite there."""
    flexibility, state, sets = problem.flexibility, problem.state, problem.sets
    inverse, members, solved, free, every = sets.inverse, sets.members, sets.solved, sets.free, sets.every
    n = every.size
    for i in range(_arrange(state, members, free), members[n]):
        row = members[i]
        for k in range(i):
            free[k] = flexibility[row, members[k]]
        for k in range(n):
            inverse[i, k] = 0.0
        products(inverse, free, i, (min(WHOLE, i), i), solved)
        left = flexibility[row, row]
        for k in range(i):
            left -= solved[k] * solved[k]
        if not left > 0.0:
            members[n] = -1
            return False
        scale = 1.0 / math.sqrt(left)
        for k in range(i):
            solved[k] *= -scale
        add_rows(inverse, every, solved, i, (min(WHOLE, i), i), inverse[i])
        inverse[i, i] = scale
    return True


@inner_sums
def _solve(
    flexibility: np.ndarray,
    gap: np.ndarray,
    held: tuple[Table, np.ndarray],
    factor: tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray],
    force: np.ndarray,
) -> None:
    """Forces that close gaps of the members, and in `free` the gaps of free rows. It is not taken in, and is
    given the arrays it needs alone.
    """
    (laws, state), (inverse, members, solved, free, every) = held, factor
    n = every.size
    count = members[n]
    # loops over whole vector registers: what stands beyond `count` is zero
    width = min(n, (count + WHOLE - 1) // WHOLE * WHOLE)
    for i in range(count):
        row = members[i]
        free[i] = laws.place[state[row], row] - gap[row]
    for i in range(count, width):
        free[i] = 0.0
    for i in range(width):
        solved[i] = 0.0
    products(inverse, free, count, (min(WHOLE, width), width), force)
    add_rows(inverse, every, force, count, (min(WHOLE, width), width), solved)
    for i in range(n):
        force[i] = 0.0
        free[i] = gap[i]
    for k in range(count):
        force[members[k]] = solved[k]
    if 2 * count < n:
        add_rows(flexibility, members, solved, count, (n, n), free)
        return
    for i in range(n):  # of most rows held the gaps of the others are fewer
        if state[i] == FREE:
            moved = 0.0
            for k in range(n):
                moved += flexibility[i, k] * force[k]
            free[i] += moved


@inner_loops
def _by_rounding(problem: Problem, row: int) -> bool:
    """Whether it is by rounding alone that a free row is beyond its bounds."""
    laws, sets, size = problem.laws, problem.sets, abs(problem.free[row])
    for k in range(sets.members[problem.free.size]):
        size += abs(problem.flexibility[sets.members[k], row] * sets.solved[k])
    beyond = max(laws.least[FREE, row] - sets.free[row], sets.free[row] - laws.most[FREE, row])
    return beyond < ROUND_OFF * size


@inner_loops
def _exchange(problem: Problem, single: bool) -> int:
    """Exchange all rows beyond their bounds, or the last of them alone; their number. Of single exchanges
    rows are left out that neither touch nor are apart, which would come and go for ever.
    """
    _, _, _, laws, _, state, sets, force = problem
    members, free, infeasible, last = sets.members, sets.free, 0, -1
    for i in range(state.size):
        now = caught(laws, i, free[i])
        if state[i] != FREE or now == FREE:
            continue
        if single and _by_rounding(problem, i):
            continue
        infeasible, last = infeasible + 1, i
        if not single:
            state[i] = now
    for k in range(members[state.size]):
        row, now = members[k], state[members[k]]
        if force[row] < laws.least[now, row] or force[row] > laws.most[now, row]:
            infeasible, last = infeasible + 1, max(last, row)
            if not single:
                state[row] = FREE
    if single and last >= 0:
        state[last] = FREE if state[last] != FREE else caught(laws, last, free[last])
    return infeasible


@compiled_apart
def contact_forces(problem: Problem) -> int:
    """Solve a contact problem without friction by block principal pivoting.

    What is kept from step to step is L^-1 of W = L L^T over the rows in contact, the members: those that join
    stand behind the others, so that those before the first one that leaves stay as they are. It is applied
    without waiting for one unknown to find the next. `sets.free` is left with the gaps of free rows. Returns
    the exchanges of the active set, -1 if the iteration did not end or W is not definite.
    """
    flexibility, gap, _, laws, _, state, sets, force = problem
    n, factor = gap.size, (sets.inverse, sets.members, sets.solved, sets.free, sets.every)
    best, patience, exchange = n + 1, PATIENCE, 0
    while exchange < 100 + 20 * n:
        if not _factorise(problem):
            return -1
        _solve(flexibility, gap, (laws, state), factor, force)
        infeasible = _exchange(problem, patience <= 0)
        if infeasible == 0:
            return exchange
        patience = PATIENCE if infeasible < best else patience - 1
        best = min(best, infeasible)
        exchange += 1
    sets.members[n] = -1
    return -1

"""Compiled solve of the contact problem of a step with friction, from the states of the step before.

The same exchanges of states, and sweeps of Gauss-Seidel where sets repeat, as in `friction`, where they are
explained; there stands Lemke's method behind them. Unknowns of a set are the forces of held normal rows and
of sticking tangential ones; where the states are those of the step before, its factors are too. How kernels
are written, `pivoting` tells.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from .compiled import compiled_loops, inner_loops, inner_sums
from .friction import AGAINST, ALONG, STICKS, Friction
from .law import FREE, PRESSED, PULLED, ROUND_OFF, Table
from .pivoting import add_rows, caught

# Exchanges before sweeps, sweeps before the next exchanges, and how often; rounding of forces.
_MAXIMUM, _SWEEPS, _ROUNDS, _ROUNDING = 40, 20, 20, 1e-12


class Rubbing(NamedTuple):
    """Tangential rows (k), behind the normal ones (c); `Friction` for kernels.

    Attributes
    ----------
    rows : (k,) int array
        The normal row of each.
    beside : (c,) int array
        The tangential row of each among all rows, -1 where there is none.
    kinetic, static : (k,) arrays
        Coefficients; zero of rows that no force moves.
    """

    rows: np.ndarray
    beside: np.ndarray
    kinetic: np.ndarray
    static: np.ndarray


class Sets(NamedTuple):
    """Factors of the set of the step before, and room to work in, of n rows.

    Attributes
    ----------
    factor : (n, n) array
        L and U.
    known : (n + 1,) int8 array
        States whose set is factorised; the last entry is 1 if any is.
    members : (n + 2,) int array
        Unknowns in order, rows that slip behind them; the last entries are their numbers.
    pivots : (n + 1,) int array
    right : (n + 1,) array
        Forces in the order of the members; the last entry is their rounding.
    free : (n,) array
        Gaps.
    following : (n,) int8 array
    swept : (n,) array
        Forces of Gauss-Seidel.
    seen : (_MAXIMUM,) int array
        Sums that tell sets apart.
    """

    factor: np.ndarray
    known: np.ndarray
    members: np.ndarray
    pivots: np.ndarray
    right: np.ndarray
    free: np.ndarray
    following: np.ndarray
    swept: np.ndarray
    seen: np.ndarray


# Where nothing rubs, but for `beside`.
NOTHING = Rubbing(np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64), np.zeros(0), np.zeros(0))


def rubbing_of(friction: Friction, flexibility: np.ndarray, count: int) -> Rubbing:
    """For kernels, of rows with a flexibility of which so many are normal ones."""
    beside = np.full(count, -1, dtype=np.int64)
    moves = np.diag(flexibility) > 0.0
    rubs = moves[count:] & moves[friction.rows]
    rows = np.ascontiguousarray(friction.rows, dtype=np.int64)
    beside[rows] = count + np.arange(len(rows))
    return Rubbing(rows, beside, np.where(rubs, friction.kinetic, 0.0), np.where(rubs, friction.static, 0.0))


def rubbing_room(rows: int) -> tuple[np.ndarray, ...]:
    """Room of `Sets` that sets of any step share: from `right` on."""
    following, seen = np.zeros(rows, dtype=np.int8), np.zeros(_MAXIMUM, dtype=np.int64)
    return np.empty(rows + 1), np.empty(rows), following, np.empty(rows), seen


# Where nothing rubs.
NO_ROOM = rubbing_room(0)


def empty_sets(rows: int) -> Sets:
    """Nothing is factorised yet."""
    known, members = np.zeros(rows + 1, dtype=np.int8), np.zeros(rows + 2, dtype=np.int64)
    return Sets(
        np.empty((rows, rows)), known, members, np.zeros(rows + 1, dtype=np.int64), *rubbing_room(rows)
    )


@inner_loops
def _pull(rubbing: Rubbing, state: np.ndarray, row: int) -> float:
    """Friction of a tangential row that slips, per pressure; 0 of others."""
    count = rubbing.beside.size
    if state[row] == ALONG:
        return rubbing.kinetic[row - count]
    return -rubbing.kinetic[row - count] if state[row] == AGAINST else 0.0


@inner_loops
def _set(flexibility: np.ndarray, rubbing: Rubbing, state: np.ndarray, sets: Sets) -> int:
    """Put the unknowns of a set in order, and its matrix, of rows and columns of one size, in the place of
    the factors; their number.
    """
    factor, members, count = sets.factor, sets.members, rubbing.beside.size
    n, unknowns = state.size, 0
    for i in range(n):
        if state[i] != FREE and (i < count or state[i] == STICKS):
            members[unknowns] = i
            unknowns += 1
    total = unknowns
    for i in range(count, n):
        if _pull(rubbing, state, i) != 0.0:
            members[total] = i
            total += 1
    members[n], members[n + 1] = unknowns, total
    for b in range(unknowns):
        column = members[b]
        scale, pull, beside = 1.0 / math.sqrt(flexibility[column, column]), 0.0, column
        if column < count and rubbing.beside[column] >= 0:
            beside = rubbing.beside[column]
            pull = _pull(rubbing, state, beside)
        for a in range(unknowns):
            row = members[a]
            value = flexibility[column, row] + pull * flexibility[beside, row]
            factor[a, b] = scale * value / math.sqrt(flexibility[row, row])
    return unknowns


@inner_loops
def _factorise(flexibility: np.ndarray, rubbing: Rubbing, state: np.ndarray, sets: Sets) -> bool:
    """Factorise the set of some states with pivots, unless that is done; whether it is regular."""
    factor, known, pivots, n = sets.factor, sets.known, sets.pivots, state.size
    same = known[n] == 1
    for i in range(n):
        same &= known[i] == state[i]
    if same:
        return True
    unknowns = _set(flexibility, rubbing, state, sets)
    known[n] = 0
    for k in range(unknowns):
        best = k
        for i in range(k + 1, unknowns):
            if abs(factor[i, k]) > abs(factor[best, k]):
                best = i
        pivots[k] = best
        if best != k:
            for j in range(unknowns):
                held = factor[k, j]
                factor[k, j] = factor[best, j]
                factor[best, j] = held
        if not abs(factor[k, k]) > ROUND_OFF:
            return False
        inverse = 1.0 / factor[k, k]
        for i in range(k + 1, unknowns):
            share = factor[i, k] * inverse
            factor[i, k] = share
            if share != 0.0:
                for j in range(k + 1, unknowns):
                    factor[i, j] -= share * factor[k, j]
    for i in range(n):
        known[i] = state[i]
    known[n] = 1
    return True


@inner_sums
def _substitute(factor: np.ndarray, pivots: np.ndarray, count: int, right: np.ndarray) -> None:
    """Solve with L and U in place."""
    for k in range(count):
        other = pivots[k]
        held = right[k]
        right[k] = right[other]
        right[other] = held
    for k in range(1, count):
        total = 0.0
        for j in range(k):
            total += factor[k, j] * right[j]
        right[k] -= total
    for k in range(count - 1, -1, -1):
        total = 0.0
        for j in range(k + 1, count):
            total += factor[k, j] * right[j]
        right[k] = (right[k] - total) / factor[k, k]


@inner_loops
def _solve(
    flexibility: np.ndarray,
    gap: tuple[np.ndarray, np.ndarray],
    held: tuple[Table, Rubbing, np.ndarray],
    sets: Sets,
    force: np.ndarray,
) -> None:
    """Forces of a set, and in `free` the gaps of all rows; `gap` are those without forces, and before."""
    (laws, rubbing, state), members, right, free = held, sets.members, sets.right, sets.free
    without, before = gap
    n, count = without.size, rubbing.beside.size
    unknowns, total = members[n], members[n + 1]
    for a in range(unknowns):
        row = members[a]
        kept = laws.place[state[row], row] if row < count else before[row]
        right[a] = (kept - without[row]) / math.sqrt(flexibility[row, row])
    _substitute(sets.factor, sets.pivots, unknowns, right)
    for i in range(n):
        force[i], free[i] = 0.0, without[i]
    for a in range(unknowns):
        right[a] /= math.sqrt(flexibility[members[a], members[a]])
        force[members[a]] = right[a]
    for a in range(unknowns, total):
        row = members[a]
        right[a] = _pull(rubbing, state, row) * force[rubbing.rows[row - count]]
        force[row] = right[a]
    add_rows(flexibility, members, right, total, (n, n), free)


@inner_sums
def _rounding(flexibility: np.ndarray, without: np.ndarray, force: np.ndarray, row: int) -> float:
    """Of a gap."""
    total = abs(without[row])
    for i in range(force.size):
        total += abs(flexibility[row, i] * force[i])
    return 10.0 * ROUND_OFF * total


@inner_loops
def _normal(
    flexibility: np.ndarray,
    without: np.ndarray,
    laws: Table,
    of: tuple[int, int],
    sets: Sets,
    force: np.ndarray,
) -> int:
    """State that a normal row, `of` a state and with a number, goes on to."""
    now, row = of
    if now != FREE:
        pull = sets.right[sets.right.size - 1]
        let = force[row] < laws.least[now, row] - pull or force[row] > laws.most[now, row] + pull
        return FREE if let else now
    if not flexibility[row, row] > 0.0:
        return FREE
    found = caught(laws, row, sets.free[row])
    if found == FREE:
        return FREE
    beyond = max(laws.least[FREE, row] - sets.free[row], sets.free[row] - laws.most[FREE, row])
    return found if beyond > _rounding(flexibility, without, force, row) else FREE


@inner_loops
def _tangential(
    flexibility: np.ndarray,
    gap: tuple[np.ndarray, np.ndarray],
    rubbing: Rubbing,
    of: tuple[int, int],
    sets: Sets,
    force: np.ndarray,
) -> int:
    """State that a tangential row, `of` a state and with a number, goes on to. What both sticking and
    slipping meet by rounding stays.
    """
    now, row = of
    number = row - rubbing.beside.size
    normal = rubbing.rows[number]
    if sets.following[normal] == FREE or not rubbing.static[number] > 0.0:
        return FREE
    if now == FREE:
        return STICKS
    if now == STICKS:
        bound = rubbing.static[number] * max(force[normal], 0.0) + sets.right[sets.right.size - 1]
        if abs(force[row]) <= bound:
            return STICKS
        return ALONG if force[row] > 0.0 else AGAINST
    without, before = gap
    moved = sets.free[row] - before[row]
    off = moved if now == ALONG else -moved
    return STICKS if off > 0.0 and off > _rounding(flexibility, without, force, row) else now


@inner_loops
def _exchange(
    flexibility: np.ndarray,
    gap: tuple[np.ndarray, np.ndarray],
    held: tuple[Table, Rubbing, np.ndarray],
    sets: Sets,
    force: np.ndarray,
) -> int:
    """States that the rows go on to; how many change."""
    (laws, rubbing, state), following = held, sets.following
    largest, changed = 0.0, 0
    for i in range(force.size):
        largest = max(largest, abs(force[i]))
    sets.right[sets.right.size - 1] = _ROUNDING * largest
    for i in range(force.size):
        if i < rubbing.beside.size:
            following[i] = _normal(flexibility, gap[0], laws, (state[i], i), sets, force)
        else:
            following[i] = _tangential(flexibility, gap, rubbing, (state[i], i), sets, force)
    for i in range(force.size):
        changed += following[i] != state[i]
        state[i] = following[i]
    return changed


@inner_loops
def _repeats(state: np.ndarray, seen: np.ndarray, done: int) -> bool:
    """Whether a set has been met before; it is kept as the next one."""
    total = 17
    for i in range(state.size):
        total = (total * 1000003) ^ (state[i] + 1)
    seen[done] = total
    for k in range(done):
        if seen[k] == total:
            return True
    return False


@inner_loops
def _alone(
    flexibility: np.ndarray,
    rows: tuple[int, int],
    rest: tuple[float, float],
    bounds: tuple[float, float],
    sets: Sets,
) -> int:
    """Pressure and friction, the first entries of `right`, of a pair of rows whose gap and change of slip
    are `rest` without them; the state of the second.
    """
    (i, t), (kinetic, static), right = rows, bounds, sets.right
    if rest[0] >= 0.0:
        right[0], right[1] = 0.0, 0.0
        return FREE
    a, b, d = flexibility[i, i], flexibility[i, t], flexibility[t, t]
    determinant = a * d - b * b
    pressure, along = b * rest[1] - d * rest[0], b * rest[0] - a * rest[1]
    if determinant > 0.0 and abs(along) <= static * pressure:
        right[0], right[1] = pressure / determinant, along / determinant
        return STICKS
    pull = kinetic if along > 0.0 else -kinetic
    # beyond the coefficient that a pair alone has one solution for, as if its rows were independent
    right[0] = -rest[0] / max(a + pull * b, 0.1 * a)
    right[1] = pull * right[0]
    return ALONG if along > 0.0 else AGAINST


@inner_loops
def _sweep(
    flexibility: np.ndarray,
    gap: tuple[np.ndarray, np.ndarray],
    held: tuple[Table, Rubbing, np.ndarray],
    sets: Sets,
) -> None:
    """Go over all rows once, each with its tangential one exactly under the forces of the others; `free` are
    the gaps under the forces `swept`.
    """
    (laws, rubbing, state), free, swept = held, sets.free, sets.swept
    n, count = free.size, rubbing.beside.size
    for i in range(count):
        if not flexibility[i, i] > 0.0:
            continue
        t, more = rubbing.beside[i], 0.0
        if t >= 0 and rubbing.static[t - count] > 0.0:
            first = free[i] - flexibility[i, i] * swept[i] - flexibility[i, t] * swept[t]
            second = free[t] - flexibility[i, t] * swept[i] - flexibility[t, t] * swept[t] - gap[1][t]
            bounds = (rubbing.kinetic[t - count], rubbing.static[t - count])
            state[t] = _alone(flexibility, (i, t), (first, second), bounds, sets)
            state[i] = FREE if state[t] == FREE else PRESSED
            pressure, more = sets.right[0], sets.right[1] - swept[t]
            swept[t] = sets.right[1]
        else:
            rest = free[i] - flexibility[i, i] * swept[i]
            state[i] = caught(laws, i, rest)
            pressure = 0.0
            if state[i] == PRESSED or state[i] == PULLED:
                pressure = (laws.place[state[i], i] - rest) / flexibility[i, i]
        change = pressure - swept[i]
        swept[i] = pressure
        for j in range(n):
            free[j] += change * flexibility[i, j]
        if more != 0.0:
            for j in range(n):
                free[j] += more * flexibility[t, j]


@compiled_loops
def rubbing_forces(
    flexibility: np.ndarray,
    gap: tuple[np.ndarray, np.ndarray],
    held: tuple[Table, Rubbing, np.ndarray],
    sets: Sets,
    force: np.ndarray,
) -> int:
    """Solve a contact problem with friction, whose gaps and slips are W force + gap.

    `gap` are the free gaps and slips, and those of the step before, whose slips rows that stick keep; `held`
    are the laws, what rubs, and the states of the step before, which are written anew. `sets.free` is left
    with gaps and slips. Returns the exchanges of states, -1 if no solution is found.
    """
    (laws, _, state), n, exchanges = held, gap[0].size, 0
    for i in range(n):
        sets.swept[i] = 0.0
    for attempt in range(_ROUNDS + 1):
        if attempt > 0:
            for i in range(n):
                sets.free[i] = gap[0][i]
                for j in range(n):
                    sets.free[i] += flexibility[i, j] * sets.swept[j]
            for _ in range(_SWEEPS):
                _sweep(flexibility, gap, held, sets)
        done = 0
        while done < _MAXIMUM and not _repeats(state, sets.seen, done):
            done += 1
            if not _factorise(flexibility, held[1], state, sets):
                break
            _solve(flexibility, gap, held, sets, force)
            if _exchange(flexibility, gap, held, sets, force) == 0:
                for i in range(held[1].beside.size):
                    if state[i] != FREE:
                        force[i] = min(max(force[i], laws.least[state[i], i]), laws.most[state[i], i])
                return exchanges
            exchanges += 1
    return -1

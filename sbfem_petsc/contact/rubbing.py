"""Compiled solve of the contact problem of a step with friction, from the states of the step before.

The same exchanges of states, and sweeps of Gauss-Seidel where sets repeat, as in `friction`, where they are
explained; there stands Lemke's method behind them. Unknowns of a set are the forces of held normal rows and
of sticking tangential ones, the column of a pressure whose row slips is that of its friction too. From set to
set few rows change: the inverse follows them by bordering and its reverse. A row that begins to slip is
counted from what its pressure pulls, and leaves. What rounding leaves of the gaps is solved for again, and
where that does not help the inverse is built anew. How kernels are written, `pivoting` tells.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from .compiled import compiled_apart, inner_loops, inner_sums
from .friction import AGAINST, ALONG, STICKS, Friction
from .law import FREE, PRESSED, PULLED, ROUND_OFF, Table
from .pivoting import add_rows, caught, products

# Exchanges before sweeps, sweeps before the next exchanges, and how often; rounding of forces.
_MAXIMUM, _SWEEPS, _ROUNDS, _ROUNDING = 40, 20, 20, 1e-12
# Pivots, relative to a row's own flexibility, that are none; what may be left of the gaps that are kept,
# relative to the largest gap without forces or by a row's own force, and how often it is solved for again.
_LEAST, _LEFT, _REFINED = 1e-9, 1e-13, 2


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
    """The inverse of the set of the step before, and room to work in, of n rows.

    Attributes
    ----------
    inverse : (n, n) array
        Forces of the members (rows) under their gaps (columns).
    known : (n,) int8 array
        States that it belongs to.
    members : (n + 1,) int array
        Unknowns in the order of the inverse, behind them rows that slip; the last entry is the number of
        unknowns, -1 where nothing is known.
    place : (n,) int array
        Of each row among the members, -1 of others.
    right : (n + 1,) array
        Of the members; the last entry is the rounding of forces.
    solved : (n,) array
        Forces of the members.
    free : (n,) array
        Gaps.
    following : (n,) int8 array
    swept : (n,) array
        Forces of Gauss-Seidel.
    seen : (_MAXIMUM,) int array
        Sums that tell sets apart.
    every : (n,) int array
        0, 1, ..
    """

    inverse: np.ndarray
    known: np.ndarray
    members: np.ndarray
    place: np.ndarray
    right: np.ndarray
    solved: np.ndarray
    free: np.ndarray
    following: np.ndarray
    swept: np.ndarray
    seen: np.ndarray
    every: np.ndarray


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
    right, solved, free, swept = (np.empty(n) for n in (rows + 1, rows, rows, rows))
    return right, solved, free, following, swept, seen, np.arange(rows)


# Where nothing rubs.
NO_ROOM = rubbing_room(0)


def empty_sets(rows: int) -> Sets:
    """Nothing is known yet."""
    known, place = np.zeros(rows, dtype=np.int8), np.zeros(rows, dtype=np.int64)
    return Sets(np.empty((rows, rows)), known, np.full(rows + 1, -1), place, *rubbing_room(rows))


@inner_loops
def pull_of(rubbing: Rubbing, state: np.ndarray, row: int) -> float:
    """Friction of a tangential row that slips, per pressure; 0 of others."""
    count = rubbing.beside.size
    if state[row] == ALONG:
        return rubbing.kinetic[row - count]
    return -rubbing.kinetic[row - count] if state[row] == AGAINST else 0.0


@inner_loops
def pulled(flexibility: np.ndarray, rubbing: Rubbing, state: np.ndarray, rows: tuple[int, int]) -> float:
    """Gap of the first of two rows under a unit force of the second, and the friction that follows it."""
    row, column = rows
    value = flexibility[column, row]
    if column < rubbing.beside.size and rubbing.beside[column] >= 0:
        beside = rubbing.beside[column]
        pull = pull_of(rubbing, state, beside)
        if pull != 0.0:
            value += pull * flexibility[beside, row]
    return value


@inner_loops
def _hold(flexibility: np.ndarray, rubbing: Rubbing, row: int, sets: Sets) -> bool:
    """Border the inverse by a row that joins; whether it is regular."""
    inverse, known, members, right, free = sets.inverse, sets.known, sets.members, sets.right, sets.free
    n = known.size
    last = members[n]
    for a in range(last):
        right[a] = pulled(flexibility, rubbing, known, (row, members[a]))
        free[a] = pulled(flexibility, rubbing, known, (members[a], row))
        inverse[last, a] = 0.0
    add_rows(inverse, sets.every, right, last, (last, last), inverse[last])
    own = pulled(flexibility, rubbing, known, (row, row))
    for a in range(last):
        own -= inverse[last, a] * free[a]
    if not abs(own) > _LEAST * flexibility[row, row]:
        return False
    products(inverse, free, last, (last, last), right)
    scale = 1.0 / own
    for a in range(last):
        share = right[a] * scale
        for b in range(last):
            inverse[a, b] += share * inverse[last, b]
        inverse[a, last] = -share
    for b in range(last):
        inverse[last, b] *= -scale
    inverse[last, last] = scale
    members[last], sets.place[row], members[n] = row, last, last + 1
    return True


@inner_loops
def _drop(flexibility: np.ndarray, row: int, sets: Sets) -> bool:
    """Take a row that leaves out of the inverse, the last one into its place; whether it is regular."""
    inverse, members, place, pivot = sets.inverse, sets.members, sets.place, sets.right
    n, at = place.size, place[row]
    last = members[n] - 1
    if not abs(inverse[at, at]) * flexibility[row, row] > _LEAST:
        return False
    scale = 1.0 / inverse[at, at]
    for b in range(last + 1):
        pivot[b] = scale * inverse[at, b]
    for a in range(last + 1):
        share = inverse[a, at]
        for b in range(last + 1):
            inverse[a, b] -= share * pivot[b]
        inverse[a, at] = inverse[a, last]
    for b in range(last):
        inverse[at, b] = inverse[last, b]
    members[at], members[n] = members[last], last
    place[members[at]], place[row] = at, -1
    return True


@inner_loops
def _slide(rubbing: Rubbing, row: int, pull: float, sets: Sets) -> None:
    """Count the friction of a tangential row that is held from what its pressure pulls, which is so much
    more."""
    inverse, place = sets.inverse, sets.place
    at, normal = place[row], place[rubbing.rows[row - rubbing.beside.size]]
    for b in range(sets.members[place.size]):
        inverse[at, b] += pull * inverse[normal, b]


@inner_loops
def _leaving(rubbing: Rubbing, state: np.ndarray, row: int, sets: Sets) -> int:
    """Which row a row takes out of a set with it, -1 for none: itself as it begins to slip or parts, its
    pressure as its friction turns. It is known from now on.
    """
    known, place, count = sets.known, sets.place, rubbing.beside.size
    before, now = known[row], state[row]
    if row < count:
        known[row] = now
        return row if now == FREE and place[row] >= 0 else -1
    if before == now or now == STICKS:
        return -1
    known[row] = now
    if before == STICKS:
        pull = pull_of(rubbing, state, row)
        if pull != 0.0:
            _slide(rubbing, row, -pull, sets)
        return row
    normal = rubbing.rows[row - count]
    return normal if place[normal] >= 0 else -1


@inner_loops
def _differs(state: np.ndarray, sets: Sets) -> bool:
    """Whether a set is another than that of the step before, of which nothing is kept where half of it is."""
    members, n, changed = sets.members, state.size, 0
    for i in range(n):
        changed += sets.known[i] != state[i]
    if members[n] >= 0 and changed == 0:
        return False
    if 2 * changed >= members[n]:
        members[n] = 0
        for i in range(n):
            sets.known[i], sets.place[i] = FREE, -1
    return True


@inner_loops
def follow(flexibility: np.ndarray, rubbing: Rubbing, state: np.ndarray, sets: Sets) -> bool:
    """Bring the inverse from the set of the step before to that of some states; whether it is regular. Rows
    that the others do not determine yet wait until more have joined.
    """
    known, place, members = sets.known, sets.place, sets.members
    n, count = state.size, rubbing.beside.size
    if not _differs(state, sets):
        return True
    for k in range(n):
        row = _leaving(rubbing, state, k + count if k + count < n else k + count - n, sets)
        if row >= 0 and not _drop(flexibility, row, sets):
            members[n] = -1
            return False
    waiting, joined = 1, 1
    while waiting > 0 and joined > 0:
        waiting, joined = 0, 0
        for i in range(n):
            if place[i] >= 0 or state[i] == FREE or (i >= count and state[i] != STICKS):
                continue
            if not _hold(flexibility, rubbing, i, sets):
                waiting += 1
                continue
            joined += 1
            if i >= count:
                pull = pull_of(rubbing, known, i)
                if pull != 0.0:
                    _slide(rubbing, i, pull, sets)
                known[i] = STICKS
    if waiting > 0:
        members[n] = -1
    return waiting == 0


@inner_loops
def _solve(
    flexibility: np.ndarray,
    gap: tuple[np.ndarray, np.ndarray],
    held: tuple[Table, Rubbing, np.ndarray],
    sets: Sets,
    force: np.ndarray,
) -> bool:
    """Forces of a set, and in `free` the gaps of all rows; `gap` are those without forces, and before. What
    rounding leaves of the gaps that are kept is solved for again; whether nothing is left.
    """
    (laws, rubbing, state), members, right, free = held, sets.members, sets.right, sets.free
    solved, (without, before) = sets.solved, gap
    n, count = without.size, rubbing.beside.size
    unknowns = members[n]
    for i in range(n):
        force[i], free[i] = 0.0, without[i]
    for attempt in range(_REFINED + 1):
        left, size = 0.0, 0.0
        for a in range(unknowns):
            row = members[a]
            kept = laws.place[state[row], row] if row < count else before[row]
            right[a] = kept - free[row]
            left = max(left, abs(right[a]))
            size = max(size, abs(without[row]), abs(flexibility[row, row] * force[row]))
        if attempt > 0 and not left > _LEFT * size:
            return True
        products(sets.inverse, right, unknowns, (unknowns, unknowns), solved)
        total = unknowns
        for a in range(unknowns):
            force[members[a]] += solved[a]
        for t in range(count, n):
            pull = pull_of(rubbing, state, t)
            if pull != 0.0:
                normal = rubbing.rows[t - count]
                members[total], solved[total] = t, pull * solved[sets.place[normal]]
                force[t] = pull * force[normal]
                total += 1
        add_rows(flexibility, members, solved, total, (n, n), free)
    return False


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
def _tangential(
    flexibility: np.ndarray,
    gap: tuple[np.ndarray, np.ndarray],
    rubbing: Rubbing,
    of: tuple[int, int],
    sets: Sets,
    force: np.ndarray,
) -> int:
    """State that a tangential row, `of` a state and with a number, goes on to: of a pair that closes what it
    would be in alone. What both sticking and slipping meet by rounding stays.
    """
    now, row = of
    number = row - rubbing.beside.size
    normal = rubbing.rows[number]
    if sets.following[normal] == FREE or not rubbing.static[number] > 0.0:
        return FREE
    without, before = gap
    moved = sets.free[row] - before[row]
    if now == FREE:
        bounds = (rubbing.kinetic[number], rubbing.static[number])
        return max(_alone(flexibility, (normal, row), (sets.free[normal], moved), bounds, sets), STICKS)
    if now == STICKS:
        bound = rubbing.static[number] * max(force[normal], 0.0) + sets.right[sets.right.size - 1]
        if abs(force[row]) <= bound:
            return STICKS
        return ALONG if force[row] > 0.0 else AGAINST
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


@compiled_apart
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
            for _ in range(2):  # where rounding has piled up, all is done anew
                solved = follow(flexibility, held[1], state, sets) and _solve(
                    flexibility, gap, held, sets, force
                )
                if solved:
                    break
                sets.members[n] = -1
            if not solved:
                break
            if _exchange(flexibility, gap, held, sets, force) == 0:
                for i in range(held[1].beside.size):
                    if state[i] != FREE:
                        force[i] = min(max(force[i], laws.least[state[i], i]), laws.most[state[i], i])
                return exchanges
            exchanges += 1
    return -1

"""Compiled solve of the contact problem of a step with friction, from the states of the step before.

Exchanges of states, and where sets repeat sweeps of nonsmooth Gauss-Seidel, each row with its tangential one
exactly under the forces of the others; behind them stands Lemke's method, in `friction_solve`. The inverse of
a set follows from that of the one before (`held_rows`). What rounding leaves of the gaps is solved for again,
and where that does not help the inverse is built anew.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from .compiled import compiled_apart, inner_loops, inner_sums
from .friction import AGAINST, ALONG, STICKS
from .held_rows import MAXIMUM, Rubbing, Sets, follow, pull_of
from .law import FREE, PRESSED, PULLED, ROUND_OFF, Table
from .pivoting import Factor, add_rows, caught, contact_forces, products

# Rounding of forces, of the largest. Sweeps of Gauss-Seidel before the next exchanges, and how often.
ROUNDING, SWEEPS, ROUNDS = 1e-12, 20, 20
# What may be left of the gaps that are kept, relative to the largest gap without forces or by a row's own
# force, and how often it is solved for again.
_LEFT, _REFINED = 1e-13, 4
# What rows that the others hold may miss of their places, relative to the largest gap without forces.
_MISSED = 1e-9


class Problem(NamedTuple):
    """A contact problem, whose gaps and slips are W force + free, of n rows.

    Attributes
    ----------
    flexibility : (n, n) array
        W.
    free, before : (n,) arrays
        Gaps and slips without forces, and those of the step before.
    laws : Table
    rubbing : Rubbing
    state : (n,) int8 array
        States of the step before, which are written anew.
    sets : Sets
    force : (n,) array
        Written.
    """

    flexibility: np.ndarray
    free: np.ndarray
    before: np.ndarray
    laws: Table
    rubbing: Rubbing
    state: np.ndarray
    sets: Sets
    force: np.ndarray


@inner_loops
def _refined(problem: Problem) -> bool:
    """Forces of a set, and in `sets.free` the gaps of all rows. What rounding leaves of the gaps that are
    kept is solved for again; whether nothing is left.
    """
    flexibility, without, _, laws, rubbing, state, sets, force = problem
    members, right, free, solved = sets.members, sets.right, sets.free, sets.solved
    n, count = without.size, rubbing.beside.size
    unknowns, left = members[n], np.inf
    for i in range(n):
        force[i], free[i] = 0.0, without[i]
    for attempt in range(_REFINED + 1):
        last, left, size = left, 0.0, 0.0
        for a in range(unknowns):
            row = members[a]
            kept = laws.place[state[row], row] if row < count else sets.kept[row]
            right[a] = kept - free[row]
            left = max(left, abs(right[a]))
            size = max(size, abs(without[row]), abs(flexibility[row, row] * force[row]))
        if attempt > 0 and not left > _LEFT * size:
            if not sets.sharp or left > 0.5 * last or attempt == _REFINED:
                return True
        products(sets.inverse, right, unknowns, (unknowns, unknowns), solved)
        total = unknowns
        for a in range(unknowns):
            force[members[a]] += solved[a]
        for t in range(count, n):
            pull = pull_of(rubbing, state, t)
            if pull != 0.0:
                normal = rubbing.rows[t - count]
                if sets.place[normal] < 0:
                    continue
                members[total], solved[total] = t, pull * solved[sets.place[normal]]
                force[t] = pull * force[normal]
                total += 1
        add_rows(flexibility, members, solved, total, (n, n), free)
    return False


@inner_loops
def _missed(problem: Problem) -> bool:
    """Whether rows that wait, see `held_rows.follow`, are not where they are kept, under forces of others."""
    _, without, _, laws, rubbing, state, sets, _ = problem
    missed, size, count = 0.0, 0.0, rubbing.beside.size
    for i in range(state.size):
        size = max(size, abs(without[i]))
        if sets.place[i] < 0 and (state[i] != FREE if i < count else state[i] == STICKS):
            kept = laws.place[state[i], i] if i < count else sets.kept[i]
            missed = max(missed, abs(kept - sets.free[i]))
    return missed > _MISSED * size


@inner_loops
def _solve(problem: Problem) -> bool:
    """Forces and gaps of a set; whether it has any. Where rounding has piled up, all is done anew."""
    sets = problem.sets
    for _ in range(2):
        found = follow(problem.flexibility, problem.rubbing, problem.state, sets) and _refined(problem)
        if found and not _missed(problem):
            return True
        sets.members[sets.place.size] = -1
    return False


@inner_sums
def _rounding(problem: Problem, row: int) -> float:
    """Of a gap."""
    total = abs(problem.free[row])
    for i in range(problem.force.size):
        total += abs(problem.flexibility[row, i] * problem.force[i])
    return 10.0 * ROUND_OFF * total


@inner_loops
def _normal(problem: Problem, row: int) -> int:
    """State that a normal row goes on to."""
    laws, sets, force, now = problem.laws, problem.sets, problem.force, problem.state[row]
    if now != FREE:
        pull = sets.right[sets.right.size - 1]
        let = force[row] < laws.least[now, row] - pull or force[row] > laws.most[now, row] + pull
        return FREE if let else now
    if not problem.flexibility[row, row] > 0.0 or sets.waits[row] != 0:
        return FREE
    found = caught(laws, row, sets.free[row])
    if found == FREE:
        return FREE
    beyond = max(laws.least[FREE, row] - sets.free[row], sets.free[row] - laws.most[FREE, row])
    return found if beyond > _rounding(problem, row) else FREE


@inner_loops
def _alone(problem: Problem, rows: tuple[int, int], rest: tuple[float, float]) -> int:
    """Pressure and friction, the first entries of `sets.right`, of a pair of rows whose gap and change of
    slip are `rest` without them; the state of the second.
    """
    flexibility, rubbing, right, (i, t) = problem.flexibility, problem.rubbing, problem.sets.right, rows
    kinetic, static = rubbing.kinetic[t - rubbing.beside.size], rubbing.static[t - rubbing.beside.size]
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
def _tangential(problem: Problem, row: int) -> int:
    """State that a tangential row goes on to: of a pair that closes what it would be in alone, but that where
    friction falls as a slip begins it has not begun to. What both sticking and slipping meet by rounding
    stays.
    """
    rubbing, sets, force, now = problem.rubbing, problem.sets, problem.force, problem.state[row]
    number = row - rubbing.beside.size
    normal = rubbing.rows[number]
    if sets.following[normal] == FREE or not rubbing.static[number] > 0.0:
        return FREE
    moved = sets.free[row] - sets.kept[row]
    if now == FREE:
        if rubbing.static[number] > rubbing.kinetic[number]:
            return STICKS
        return max(_alone(problem, (normal, row), (sets.free[normal], moved)), STICKS)
    if now == STICKS:
        bound = rubbing.static[number] * max(force[normal], 0.0) + sets.right[sets.right.size - 1]
        if abs(force[row]) <= bound:
            return STICKS
        return ALONG if force[row] > 0.0 else AGAINST
    off = moved if now == ALONG else -moved
    return STICKS if off > 0.0 and off > _rounding(problem, row) else now


@inner_loops
def _exchange(problem: Problem) -> int:
    """States that the rows go on to; how many change."""
    state, sets, force, following = problem.state, problem.sets, problem.force, problem.sets.following
    largest, changed = 0.0, 0
    for i in range(force.size):
        largest = max(largest, abs(force[i]))
    sets.right[sets.right.size - 1] = ROUNDING * largest
    for i in range(force.size):
        normal = i < problem.rubbing.beside.size
        following[i] = _normal(problem, i) if normal else _tangential(problem, i)
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
def _sweep(problem: Problem) -> None:
    """Go over all rows once, each with its tangential one exactly under the forces of the others; `sets.free`
    are the gaps under the forces `sets.swept`.
    """
    flexibility, _, _, laws, rubbing, state, sets, _ = problem
    free, swept = sets.free, sets.swept
    n, count = free.size, rubbing.beside.size
    for i in range(count):
        if not flexibility[i, i] > 0.0 or sets.waits[i] != 0:
            continue
        t, more = rubbing.beside[i], 0.0
        if t >= 0 and rubbing.static[t - count] > 0.0:
            first = free[i] - flexibility[i, i] * swept[i] - flexibility[i, t] * swept[t]
            second = free[t] - flexibility[i, t] * swept[i] - flexibility[t, t] * swept[t] - sets.kept[t]
            state[t] = _alone(problem, (i, t), (first, second))
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


@inner_loops
def _land(problem: Problem) -> int:
    """Tell where the rows that wait land, and let them: gap and slip go linearly from those before to those
    of the solution without them, of rows that land only because others do at its end. How many change their
    states, -1 where none lands.
    """
    _, _, before, laws, rubbing, state, sets, force = problem
    count, lands = rubbing.beside.size, False
    for i in range(count):
        lands |= sets.waits[i] != 0 and caught(laws, i, sets.free[i]) != FREE
    if not lands:
        return -1
    for i in range(state.size):
        sets.told[i], sets.aside[i] = state[i], force[i]
        sets.landed[i, 0], sets.landed[i, 1], sets.landed[i, 2] = 0.0, 0.0, 0.0
    for k in range(rubbing.rows.size):
        i, t = rubbing.rows[k], count + k
        if sets.waits[i] != 0 and rubbing.static[k] > 0.0:
            reached, slipped = min(sets.free[i], 0.0), sets.free[t] - before[t]
            share = 1.0 / (before[i] - reached)
            sets.landed[t, 0] = share * before[i]
            sets.landed[t, 1] = slipped * share**2 * reached
            sets.landed[t, 2] = slipped * share**2 * before[i] if reached < 0.0 else 0.0
            sets.kept[t] = before[t] + sets.landed[t, 0] * slipped
    for i in range(count):
        sets.waits[i] = 0
    return _exchange(problem)


@inner_loops
def _settle(problem: Problem) -> int:
    """Forces, gaps and states that fit together; how many exchanges they take, -1 if none are found."""
    flexibility, free, before, laws, rubbing, state, sets, force = problem
    n, exchanges = free.size, 0
    slipping = Rubbing(rubbing.rows, rubbing.beside, rubbing.kinetic, rubbing.kinetic)
    for i in range(n):
        sets.swept[i] = 0.0
    for attempt in range(ROUNDS + 1):
        # what sticks under what holds a row that slips sticks under more
        bounds = rubbing if attempt <= ROUNDS // 2 else slipping
        bounded = Problem(flexibility, free, before, laws, bounds, state, sets, force)
        if attempt > 0:
            for i in range(n):
                sets.free[i] = free[i]
                for j in range(n):
                    sets.free[i] += flexibility[i, j] * sets.swept[j]
            for _ in range(SWEEPS):
                _sweep(bounded)
        done = 0
        while done < MAXIMUM and not _repeats(state, sets.seen, done):
            done += 1
            if not _solve(problem):
                break
            if _exchange(bounded) == 0:
                return exchanges
            exchanges += 1
    return -1


@compiled_apart
def rubbing_forces(problem: Problem) -> int:
    """Solve a contact problem with friction.

    Rows that stick keep their slips of the step before, those that land the slips where they do (of gaps of
    zero before those of the step before). Rows that stood apart wait until the others have settled.
    `sets.free` is left with gaps and slips, `sets.kept` with the slips that are kept. Returns the exchanges
    of states, -1 if no solution is found.
    """
    _, _, before, laws, rubbing, state, sets, force = problem
    count, waits, changed, landed = rubbing.beside.size, False, -1, False
    for i in range(state.size):
        sets.kept[i] = before[i]
    for i in range(count):
        sets.waits[i] = 1 if state[i] == FREE and before[i] > 0.0 else 0
        waits |= sets.waits[i] != 0
    exchanges = _settle(problem)
    if waits and exchanges >= 0:
        changed = _land(problem)
    if changed > 0:
        more = _settle(problem)
        exchanges = exchanges + more + 1 if more >= 0 else -1
    if exchanges < 0:
        return -1
    for i in range(count):
        if state[i] != FREE:
            force[i] = min(max(force[i], laws.least[state[i], i]), laws.most[state[i], i])
    for t in range(count, state.size if changed >= 0 else count):
        if state[t] == FREE:
            sets.kept[t] = before[t]
            sets.landed[t, 0], sets.landed[t, 1], sets.landed[t, 2] = 0.0, 0.0, 0.0
        landed |= sets.landed[t, 0] > 0.0
    sets.told[state.size] = landed
    return exchanges


@compiled_apart
def smooth_forces(problem: Problem) -> int:
    """`contact_forces` as `rubbing_forces` is called, of which a step calls one."""
    sets = problem.sets
    factor = Factor(sets.inverse, sets.members, sets.solved, sets.free, sets.every)
    return contact_forces(
        problem.flexibility, problem.free, problem.laws, problem.state, factor, problem.force
    )

"""Compiled solve of the contact problem of a step with friction, from the states of the step before.

States are exchanged as those of the normal rows are (`complementarity`), each set a linear system that the
bound's dependence on the pressure makes unsymmetric. Where sets repeat Lemke's method takes over: the problem
in pressures, friction of either sense and speeds of slip is copositive for every mu >= 0, so that it ends in
a solution (Stewart and Trinkle 1996) wherever W is positive definite. For large mu there may be several: it
is then one of them. The inverse of a set follows from that of the one before (`held_rows`). What rounding
leaves of the gaps is solved for again, and where that does not help the inverse is built anew.
"""

from __future__ import annotations

import math

import numpy as np

from .compiled import compiled_apart, inner_loops, inner_sums
from .friction import AGAINST, ALONG, STICKS, Rubbing
from .held_rows import follow, pull_of
from .law import FREE, PRESSED, PULLED, ROUND_OFF
from .pivoting import add_rows, caught, products
from .problem import Problem

# Rounding of forces, of the largest.
ROUNDING = 1e-12
# Way of Lemke's method, relative to all of it, that is rounding.
_END = 1e-14
# What may be left of the gaps that are kept, relative to the largest gap without forces or by a row's own
# force, and how often it is solved for again.
_LEFT, _REFINED = 1e-13, 4
# What rows that the others hold may miss of their places, relative to the largest gap without forces.
_MISSED = 1e-9


@inner_loops
def _respond(problem: Problem, force: np.ndarray, gap: np.ndarray) -> None:
    """Add the forces of a set that change its gaps by `sets.right`, and what they do to all gaps."""
    flexibility, _, _, _, rubbing, state, sets, _ = problem
    members, solved, n, count = sets.members, sets.solved, state.size, rubbing.beside.size
    unknowns = members[n]
    products(sets.inverse, sets.right, unknowns, (unknowns, unknowns), solved)
    total = unknowns
    for a in range(unknowns):
        force[members[a]] += solved[a]
    for t in range(count, n):
        pull, normal = pull_of(rubbing, state, t), rubbing.rows[t - count]
        if pull != 0.0 and sets.place[normal] >= 0:
            members[total], solved[total] = t, pull * solved[sets.place[normal]]
            force[t] = pull * force[normal]
            total += 1
    add_rows(flexibility, members, solved, total, (n, n), gap)


@inner_loops
def _refined(problem: Problem) -> bool:
    """Forces of a set, and in `sets.free` the gaps of all rows. What rounding leaves of the gaps that are
    kept is solved for again; whether nothing is left.
    """
    flexibility, without, _, laws, rubbing, state, sets, force = problem
    members, right, free = sets.members, sets.right, sets.free
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
        _respond(problem, force, free)
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
        flexibility, gap = problem.flexibility, sets.free[normal]
        pressure = flexibility[normal, row] * moved - flexibility[row, row] * gap
        along = flexibility[normal, row] * gap - flexibility[normal, normal] * moved
        falls = rubbing.static[number] > rubbing.kinetic[number]
        if falls or gap >= 0.0 or abs(along) <= rubbing.static[number] * pressure:
            return STICKS
        return ALONG if along > 0.0 else AGAINST
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


# ---------------------------------------------------------------------- Lemke's method
@inner_loops
def _apart(problem: Problem, row: int) -> float:
    """By how much a normal row's faces stand further apart a unit of the way, m: by no two rows alike."""
    laws = problem.laws
    if laws.least[FREE, row] > laws.most[FREE, row]:
        return 0.0
    return math.sqrt(problem.flexibility[row, row]) * (1.0 + 0.6180339887 * row % 1.0)


@inner_loops
def _slack(
    problem: Problem, place: tuple[int, int], of: tuple[np.ndarray, np.ndarray], parts: tuple[float, float]
) -> float:
    """What is left of a row to the first or second bound of its state, infinite where it has none, under
    `parts` of what holds without a way and of a unit of it, for forces and gaps of these.
    """
    laws, rubbing, state, sets = problem.laws, problem.rubbing, problem.state, problem.sets
    (row, side), (force, gap), (fixed, way) = place, of, parts
    count, now, sense = rubbing.beside.size, state[row], 1.0 - 2.0 * side
    if row < count:
        bound = laws.least[now, row] if side == 0 else laws.most[now, row]
        if abs(bound) == np.inf or sets.waits[row] != 0 or not problem.flexibility[row, row] > 0.0:
            return np.inf
        if now != FREE:
            return sense * (force[row] - fixed * bound)
        return sense * (gap[row] - fixed * bound) + way * _apart(problem, row)
    if now == STICKS:
        k = row - count
        return rubbing.kinetic[k] * force[rubbing.rows[k]] - sense * force[row]
    if now != (ALONG if side == 0 else AGAINST):
        return np.inf
    return -sense * (gap[row] - fixed * sets.kept[row])


@inner_loops
def _enter(problem: Problem, place: tuple[int, int], way: float) -> None:
    """Let a row go over to what is beyond a bound; one that closes slips on."""
    rubbing, state, sets, (row, side) = problem.rubbing, problem.state, problem.sets, place
    count = rubbing.beside.size
    if row >= count:
        state[row] = (ALONG if side == 0 else AGAINST) if state[row] == STICKS else STICKS
        return
    state[row] = FREE if state[row] != FREE else (PRESSED if side == 0 else PULLED)
    t = rubbing.beside[row]
    if t >= 0 and rubbing.static[t - count] > 0.0:
        moved = sets.free[t] + way * sets.rates[1, t] - sets.kept[t]
        state[t] = FREE if state[row] == FREE else (AGAINST if moved > 0.0 else ALONG)


@inner_loops
def _bound(problem: Problem, sense: float) -> tuple[float, int, int]:
    """Where on a way of this sense the next bound is met, and by which row: -1 of none."""
    sets, rates = problem.sets, (problem.sets.rates[0], problem.sets.rates[1])
    best, row, side = np.inf, -1, 0
    for i in range(problem.state.size):
        for s in range(2):
            left = _slack(problem, (i, s), (problem.force, sets.free), (1.0, 0.0))
            rate = _slack(problem, (i, s), rates, (0.0, 1.0)) if left < np.inf else 0.0
            if sense * rate < 0.0 and -sense * left / rate < best:
                best, row, side = -sense * left / rate, i, s
    return sense * best, row, side


@inner_loops
def lemke(problem: Problem) -> bool:
    """States of a solution by Lemke's method; whether it ends. From faces so far apart that none touch it
    follows the solutions as they come together, row by row; where that turns about, they part for a while.
    """
    laws, state, sets = problem.laws, problem.state, problem.sets
    n, count, rates = state.size, problem.rubbing.beside.size, sets.rates
    sense, row, side, whole = -1.0, -1, 0, 0.0
    for i in range(n):
        held = i < count and laws.least[FREE, i] > laws.most[FREE, i] and problem.flexibility[i, i] > 0.0
        state[i] = PRESSED if held else FREE
    for _ in range(100 + 50 * n):
        if not _solve(problem):
            return False
        for a in range(sets.members[n]):
            i, sets.right[a] = sets.members[a], 0.0
            if i < count:
                sets.right[a] = _apart(problem, i) * (1.0 if state[i] == PULLED else -1.0)
        for i in range(n):
            rates[0, i], rates[1, i] = 0.0, 0.0
        _respond(problem, rates[0], rates[1])
        if row >= 0:
            into = _slack(problem, (row, side), (rates[0], rates[1]), (0.0, 1.0))
            sense = 1.0 if into > 0.0 else -1.0
        way, row, side = _bound(problem, sense)
        whole = max(whole, way)
        if row < 0 or not way > _END * whole:
            return sense < 0.0
        _enter(problem, (row, side), way)
    return False


@inner_loops
def _land(problem: Problem) -> int:
    """Tell where the rows that wait land, and let them: gap and slip go linearly from those before to those
    of the solution without them, of rows that land only because others do at its end. How many change their
    states, -1 where none lands.
    """
    _, _, before, laws, rubbing, state, sets, _ = problem
    count, lands = rubbing.beside.size, False
    for i in range(count):
        lands |= sets.waits[i] != 0 and caught(laws, i, sets.free[i]) != FREE
    if not lands:
        return -1
    for i in range(state.size):
        sets.told[i] = state[i]
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
    slipping, exchanges = Rubbing(rubbing.rows, rubbing.beside, rubbing.kinetic, rubbing.kinetic), 0
    for attempt in range(3):
        # what sticks under what holds a row that slips sticks under more
        bounds = slipping if attempt == 1 else rubbing
        bounded = Problem(flexibility, free, before, laws, bounds, state, sets, force)
        if attempt == 2 and not lemke(problem):
            break
        done = 0
        while done < sets.seen.size and not _repeats(state, sets.seen, done):
            done += 1
            if not _solve(problem):
                break
            if _exchange(bounded) == 0:
                return exchanges
            exchanges += 1
    sets.members[state.size] = -1
    return -1


@compiled_apart
def rubbing_forces(problem: Problem) -> int:
    """Solve a contact problem with friction.

    Rows that stick keep their slips of the step before, those that land the slips where they do (of gaps of
    zero before those of the step before). Rows that stood apart wait until the others have settled; where
    those around a node cannot all be held where they land, all are where they stood.
    `sets.free` is left with gaps and slips, `sets.kept` with the slips that are kept. Returns the exchanges
    of states, -1 if no solution is found.
    """
    _, _, before, laws, rubbing, state, sets, force = problem
    count, exchanges, changed, waits, landed = rubbing.beside.size, 0, -1, False, False
    for i in range(state.size):
        sets.kept[i] = before[i]
    for i in range(count):
        sets.waits[i] = 1 if state[i] == FREE and before[i] > 0.0 else 0
        waits |= sets.waits[i] != 0
    for stage in range(3):
        more = _settle(problem)
        exchanges += max(more, 0) + (stage > 0)
        if more >= 0:
            if stage == 0 and waits:
                changed = _land(problem)
            if stage > 0 or changed <= 0:
                break
        elif stage == 2 or not waits:
            return -1
        else:
            changed = -1
            for i in range(state.size):
                sets.kept[i], sets.waits[i] = before[i], 0
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

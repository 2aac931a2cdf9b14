"""The inverse of the flexibility of rows that are held, for kernels.

Unknowns of a set are the forces of held normal rows and of sticking tangential ones, the column of a pressure
whose row slips is that of its friction too. From set to set few rows change: the inverse follows them by
bordering and its reverse. A row that begins to slip is counted from what its pressure pulls, and leaves. How
kernels are written, `pivoting` tells.
"""

from __future__ import annotations

import numpy as np

from .compiled import inner_loops
from .friction import AGAINST, ALONG, STICKS, Rubbing
from .law import FREE
from .pivoting import add_rows, products
from .problem import Sets

# Pivots, relative to a row's own flexibility, that are none, and by which rounding is multiplied: rows around
# a node of several pairs, where cracks turn or meet, have ones of their slack.
_LEAST, _SMALL = 1e-11, 1e-5


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
def _sharpened(flexibility: np.ndarray, rubbing: Rubbing, row: int, sets: Sets) -> float:
    """The pivot of a row that joins, after what the inverse leaves of the solutions for its column, `right`,
    and for its row, behind the inverse's last one, has been solved for again: a small pivot multiplies it.
    """
    inverse, known, members, right, left = sets.inverse, sets.known, sets.members, sets.right, sets.solved
    last = members[known.size]
    for a in range(last):
        left[a] = sets.free[a]
        for b in range(last):
            left[a] -= pulled(flexibility, rubbing, known, (members[a], members[b])) * right[b]
    for a in range(last):
        for b in range(last):
            right[a] += inverse[a, b] * left[b]
    for b in range(last):
        left[b] = pulled(flexibility, rubbing, known, (row, members[b]))
        for a in range(last):
            left[b] -= inverse[last, a] * pulled(flexibility, rubbing, known, (members[a], members[b]))
    add_rows(inverse, sets.every, left, last, (last, last), inverse[last])
    own = pulled(flexibility, rubbing, known, (row, row))
    for a in range(last):
        own -= inverse[last, a] * sets.free[a]
    return own


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
    own, whole = pulled(flexibility, rubbing, known, (row, row)), flexibility[row, row]
    for a in range(last):
        own -= inverse[last, a] * free[a]
    if not abs(own) > _LEAST * whole:
        return False
    products(inverse, free, last, (last, last), right)
    if abs(own) < _SMALL * whole:
        own = _sharpened(flexibility, rubbing, row, sets)
        if not abs(own) > _LEAST * whole:
            return False
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
    for b in range(sets.members[place.size] if normal >= 0 else 0):
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
def _joined(flexibility: np.ndarray, rubbing: Rubbing, state: np.ndarray, sets: Sets) -> bool:
    """Take in the rows that are held and not in the set yet, as long as some can be; whether all are."""
    known, place, count = sets.known, sets.place, rubbing.beside.size
    waiting, joined = 1, 1
    while waiting > 0 and joined > 0:
        waiting, joined = 0, 0
        for i in range(state.size):
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
    return waiting == 0


@inner_loops
def follow(flexibility: np.ndarray, rubbing: Rubbing, state: np.ndarray, sets: Sets) -> bool:
    """Bring the inverse from the set of the step before to that of some states; whether it is regular. Rows
    that the others do not determine yet wait until more have joined; those that wait at the end are held by
    the others, as twice the same row is, and take no force.
    """
    members, n, count = sets.members, state.size, rubbing.beside.size
    if not _differs(state, sets):
        return True
    for k in range(n):
        row = _leaving(rubbing, state, k + count if k + count < n else k + count - n, sets)
        if row >= 0 and not _drop(flexibility, row, sets):
            members[n] = -1
            return False
    if _joined(flexibility, rubbing, state, sets):
        return True
    for i in range(count, n):
        if sets.place[i] < 0 and state[i] == STICKS and pull_of(rubbing, sets.known, i) != 0.0:
            members[n] = -1  # what its pressure pulled is no force of its own
            return False
    return True

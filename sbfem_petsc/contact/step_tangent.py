"""What contact, with friction or without, does to a small disturbance of a history of time steps
(`marching.march`).

While no row changes its state a step is linear in the position dq before contact acts and in what the rows
remember: the forces f of the rows a that keep a gap or stick, E f of all rows (those that slip pull by their
share of the pressure beside them), obey W_a E f = ds - U_a V^T dq with the slips ds that sticking rows keep.
What a row keeps is written at the last instant at which it has not stuck; where it was apart there, this goes
on to where the row lands, a share of the way to the next instant (`rubbing.rubbing_forces`). The memory of a
state is what the rows keep at it: from these slips a row either slips or sticks, from its slip at the instant
itself it might do both, so that the derivative would have two values.

From set to set few rows change: inverses of W_a E follow them as in the steps themselves (`held_rows`).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from .compiled import compiled_loops, inner_loops, inner_sums
from .friction import STICKS, Rubbing
from .held_rows import follow, pull_of, pulled
from .law import FREE, rows_depend
from .pivoting import add_rows, products
from .problem import Sets, empty_sets
from .step_data import StepConstants
from .tangent import Contacts, repeated, thin_axes

# Directions of contact that change the position in a step, in units of it, by less than this are left out, or
# where that is enough by less than another.
LEAST, ROUGH = 1e-12, 1e-5
# What rounding may leave of an inverse that has followed its rows, relative.
ROUNDED = 1e-10


class _Room(NamedTuple):
    """Room to condense sets of n rows in, of which k remember, with r thin directions.

    Attributes
    ----------
    drawn, forces, gathered : (r, n) arrays
        U^T E of the members, that times the inverse, U^T of the members.
    columns : (r + k, r) array
        What position and memory do in the thin space.
    base : (r, r) array
        Directions, one a row.
    along : (n,) array
    """

    drawn: np.ndarray
    forces: np.ndarray
    gathered: np.ndarray
    columns: np.ndarray
    base: np.ndarray
    along: np.ndarray


def step_contacts(
    step: StepConstants,
    history: tuple[np.ndarray, np.ndarray, np.ndarray],
    units: np.ndarray,
    least: float = LEAST,
) -> Contacts:
    """Of steps as they are, of one length.

    Parameters
    ----------
    step : StepConstants
    history : (n + 1, c + k) int8 array, (n, k, 3) array, (n, c + k) int8 array
        States of the rows at the steps' ends, where they land in these, and from which states this is told
        (`step_data.StepHistory`).
    units : (k,) array
        Those of the slips in the state, m.
    least : float
        What is left out.
    """
    (states, landings, told), count = history, step.rubbing.beside.size
    writes, lands = _written(states, landings, told)
    landing = lands.any(axis=1)
    instants = np.flatnonzero((states != FREE).any(axis=1) | writes.any(axis=1))
    # rows that land are told from a set without them before that of their instant
    of = np.repeat(instants, 1 + landing[instants])
    aside = np.append(of[1:] == of[:-1], False)
    beside = landing | np.append(landing[1:], False)
    # the first instant has no step before it; one beside which rows land is like no other
    keys = [
        (n == 0, alone, n if beside[n] else -1, states[n].tobytes(), writes[n].tobytes())
        for n, alone in zip(of.tolist(), aside.tolist())
    ]
    known = {key: number for number, key in enumerate(dict.fromkeys(keys))}
    which = np.array([known[key] for key in keys], dtype=int)
    _, kinds = np.unique(which, return_index=True)
    at, alone = of[kinds], aside[kinds]
    shares = np.zeros((len(kinds), len(units), 2))
    shares[:, :, 0] = 1.0
    goes_on = ~alone & (at < len(landings))
    shares[goes_on] -= landings[at[goes_on], :, :2]
    shares[alone] = landings[at[alone] - 1][:, :, [0, 2]]
    sets, written = states[at], np.where(alone[:, None], lands[at], writes[at])
    sets[alone] = told[at[alone] - 1]
    push, spread, changes, sizes = _condensed(
        step, (sets, written, shares, alone, units), not at[:1].any(), least
    )
    ends = np.cumsum(sizes)
    first = ends - sizes
    held = spread.copy()
    rows, slips = np.nonzero(changes)
    held[rows, count + slips] = np.where(np.repeat(alone, sizes)[rows], 0.0, -1.0 / units[slips])
    for kind in np.flatnonzero(alone):
        behind, own = which[np.flatnonzero(which == kind)[0] + 1], slice(first[kind], ends[kind])
        part, kept = slice(first[behind], ends[behind]), np.flatnonzero(written[kind])
        read = held[part, count + kept] * units[kept]
        spread[part] += read @ spread[own]
        held[part] += read @ held[own]
    place, owner = repeated(sizes, which), np.repeat(of, sizes[which])
    reads, factors = -held[:, count:] * units, spread @ step.left.T @ step.right
    counts = np.bincount(np.searchsorted(instants, owner), minlength=len(instants))
    return Contacts(
        instants, counts, factors[place], (push @ step.right)[place], reads[place], changes[place]
    )


def _written(states: np.ndarray, landings: np.ndarray, told: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(n + 1, k): the instants at which slips are written that are kept later on or left to the next period,
    and those at which they go on to where a row lands.
    """
    count = states.shape[1] - landings.shape[1]
    sticks, landed = states[:, count:] == STICKS, landings[:, :, 0] > 0.0
    writes, lands = np.zeros_like(sticks), np.zeros_like(sticks)
    writes[:-1] = ~sticks[:-1] & (sticks[1:] | (landed.any(axis=1)[:, None] & (told[:, count:] == STICKS)))
    writes[-2] = ~sticks[-2]
    lands[1:] = writes[:-1] & landed
    return writes, lands


def _condensed(
    step: StepConstants, sets: tuple[np.ndarray, ...], early: bool, least: float
) -> tuple[np.ndarray, ...]:
    """Of sets - states, slips that are written, what slips and gaps share in these, whether no more is asked,
    units - one set after the other, the first of them `early` if no step is before it: what directions of
    contact push in the thin space (s, r), what takes part in them and in slips that are written, from all
    rows (s, c + k), the memory that is written (s, k), and how many each set has.
    """
    (rank, rows), (states, writes, shares, alone, units) = step.left.shape, sets
    memory = len(units)
    thin, unscaled = thin_axes(step.right, step.coefficients[0, 4])
    most = rank * len(states) + int(writes.sum())
    result = np.zeros((most, rank)), np.zeros((most, rows)), np.zeros((most, memory))
    sizes = np.zeros(len(states), dtype=np.int64)
    drawn, forces, gathered = (np.empty((rank, rows)) for _ in range(3))
    columns, base = np.empty((rank + memory, rank)), np.empty((rank, rank))
    room = _Room(drawn, forces, gathered, columns, base, np.empty(rows))
    flexibility = step.flexibility[0], step.residual if early else step.flexibility[0]
    scaled = np.ascontiguousarray(thin.T @ step.left)
    states, writes, shares, alone = map(np.ascontiguousarray, (states, writes, shares, alone))
    held = step.rubbing, states, writes, shares, alone, units, least
    total = _condense(flexibility, scaled, held, empty_sets(rows), room, (*result, sizes))
    if total < 0:
        raise rows_depend()
    push, spread, changes = (part[:total] for part in result)
    return push @ unscaled.T, spread, changes, sizes


@inner_loops
def _drawn(
    flexibility: np.ndarray, scaled: np.ndarray, held: tuple[Rubbing, np.ndarray], sets: Sets, room: _Room
) -> float:
    """Thin forces under the gaps of the members; what rounding leaves of the inverse, relative."""
    (rubbing, state), members = held, sets.members
    drawn, forces, along = room.drawn, room.forces, room.along
    unknowns, count, rank = members[state.size], rubbing.beside.size, scaled.shape[0]
    for a in range(unknowns):
        row, pull, beside = members[a], 0.0, 0
        if row < count and rubbing.beside[row] >= 0:
            beside = rubbing.beside[row]
            pull = pull_of(rubbing, state, beside)
        along[a] = 0.0
        for q in range(rank):
            drawn[q, a] = scaled[q, row] + pull * scaled[q, beside]
            forces[q, a] = 0.0
    for q in range(rank):
        add_rows(sets.inverse, sets.every, drawn[q], unknowns, (unknowns, unknowns), forces[q])
        for a in range(unknowns):
            along[a] += forces[q, a]
    left, size = 0.0, 0.0
    for b in range(unknowns):
        expected, found = 0.0, 0.0
        for q in range(rank):
            expected += drawn[q, b]
        for a in range(unknowns):
            found += along[a] * pulled(flexibility, rubbing, state, (members[a], members[b]))
        left, size = max(left, abs(found - expected)), max(size, abs(expected))
    return left / max(size, 1e-300)


@inner_loops
def _sharpened(
    flexibility: np.ndarray, held: tuple[Rubbing, np.ndarray], rank: int, sets: Sets, room: _Room
) -> None:
    """Solve again for what the inverse leaves of the thin forces."""
    (rubbing, state), members, left = held, sets.members, room.along
    unknowns = members[state.size]
    for q in range(rank):
        for b in range(unknowns):
            left[b] = room.drawn[q, b]
            for a in range(unknowns):
                left[b] -= room.forces[q, a] * pulled(flexibility, rubbing, state, (members[a], members[b]))
        add_rows(sets.inverse, sets.every, left, unknowns, (unknowns, unknowns), room.forces[q])


@inner_loops
def _columns(scaled: np.ndarray, units: np.ndarray, members: np.ndarray, unknowns: int, room: _Room) -> int:
    """What position and the memory of the members do in the thin space; how many columns that are."""
    rank, count, total = scaled.shape[0], scaled.shape[1] - units.size, scaled.shape[0]
    forces, gathered, columns, along = room.forces, room.gathered, room.columns, room.along
    for j in range(rank):
        for a in range(unknowns):
            gathered[j, a] = scaled[j, members[a]]
    for q in range(rank):
        products(gathered, forces[q], rank, (unknowns, unknowns), along)
        for j in range(rank):
            columns[j, q] = along[j]
    for a in range(unknowns):
        if members[a] >= count:
            for q in range(rank):
                columns[total, q] = forces[q, a] * units[members[a] - count]
            total += 1
    return total


@inner_sums
def _dot(one: np.ndarray, i: int, other: np.ndarray, j: int) -> float:
    """Of two rows."""
    total = 0.0
    for q in range(one.shape[1]):
        total += one[i, q] * other[j, q]
    return total


@inner_loops
def _directions(columns: np.ndarray, total: int, base: np.ndarray, least: float) -> int:
    """Orthonormal directions that the columns have, by Gram and Schmidt with pivots; how many."""
    rank, found, largest = base.shape[0], 0, 1.0
    while found < rank:
        pivot, size = 0, -1.0
        for c in range(total):
            square = _dot(columns, c, columns, c)
            if square > size:
                pivot, size = c, square
        size = math.sqrt(size)
        largest = max(largest, size)
        if not size > least * largest:
            break
        for q in range(rank):
            base[found, q] = columns[pivot, q]
        for _ in range(2):
            for j in range(found):
                share = _dot(base, found, base, j)
                for q in range(rank):
                    base[found, q] -= share * base[j, q]
        scale = 1.0 / math.sqrt(_dot(base, found, base, found))
        for q in range(rank):
            base[found, q] *= scale
        for c in range(total):
            share = _dot(columns, c, base, found)
            for q in range(rank):
                columns[c, q] -= share * base[found, q]
        found += 1
    return found


@compiled_loops
def directions(columns: np.ndarray, least: float, base: np.ndarray, counts: np.ndarray) -> None:
    """Orthonormal directions (n, r, r) of columns (n, c, r), which are used up, and how many (n,)."""
    for n in range(counts.size):
        counts[n] = _directions(columns[n], columns.shape[1], base[n], least)


@inner_loops
def _taken(sets: Sets, factors: np.ndarray, rows: np.ndarray, count: int, along: np.ndarray) -> None:
    """So many rows of the members, each times its factor, summed."""
    unknowns = sets.members[sets.place.size]
    for a in range(unknowns):
        along[a] = 0.0
    add_rows(rows, sets.every, factors, count, (unknowns, unknowns), along)


@compiled_loops
def _condense(
    flexibility: tuple[np.ndarray, np.ndarray],
    scaled: np.ndarray,
    held: tuple[Rubbing, np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray, float],
    sets: Sets,
    room: _Room,
    result: tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray],
) -> int:
    """See `_condensed`; the number of all rows, -1 where a set is singular."""
    (rubbing, states, writes, shares, alone, units, least), (push, spread, changes, sizes) = held, result
    n, rank, members, along, total = states.shape[1], scaled.shape[0], sets.members, room.along, 0
    for kind in range(states.shape[0]):
        w, state, first = flexibility[1] if kind == 0 else flexibility[0], states[kind], total
        if kind < 2:
            members[n] = -1
        for attempt in range(2):
            regular = follow(w, rubbing, state, sets)
            if regular and _drawn(w, scaled, (rubbing, state), sets, room) <= ROUNDED:
                break
            if attempt == 0:
                members[n] = -1
            elif regular:  # rows that are nearly the same
                _sharpened(w, (rubbing, state), rank, sets, room)
        if not regular:
            return -1
        unknowns = members[n]
        columns = 0 if alone[kind] else _columns(scaled, units, members, unknowns, room)
        for j in range(_directions(room.columns, columns, room.base, least)):
            for q in range(rank):
                push[total, q] = room.base[j, q]
            _taken(sets, room.base[j], room.forces, rank, along)
            for a in range(unknowns):
                spread[total, members[a]] = along[a]
            total += 1
        for t in range(units.size):
            if not writes[kind, t]:
                continue
            row, normal, share = n - units.size + t, rubbing.rows[t], shares[kind, t, 1] / units[t]
            for a in range(unknowns):
                room.drawn[0, a] = (
                    shares[kind, t, 0] / units[t] * pulled(w, rubbing, state, (row, members[a]))
                )
                if share != 0.0:
                    room.drawn[0, a] += share * pulled(w, rubbing, state, (normal, members[a]))
            _taken(sets, room.drawn[0], sets.inverse, unknowns, along)
            for a in range(unknowns):
                spread[total, members[a]] = along[a]
            spread[total, row] -= shares[kind, t, 0] / units[t]
            spread[total, normal] -= share
            changes[total, t] = 1.0
            total += 1
        sizes[kind] = total - first
    return total

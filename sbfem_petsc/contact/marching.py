"""Compiled time steps of a reduced model with contact.

One step is linear in the modal forces: with per-mode coefficients the state advances as
q1 = aqq q + aqv v + bq p0 + dq p1 + cq (r0 + r1), v1 = avq q + avv v + bv p0 + dv p1 + cv (r0 + r1), where p
are the modal forces of the loads at both ends and r = C^T force those of contact. The gap at the step's end
is W force + free gap with the constant W = C diag(cq) C^T + R.

The kernels are plain loops over scalars of contiguous arrays that are given: array expressions, slices,
linear algebra and new arrays in them would take seconds to compile.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from .compiled import compiled_loops, inner_loops, inner_sums
from .law import ROUND_OFF, RowLaws

# Full exchanges of the active set that may pass without fewer wrong signs before single exchanges by index
# take over; Judice and Pires (1994) show that this ends for every positive definite W.
PATIENCE = 5
# Numbers that a loop takes at a time at most: four vector registers of four.
WHOLE = 16


class Halving(NamedTuple):
    """Which steps are taken as two halves, and these as halves again, as far as there are constants: those in
    which the faces' contact, which does no work in the exact motion, does more of it than so much.

    Attributes
    ----------
    tolerance : float
        Of the energy of the modes at the step's end; infinite: no step.
    floor : float
        Energy that is added to it, J.
    """

    tolerance: float
    floor: float


NEVER = Halving(math.inf, 0.0)


class StepConstants(NamedTuple):
    """What the steps of a reduced model have in common; see `step_constants`.

    Attributes
    ----------
    coefficients : (levels, 10, m) array
        aqq, aqv, bq, dq, cq, avq, avv, bv, dv, cv of each mode, of a step h, of h / 2, h / 4, ..
    left, right : (r, pairs), (r, m) arrays
        Rows of the factors of C = U V^T, gaps of the modes: U^T and V^T.
    flexibility : (levels, pairs, pairs) array
        W of each of these steps.
    residual : (pairs, pairs) array
        R, which alone gives the forces of a state from which no step leads back.
    tied : (pairs,) bool array
        See `law.RowLaws`.
    stiffness : (m,) array
        omega^2, of the energy that the work of contact is compared with.
    halving : Halving
    """

    coefficients: np.ndarray
    left: np.ndarray
    right: np.ndarray
    flexibility: np.ndarray
    residual: np.ndarray
    tied: np.ndarray
    stiffness: np.ndarray
    halving: Halving


class StepLoads(NamedTuple):
    """What drives several steps, at their n + 1 ends.

    Attributes
    ----------
    external : (n + 1, m) array
        Modal forces of the loads; (0, m) where there are none.
    free_gap : (n + 1, pairs) array
        Initial gaps and the residual flexibility's share of the loads.
    levels : (n,) int8 array
        Of the steps, whose lengths are h / 2^level. Loads and gaps are linear in each.
    """

    external: np.ndarray
    free_gap: np.ndarray
    levels: np.ndarray


class StepState(NamedTuple):
    """A state between two steps, advanced in place.

    Attributes
    ----------
    q, v : (m,) arrays
        Modal coordinates and rates.
    force : (pairs,) array
        Of contact, N.
    active : (pairs,) bool array
        Rows in contact, tied ones included.
    """

    q: np.ndarray
    v: np.ndarray
    force: np.ndarray
    active: np.ndarray


class StepHistory(NamedTuple):
    """Filled with what the steps lead to.

    Attributes
    ----------
    states, velocities, forces : (n, m), (n, m), (n, pairs) arrays
        q, v and the contact forces after each step.
    work : (n,) array
        Of the contact forces in each, J: mean force times change of the gap, of its parts one by one.
    parts : (n 2^(levels - 1) + 1,) or (0,) int8 array
        Levels of the steps as they were taken, whose number is told; not kept in an empty one.
    """

    states: np.ndarray
    velocities: np.ndarray
    forces: np.ndarray
    work: np.ndarray
    parts: np.ndarray = np.empty(0, dtype=np.int8)


class Marched(NamedTuple):
    """What has been done.

    Attributes
    ----------
    steps : int
        Fewer than n: a contact problem was not solved.
    exchanges : int
        Of active sets, in all.
    unresolved : int
        Steps of the last level in which contact does more work than `Halving` allows.
    taken : int
        Steps and parts of steps.
    """

    steps: int
    exchanges: int
    unresolved: int
    taken: int


class Factor(NamedTuple):
    """L^-1 of W = L L^T over the rows in contact, kept from a step to the next, and room to work in.

    Attributes
    ----------
    inverse : (n, n) array
    members : (n + 1,) int array
        Rows in contact in the order of the factor; the last entry is their number, -1 where nothing is
        factorised.
    solved, free : (n,) arrays
    every : (n,) int array
        0, 1, ..
    """

    inverse: np.ndarray
    members: np.ndarray
    solved: np.ndarray
    free: np.ndarray
    every: np.ndarray


class _End(NamedTuple):
    """One end of a step: q and v (m,), modal forces of contact (m,), its forces, gaps, which rows touch."""

    q: np.ndarray
    v: np.ndarray
    pull: np.ndarray
    force: np.ndarray
    gap: np.ndarray
    active: np.ndarray


class Room(NamedTuple):
    """Room for steps: the factors of each level, both ends of a step and gaps in the thin space (r,)."""

    inverses: np.ndarray
    members: np.ndarray
    factor: Factor
    before: _End
    after: _End
    thin: np.ndarray


def step_constants(
    coefficients: Sequence[np.ndarray],
    factors: tuple[np.ndarray, np.ndarray],
    residual: np.ndarray,
    laws: RowLaws,
    omega: np.ndarray,
    halving: Halving = NEVER,
) -> StepConstants:
    """`StepConstants` from coefficients (10, m) of a step and of its halves, quarters .. and arrays in any
    layout: the factors U (pairs, r) and V (m, r), see `closed_sets.thin_factors`, and R.
    """
    left, right = factors
    flexibility = [left @ ((right.T * each[4]) @ right) @ left.T + residual for each in coefficients]
    return StepConstants(
        coefficients=np.ascontiguousarray(coefficients),
        left=np.ascontiguousarray(left.T),
        right=np.ascontiguousarray(right.T),
        flexibility=np.ascontiguousarray(flexibility),
        residual=np.ascontiguousarray(residual),
        tied=laws.tied,
        stiffness=omega**2,
        halving=halving,
    )


def empty_factor(rows: int) -> Factor:
    """Nothing is factorised yet."""
    members = np.full(rows + 1, -1)
    return Factor(np.empty((rows, rows)), members, np.empty(rows), np.empty(rows), np.arange(rows))


def empty_room(step: StepConstants) -> Room:
    """Room for steps with these constants."""
    rank, pairs = step.left.shape
    levels, _, modes = step.coefficients.shape

    def end() -> _End:
        q, v, pull, force, gap = (np.empty(size) for size in (modes, modes, modes, pairs, pairs))
        return _End(q, v, pull, force, gap, np.empty(pairs, dtype=bool))

    members = np.full((levels, pairs + 1), -1)
    return Room(np.empty((levels, pairs, pairs)), members, empty_factor(pairs), end(), end(), np.empty(rank))


@inner_sums
def products(rows, vector, count, width, result):
    """The first `count` rows, as far as `width`, times a vector."""
    for k in range(count):
        total = 0.0
        for i in range(width):
            total += rows[k, i] * vector[i]
        result[k] = total


@inner_loops
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


@inner_loops
def _arrange(active, members, joins):
    """Put the rows in contact in the order of the factor; returns how many are where they were, before
    the first one that left.
    """
    n = active.size
    kept, count = max(members[n], 0), 0
    for i in range(n):
        joins[i] = 1.0
    for k in range(kept):
        i = members[k]
        joins[i] = 0.0
        if active[i]:
            members[count] = i
            count += 1
        elif kept > count:
            kept = count
    for i in range(n):
        if active[i] and joins[i] > 0.0:
            members[count] = i
            count += 1
    members[n] = count
    return kept


@compiled_loops
def contact_forces(flexibility, gap, tied, active, factor, force):
    """Solve 0 <= force _|_ W force + gap >= 0, and W force + gap = 0 in tied rows, by block principal
    pivoting from the active set of the step before, which holds the tied rows.

    `active` and the `Factor` are kept between steps, where they need not be those of the same step; rows that
    join stand behind the others, so that those before the first one that leaves stay as they are. `free` is
    left with the gaps, unless all rows touch. The inverse is applied without waiting for one unknown to find
    the next. Returns the exchanges of the active set, -1 if the iteration did not end or W is not definite.
    """
    n = gap.size
    inverse, members, solved, free, every = factor
    best, patience, exchange = n + 1, PATIENCE, 0
    while exchange < 100 + 20 * n:
        kept = _arrange(active, members, free)
        count = members[n]
        # loops over whole vector registers: what stands beyond `count` is zero
        width = min(n, (count + WHOLE - 1) // WHOLE * WHOLE)
        for i in range(kept, count):
            row = members[i]
            for k in range(i):
                free[k] = flexibility[row, members[k]]
            for k in range(n):
                inverse[i, k] = 0.0
            products(inverse, free, i, i, solved)
            left = flexibility[row, row]
            for k in range(i):
                left -= solved[k] * solved[k]
            if not left > 0.0:
                members[n] = -1
                return -1
            scale = 1.0 / math.sqrt(left)
            for k in range(i):
                solved[k] *= -scale
            add_rows(inverse, every, solved, i, i, inverse[i])
            inverse[i, i] = scale
        for i in range(count):
            free[i] = -gap[members[i]]
        for i in range(count, width):
            free[i] = 0.0
        for i in range(width):
            solved[i] = 0.0
        products(inverse, free, count, width, force)
        add_rows(inverse, every, force, count, width, solved)
        for i in range(n):
            force[i] = 0.0
            free[i] = gap[i]
        for k in range(count):
            force[members[k]] = solved[k]
        if count < n:  # otherwise there are no gaps to look at
            add_rows(flexibility, members, solved, count, n, free)
        # an exchange of all rows with a wrong sign; `last` is what a single one would exchange
        infeasible, last = 0, -1
        for i in range(n):
            if (force[i] < 0.0 and not tied[i]) if active[i] else free[i] < 0.0:
                if patience <= 0 and not active[i]:
                    # a row that neither touches nor is apart, by rounding alone, would come and go for ever
                    size = abs(gap[i])
                    for k in range(count):
                        size += abs(flexibility[members[k], i] * solved[k])
                    if free[i] > -ROUND_OFF * size:
                        continue
                active[i] = not active[i]
                infeasible += 1
                last = i
        if infeasible == 0:
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
        exchange += 1
    members[n] = -1
    return -1


def march(step: StepConstants, loads: StepLoads, state: StepState, history: StepHistory) -> Marched:
    """Advance a reduced model over several steps; the state and the history are written in place."""
    external = loads.external if loads.external.any() else loads.external[:0]
    loads = StepLoads(*map(np.ascontiguousarray, (external, *loads[1:])))
    return Marched(*_march(step, loads, state, history, empty_room(step)))


@inner_loops
def _begin(step, loads, state, room):
    """The first end of the first step."""
    rank, pairs = step.left.shape
    every, end = room.factor.every, room.before
    for level in range(room.members.shape[0]):
        room.members[level, pairs] = -1
    for j in range(end.q.size):
        end.q[j], end.v[j], end.pull[j] = state.q[j], state.v[j], 0.0
    for i in range(pairs):
        end.force[i], end.active[i], end.gap[i] = state.force[i], state.active[i], loads.free_gap[0, i]
    products(step.left, end.force, rank, pairs, room.thin)
    add_rows(step.right, every, room.thin, rank, end.q.size, end.pull)
    products(step.right, end.q, rank, end.q.size, room.thin)
    add_rows(step.left, every, room.thin, rank, pairs, end.gap)
    add_rows(step.residual, every, end.force, pairs, pairs, end.gap)
    for i in range(pairs):
        if end.active[i]:
            end.gap[i] = 0.0


@inner_loops
def _take(step, loads, place, before, after, room):
    """A step of a level, from one share of a given step to another; returns the exchanges, -1 if the contact
    problem was not solved.
    """
    level, done, begin, end = place
    coefficients, left, right = step.coefficients[level], step.left, step.right
    external, free_gap, _ = loads
    q, v, pull = after.q, after.v, after.pull
    rank, pairs = left.shape
    m, every = q.size, room.factor.every
    for j in range(m):
        q[j] = (
            coefficients[0, j] * before.q[j]
            + coefficients[1, j] * before.v[j]
            + coefficients[4, j] * before.pull[j]
        )
        v[j] = (
            coefficients[5, j] * before.q[j]
            + coefficients[6, j] * before.v[j]
            + coefficients[9, j] * before.pull[j]
        )
    if external.shape[0] > 0:
        for j in range(m):
            first, last = external[done, j], external[done + 1, j]
            former, following = (1.0 - begin) * first + begin * last, (1.0 - end) * first + end * last
            q[j] += coefficients[2, j] * former + coefficients[3, j] * following
            v[j] += coefficients[7, j] * former + coefficients[8, j] * following
    products(right, q, rank, m, room.thin)
    for i in range(pairs):
        after.gap[i] = (1.0 - end) * free_gap[done, i] + end * free_gap[done + 1, i]
    add_rows(left, every, room.thin, rank, pairs, after.gap)
    pulled = False
    for i in range(pairs):
        after.active[i] = before.active[i]
        pulled |= before.active[i] or after.gap[i] < 0.0
    for j in range(m):
        pull[j] = 0.0
    if not pulled:
        for i in range(pairs):
            after.force[i] = 0.0
        return 0
    given = room.factor
    factor = Factor(room.inverses[level], room.members[level], given.solved, given.free, every)
    exchange = contact_forces(
        step.flexibility[level], after.gap, step.tied, after.active, factor, after.force
    )
    if exchange < 0:
        return exchange
    for i in range(pairs):
        after.gap[i] = 0.0 if after.active[i] else factor.free[i]
    products(left, after.force, rank, pairs, room.thin)
    add_rows(right, every, room.thin, rank, m, pull)
    for j in range(m):
        q[j] += coefficients[4, j] * pull[j]
        v[j] += coefficients[9, j] * pull[j]
    return exchange


@inner_sums
def _work(before, after):
    """Of contact in a step: mean of the forces times change of the gaps, one of which is zero at each end."""
    total = 0.0
    for i in range(before.gap.size):
        total += before.force[i] * after.gap[i] - after.force[i] * before.gap[i]
    return 0.5 * total


@inner_sums
def _energy(stiffness, end):
    """Of the modes."""
    total = 0.0
    for j in range(stiffness.size):
        total += end.v[j] * end.v[j] + stiffness[j] * end.q[j] * end.q[j]
    return 0.5 * total


@compiled_loops
def _march(step, loads, state, history, room):
    states, velocities, forces, works, parts = history
    halving, levels = step.halving, loads.levels
    steps, m = states.shape
    pairs, last = step.tied.size, step.coefficients.shape[0] - 1
    exchanges = unresolved = taken = 0
    _begin(step, loads, state, room)
    before, after = room.before, room.after
    for done in range(steps):
        works[done] = 0.0
        first = np.int64(levels[done])
        level, place, whole = first, 0, 1 << (last - first)
        while place < whole:
            size = 1 << (last - level)
            exchange = _take(
                step, loads, (level, done, place / whole, (place + size) / whole), before, after, room
            )
            if exchange < 0:
                return done, exchanges, unresolved, taken
            exchanges += exchange
            if exchange > 0:  # where no row changes sides there is no work
                work = _work(before, after)
                if abs(work) > halving.tolerance * (_energy(step.stiffness, after) + halving.floor):
                    if level < last:
                        level += 1
                        continue
                    unresolved += 1
                works[done] += work
            before, after = after, before
            place += size
            if parts.size > 0:
                parts[taken] = level
            taken += 1
            # a second half is done, and with it what it is a half of
            while level > first and place % (1 << (last - level + 1)) == 0:
                level -= 1
        for j in range(m):
            states[done, j] = before.q[j]
            velocities[done, j] = before.v[j]
        for i in range(pairs):
            forces[done, i] = before.force[i]
    for j in range(m):
        state.q[j], state.v[j] = before.q[j], before.v[j]
    for i in range(pairs):
        state.force[i], state.active[i] = before.force[i], before.active[i]
    return steps, exchanges, unresolved, taken

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
from typing import NamedTuple

import numpy as np

from .compiled import compiled_loops, inner_loops, inner_sums

# Full exchanges of the active set that may pass without fewer wrong signs before single exchanges by index
# take over; Judice and Pires (1994) show that this ends for every positive definite W.
PATIENCE = 5
# Numbers that a loop takes at a time at most: four vector registers of four.
WHOLE = 16


class StepConstants(NamedTuple):
    """What the steps of a reduced model have in common; see `step_constants`.

    Attributes
    ----------
    coefficients : (10, m) array
        aqq, aqv, bq, dq, cq, avq, avv, bv, dv, cv of each mode.
    left, right : (r, pairs), (r, m) arrays
        Rows of the factors of C = U V^T, gaps of the modes: U^T and V^T.
    flexibility : (pairs, pairs) array
        W.
    residual : (pairs, pairs) array
        R, which alone gives the forces of a state from which no step leads back.
    tied : (pairs,) bool array
        See `law.RowLaws`.
    """

    coefficients: np.ndarray
    left: np.ndarray
    right: np.ndarray
    flexibility: np.ndarray
    residual: np.ndarray
    tied: np.ndarray


class StepLoads(NamedTuple):
    """What drives several steps, at their n + 1 ends.

    Attributes
    ----------
    external : (n + 1, m) array
        Modal forces of the loads; (0, m) where there are none.
    free_gap : (n + 1, pairs) array
        Initial gaps and the residual flexibility's share of the loads.
    """

    external: np.ndarray
    free_gap: np.ndarray


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
    """Filled with q, v and the contact forces after each step: (n, m), (n, m), (n, pairs) arrays."""

    states: np.ndarray
    velocities: np.ndarray
    forces: np.ndarray


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


class Room(NamedTuple):
    """Room for steps: the factor, gaps (pairs,), those in the thin space (r,) and modal forces (m,)."""

    factor: Factor
    gap: np.ndarray
    thin: np.ndarray
    pull: np.ndarray


def step_constants(
    coefficients: np.ndarray,
    factors: tuple[np.ndarray, np.ndarray],
    flexibilities: tuple[np.ndarray, np.ndarray],
    tied: np.ndarray,
) -> StepConstants:
    """`StepConstants` from arrays in any layout: the factors U (pairs, r) and V (m, r), see
    `closed_sets.thin_factors`, and W and R.
    """
    left, right = factors
    arrays = (coefficients, left.T, right.T, *flexibilities, tied)
    return StepConstants(*map(np.ascontiguousarray, arrays))


def empty_factor(rows: int) -> Factor:
    """Nothing is factorised yet."""
    members = np.full(rows + 1, -1)
    return Factor(np.empty((rows, rows)), members, np.empty(rows), np.empty(rows), np.arange(rows))


def empty_room(step: StepConstants) -> Room:
    """Room for steps with these constants."""
    rank, pairs = step.left.shape
    return Room(empty_factor(pairs), np.empty(pairs), np.empty(rank), np.empty(step.right.shape[1]))


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


@compiled_loops
def contact_forces(flexibility, gap, tied, active, factor, force):
    """Solve 0 <= force _|_ W force + gap >= 0, and W force + gap = 0 in tied rows, by block principal
    pivoting from the active set of the step before, which holds the tied rows.

    `active` and the `Factor` are kept between steps; rows that join stand behind the others, so that those
    before the first one that leaves stay as they are. The inverse is applied without waiting for one unknown
    to find the next. Returns the exchanges of the active set, -1 if the iteration did not end or W is not
    definite.
    """
    n = gap.size
    inverse, members, solved, free, every = factor
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


def march(step: StepConstants, loads: StepLoads, state: StepState, history: StepHistory) -> tuple[int, int]:
    """Advance a reduced model over several steps; the state and the history are written in place.

    Returns
    -------
    steps, exchanges : int
        Steps done (fewer than n: a contact problem was not solved) and exchanges of active sets in all.
    """
    external = loads.external if loads.external.any() else loads.external[:0]
    loads = StepLoads(*map(np.ascontiguousarray, (external, loads.free_gap)))
    steps, exchanges = _march(step, loads, state, history, empty_room(step))
    return steps, exchanges


@compiled_loops
def _march(step, loads, state, history, room):
    coefficients, left, right, flexibility, _, tied = step
    external, free_gap = loads
    q, v, force, active = state
    states, velocities, forces = history
    factor, gap, thin, pull = room
    steps, m = states.shape
    rank, pairs = left.shape
    every, members = factor.every, factor.members
    members[pairs] = -1
    loaded = external.shape[0] > 0
    exchanges, pulled = 0, True
    for done in range(-1, steps):
        if done >= 0:
            for j in range(m):
                position = (
                    coefficients[0, j] * q[j] + coefficients[1, j] * v[j] + coefficients[4, j] * pull[j]
                )
                v[j] = coefficients[5, j] * q[j] + coefficients[6, j] * v[j] + coefficients[9, j] * pull[j]
                q[j] = position
            if loaded:
                for j in range(m):
                    before, following = external[done, j], external[done + 1, j]
                    q[j] += coefficients[2, j] * before + coefficients[3, j] * following
                    v[j] += coefficients[7, j] * before + coefficients[8, j] * following
            products(right, q, rank, m, thin)
            for i in range(pairs):
                gap[i] = free_gap[done + 1, i]
            add_rows(left, every, thin, rank, pairs, gap)
            pulled = members[pairs] != 0
            for i in range(pairs):
                pulled |= gap[i] < 0.0
            if pulled:
                exchange = contact_forces(flexibility, gap, tied, active, factor, force)
                if exchange < 0:
                    return done, exchanges
                exchanges += exchange
        if pulled:
            # modal forces of contact; before the first step those of the state that is given
            products(left, force, rank, pairs, thin)
            for j in range(m):
                pull[j] = 0.0
            add_rows(right, every, thin, rank, m, pull)
            if done >= 0:
                for j in range(m):
                    q[j] += coefficients[4, j] * pull[j]
                    v[j] += coefficients[9, j] * pull[j]
        if done >= 0:
            for j in range(m):
                states[done, j] = q[j]
                velocities[done, j] = v[j]
            for i in range(pairs):
                forces[done, i] = force[i]
    return steps, exchanges

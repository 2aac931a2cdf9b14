"""Exact derivative of the compiled time steps (`marching.march`) with the contact sets of a history.

Where no pair changes sides a step is linear: with the set A of pairs that touch at its end, the thin contact
forces p = U^T force obey dp = -K (V^T dq + ...), K = U_A^T W_AA^-1 U_A. A history's sets change seldom, so
the K of each run of steps is made once, and carrying many columns through a step takes two products with the
thin V. At the start of a history the force follows from the position alone, through the residual flexibility
R in the place of W.
"""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True)
def _condense(flexibility, left, touching):
    """U_A^T W_AA^-1 spread over all pairs, (r, pairs)."""
    pairs, rank = left.shape
    members = np.flatnonzero(touching)
    spread = np.zeros((rank, pairs))
    if members.size:
        block = np.empty((members.size, members.size))
        sides = np.empty((members.size, rank))
        for i in range(members.size):
            sides[i] = left[members[i]]
            for j in range(members.size):
                block[i, j] = flexibility[members[i], members[j]]
        solved = np.linalg.solve(block, sides)
        for i in range(members.size):
            spread[:, members[i]] = solved[i]
    return spread


@njit(cache=True)
def contact_operators(left, flexibility, residual, acting, gap_rates):
    """What contact contributes to the derivative of each step.

    Parameters
    ----------
    left : (pairs, r) array
    flexibility, residual : (pairs, pairs) arrays
        W of a step and R.
    acting : (n + 1, pairs) bool array
        Rows that keep their gaps at the steps' ends.
    gap_rates : (n + 1, pairs, e) array
        Rates of the free gaps with e parameters.

    Returns
    -------
    runs : (n + 1,) int array
        Which operator acts at each instant, -1 where nothing touches.
    operators : (k, r, r) array
        K of each run.
    shifts : (n + 1, r, e) array
        Part of -dp that the free gaps cause.
    """
    instants, pairs = acting.shape
    rank, parameters = left.shape[1], gap_rates.shape[2]
    runs = np.full(instants, -1)
    operators = np.empty((instants, rank, rank))
    shifts = np.zeros((instants, rank, parameters))
    count = 0
    touching = np.zeros(pairs, dtype=np.bool_)
    spread = np.zeros((rank, pairs))
    for n in range(instants):
        changed, some = n < 2, False
        for i in range(pairs):
            now = acting[n, i]
            changed |= now != touching[i]
            some |= now
            touching[i] = now
        if not some:
            continue
        if changed or runs[n - 1] < 0:
            spread = _condense(residual if n == 0 else flexibility, left, touching)
            operators[count] = spread @ left
            count += 1
        runs[n] = count - 1
        if parameters:
            shifts[n] = spread @ np.ascontiguousarray(gap_rates[n])
    return runs, operators[:count].copy(), shifts


@njit(cache=True)
def _overlap(residual, acting, force, pair):
    """By how much a pair would overlap without its own force, the others that touch remaining closed."""
    members = np.flatnonzero(acting)
    block, unit = np.empty((members.size, members.size)), np.zeros(members.size)
    for i in range(members.size):
        unit[i] = members[i] == pair
        for j in range(members.size):
            block[i, j] = residual[members[i], members[j]]
    return force[pair] / (unit @ np.linalg.solve(block, unit))


@njit(cache=True)
def located_operators(left, right, coefficients, residual, gaps, forces, closed):
    """As `contact_operators` without parameters, for the variational equation with each switch located inside
    its step.

    The steps hold a pair's force at the mean of their ends, so a pair acts over whole steps, and multipliers
    jump where a switch passes an instant of the grid. Here a switch stands where the gap without the pair's
    own force, linear over the step, vanishes; a step acts by the mean of K_R = U_A^T R_AA^-1 U_A over the
    sets A that it passes through, an instant by the mean of the steps beside it. What is left of the jumps is
    of second order in the step.

    Parameters
    ----------
    left, right : (pairs, r), (m, r) arrays
    coefficients : (10, m) array
        See `marching`.
    residual : (pairs, pairs) array
        R.
    gaps, forces : (n + 1, pairs) arrays
    closed : (n + 1, pairs) bool array
        Rows that keep their gaps.

    Returns
    -------
    runs, operators, shifts
        The last of size 0.
    """
    instants, pairs = forces.shape
    rank = left.shape[1]
    cq = coefficients[4]
    motion = np.zeros((rank, rank))
    for j in range(cq.size):
        for k in range(rank):
            for i in range(rank):
                motion[k, i] += right[j, k] * cq[j] * right[j, i]
    touching = closed[0].copy()
    now = _condense(residual, left, touching) @ left
    before, before_number, number = np.zeros((rank, rank)), -1, 0
    runs, operators, count = np.full(instants, -1), np.empty((instants, rank, rank)), 0
    last = (-2, -2)
    for n in range(instants):
        step, step_number = now, number
        if n < instants - 1:
            moments, which = np.empty(pairs), np.empty(pairs, dtype=np.int64)
            events = 0
            for i in range(pairs):
                if closed[n + 1, i] != touching[i]:
                    at = n if touching[i] else n + 1
                    overlap, gap = (
                        _overlap(residual, closed[at], forces[at], i),
                        max(gaps[2 * n + 1 - at, i], 0.0),
                    )
                    moments[events] = overlap / (overlap + gap) if touching[i] else gap / (overlap + gap)
                    which[events] = i
                    events += 1
            if events:
                step, passed = np.zeros((rank, rank)), 0.0
                for k in np.argsort(moments[:events]):
                    step += (moments[k] - passed) * now
                    passed = moments[k]
                    touching[which[k]] = not touching[which[k]]
                    now = _condense(residual, left, touching) @ left
                step += (1.0 - passed) * now
                step_number, number = number + 1, number + 2
        if n == 0:
            acting = step
        elif n == instants - 1:
            acting = before
        else:
            acting = 0.5 * (before + step)
        if np.any(acting != 0.0):
            if n < 2 or n == instants - 1 or last != (before_number, step_number):
                operators[count] = (
                    acting if n == 0 else np.linalg.solve(np.eye(rank) + acting @ motion, acting)
                )
                count += 1
            runs[n] = count - 1
        last = (before_number, step_number)
        before, before_number = step, step_number
    return runs, operators[:count].copy(), np.zeros((instants, rank, 0))


@njit(cache=True)
def carry(coefficients, right, runs, operators, shifts, sources, speed_sources, q, v):
    """Carry columns of dq and dv, (m, c), through all steps, in place.

    The last e columns are derivatives with parameters, whose sources (n, m, e) each step adds; the first c -
    e are derivatives with the initial state.

    Parameters
    ----------
    coefficients : (10, m) array
        See `marching`.
    right : (m, r) array
    runs, operators, shifts : arrays
        Of `contact_operators`.
    sources, speed_sources : (n, m, e) arrays
    q, v : (m, c) arrays
    """
    aqq, aqv, _, _, cq, avq, avv, _, _, cv = coefficients
    steps, m, parameters = sources.shape
    columns = q.shape[1]
    first = columns - parameters
    thin_rows = np.ascontiguousarray(right.T)
    pull = np.zeros((m, columns))
    pulled = runs[0] >= 0
    if pulled:
        thin = operators[runs[0]] @ (thin_rows @ q)
        thin[:, first:] += shifts[0]
        np.dot(right, -thin, pull)
    # contact at a step's end joins the next step's start in one pass over the columns; at the first instant
    # there is no step before it
    ended = False
    for n in range(steps):
        for j in range(m):
            a, b, d, e, f, g = aqq[j], aqv[j], avq[j], avv[j], cq[j], cv[j]
            if pulled:
                if ended:
                    f, g = a * f + b * g + f, d * f + e * g + g
                for k in range(columns):
                    position = a * q[j, k] + b * v[j, k] + f * pull[j, k]
                    v[j, k] = d * q[j, k] + e * v[j, k] + g * pull[j, k]
                    q[j, k] = position
            else:
                for k in range(columns):
                    position = a * q[j, k] + b * v[j, k]
                    v[j, k] = d * q[j, k] + e * v[j, k]
                    q[j, k] = position
            for k in range(parameters):
                q[j, first + k] += sources[n, j, k]
                v[j, first + k] += speed_sources[n, j, k]
        pulled, ended = runs[n + 1] >= 0, True
        if pulled:
            thin = operators[runs[n + 1]] @ (thin_rows @ q)
            thin[:, first:] += shifts[n + 1]
            np.dot(right, -thin, pull)
    if pulled and ended:
        for j in range(m):
            for k in range(columns):
                q[j, k] += cq[j] * pull[j, k]
                v[j, k] += cv[j] * pull[j, k]

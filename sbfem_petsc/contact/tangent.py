"""Exact derivative of the compiled time steps (`marching.march`) with the contact sets of a history.

Where no pair changes sides a step is linear: with the set A of pairs that touch at its end, the thin contact forces p = U^T force obey
dp = -K (V^T dq + ...), K = U_A^T W_AA^-1 U_A. A history's sets change seldom, so the K of each run of steps is made once, and carrying many
columns through a step takes two products with the thin V. At the start of a history the force follows from the position alone, through the
residual flexibility R in the place of W.
"""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True)
def _condense(flexibility, left, touching, share):
    """U_A^T W_AA^-1 spread over all pairs, (r, pairs); each pair acts by its share, a half of it on either side."""
    pairs, rank = left.shape
    members = np.flatnonzero(touching)
    spread = np.zeros((rank, pairs))
    if members.size:
        block = np.empty((members.size, members.size))
        sides = np.empty((members.size, rank))
        for i in range(members.size):
            sides[i] = left[members[i]] * np.sqrt(share[members[i]])
            for j in range(members.size):
                block[i, j] = flexibility[members[i], members[j]]
        solved = np.linalg.solve(block, sides)
        for i in range(members.size):
            spread[:, members[i]] = solved[i] * np.sqrt(share[members[i]])
    return spread


@njit(cache=True)
def contact_operators(left, flexibility, residual, forces, gap_rates, shares):
    """What contact contributes to the derivative of each step.

    Parameters
    ----------
    left : (pairs, r) array
    flexibility, residual : (pairs, pairs) arrays
        W of a step and R.
    forces : (n + 1, pairs) array
        Contact forces at the steps' ends; a pair touches where its force is not zero.
    gap_rates : (n + 1, pairs, e) array
        Rates of the free gaps with e parameters.
    shares : (n + 1, pairs) array
        Ones for the derivative of the steps as they are; see `switch_shares`.

    Returns
    -------
    runs : (n + 1,) int array
        Which operator acts at each instant, -1 where nothing touches.
    operators : (k, r, r) array
        K of each run.
    shifts : (n + 1, r, e) array
        Part of -dp that the free gaps cause.
    """
    instants, pairs = forces.shape
    rank, parameters = left.shape[1], gap_rates.shape[2]
    runs = np.full(instants, -1)
    operators = np.empty((instants, rank, rank))
    shifts = np.zeros((instants, rank, parameters))
    count = 0
    touching = np.zeros(pairs, dtype=np.bool_)
    share = np.ones(pairs)
    spread = np.zeros((rank, pairs))
    for n in range(instants):
        changed, some = n < 2, False
        for i in range(pairs):
            now = forces[n, i] != 0.0
            changed |= now != touching[i] or (now and shares[n, i] != share[i])
            some |= now
            touching[i], share[i] = now, shares[n, i]
        if not some:
            continue
        if changed or runs[n - 1] < 0:
            spread = _condense(residual if n == 0 else flexibility, left, touching, share)
            operators[count] = spread @ left
            count += 1
        runs[n] = count - 1
        if parameters:
            shifts[n] = spread @ np.ascontiguousarray(gap_rates[n])
    return runs, operators[:count].copy(), shifts


@njit(cache=True)
def switch_shares(gaps, forces, residual):
    """Shares with which pairs act in the variational equation at the instants before and after they close or open.

    The steps hold a pair's force at the mean of their ends, so a pair acts over whole steps and the multipliers jump when a switch passes an instant
    of the grid. With the switch located inside its step, linearly between the gap before it and the overlap that the force stands for
    behind it, a pair acts as long as it touches; what is left of the jumps is of second order in the step.

    Parameters
    ----------
    gaps, forces : (n + 1, pairs) arrays
    residual : (pairs, pairs) array
        R.

    Returns
    -------
    (n + 1, pairs) array
    """
    instants, pairs = forces.shape
    shares = np.ones((instants, pairs))
    for n in range(instants):
        for i in range(pairs):
            if forces[n, i] == 0.0:
                continue
            overlap = residual[i, i] * forces[n, i]
            before = 0.5
            if n > 0 and forces[n - 1, i] == 0.0:
                before = overlap / (overlap + max(gaps[n - 1, i], 0.0))
            after = 0.5
            if n < instants - 1 and forces[n + 1, i] == 0.0:
                after = overlap / (overlap + max(gaps[n + 1, i], 0.0))
            # the first and the last instant belong to one step each
            shares[n, i] = 2.0 * after if n == 0 else 2.0 * before if n == instants - 1 else before + after
    return shares


@njit(cache=True)
def carry(coefficients, right, runs, operators, shifts, sources, speed_sources, q, v):
    """Carry columns of dq and dv, (m, c), through all steps, in place.

    The last e columns are derivatives with parameters, whose sources (n, m, e) each step adds; the first c - e are derivatives with the initial state.

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
        pull = -(right @ thin)
    for n in range(steps):
        for j in range(m):
            a, b, d, e, f, g = aqq[j], aqv[j], avq[j], avv[j], cq[j], cv[j]
            if pulled:
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
        pulled = runs[n + 1] >= 0
        if pulled:
            thin = operators[runs[n + 1]] @ (thin_rows @ q)
            thin[:, first:] += shifts[n + 1]
            pull = -(right @ thin)
            for j in range(m):
                f, g = cq[j], cv[j]
                for k in range(columns):
                    q[j, k] += f * pull[j, k]
                    v[j, k] += g * pull[j, k]

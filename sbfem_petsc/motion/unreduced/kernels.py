"""Compiled sweeps over the large vectors of unreduced steps: what counts is the traffic from memory."""

from __future__ import annotations

import numpy as np

from ...contact.compiled import compiled


@compiled
def form(right: np.ndarray, mass_v: np.ndarray, stiffness_u: np.ndarray, rate: float) -> None:
    """Right side of a step but for the loads."""
    for i in range(right.size):
        right[i] = 2.0 * (rate * mass_v[i] - stiffness_u[i])


@compiled
def add_columns(target: np.ndarray, columns: np.ndarray, values: np.ndarray) -> None:
    """target += columns @ values over the values that are not zero, four columns at a time: what counts is
    the traffic from memory.
    """
    used = np.flatnonzero(values)
    places, weights = np.zeros((used.size + 3) // 4 * 4, dtype=np.int64), np.zeros((used.size + 3) // 4 * 4)
    places[: used.size], weights[: used.size] = used, values[used]
    for j in range(0, places.size, 4):
        one, two, three, four = (
            columns[:, places[j]],
            columns[:, places[j + 1]],
            columns[:, places[j + 2]],
            columns[:, places[j + 3]],
        )
        for i in range(target.size):
            target[i] += (one[i] * weights[j] + two[i] * weights[j + 1]) + (
                three[i] * weights[j + 2] + four[i] * weights[j + 3]
            )


@compiled
def advance(
    moving: tuple[np.ndarray, ...], increment: tuple[np.ndarray, ...], factors: tuple[float, float, float]
) -> tuple[float, float]:
    """States after a step; products of d with M d and K d.

    Parameters
    ----------
    moving : (u, v, M v, K u)
        Advanced in place.
    increment : (d, K d, right)
        d = u1 - u0, and the right side of the step's equation (inertia M + stretch K) d = right.
    factors : (inertia, stretch, rate)
        Of M and K in it, 1/s^2 and 1, and of d in v0 + v1 = rate d, 1/s.
    """
    u, v, mass_v, stiffness_u = moving
    d, stiffness_d, right = increment
    inertia, stretch, rate = factors
    by_mass, by_stiffness = 0.0, 0.0
    for i in range(u.size):
        mass_d = (right[i] - stretch * stiffness_d[i]) / inertia
        by_mass += d[i] * mass_d
        by_stiffness += d[i] * stiffness_d[i]
        u[i] += d[i]
        v[i] = rate * d[i] - v[i]
        mass_v[i] = rate * mass_d - mass_v[i]
        stiffness_u[i] += stiffness_d[i]
    return by_mass, by_stiffness

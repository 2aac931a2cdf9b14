"""Coefficients of one time step of modal equations."""

from __future__ import annotations

import numpy as np
from scipy import linalg


def step_coefficients(omega: np.ndarray, damping: np.ndarray, step: float, scheme: str) -> np.ndarray:
    """(10, m) coefficients of one step of each mode, see `contact.marching`.

    Parameters
    ----------
    omega, damping : (m,) arrays
        rad/s and damping ratios.
    step : float
        s.
    scheme : {"exact", "newmark"}
    """
    return (_exact if scheme == "exact" else _newmark)(omega, damping, step)


def _exact(omega: np.ndarray, damping: np.ndarray, step: float) -> np.ndarray:
    """Exact for loads linear over the step and contact forces held at the mean of its ends: exponential of
    [q, v, p, p'] of each mode.
    """
    generator = np.zeros((len(omega), 4, 4))
    generator[:, 0, 1] = generator[:, 1, 2] = generator[:, 2, 3] = step
    generator[:, 1, 0], generator[:, 1, 1] = -(omega**2) * step, -2.0 * damping * omega * step
    e = linalg.expm(generator)
    rows = []
    for k in (0, 1):
        slope = e[:, k, 3] / step
        rows += [e[:, k, 0], e[:, k, 1], e[:, k, 2] - slope, slope, 0.5 * e[:, k, 2]]
    return np.array(rows)


def _newmark(omega: np.ndarray, damping: np.ndarray, step: float) -> np.ndarray:
    """Average acceleration (beta = 1/4, gamma = 1/2)."""
    stiffness, friction = 0.25 * (step * omega) ** 2, 0.5 * step * damping * omega
    one = np.ones_like(omega)
    left = np.moveaxis(
        np.array([[one + stiffness, step * friction], [2.0 * stiffness / step, one + 2.0 * friction]]), 2, 0
    )
    right = np.moveaxis(
        np.array(
            [
                [one - stiffness, step * (one - friction), 0.25 * step**2 * one],
                [-2.0 * stiffness / step, one - 2.0 * friction, 0.5 * step * one],
            ]
        ),
        2,
        0,
    )
    s = np.linalg.solve(left, right)
    return np.array(
        [row for k in (0, 1) for row in (s[:, k, 0], s[:, k, 1], s[:, k, 2], s[:, k, 2], s[:, k, 2])]
    )

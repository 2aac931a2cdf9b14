"""The exact period of masses with elastic stops, from contact change to contact change: SciPy's DOP853 with
events, the variational equation beside it.

A stop's force begins at zero, so that the vector field is continuous where a stop is met and left: the
derivative goes on unchanged there (its saltation matrix is the identity).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

TURN = 2.0 * np.pi


class EventMap:
    """M u'' + C u' + K u = F sin(omega t) + R^T p, with p_i = max(0, -k_i g_i) and gaps g = R u + g0.

    States are x = (u, u').

    Parameters
    ----------
    mass, damping, stiffness : (n, n) arrays
    rows : (s, n) array
        R.
    gaps, stops : (s,) arrays
        g0, k.
    force : (n,) array
    """

    def __init__(self, mass, damping, stiffness, rows, gaps, stops, force):
        self.size, inverse = len(mass), np.linalg.inv(mass)
        self.rows, self.gaps, self.stops = (np.array(item, dtype=float) for item in (rows, gaps, stops))
        self._free, self._damping = inverse @ stiffness, inverse @ damping
        self._push, self._force = inverse @ self.rows.T, inverse @ force

    def matrix(self, closed: np.ndarray) -> np.ndarray:
        """Of x' = A x + b with these stops met."""
        held = self._free + (self._push * (self.stops * closed)) @ self.rows
        n = self.size
        return np.block([[np.zeros((n, n)), np.eye(n)], [-held, -self._damping]])

    def period(self, state: np.ndarray, frequency: float, periods: int = 1) -> tuple[np.ndarray, np.ndarray]:
        """x after some periods of the load, and its derivative with the state."""
        n, omega, time = self.size, TURN * frequency, 0.0
        end, whole = periods / frequency, np.eye(2 * n)
        state = np.array(state, dtype=float)
        closed = self._closed(state)
        while time < end:
            matrix = self.matrix(closed)
            push = np.append(np.zeros(n), -(self._push * (self.stops * closed)) @ self.gaps)

            def rate(t, y, matrix=matrix, push=push):
                z = y.reshape(1 + 2 * n, 2 * n)
                change = z @ matrix.T
                change[0] += push
                change[0, n:] += self._force * np.sin(omega * t)
                return change.ravel()

            events = [self._event(k, bool(shut)) for k, shut in enumerate(closed)]
            y = np.concatenate([state, np.eye(2 * n).ravel()])  # the derivative's columns one after the other
            for longest in (0.05, 0.002):
                piece = solve_ivp(
                    rate,
                    (time, end),
                    y,
                    "DOP853",
                    rtol=1e-11,
                    atol=1e-13,
                    events=events,
                    max_step=longest / frequency,
                    dense_output=True,
                )
                assert piece.success, piece.message
                if not self._missed(piece, closed):  # a touch within a step
                    break
            last = piece.y[:, -1].reshape(1 + 2 * n, 2 * n)
            time, state, whole = float(piece.t[-1]), last[0], last[1:].T @ whole
            for k, found in enumerate(piece.t_events):
                closed[k] ^= len(found) > 0
        return state, whole

    def _closed(self, state: np.ndarray) -> np.ndarray:
        gap = self.rows @ state[: self.size] + self.gaps
        rate = self.rows @ state[self.size :]
        return (gap < 0.0) | ((gap == 0.0) & (rate < 0.0))

    def _missed(self, piece, closed: np.ndarray) -> bool:
        between = piece.sol(np.linspace(piece.t[0], piece.t[-1], 1002)[1:-1])[: self.size]
        gap = self.rows @ between + self.gaps[:, None]
        return bool((((gap < 0.0) != closed[:, None]) & (np.abs(gap) > 1e-9)).any())

    def _event(self, row: int, shut: bool) -> Callable:
        def gap(t, y):
            return self.rows[row] @ y[: self.size] + self.gaps[row]

        gap.terminal, gap.direction = True, 1.0 if shut else -1.0  # type: ignore[attr-defined]
        return gap

    def orbit(self, state: np.ndarray, frequency: float, periods: int = 1) -> tuple[np.ndarray, np.ndarray]:
        """The periodic motion near a state, by Newton's method, and the derivative of its period."""
        for _ in range(12):
            end, derivative = self.period(state, frequency, periods)
            missed = end - state
            if np.linalg.norm(missed) < 1e-10 * max(1.0, np.linalg.norm(state)):
                return state, derivative
            state = state + np.linalg.solve(np.eye(len(state)) - derivative, missed)
        raise AssertionError(f"no periodic motion near {state} at {frequency}")

    def multipliers(self, state: np.ndarray, frequency: float, periods: int = 1) -> np.ndarray:
        """Of the periodic motion near a state, by falling modulus."""
        values = np.linalg.eigvals(self.orbit(state, frequency, periods)[1])
        return values[np.argsort(-np.abs(values), kind="stable")]

    def doubling(self, state: np.ndarray, frequency: float, apart: float = 1e-4) -> float:
        """The frequency near one at which a multiplier is -1, sought within `apart` of it, relative."""
        known = {}

        def excess(f: float) -> float:
            near = known[min(known, key=lambda other: abs(other - f))] if known else state
            known[f], derivative = self.orbit(near, f)
            return float(np.linalg.det(derivative + np.eye(2 * self.size)))

        for reach in (1.0, 4.0, 16.0, 64.0):
            low, high = frequency * (1.0 - reach * apart), frequency * (1.0 + reach * apart)
            if excess(low) * excess(high) < 0.0:
                return brentq(excess, low, high, xtol=1e-9 * frequency)
        raise AssertionError(f"no period doubling near {frequency}")


def two_masses_exactly(force: float, compliance: float = 0.01, damping: float = 0.03) -> EventMap:
    """Those of `systems.two_masses` under a load of some amplitude."""
    stiffness = np.array([[1.0, -1.0], [-1.0, 2.0]])
    load = [0.0, force]
    return EventMap(np.eye(2), damping * stiffness, stiffness, [[1.0, 0.0]], [1.0], [1.0 / compliance], load)

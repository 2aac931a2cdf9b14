"""Rates of signals: of displacements that are prescribed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .signal import JUST, Constant, Signal, Sum
from .waves import Harmonic


@dataclass(frozen=True, repr=False)
class Rate(Signal):
    """Rate of a signal that is continuous, by its differences over `step` (s), within which no turn of it
    (`breaks`, and t = 0) lies: next to one they are taken on the other side, there on that which is asked
    for.
    """

    signal: Signal
    step: float

    @property
    def highest_frequency(self) -> float | None:
        return self.signal.highest_frequency

    @property
    def breaks(self) -> tuple[float, ...]:
        return self.signal.breaks

    def _values(self, t: np.ndarray, side: int = 0) -> np.ndarray:
        turns = np.unique([-np.inf, 0.0, *self.signal.breaks, np.inf])
        slack = JUST * np.abs(t)
        after = np.searchsorted(turns, t + slack, side="right")
        next_one, last = turns[after], turns[after - 1]
        at = np.abs(t - last) <= slack
        half = 0.5 * self.step
        right = np.minimum(next_one - t, half)
        left = np.where(at, np.where(side < 0, half, 0.0), np.minimum(t - last, half))
        right = np.where(at & (side < 0), 0.0, right)
        one, other = self.signal.after, self.signal.before
        both = (left == half) & (right == half)
        change = other(t + half) - one(t - half)
        # to the side on which there is more room, of second order
        reach = np.where(right >= left, right, -left)
        ahead = reach > 0.0
        middle, end = t + 0.5 * reach, t + reach
        start = np.where(ahead, one(t), other(t))
        final = np.where(ahead, other(end), one(end))
        slope = 4.0 * self.signal(middle) - 3.0 * start - final
        return np.where(both, change / self.step, slope / np.where(both, self.step, reach))


def rate_of(signal: Signal, step: float) -> Signal:
    """The rate of a signal that is continuous: in closed form of tones and constants, else by differences
    over a step (s).
    """
    if isinstance(signal, Sum):
        return Sum(tuple(rate_of(part, step) for part in signal.parts))
    if isinstance(signal, Constant):
        return Constant(0.0)
    if isinstance(signal, Harmonic):
        speed = 2.0 * np.pi * signal.frequency
        return Harmonic(speed * signal.amplitude, signal.frequency, signal.phase + 0.5 * np.pi)
    return Rate(signal, step)

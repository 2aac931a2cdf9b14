"""The range of a branch's parameter and the settings by which it is followed."""

from __future__ import annotations

import math
from dataclasses import dataclass

from .period_map import DrivenPeriod, Period


@dataclass(frozen=True)
class ParameterRange:
    """The parameter of a branch and where it goes.

    Attributes
    ----------
    name : {"frequency", "load"}
        Forcing frequency (Hz), or factor on the oscillating loads.
    start, stop : float
    frequency : float or None
        Hz, where the load is the parameter.
    before : float
        How far the branch may go to the other side of `start`; it begins there where this is not zero.
    """

    name: str
    start: float
    stop: float
    frequency: float | None = None
    before: float = 0.0

    @property
    def lower(self) -> float:
        """The lesser end."""
        if self.stop < self.start:
            return self.stop
        return max(self.start - self.before, 1e-9 * self.stop) if self.before else self.start

    @property
    def upper(self) -> float:
        """The greater end."""
        return self.stop if self.stop > self.start else self.start + self.before

    @property
    def extent(self) -> float:
        """Length of the range."""
        return self.upper - self.lower

    @property
    def direction(self) -> int:
        """+1 or -1: where the parameter goes at first."""
        towards = 1 if self.stop > self.start else -1
        return -towards if self.before else towards

    def reached(self, value: float) -> bool:
        """Whether a value is at `stop` or beyond it."""
        return value >= self.stop if self.stop > self.start else value <= self.stop

    def holds(self, value: float) -> bool:
        """Whether a value lies inside, the ends excluded."""
        return self.lower < value < self.upper

    def nearest(self, value: float) -> float:
        """The value of the range, its ends included, that is nearest to one."""
        return min(max(value, self.lower), self.upper)

    def at(self, period: Period, value: float) -> DrivenPeriod:
        """The driven period of a value of the parameter."""
        return period.at(*self.conditions(value))

    def conditions(self, value: float) -> tuple[float, float]:
        """Forcing frequency (Hz) and load factor of a value of the parameter."""
        if self.frequency is None:
            return value, 1.0
        return self.frequency, value


@dataclass(frozen=True)
class ContinuationSettings:
    """How a branch is followed.

    Attributes
    ----------
    points : int
        Points at most.
    largest_step : float
        Largest change of the parameter from a point to the next one.
    stability : bool
        Whether Floquet multipliers and bifurcations are computed.
    leave : bool
        The first motion is next to a period doubling, and the branch goes away from it.
    more : str
        How there could be more points, for the warning of a branch that ends after so many.
    """

    points: int = 400
    largest_step: float = math.inf
    stability: bool = True
    leave: bool = False
    more: str = "raise points"

"""Branches of periodic motions by pseudo-arclength continuation in the frequency or the load, through
folds.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator

import numpy as np

from ..dynamics.several_periods import minimal_periods, passes_shorter
from ..errors import SolveError
from .shooting import Period, Shot, shoot_along

# Arc length in which the state's relative change and SPAN times the parameter's relative change are summed as
# squares.
SPAN = 10.0
FIRST, LARGEST, SMALLEST = 0.05, 0.35, 1e-5
# The turn of the branch between two steps that is aimed at, and beyond which a step is taken again at half
# its length; radian.
TURN, TOO_SHARP = 0.35, 1.0
# Newton iterations a step should take, and more than which is a sign that it has met another branch.
COMFORT, TOO_MANY = 4, 7
# Below this length a turn is a corner of the branch, where a pair begins to touch, and is taken.
CORNER = 5e-3
# Beyond a corner, a point in the direction of what lies behind, by this cosine, is on the part of the branch
# that has been gone through.
BACK = 0.999


class Station:
    """A point of a branch.

    Attributes
    ----------
    shot : Shot
    value : float
        The parameter: frequency (Hz) or factor on the oscillating loads.
    """

    def __init__(self, shot: Shot, value: float):
        self.shot, self.value = shot, value

    def derivative(self, name: str) -> np.ndarray:
        """dx(T) along x(0) and the named parameter, (2 m, 2 m + 1)."""
        if not hasattr(self, "_derivative"):
            self._derivative = self.shot.driven.carried(
                self.shot.motion, np.eye(len(self.shot.state)), (name,)
            )
        return self._derivative


class Trace:
    """A branch of fixed points, point by point.

    Iterating gives a `Station` after each accepted step, the end of the range included; afterwards `reason`
    says why it stopped.

    Parameters
    ----------
    period : Period
    first : Station
        A converged point.
    name : {"frequency", "load"}
    lower, upper : float
        Range of the parameter; the branch ends where it leaves the range.
    direction : int
        +1 or -1: where the parameter goes at first.
    driven : callable
        DrivenPeriod of a value of the parameter.
    most : int
        Points at most.
    largest_step : float
        Largest change of the parameter from a point to the next one.

    Notes
    -----
    Assigning more points to `stations` before the first step resumes a branch.
    """

    def __init__(
        self,
        period: Period,
        first: Station,
        name: str,
        lower: float,
        upper: float,
        direction: int,
        driven: Callable,
        most: int = 400,
        largest_step: float = math.inf,
    ):
        self.period, self.name, self.driven, self.most, self.largest_step = (
            period,
            name,
            driven,
            most,
            largest_step,
        )
        self.lower, self.upper, self.range = lower, upper, upper - lower
        self.stations = [first]
        # where a branch starts from rest its state has no size of its own
        self.least = 1e-3 * max(np.linalg.norm(driven(value).linear_state) for value in (lower, upper))
        self.direction, self.length, self.reason = direction, FIRST, ""
        self.sign = None
        # the fewest forcing periods after which the first motion repeats itself; a branch of several has
        # ended where it meets one of fewer
        self.periods, self.fallen = minimal_periods(first.shot), ""

    def __iter__(self) -> Iterator[Station]:
        while True:
            if len(self.stations) >= self.most:
                self.reason = f"{self.most} points"
                return
            station = self._next()
            if station is None:
                return
            yield station
            if not self.lower < station.value < self.upper:
                self.reason = f"end of the range at {station.value:.8g}"
                return

    # ------------------------------------------------------------------ one step
    def _metric(self) -> tuple[float, float]:
        """Units of the state and of the parameter."""
        return max(np.linalg.norm(self.stations[-1].shot.state), self.least, 1e-300), self.range / SPAN

    def _tangent(self, derivative: np.ndarray, near: np.ndarray) -> np.ndarray:
        """Direction in which the linearised residual does not change, in units of the metric; at a converged
        point the branch's tangent.

        Its sign is such that the determinant of residual and tangent keeps its sign along the branch: so it
        passes folds and corners, also those that a step has skipped. `near` is a direction not across it.
        """
        size, unit = self._metric()
        m2 = len(derivative)
        bordered = np.empty((m2 + 1, m2 + 1))
        bordered[:m2, :m2] = (derivative[:, :m2] - np.eye(m2)) * size
        bordered[:m2, m2] = derivative[:, m2] * unit
        # the last row is made as large as the others
        bordered[m2] = near * np.abs(bordered[:m2]).max()
        tangent = np.linalg.solve(bordered, np.eye(m2 + 1)[m2])
        sign = np.linalg.slogdet(bordered)[0]
        if self.sign is None:
            self.sign = sign
        return (1.0 if sign == self.sign else -1.0) * tangent / np.linalg.norm(tangent)

    def _secant(self, one: Station, other: Station) -> np.ndarray:
        size, unit = self._metric()
        step = np.append((other.shot.state - one.shot.state) / size, (other.value - one.value) / unit)
        return step / np.linalg.norm(step)

    def _next(self) -> Station | None:
        last = self.stations[-1]
        heading = self._heading()
        length = min(self.length, self.largest_step / (self._metric()[1] * max(abs(heading[-1]), 1e-12)))
        while length >= SMALLEST:
            station = self._step(heading, length)
            if station is None and length < CORNER:
                if self.fallen:  # turning about there would be going back
                    break
                station = self._around(heading, length)
            if station is not None:
                self.stations.append(station)
                self.fallen = ""
                return station
            length *= 0.5
        self.reason = self.fallen or f"no further point within a step of {SMALLEST:g} at {last.value:.8g}"
        return None

    def _heading(self) -> np.ndarray:
        """Tangent at the last point; at the first one the parameter goes where it is to go."""
        last = self.stations[-1]
        near = np.zeros(len(last.shot.state) + 1)
        near[-1] = self.direction
        if len(self.stations) > 1:
            near = self._secant(*self.stations[-2:])
        return self._tangent(last.derivative(self.name), near)

    def _around(self, heading: np.ndarray, length: float) -> Station | None:
        """A point beyond a corner of the branch, where a pair begins or ceases to touch: in the direction of
        the derivative on the corner's far side.
        """
        size, unit = self._metric()
        last = self.stations[-1]
        try:
            driven = self.driven(last.value + length * unit * heading[-1])
            motion = driven.run(last.shot.state + length * size * heading[:-1])
            beyond = self._tangent(
                driven.carried(motion, np.eye(len(last.shot.state)), (self.name,)), heading
            )
        except (SolveError, ValueError):
            return None
        # a stiff stop is hardly pressed beyond its corner: only a step much longer than the way to the corner
        # gets there
        for reach in (1.0, 8.0, 64.0):
            station = self._step(beyond, min(reach * length, CORNER), behind=-heading)
            if station is not None:
                return station
        return None

    def _step(self, heading: np.ndarray, length: float, behind: np.ndarray | None = None) -> Station | None:
        """The branch's point in the plane across a heading, if Newton's method finds it at ease; sets the
        length of the step after it.
        """
        size, unit = self._metric()
        last = self.stations[-1]
        target = last.value + length * unit * heading[-1]
        outside = not self.lower < target < self.upper
        if outside:  # land on the end of the range: the condition is then the parameter's value
            end = self.upper if target >= self.upper else self.lower
            length = (end - last.value) / (unit * heading[-1])
        guess, value = last.shot.state + length * size * heading[:-1], end if outside else target

        def condition(state, change):
            if outside:
                return size / unit * change, np.zeros(len(state)), size / unit
            return (
                float(heading[:-1] @ (state - guess) + size / unit * heading[-1] * change),
                heading[:-1],
                size / unit * heading[-1],
            )

        try:
            shot = shoot_along(self.period, guess, value, self.driven, self.name, condition)
        except (SolveError, ValueError):
            return None
        station = Station(shot, end if outside else float(shot.parameters[0]))
        fewer = passes_shorter(last.shot, shot) if self.periods > 1 else 0
        if fewer:
            self.fallen = (
                f"the branch of {self.periods} periods falls onto a motion of {fewer} at {station.value:.8g}"
            )
            return None
        chord = self._secant(last, station)
        if behind is not None and chord @ behind > BACK:
            return None
        onward = self._tangent(station.derivative(self.name), chord)
        turn = float(np.arccos(np.clip(min(onward @ chord, chord @ heading), -1.0, 1.0)))
        iterations = len(shot.residuals) - 1
        if length > CORNER and (turn > TOO_SHARP or iterations > TOO_MANY):
            return None
        if onward @ chord < 0.0:  # a branch point: the determinant has changed its sign on a smooth branch
            self.sign = -self.sign
        self.length = min(
            LARGEST, max(0.5, min(2.0, TURN / max(turn, 1e-3), COMFORT / max(iterations, 1) + 0.25)) * length
        )
        return station

"""Branches of periodic motions by pseudo-arclength continuation in the frequency or the load, through
folds.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy import linalg

from ..errors import SolveError
from .branch_range import ContinuationSettings, ParameterRange
from .fixed_point import FixedPoint
from .period_map import DrivenPeriod, Period
from .several_periods import minimal_periods, passes_shorter
from .shooting import shoot_along

# Arc length in which the state's relative change and SPAN times the parameter's relative change are summed as
# squares.
SPAN = 10.0
FIRST, LARGEST, SMALLEST = 0.05, 0.35, 1e-5
# A step that is the parameter's by more than this share is taken to a value of it, so that one preparation of
# the period serves all iterations.
HELD = 0.7
# The turn of the branch between two steps that is aimed at, and beyond which a step is taken again at half
# its length; radian.
TURN, TOO_SHARP = 0.35, 1.0
# Further than this from its heading a step has come to another part of the branch, radian.
ASIDE = 1.0
# Newton iterations a step should take, and more than which is a sign that it has met another branch.
COMFORT, TOO_MANY = 4, 7
# Below this length a turn is a corner of the branch, where a pair begins to touch, and is taken.
CORNER = 5e-3
# Of the state: how near the last point is to the first one if it is the same motion.
SAME = 1e-6
# Of the range: the parameter of a branch that goes no further does not change.
STILL = 1e-9
# Beyond a corner, a point in the direction of what lies behind, by this cosine, is on the part of the branch
# that has been gone through.
BACK = 0.999
# A tangent that points back so straight is that of a smooth branch at which the determinant has changed its
# sign, and not of the far side of a corner.
STRAIGHT = 0.999
# The same of a branch that bends there: a point this near, of its distance from the last one, to the parabola
# through the last three.
ALONG = 0.05
DEFAULT = ContinuationSettings()
# What may help where motions are not isolated.
ELSEWHERE = "hold it, give it damping, or begin elsewhere"


class ContinuationPoint:
    """A point of a branch.

    Attributes
    ----------
    fixed : FixedPoint
    value : float
        The parameter: frequency (Hz) or factor on the oscillating loads.
    """

    def __init__(self, fixed: FixedPoint, value: float):
        self.fixed, self.value = fixed, value

    def derivative(self, name: str) -> np.ndarray:
        """dx(T) along x(0), with switches located inside their steps, and the named parameter,
        (2 m, 2 m + 1).
        """
        return self.fixed.derivative(name)


class Continuation:
    """A branch of fixed points, point by point.

    Iterating gives a `ContinuationPoint` after each accepted step, the end of the range included; afterwards
    `reason` says why it stopped.

    Parameters
    ----------
    period : Period
    first : ContinuationPoint
        A converged point.
    parameter : ParameterRange
        The branch ends where it leaves the range.
    settings : ContinuationSettings

    Attributes
    ----------
    points : list of ContinuationPoint
        More of them before the first step resume a branch.
    length : float
        Of the next step.
    reason, advice : str
        Why it stopped, and what may help if it should not have.
    """

    def __init__(
        self,
        period: Period,
        first: ContinuationPoint,
        parameter: ParameterRange,
        settings: ContinuationSettings = DEFAULT,
    ):
        self.period, self.parameter, self.settings = period, parameter, settings
        self.points = [first]
        # where a branch starts from rest its state has no size of its own
        ends = (parameter.at(period, value) for value in (parameter.lower, parameter.upper))
        self.least = 1e-3 * max(end.oscillation for end in ends)
        self.length, self.reason = FIRST, ""
        self.advice = "take more steps a period, or see -shooting_snes_monitor"
        self.sign: float | None = None
        self._finer: dict[int, Period] = {}
        # the fewest forcing periods after which the first motion repeats itself; a branch of several has
        # ended where it meets one of fewer
        self.periods, self.fallen = minimal_periods(first.fixed), ""

    def finer(self, times: int) -> Period:
        """The period in so many times the steps."""
        if times not in self._finer:
            self._finer[times] = self.period.in_steps(times * self.period.steps)
        return self._finer[times]

    def driven(self, value: float) -> DrivenPeriod:
        """The driven period of a value of the parameter."""
        return self.parameter.at(self.period, value)

    def __iter__(self) -> Iterator[ContinuationPoint]:
        while True:
            if len(self.points) >= self.settings.points:
                self.reason = f"{self.settings.points} points"
                return
            point = self._next()
            if point is None:
                return
            yield point
            if not self.parameter.holds(point.value):
                self.reason = self._back_at_its_beginning() or f"end of the range at {point.value:.8g}"
                return

    def forget(self) -> None:
        """Let go of the motions of the points that no further step looks at."""
        if len(self.points) > 2:
            self.points[-3].fixed.forget()

    def _back_at_its_beginning(self) -> str:
        """A sentence where the last point is the first one, where the branch cannot come to the end of its
        range in the direction in which it began, or other motions at the same value are all there is.
        """
        first, last = self.points[0], self.points[-1]
        if last.value != first.value:
            return ""
        furthest = max((p.value for p in self.points), key=lambda value: abs(value - last.value))
        if abs(furthest - last.value) < STILL * self.parameter.extent:
            return (
                f"back at its beginning at {last.value:.8g}, which it has not left: "
                f"{_not_isolated(last.value)}; {ELSEWHERE}"
            )
        apart = np.linalg.norm(last.fixed.state - first.fixed.state)
        if apart >= SAME * self.metric()[0]:
            return ""
        return (
            f"back at its beginning at {last.value:.8g}: it has turned about near {furthest:.8g} and run "
            "back along itself; take more steps a period"
        )

    # ------------------------------------------------------------------ one step
    def metric(self) -> tuple[float, float]:
        """Units of the state and of the parameter."""
        size = max(self.period.size(self.points[-1].fixed.state), self.least, 1e-300)
        return size, self.parameter.extent / SPAN

    def _tangent(self, derivative: np.ndarray, near: np.ndarray) -> np.ndarray:
        """Direction in which the linearised residual does not change, in units of the metric; at a converged
        point the branch's tangent.

        Its sign is such that the determinant of residual and tangent keeps its sign along the branch: so it
        passes folds and corners, also those that a step has skipped. `near` is a direction not across it.
        """
        size, unit = self.metric()
        m2 = len(derivative)
        bordered = np.empty((m2 + 1, m2 + 1))
        bordered[:m2, :m2] = (derivative[:, :m2] - np.eye(m2)) * size
        bordered[:m2, m2] = derivative[:, m2] * unit
        # the last row is made as large as the others
        bordered[m2] = near * np.abs(bordered[:m2]).max()
        factors, exchanged, singular = linalg.lapack.dgetrf(bordered)
        if singular:
            raise np.linalg.LinAlgError("the branch has no single direction")
        tangent, _ = linalg.lapack.dgetrs(factors, exchanged, np.eye(m2 + 1)[m2])
        # of the determinant: each exchange of rows turns it
        turned = (exchanged != np.arange(m2 + 1)).sum() + (np.diagonal(factors) < 0.0).sum()
        sign = -1.0 if turned % 2 else 1.0
        if self.sign is None:
            self.sign = sign
        return (1.0 if sign == self.sign else -1.0) * tangent / np.linalg.norm(tangent)

    def _secant(self, one: ContinuationPoint, other: ContinuationPoint) -> np.ndarray:
        size, unit = self.metric()
        step = np.append((other.fixed.state - one.fixed.state) / size, (other.value - one.value) / unit)
        return step / np.linalg.norm(step)

    def _next(self) -> ContinuationPoint | None:
        last = self.points[-1]
        try:
            heading = self.heading()
        except np.linalg.LinAlgError:
            self.reason, self.advice = _not_isolated(last.value), ELSEWHERE
            return None
        length = min(
            self.length, self.settings.largest_step / (self.metric()[1] * max(abs(heading[-1]), 1e-12))
        )
        while length >= SMALLEST:
            point = self._step(heading, length)
            if point is None and length < CORNER:
                if self.fallen:  # turning about there would be going back
                    break
                point = self._around(heading, length)
            if point is not None:
                self.points.append(point)
                self.forget()
                self.fallen = ""
                return point
            length *= 0.5
        self.reason = self.fallen or f"no further point within a step of {SMALLEST:g} at {last.value:.8g}"
        return None

    def heading(self) -> np.ndarray:
        """Tangent at the last point; at the first one the parameter goes where it is to go."""
        last = self.points[-1]
        near = np.zeros(len(last.fixed.state) + 1)
        near[-1] = self.parameter.direction
        if len(self.points) > 1:
            near = self._secant(*self.points[-2:])
        return self._tangent(last.derivative(self.parameter.name), near)

    def _gone_through(self, point: ContinuationPoint) -> bool:
        """Whether a point is on the part of the branch between its last three points."""
        if len(self.points) < 3:
            return False
        size, unit = self.metric()
        known = np.array(
            [np.append(p.fixed.state / size, p.value / unit) for p in (*self.points[-3:], point)]
        )
        one, two, last, here = known - known[2]
        arc = np.array([-np.linalg.norm(one - two) - np.linalg.norm(two), -np.linalg.norm(two), 0.0])
        places = np.linspace(1.5 * arc[0], 0.0, 301)
        weights = np.polynomial.polynomial.polyfit(arc, np.eye(3), 2)
        curve = np.polynomial.polynomial.polyval(places, weights).T @ np.array([one, two, last])
        return bool(np.linalg.norm(curve - here, axis=1).min() < ALONG * np.linalg.norm(here))

    def _bend(self, heading: np.ndarray, length: float) -> np.ndarray:
        """How far the branch is off its tangent after a step, by the parabola through the point before;
        across the heading.
        """
        if len(self.points) < 2:
            return np.zeros(len(heading))
        size, unit = self.metric()
        one, other = self.points[-2:]
        back = np.append((one.fixed.state - other.fixed.state) / size, (one.value - other.value) / unit)
        reach = -float(back @ heading)
        if not reach > 0.0 or length > 3.0 * reach:
            return np.zeros(len(heading))
        return (length / reach) ** 2 * (back + reach * heading)

    def _ahead(self, length: float) -> np.ndarray:
        """Derivative of x(T) that is expected after a step, by those of the last two points."""
        last = self.points[-1].derivative(self.parameter.name)
        if len(self.points) < 2 or length < CORNER:  # behind a corner it is another one
            return last
        size, unit = self.metric()
        one, other = self.points[-2:]
        way = np.append((other.fixed.state - one.fixed.state) / size, (other.value - one.value) / unit)
        share = min(1.0, length / max(float(np.linalg.norm(way)), 1e-300))
        return last + share * (last - one.derivative(self.parameter.name))

    def _around(self, heading: np.ndarray, length: float) -> ContinuationPoint | None:
        """A point beyond a corner of the branch, where a pair begins or ceases to touch: in the direction of
        the derivative on the corner's far side.
        """
        size, unit = self.metric()
        last = self.points[-1]
        try:
            driven = self.driven(last.value + length * unit * heading[-1])
            motion = driven.run(last.fixed.state + length * size * heading[:-1])
            beyond = self._tangent(
                driven.carried(motion, np.eye(len(last.fixed.state)), (self.parameter.name,)), heading
            )
        except (SolveError, ValueError):
            return None
        # a stiff stop is hardly pressed beyond its corner: only a step much longer than the way to the corner
        # gets there
        for reach in (1.0, 8.0, 64.0):
            point = self._step(beyond, min(reach * length, CORNER), behind=-heading)
            if point is not None:
                return point
        return None

    def _step(
        self, heading: np.ndarray, length: float, behind: np.ndarray | None = None
    ) -> ContinuationPoint | None:
        """The branch's point in the plane across a heading, or at the value of the parameter that it leads
        to, if Newton's method finds it at ease; sets the length of the step after it.
        """
        size, unit = self.metric()
        last = self.points[-1]
        target = last.value + length * unit * heading[-1]
        outside = not self.parameter.holds(target)
        if outside:  # land on the end of the range
            target = self.parameter.nearest(target)
            if target == last.value:  # that end is where it comes from
                return None
            length = (target - last.value) / (unit * heading[-1])
        guess = last.fixed.state + length * size * heading[:-1]
        bent = np.zeros(len(heading)) if behind is not None else self._bend(heading, length)
        if outside:
            bent[-1] = 0.0
        start, begin = guess + size * bent[:-1], self.parameter.nearest(target + unit * bent[-1])
        held = outside or abs(heading[-1]) > HELD
        most = TOO_MANY if length > CORNER else np.inf

        def across(state, change):
            change += begin - target
            return (
                float(heading[:-1] @ (state - guess) + size / unit * heading[-1] * change),
                heading[:-1],
                size / unit * heading[-1],
            )

        try:
            fixed = shoot_along(
                self.period,
                (start, begin),
                self.parameter,
                None if held else across,
                self._ahead(length),
                most,
            )
            value = float(begin if held else fixed.parameters[0])
            if not (held or self.parameter.holds(value)):  # it has led beyond the end of the range
                beyond, value = value, self.parameter.nearest(value)
                if value == last.value:  # that end is where it comes from: it has turned about meanwhile
                    return None
                share = (value - last.value) / (beyond - last.value)
                start = last.fixed.state + share * (fixed.state - last.fixed.state)
                fixed = shoot_along(
                    self.period, (start, value), self.parameter, None, self._ahead(length), most
                )
        except (SolveError, ValueError):
            return None
        point = ContinuationPoint(fixed, value)
        fewer = passes_shorter(last.fixed, fixed) if self.periods > 1 else 0
        if fewer:
            self.fallen = (
                f"the branch of {self.periods} periods falls onto a motion of {fewer} at {point.value:.8g}"
            )
            return None
        chord = self._secant(last, point)
        if np.arccos(np.clip(chord @ heading, -1.0, 1.0)) > ASIDE or (
            behind is not None and (chord @ behind > BACK or self._gone_through(point))
        ):
            return None
        onward = self._tangent(point.derivative(self.parameter.name), chord)
        turn = float(np.arccos(np.clip(min(onward @ chord, chord @ heading), -1.0, 1.0)))
        if length > CORNER and turn > TOO_SHARP:
            return None
        if onward @ chord < -STRAIGHT:
            # a branch point: the determinant has changed its sign on a smooth branch; beyond a corner the
            # branch may well lead back, but beside the chord
            assert self.sign is not None  # set with the first tangent
            self.sign = -self.sign
        self.length = min(
            LARGEST,
            max(0.5, min(2.0, TURN / max(turn, 1e-3), COMFORT / max(fixed.effort, 1.0) + 0.25)) * length,
        )
        return point


def _not_isolated(value: float) -> str:
    return (
        f"motions of one period are not isolated at {value:.8g}, as those of a body without supports or of a "
        "system without damping"
    )

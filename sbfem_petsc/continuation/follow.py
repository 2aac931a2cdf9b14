"""One continuation for every problem: predictor, corrector, length of step, folds, corners, ends."""

from __future__ import annotations

import functools
import math
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from .newton import attempt, correct
from .problem import Linear, Metric, Point, Problem, Range

# A step that is the value's by more than this share is taken to a value of it, so that what is prepared for
# one serves all iterations.
HELD = 0.7
# The turn of the branch between two steps beyond which a step is taken again at half its length; radian.
TOO_SHARP = 1.0
# Further than this from its tangent a step has come to another part of the branch, radian. Curves that come
# down to a stop had run back to where they began; no test of these or of random stops fails without it now.
ASIDE = 1.0
# Newton iterations a step should take, and more than which is a sign that it has met another branch; both for
# what steps cost: curves of 20 random systems of stops come as far without the second.
COMFORT, TOO_MANY = 4, 7
# Below this length a turn is a corner of the branch, where a pair begins to touch, and is taken; a cusp is
# not passed with a tenth of it or ten times as much.
CORNER = 5e-3
# A stiff stop is hardly pressed beyond its corner: only a step much longer than the way to the corner gets
# there, as on a curve over the load that meets one; so many times as long.
REACHES = 1.0, 8.0, 64.0
# Beyond a corner, a point in the direction of what lies behind, by this cosine, is on the part of the branch
# that has been gone through, far behind the last points, too: without, a curve over the load whose stop is
# met at .33 of it runs back to 0 ...
BACK = 0.999
# ... and of a branch that bends there a point this near, of its distance from the last one, to the parabola
# through the last three.
ALONG = 0.05
# A tangent that points back so straight is that of a smooth branch at which the determinant has changed its
# sign, as on either branch of a pitchfork, and not of the far side of a corner.
STRAIGHT = 0.999
# Of the unknowns in their units: how near the last point is to the first one if it is the same solution.
SAME = 1e-6
# Of the range: the value of a branch that goes no further does not change.
STILL = 1e-9
# How far a line that closes may pass beside its first point, of its step: a circle in steps as usual passes
# by more than .002.
MISS = 0.2
# The reason of one that has closed.
CLOSED = "it is closed"
# Length of the first step beyond a leap.
LANDED = 0.02


@dataclass(frozen=True)
class Settings:
    """How a branch is followed.

    Attributes
    ----------
    points : int
        Points at most.
    largest_step : float
        Largest change of the value from a point to the next one.
    first, largest, smallest : float
        Lengths of steps.
    growth : float
        Of the length from a step to the next one, at most.
    turn : float
        Of the branch between two steps that is aimed at, radian.
    """

    points: int = 400
    largest_step: float = math.inf
    first: float = 0.05
    largest: float = 0.35
    smallest: float = 1e-5
    growth: float = 2.0
    turn: float = 0.35


def points_of(count: int) -> str:
    """So many points, in words: the reason of a line that has all that it may have."""
    return f"{count} point{'s' * (count != 1)}"


def ran_out(reason: str) -> bool:
    """Whether this is why a line ends."""
    return reason.endswith((" point", " points"))


@dataclass
class Line:
    """A branch while it is followed, and what it takes to go on with it.

    Attributes
    ----------
    points : list of Point
        In order of arc length.
    length : float
        Of the next step; 0: the first one's.
    sign : float or None
        Of the determinant along it.
    reason : str
        Why it ended; "" while it has not.
    complete : bool
        Whether it has come to an end of its range, or closed.
    advice : str
        What may help where it stopped.
    most : int
        Points at most.
    """

    points: list[Point]
    length: float = 0.0
    sign: float | None = None
    reason: str = ""
    complete: bool = False
    advice: str = field(default="", repr=False)
    most: int = field(default=sys.maxsize, repr=False)

    @property
    def full(self) -> bool:
        """Whether it has all the points it may have."""
        return len(self.points) >= self.most

    @property
    def problem(self) -> Problem:
        """That of its last point."""
        return self.points[-1].problem

    @property
    def values(self) -> np.ndarray:
        """(n,) of all points."""
        return np.array([point.value for point in self.points])

    def told(self, name: str) -> np.ndarray:
        """(n, ...): what is told of all points by that name."""
        return np.array([point.told[name] for point in self.points])

    @property
    def columns(self) -> dict[str, np.ndarray]:
        """All that is told of all points."""
        return {name: self.told(name) for name in self.points[0].told}


def follow(
    line: Line,
    within: Range,
    settings: Settings | None = None,
    recorder: Callable[[Line], None] | None = None,
) -> Line:
    """Follow a branch from its points on, one or those of a former run, until it ends.

    Parameters
    ----------
    line : Line
        Is gone on with.
    within : Range
    settings : Settings, optional
    recorder : callable, optional
        Called after each point; the states of the last two are whole.
    """
    for _ in Follower(line, within, settings or Settings()):
        if recorder is not None:
            recorder(line)
    return line


class Follower:
    """Follows a `Line` point by point, as `follow` does; iterating gives each point after it is accepted."""

    def __init__(self, line: Line, within: Range, settings: Settings):
        self.line, self.within, self.settings = line, within, settings
        self.problem, self.points = line.problem.unrestricted, line.points
        line.length, line.most = line.length or settings.first, settings.points
        # the last state of which `_known` was asked, and what it is
        self.kept: tuple[Any, Any] = None, None
        # why no step has been found, and why none ever will be
        self.why = self.fallen = ""
        self.tried = 0  # points at the last leap in vain

    def __iter__(self) -> Iterator[Point]:
        line = self.line
        if line.complete:
            return
        line.reason, line.advice = "", self.problem.advice
        if len(self.points) > 1:  # those of a former run may have come to the end
            line.reason, line.complete = self._end()
            if line.reason:
                return
        while not line.full:
            point = self.next()
            if point is None:
                return
            yield point
            line.reason, line.complete = self._end()
            if line.reason:
                return
        line.reason = points_of(self.settings.points)

    def _end(self) -> tuple[str, bool]:
        """Why the line ends at its last point, if it does, and whether it is complete."""
        last = self.points[-1]
        if self._closes():
            return CLOSED, True
        if self.within.holds(last.value):
            return "", False
        back = self._back_at_its_beginning()
        return back or f"end of the range at {last.value:.8g}", not back

    def _back_at_its_beginning(self) -> str:
        """A sentence where the last point is the first one, where the branch cannot come to the end of its
        range in the direction in which it began, or other solutions at the same value are all there is.
        """
        first, last = self.points[0], self.points[-1]
        if last.value != first.value or len(first.u) != len(last.u):
            return ""
        furthest = max((point.value for point in self.points), key=lambda value: abs(value - last.value))
        if abs(furthest - last.value) < STILL * self.within.extent:
            isolated = self.problem.isolated.format(last.value)
            return f"back at its beginning at {last.value:.8g}, which it has not left: {isolated}"
        metric = Metric(self.problem, last.u)
        if metric.length(metric.way(first, last)) >= SAME:
            return ""
        return (
            f"back at its beginning at {last.value:.8g}: it has turned about near {furthest:.8g} and run "
            f"back along itself; {self.problem.advice}"
        )

    def _closes(self) -> bool:
        """Whether the last step has passed the first point in the direction in which the line began."""
        points = self.points
        if len(points[0].u) != len(points[-1].u):
            return False
        metric = Metric(self.problem, points[-1].u)
        step, there = metric.way(points[-2], points[-1]), metric.way(points[-2], points[0])
        length = max(metric.length(step), 1e-300)
        share = metric.dot(step, there) / length**2
        return (
            0.0 < share <= 1.0
            and metric.dot(step, metric.way(points[0], points[1])) > 0.0
            and metric.length(there - share * step) < MISS * length
        )

    # ------------------------------------------------------------------ one step
    def next(self) -> Point | None:
        """Take one step; None, with the line's reason, where there is none."""
        line, last = self.line, self.points[-1]
        tangent = attempt(self.tangent)
        if tangent is None:
            line.reason, line.advice = self.problem.isolated.format(last.value), ""
            return None
        point = self._found(tangent)
        if point is None:
            line.reason = self.fallen or self.why
            return None
        self.points.append(point)
        if len(self.points) > 2:
            self.points[-3].state.forget()
        other = self.problem.advanced(self.points)
        if other is not None:
            (self.problem, self.points[-1]), line.sign = other, None
        return point

    def tangent(self) -> np.ndarray:
        """Tangent at the last point, in units; at the first one the value goes where it is to go.

        Its sign is such that the determinant of the linearised equations and the tangent keeps its sign along
        the branch: so it passes folds and corners, also those that a step has skipped.
        """
        self.metric, tangent, sign = self._known(self.points[-1], self._behind())
        tangent = self._signed(tangent, sign)
        if self.line.sign is None or sign is None:
            self.line.sign = sign
        return tangent

    def _known(self, point: Point, behind: Point | None) -> tuple[Metric, np.ndarray, float | None]:
        """The metric at a point, the tangent in it and the determinant's sign."""
        if self.kept[0] is not point.state:
            metric = Metric(self.problem, point.u)
            if behind is not None:
                near = metric.chord(behind, point)
            elif self.problem.begins is not None:
                near = self.problem.begins
            else:
                near = metric.unit(self.problem.value(point.u)[1] * metric.units * self.within.direction)
            self.kept = point.state, (metric, *metric.tangent(point.linear, near))
        found: tuple[Metric, np.ndarray, float | None] = self.kept[1]
        return found

    def _behind(self) -> Point | None:
        """The point before the last one, where both are of one discretisation."""
        one = self.points[-2] if len(self.points) > 1 else None
        return one if one is not None and len(one.u) == len(self.points[-1].u) else None

    def _signed(self, tangent: np.ndarray, sign: float | None) -> np.ndarray:
        """A tangent with the determinant's sign, as the branch goes."""
        return tangent if sign is None or self.line.sign in (None, sign) else -tangent

    def _found(self, tangent: np.ndarray) -> Point | None:
        """The next point by steps, or beyond what stops or turns the branch by a leap."""
        problem, onwards, last, point = self.problem, self.within.direction, self.points[-1], None
        furthest = max(onwards * point.value for point in self.points)
        # behind the furthest value the branch is in a tongue that could not be passed over
        if problem.narrow and onwards * last.value >= furthest:
            point = self._searched(problem, tangent, problem.narrow)
            turned = point is not None and onwards * (point.value - last.value) < 0.0
            if (point is None or turned) and self.tried != len(self.points):
                self.tried = len(self.points)
                beyond = problem.leap(self.points, onwards)
                if beyond is not None:
                    self.line.sign, self.line.length, beyond.leapt = None, LANDED, True
                    return beyond
        for equations in (problem.restricted(last), problem):
            if point is None and equations is not None:
                point = self._searched(equations, equations.projected(tangent), 0.0)
        return point

    def _searched(self, problem: Problem, tangent: np.ndarray, least: float) -> Point | None:
        """The next point by the longest of steps whose lengths are halved that finds one."""
        slope = problem.value(self.points[-1].u)[1] * self.metric.units
        pace, last = abs(problem.sum(float(slope @ tangent))), self.points[-1]
        self.why = f"no further point within a step of {self.settings.smallest:g} at {last.value:.8g}"
        longest = self.settings.largest_step / max(pace, 1e-300)
        if longest < self.settings.smallest:
            self.why = (
                f"largest_step = {self.settings.largest_step:g} is less than the shortest step there is, "
                f"{self.settings.smallest * pace:.2g} at {last.value:.8g}; give more than that"
            )
            self.line.advice = ""
        length = min(self.line.length, longest)
        while length >= max(self.settings.smallest, least):
            point = attempt(functools.partial(self._step, problem, tangent, length))
            if point is None and length < CORNER and problem.corners:
                if self.fallen:  # turning about there would be going back
                    return None
                point = self._around(problem, tangent, length)
            if point is not None:
                self.fallen = ""
                return point
            length *= 0.5
        return None

    def _around(self, problem: Problem, tangent: np.ndarray, length: float) -> Point | None:
        """A point beyond a corner of the branch, where a pair begins or ceases to touch: in the direction of
        the derivative on the corner's far side.
        """
        there = self.points[-1].u + length * tangent * self.metric.units
        beyond = attempt(lambda: self._signed(*self.metric.tangent(problem.at(there).linear(), tangent)))
        if beyond is None:
            return None
        for reach in REACHES:
            step = functools.partial(self._step, problem, beyond, min(reach * length, CORNER), -tangent)
            point = attempt(step)
            if point is not None:
                return point
        return None

    def _step(
        self, problem: Problem, tangent: np.ndarray, length: float, behind: np.ndarray | None = None
    ) -> Point | None:
        """The branch's point in the plane across a tangent, or at the value that it leads to, if Newton's
        method finds it at ease and it lies ahead; sets the length of the step after it.
        """
        last = self.points[-1]
        point = self._corrected(problem, tangent, length, behind is None)
        if point is None:
            return None
        chord = self.metric.chord(last, point)
        refused = problem.refuse(last, point)
        self.fallen = refused or self.fallen
        if refused or self._aside(point, chord, tangent, behind):
            return None
        there, onward, sign = self._known(point, last)
        onward = self._signed(self.metric.unit(onward * there.units / self.metric.units), sign)
        straight = min(self.metric.dot(onward, chord), self.metric.dot(chord, tangent))
        turn = math.acos(min(max(straight, -1.0), 1.0))
        if length > CORNER and turn > TOO_SHARP:
            return None
        if self.line.sign is not None and self.metric.dot(onward, chord) < -STRAIGHT:
            # a branch point: the determinant has changed its sign on a smooth branch; beyond a corner the
            # branch may well lead back, but beside the chord
            self.line.sign = -self.line.sign
        turn = min(turn, self._chords_turn(chord))
        aimed = min(self.settings.growth, self.settings.turn / max(turn, 1e-3))
        grow = min(aimed, COMFORT / max(point.effort, 1.0) + 0.25)
        self.line.length = min(self.settings.largest, max(0.5, grow) * length)
        return point

    def _chords_turn(self, chord: np.ndarray) -> float:
        """How far the last two chords turn, radian: where steps of time give a branch teeth, tangents of the
        smooth branch do not tell how it bends.
        """
        behind = self._behind()
        if behind is None:
            return math.pi
        straight = self.metric.dot(self.metric.chord(behind, self.points[-1]), chord)
        return math.acos(min(max(straight, -1.0), 1.0))

    def _corrected(self, problem: Problem, tangent: np.ndarray, length: float, bent: bool) -> Point | None:
        """The point that a step of some length leads to, or that on an end of the range beyond it."""
        last, within, metric = self.points[-1], self.within, self.metric
        slope = problem.value(last.u)[1] * metric.units
        pace = problem.sum(float(slope @ tangent))
        target = last.value + length * pace
        landed = not within.holds(target)
        if landed:
            target = within.nearest(target)
            if target == last.value:  # that end is where it comes from
                self.why = f"end of the range at {last.value:.8g}"
                return None
            length = (target - last.value) / pace
        flat = last.u + length * tangent * metric.units
        bend = self._bend(tangent, length) if bent else 0.0 * tangent
        begin = problem.projected(flat + bend * metric.units)
        if not landed:
            target = self._allowed(problem.value(begin)[0])
        begin = problem.placed(begin, target)
        most = TOO_MANY if length > CORNER else math.inf
        held = landed or abs(pace) > HELD * metric.pace(last.u)
        condition = metric.level(last.u, target) if held else metric.plane(tangent, flat)
        predicted = self._predicted(problem, length)
        point = correct(problem, begin, condition, predicted, most)
        if held:
            point.value = target
        elif (goal := self._allowed(point.value)) != point.value:
            # it has led beyond the end of the range or the largest step
            if goal == last.value:  # that end is where it comes from: it has turned about meanwhile
                return None
            share = (goal - last.value) / (point.value - last.value)
            start = problem.placed(last.u + share * (point.u - last.u), goal)
            point = correct(problem, start, metric.level(last.u, goal), predicted, most)
            point.value = goal
        return point

    def _allowed(self, value: float) -> float:
        """The nearest value in the range that is no further than the largest step from the last one."""
        last, furthest = self.points[-1].value, self.settings.largest_step
        return self.within.nearest(min(max(value, last - furthest), last + furthest))

    def _bend(self, tangent: np.ndarray, length: float) -> np.ndarray:
        """How far the branch is off its tangent after a step, by the parabola through the point before;
        across the tangent, in units.
        """
        behind = self._behind()
        if behind is None or (length < CORNER and not self.problem.alike(behind, self.points[-1])):
            return np.zeros(len(tangent))  # there is none, or a corner lies between
        back = self.metric.way(self.points[-1], behind)
        reach = -self.metric.dot(back, tangent)
        if not reach > 0.0 or length > 3.0 * reach:
            return np.zeros(len(tangent))
        return (length / reach) ** 2 * (back + reach * tangent)

    def _predicted(self, problem: Problem, length: float) -> Linear | None:
        """Linearised equations that are expected after a step, by those of the last two points; None where
        these are of another problem, as those outside of a subspace lead out of it.
        """
        behind, last = self._behind(), self.points[-1]
        if last.problem is not problem:
            return None
        if behind is None or length < CORNER:  # behind a corner they are others
            return last.linear
        share = min(1.0, length / max(self.metric.length(self.metric.way(behind, last)), 1e-300))
        return last.linear.mixed((last.linear, behind.linear), (1.0 + share, -share))

    def _aside(self, point: Point, chord: np.ndarray, tangent: np.ndarray, behind: np.ndarray | None) -> bool:
        """Whether a point lies aside of its tangent, or on the part that has been gone through."""
        if self.metric.dot(chord, tangent) < math.cos(ASIDE):
            return True
        if behind is None:
            return False
        return self.metric.dot(chord, behind) > BACK or self._gone_through(point)

    def _gone_through(self, point: Point) -> bool:
        """Whether a point is on the part of the branch between its last three points."""
        if len(self.points) < 3:
            return False
        one, two, last = self.points[-3:]
        ways = [self.metric.way(last, other) for other in (one, two, point)]
        arc = np.array([-self.metric.length(ways[0] - ways[1]), 0.0, 0.0])
        arc[:2] -= self.metric.length(ways[1])
        weights = np.polynomial.polynomial.polyfit(arc, np.eye(3), 2)
        places = np.linspace(1.5 * arc[0], 0.0, 301)
        shares = np.polynomial.polynomial.polyval(places, weights).T
        shares[:, 2] = -1.0  # of the point, in the place of the last one, from which all are counted
        products = np.array([[self.metric.dot(a, b) for b in ways] for a in ways])
        apart = np.einsum("pi,ij,pj->p", shares, products, shares).min()
        return bool(max(apart, 0.0) < ALONG**2 * products[2, 2])

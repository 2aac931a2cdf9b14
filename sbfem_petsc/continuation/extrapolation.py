"""What the steps and left-out modes leave of the error of a branch's multipliers and bifurcations, by its
motions in twice and four times the steps and in more modes.

The error by steps is of second order, but for where in them pairs switch, which scatters: a third of what
twice the steps change goes on top of it, and what is left is told by what that extrapolation itself changes
with the steps. What half as many modes again move a bifurcation by, in twice the steps, goes on top of it as
well, and is told to be left: with little damping single modes count, which no vectors stand for.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Callable

import numpy as np

from ..errors import SolveError
from .events import Way, in_finer_steps
from .follow import Line
from .multipliers import outside
from .newton import attempt
from .orbit import uncertainty_of
from .problem import Point
from .problems.driven_orbits import WiderOrbits

# So many times the steps.
TIMES = 2, 4
# In finer steps and in more modes: furthest from where it is in the branch's steps that a bifurcation is
# sought, in chords between two points. What it may be off by, of how far it has moved. Steps of a secant at
# most.
FURTHEST, CLOSE, MOST = (1.0, 4.0), 0.05, 8
# What half as many modes again leave of a bifurcation's error, at least, of how far they move it: six of
# a beam kept .1 to .6.
LEFT = 1.0
# What twice the steps may change, relative, without being looked at in finer ones; that is then what is told.
FINEST = 1e-6
# Where multipliers jump the bracket grows by this factor until it holds the jump.
WIDER = 4.0

Found = tuple[Point, Point, Point]
# The point at a fraction of a way, from unknowns with the linearised equations at a point nearby.
Solve = Callable[[float, np.ndarray, Point], Point]


def uncertainty_at(line: Line, k: int, largest: np.ndarray) -> float:
    """Of the largest modulus, `largest` those of all points, at point k: by its change in twice the steps at
    the same place of the branch, and by that of the parameter there, which beside a fold is more; inf where
    twice the steps have no motion.
    """
    points = line.points
    point, first = points[k], min(k, len(points) - 2)
    place = first, float(k - first)
    finer = attempt(lambda: in_finer_steps(line, TIMES[0], place, point.u, point), SolveError)
    if finer is None:
        return math.inf
    change = abs(largest[k] - abs(finer.state.multipliers.values[0]))
    moved = abs(finer.value - point.value)
    if moved:
        neighbours = [n for n in (k - 1, k + 1) if 0 <= n < len(points) and points[n].value != point.value]
        rates = [abs((largest[n] - largest[k]) / (points[n].value - point.value)) for n in neighbours]
        change += moved * max(rates, default=math.inf)
    return uncertainty_of(change)


def fold(line: Line, k: int, point: Point) -> tuple[float, float]:
    """Value and uncertainty of a fold at a point between point k and the next one."""
    return _told(line, k, _Fold(line, k, point))


def passage(line: Line, k: int, found: Found, value: complex) -> tuple[float, float]:
    """Value and uncertainty of the point between point k and the next one at which a multiplier, `value`,
    passes the unit circle; `found` are that point and its neighbours of either sign.
    """
    sought = attempt(lambda: _Passage(line, k, found, value), SolveError)
    return (found[0].value, math.nan) if sought is None else _told(line, k, sought)


def jump(line: Line, k: int, found: Found) -> tuple[float, float]:
    """The same where multipliers jump over the unit circle."""
    sought = _Jump(line, k, found)
    value, error = _told(line, k, sought)
    return value, error + sought.resolved


def _told(line: Line, k: int, sought: _Fold | _Passage | _Jump) -> tuple[float, float]:
    """Value and uncertainty of what is sought between point k and the next one."""
    return extrapolated(
        sought.own,
        lambda times: sought.located(lambda *place: in_finer_steps(line, times, (k, place[0]), *place[1:])),
        lambda value: _moved(line, k, sought, value),
    )


def extrapolated(
    own: float,
    located: Callable[[int], float],
    by_modes: Callable[[float], tuple[float, float]] = lambda value: (0.0, 0.0),
) -> tuple[float, float]:
    """A value and its uncertainty from that in the branch's steps and those in finer ones, and from what more
    modes add to the latter first, and leave; nan where these are not found.
    """
    values, least = [own], FINEST * abs(own)
    moved = left = 0.0
    try:
        for times in TIMES:
            values.append(located(times))
            if times == TIMES[0]:
                moved, left = by_modes(values[1])
            if abs(values[1] - own) <= least:
                return values[1] + (values[1] - own) / 3.0 + moved, least + left
    except SolveError:
        return own, math.nan
    earlier, last = (fine + (fine - coarse) / 3.0 for coarse, fine in zip(values, values[1:]))
    return last + moved, max(abs(last - values[-1]), abs(last - earlier)) + left


def _moved(line: Line, k: int, sought: _Fold | _Passage | _Jump, value: float) -> tuple[float, float]:
    """How far a value in twice the steps moves in more modes, and what those that are left out then may do; 0
    where nothing is known of them, or there are none. The latter is nan if it is not found in these, or they
    have no part in the motion.
    """

    def change() -> tuple[float, float]:
        more = line.points[k + 1].problem.wider(TIMES[0])
        if more is None:
            return 0.0, 0.0
        if not math.isfinite(more.factor):
            return 0.0, math.nan
        first = max(0, k - 1)
        way = Way(Line([more.moved(point) for point in line.points[first : k + 3]]), k - first)

        def solve(place: float, start: np.ndarray, near: Point) -> Point:
            return way.point(more.problem, place, start, near.linear)

        moved = sought.in_modes(more, solve) - value
        return moved, max(more.factor - 1.0, LEFT) * abs(moved)

    return attempt(change, SolveError) or (0.0, math.nan)


class _Fold:
    """A fold: to first order the parameter's extremum does not move along the branch."""

    def __init__(self, line: Line, k: int, point: Point):
        self.place, self.point, self.near, self.own = Way(line, k).place_of(point), point, point, point.value

    def in_modes(self, more: WiderOrbits, solve: Solve) -> float:
        """Its value in more modes."""
        begun = more.begun(self.near)
        return solve(self.place, begun.u, begun).value

    def located(self, solve: Solve) -> float:
        """Its value in other steps."""
        self.near = solve(self.place, self.near.u, self.point)
        return self.near.value


class _Passage:
    """The passage of a multiplier, by secants from the steps it has been located in to finer ones.

    What vanishes is, of a real one, the product of all multipliers' distances from its place on the circle,
    which stays smooth where it meets another one; of a complex pair how far outside the circle it is.
    """

    def __init__(self, line: Line, k: int, found: Found, value: complex):
        point, one, other = found
        way = Way(line, k)
        places = [way.place_of(item) for item in found]
        width = places[2] - places[1]
        self.ends, self.width = (one, other), width
        # rates along the way, and how the test changes
        self.rate = (other.u - one.u) / width
        self.value = (other.value - one.value) / width
        self.multiplier = complex(value.real, abs(value.imag))
        excess, before, after = (self._excess(item.state.multipliers.values) for item in found)
        self.slope = (after - before) / width
        # the last point, its place, how far from it the multiplier passes; how far more steps have moved that
        self.near, self.place, self.shift = point, places[0], self._to_zero(excess)
        self.first, self.moved = self.place + self.shift, 0.0
        self.own = point.value + self.shift * self.value
        self.furthest = FURTHEST[0]

    def _to_zero(self, excess: float) -> float:
        return -excess / self.slope if self.slope else math.inf

    def in_modes(self, more: WiderOrbits, solve: Solve) -> float:
        """Value of the parameter at which it passes in more modes, from where it does in as many steps: the
        multipliers of further ones are about those of free motions.
        """
        other = copy.copy(self)
        one, behind = (more.moved(point).u for point in self.ends)
        other.rate, other.near = (behind - one) / self.width, more.begun(self.near)
        other.furthest = FURTHEST[1]
        if not self.multiplier.imag:
            other.slope *= more.free(self.near.value, math.copysign(1.0, self.multiplier.real))
        return other.located(solve)

    def located(self, solve: Solve) -> float:
        """Value of the parameter at which it passes, in other steps or modes.

        Raises
        ------
        SolveError
            If that is not found.
        """
        begin, last = self.place + self.shift, None
        for _ in range(MOST):
            place = self.place + self.shift
            if not abs(place - self.first) < self.furthest:
                break
            start = self.near.u + self.shift * self.rate
            point = solve(place, start, self.near)
            excess = self._excess(point.state.multipliers.values)
            if last is not None and place != last[0]:
                self.slope = (excess - last[1]) / (place - last[0])
            self.near, self.place, self.shift, last = point, place, self._to_zero(excess), (place, excess)
            moved = max(abs(place + self.shift - begin), self.moved)
            if abs(self.shift) <= CLOSE * moved or abs(self.shift * self.value) <= FINEST * abs(point.value):
                self.moved = moved
                return point.value + self.shift * self.value
        raise SolveError("no passage of the unit circle was found in other steps or modes")

    def _excess(self, values: np.ndarray) -> float:
        if not self.multiplier.imag:
            return float(np.prod(values - math.copysign(1.0, self.multiplier.real)).real)
        pairs = values[values.imag > 0.0]
        if not len(pairs):
            raise SolveError("the pair has become real")
        self.multiplier = complex(pairs[np.abs(pairs - self.multiplier).argmin()])
        return abs(self.multiplier) - 1.0


class _Jump:
    """A jump of multipliers over the unit circle, between two places with different numbers outside."""

    def __init__(self, line: Line, k: int, found: Found):
        point, one, other = found
        self.own, way = point.value, Way(line, k)
        self.ends = {way.place_of(item): item for item in (one, other)}
        self.width = max(self.ends) - min(self.ends)
        self.counts = [self._count(self.ends[place]) for place in sorted(self.ends)]
        self.resolved = 0.5 * abs(one.value - other.value)
        self.furthest = FURTHEST[0]

    def _count(self, point: Point) -> int:
        return int(outside(point.state.multipliers).sum())

    def in_modes(self, more: WiderOrbits, solve: Solve) -> float:
        """Value of the parameter in the middle of a bracket in more modes."""
        other = copy.copy(self)
        other.ends = {place: more.begun(point) for place, point in self.ends.items()}
        other.furthest = FURTHEST[1]
        return other.located(solve)

    def located(self, solve: Solve) -> float:
        """Value of the parameter in the middle of a bracket in other steps or modes.

        Raises
        ------
        SolveError
            If no bracket is found.
        """
        known = dict(self.ends)
        lower, upper = sorted(known)
        finer = {place: self._point(solve, place, known) for place in (lower, upper)}
        counts, reach = [self._count(finer[place]) for place in (lower, upper)], self.width
        while counts != self.counts:
            reach *= WIDER
            if counts[0] != counts[1] or reach > self.furthest:
                raise SolveError("no jump over the unit circle was found in other steps or modes")
            ahead = counts[0] == self.counts[0]
            lower, upper = (upper, upper + reach) if ahead else (lower - reach, lower)
            new = upper if ahead else lower
            finer[new] = self._point(solve, new, finer)
            counts = [self._count(finer[place]) for place in (lower, upper)]
        while upper - lower > 2.0 * self.width:
            middle = 0.5 * (lower + upper)
            finer[middle] = self._point(solve, middle, finer)
            lower, upper = (
                (middle, upper) if self._count(finer[middle]) == self.counts[0] else (lower, middle)
            )
        self.ends = {place: finer[place] for place in (lower, upper)}
        self.resolved = 0.5 * abs(finer[lower].value - finer[upper].value)
        return 0.5 * (finer[lower].value + finer[upper].value)

    @staticmethod
    def _point(solve: Solve, place: float, known: dict[float, Point]) -> Point:
        near = known[min(known, key=lambda other: abs(other - place))]
        return solve(place, near.u, near)

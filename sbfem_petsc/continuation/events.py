"""Points of a branch between two that are known, and where a function of them vanishes."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable

import numpy as np
from numpy.polynomial import polynomial

from ..errors import SolveError
from .follow import HELD, Line
from .newton import attempt, correct
from .problem import Condition, Linear, Lost, Metric, Point, Problem

# How far along the way between two points a zero is located; the same where the function is steep or pairs
# begin or cease to touch; evaluations at most.
FINE, FINER, MOST = 5e-3, 2e-4, 20
# Where no point is found at a place, so many are tried, each half as far from where the test is small.
CLOSER = 5
# Neighbours tell how a branch bends between two points if they are so far beyond them, of their distance.
APART = 0.2
# Share of the value's part in the planes that cut a way: where it turns all else tells how far a point is.
LEAN = 0.01
# Points to either side of a turn that teeth alone do not outlast.
TEETH = 3
# Straight lines to a zero that has been enclosed, at most.
SECANTS = 2
# Values that rounding alone tells apart.
SAME = 1e-10
# A chord of a curve, over value and height both scaled to 1, is divided, so many times at most, if it is off
# the curve by more than this share of the height, or of it times a cosine where the curve is steeper; beside
# a peak until the bend (radian) or the chord is as small; not if it is shorter.
CHORD, STEEP, BEND, PEAK, SHORT, PASSES = 0.015, 0.3, 0.3, 0.005, 0.005, 6

Places = dict[float, Point]


class Way:
    """The way from point k of a line to the next one, cut into fractions by planes across its chord, or by
    the value where the way is mostly that and does not turn nearby, where it leads beyond both points.

    Attributes
    ----------
    held : bool
        Whether the value cuts it.
    """

    def __init__(self, line: Line, k: int):
        self.points, self.k = line.points, k
        self.one, self.other = line.points[k : k + 2]
        if self.other.leapt:
            raise Lost(f"no branch has been followed from {self.one.value:.8g} to {self.other.value:.8g}")
        self.problem = self.other.problem
        self.metric = Metric(self.problem, self.one.u)
        self.step = self.metric.way(self.one, self.other)
        values = np.diff([point.value for point in self.points[max(0, k - 1) : k + 3]])
        of_value = self.metric.length(_of_value(self.metric, self.one, self.step))
        along = of_value > HELD * self.metric.length(self.step)
        self.held = along and bool((values > 0.0).all() or (values < 0.0).all())
        self.normal = self.step - (1.0 - LEAN) * _of_value(self.metric, self.one, self.step)

    def place_of(self, point: Point) -> float:
        """Fraction of the way at which a point is."""
        if self.held:
            return (point.value - self.one.value) / (self.other.value - self.one.value)
        there = self.metric.way(self.one, point)
        return self.metric.dot(there, self.normal) / self.metric.dot(self.step, self.normal)

    def neighbours(self) -> Places:
        """The points before and behind the two by their fractions of the way between these."""
        result = {}
        for n in (self.k - 1, self.k + 2):
            if 0 <= n < len(self.points) and len(self.points[n].u) == len(self.one.u):
                place = self.place_of(self.points[n])
                if place < -APART if n < self.k else place > 1.0 + APART:
                    result[place] = self.points[n]
        return result

    def at(self, fraction: float) -> tuple[Condition, float]:
        """The condition of a fraction, and the value there along the chord."""
        value = self.one.value + fraction * (self.other.value - self.one.value)
        if self.held:
            return self.metric.level(self.one.u, value), value
        there = self.one.u + fraction * (self.other.u - self.one.u)
        return self.metric.plane(self.metric.unit(self.normal), there), value

    def point(self, problem: Problem, fraction: float, start: np.ndarray, near: Linear | None) -> Point:
        """The solution of a problem at a fraction, from a start with linearised equations nearby."""
        condition, value = self.at(fraction)
        if not self.held:
            return correct(problem, start, condition, near)
        found = correct(problem, problem.placed(start, value), condition, near)
        found.value = value
        return found


def _of_value(metric: Metric, point: Point, way: np.ndarray) -> np.ndarray:
    """The part of a way, in units, along the value's gradient."""
    slope = point.problem.value(point.u)[1] * metric.units
    return slope * (metric.dot(slope, way) / max(metric.dot(slope, slope), 1e-300))


def between(line: Line, k: int, fraction: float, known: Places | None = None) -> Point:
    """The point of a line at a fraction of the way from point k to the next one (see `Way`); `known` are such
    points by their fractions.
    """
    way = Way(line, k)
    ends = {0.0: way.one, 1.0: way.other, **way.neighbours()}
    places, weights = _weights(ends, fraction)
    near = way.other.linear.mixed([ends[place].linear for place in places], list(weights))
    found = {**ends, **(known or {})}
    places, weights = _weights(found, fraction)
    start = weights @ np.array([found[place].u for place in places])
    return way.point(way.problem, fraction, start, near)


def in_finer_steps(line: Line, times: int, place: tuple[int, float], start: np.ndarray, near: Point) -> Point:
    """As `between`, of solutions in so many times the steps of time: at a fraction of the way from point k,
    from unknowns, with the linearised equations at a point nearby.
    """
    way = Way(line, place[0])
    return way.point(way.problem.finer(times), place[1], start, near.linear)


def _weights(known: Places, fraction: float) -> tuple[list[float], np.ndarray]:
    """Places that are nearest to a fraction, and the weights of the polynomial through them there."""
    places = sorted(known, key=lambda place: abs(place - fraction))[:4]
    weights = [
        math.prod((fraction - other) / (place - other) for other in places if other != place)
        for place in places
    ]
    return places, np.array(weights)


def find_zero(
    line: Line,
    k: int,
    test: Callable[[Point], float],
    ends: tuple[float, float],
    smooth: Callable[[Places], dict[float, float]] | None = None,
    small: float = math.inf,
) -> tuple[Point, Point, Point]:
    """The point between points k and k + 1 at which a test function of points vanishes, and its nearest
    neighbours of either sign.

    Parameters
    ----------
    line : Line
    k : int
    test : callable
    ends : (float, float)
        Its values at both points, of different sign.
    smooth : callable, optional
        Values at points by their places, also at those before and behind the two, of a function that is the
        test near its zero and bends less: where that is looked for next. Default: the test itself.
    small : float
        What the test may be at the point that is found; a larger value is located more finely.
    """
    alike = line.points[k + 1].problem.alike
    known: Places = dict(zip((0.0, 1.0), line.points[k : k + 2]))
    values = dict(zip((0.0, 1.0), ends))
    around = Way(line, k).neighbours() if smooth is not None else {}
    bracket, place, widths, poor = (0.0, 1.0), 0.0, [1.0], False
    while len(widths) <= MOST:
        near = min(abs(values[end]) for end in bracket) <= small
        if _narrow(widths[-1], near, alike, *(known[end] for end in bracket)):
            break
        expected = values if smooth is None else smooth({**around, **known})
        # what is followed may vanish elsewhere than the test, which counts all
        other = len(known) > 2 and abs(expected[place] - values[place]) > SAME
        if len(known) > 2 and not other and near and _arrived(known, values, expected, place, alike):
            break
        slow = len(widths) > 2 and widths[-1] > 0.5 * widths[-3]
        place = 0.5 * sum(bracket) if slow or poor or other else _next_place(expected, *bracket)
        least = min(bracket, key=lambda end: abs(values[end]))
        for _ in range(CLOSER):
            try:
                known[place] = between(line, k, place, known)
                break
            except SolveError:
                place = 0.5 * (place + least)
        else:  # the nearer of the points that were found stands for it
            break
        values[place] = test(known[place])
        ahead = values[place] * values[bracket[0]] > 0.0
        left = bracket[0] if ahead else bracket[1]
        # at a jump nothing vanishes
        poor = abs(values[place]) > 0.5 * abs(values[left])
        bracket = (place, bracket[1]) if ahead else (bracket[0], place)
        widths.append(bracket[1] - bracket[0])
    nearest = min(bracket, key=lambda place: abs(values[place]))
    return known[nearest], known[bracket[0]], known[bracket[1]]


def _narrow(
    width: float, near: bool, alike: Callable[[Point, Point], bool], left: Point, right: Point
) -> bool:
    """Whether a bracket needs no point within it, sooner where the test is small and the branch smooth."""
    return width <= FINER * (1.0 + 1e-9) or (width <= FINE * (1.0 + 1e-9) and near and alike(left, right))


def _next_place(values: dict[float, float], lower: float, upper: float) -> float:
    """Where the polynomial through the nearest values vanishes between two places, their middle if nowhere;
    beyond it if it is next to either, so that they come near to each other.
    """
    middle = 0.5 * (lower + upper)
    places = np.array(sorted(values, key=lambda place: abs(place - middle))[:4])
    heights = np.array([values[place] for place in places])
    weights = polynomial.polyfit(places - middle, heights / np.abs(heights).max(), len(places) - 1)
    roots = polynomial.polyroots(weights)
    roots = roots.real[np.abs(roots.imag) < 1e-9] + middle
    inside = roots[(roots > lower) & (roots < upper)]
    if not len(inside):
        return middle
    best = places[np.abs(heights).argmin()]
    found = float(inside[np.abs(inside - best).argmin()])
    # as far beyond it, unless that is beyond both
    if found - lower < 0.5 * FINE:
        found = lower + max(2.0 * (found - lower), 0.5 * FINE)
    elif upper - found < 0.5 * FINE:
        found = upper - max(2.0 * (upper - found), 0.5 * FINE)
    return found if lower < found < upper else middle


def _arrived(
    known: Places,
    values: dict[float, float],
    expected: dict[float, float],
    place: float,
    alike: Callable[[Point, Point], bool],
) -> bool:
    """Whether a test function vanishes next to a place: by the straight lines to the neighbours on either
    side, between which the zero of a curve without inflection lies; not where the branch has a corner.
    """
    places = sorted(known)
    n = places.index(place)
    for other in (places[n - 1], places[n + 1]):
        if values[other] * values[place] <= 0.0 and not alike(known[place], known[other]):
            return False
        rise = abs(expected[place] - expected[other])
        if abs(expected[place] * (other - place)) > 0.5 * FINE * rise:
            return False
    return True


def located(
    line: Line, k: int, test: Callable[[Point], float], ends: tuple[float, float]
) -> tuple[int, Point]:
    """Where a test function vanishes between points k and k + 1, and by straight lines through the points
    where it is least, as long as these are nearer: a value's extremum is then off by the fourth power of how
    far they are apart, or less. With k.
    """
    point, *sides = find_zero(line, k, test, ends)
    way, left = Way(line, k), abs(test(point))
    known = {way.place_of(side): side for side in sides}
    values = {place: test(side) for place, side in known.items()}
    for _ in range(SECANTS):
        one, other = sorted(known, key=lambda place: abs(values[place]))[:2]
        if values[one] == values[other]:
            break
        place = one - values[one] * (other - one) / (values[other] - values[one])
        found = attempt(functools.partial(between, line, k, place, known), SolveError)
        if found is None or abs(value := test(found)) >= left:
            break
        known[place], values[place], point, left = found, value, found, abs(value)
    return k, point


def folds(line: Line) -> list[tuple[int, Point]]:
    """Where the value turns along a line: numbers of the points before, and the points there."""
    found = (_fold(line, k) for k in range(1, len(line.points) - 1))
    return sorted({item[0]: item for item in found if item is not None}.values(), key=lambda item: item[0])


def fold_between(line: Line, k: int) -> Point | None:
    """Where the value turns between points k and k + 1 by their tangents, whatever the values of the points
    tell; None where these do not.
    """
    one, other = line.points[k : k + 2]
    direction = _direction(one, one, other)
    _, begin = direction(one)

    def pace(point: Point) -> float:
        value, sign = direction(point)
        return begin * sign * value

    ends = pace(one), pace(other)
    return located(line, k, pace, ends)[1] if ends[0] * ends[1] < 0.0 else None


def turns_twice(line: Line, k: int, passed: bool, within: float) -> bool:
    """Whether the value turns twice between points k and k + 1 by the cubic through both with their tangents.

    By more than `within` it goes back from one to the other while it goes on before and behind them, and the
    tangents lead forth; or it goes on, something has been `passed`, and they lead forth more than three times
    as steeply as the chord.
    """
    values = np.diff([point.value for point in line.points[max(0, k - 1) : k + 3]])
    back = (
        len(values) == 3
        and abs(values[1]) > within
        and max(values[0] * values[1], values[1] * values[2]) < 0.0
    )
    one, other = line.points[k : k + 2]
    if not (passed or back) or other.leapt or len(one.u) != len(other.u):
        return False
    metric = Metric(one.problem, one.u)
    way = metric.way(one, other)
    normal = metric.unit(way - _of_value(metric, one, way))
    chord = (other.value - one.value) / max(metric.dot(way, normal), 1e-300)
    direction = _direction(one, one, other)
    (first, begin), (second, end) = direction(one), direction(other)
    ahead = -np.sign(chord) if back else np.sign(chord)
    return begin == end and min(first * ahead, second * ahead) > (0.0 if back else 3.0 * abs(chord))


def _direction(about: Point, one: Point, other: Point) -> Callable[[Point], tuple[float, float]]:
    """The value's part of the branch's direction at a point, along the way from one point to another, and the
    determinant's sign. Which way that is is told by all but the value, which turns.
    """
    metric = Metric(about.problem, about.u)
    way = metric.way(one, other)
    row = metric.row(metric.unit(way - _of_value(metric, about, way)))

    def direction(point: Point) -> tuple[float, float]:
        border = point.linear.bordered(row)
        tangent = border.solve(np.eye(1, point.linear.rows + 1, point.linear.rows)[0])
        pace = point.problem.sum(float(point.problem.value(point.u)[1] @ tangent))
        return pace, border.sign or 1.0

    return direction


def furthest(line: Line, k: int, within: float) -> int | None:
    """The nearest point at which the values of the points turn, and beyond which none of `TEETH` to either
    side goes, on the stretch around point k of which all values are within some of its own; None without one.
    Of the tangents of the smooth branch it knows nothing.
    """
    values = np.array([point.value for point in line.points])
    apart = np.flatnonzero(np.abs(values - values[k]) > within)
    first, last = int(apart[apart < k].max(initial=-1)) + 1, int(apart[apart > k].min(initial=len(values)))
    for j in sorted(range(max(1, first), min(len(values) - 1, last)), key=lambda j: abs(j - k)):
        away = values[max(0, j - TEETH) : j + TEETH + 1] - values[j]
        turned = (values[j - 1] - values[j]) * (values[j + 1] - values[j]) > 0.0
        if turned and ((away >= 0.0).all() or (away <= 0.0).all()):
            return j
    return None


def _fold(line: Line, k: int) -> tuple[int, Point] | None:
    """The turn of the value between the neighbours of point k. Where steps of time give the branch teeth its
    points turn elsewhere than the tangents of the smooth branch, which then turn within `TEETH` points to
    either side; None if they do not, or if the value goes on beyond point k there.
    """
    before, here, behind = line.points[k - 1 : k + 2]
    if not (here.value - before.value) * (behind.value - here.value) < 0.0:
        return None
    direction = _direction(here, before, behind)
    # where a corner turns all else too, the determinant keeps its sign along the branch
    ahead = sum(direction(point)[1] for point in (before, here, behind)) * (here.value - before.value)

    def pace(point: Point) -> float:
        value, sign = direction(point)
        return math.copysign(1.0, ahead) * sign * value

    beyond = [first for n in range(1, TEETH) for first in (k - 1 - n, k + n)]
    for first in (k - 1, k, *(first for first in beyond if 0 <= first < len(line.points) - 1)):
        ends = pace(line.points[first]), pace(line.points[first + 1])
        if ends[0] >= 0.0 >= ends[1]:
            return located(line, first, pace, ends)
        if first == k:
            around = line.points[max(0, k - TEETH) : k + TEETH + 1]
            if any((point.value - here.value) * (here.value - before.value) > 0.0 for point in around):
                break
    return None


def refine(
    line: Line,
    places: Callable[[], np.ndarray],
    heights: Callable[[], np.ndarray],
    tell: Callable[[Point], object],
    shortest: float = 0.0,
) -> None:
    """Points between those where heights bend over the value, so that chords show the curve and peaks stand
    where they are; as many as the line may have, spread over all such places.

    Parameters
    ----------
    line : Line
    places : callable
        (n,) of all points: where they are along the range, as shares of it.
    heights : callable
        (curves, n) of all points, such as amplitudes.
    tell : callable
        Notes what is kept of each new point.
    shortest : float
        Arc length of ways that are not divided.
    """
    for _ in range(PASSES):
        along = places()
        bent = sorted({k for curve in heights() if curve.any() for k in coarse_chords(along, curve)})
        for k in reversed(bent[:: 1 + len(bent) // max(line.most - len(line.points), 1)]):
            one, other = line.points[k : k + 2]
            if len(one.u) == len(other.u):  # of one discretisation
                metric = Metric(other.problem, one.u)
                if metric.length(metric.way(one, other)) > shortest:
                    insert(line, k, 0.5, tell)
        if not bent or line.full:
            break


def insert(line: Line, k: int, fraction: float, tell: Callable[[Point], object]) -> None:
    """A further point of a line, if it may have more, between point k and the next one, unless a corner is
    there.
    """
    if line.full:
        return
    point = attempt(lambda: between(line, k, fraction), SolveError)
    if point is None:
        return
    metric = Metric(point.problem, line.points[k].u)
    ends = line.points[k : k + 2]
    if any(metric.length(metric.way(end, point)) > metric.length(metric.way(*ends)) for end in ends):
        return  # it is on another part
    tell(point)
    line.points.insert(k + 1, point)
    point.state.forget()


def coarse_chords(value: np.ndarray, height: np.ndarray) -> np.ndarray:
    """Numbers of the chords of a curve that are to be divided.

    Parameters
    ----------
    value : (n,) array
        As a share of its range.
    height : (n,) array
    """
    heights = height / height.max()
    steps = np.diff(np.stack([value, heights], axis=1), axis=0)
    length = np.hypot(*steps.T)
    turn = np.abs(np.diff(np.unwrap(np.arctan2(steps[:, 1], steps[:, 0]))))
    curvature = 2.0 * turn / np.maximum(length[1:] + length[:-1], 1e-300)
    most, sharpest = (
        np.maximum(np.append(item, 0.0), np.append(0.0, item)) for item in (curvature, turn)
    )  # of both ends of each chord
    # a corner is off no chord by more than its turn tells
    off = np.minimum(most * length**2 / 8.0, sharpest * length / 4.0)
    height = 0.5 * (heights[1:] + heights[:-1])
    flatness = np.maximum(np.abs(steps[:, 0]) / np.maximum(length, 1e-300), STEEP)
    coarse = (off > CHORD * height * flatness) & (length > SHORT)
    inner = heights[1:-1]
    peaks = 1 + np.flatnonzero((inner >= heights[:-2]) & (inner >= heights[2:]) & (turn > BEND))
    neighbours = np.unique(np.concatenate([peaks - 1, peaks]))
    coarse[neighbours[length[neighbours] > PEAK]] = True
    return np.flatnonzero(coarse)

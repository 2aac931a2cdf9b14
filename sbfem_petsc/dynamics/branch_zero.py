"""Points of a branch between two that are known, and where a function of them vanishes."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.polynomial import polynomial

from ..errors import SolveError
from .continuation import HELD, SPAN, Continuation, ContinuationPoint
from .period_map import Period
from .shooting import shoot_along

# How far along the arc between two points a zero is located; the same where the function is steep or pairs
# begin or cease to touch; evaluations at most.
FINE, FINER, MOST = 5e-3, 2e-4, 20
# Neighbours tell how a branch bends between two points if they are so far beyond them, of their distance.
APART = 0.2
# Values that rounding alone tells apart.
SAME = 1e-10

Places = dict[float, ContinuationPoint]


def between(
    continuation: Continuation,
    k: int,
    fraction: float,
    known: Places | None = None,
) -> ContinuationPoint:
    """A point of the branch at a fraction of the way from point k to the next one (see `across`); `known` are
    such points by their fractions.
    """
    ends = {0.0: continuation.points[k], 1.0: continuation.points[k + 1], **beside(continuation, k)}
    places, weights = _weights(ends, fraction)
    near = np.tensordot(weights, [_derivative(continuation, k, ends[place]) for place in places], 1)
    found = {**ends, **(known or {})}
    places, weights = _weights(found, fraction)
    start = (
        weights @ np.array([found[place].fixed.state for place in places]),
        float(weights @ np.array([found[place].value for place in places])),
    )
    return _in_plane(continuation, continuation.period, (k, fraction), start, near)


def in_finer_steps(
    continuation: Continuation,
    times: int,
    place: tuple[int, float],
    start: tuple[np.ndarray, float],
    near: ContinuationPoint,
) -> ContinuationPoint:
    """As `between`, of motions in so many times the steps: at a fraction of the way from point k, from a
    state and a value of the parameter, with the derivative at a point nearby.
    """
    return _in_plane(
        continuation, continuation.finer(times), place, start, _derivative(continuation, place[0], near)
    )


def _derivative(continuation: Continuation, k: int, point: ContinuationPoint) -> np.ndarray:
    """Of x(T), along the parameter too where it is free in the planes across the way from point k."""
    held = not across(continuation, k)[1][:-1].any()
    return point.fixed.monodromy if held else point.derivative(continuation.parameter.name)


def _in_plane(
    continuation: Continuation,
    period: Period,
    place: tuple[int, float],
    start: tuple[np.ndarray, float],
    near: np.ndarray,
) -> ContinuationPoint:
    """The motion of a period in the plane at a fraction of the way from point k to the next one, by Newton's
    method from a start with a derivative nearby.
    """
    (k, fraction), parameter = place, continuation.parameter
    one, other = continuation.points[k : k + 2]
    size, normal = across(continuation, k)
    held = not normal[:-1].any()
    guess, value = (
        one.fixed.state + fraction * (other.fixed.state - one.fixed.state),
        one.value + fraction * (other.value - one.value),
    )
    begin = value if held else start[1]

    def condition(state, change):
        slope = size / parameter.extent * normal[-1]
        return float(normal[:-1] @ (state - guess) + slope * (change + begin - value)), normal[:-1], slope

    fixed = shoot_along(period, (start[0], begin), parameter, None if held else condition, near)
    return ContinuationPoint(fixed, float(begin if held else fixed.parameters[0]))


def chord(
    continuation: Continuation, one: ContinuationPoint, other: ContinuationPoint
) -> tuple[float, np.ndarray]:
    """Unit of the state, and the way from a point to another one with the parameter as a share of its
    range.
    """
    size = max(*(continuation.period.size(point.fixed.state) for point in (one, other)), 1e-300)
    state, value = other.fixed.state - one.fixed.state, other.value - one.value
    return size, np.append(state / size, value / continuation.parameter.extent)


def across(continuation: Continuation, k: int) -> tuple[float, np.ndarray]:
    """Unit of the state, and the normal of the planes, in units of `chord`, that cut the way from point k to
    the next one in fractions: its chord, or the parameter where the way is mostly that and does not turn
    nearby, where it leads beyond both points.
    """
    size, way = chord(continuation, *continuation.points[k : k + 2])
    steps = np.diff([point.value for point in continuation.points[max(0, k - 1) : k + 3]])
    along = abs(way[-1]) * SPAN > HELD * np.hypot(np.linalg.norm(way[:-1]), way[-1] * SPAN)
    if along and ((steps > 0.0).all() or (steps < 0.0).all()):
        return size, np.append(np.zeros(len(way) - 1), 1.0)
    return size, way / np.linalg.norm(way)


def place_of(continuation: Continuation, k: int, point: ContinuationPoint) -> float:
    """Fraction of the way from point k to the next one at which a point is."""
    one, other = continuation.points[k : k + 2]
    size, normal = across(continuation, k)
    _, way = chord(continuation, one, other)
    state, value = point.fixed.state - one.fixed.state, point.value - one.value
    there = np.append(state / size, value / continuation.parameter.extent)
    return float(there @ normal / (way @ normal))


def beside(continuation: Continuation, k: int) -> Places:
    """The points before and behind points k and k + 1 by their fractions of the way between these."""
    points, result = continuation.points, {}
    for n, outside in ((k - 1, lambda place: place < -APART), (k + 2, lambda place: place > 1.0 + APART)):
        if 0 <= n < len(points):
            place = place_of(continuation, k, points[n])
            if outside(place):
                result[place] = points[n]
    return result


def _weights(known: Places, fraction: float) -> tuple[list[float], np.ndarray]:
    """Places that are nearest to a fraction, and the weights of the polynomial through them there."""
    places = sorted(known, key=lambda place: abs(place - fraction))[:4]
    weights = [
        math.prod((fraction - other) / (place - other) for other in places if other != place)
        for place in places
    ]
    return places, np.array(weights)


def find_zero(
    continuation: Continuation,
    k: int,
    test: Callable[[ContinuationPoint], float],
    ends: tuple[float, float],
    smooth: Callable[[Places], dict[float, float]] | None = None,
    small: float = math.inf,
) -> tuple[ContinuationPoint, ContinuationPoint, ContinuationPoint]:
    """The point between points k and k + 1 at which a test function of points vanishes, and its nearest
    neighbours of either sign.

    Parameters
    ----------
    continuation : Continuation
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
    known: Places = dict(zip((0.0, 1.0), continuation.points[k : k + 2]))
    values = dict(zip((0.0, 1.0), ends))
    around = beside(continuation, k) if smooth is not None else {}
    bracket, place, widths, poor = (0.0, 1.0), 0.0, [1.0], False
    while len(widths) <= MOST:
        near = min(abs(values[end]) for end in bracket) <= small
        if widths[-1] <= FINER * (1.0 + 1e-9) or (
            widths[-1] <= FINE * (1.0 + 1e-9)
            and near
            and (known[bracket[0]].fixed.touching == known[bracket[1]].fixed.touching).all()
        ):
            break
        expected = values if smooth is None else smooth({**around, **known})
        # what is followed may vanish elsewhere than the test, which counts all
        other = len(known) > 2 and abs(expected[place] - values[place]) > SAME
        if len(known) > 2 and not other and near and _arrived(known, values, expected, place):
            break
        slow = len(widths) > 2 and widths[-1] > 0.5 * widths[-3]
        place = 0.5 * sum(bracket) if slow or poor or other else _next_place(expected, *bracket)
        try:
            known[place] = between(continuation, k, place, known)
        except SolveError:  # the nearer of the points that were found stands for it
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


def _arrived(known: Places, values: dict[float, float], expected: dict[float, float], place: float) -> bool:
    """Whether a test function vanishes next to a place: by the straight lines to the neighbours on either
    side, between which the zero of a curve without inflection lies; not where pairs touch on one side alone.
    """
    places = sorted(known)
    n = places.index(place)
    for other in (places[n - 1], places[n + 1]):
        if (
            values[other] * values[place] <= 0.0
            and (known[place].fixed.touching != known[other].fixed.touching).any()
        ):
            return False
        rise = abs(expected[place] - expected[other])
        if abs(expected[place] * (other - place)) > 0.5 * FINE * rise:
            return False
    return True

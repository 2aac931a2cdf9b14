"""Folds, period doublings, Neimark-Sacker and grazing points between the points of a branch."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq

from ..errors import SolveError
from .continuation import Continuation, ContinuationPoint
from .orbit import FLOOR
from .shooting import shoot_along
from .stability import Multipliers, multipliers_of

# How far along the arc between two points a bifurcation is located.
FINE = 5e-3
# A located multiplier this near the unit circle has passed it there.
RESOLVED = 1e-2
# Neighbours tell how a branch bends between two points if they are so far beyond them, of their distance.
APART = 0.2


@dataclass(frozen=True, eq=False)
class Bifurcation:
    """A point where the number of unstable multipliers changes, or where the branch turns back.

    Attributes
    ----------
    kind : {"fold", "period doubling", "Neimark-Sacker", "branch point", "grazing"}
        "grazing": a pair begins or ceases to touch, and the multiplier is inside the unit circle on one side
        and outside on the other, however near.
    value : float
        Frequency (Hz) or load factor.
    multiplier : complex
        The one that passes the unit circle.
    state : (2 m,) array
        x(0).
    direction : (2 m,) complex array
        Its Floquet direction.
    after : int
        Index of the point of the branch behind it.
    row : int or None
        Contact row that begins or ceases to touch, where a grazing point knows it.
    """

    kind: str
    value: float
    multiplier: complex
    state: np.ndarray
    direction: np.ndarray
    after: int
    row: int | None = None

    def __repr__(self) -> str:
        return f"Bifurcation({self.kind} at {self.value:.7g}, multiplier {self.multiplier:.6g})"


def unstable(found: Multipliers, margin: float = 0.0) -> int:
    """Number of multipliers outside the unit circle by more than a margin."""
    return int((np.abs(found.values) > 1.0 + margin).sum())


def several(one: Multipliers, other: Multipliers) -> bool:
    """Whether multipliers pass the unit circle at -1 and at +1 from a point of a branch to the next one.

    Real ones that meet and become a complex pair leave their sign in twos: an odd number passes.
    """
    real = [found.values.real[np.abs(found.values.imag) == 0.0] for found in (one, other)]
    below, above = ([int((sign * part > 1.0 + FLOOR).sum()) for part in real] for sign in (-1.0, 1.0))
    return bool((below[0] - below[1]) % 2 and (above[0] - above[1]) % 2)


def between(
    continuation: Continuation,
    k: int,
    fraction: float,
    known: dict[float, ContinuationPoint] | None = None,
) -> ContinuationPoint:
    """A point of the branch in the plane across the chord from point k to the next one; `known` are such
    points by their fractions.
    """
    one, other = continuation.points[k : k + 2]
    size, chord = _chord(continuation, one, other)
    heading = chord / np.linalg.norm(chord)
    guess, value = (
        one.fixed.state + fraction * (other.fixed.state - one.fixed.state),
        one.value + fraction * (other.value - one.value),
    )

    def condition(state, change):
        return (
            float(
                heading[:-1] @ (state - guess) + size / continuation.parameter.extent * heading[-1] * change
            ),
            heading[:-1],
            size / continuation.parameter.extent * heading[-1],
        )

    name = continuation.parameter.name
    near = (1.0 - fraction) * one.derivative(name) + fraction * other.derivative(name)
    start, begin = _interpolated(
        {0.0: one, 1.0: other, **_beside(continuation, k), **(known or {})}, fraction
    )
    fixed = shoot_along(
        continuation.period,
        (start, begin),
        continuation.driven,
        name,
        lambda state, change: condition(state, change + begin - value),
        near,
    )
    return ContinuationPoint(fixed, float(fixed.parameters[0]))


def _chord(
    continuation: Continuation, one: ContinuationPoint, other: ContinuationPoint
) -> tuple[float, np.ndarray]:
    """Unit of the state, and the way from a point to another one with the parameter as a share of its
    range.
    """
    size = max(float(np.linalg.norm(one.fixed.state)), float(np.linalg.norm(other.fixed.state)), 1e-300)
    state, value = other.fixed.state - one.fixed.state, other.value - one.value
    return size, np.append(state / size, value / continuation.parameter.extent)


def _beside(continuation: Continuation, k: int) -> dict[float, ContinuationPoint]:
    """The points before and behind points k and k + 1 by their fractions of the way between these."""
    points = continuation.points
    size, chord = _chord(continuation, points[k], points[k + 1])
    result = {}
    for n, outside in ((k - 1, lambda place: place < -APART), (k + 2, lambda place: place > 1.0 + APART)):
        if 0 <= n < len(points):
            way = np.append(
                (points[n].fixed.state - points[k].fixed.state) / size,
                (points[n].value - points[k].value) / continuation.parameter.extent,
            )
            place = float(way @ chord / (chord @ chord))
            if outside(place):
                result[place] = points[n]
    return result


def _interpolated(known: dict[float, ContinuationPoint], fraction: float) -> tuple[np.ndarray, float]:
    """State and parameter at a fraction by the polynomial through the nearest points that are known."""
    places = sorted(known, key=lambda place: abs(place - fraction))[:4]
    state, value = np.zeros_like(known[places[0]].fixed.state), 0.0
    for place in places:
        weight = math.prod((fraction - other) / (place - other) for other in places if other != place)
        state += weight * known[place].fixed.state
        value += weight * known[place].value
    return state, value


def locate(continuation: Continuation, found: list[Multipliers]) -> list[Bifurcation]:
    """All bifurcations of a branch in the order of its points.

    Parameters
    ----------
    continuation : Continuation
        Gone through.
    found : list of Multipliers
        Of all its points.
    """
    result = []
    points = continuation.points
    for k in range(1, len(points)):
        if (
            k + 1 < len(points)
            and (points[k].value - points[k - 1].value) * (points[k + 1].value - points[k].value) < 0.0
        ):
            result.append(_fold(continuation, k))
        one, other = unstable(found[k - 1], FLOOR), unstable(found[k], FLOOR)
        if one != other:
            crossing = _crossing(continuation, k, max(one, other) - 1, found[k - 1], found[k])
            # a real multiplier through +1 at a turning point is the fold itself, which has been found by its
            # turn
            if crossing is not None and not (crossing.kind == "branch point" and _turns(points, k)):
                result.append(crossing)
    return result


def _turns(points: list[ContinuationPoint], k: int) -> bool:
    steps = np.diff([s.value for s in points[max(0, k - 2) : k + 2]])
    return bool((steps[1:] * steps[:-1] < 0.0).any())


def _fold(continuation: Continuation, k: int) -> Bifurcation:
    """Where the branch turns: the parameter's extremum between the neighbours of point k."""
    points = continuation.points

    def slope(point: ContinuationPoint) -> float:
        """The parameter's part of the branch's direction."""
        m2, carried = len(point.fixed.state), point.derivative(continuation.parameter.name)
        bordered = np.zeros((m2 + 1, m2 + 1))
        bordered[:m2] = carried
        bordered[:m2, :m2] -= np.eye(m2)
        chord = np.append(points[k + 1].fixed.state - points[k - 1].fixed.state, 0.0)
        bordered[m2] = chord / np.linalg.norm(chord)
        # the unit in which the parameter is solved for must not make the border small
        scale = float(np.linalg.norm(carried[:, m2]) / np.linalg.norm(carried[:, :m2], 2))
        bordered[:, m2] /= max(scale, 1e-300)
        direction = np.linalg.solve(bordered, np.eye(m2 + 1)[m2])
        return float(direction[m2])

    for first in (k - 1, k):
        ends = slope(points[first]), slope(points[first + 1])
        if ends[0] * ends[1] > 0.0:
            continue
        point, _, _ = _root(continuation, first, slope, ends)
        values = multipliers_of(point.fixed)
        nearest = int(np.argmin(np.abs(values.values - 1.0)))
        return Bifurcation(
            "fold",
            point.value,
            complex(values.values[nearest]),
            point.fixed.state,
            values.direction(nearest),
            first + 1,
        )
    values = multipliers_of(points[k].fixed)
    nearest = int(np.argmin(np.abs(values.values - 1.0)))
    return Bifurcation(
        "fold",
        points[k].value,
        complex(values.values[nearest]),
        points[k].fixed.state,
        values.direction(nearest),
        k + 1,
    )


def _crossing(
    continuation: Continuation, k: int, rank: int, before: Multipliers, after: Multipliers
) -> Bifurcation | None:
    """Where the multiplier of the given rank by modulus passes the unit circle between points k - 1 and k,
    whose multipliers are known.
    """
    known = {}

    def excess(point: ContinuationPoint) -> float:
        known[id(point)] = multipliers_of(point.fixed)
        return float(np.abs(known[id(point)].values[rank]) - 1.0)

    first, second = continuation.points[k - 1], continuation.points[k]
    ends = float(np.abs(before.values[rank]) - 1.0), float(np.abs(after.values[rank]) - 1.0)
    if ends[0] * ends[1] > 0.0:
        return None
    point, one, other = _root(continuation, k - 1, excess, ends)
    found = known.get(id(point)) or (before if point is first else after)
    value = complex(found.values[rank])
    # a jump over the circle between two points that touch differently, finer than bifurcations are located
    unresolved = abs(abs(value) - 1.0) > RESOLVED and (_touching(first) != _touching(second)).any()
    kind = (
        "grazing"
        if (_touching(one) != _touching(other)).any() or unresolved
        else "Neimark-Sacker"
        if value.imag != 0.0
        else "period doubling"
        if value.real < 0.0
        else "branch point"
    )
    rows = np.flatnonzero(_touching(one) != _touching(other))
    row = int(rows[0]) if kind == "grazing" and len(rows) == 1 else None
    return Bifurcation(kind, point.value, value, point.fixed.state, found.direction(rank), k, row)


def _root(
    continuation: Continuation,
    k: int,
    test: Callable[[ContinuationPoint], float],
    ends: tuple[float, float],
) -> tuple[ContinuationPoint, ContinuationPoint, ContinuationPoint]:
    """The point between points k and k + 1 at which a test function of points vanishes, and its nearest
    neighbours of either sign.
    """
    known = dict(zip((0.0, 1.0), zip(continuation.points[k : k + 2], ends)))

    def value(fraction: float) -> float:
        if fraction not in known:
            points = {place: point for place, (point, _) in known.items()}
            point = between(continuation, k, fraction, points)
            known[fraction] = point, test(point)
            if _arrived(known, fraction):
                return 0.0
        return known[fraction][1]

    try:
        brentq(value, 0.0, 1.0, xtol=FINE, rtol=1e-8)
    except SolveError:  # the nearer of the points that were found stands for it
        pass
    places = sorted(known)
    n = next(n for n in range(1, len(places)) if known[places[n - 1]][1] * known[places[n]][1] <= 0.0)
    nearest = min(known.values(), key=lambda pair: abs(pair[1]))[0]
    return nearest, known[places[n - 1]][0], known[places[n]][0]


def _arrived(known: dict[float, tuple[ContinuationPoint, float]], fraction: float) -> bool:
    """Whether a test function vanishes next to a fraction: by the straight lines to the nearest point of
    the other sign and to the nearest of all others, between which the zero of a curve without inflection
    lies; not where pairs touch on one side alone.
    """
    point, value = known[fraction]
    nearest = sorted((place for place in known if place != fraction), key=lambda place: abs(place - fraction))
    across = next(place for place in nearest if known[place][1] * value <= 0.0)
    if (_touching(point) != _touching(known[across][0])).any():
        return False
    return all(
        abs(value * (place - fraction)) <= 0.5 * FINE * abs(value - known[place][1])
        for place in (across, nearest[0])
    )


def _touching(point: ContinuationPoint) -> np.ndarray:
    """(pairs,) bool: which pairs touch at any time of the period."""
    return (point.fixed.motion.forces > 0.0).any(axis=0)

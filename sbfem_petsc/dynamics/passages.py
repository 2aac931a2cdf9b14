"""Multipliers that pass the unit circle unseen between two points of a branch: one leaves it and another one
enters, or the same one leaves and comes back.
"""

from __future__ import annotations

import numpy as np

from .orbit import FLOOR
from .stability import Multipliers

# Multipliers whose modulus is this near to one are watched for excursions over the unit circle.
NEAR = 0.05


def passages(one: Multipliers, other: Multipliers) -> int:
    """Multipliers that are outside the unit circle at one of two points of a branch, while the one that is
    nearest to them at the other is not; a complex pair counts once.
    """
    count = 0
    for here, there in ((one, other), (other, one)):
        outside = here.values[(np.abs(here.values) > 1.0 + FLOOR) & (here.values.imag >= 0.0)]
        for value in outside:
            nearest = there.values[np.abs(there.values - value).argmin()]
            count += int(np.abs(nearest) <= 1.0 + FLOOR)
    return count


def ambiguous(one: Multipliers, other: Multipliers) -> bool:
    """Whether both the number of real multipliers outside the unit circle and that of complex pairs differ
    between two points: a pair may have come back before a real one left, or split into two of which one came
    back.
    """
    real, paired = (
        [int(((np.abs(item.values) > 1.0 + FLOOR) & kind(item.values)).sum()) for item in (one, other)]
        for kind in (lambda values: values.imag == 0.0, lambda values: values.imag > 0.0)
    )
    change = real[1] - real[0] + 2 * (paired[1] - paired[0])
    return real[0] != real[1] and paired[0] != paired[1] and change != 0


def excursion(around: list[tuple[float, Multipliers]]) -> float | None:
    """Where between two points of a branch, as a fraction of the way, a multiplier is expected furthest
    beyond the unit circle that is on the same side of it at both; None where none is.

    Parameters
    ----------
    around : list of (float, Multipliers)
        Four points in their order, the two in the middle at 0 and 1: the parabolas through either three of
        them must agree, so that a corner of the branch is not taken for a bend.
    """
    _, middle, following, _ = (found.values for _, found in around)
    places = np.array([place for place, _ in around])
    furthest, where = FLOOR, None
    for value in middle[(np.abs(np.abs(middle) - 1.0) < NEAR) & (middle.imag >= 0.0)]:
        chain = np.array([_nearest(around[0][1], value), value, _nearest(around[2][1], value), 0.0])
        chain[3] = _nearest(around[3][1], chain[2])
        heights = np.abs(chain) - 1.0
        if heights[1] * heights[2] <= 0.0:
            continue
        side = -np.sign(heights[1])
        tops = [_top(places[part], side * heights[part]) for part in (slice(0, 3), slice(1, 4))]
        if all(0.0 < place < 1.0 for place, _ in tops):
            beyond = min(height for _, height in tops)
            if beyond > furthest:
                furthest, where = beyond, 0.5 * (tops[0][0] + tops[1][0])
    return where


def _nearest(found: Multipliers, value: complex) -> complex:
    return complex(found.values[np.abs(found.values - value).argmin()])


def _top(places: np.ndarray, heights: np.ndarray) -> tuple[float, float]:
    """Place and height of the top of a parabola through three points; nan where it has none."""
    bend, slope, level = np.polyfit(places, heights, 2)
    if not bend < 0.0:
        return np.nan, np.nan
    place = -0.5 * slope / bend
    return float(place), float(level + 0.5 * slope * place)

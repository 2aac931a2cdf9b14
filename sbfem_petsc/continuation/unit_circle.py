"""Multipliers that pass the unit circle unseen between two points of a branch: one leaves it and another one
enters, or the same one leaves and comes back.
"""

from __future__ import annotations

import numpy as np

from .multipliers import Multipliers
from .orbit import FLOOR

# Multipliers whose modulus is this near to one are watched for excursions over the unit circle.
NEAR = 0.05
# A multiplier that is no further inside the unit circle than this share of its change may have been outside:
# a real one near -1, and one of a pair by the change of its modulus.
HURRIED, PAIRED = 0.25, 0.02


def outside(found: Multipliers) -> np.ndarray:
    """(k,) bool: which multipliers are outside the unit circle by more than rounding."""
    return np.abs(found.values) > 1.0 + FLOOR


def passages(one: Multipliers, other: Multipliers) -> int:
    """Multipliers that are outside the unit circle at one of two points of a branch, while the one that is
    nearest to them at the other is not; a complex pair counts once.
    """
    count = 0
    for here, there in ((one, other), (other, one)):
        leading = here.values[outside(here) & (here.values.imag >= 0.0)]
        count += int((~outside(there)[_nearest(there, leading)]).sum())
    return count


def ambiguous(one: Multipliers, other: Multipliers) -> bool:
    """Whether both the number of real multipliers outside the unit circle and that of complex pairs differ
    between two points: a pair may have come back before a real one left, or split into two of which one came
    back.
    """
    here, there = (item.values[outside(item)].imag for item in (one, other))
    real = np.count_nonzero(there == 0.0) - np.count_nonzero(here == 0.0)
    paired = np.count_nonzero(there > 0.0) - np.count_nonzero(here > 0.0)
    return real != 0 and paired != 0 and real + 2 * paired != 0


def hurried(one: Multipliers, other: Multipliers) -> bool:
    """Whether a multiplier is just inside -1 at one of two points of a branch, or a pair inside the unit
    circle, and far from there at the other: between them it may have been outside and come back.
    """
    for here, there in ((one, other), (other, one)):
        values = here.values
        turning = (values.imag > 0.0) | (values.imag == 0.0) & (values.real < 0.0)
        near = values[turning & (np.abs(values) > 1.0 - NEAR) & ~outside(here)]
        beside = there.values[_nearest(there, near)]
        # of a pair what counts is how it nears the circle: without damping all run along it
        nears = PAIRED * np.abs(np.abs(beside) - np.abs(near))
        reach = np.where(near.imag > 0.0, nears, HURRIED * np.abs(beside - near))
        if ((1.0 - np.abs(near) < reach) & (reach > FLOOR)).any():
            return True
    return False


def excursion(around: list[tuple[float, Multipliers]]) -> float | None:
    """Where between two points of a branch, as a fraction of the way, a multiplier is expected furthest
    beyond the unit circle that is on the same side of it at both; None where none is.

    Parameters
    ----------
    around : list of (float, Multipliers)
        Four points in their order, the two in the middle at 0 and 1: the parabolas through either three of
        them must agree, so that a corner of the branch is not taken for a bend.
    """
    spectra = [found for _, found in around]
    middle = spectra[1].values
    middle = middle[(np.abs(np.abs(middle) - 1.0) < NEAR) & (middle.imag >= 0.0)]
    before, following = (found.values[_nearest(found, middle)] for found in (spectra[0], spectra[2]))
    behind = spectra[3].values[_nearest(spectra[3], following)]
    heights = np.abs(np.array([before, middle, following, behind])) - 1.0
    heights *= -np.sign(heights[1])
    same = heights[2] < 0.0
    if not same.any():
        return None
    places, heights = np.array([place for place, _ in around]), heights[:, same]
    tops, beyond = zip(*(_top(places[n : n + 3], heights[n : n + 3]) for n in (0, 1)))
    within = ((np.array(tops) > 0.0) & (np.array(tops) < 1.0)).all(axis=0)
    reached = np.where(within, np.minimum(*beyond), -np.inf)
    furthest = int(reached.argmax())
    return float(np.mean(tops, axis=0)[furthest]) if reached[furthest] > FLOOR else None


def _nearest(found: Multipliers, values: np.ndarray) -> np.ndarray:
    """(n,) int: which multipliers are the nearest to (n,) values."""
    return np.abs(found.values - values[:, None]).argmin(axis=1)


def _top(places: np.ndarray, heights: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Places and heights of the tops of parabolas through three points each, (3, k); nan where there is
    none.
    """
    first, second = np.diff(heights, axis=0) / np.diff(places)[:, None]
    bend = (second - first) / (places[2] - places[0])
    bend[~(bend < 0.0)] = np.nan
    place = 0.5 * (places[0] + places[1]) - 0.5 * first / bend
    return place, heights[0] + (place - places[0]) * (first + bend * (place - places[1]))

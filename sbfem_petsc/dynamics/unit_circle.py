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
        count += int((np.abs(_nearest(there, outside)) <= 1.0 + FLOOR).sum())
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
    spectra = [found for _, found in around]
    middle = spectra[1].values
    middle = middle[(np.abs(np.abs(middle) - 1.0) < NEAR) & (middle.imag >= 0.0)]
    following = _nearest(spectra[2], middle)
    chains = [_nearest(spectra[0], middle), middle, following, _nearest(spectra[3], following)]
    heights = np.abs(np.array(chains)) - 1.0
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
    return found.values[np.abs(found.values - values[:, None]).argmin(axis=1)]


def _top(places: np.ndarray, heights: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Places and heights of the tops of parabolas through three points each, (3, k); nan where there is
    none.
    """
    first, second = np.diff(heights, axis=0) / np.diff(places)[:, None]
    bend = (second - first) / (places[2] - places[0])
    bend[~(bend < 0.0)] = np.nan
    place = 0.5 * (places[0] + places[1]) - 0.5 * first / bend
    return place, heights[0] + (place - places[0]) * (first + bend * (place - places[1]))

"""Stability of free motions, and what lies between those of a branch: turns in energy, multipliers that leave
the unit circle, interactions with higher modes.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from ...record.record import Record, described, quantity
from ..events import find_zero, folds, insert
from ..follow import Line
from ..problem import Metric, Point
from .free import UNCERTAIN, FreeState, FreeSystem

KINDS = ("fold", "period doubling", "Neimark-Sacker", "branch point")
# How far off the unit circle a multiplier is that has left it for certain. Angle from 1 or -1, radian, that
# is none, and distance from 1 within which it belongs to a turn beside.
CERTAIN, REAL, OF_TURN = 1e-3, 0.1, 0.5
# Multipliers that turn by so many turns from a point to the next are not followed; vectors of one pair at two
# points have this product at least.
TURN, ALIKE = 0.25, 0.5
# Extent of an interaction, as a change of the state, from which on it is one; energies on either side of it
# are to be as near to each other as this.
EXTENT, NEAR = 1e-3, 1.2
# Times that a stretch with an interaction is divided at most, and where.
HALVINGS, FRACTIONS = 4, (0.5, 0.4, 0.6)


@described
class FreeEvent(Record):
    """A place on a branch of free motions.

    Of kind "fold" the branch turns in energy; else a multiplier leaves or enters the unit circle, through -1,
    as one of a pair, or through 1.
    """

    kind: str = quantity(text="what it is", one_of=KINDS)
    energy: float = quantity("J", "energy of the motion", least=1e-300)
    frequency: float = quantity("Hz", "its frequency, in the branch's own steps", least=1e-300)
    multiplier: complex = quantity("1", "the one of largest modulus next to it", finite=False)
    after: int = quantity("1", "index of the point of the branch behind it", least=0, detail=True)


def free_multipliers(state: FreeState, *, damped: bool) -> np.ndarray:
    """Multipliers of a free motion by falling modulus, complex; in conjugate pairs.

    Without that along the motion, which is 1; without damping less a second 1, along the branch; with damping
    less what the self-excitation gives to every disturbance alike, and the product of those two over 1 is the
    one that remains.
    """
    rest, _, product = state.spectrum
    if damped:
        rest = np.append(rest, product) * math.exp(-0.5 * state.excitation / state.frequency)
    return rest[np.argsort(-np.abs(rest), kind="stable")]


def free_events(line: Line, *, damped: bool, stability: bool) -> tuple[FreeEvent, ...]:
    """Turns at points of a branch and, if its stability is asked for, changes of it between them."""
    result = []

    def largest(point: Point) -> complex:
        return complex(free_multipliers(point.state, damped=damped)[0])

    def excess(point: Point) -> float:
        return abs(largest(point)) - 1.0 - UNCERTAIN

    turns = {before + 1: here for before, here in folds(line)}
    stability = stability and len(line.points[0].state.spectrum[0]) + damped > 0
    for k, point in enumerate(line.points):
        if k in turns:
            here = turns[k]
            value = largest(here) if stability else complex(math.nan)
            result.append(FreeEvent(KINDS[0], here.value, here.state.frequency, value, k))
        if k == 0 or not stability or point.leapt:
            continue
        ends = excess(line.points[k - 1]), excess(point)
        if not (ends[0] * ends[1] < 0.0 and max(ends) > CERTAIN):
            continue
        here, *sides = find_zero(line, k - 1, excess, ends)
        value = largest(max(sides, key=excess))
        if abs(value - 1.0) > OF_TURN or not turns.keys() & {k - 2, k - 1, k, k + 1}:
            result.append(FreeEvent(_kind(value), here.value, here.state.frequency, value, k))
    return tuple(result)


def _kind(value: complex) -> str:
    angle = abs(math.atan2(value.imag, value.real))
    return KINDS[3] if angle < REAL else KINDS[1] if angle > math.pi - REAL else KINDS[2]


# ---------------------------------------------------------------------- interactions
# A multiplier on the unit circle comes round to 1 where a multiple of the frequency meets that of its mode.
# Coupled motions leave the branch there along a tongue. At a distance d along the branch the tangent has a
# part a in the vector of that multiplier which grows as 1 / d^2, so that the tongue is as long as the way on
# which it is all of the tangent, d sqrt(a).
def interactions_of(line: Line) -> tuple[tuple[float, float], ...]:
    """Energies, J, of the points on either side of each interaction with a higher mode that a branch without
    damping passes.
    """
    values = line.values.tolist()
    return tuple((values[k], values[k + 1]) for k in _found(line))


def divide_interactions(line: Line, tell: Callable[[Point], object]) -> None:
    """Add points where those on either side are far apart."""
    for _ in range(HALVINGS):
        values, count = line.values, len(line.points)
        for k in reversed(_found(line)):
            if 1.0 / NEAR < values[k + 1] / values[k] < NEAR:
                continue
            for fraction in FRACTIONS:  # where one is on the tongue itself another one is not
                known = len(line.points)
                insert(line, k, fraction, tell)
                if len(line.points) > known:
                    break
        if len(line.points) == count:
            break


def _found(line: Line) -> list[int]:
    """Numbers of the points before them, as far as the branch leads beyond all energies before."""
    values = line.values
    ahead = values if values[-1] > values[0] else -values
    furthest = np.maximum.accumulate(ahead)
    return [
        k
        for k in range(len(ahead) - 1)
        if ahead[k] == furthest[k] and ahead[k + 1] > ahead[k] and _passes(*line.points[k : k + 2])
    ]


def _passes(one: Point, other: Point) -> bool:
    """Whether there is one between two points."""
    if other.leapt:
        return True
    (turns_one, vectors_one), (turns_other, vectors_other) = one.state.turning, other.state.turning
    if not len(turns_one) or not len(turns_other):
        return False
    system = one.state.system
    alike = np.abs(_form(system, vectors_one, vectors_other))
    matched = alike.argmax(axis=1)
    follows = turns_other[matched]
    passed = (turns_one * follows < 0.0) & (np.abs(turns_one) < TURN) & (np.abs(follows) < TURN)
    passed &= alike.max(axis=1) > ALIKE
    metric = Metric(one.problem, one.u)
    way = metric.way(one, other)
    for n in np.flatnonzero(passed):
        share = turns_one[n] / (turns_one[n] - follows[n])
        ends = ((one, vectors_one[:, n], share), (other, vectors_other[:, matched[n]], 1.0 - share))
        for point, vector, away in ends:
            part = _part(point, vector, metric.unit(way))
            if away * metric.length(way) * math.sqrt(part) > EXTENT:
                return True
    return False


def _form(system: FreeSystem, one: np.ndarray, other: np.ndarray) -> np.ndarray:
    return one.conj().T @ system.turned(other)


def _part(point: Point, vector: np.ndarray, near: np.ndarray) -> float:
    """Of the branch's direction at a point, the part in a multiplier's vector."""
    metric = Metric(point.problem, point.u)
    tangent = metric.tangent(point.linear, near)[0][:-2]
    share = np.abs(_form(point.state.system, vector[:, None], tangent[:, None]))[0, 0]
    return float(share * np.linalg.norm(vector))

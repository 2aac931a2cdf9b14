"""Follows a branch of periodic motions: what is kept of each point, finer points where it bends, its end."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable
from dataclasses import replace
from typing import Protocol

import numpy as np

from meshing.warnings import BranchWarning

from ..errors import SolveError, caller_level, on_all_ranks
from .bifurcations import Bifurcation, locate
from .branch import Branch
from .branch_range import ContinuationSettings, ParameterRange
from .branch_zero import beside, between
from .continuation import Continuation, ContinuationPoint
from .excitation import one_sided
from .extrapolation import uncertainty_at
from .fixed_point import FixedPoint
from .orbit import FLOOR, NEAR, modal_motion
from .period_map import Period
from .several_periods import distances, minimal_periods
from .stability import Multipliers, multipliers_of
from .unit_circle import ambiguous, excursion, passages

# Harmonics kept of every point.
HARMONICS = 20
# Frequencies of a linear response: so many over the range, and so many about each resonance.
EVEN, ABOUT = 201, 41
# A chord of the curve, over parameter and amplitude both scaled to 1, is divided, so many times at most, if
# it is off the curve by more than this share of the amplitude, or of it times a cosine where the curve is
# steeper; beside a peak until the bend (radian) or the chord is as small; not if it is shorter.
CHORD, STEEP, BEND, PEAK, SHORT, PASSES = 0.015, 0.3, 0.3, 0.005, 0.005, 6
# A stretch with a period doubling and a fold in it is halved so often at most.
HALVINGS = 8
# Step along a branch, relative to the state, by which its distance from shorter motions is differentiated.
AHEAD = 1e-4
# The multipliers' uncertainty is measured at every so many points, and where the largest modulus is off 1 by
# no more than so many times that of its neighbours.
SPARSE, FAR = 32, 5.0
# A branch that first leads away from its range may do so by this share of the parameter or of the range.
EXCURSION = 0.02


class BranchRecorder(Protocol):
    """Keeps a branch while it is followed.

    Attributes
    ----------
    former : (states (n, 2 m), values (n,), float, str) or None
        Points of the run that is resumed, the length of its next step, and why it ended.
    """

    former: tuple[np.ndarray, np.ndarray, float, str] | None

    def update(self, branch: Callable[[], Branch], length: float, last: bool = False) -> None:
        """Keep the branch as it is and the length of its next step. Collective."""


def follow(
    period: Period,
    parameter: ParameterRange,
    first: Callable[[], np.ndarray],
    *,
    settings: ContinuationSettings,
    recorder: BranchRecorder | None = None,
    report: Callable[[float], None] | None = None,
) -> Branch:
    """Follow a branch over a range of its parameter.

    Parameters
    ----------
    period : Period
    parameter : ParameterRange
    first : callable
        State of a motion at the start.
    settings : ContinuationSettings
    recorder : BranchRecorder, optional
    report : callable, optional
        Called with the fraction done.

    Raises
    ------
    SolveError
        If the branch comes to a stop within the range; the points so far are the error's attribute `branch`.

    Warns
    -----
    BranchWarning
        If it ends after the most points that are allowed.
    """
    what = f"{parameter.name}_response"
    if not period.excitation.orders.any():
        raise on_all_ranks(
            ValueError(f"{what}: no load oscillates; give a number, the amplitude of sin(2 pi f t)")
        )
    former = recorder.former if recorder is not None else None
    known = [(first(), parameter.start)] if former is None else list(zip(*former[:2]))
    rows, points = PointRows(period, settings.stability), []
    for state, value in known:
        points.append(_point(period, parameter, state, float(value)))
        rows.add(points[-1])
        if len(points) > 2:
            points[-3].fixed.forget()
    continuation = Continuation(period, points[0], parameter, settings)
    continuation.points = points
    if former is not None:
        continuation.length, continuation.reason = former[2:]
    elif settings.leave:
        lead_away(continuation)
    parameter = continuation.parameter
    if len(points) == 1 or parameter.holds(points[-1].value):
        for item in continuation:
            rows.add(item)
            if recorder is not None:
                recorder.update(lambda: _branch(continuation, rows, False), continuation.length)
            if report is not None:
                report(min(1.0, abs(item.value - parameter.start) / parameter.extent))
        if not parameter.holds(continuation.points[-1].value):
            _refine(continuation, rows)
            if settings.stability:
                _separate(continuation, rows)
    result = _branch(continuation, rows, True)
    if recorder is not None:
        recorder.update(lambda: result, continuation.length, last=True)
    if len(result.value) >= settings.points and not result.complete:
        warnings.warn(
            f"{what}: the curve ends at {result.value[-1]:.8g} after {settings.points} points, before "
            f"{parameter.stop:.8g}; {settings.more}, or take more steps a period if it zigzags",
            BranchWarning,
            stacklevel=caller_level(),
        )
    elif continuation.reason.startswith("back"):
        warnings.warn(f"{what}: the curve is {continuation.reason}", BranchWarning, stacklevel=caller_level())
    elif parameter.holds(float(result.value[-1])) or len(result.value) == 1:
        error = SolveError(
            f"{what}: the curve stops at {result.value[-1]:.8g} after {len(result.value)} points: "
            f"{continuation.reason}; {continuation.advice}"
        )
        error.branch = result  # type: ignore[attr-defined]
        raise on_all_ranks(error)
    return result


def lead_away(continuation: Continuation) -> None:
    """Let a branch of several periods begin in the direction in which it parts from shorter motions.

    Behind a subcritical period doubling that is away from where the range lies; the branch comes back through
    a fold, so the range is extended on that side.
    """
    first, parameter = continuation.points[0], continuation.parameter
    before = distances(first.fixed.driven, first.fixed.motion)
    if not before or minimal_periods(first.fixed) < continuation.period.excitation.periods:
        return
    size, unit = continuation.metric()
    heading = continuation.heading()
    continuation.sign = None
    driven = continuation.driven(first.value + AHEAD * unit * heading[-1])
    after = distances(driven, driven.run(first.fixed.state + AHEAD * size * heading[:-1]))
    nearest = min(before, key=lambda fewer: before[fewer])
    if after[nearest] < before[nearest]:
        reach = max(EXCURSION * abs(first.value), parameter.extent)
        continuation.parameter = replace(parameter, before=reach)


def _point(period: Period, parameter: ParameterRange, state: np.ndarray, value: float) -> ContinuationPoint:
    driven = parameter.at(period, value)
    motion = driven.run(state)
    residual = (float(np.linalg.norm(motion.residual)),)
    return ContinuationPoint(FixedPoint(state, np.array([value]), driven, motion, residual), value)


def _branch(continuation: Continuation, rows: PointRows, finished: bool) -> Branch:
    """The branch as it is; bifurcations and uncertainties are looked for when it is finished."""
    parameter, points, period = continuation.parameter, continuation.points, continuation.period
    asked = finished and continuation.settings.stability
    arrived = parameter.reached(points[-1].value)
    found = [item for item in rows.found if item is not None]  # all of them where stability is asked for
    bifurcations = tuple(locate(continuation, found)) if asked else ()
    return Branch(
        parameter.name,
        np.array([point.value for point in points]),
        np.array([point.fixed.state for point in points]),
        *rows.arrays(),
        _uncertainty(continuation, found, bifurcations) if asked else np.full(len(points), np.nan),
        np.array([len(point.fixed.residuals) - 1 for point in points]),
        bifurcations,
        continuation.reason or "unfinished",
        len(points) > 1 and arrived,
        period.excitation.periods,
        period,
        parameter.frequency,
    )


class PointRows:
    """What is kept of each point."""

    def __init__(self, period: Period, stability: bool):
        self.period, self.stability = period, stability
        self.rows: list[tuple] = []
        self.found: list[Multipliers | None] = []

    def add(self, point: ContinuationPoint, place: int | None = None) -> None:
        """Note a point, at the end or before another one."""
        r, fixed = self.period.reduced, point.fixed
        q, _ = modal_motion(fixed.driven, fixed.motion)
        forces, pairs = fixed.motion.forces[:-1], self.period.pairs
        padded = np.zeros((len(forces), len(r.initial_gap)))
        padded[:, :pairs] = forces
        u = r.points(q[:-1], fixed.driven.loads[:-1], padded)
        spectrum, periods = one_sided(u), self.period.excitation.periods
        found = multipliers_of(fixed) if self.stability else None
        row = (
            np.moveaxis(spectrum[::periods][: HARMONICS + 1], 0, -1),
            0.5 * np.ptp(u[..., 1], axis=0),
            np.moveaxis(spectrum[:periods], 0, -1),
            forces.sum(axis=1).max(initial=0.0),
            found.values if found is not None else np.zeros(0, dtype=complex),
        )
        place = len(self.rows) if place is None else place
        self.rows.insert(place, row)
        self.found.insert(place, found)

    def arrays(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Harmonics, amplitudes, subharmonics, contact peaks and multipliers of all points."""
        harmonics, amplitudes, subharmonics, peaks, values = (np.array(column) for column in zip(*self.rows))
        return harmonics, amplitudes, subharmonics, peaks, values


def _refine(continuation: Continuation, rows: PointRows) -> None:
    """Points between those where the amplitude of a named point bends over the parameter, so that chords show
    the curve and peaks stand where they are.
    """
    for _ in range(PASSES):
        points = continuation.points
        value = np.array([point.value for point in points]) / continuation.parameter.extent
        amplitudes = rows.arrays()[1].T
        bent = {k for heights in amplitudes if heights.any() for k in coarse_chords(value, heights)}
        for k in sorted(bent, reverse=True):
            try:
                point = between(continuation, k, 0.5)
            except SolveError:  # a corner of the branch: the curve is left as it is there
                continue
            rows.add(point, k + 1)
            points.insert(k + 1, point)
            point.fixed.forget()
        if not bent:
            break


def coarse_chords(value: np.ndarray, amplitude: np.ndarray) -> np.ndarray:
    """Numbers of the chords of a curve that are to be divided.

    Parameters
    ----------
    value : (n,) array
        Parameter as a share of its range.
    amplitude : (n,) array
    """
    heights = amplitude / amplitude.max()
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
    beside = np.unique(np.concatenate([peaks - 1, peaks]))
    coarse[beside[length[beside] > PEAK]] = True
    return np.flatnonzero(coarse)


def _separate(continuation: Continuation, rows: PointRows) -> None:
    """Points between those with several passages of the unit circle between them, until each has its own
    place.
    """
    found, points = rows.found, continuation.points
    for _ in range(HALVINGS):
        places = {k: _unseen(continuation, k, found) for k in range(len(points) - 1)}
        for k, place in reversed(places.items()):
            if place is None:
                continue
            try:
                point = between(continuation, k, place)
            except SolveError:  # a corner of the branch: they stay together
                continue
            rows.add(point, k + 1)
            points.insert(k + 1, point)
            point.fixed.forget()
        if not any(places.values()):
            break


def _unseen(continuation: Continuation, k: int, found: list[Multipliers | None]) -> float | None:
    """Where between points k and k + 1 a further one tells passages of the unit circle apart."""
    one, other = found[k : k + 2]
    assert one is not None and other is not None  # stability is asked for
    passing = passages(one, other)
    if passing > 1 or ambiguous(one, other):
        return 0.5
    outer = beside(continuation, k)
    if passing or len(outer) < 2:
        return None
    before, behind = found[k - 1], found[k + 2]
    assert before is not None and behind is not None
    low, high = sorted(outer)
    return excursion([(low, before), (0.0, one), (1.0, other), (high, behind)])


def _uncertainty(
    continuation: Continuation, found: list[Multipliers], bifurcations: tuple[Bifurcation, ...]
) -> np.ndarray:
    """(n,): uncertainty of the largest modulus where the verdict may depend on it, nan elsewhere.

    Beside bifurcations it is expected to be as much as the modulus changes over what the steps move these.
    Where the modulus is near 1 it is measured here and there, at the nearest point of each stretch of one
    verdict, and wherever it is not far from 1 beside what is expected there or known next to it.
    """
    largest = np.array([abs(item.values[0]) for item in found])
    result, off = np.full(len(found), np.nan), np.abs(largest - 1.0)
    if len(found) < 2:
        return result
    changes = np.flatnonzero(np.diff(largest > 1.0 + FLOOR)) + 1
    nearest = {begin + int(part.argmin()) for begin, part in zip([0, *changes], np.split(off, changes))}
    asked = {*range(0, len(found), SPARSE), *(nearest - {*changes, *(changes - 1)})}
    for item in bifurcations:
        pair = np.array([item.after - 1, item.after])
        one, other = (continuation.points[k] for k in pair)
        moved = math.inf if math.isnan(item.error) else abs(item.value - item.own_value) + item.error
        expected = moved * np.ptp(largest[pair]) / max(abs(other.value - one.value), 1e-300)
        asked |= {*pair[off[pair] < FAR * expected]}
    while asked:
        k = asked.pop()
        if not np.isnan(result[k]) or off[k] > NEAR:
            continue
        result[k] = uncertainty_at(continuation, k, largest)
        beside = {max(k - 1, 0), min(k + 1, len(found) - 1)}
        asked |= {n for n in beside if result[k] > FLOOR and off[n] < FAR * result[k]}
    return result


def linear_branch(period: Period, start: float, stop: float) -> Branch:
    """The response without contact, closed form."""
    r = period.reduced
    lower, upper = min(start, stop), max(start, stop)
    inside = [(f, z) for f, z in zip(r.frequencies, r.damping) if lower < f < upper]
    # an even number leaves out a resonance without damping
    near = [
        f * (1.0 + max(z, 1e-4) * np.tan(np.linspace(-1.45, 1.45, ABOUT if z else ABOUT - 1)))
        for f, z in inside
    ]
    values = np.unique(np.concatenate([np.linspace(lower, upper, EVEN), *near]))
    values = values[(values >= lower) & (values <= upper)]
    values = values if stop > start else values[::-1]
    rows, states = PointRows(period, stability=False), []
    for value in values:
        driven = period.at(float(value))
        motion = driven.run(driven.linear_state)
        states.append(driven.linear_state)
        rows.add(
            ContinuationPoint(
                FixedPoint(driven.linear_state, np.zeros(0), driven, motion, (0.0,)), float(value)
            )
        )
    return Branch(
        "frequency",
        values,
        np.array(states),
        *rows.arrays(),
        np.full(len(values), np.nan),
        np.zeros(len(values), dtype=int),
        (),
        f"end of the range at {values[-1]:g}",
        True,
        period.excitation.periods,
        period,
    )

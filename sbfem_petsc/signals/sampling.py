"""How finely a function of time has to be sampled, and where it jumps, found by sampling it."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ..errors import called
from .signal import STEPS_A_PERIOD, Custom, Signal, Sum

# Samples of a span of time: at first, so that what is a hundred thousandth of it is seen, and at most.
FIRST, MOST = 2**17, 2**20
# Fewest steps that follow from them.
FEWEST = 2**11
# Where between two samples a function is looked at, and how far from their line it may be, as a share of its
# amplitude: as a tone is from chords of the default steps.
BETWEEN = 0.381966
AGREE = (2.0 * np.pi / STEPS_A_PERIOD) ** 2 / 8.0
# Times this a function of a given band may be from the lines: as of one twice as high.
SLACK = 4.0
# Parts of the span in each of which they have to be near to the lines.
PARTS = 64
# More places than this where samples do not agree are no jumps.
JUMPS = 2**14
# Halvings until nothing is between two times, the first of which may be zero; jumps in one interval.
HALVINGS, WITHIN = 1100, 8


class Sampling(NamedTuple):
    """Equal intervals over a span of time in which a function is straight but for its jumps.

    Attributes
    ----------
    intervals : int
        How many they are.
    breaks : (k,) array
        First instants behind the jumps, s.
    """

    intervals: int
    breaks: np.ndarray


class _Spans(NamedTuple):
    """Spans of time and the values at their ends, (n,) each."""

    begin: np.ndarray
    end: np.ndarray
    first: np.ndarray
    last: np.ndarray


def sampled(signal: Signal, start: float, stop: float) -> Sampling | None:
    """As many samples as it takes for twice as many to be on the lines between them, in the mean over each
    part of the span, but for jumps; None if that is more than `MOST`.
    """
    count = FIRST
    while count <= MOST:
        time = np.linspace(start, stop, count + 1)
        values = signal(time)
        spans = _Spans(time[:-1], time[1:], values[:-1], values[1:])
        # changes below rounding are none
        allowed = 0.5 * AGREE * np.ptp(values) + 1e-13 * np.abs(values).max()
        distance = _distance(signal, spans)
        bent = np.flatnonzero(distance > allowed)
        breaks = _jumps(signal, _Spans(*(part[bent] for part in spans)), allowed)
        jumping = np.unique(np.searchsorted(time, breaks) - 1)
        if _straight(distance, jumping, allowed):
            return Sampling(_fewest(values, jumping, allowed), breaks)
        count *= 2
    return None


def known(signal: Signal, duration: float) -> Signal:
    """The signal with the bands and jumps of functions without a band, or with one that does not hold, as a
    history of this duration (s) sees them.

    Raises
    ------
    ValueError
        If a function changes between the most samples that are taken, and has no band that holds.
    """
    if isinstance(signal, Sum):
        return Sum(tuple(known(part, duration) for part in signal.parts))
    if not isinstance(signal, Custom) or _holds(signal, 0.0, duration, np.array(signal.breaks)):
        return signal
    found, given = sampled(signal, 0.0, duration), signal.highest_frequency
    if found is None:
        raise _changing(called("transient"), signal, duration)
    band = max(found.intervals / (STEPS_A_PERIOD * duration), given or 0.0)
    return replace(signal, highest_frequency=band, breaks=tuple(found.breaks.tolist()))


def resolved(signal: Signal, start: float, stop: float, breaks: np.ndarray) -> Sampling | None:
    """What samples tell of a signal with functions in a period; None of one whose band says more than these.

    Parameters
    ----------
    breaks : (k,) array
        Those that the signal says of itself in this span, s.

    Raises
    ------
    ValueError
        If it changes between the most samples that are taken, and has no band that holds.
    """
    found = sampled(signal, start, stop)
    if found is None and not _holds(signal, start, stop, breaks):
        raise _changing(called(), signal, stop - start)
    return found


def _holds(signal: Signal, start: float, stop: float, breaks: np.ndarray) -> bool:
    """Whether a signal is near to the lines between the steps for its band, but for its breaks."""
    if signal.highest_frequency is None:
        return False
    asked = STEPS_A_PERIOD * (stop - start) * signal.highest_frequency
    count = PARTS * math.ceil(min(max(asked, FEWEST), MOST) / PARTS)
    begin = np.linspace(start, stop, count, endpoint=False)
    end = begin + (stop - start) / max(asked, count)  # of more steps than samples only some
    values = signal(np.stack([begin, end]))
    allowed = SLACK * 0.5 * AGREE * np.ptp(values) + 1e-13 * np.abs(values).max()
    distance = _distance(signal, _Spans(begin, end, *values))
    jumping = np.add.outer(np.searchsorted(begin, breaks), [-2, -1, 0]).clip(0, count - 1)
    return _straight(distance, jumping.ravel(), allowed)


def _changing(owner: str, signal: Signal, span: float) -> ValueError:
    """The error of a signal that changes between the most samples of a span of time, s."""
    lacks = "give its highest_frequency"
    if signal.highest_frequency is not None:
        lacks = f"{STEPS_A_PERIOD} in a period of its highest_frequency do not follow it; give the one it has"
    return ValueError(
        f"{owner}: {signal!r} changes between {MOST:,d} samples of {span:g} s; {lacks}, and breaks where it "
        "jumps, or a shorter time"
    )


def _distance(signal: Signal, spans: _Spans) -> np.ndarray:
    """(n,): how far the signal is from the lines between the ends of spans."""
    between = signal(spans.begin + BETWEEN * (spans.end - spans.begin))
    return np.abs(between - spans.first - BETWEEN * (spans.last - spans.first))


def _straight(distance: np.ndarray, jumping: np.ndarray, allowed: float) -> bool:
    """Whether distances from lines, but for spans that jump, are small in the mean over each part."""
    squares = distance**2
    squares[jumping] = 0.0
    return bool(squares.reshape(PARTS, -1).mean(axis=1).max() <= 0.5 * allowed**2)


def _jumps(signal: Signal, spans: _Spans, allowed: float) -> np.ndarray:
    """The first instants behind the jumps in spans, if they are few."""
    found = [np.zeros(0)]
    if len(spans.begin) > JUMPS:
        return found[0]
    for _ in range(WITHIN):
        halved = _halved(signal, spans)
        jumps = np.abs(halved.last - halved.first) > allowed
        found.append(halved.end[jumps])
        # a span may have several
        rest = _Spans(
            np.concatenate([spans.begin[jumps], halved.end[jumps]]),
            np.concatenate([halved.begin[jumps], spans.end[jumps]]),
            np.concatenate([spans.first[jumps], halved.last[jumps]]),
            np.concatenate([halved.first[jumps], spans.last[jumps]]),
        )
        bent = _distance(signal, rest) > allowed
        spans = _Spans(*(part[bent] for part in rest))
    return np.unique(np.concatenate(found))


def _halved(signal: Signal, spans: _Spans) -> _Spans:
    """Neighbouring numbers in the spans: always in the half that changes more."""
    begin, end, first, last = (part.copy() for part in spans)
    for _ in range(HALVINGS):
        middle = 0.5 * (begin + end)
        left = np.flatnonzero((middle > begin) & (middle < end))
        if not len(left):
            break
        values = signal(middle[left])
        later = np.abs(last[left] - values) > np.abs(values - first[left])
        for place, kept, limit, value in ((later, left, begin, first), (~later, left, end, last)):
            limit[kept[place]], value[kept[place]] = middle[kept[place]], values[place]
    return _Spans(begin, end, first, last)


def _fewest(values: np.ndarray, jumping: np.ndarray, allowed: float) -> int:
    """The fewest intervals on whose lines the samples are, but where they jump."""
    count = len(values) - 1
    while count > FEWEST:
        stride = 2 * (len(values) - 1) // count
        first, last = values[:-1:stride, None], values[stride::stride, None]
        distance = np.abs(
            values[:-1].reshape(-1, stride) - first - (last - first) * np.arange(stride) / stride
        )
        distance[jumping // stride] = 0.0
        if not _straight(distance.ravel(), jumping[:0], allowed):
            break
        count //= 2
    return count

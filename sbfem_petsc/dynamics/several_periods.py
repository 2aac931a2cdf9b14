"""Motions of several of the loads' periods: the fewest periods after which one repeats itself, and branches
of them, which begin and end on branches of shorter ones.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..analysis.shooting import DrivenPeriod, Motion, Shot

if TYPE_CHECKING:
    from ..analysis.continuation import Trace

# Change of the state over fewer periods, relative to its size, below which a motion is one of fewer periods.
SAME = 1e-7
# Step along the branch, relative to the state, by which its distance from shorter motions is differentiated.
AHEAD = 1e-4
# A branch that first leads away from its range may do so by this share of the parameter or of the range.
EXCURSION = 0.02


def distances(driven: DrivenPeriod, motion: Motion) -> dict[int, float]:
    """For each number of periods that divides that of the map, and after which the loads repeat: the change
    of the state over so many periods, relative to its size.
    """
    p = driven.period
    periods = p.drive.periods
    size = float(np.linalg.norm(driven.linear_state + _difference(p, motion, 0)))
    result = {}
    for fewer in range(1, periods):
        if periods % fewer or (p.steps * fewer) % periods or (p.drive.orders * fewer % periods).any():
            continue
        k = p.steps * fewer // periods
        # the linear response repeats with the loads
        change = np.linalg.norm(_difference(p, motion, k) - _difference(p, motion, 0))
        result[fewer] = float(change) / max(size, 1e-300)
    return result


def _difference(period, motion: Motion, k: int) -> np.ndarray:
    return np.concatenate([period.weights * motion.states[k], motion.velocities[k]])


def minimal_periods(shot: Shot) -> int:
    """The fewest of the loads' periods after which a motion repeats itself."""
    for fewer, change in distances(shot.driven, shot.motion).items():
        if change < SAME:
            return fewer
    return shot.driven.period.drive.periods


def passes_shorter(one: Shot, other: Shot) -> int:
    """Periods of the shorter motion on which a branch of several has landed, or through which it has passed
    between two points to its own motions begun half a period later; 0 if neither.
    """
    periods = other.driven.period.drive.periods
    fewer = minimal_periods(other)
    if fewer < periods:
        return fewer
    if periods % 2 or periods // 2 not in distances(other.driven, other.motion):
        return 0
    halves = []
    for shot in (one, other):
        p = shot.driven.period
        halves.append(_difference(p, shot.motion, p.steps // 2) - _difference(p, shot.motion, 0))
    return periods // 2 if halves[0] @ halves[1] < 0.0 else 0


def lead_away(trace: Trace) -> None:
    """Let a branch of several periods begin in the direction in which it parts from shorter motions.

    Behind a subcritical period doubling that is away from where the range lies; the branch comes back through
    a fold, so the range is extended on that side.
    """
    first = trace.stations[0]
    before = distances(first.shot.driven, first.shot.motion)
    if not before or minimal_periods(first.shot) < trace.period.drive.periods:
        return
    size, unit = trace._metric()
    heading = trace._heading()
    trace.sign = None
    driven = trace.driven(first.value + AHEAD * unit * heading[-1])
    after = distances(driven, driven.run(first.shot.state + AHEAD * size * heading[:-1]))
    nearest = min(before, key=lambda fewer: before[fewer])
    if after[nearest] >= before[nearest]:
        return
    reach = max(EXCURSION * abs(first.value), trace.range)
    if trace.direction > 0:
        trace.lower = max(trace.lower - reach, 1e-9 * trace.upper)
    else:
        trace.upper += reach
    trace.direction = -trace.direction

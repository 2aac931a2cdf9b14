"""Motions of several of the loads' periods: the fewest periods after which one repeats itself."""

from __future__ import annotations

import numpy as np

from ...motion.period_map import DrivenPeriod, FixedPoint, Period
from ...motion.period_motion import PeriodMotion

# Change of the state over fewer periods, relative to its size, below which a motion is one of fewer periods.
SAME = 1e-7


def distances(driven: DrivenPeriod, motion: PeriodMotion) -> dict[int, float]:
    """For each number of periods that divides that of the map, and after which the loads repeat: the change
    of the state over so many periods, relative to its size.
    """
    p = driven.period
    periods = p.excitation.periods
    begin = driven.linear_state.copy()
    begin[: 2 * p.modes] += _difference(p, motion, 0)
    size = p.size(begin)
    result = {}
    for fewer in range(1, periods):
        if periods % fewer or (p.steps * fewer) % periods or (p.excitation.orders * fewer % periods).any():
            continue
        k = p.steps * fewer // periods
        # the linear response repeats with the loads
        change = np.linalg.norm(_difference(p, motion, k) - _difference(p, motion, 0))
        result[fewer] = float(change) / max(size, 1e-300)
    return result


def _difference(period: Period, motion: PeriodMotion, k: int) -> np.ndarray:
    return np.concatenate([period.weights * motion.states[k], motion.velocities[k]])


def minimal_periods(fixed: FixedPoint) -> int:
    """The fewest of the loads' periods after which a motion repeats itself."""
    for fewer, change in distances(fixed.driven, fixed.motion).items():
        if change < SAME:
            return fewer
    return fixed.driven.period.excitation.periods


def passes_shorter(one: FixedPoint, other: FixedPoint) -> int:
    """Periods of the shorter motion on which a branch of several has landed, or through which it has passed
    between two points to its own motions begun half a period later; 0 if neither.
    """
    periods = other.driven.period.excitation.periods
    fewer = minimal_periods(other)
    if fewer < periods:
        return fewer
    if periods % 2 or periods // 2 not in distances(other.driven, other.motion):
        return 0
    halves = []
    for fixed in (one, other):
        p = fixed.driven.period
        halves.append(_difference(p, fixed.motion, p.steps // 2) - _difference(p, fixed.motion, 0))
    return periods // 2 if halves[0] @ halves[1] < 0.0 else 0

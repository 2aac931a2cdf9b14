"""Fixed points that Newton's method does not find from its first guess."""

from __future__ import annotations

import numpy as np

from ..errors import SolveError, on_all_ranks
from .continuation import Continuation, ContinuationPoint, ParameterRange
from .shooting import FixedPoint, Period, shoot

# Periods of a history after which Newton's method is tried again.
SETTLING = (1, 3, 10, 30)
# Factor on the oscillating loads from which a ramp starts where Newton's method does not converge at full load.
RAMP = 0.02


def steady_state(
    period: Period, frequency: float, guess: np.ndarray, jacobian: str = "auto"
) -> tuple[FixedPoint, str]:
    """A fixed point and how it was reached: "Newton", "history" or "ramp of the load".

    Raises
    ------
    SolveError
        If there is none from the guess, after some periods of a history, or along a ramp of the load.
    """
    try:
        return shoot(period, guess, frequency, jacobian=jacobian), "Newton"
    except SolveError as error:
        if not period.pairs:
            raise
        found = _settled(period, frequency, guess)
        if found is not None:
            return found, "history"
        return _ramped(period, frequency, error), "ramp of the load"


def _settled(period: Period, frequency: float, state: np.ndarray) -> FixedPoint | None:
    """Fixed point from where a history of some periods has brought the state: it forgets what Newton's method
    cannot leave.
    """
    driven, done = period.at(frequency), 0
    for periods in SETTLING:
        try:
            for _ in range(periods - done):
                state = state + driven.run(state).residual
            done = periods
            return shoot(period, state, frequency)
        except SolveError:
            continue
    return None


def _ramped(period: Period, frequency: float, error: SolveError) -> FixedPoint:
    """Fixed point at full load, at the end of a branch from a small one."""
    try:
        first = shoot(period, period.at(frequency, RAMP).linear_state, frequency, RAMP)
    except SolveError:
        raise error from None
    continuation = Continuation(
        period,
        ContinuationPoint(first, RAMP),
        ParameterRange("load", 0.0, 1.0, frequency),
    )
    for point in continuation:
        if point.value >= 1.0:
            # the branch ends at the load itself, not near it
            return shoot(period, point.fixed.state, frequency)
    raise on_all_ranks(
        SolveError(f"{error}; a ramp of the load ended as well: {continuation.reason} of the full load")
    )

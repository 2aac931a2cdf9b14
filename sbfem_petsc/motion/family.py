"""The periods of a reduced model over the forcing frequency and a second parameter."""

from __future__ import annotations

import numpy as np

from .period_map import DrivenPeriod, Period
from .period_motion import PeriodMotion


class Family:
    """The periods of a reduced model over the forcing frequency and a second parameter.

    Parameters
    ----------
    period : Period
    parameter : {"load", "damping", "gap"}
    factor : float
        On the oscillating loads, where the second parameter is another.
    """

    def __init__(self, period: Period, parameter: str, factor: float = 1.0):
        self.period, self.parameter, self.factor = period, parameter, factor

    def at(self, frequency: float, value: float) -> DrivenPeriod:
        """The driven period of both parameters."""
        if self.parameter == "load":
            return self.period.at(frequency, value)
        return self.period.at(frequency, self.factor, **{self.parameter: value})

    def derivative(
        self, driven: DrivenPeriod, motion: PeriodMotion, state: np.ndarray, value: float
    ) -> np.ndarray:
        """dx(T) along x(0), the frequency and the second parameter, (2 m, 2 m + 2)."""
        identity = np.eye(len(state))
        if self.parameter == "load":
            return driven.carried(motion, identity, ("frequency", "load"))
        step = 1e-6 * max(abs(value), 1e-3)
        ahead = self.at(driven.frequency, value + step).run(state)
        behind = self.at(driven.frequency, value - step).run(state)
        rate = (ahead.residual - behind.residual) / (2.0 * step)
        return np.column_stack([driven.carried(motion, identity, ("frequency",)), rate])

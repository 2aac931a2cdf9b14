"""A fixed point of the period of a reduced model (`period_map`)."""

from __future__ import annotations

import functools

import numpy as np

from .period_map import DrivenPeriod, PeriodMotion


class FixedPoint:
    """A fixed point of a period.

    Attributes
    ----------
    state : (2 m,) array
        x(0).
    driven : DrivenPeriod
    motion : PeriodMotion
    residual : (2 m,) array
        x(T) - x(0).
    residuals : tuple of float
        Norm of x(T) - x(0) at each Newton iterate.
    touching : (pairs,) bool array
        Pairs that touch at any time of the period.
    """

    def __init__(
        self,
        state: np.ndarray,
        driven: DrivenPeriod,
        motion: PeriodMotion,
        residuals: tuple[float, ...] = (),
    ):
        self.state, self.residual, self.residuals = state, motion.residual, residuals
        self.touching = (motion.forces != 0.0).any(axis=0)
        self._driven: DrivenPeriod | None = driven
        self._motion: PeriodMotion | None = motion
        self._conditions = driven.period, driven.frequency, driven.factor

    @property
    def driven(self) -> DrivenPeriod:
        """The period at the point's conditions."""
        if self._driven is None:
            period, frequency, factor = self._conditions
            return period.at(frequency, factor)
        return self._driven

    @property
    def motion(self) -> PeriodMotion:
        """One period from the state."""
        return self.driven.run(self.state) if self._motion is None else self._motion

    @functools.cached_property
    def monodromy(self) -> np.ndarray:
        """(2 m, 2 m): dx(T) / dx(0), with switches located inside their steps."""
        return self.driven.monodromy(self.motion)

    def forget(self) -> None:
        """Let go of what takes memory; it is computed again where it is asked for."""
        self._driven = self._motion = None

"""A fixed point of the period of a reduced model (`period_map`)."""

from __future__ import annotations

import functools

import numpy as np

from .period_map import DrivenPeriod, PeriodMotion

# Difference of a parameter by which a motion's rate with it is found, relative to the parameter, and the
# least factor on the loads that it is relative to.
AHEAD, LEAST = 1e-7, 1e-3


class FixedPoint:
    """A fixed point of a period.

    Attributes
    ----------
    state : (2 m,) array
        x(0).
    parameters : (e,) array
        Values of the free parameters.
    driven : DrivenPeriod
    motion : PeriodMotion
    residuals : tuple of float
        Norm of x(T) - x(0), and of the conditions on the parameters, at each Newton iterate.
    derivatives : int
        How many of the iterations had a derivative of their own.
    touching : (pairs,) bool array
        Pairs that touch at any time of the period.
    """

    def __init__(
        self,
        state: np.ndarray,
        parameters: np.ndarray,
        driven: DrivenPeriod,
        motion: PeriodMotion,
        residuals: tuple[float, ...],
        derivatives: int = 0,
    ):
        self.state, self.parameters, self.residuals = state, parameters, residuals
        self.derivatives = derivatives
        self._driven: DrivenPeriod | None = driven
        self._residual, self.touching = motion.residual, (motion.forces > 0.0).any(axis=0)
        self._motion: PeriodMotion | None = motion
        self._conditions = driven.period, driven.frequency, driven.factor
        self._rates: dict[str, np.ndarray] = {}

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

    def derivative(self, name: str) -> np.ndarray:
        """(2 m, 2 m + 1): dx(T) along x(0), the monodromy, and along "frequency" or "load".

        The last column, which points the way along a branch, is a difference of two periods: a third of the
        work of its exact derivative.
        """
        if name not in self._rates:
            period, frequency, factor = self._conditions
            step = AHEAD * (frequency if name == "frequency" else max(abs(factor), LEAST))
            ahead = (frequency + step, factor) if name == "frequency" else (frequency, factor + step)
            change = period.at(*ahead).run(self.state).residual - self._residual
            self._rates[name] = change[:, None] / step
        return np.concatenate([self.monodromy, self._rates[name]], axis=1)

    def forget(self) -> None:
        """Let go of what takes memory; it is computed again where it is asked for."""
        self._driven = self._motion = None

    @property
    def effort(self) -> float:
        """Newton iterations; three with an updated derivative count as one."""
        return effort(len(self.residuals) - 1, self.derivatives)


def effort(iterations: int, derivatives: int) -> float:
    """Newton iterations of which so many had a derivative of their own; the others count as a third."""
    return derivatives + (iterations - derivatives) / 3.0

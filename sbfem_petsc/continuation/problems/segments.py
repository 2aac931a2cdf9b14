"""Multiple shooting: a period in segments, for long periods and motions that are strongly unstable.

The unknowns are the states at the beginning of each segment, so that a disturbance grows over one segment
alone before Newton's method sees it.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ...errors import PetscFailure, SolveError, called, failed_solve
from ...motion.period_map import DrivenPeriod, FixedPoint, Period
from ...motion.period_motion import PeriodMotion
from ...motion.states import ModalStates
from ..harmonic_errors import in_modes
from ..linear import Cyclic
from ..newton import correct
from ..orbit import Orbit, uncertainty_of
from ..problem import Metric, Point
from ..segment_products import product_eigenvalues
from .driven_orbits import DIFFERENCE, Orbits, ParameterRange


class SegmentedOrbits(Orbits):
    """Unknowns are the states at the segments' beginnings, as differences to the linear steady state, and the
    parameter.

    Parameters
    ----------
    period : Period
    parameter : ParameterRange
    count : int
        Segments of equal numbers of steps, of which the period has a multiple of it.
    """

    patience = 5  # where pairs switch, a step may lead up before it leads down

    def __init__(self, period: Period, parameter: ParameterRange, count: int):
        super().__init__(period, parameter)
        self.count, self.short = count, period.of(period.steps // count)

    def at(self, u: np.ndarray) -> Segments:  # type: ignore[override]
        """See `Problem`."""
        return Segments(self, u)

    def units(self, u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """See `Problem`: of the whole motion, not of what is left of it without the linear one, which is
        nothing before contact.
        """
        units, weights = super().units(np.append(np.zeros(2 * self.period.modes), u[-1]))
        whole = self.driven(float(u[-1])).oscillation
        size = max(float(np.linalg.norm(u[:-1])), whole * self.count**0.5, self.least, 1e-300)
        return np.append(np.full(len(u) - 1, size), units[-1]), np.ones(len(u))

    def refuse(self, last: Point, point: Point) -> str:
        """See `Problem`."""
        return super().refuse(_whole(last), _whole(point))

    def finer(self, times: int) -> SegmentedOrbits:
        """See `Problem`."""
        return SegmentedOrbits(self.period.in_steps(times * self.period.steps), self.parameter, self.count)


def _whole(point: Point) -> Point:
    return Point(point.problem, point.u, point.state.joined(), point.value)


class Segments:
    """The motions of all segments from their beginnings."""

    def __init__(self, problem: SegmentedOrbits, u: np.ndarray):
        self.problem, self.value = problem, float(u[-1])
        self.states = u[:-1].reshape(problem.count, -1)
        self.driven = problem.driven(self.value)
        self._residual, self.motions = self._run(self.value)
        self.residual = self._residual.ravel()
        size = max(float(np.linalg.norm(self.driven.linear_state)), float(np.linalg.norm(u[:-1])), 1e-300)
        self.scale = size * problem.count**0.5

    def _run(self, value: float) -> tuple[np.ndarray, list[PeriodMotion]]:
        """(count, 2 m): how far each segment's end is from the next one's beginning, and the motions."""
        motions = [part.run(state) for part, state in zip(self._parts(value), self.states)]
        ends = self.states + np.array([motion.residual for motion in motions])
        return ends - np.roll(self.states, -1, axis=0), motions

    def _parts(self, value: float) -> list[DrivenPeriod]:
        driven, short = self.problem.driven(value), self.problem.short
        return [driven.part(short, k * short.steps) for k in range(self.problem.count)]

    @property
    def touching(self) -> np.ndarray:
        """(pairs,) bool: pairs that touch at any time of the period."""
        return np.any([(motion.forces != 0.0).any(axis=0) for motion in self.motions], axis=0)

    def derivatives(self, located: bool) -> np.ndarray:
        """(count, 2 m, 2 m): dx(end) / dx(begin) of each segment."""
        unit = np.eye(self.states.shape[1])
        return np.array(
            [
                part.carried(motion, unit, located=located)
                for part, motion in zip(self._parts(self.value), self.motions)
            ]
        )

    def linear(self, smooth: bool = False) -> Cyclic:
        """See `problem.State`."""
        step = DIFFERENCE * max(abs(self.value), self.problem.smallest)
        column = (self._run(self.value + step)[0] - self._residual) / step
        return Cyclic(self.derivatives(smooth), column)

    def forget(self) -> None:
        """See `problem.State`."""

    def joined(self, residuals: tuple[float, ...] = ()) -> FixedPoint:
        """The motion of all segments as one period's."""

        def whole(name: str) -> np.ndarray:
            parts = [getattr(motion, name) for motion in self.motions]
            return np.concatenate([part[:-1] for part in parts] + [parts[-1][-1:]])

        residual = self.states[-1] + self.motions[-1].residual - self.states[0]
        work = np.concatenate([motion.work for motion in self.motions])
        motion = PeriodMotion(residual, whole("states"), whole("velocities"), whole("forces"), work)
        return FixedPoint(self.states[0] + self.driven.linear_state, self.driven, motion, residuals)


def at_segments(guess: Orbit, period: Period, frequency: float, segments: int) -> np.ndarray:
    """(segments, 2 m): a motion at the segments' beginnings, in differences to the linear response; one under
    a multiple of the frequency is repeated as often as it takes, and further modes are as without contact.
    """
    driven = period.at(frequency)
    instants = np.arange(segments) * (period.steps // segments)
    # in forcing periods: motions under neighbouring frequencies keep their phase
    times = max(1, round(guess.frequency / frequency))
    places = times * instants * period.excitation.periods / period.steps / guess.periods * len(guess.time)
    assert isinstance(guess.states, ModalStates)  # of the same model
    own = guess.states.reduced
    states = in_modes(np.concatenate([guess.states.q, guess.states.v], axis=1), own, period.reduced)
    states[:, : period.modes] *= period.weights
    before = np.floor(places + 1e-9).astype(int)
    share = (places - before)[:, None]
    states = (1.0 - share) * states[before % len(states)] + share * states[(before + 1) % len(states)]
    q, v = (
        period.over_time(part)[instants] for part in (driven.amplitudes, driven.speeds * driven.amplitudes)
    )
    linear = np.concatenate([period.weights * q, v], axis=1)
    known = np.arange(period.modes) < len(own.omega)
    return np.where(np.tile(known, 2), states - linear, 0.0)


def shoot_segments(
    period: Period, frequency: float, count: int, states: np.ndarray | None = None
) -> tuple[FixedPoint, Segments]:
    """A periodic motion by multiple shooting, whole and in its segments.

    Parameters
    ----------
    period : Period
    frequency : float
        Hz.
    count : int
        Segments.
    states : (count, 2 m) array, optional
        First guess, differences to the linear steady state. Default: none.

    Raises
    ------
    SolveError
        If Newton's method does not converge.
    """
    orbits = SegmentedOrbits(period, ParameterRange("frequency", frequency, frequency), count)
    orbits.settled = orbits.closed  # to rounding, as steady states are found
    guess = np.zeros((count, 2 * period.modes)) if states is None else states
    u = np.append(guess.ravel(), frequency)
    try:
        point = correct(orbits, u, Metric(orbits, u).level(u, frequency))
    except PetscFailure:
        raise
    except SolveError as error:
        raise failed_solve(
            f"{called()}: over {count} segments {error}; start from a neighbour, or take more segments "
            "or steps"
        ) from None
    return point.state.joined(tuple(point.state.scale * missed for missed in point.residuals)), point.state


def segmented_stability(segments: Segments) -> tuple[np.ndarray, Callable[[], float]]:
    """Multipliers of a motion, as the eigenvalues of the product of its segments' derivatives, and what
    computes the uncertainty of the largest modulus, by the same motion in twice the steps.
    """
    values = product_eigenvalues(segments.derivatives(located=True))
    frequency, period = segments.value, segments.problem.period
    begins = [
        np.append(period.weights * motion.states[0], motion.velocities[0]) for motion in segments.motions
    ]

    def error() -> float:
        finer = period.in_steps(2 * period.steps)
        try:
            _, other = shoot_segments(finer, frequency, len(begins), np.array(begins))
        except SolveError:
            return np.nan
        return uncertainty_of(abs(values[0]) - abs(product_eigenvalues(other.derivatives(located=True))[0]))

    return values, error

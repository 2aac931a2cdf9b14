"""Periodic motions under loads, x(T) - x(0) = 0, over their frequency, a factor on what oscillates, on the
damping or on the gaps.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...motion.contact_work import contact_work
from ...motion.factors import FACTORS, WORDS
from ...motion.period_map import DrivenPeriod, FixedPoint, Period
from ...motion.period_motion import PeriodMotion
from ...motion.steps import free_motion
from ...record.record import Record, described, quantity
from ...reduction.build import in_further_modes
from ...reduction.reduced_model import ReducedModel, held_in
from ..harmonic_errors import beyond, carried_derivative, in_modes, in_more_modes, seen
from ..linear import Dense
from ..multipliers import Multipliers, multipliers_of
from ..newton import attempt
from ..problem import FINER_GAIN, Lost, Point, Problem, Range

# Arc length in which the state's relative change and SPAN times the parameter's change, as a share of its
# range, are summed as squares.
SPAN = 10.0
# Difference of a parameter by which a motion's rate with it is found, relative to the parameter, and the
# least factor that it is relative to.
DIFFERENCE, LEAST = 1e-7, 1e-3
# Of the linear motion at the ends of the range: where a branch starts from rest its state has no size of its
# own.
REST = 1e-3
# Pairs of which it is known how often each meets.
FEW = 8
# Change of the state over fewer periods, relative to its size, below which a motion is one of fewer periods.
SAME = 1e-7


@dataclass(frozen=True)
class ParameterRange:
    """The parameter of a branch and where it goes: what a user names, whatever the family.

    Attributes
    ----------
    name : {"frequency", "load", "damping", "gap"}
        Forcing frequency (Hz), or factor on the oscillating loads, the damping or the initial gaps.
    start, stop : float
    frequency : float or None
        Hz, where the frequency is not the parameter.
    """

    name: str
    start: float
    stop: float
    frequency: float | None = None

    @property
    def range(self) -> Range:
        """From `start` towards `stop`."""
        ends = sorted((self.start, self.stop))
        return Range(ends[0], ends[1], 1 if self.stop > self.start else -1)

    @property
    def owner(self) -> str:
        """The analysis that follows motions over it, for messages."""
        return f"{'frequency' if self.name == 'frequency' else 'load'}_response"

    def reached(self, value: float) -> bool:
        """Whether a value is at `stop` or beyond it."""
        return value >= self.stop if self.stop > self.start else value <= self.stop

    def at(self, period: Any, value: float) -> Any:
        """The driven period of a value of the parameter, of a `Period` or an `UnreducedPeriod`."""
        if value < 0.0 or value == 0.0 and self.name == "frequency":
            raise Lost(f"the {self.name} has become {value:.6g}")
        if self.frequency is None:
            return period.at(value)
        return period.at(self.frequency, **{self.name: value})


@described
class OverParameter(Record):
    """A result over a parameter."""

    parameter: str = quantity(text="what it is over", one_of=("frequency", *FACTORS))
    value: np.ndarray = quantity(
        "Hz or 1",
        f"forcing frequency, or factor on {WORDS}",
        "point",
        least=0.0,
        unit_of=lambda branch: "Hz" if branch.parameter == "frequency" else "1",
    )

    def __len__(self) -> int:
        return len(self.value)


class Family:
    """The periods of a reduced model over the forcing frequency and a second parameter.

    Parameters
    ----------
    period : Period
    parameter : {"load", "damping", "gap"}
    factor : float
        On the oscillating loads, where the second parameter is another.
    """

    def __init__(self, period: Period, parameter: str, factor: float):
        self.period, self.parameter, self.factor = period, parameter, factor

    def at(self, frequency: float, value: float) -> DrivenPeriod:
        """The driven period of both parameters."""
        return self.period.at(frequency, **{"load": self.factor, self.parameter: value})

    def derivative(
        self, driven: DrivenPeriod, motion: PeriodMotion, state: np.ndarray, value: float
    ) -> np.ndarray:
        """dx(T) along x(0), the frequency and the second parameter, (2 m, 2 m + 2)."""
        frequency, steps = driven.frequency, DIFFERENCE * np.array([driven.frequency, max(abs(value), LEAST)])
        ahead = self.at(frequency + steps[0], value), self.at(frequency, value + steps[1])
        rates = [(other.run(state).residual - motion.residual) / step for other, step in zip(ahead, steps)]
        return np.column_stack([driven.carried(motion, np.eye(len(state))), *rates])


class OpenRowFamily(Family):
    """The periods of a reduced model without one of its contact rows, whose gap is watched: where the row
    begins to touch, its least gap over the period passes through zero smoothly.

    Parameters
    ----------
    period : Period
        Of the whole model.
    row : int
    parameter, factor
        See `Family`.
    """

    def __init__(self, period: Period, row: int, parameter: str, factor: float = 1.0):
        others = np.delete(np.arange(len(period.reduced.initial_gap)), row)
        reduced = held_in(period.reduced, others)
        super().__init__(Period(reduced, period.excitation, period.steps), parameter, factor)
        self.whole, self.row = period, row
        gap = period.reduced.gap
        self._modes, self._loads = gap.modes[row], gap.loads[row]
        self._contact = np.delete(gap.contact[row], row)

    def gap(self, driven: DrivenPeriod, motion: PeriodMotion, value: float) -> np.ndarray:
        """(n + 1,): how far the row is from being held over the period, m."""
        p, factor = driven.period, value if self.parameter == "gap" else 1.0
        linear = p.over_time(driven.amplitudes @ self._modes) + driven.loads @ self._loads
        shut = motion.states @ self._modes + motion.forces @ self._contact
        gap = linear + shut + factor * float(self.whole.reduced.initial_gap[self.row])
        return self.whole.laws.room(gap, self.row)


def least(values: np.ndarray) -> float:
    """Minimum of equal samples of a period, between them by the parabola through the lowest three."""
    k = int(np.argmin(values))
    before, middle, after = values[k - 1], values[k], values[(k + 1) % len(values)]
    bend = before - 2.0 * middle + after
    return float(middle - 0.125 * (after - before) ** 2 / bend) if bend > 0.0 else float(middle)


class Orbits(Problem):
    """Unknowns are x(0) and the parameter.

    Parameters
    ----------
    period : Period
    parameter : ParameterRange
    """

    closed, settled, corners = 1e-12, 1e-9, True
    isolated = (
        "motions of one period are not isolated at {:.8g}, as those of a body without supports or of a "
        "system without damping; hold it, give it damping, or begin elsewhere"
    )
    advice = "take more steps a period"

    def __init__(self, period: Period, parameter: ParameterRange):
        self.period, self.parameter = period, parameter
        self.map = period  # whose fixed points the motions are
        if not period.reduced.damping.any() and parameter.name != "damping":
            self.advice = (
                "without damping motions grow without bound at a resonance and high modes never settle: give "
                "the body some (damping=0.001), or end the range before"
            )
        self.extent = parameter.range.extent
        self.smallest = 0.0 if parameter.name == "frequency" else LEAST
        ends = (self.driven(value) for value in (parameter.start, parameter.stop))
        self.least = REST * max(end.oscillation for end in ends)
        # the fewest forcing periods after which the first motion repeats itself; a branch of several has
        # ended where it meets one of fewer
        self.periods: int | None = None
        self._finer: dict[int, Orbits] = {}
        self._wider: dict[int, WiderOrbits | None] = {}

    def driven(self, value: float) -> DrivenPeriod:
        """The driven period of a value of the parameter."""
        found: DrivenPeriod = self.parameter.at(self.period, value)
        return found

    def at(self, u: np.ndarray) -> OrbitState:
        """See `Problem`."""
        return OrbitState(self, u)

    def units(self, u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """See `Problem`."""
        size = max(self.period.size(u[:-1]), self.least, 1e-300)
        unit = self.extent / SPAN or max(abs(float(u[-1])), LEAST)
        return np.append(np.full(len(u) - 1, size), unit), np.ones(len(u))

    def refuse(self, last: Point, point: Point) -> str:
        """See `Problem`: motions of fewer periods are of another branch."""
        if self.periods is None:
            self.periods = minimal_periods(last.state)
        fewer = passes_shorter(last.state, point.state) if self.periods > 1 else 0
        if not fewer:
            return ""
        return f"the branch of {self.periods} periods falls onto a motion of {fewer} at {point.value:.8g}"

    def finer(self, times: int) -> Orbits:
        """See `Problem`."""
        if times not in self._finer:
            self._finer[times] = Orbits(self.period.in_steps(times * self.period.steps), self.parameter)
            self._finer[times].gain = FINER_GAIN
        return self._finer[times]

    def wider(self, times: int) -> WiderOrbits | None:
        """See `Problem`. Raises `Lost` where there is no room for them."""
        if times not in self._wider:
            more = in_further_modes(self.period.reduced)
            if more is self.period.reduced:
                more = None
            self._wider[times] = None if more is None else WiderOrbits(self, more, times)
        return self._wider[times]


class WiderOrbits:
    """Motions in more modes, for what those that are left out do.

    Attributes
    ----------
    problem : Orbits
    factor : float
        Of a change in these modes, what it tells of the error; inf where they have no part in the motion.
    """

    def __init__(self, orbits: Orbits, more: ReducedModel, times: int):
        own = orbits.period.reduced
        wide = attempt(lambda: in_more_modes(orbits.period, more, times * orbits.period.steps), ValueError)
        if wide is None:
            raise Lost("there is no memory for more modes")
        self.own, self.problem = orbits, Orbits(wide, orbits.parameter)
        self.problem.gain = FINER_GAIN
        self.factor = beyond(own, more)

    def moved(self, point: Point) -> Point:
        """A point in as many steps, or fewer, in these modes; it is no solution."""
        u, value = point.u, float(point.u[-1])
        old, new = self.own.driven(value), self.problem.driven(value)
        added = in_modes(u[:-1] - old.linear_state, old.period.reduced, new.period.reduced)
        u = np.append(new.linear_state + added, value)
        return Point(self.problem, u, None, point.value, leapt=point.leapt)

    def begun(self, point: Point) -> Point:
        """The same with about the linearised equations there."""
        found = self.moved(point)
        state = found.state = self.problem.at(found.u)
        state.begin(carried_derivative(point.state, state.driven, state.state))
        return found

    def free(self, value: float, place: float) -> float:
        """Product of the distances of the multipliers of the further modes' free motions from a place on the
        real axis, at a value.
        """
        own, wide = self.own.period.reduced, self.problem.period.reduced
        first, duration = own.natural, self.problem.driven(value).duration

        def determinant(r: ReducedModel) -> float:
            modes = r.omega[first:], r.damping[first:]
            motion = free_motion(modes, duration, modes[0], 2 * len(modes[0]))
            return float(np.linalg.det(motion - place * np.eye(len(motion))))

        return determinant(wide) / determinant(own)


class OrbitState(FixedPoint):
    """A motion over one period, periodic or not; what of it takes memory is computed again where it is asked
    for after `forget`.
    """

    def __init__(self, problem: Orbits, u: np.ndarray):
        self.problem, self.value = problem, float(u[-1])
        driven = problem.driven(self.value)
        super().__init__(u[:-1], driven, driven.run(u[:-1]))
        self.scale = max(
            float(np.linalg.norm(driven.linear_state)), float(np.linalg.norm(self.state)), 1e-300
        )

    @functools.cached_property
    def driven(self) -> DrivenPeriod:  # type: ignore[override]
        """The period at the motion's conditions."""
        return self.problem.driven(self.value)

    @functools.cached_property
    def motion(self) -> PeriodMotion:  # type: ignore[override]
        """One period from the state."""
        return self.driven.run(self.state)

    @functools.cached_property
    def multipliers(self) -> Multipliers:
        """Of the monodromy."""
        return multipliers_of(self)

    @functools.cached_property
    def meetings(self) -> np.ndarray:
        """(pairs,): how often each of few pairs begins to touch in a period; (0,) where there are many."""
        if self.driven.period.pairs > FEW:
            return np.zeros(0, dtype=int)
        touching = self.motion.forces != 0.0
        return np.asarray((touching[1:] & ~touching[:-1]).sum(axis=0))

    def forget(self) -> None:
        """See `problem.State`; how often pairs meet stays known."""
        vars(self)["meetings"] = self.meetings
        for name in ("driven", "motion", "_smooth"):
            self.__dict__.pop(name, None)

    @functools.cached_property
    def contact_work(self) -> float:
        """That of contact in the steps, see `motion.contact_work`."""
        return contact_work(self.driven, self.motion)

    def seen(self) -> tuple[np.ndarray, np.ndarray]:
        """Displacements of the named points and the contact resultant, see `harmonic_errors.seen`."""
        return seen(self)

    @functools.cached_property
    def rate(self) -> np.ndarray:
        """dx(T) along the parameter, (2 m,), as a difference of two periods."""
        step = DIFFERENCE * max(abs(self.value), self.problem.smallest)
        return (self.problem.driven(self.value + step).run(self.state).residual - self.residual) / step

    def linear(self, smooth: bool = False) -> Dense:
        """See `problem.State`."""
        if smooth:
            return self._smooth
        along = self.driven.carried(self.motion, np.eye(len(self.state)), rough=True)
        return self._less_start(np.column_stack([along, self.rate]))

    def begin(self, derivative: np.ndarray) -> None:
        """Take dx(T) / dx(0) to be about this, for smooth linearised equations to begin with."""
        self._smooth = self._less_start(np.column_stack([derivative, self.rate]))

    @functools.cached_property
    def _smooth(self) -> Dense:
        return self._less_start(np.column_stack([self.monodromy, self.rate]))

    @staticmethod
    def _less_start(matrix: np.ndarray) -> Dense:
        """Of x(T) - x(0), by that of x(T)."""
        matrix[:, :-1] -= np.eye(len(matrix))
        return Dense(matrix)


# ---------------------------------------------------------------------- motions of several periods
def distances(driven: DrivenPeriod, motion: PeriodMotion) -> dict[int, float]:
    """For each number of periods that divides that of the map, and after which the loads repeat: the change
    of the state over so many periods, relative to its size.
    """
    p = driven.period
    periods = p.excitation.periods
    begin = driven.linear_state.copy()
    begin[: 2 * p.modes] += np.concatenate([p.weights * motion.states[0], motion.velocities[0]])
    size = p.size(begin)
    result = {}
    for fewer in range(1, periods):
        if periods % fewer or (p.steps * fewer) % periods or (p.excitation.orders * fewer % periods).any():
            continue
        change = np.linalg.norm(_change(p, motion, p.steps * fewer // periods))
        result[fewer] = float(change) / max(size, 1e-300)
    return result


def _change(period: Period, motion: PeriodMotion, k: int) -> np.ndarray:
    """Of the state to the k-th instant, after which the loads repeat, and the linear response with them."""
    moved = period.weights * (motion.states[k] - motion.states[0])
    return np.concatenate([moved, motion.velocities[k] - motion.velocities[0]])


def minimal_periods(fixed: FixedPoint) -> int:
    """The fewest of the loads' periods after which a motion repeats itself."""
    repeats = (fewer for fewer, change in distances(fixed.driven, fixed.motion).items() if change < SAME)
    return next(repeats, fixed.driven.period.excitation.periods)


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
    p = other.driven.period
    before, behind = (_change(p, fixed.motion, p.steps // 2) for fixed in (one, other))
    return periods // 2 if before @ behind < 0.0 else 0

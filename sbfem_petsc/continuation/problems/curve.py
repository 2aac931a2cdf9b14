"""Invariant curves of the map over a period of the loads, as a family of solutions.

At multiples of the period the state runs round a closed curve z(theta), which the map takes to itself:
P_theta(z(theta)) = z(theta + rho). Unknowns are its samples at N phases, between which it is its
trigonometric interpolant; a shift by rho multiplies the k-th harmonic by exp(2 pi i k rho).

Of a motion with a tone of its own, which leaves a branch of periodic motions at a Neimark-Sacker point, the
rotation rho and the parameter are unknown too, and the curve may begin anywhere: its phase is that of the
curve before it.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ...errors import PetscFailure, SolveError
from ...motion.period_map import DrivenPeriod, Period, PeriodMotion
from ...petsc import MPI
from ..bifurcations import Bifurcation
from ..newton import correct
from ..problem import BaseProblem, Linear, Lost, Metric, Point
from .curve_system import (
    Border,
    CurveMaps,
    CurveSystem,
    Harmonics,
    filtered,
    require_room,
    resampled,
    shift,
    tangents,
)

# The linear systems: relative residual.
LINEAR = 1e-8
# A curve is resolved by its samples if no more than this share of it is in the highest quarter of their
# harmonics: docs/quasi_periodic.md has what lines and own tones were off by below and above it.
RESOLVED = 0.01
# Of the states, harmonics that are rounding.
ROUNDING = 1e-9
# Phases at which a curve is looked for, in distances of its samples.
PHASES = (0.0, 0.5, 0.25, 0.75)
# The parameter's unit is this share of its value; its difference by which the map's rate with it is found.
UNIT, AHEAD = 0.1, 1e-7
# Samples are doubled so many times at most where they do not resolve the curve, if Newton's method then takes
# no more than so many iterations.
DOUBLINGS, EASE = 2, 10
# Shares of Newton's steps along a branch: where curves have kinks shorter ones lead nowhere.
SHARES = (1.0, 0.5)
# Of the swing of the curve before: a curve that is none any more.
SHRUNK = 0.1


def spectral_tail(states: np.ndarray) -> float:
    """Share of a curve's way from its mean that is in the highest quarter of the harmonics of its samples, as
    a ratio of root mean squares: 0 for a curve of low harmonics, 1 for one of the highest alone.

    Parameters
    ----------
    states : (N, 2 m) array
        (Omega q, q'), whose square is twice the energy.
    """
    size = np.linalg.norm(np.fft.rfft(states, axis=0)[1:], axis=1)
    whole = float(np.linalg.norm(size))
    if whole <= ROUNDING * np.linalg.norm(states) * math.sqrt(len(states)):
        return 0.0
    return float(np.linalg.norm(size[-math.ceil(len(size) / 4) :])) / whole


class InvariantCurves(BaseProblem):
    """What curves of any kind have in common: each of N samples has a map, `at_sample(value)(i)`.

    Attributes
    ----------
    period : Period
    samples : int
    comm : MPI.Comm
        Ranks that share the samples: each takes those from its own number on in steps of their count.
    unit : float
        Of all samples.
    phase : (N 2 m + 2,) array or None
        The condition on where a curve begins, where it may begin anywhere.
    """

    period: Period
    samples: int
    comm: MPI.Comm
    unit: float
    phase: np.ndarray | None = None
    _units: np.ndarray

    def split(self, u: np.ndarray) -> tuple[np.ndarray, float, float]:
        """Samples (N, 2 m), rotation and value."""
        raise NotImplementedError

    def at_sample(self, value: float) -> Callable[[int], DrivenPeriod]:
        """The map of a sample's index."""
        raise NotImplementedError

    def at(self, u: np.ndarray) -> CurveState:
        """See `Problem`."""
        return CurveState(self, u)

    def value(self, u: np.ndarray) -> tuple[float, np.ndarray]:
        """See `Problem`."""
        return float(u[-1]), np.eye(1, len(u), len(u) - 1)[0]

    def units(self, u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """See `Problem`."""
        return self._units, np.ones(len(u))

    def placed(self, u: np.ndarray, value: float) -> np.ndarray:
        """See `Problem`."""
        return np.append(u[:-1], value)

    def off_phase(self, u: np.ndarray) -> float:
        """What curves are in phase where it vanishes."""
        raise NotImplementedError

    def images(self, states: np.ndarray, value: float) -> tuple[np.ndarray, list[PeriodMotion | None]]:
        """(N, 2 m): where the maps take samples, and the motions of this rank's. Collective.

        Raises
        ------
        SolveError
            On all ranks, where one of the maps fails.
        """
        comm, driven = self.comm, self.at_sample(value)
        ends = np.zeros_like(states)
        motions: list[PeriodMotion | None] = [None] * len(states)
        failed = None
        for i in range(comm.rank, len(states), comm.size):
            try:
                motion = driven(i).run(states[i])
            except SolveError as error:
                failed = error
                break
            motions[i], ends[i] = motion, states[i] + motion.residual
        failures = [item for item in comm.allgather(failed) if item is not None]
        if failures:
            raise failures[0]
        comm.Allreduce(MPI.IN_PLACE, ends)
        return ends, motions


class CurveState:
    """The equations at some unknowns; what takes memory is made where it is asked for.

    Attributes
    ----------
    states : (N, 2 m) array
    rotation : float
        Turns in one application of the map.
    value : float
    told : array or None
        What a result says of the curve beside its unknowns, as numbers for a file.
    """

    told: np.ndarray | None = None

    def __init__(self, problem: InvariantCurves, u: np.ndarray):
        self.problem, self.u, self.scale = problem, u, problem.unit
        self.states, self.rotation, self.value = problem.split(u)
        self._missed: np.ndarray | None = None
        self.finer: Point | None = None
        self.forget()

    def forget(self) -> None:
        """See `problem.State`."""
        self._run: tuple[np.ndarray, list[PeriodMotion | None]] | None = None
        self._smooth: tuple[Harmonics, np.ndarray] | None = None

    def in_phase_of(self, problem: InvariantCurves) -> CurveState:
        """The same under another condition on its phase."""
        result = copy.copy(self)
        result.problem, result.scale = problem, problem.unit
        return result

    @property
    def rows(self) -> int:
        """Equations."""
        return len(self.u) - 1

    @property
    def ends(self) -> np.ndarray:
        """(N, 2 m): where the map takes the samples."""
        return self._images()[0]

    @property
    def motions(self) -> list[PeriodMotion | None]:
        """Over the period from each sample; None for those of other ranks."""
        return self._images()[1]

    def _images(self) -> tuple[np.ndarray, list[PeriodMotion | None]]:
        if self._run is None:
            self._run = self.problem.images(self.states, self.value)
        return self._run

    @property
    def residual(self) -> np.ndarray:
        """See `problem.State`: how far the curve misses itself, and its phase."""
        if self._missed is None:
            shifted = filtered(self.states, shift(len(self.states), self.rotation))
            self._missed = (self.ends - shifted).ravel()
        phase = self.problem.phase
        return self._missed if phase is None else np.append(self._missed, self.problem.off_phase(self.u))

    @property
    def swing(self) -> float:
        """Root mean square distance of the curve from its middle."""
        return float(np.linalg.norm(self.states - self.states.mean(axis=0))) / math.sqrt(len(self.states))

    @property
    def resolved(self) -> bool:
        """Whether the samples resolve the curve."""
        return spectral_tail(self.states) <= RESOLVED

    def maps(self, smooth: bool) -> CurveMaps:
        """Derivatives along the state: of the steps, or with switches located inside them."""
        problem, driven = self.problem, self.problem.at_sample(self.value)
        mine, size = range(problem.comm.rank, len(self.states), problem.comm.size), self.states.shape[1]
        found, unit = np.empty((len(mine), size, size)), np.eye(size)
        for place, i in enumerate(mine):
            motion = self.motions[i]
            assert motion is not None  # this rank's
            found[place] = driven(i).carried(motion, unit, located=smooth)
        return CurveMaps(problem.comm, len(self.states), found)

    def linear(self, smooth: bool = False) -> CurveLinear:
        """See `problem.State`: made where it is used."""
        return CurveLinear(self, smooth)

    def linearised(self, smooth: bool) -> tuple[Harmonics, np.ndarray]:
        """The preconditioner with the maps that it is made of, and the equations' derivatives along rotation
        and value, (2, N 2 m), where they are unknown; the smooth ones are kept.
        """
        if smooth and self._smooth is not None:
            return self._smooth
        bordered = self.problem.phase is not None
        harmonics = Harmonics(self.maps(smooth), shift(len(self.states), self.rotation), bordered)
        columns = [-tangents(self.states, self.rotation).ravel(), self._rate().ravel()] if bordered else []
        made = harmonics, np.array(columns)
        if smooth:
            self._smooth = made
        return made

    def _rate(self) -> np.ndarray:
        """(N, 2 m): derivative of the images along the value, by differences."""
        ahead = AHEAD * abs(self.value)
        return (self.problem.images(self.states, self.value + ahead)[0] - self.ends) / ahead


class CurveLinear:
    """The linearised equations. They have no sum with those of other curves, whose derivatives are as dear as
    their own.
    """

    def __init__(self, state: CurveState, smooth: bool):
        self.state, self.smooth, self.rows = state, smooth, state.rows

    def mixed(self, others: Sequence[Linear], weights: Sequence[float]) -> None:
        """See `problem.Linear`."""
        return None

    def bordered(self, row: np.ndarray) -> CurveBorder:
        """See `problem.Linear`."""
        return CurveBorder(self.state, *self.state.linearised(self.smooth), row)


class CurveBorder:
    """By KSP, in units. Where the rotation is known the value is held: the border is its row alone."""

    sign: float | None = None

    def __init__(self, state: CurveState, harmonics: Harmonics, columns: np.ndarray, row: np.ndarray):
        problem, border = state.problem, None
        self.units, self.unit = problem.units(state.u)[0], problem.unit
        scaled = row * self.units
        self.size = float(np.linalg.norm(scaled))
        if problem.phase is not None:
            scales = self.units[-2:, None] / self.unit
            border = Border(columns * scales, np.array([problem.phase, scaled / self.size]))
        self.held = border is None
        self.system = CurveSystem(harmonics, border)

    def solve(self, right: np.ndarray) -> np.ndarray:
        """See `problem.Border`."""
        right = np.append(right[:-1] / self.unit, right[-1] / self.size)
        if self.held:
            return self.units * np.append(self.system.solve(right[:-1], LINEAR), right[-1])
        return self.units * self.system.solve(right, LINEAR)


# ---------------------------------------------------------------------- with a tone of its own
@dataclass(frozen=True, eq=False)
class OwnTone:
    """The map of one period of the loads, over a parameter, at N points of a curve.

    Attributes
    ----------
    period : Period
    parameter : {"frequency", "load", "damping", "gap"}
    frequency : float or None
        Forcing frequency, Hz, where another one is the parameter.
    samples : int
        Odd.
    comm : MPI.Comm
        Ranks that share the samples.
    load, damping, gap : float
        Factors on the oscillating loads, the damping ratios and the initial gaps, where they are not the
        parameter.
    """

    period: Period
    parameter: str
    frequency: float | None
    samples: int
    comm: MPI.Comm
    load: float = 1.0
    damping: float = 1.0
    gap: float = 1.0

    def at(self, value: float) -> OwnTone:
        """With the parameter at a value; the frequency stays None where it is the parameter."""
        known: Any = {} if self.parameter == "frequency" else {self.parameter: value}
        return replace(self, **known)

    def over(self, parameter: str, value: float) -> tuple[OwnTone, float]:
        """The same map over another parameter, where this one has a value, and that of the other one."""
        if parameter == self.parameter:
            return self, value
        frequency = self.frequency or value
        if parameter == "frequency":
            return replace(self.at(value), parameter=parameter, frequency=None), frequency
        other = replace(self.at(value), parameter=parameter, frequency=frequency)
        return other, getattr(other, parameter)

    def driven(self, value: float) -> DrivenPeriod:
        """The map at a value of the parameter."""
        if not value > 0.0:
            raise Lost(f"the {self.parameter} has become {value:.6g}")
        own = self.at(value)
        frequency = value if own.frequency is None else own.frequency
        return own.period.at(frequency, own.load, damping=own.damping, gap=own.gap)

    def resampled(self, states: np.ndarray) -> np.ndarray:
        """A curve of another odd number of samples at this one's phases."""
        return resampled(states, self.samples)

    def require_room(self, owner: str) -> None:
        """Refuse a curve that would take more memory than is free. Collective."""
        orders, steps = len(self.period.excitation.orders), self.period.steps
        require_room(owner, self.period.reduced, self.comm, samples=self.samples, steps=steps, orders=orders)

    def finer(self, owner: str) -> list[OwnTone]:
        """The map with twice and four times as many samples, where there is memory for them. Collective."""
        found = [self]
        for _ in range(DOUBLINGS):
            more = replace(found[-1], samples=2 * found[-1].samples - 1)
            try:
                more.require_room(owner)
            except ValueError:
                break
            found.append(more)
        return found[1:]


class Curves(InvariantCurves):
    """u = (samples of the state, rotation, value), in the phase of one of them.

    Parameters
    ----------
    own : OwnTone
    u : (N 2 m + 2,) array
        The curve whose phase the others take, and units.
    finer : sequence of OwnTone
        With more and more samples; where those of one do not resolve the curve the next are taken.
    begins : (N 2 m + 2,) array, optional
        See `Problem`.
    """

    # steps that miss more lead across kinks
    closed, patience, gain = 1e-10, 3, 0.1
    isolated = "invariant curves are not isolated at {:.8g}"
    advice = "the tone locks, or more samples or steps are needed"

    def __init__(
        self, own: OwnTone, u: np.ndarray, finer: Sequence[OwnTone] = (), begins: np.ndarray | None = None
    ):
        self.tone, self.finer_maps, self.begins = own, tuple(finer), begins
        self.period, self.samples, self.comm = own.period, own.samples, own.comm
        states, _, value = self.split(u)
        self.unit = max(float(np.linalg.norm(states - self.period.rest)), 1e-300)
        self._units = np.append(np.full(states.size, self.unit), [1.0, UNIT * abs(value)])
        along = tangents(states).ravel()
        self.phase = np.append(along / max(float(np.linalg.norm(along)), 1e-300), [0.0, 0.0])
        self._begin = float(self.phase @ u)

    def split(self, u: np.ndarray) -> tuple[np.ndarray, float, float]:
        """See `InvariantCurves`."""
        return u[:-2].reshape(self.samples, -1), float(u[-2]), float(u[-1])

    def at_sample(self, value: float) -> Callable[[int], DrivenPeriod]:
        """See `InvariantCurves`: the same for all."""
        driven = self.tone.driven(value)
        return lambda i: driven

    def off_phase(self, u: np.ndarray) -> float:
        """See `InvariantCurves`."""
        return float(self.phase @ u) - self._begin

    def growing(self, u: np.ndarray) -> np.ndarray:
        """Direction in which a curve grows."""
        states = self.split(u)[0]
        outwards = np.append((states - states.mean(axis=0)).ravel(), [0.0, 0.0])
        return outwards / np.linalg.norm(outwards)

    def refuse(self, last: Point, point: Point) -> str:
        """See `Problem`: a periodic motion is an invariant curve as well, and so is one that has passed it,
        begun half a turn later.
        """
        one, other = last.state, point.state
        swings = (one.states - one.states.mean(axis=0)) * (other.states - other.states.mean(axis=0))
        if other.swing < SHRUNK * one.swing or swings.sum() < 0.0:
            return f"it shrinks onto the periodic motion at {point.value:.8g}"
        if other.resolved:
            return ""
        other.finer = self.resolved(point, point.u - last.u)
        return "" if other.finer is not None else self.unresolved(point)

    def unresolved(self, point: Point) -> str:
        """Why a curve is none."""
        return (
            f"{self.samples} samples do not resolve the curve at {point.value:.8g}, "
            f"{spectral_tail(point.state.states):.2g} of it is in the highest quarter of their harmonics, "
            f"more than {RESOLVED:g}: the tone locks, or more samples or steps are needed"
        )

    def resolved(self, point: Point, chord: np.ndarray) -> Point | None:
        """The same curve by the fewest samples that resolve it, on a branch that goes along a chord."""
        for k, own in enumerate(self.finer_maps):
            u, along = (
                np.append(own.resampled(self.split(item)[0]).ravel(), item[-2:]) for item in (point.u, chord)
            )
            try:
                found = curve_near(own, u, None, self.finer_maps[k + 1 :], along, EASE)
            except PetscFailure:
                raise
            except SolveError:
                continue
            if found.state.resolved:
                found.value = point.value
                return found
        return None

    def advanced(self, points: list[Point]) -> tuple[Curves, Point]:
        """See `Problem`: more samples where they are needed, and the phase of the last curve."""
        last = points[-1].state.finer or points[-1]
        point = beginning(last, None if last is points[-1] else last.problem.begins)
        return point.problem, point

    def memory(self, point: Point) -> np.ndarray:
        """See `Problem`: how the branch begins there, if it does, and what is told of the curve."""
        begins = np.zeros(0) if self.begins is None else self.begins
        return np.concatenate([[len(begins)], begins, point.state.told])

    def recalled(self, u: np.ndarray, value: float, memory: np.ndarray) -> Point:
        """See `Problem`."""
        known, samples = 1 + int(memory[0]), (len(u) - 2) // (2 * self.period.modes)
        finer = [item for item in self.finer_maps if item.samples > samples]
        problem = Curves(replace(self.tone, samples=samples), u, finer)
        point = beginning(Point(problem, u, problem.at(u), value), memory[1:known] if known > 1 else None)
        point.state.told = memory[known:]
        return point


def beginning(point: Point, begins: np.ndarray | None) -> Point:
    """A curve from which a branch goes on, in its own phase; `begins` is a direction in which it does."""
    old = point.problem
    problem = Curves(old.tone, point.u, old.finer_maps, begins)
    problem.shares = SHARES
    return replace(point, problem=problem, state=point.state.in_phase_of(problem))


def named(error: SolveError | None) -> str:
    """Why there is no curve."""
    return "quasi_periodic: " + str(error).removeprefix("quasi_periodic: ")


def curve_near(
    own: OwnTone,
    u: np.ndarray,
    heading: np.ndarray | None = None,
    finer: Sequence[OwnTone] = (),
    begins: np.ndarray | None = None,
    most: float = math.inf,
) -> Point:
    """The invariant curve near a guess, from other phases of it if one leads to none: of few samples some
    stand where pairs begin to touch.

    Parameters
    ----------
    own : OwnTone
    u : (N 2 m + 2,) array
        Samples, rotation and value.
    heading : (N 2 m + 2,) array, optional
        In units: the curve lies in the plane through the guess across it. Default: at the guess's value.
    finer
        See `Curves`.
    begins : (N 2 m + 2,) array, optional
        Change of the unknowns along the branch.
    most : float
        Newton iterations that are taken.

    Raises
    ------
    SolveError
        The first one, if Newton's method converges from none.
    """
    failed: SolveError | None = None
    for share in PHASES:
        turns = share / own.samples

        def turned(item: np.ndarray, turns: float = turns) -> np.ndarray:
            states = filtered(item[:-2].reshape(own.samples, -1), shift(own.samples, turns))
            return np.append(states.ravel(), item[-2:])

        begin = turned(u) if turns else u
        problem = Curves(own, begin, finer)
        metric = Metric(problem, begin)
        if begins is not None:
            problem.begins = turned(begins) / metric.units
        try:
            if heading is None:
                return correct(problem, begin, metric.level(begin, float(u[-1])), most=most)
            return correct(problem, begin, metric.plane(turned(heading), begin), most=most)
        except PetscFailure:
            raise
        except SolveError as error:
            failed = failed or error
    raise SolveError(
        f"{named(failed)}; take more samples or steps, or a motion nearer to the one that is known; "
        "or the motion's own tone is locked to the load there, so that it is periodic over some periods "
        "(`periodic(..., periods=n)`)"
    )


def first_curve(own: OwnTone, bifurcation: Bifurcation, share: float) -> tuple[np.ndarray, np.ndarray]:
    """A small curve about the periodic motion of a Neimark-Sacker point, and the direction in which it grows.

    Parameters
    ----------
    own : OwnTone
    bifurcation : Bifurcation
    share : float
        Root mean square of the curve's distance from the periodic motion, relative to that.
    """
    direction, multiplier = bifurcation.direction, bifurcation.multiplier
    if multiplier.imag < 0.0:
        direction, multiplier = np.conj(direction), multiplier.conjugate()
    turns = np.exp(2j * np.pi * np.arange(own.samples) / own.samples)
    wave = (turns[:, None] * direction).real
    wave /= np.linalg.norm(wave)
    states = bifurcation.state + share * own.period.size(bifurcation.state) * math.sqrt(own.samples) * wave
    rotation = float(np.angle(multiplier)) / (2.0 * np.pi)
    u = np.append(states.ravel(), [rotation, bifurcation.own_value])
    return u, np.append(wave.ravel(), [0.0, 0.0])


def strays(point: Point, periods: int, dense: int = 2001) -> float:
    """Largest distance from a curve, in its swings, of a history that begins between two samples."""
    state, own = point.state, point.problem.tone
    driven, farthest = own.driven(state.value), 0.0
    known = resampled(state.states, dense)
    here: Any = filtered(state.states, shift(own.samples, 0.5 / own.samples))[0]
    try:
        for _ in range(periods):
            here = here + driven.run(here).residual
            farthest = max(farthest, float(np.linalg.norm(known - here, axis=1).min()))
    except SolveError:
        farthest = np.inf
    return own.comm.bcast(farthest / state.swing)  # ranks may have rounded differently

"""Invariant curves of motions with a tone of their own, which leave a branch of periodic motions at a
Neimark-Sacker point: rotation and parameter are unknown too, and the curve may begin anywhere: its phase is
that of the curve before it.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ...errors import SolveError, failed_solve
from ...motion.excitation import Excitation
from ...motion.factors import FACTORS
from ...motion.period_map import DrivenPeriod, Period
from ...petsc import MPI
from ...record.record import Record, described, quantity
from ..bifurcations import Bifurcation
from ..newton import attempt, correct
from ..problem import Lost, Metric, Point
from .curve import RESOLVED, InvariantCurves, named, spectral_tail
from .curve_system import filtered, require_room, resampled, shift, tangents

# Phases at which a curve is looked for, in distances of its samples.
PHASES = (0.0, 0.5, 0.25, 0.75)
# The parameter's unit is this share of its value.
UNIT = 0.1
# Samples are doubled so many times at most where they do not resolve the curve, if Newton's method then takes
# no more than so many iterations.
DOUBLINGS, EASE = 2, 10
# Shares of Newton's steps along a branch: where curves have kinks shorter ones lead nowhere.
SHARES = (1.0, 0.5)
# Of the swing of the curve before: a curve that is none any more.
SHRUNK = 0.1
# Points of a curve that the distance from it is measured to.
DENSE = 2001


@described
class OwnTone(Record):
    """The map of one period of the loads, over a parameter, at N points of a curve, `samples`, an odd number
    that the ranks of `comm` share.
    """

    period: Period = quantity(text="the period map", part="Period", detail=True)
    parameter: str = quantity(text="what it is over", one_of=("frequency", *FACTORS))
    frequency: float | None = quantity("Hz", "forcing frequency, where another one is the parameter", least=0)
    samples: int = quantity("1", "phases of the motion's own tone", least=3)
    comm: MPI.Comm
    load: float = quantity(
        "1", "factor on the oscillating loads", called="load_factor", default=1.0, least=0.0
    )
    damping: float = quantity("1", "factor on the damping ratios", default=1.0, least=0.0)
    gap: float = quantity("1", "factor on the initial gaps", default=1.0, least=0.0)

    @classmethod
    def _revived(cls, found: dict[str, Any]) -> OwnTone:
        """From a file: with the ranks of its map."""
        return cls(**found | {"comm": found["period"].comm})

    def check(self) -> None:
        """Raise ValueError unless the frequency is known."""
        if (self.parameter != "frequency") != bool(self.frequency) or self.samples % 2 == 0:
            raise ValueError(
                f"it is over {self.parameter!r} at a fixed frequency of {self.frequency} Hz, of "
                f"{self.samples} samples"
            )

    @property
    def factors(self) -> dict[str, float]:
        """All of `FACTORS` by name."""
        return {name: getattr(self, name) for name in FACTORS}

    def at(self, value: float) -> OwnTone:
        """With the parameter at a value; the frequency stays None where it is the parameter."""
        known: Any = {self.parameter: value}
        return self if self.parameter == "frequency" else replace(self, **known)

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
        return own.period.at(frequency, **own.factors)

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
        self.phase_begin = float(self.phase @ u)

    def split(self, u: np.ndarray) -> tuple[np.ndarray, float, float]:
        """See `InvariantCurves`."""
        return u[:-2].reshape(self.samples, -1), float(u[-2]), float(u[-1])

    def at_sample(self, value: float) -> Callable[[int], DrivenPeriod]:
        """See `InvariantCurves`: the same for all."""
        driven = self.tone.driven(value)
        return lambda i: driven

    def linear_response(self, value: float) -> Sequence[tuple[Excitation, np.ndarray]]:
        """See `InvariantCurves`: of one tone."""
        driven = self.tone.driven(value)
        return ((driven.excitation, driven.amplitudes),)

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
                np.append(resampled(self.split(item)[0], own.samples).ravel(), item[-2:])
                for item in (point.u, chord)
            )
            found = attempt(
                functools.partial(curve_near, own, u, None, self.finer_maps[k + 1 :], along, EASE), SolveError
            )
            if found is not None and found.state.resolved:
                found.value = point.value
                return found
        return None

    def advanced(self, points: list[Point]) -> tuple[Curves, Point]:
        """See `Problem`: more samples where they are needed, and the phase of the last curve."""
        last = points[-1].state.finer or points[-1]
        point = beginning(last, None if last is points[-1] else last.problem.begins)
        return point.problem, point

    def memory(self, point: Point) -> list[Any]:
        """See `Problem`: how the branch begins there, if it does, and what is told of the curve."""
        return [self.begins, point.state.recorded]

    def recalled(self, u: np.ndarray, value: float, memory: Sequence[Any]) -> Point:
        """See `Problem`."""
        samples = (len(u) - 2) // self.period.unknowns
        finer = [item for item in self.finer_maps if item.samples > samples]
        problem = Curves(replace(self.tone, samples=samples), u, finer)
        begins, recorded = memory
        point = beginning(Point(problem, u, problem.at(u), value), begins)
        point.state.recorded = recorded
        return point


def beginning(point: Point, begins: np.ndarray | None) -> Point:
    """A curve from which a branch goes on, in its own phase; `begins` is a direction in which it does."""
    old = point.problem
    problem = Curves(old.tone, point.u, old.finer_maps, begins)
    problem.shares = SHARES
    return replace(point, problem=problem, state=point.state.in_phase_of(problem))


def curve_near(
    own: OwnTone,
    u: np.ndarray,
    tangent: np.ndarray | None = None,
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
    tangent : (N 2 m + 2,) array, optional
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
    failed = list[SolveError]()
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
        level = metric.level(begin, float(u[-1]))
        condition = level if tangent is None else metric.plane(turned(tangent), begin)
        find = functools.partial(correct, problem, begin, condition, most=most)
        if (point := attempt(find, SolveError, failed)) is not None:
            return point
    raise failed_solve(
        f"{named(failed[0])}; take more samples or steps, or a motion nearer to the one that is known; "
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


def strays(point: Point, periods: int) -> float:
    """Largest distance from a curve, in its swings, of a history that begins between two samples."""
    state, own = point.state, point.problem.tone
    driven, farthest = own.driven(state.value), 0.0
    known = resampled(state.states, DENSE)
    here: Any = filtered(state.states, shift(own.samples, 0.5 / own.samples))[0]
    try:
        for _ in range(periods):
            here = here + driven.run(here).residual
            farthest = max(farthest, float(np.linalg.norm(known - here, axis=1).min()))
    except SolveError:
        farthest = np.inf
    return own.comm.bcast(farthest / state.swing)  # ranks may have rounded differently

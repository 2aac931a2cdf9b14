"""Invariant curves of the map over a period of the loads, as a family of solutions.

At multiples of the period the state runs round a closed curve z(theta), which the map takes to itself:
P_theta(z(theta)) = z(theta + rho). Unknowns are its samples at N phases, between which it is its
trigonometric interpolant; a shift by rho multiplies the k-th harmonic by exp(2 pi i k rho).
"""

from __future__ import annotations

import copy
import functools
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from ...contact.law import peak_of
from ...errors import SolveError
from ...motion.excitation import Excitation
from ...motion.period_map import DrivenPeriod, Period
from ...motion.period_motion import PeriodMotion
from ...petsc import MPI
from ...ranks.parallel import collective
from ...reduction.outputs import LinearOutput
from ..problem import Linear, Point, Problem
from .curve_system import CurveBorder, CurveMaps, Harmonics, filtered, shift, tangents

# A curve is resolved by its samples if no more than this share of it is in the highest quarter of their
# harmonics: docs/verification/quasi_periodic.md has what lines and own tones were off by below and above it.
RESOLVED = 0.01
# Of the states, harmonics that are rounding.
ROUNDING = 1e-9
# Difference of the parameter by which the map's rate with it is found.
DIFFERENCE = 1e-7
# Multiples of the faster tone of which lines are kept, and instants that are looked at together.
LINES, INSTANTS = 20, 512
# Motions from samples, by their numbers.
Motions = Mapping[int, PeriodMotion]


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


class InvariantCurves(Problem):
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
    phase_begin : float
        Its product with the unknowns of those that are in phase.
    """

    period: Period
    samples: int
    comm: MPI.Comm
    unit: float
    phase: np.ndarray | None = None
    phase_begin = 0.0
    _units: np.ndarray

    def split(self, u: np.ndarray) -> tuple[np.ndarray, float, float]:
        """Samples (N, 2 m), rotation and value."""
        raise NotImplementedError

    def at_sample(self, value: float) -> Callable[[int], DrivenPeriod]:
        """The map of a sample's index."""
        raise NotImplementedError

    def linear_response(self, value: float) -> Sequence[tuple[Excitation, np.ndarray]]:
        """Loads of the faster tone, and of the slower one, with the modal amplitudes (k, m) of the linear
        response.
        """
        raise NotImplementedError

    def seen(self, motion: PeriodMotion) -> PeriodMotion:
        """A motion as points follow it beyond the modes."""
        return motion

    def at(self, u: np.ndarray) -> CurveState:
        """See `Problem`."""
        return CurveState(self, u)

    def units(self, u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """See `Problem`."""
        return self._units, np.ones(len(u))

    def images(self, states: np.ndarray, value: float) -> tuple[np.ndarray, Motions]:
        """(N, 2 m): where the maps take samples, and the motions of this rank's. Collective.

        Raises
        ------
        SolveError
            On all ranks, where one of the maps fails.
        """
        comm, driven = self.comm, self.at_sample(value)
        ends, motions = np.zeros_like(states), dict[int, PeriodMotion]()
        with collective(comm):
            for i in range(comm.rank, len(states), comm.size):
                motions[i] = motion = driven(i).run(states[i])
                ends[i] = states[i] + motion.residual
        comm.Allreduce(MPI.IN_PLACE, ends)
        stuck = self.stuck(motions)
        ends[:, stuck] = states[:, stuck].mean(axis=0)
        return ends, motions

    def stuck(self, motions: Motions) -> np.ndarray:
        """Where a state has the slips that stick along the whole curve: every value that is the same at all
        phases is one of theirs, and the map takes them to their mean. Collective.
        """
        period = self.period
        if period.friction is None:
            return np.empty(0, dtype=int)
        count = len(period.laws)
        sticks = [motion.stays(count) for motion in motions.values()]
        everywhere = np.all(sticks, axis=0) if sticks else np.ones(period.pairs - count, dtype=bool)
        self.comm.Allreduce(MPI.IN_PLACE, everywhere, MPI.LAND)
        return 2 * period.modes + np.flatnonzero(everywhere)


class CurveState:
    """The equations at some unknowns; what takes memory is made where it is asked for.

    Attributes
    ----------
    states : (N, 2 m) array
    rotation : float
        Turns in one application of the map.
    value : float
    recorded : dict or None
        What a result says of the curve beside its unknowns, by names of `QuasiPeriodic`.
    """

    recorded: dict[str, Any] | None = None

    def __init__(self, problem: InvariantCurves, u: np.ndarray):
        self.problem, self.u, self.scale = problem, u, problem.unit
        self.states, self.rotation, self.value = problem.split(u)
        self.finer: Point | None = None

    def forget(self) -> None:
        """See `problem.State`."""
        for name in ("_run", "_smooth"):
            self.__dict__.pop(name, None)

    def in_phase_of(self, problem: InvariantCurves) -> CurveState:
        """The same under another condition on its phase."""
        result = copy.copy(self)
        result.problem, result.scale = problem, problem.unit
        return result

    @functools.cached_property
    def _run(self) -> tuple[np.ndarray, Motions]:
        return self.problem.images(self.states, self.value)

    @property
    def ends(self) -> np.ndarray:
        """(N, 2 m): where the map takes the samples."""
        return self._run[0]

    @property
    def motions(self) -> Motions:
        """Over the period from each of this rank's samples."""
        return self._run[1]

    @property
    def residual(self) -> np.ndarray:
        """See `problem.State`: how far the curve misses itself, and its phase."""
        phase, begin = self.problem.phase, self.problem.phase_begin
        return self._missed if phase is None else np.append(self._missed, float(phase @ self.u) - begin)

    @functools.cached_property
    def _missed(self) -> np.ndarray:
        return (self.ends - filtered(self.states, shift(len(self.states), self.rotation))).ravel()

    def lines(self, points: LinearOutput | None = None) -> np.ndarray:
        """(21, k, points, 2) lines at multiples of the faster tone plus those of the slower one, m, of all
        named points or of others. Collective.
        """
        points = points or self.problem.period.reduced.points
        problem, motions, rotation = self.problem, self.motions, self.rotation
        period, samples = problem.period, problem.samples
        steps, half = period.steps, samples // 2
        lines = min(LINES, steps // 2 - 1)
        orders, seen = np.arange(-half, half + 1), points.modes.shape[:2]
        found = np.zeros((lines + 1, len(orders), *seen), dtype=complex)
        mine = [problem.seen(motion) for motion in motions.values()]
        over_samples = np.exp(-2j * np.pi * orders[:, None] * [*motions] / samples) / samples
        for begin in range(0, steps if mine else 0, INSTANTS):
            part = slice(begin, min(begin + INSTANTS, steps))
            u = np.array([_moved(points, period.pairs, motion, part) for motion in mine])
            # the slower tone's lines over the samples at each instant, then the faster one's over these
            slow = np.tensordot(over_samples, u, axes=1)
            share = np.arange(part.start, part.stop) / steps
            forward = np.exp(-2j * np.pi * np.arange(lines + 1)[:, None] * share) / steps
            for j, order in enumerate(orders):
                turned = np.exp(-2j * np.pi * order * rotation * share)[:, None] * slow[j]
                found[:, j] += (forward @ turned).reshape(-1, *seen)
        problem.comm.Allreduce(MPI.IN_PLACE, found)
        found *= 2.0
        found[0, half] *= 0.5
        if samples % 2 == 0:  # both ends of the range are the same harmonic of the samples
            found[:, [0, -1]] *= 0.5
        for tone, (drive, amplitudes) in enumerate(problem.linear_response(self.value)):
            response = np.einsum("pim,km->kpi", points.modes, amplitudes)
            response += np.einsum("pil,kl->kpi", points.loads, drive.amplitudes)
            for order, value in zip(drive.orders, response):
                place = (order, half) if tone == 0 else (0, half + order)
                if place[0] <= lines and place[1] < len(orders):
                    found[place] += value
        return found

    @property
    def peak(self) -> float:
        """Contact resultant of largest modulus, N. Collective."""
        rows = len(self.problem.period.laws)
        mine = [peak_of(motion.forces[:-1, :rows].sum(axis=1)) for motion in self.motions.values()]
        return peak_of(np.concatenate(self.problem.comm.allgather(mine)))

    def told(self, growth: np.ndarray, frequency: float) -> dict[str, Any]:
        """What a result says of the curve beside its unknowns, by names of `QuasiPeriodic`: with so many
        exponents, and where faces rub the mean power that they lose at the first tone's frequency, W, and how
        many slips stick throughout. Collective.
        """
        found = {"exponents": growth, "contact_peak": self.peak, "lines": self.lines()}
        if self.problem.period.friction is None:
            return found
        lost = sum(float(motion.lost.sum()) for motion in self.motions.values())
        power = frequency * self.problem.comm.allreduce(lost) / len(self.states)
        return found | {"friction_power": power, "sticking": len(self.problem.stuck(self.motions))}

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
        size, stuck = self.states.shape[1], problem.stuck(self.motions)
        found, unit = np.empty((len(self.motions), size, size)), np.eye(size)
        for place, (i, motion) in enumerate(self.motions.items()):
            found[place] = driven(i).carried(motion, unit, located=smooth)
            if problem.period.friction is not None:  # elsewhere on the curve they slip
                kept = 2 * problem.period.modes + np.flatnonzero(motion.stays(len(problem.period.laws)))
                found[place, kept, kept] = 1.0
        if stuck.size:
            found[:, stuck] = 0.0
        return CurveMaps(problem.comm, len(self.states), found)

    def linear(self, smooth: bool = False) -> CurveLinear:
        """See `problem.State`: made where it is used."""
        return CurveLinear(self, smooth)

    def linearised(self, smooth: bool) -> tuple[Harmonics, np.ndarray]:
        """The preconditioner with the maps that it is made of, and the equations' derivatives along rotation
        and value, (2, N 2 m), where they are unknown; the smooth ones are kept.
        """
        return self._smooth if smooth else self._made(smooth)

    @functools.cached_property
    def _smooth(self) -> tuple[Harmonics, np.ndarray]:
        return self._made(True)

    def _made(self, smooth: bool) -> tuple[Harmonics, np.ndarray]:
        bordered = self.problem.phase is not None
        harmonics = Harmonics(self.maps(smooth), shift(len(self.states), self.rotation), bordered)
        columns = [-tangents(self.states, self.rotation).ravel(), self._rate().ravel()] if bordered else []
        return harmonics, np.array(columns)

    def _rate(self) -> np.ndarray:
        """(N, 2 m): derivative of the images along the value, by differences."""
        difference = DIFFERENCE * abs(self.value)
        return (self.problem.images(self.states, self.value + difference)[0] - self.ends) / difference


class CurveLinear(Linear):
    """The linearised equations. They have no sum with those of other curves, whose derivatives are as dear as
    their own.
    """

    def __init__(self, state: CurveState, smooth: bool):
        self.state, self.smooth, self.rows = state, smooth, len(state.u) - 1

    def bordered(self, row: np.ndarray) -> CurveBorder:
        """See `problem.Linear`."""
        state, problem = self.state, self.state.problem
        units = problem.units(state.u)[0], problem.unit
        return CurveBorder(*state.linearised(self.smooth), problem.phase, row, units)


def _moved(points: LinearOutput, pairs: int, motion: PeriodMotion, part: slice) -> np.ndarray:
    """(n, 2 points): displacements of points at some instants, without the linear response."""
    u = np.einsum("pim,nm->npi", points.modes, motion.states[part], optimize=True)
    u += np.einsum("pic,nc->npi", points.contact[..., :pairs], motion.forces[part], optimize=True)
    return u.reshape(len(u), -1)


def named(error: SolveError | None) -> str:
    """Why there is no curve."""
    return "quasi_periodic: " + str(error).removeprefix("quasi_periodic: ")

"""Quasi-periodic motions under two tones: an invariant curve of the map over the first tone's period.

At multiples of T1 = 1 / f1 the state is a function z(theta) of the second tone's phase, which the map
advances by rho = f2 / f1. The unknowns of `curve` are differences to the linear response to both tones, which
is known in closed form.
"""

from __future__ import annotations

import copy
import functools
import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from ...errors import SolveError, failed_solve
from ...motion.excitation import Excitation, modal_forces
from ...motion.period_map import DrivenPeriod, Period
from ...motion.period_motion import PeriodMotion
from ...petsc import MPI
from ...reduction.build import wider
from ...reduction.reduced_model import ReducedModel
from ..harmonic_errors import FAINT, SECOND, beyond, in_modes
from ..newton import attempt, correct
from ..orbit import LOWEST
from ..problem import Point
from .curve import InvariantCurves, Motions, named
from .curve_system import CurveMaps, filtered, shift

# Orbits of the curve's own map, after which Newton's method is tried again.
SETTLING = (3, 10, 30, 100, 300)
# Most periods of the first tone over which a motion is followed before it is tried first.
LONGEST = 100


class Torus(InvariantCurves):
    """The map over one period of the first tone, at N phases of the second one. u = (samples, a number that
    is held): nothing but the samples is unknown.

    Parameters
    ----------
    reduction : ReducedModel
    drives : (Excitation, Excitation)
        Of the first tone, with the constant loads, and of the second one; one period each.
    frequencies : (float, float)
        f1, f2, Hz.
    samples, steps : int
        Phases, and steps in T1.
    comm : MPI.Comm
        Ranks that share the phases.
    """

    closed, gain = 1e-11, 0.02

    def __init__(
        self,
        reduction: ReducedModel,
        drives: tuple[Excitation, Excitation],
        frequencies: tuple[float, float],
        *,
        samples: int,
        steps: int,
        comm: MPI.Comm,
    ):
        self.reduced, self.drives, self.frequencies = reduction, drives, frequencies
        self.samples, self.comm = samples, comm
        # what is left out may follow its forces by a delay, s: what that adds to the gaps of samples
        self.delay, self.late = 0.0, dict[int, np.ndarray]()
        self.period = Period(reduction, drives[0], steps)
        self.base = self.period.at(frequencies[0])
        self.rotation = frequencies[1] / frequencies[0]
        # what the second tone adds to the gaps, without its phase
        second = drives[1]
        self.pumped = second.response(reduction, frequencies[1])
        turns = self.rotation * np.arange(steps + 1)[:, None] / steps * second.orders
        self.turning = np.exp(2j * np.pi * turns)
        p = self.period
        gaps = (self.pumped @ p.right) @ p.left.T + second.amplitudes @ reduction.gap.loads[: p.pairs].T
        self.pump_gaps = np.concatenate([gaps.real, -gaps.imag])
        self.pump_speeds = speeds = 2j * np.pi * second.orders[:, None] * frequencies[1]
        self.unit = np.sqrt(samples) * max(
            self.base.oscillation,
            float(np.linalg.norm(np.concatenate([p.weights * self.pumped, speeds * self.pumped], axis=1))),
            1e-300,
        )
        # the linear response itself, with faces that rub as they are at rest
        self.linear = p.begun(np.zeros(2 * p.modes))
        self._units = np.append(np.full(p.unknowns * samples, self.unit), 1.0)

    @property
    def told_steps(self) -> int:
        """Steps a period of the first tone."""
        return self.period.steps

    def split(self, u: np.ndarray) -> tuple[np.ndarray, float, float]:
        """See `InvariantCurves`."""
        return u[:-1].reshape(self.samples, -1), self.rotation, float(u[-1])

    def at_sample(self, value: float) -> Callable[[int], DrivenPeriod]:
        """See `InvariantCurves`."""
        return self.driven

    def delayed(self, motions: Motions, delay: float) -> Torus:
        """The map whose gaps through what is left out follow the forces of motions and the loads as under
        Rayleigh's damping, see `harmonic_errors.delayed`.
        """
        r, p, result = self.reduced, self.period, copy.copy(self)
        assert r.lag is not None  # whose delay it is
        flexible = (r.gap.contact - np.diag(r.lag.layers))[: p.pairs, : p.pairs]
        first, second = (
            (late - drive.amplitudes) @ r.gap.loads[: p.pairs].T
            for late, drive in zip(self._late_loads(delay), self.drives)
        )
        result.delay = delay
        result.late = {
            i: (followed(motion.forces, delay / self.base.step) - motion.forces) @ flexible
            + p.over_time(first)
            + (self._phases(i / self.samples) @ second).real
            for i, motion in motions.items()
        }
        return result

    def _late_loads(self, delay: float) -> list[np.ndarray]:
        """Amplitudes that what is left out follows, of both tones; moving supports are followed at once."""
        result = []
        for drive, frequency in zip(self.drives, self.frequencies):
            delays = np.full(drive.amplitudes.shape[1], delay)
            delays[self.reduced.edges] = 0.0
            turns = 2j * np.pi * frequency / drive.periods * drive.orders[:, None] * delays
            result.append(drive.amplitudes / (1.0 + turns))
        return result

    def linear_response(self, value: float) -> Sequence[tuple[Excitation, np.ndarray]]:
        """See `InvariantCurves`."""
        late = zip(self.drives, self._late_loads(self.delay))
        drives = [replace(drive, amplitudes=loads) for drive, loads in late] if self.delay else self.drives
        return tuple(zip(drives, (self.base.amplitudes, self.pumped)))

    def seen(self, motion: PeriodMotion) -> PeriodMotion:
        """See `InvariantCurves`."""
        if not self.delay:
            return motion
        return replace(motion, forces=followed(motion.forces, self.delay / self.base.step))

    def driven(self, i: int) -> DrivenPeriod:
        """The map at a sample, in differences to the linear response; its gaps may follow forces later, see
        `delayed`.
        """
        result, phases = copy.copy(self.base), self._phases(i / self.samples)
        # the real part of a product of complex matrices, by one of real ones
        moved = np.concatenate([phases.real, phases.imag], axis=1) @ self.pump_gaps
        result.free_gap = np.add(moved, self.base.free_gap, out=moved)
        if i in self.late:
            result.free_gap += self.late[i]
        result.linear_state = np.zeros_like(self.base.linear_state)
        return result

    def _phases(self, theta: float) -> np.ndarray:
        """(steps + 1, k): of the second tone's multiples over the first one's period."""
        return self.turning * np.exp(2j * np.pi * theta * self.drives[1].orders)

    def contact_work(self, motions: Motions) -> float:
        """As `contact_work.contact_work`, over the motions from all samples. Collective."""
        forces, velocities = self.base.oscillations()
        further = (modal_forces(self.reduced, self.pumped, self.pump_speeds), self.pump_speeds * self.pumped)
        done = np.zeros(2)
        for i, motion in motions.items():
            phases = self._phases(i / self.samples)
            force, velocity = ((phases @ part).real for part in further)
            powers = (forces + force) * (velocities + velocity + motion.velocities)
            done += np.abs(motion.work).sum(), np.abs(powers[:-1]).sum() * self.base.step
        self.comm.Allreduce(MPI.IN_PLACE, done)
        return float(done[0] / done[1])

    def solve(self, states: np.ndarray | None = None) -> Point:
        """The invariant curve near a guess (N, 2 m + k). By default near the linear response, where faces rub
        near where two periods of the second tone take the structure from rest, as a history does: they keep
        what they have slipped.

        Raises
        ------
        SolveError
            If Newton's method does not converge, neither from the guess nor from where the map has taken it.
        """
        if states is None and self.period.friction is not None:
            u = self._followed(self._at_rest(), min(math.ceil(2.0 / self.rotation), LONGEST))
        else:
            begin = np.tile(self.linear, (self.samples, 1)) if states is None else states
            u = np.append(begin.ravel(), 0.0)

        done, failed = 0, list[SolveError]()
        for target in (0, *SETTLING):
            u, done = self._followed(u, target - done), target
            point = attempt(functools.partial(correct, self, u, self.value), SolveError, failed)
            if point is not None:
                return point
        raise failed_solve(
            f"{named(failed[0])}; neither from where {done} periods of the first tone take the curve; "
            "take more samples or steps, or smaller loads"
        )

    def _followed(self, u: np.ndarray, periods: int) -> np.ndarray:
        """Where the map takes a curve in so many periods of the first tone."""
        back = shift(self.samples, -self.rotation)
        for _ in range(periods):
            u = np.append(filtered(self.at(u).ends, back), 0.0)
        return u

    def _at_rest(self) -> np.ndarray:
        """The structure at rest under the constant loads, at all phases."""
        p = self.period
        phases = np.exp(2j * np.pi * np.arange(self.samples)[:, None] / self.samples * self.drives[1].orders)
        second = [(phases @ part).real for part in (p.weights * self.pumped, self.pump_speeds * self.pumped)]
        states = np.tile(p.rest, (self.samples, 1))
        states[:, : 2 * p.modes] -= self.base.linear_state[: 2 * p.modes] + np.concatenate(second, axis=1)
        return np.append(states.ravel(), 0.0)


def followed(values: np.ndarray, delay: float) -> np.ndarray:
    """Values (n, ...) that follow others, linear in each step, as y + b y' = x from the first one on, b in
    steps.
    """
    from scipy.signal import lfilter  # slow to load, for all that know two tones

    fade = math.exp(-1.0 / delay)
    before, behind = delay * (1.0 - fade) - fade, 1.0 - delay * (1.0 - fade)
    steps = before * values[:-1] + behind * values[1:]
    return np.concatenate([values[:1], lfilter([1.0], [1.0, -fade], steps, axis=0, zi=fade * values[:1])[0]])


def exponents(
    maps: CurveMaps, rotation: float, count: int, turns: int, tangents: np.ndarray | None = None
) -> np.ndarray:
    """The largest Lyapunov exponents, per application of the map, by falling value. Collective.

    Mean growth of an orthonormal frame carried along the curve (QR); the map's derivative between samples is
    its trigonometric interpolant. Directions turn as they are carried, which leaves about 1 / turns of
    uncertainty in the growth a turn.

    Parameters
    ----------
    maps : CurveMaps
        Derivatives at the samples.
    rotation : float
        Turns of the curve's phase in the map.
    count : int
        How many; fewer by one where that would part a pair.
    turns : int
        Applications of the map over which growth is averaged.
    tangents : (N, 2 m) array, optional
        Of a curve whose phase is free: their direction, which neither grows nor decays, is not among the
        exponents.
    """
    comm, samples, own = maps.comm, maps.samples, maps.states
    size = own.shape[1]
    orders = np.fft.fftfreq(samples, 1.0 / samples)
    coefficients = np.fft.fft(np.eye(samples), axis=0) / samples
    flat = own.reshape(len(own), size**2)

    def weights(theta: float) -> np.ndarray:
        """Of the samples in the interpolant at a phase."""
        return (np.exp(2j * np.pi * orders * theta) @ coefficients).real

    # the frame begins where the mean derivative says that disturbances last longest, not at random: with
    # little damping directions part too slowly to be notes apart by their growth
    values, vectors = np.linalg.eig(maps.mean())
    longest = np.argsort(-np.abs(values), kind="stable")[:count]
    upper = values[longest].imag >= 0.0
    turning = longest[values[longest].imag > 0.0]
    columns = [vectors[:, longest[upper]].real, vectors[:, turning].imag]
    known = 0 if tangents is None else 1
    if tangents is not None:
        columns.insert(0, (weights(0.0) @ tangents)[:, None])
    frame = np.linalg.qr(np.concatenate(columns, axis=1))[0]
    frame = comm.bcast(frame)  # ranks may have taken another sign
    growth, counted, theta = np.zeros(frame.shape[1] - known), 0, 0.0
    for turn in range(turns):
        image = (weights(theta)[maps.mine] @ flat).reshape(size, size) @ frame
        comm.Allreduce(MPI.IN_PLACE, image)
        theta = (theta + rotation) % 1.0
        if tangents is not None:  # where it leads is known better than what it has been carried to
            image[:, 0] = weights(theta) @ tangents
        frame, upper = np.linalg.qr(image)
        if turn >= turns // 4:
            growth += np.log(np.maximum(np.abs(np.diag(upper)[known:]), 1e-300))
            counted += 1
    comm.Bcast(growth)  # ranks may have rounded differently
    return np.sort(growth / counted)[::-1]


# ---------------------------------------------------------------------- what is told of the lines' errors
def line_error_estimates(
    torus: Torus, point: Point, make: Callable[[ReducedModel, int], Torus]
) -> np.ndarray:
    """(3, 5): errors by left-out modes, by the steps and by the viscosity of what is left out, of the lines
    m f1 + n f2 of all named points, the largest of each order |m| + |n| = 0 to 4, relative to the line or to
    1e-3 of the largest that oscillates; as `harmonic_error_estimates` has those of one tone. Collective.

    Parameters
    ----------
    torus : Torus
    point : Point
        Its invariant curve.
    make : callable
        The same map of a model in so many steps.
    """
    r = torus.reduced
    more = wider(r)
    if more is None or not len(r.points.names):
        return np.full((3, LOWEST), np.nan)
    errors, own, delay = np.full((3, LOWEST), np.inf), point.state.lines(), 0.0
    if not point.state.peak:  # known in closed form
        errors[1] = 0.0
    elif found := _nearby(lambda: make(r, 2 * torus.period.steps), point.state.states - torus.linear):
        (torus, point), lines = found, found[1].state.lines()
        errors[1], own = SECOND * _by_order(lines - own, own), lines
    added, motions = point.state.states - torus.linear, point.state.motions
    if not r.delay:
        errors[2] = 0.0
    elif found := _nearby(lambda: torus.delayed(motions, r.delay), added):
        delay, lines = r.delay, found[1].state.lines()
        errors[2], own = _by_order(lines - own, own), lines
    factor = beyond(r, more)

    def wide() -> Torus:
        found = make(more, torus.period.steps)
        return found.delayed(motions, delay) if delay else found

    if np.isfinite(factor) and (found := _nearby(wide, in_modes(added, r, more))):
        errors[0] = factor * _by_order(found[1].state.lines() - own, own)
    return errors


def _nearby(make: Callable[[], Torus], added: np.ndarray) -> tuple[Torus, Point] | None:
    """An invariant curve near a difference to the linear response, and its map; None if there is none, or no
    room for it. Collective.
    """
    torus = attempt(make, ValueError)  # there may be no memory for it
    if torus is None:
        return None
    point = attempt(functools.partial(torus.solve, added + torus.linear), SolveError)
    return None if point is None else (torus, point)


def _by_order(off: np.ndarray, own: np.ndarray) -> np.ndarray:
    """(5,): of lines (m, n, points, xy), the largest error of each order."""
    count = min(len(off), len(own))
    off, own = (np.linalg.norm(part[:count], axis=(2, 3)) for part in (off, own))
    middle = own.shape[1] // 2
    off[0, :middle] = 0.0  # conjugate to those of positive n, but for the linear response, which these have
    order = np.arange(count)[:, None] + np.abs(np.arange(own.shape[1]) - middle)
    least = max(FAINT * own[order > 0].max(initial=0.0), np.finfo(float).tiny)
    errors = off / np.maximum(own, least)
    return np.array([errors[order == k].max(initial=0.0) for k in range(LOWEST)])

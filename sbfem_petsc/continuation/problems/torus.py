"""Quasi-periodic motions under two tones: an invariant curve of the map over the first tone's period.

At multiples of T1 = 1 / f1 the state is a function z(theta) of the second tone's phase, which the map
advances by rho = f2 / f1: P_theta(z(theta)) = z(theta + rho). The curve is sampled at N phases; between them
it is its trigonometric interpolant, which a shift by rho multiplies by exp(2 pi i k rho) in the k-th
harmonic. The unknowns are differences to the linear response to both tones, which is known in closed form.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from ...errors import PetscFailure, SolveError
from ...motion.excitation import Excitation
from ...motion.period_map import DrivenPeriod, Period, PeriodMotion, modal_forces
from ...petsc import MPI
from ...reduction.reduced_model import ReducedModel
from .curve_system import CurveMaps, CurveSystem, filtered

# Newton's method: closing error relative to the linear response, and iterations.
CLOSED, ITERATIONS = 1e-11, 15
# The linear systems need be no better than this, and than the square of what Newton's method has come to.
LINEAR = 1e-11
# The derivative is kept for the next iteration where an iteration gains at least this factor.
KEPT = 0.02
# Orbits of the curve's own map, after which Newton's method is tried again.
SETTLING = (3, 10, 30, 100, 300)
# A curve is resolved by its samples if no more than this share of it is in the highest quarter of their
# harmonics: docs/quasi_periodic.md has what lines and own tones were off by below and above it.
RESOLVED = 0.01
# Of the states, harmonics that are rounding.
ROUNDING = 1e-9


@dataclass(frozen=True, eq=False)
class Curve:
    """An invariant curve.

    Attributes
    ----------
    states : (N, 2 m) array
        Differences (Omega q, q') to the linear response, at t = 0 and the second tone's phases i / N.
    motions : list of PeriodMotion
        Over T1 from each of them; None for those of other ranks.
    residuals : tuple of float
        Norms at each Newton iterate.
    """

    states: np.ndarray
    motions: list[PeriodMotion | None]
    residuals: tuple[float, ...]


class Torus:
    """The map over one period of the first tone, at N phases of the second one, distributed over ranks.

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
        self.period = Period(reduction, drives[0], steps)
        self.base = self.period.at(frequencies[0])
        self.rotation = frequencies[1] / frequencies[0]
        self.orders = np.fft.fftfreq(samples, 1.0 / samples)
        self.shift = np.exp(2j * np.pi * self.orders * self.rotation)
        if samples % 2 == 0:  # the highest harmonic of a real function is a cosine
            self.shift[samples // 2] = np.cos(np.pi * samples * self.rotation)
        self.mine = range(comm.rank, samples, comm.size)
        # what the second tone adds to the gaps, without its phase
        second = drives[1]
        self.pumped, _ = second.response(reduction, frequencies[1])
        turns = self.rotation * np.arange(steps + 1)[:, None] / steps * second.orders
        self.turning = np.exp(2j * np.pi * turns)
        p = self.period
        gaps = (self.pumped @ p.right) @ p.left.T + second.amplitudes @ reduction.gap.loads[: p.pairs].T
        self.pump_gaps = np.concatenate([gaps.real, -gaps.imag])
        self.pump_speeds = speeds = 2j * np.pi * second.orders[:, None] * frequencies[1]
        self.size = max(
            self.base.oscillation,
            float(np.linalg.norm(np.concatenate([p.weights * self.pumped, speeds * self.pumped], axis=1))),
            1e-300,
        )

    def driven(self, theta: float) -> DrivenPeriod:
        """The map at a phase of the second tone, in differences to the linear response."""
        result = copy.copy(self.base)
        phases = self._phases(theta)
        # the real part of a product of complex matrices, by one of real ones
        moved = np.concatenate([phases.real, phases.imag], axis=1) @ self.pump_gaps
        result.free_gap = np.add(moved, self.base.free_gap, out=moved)
        result.linear_state = np.zeros_like(self.base.linear_state)
        return result

    def _phases(self, theta: float) -> np.ndarray:
        """(steps + 1, k): of the second tone's multiples over the first one's period."""
        return self.turning * np.exp(2j * np.pi * theta * self.drives[1].orders)

    def contact_work(self, motions: Sequence[PeriodMotion | None]) -> float:
        """As `contact_work.contact_work`, over the motions from all samples. Collective."""
        forces, velocities = self.base.oscillations()
        further = (modal_forces(self.reduced, self.pumped, self.pump_speeds), self.pump_speeds * self.pumped)
        done = np.zeros(2)
        for i in self.mine:
            motion, phases = motions[i], self._phases(i / self.samples)
            assert motion is not None  # this rank's
            force, velocity = ((phases @ part).real for part in further)
            powers = (forces + force) * (velocities + velocity + motion.velocities)
            done += np.abs(motion.work).sum(), np.abs(powers[:-1]).sum() * self.base.step
        self.comm.Allreduce(MPI.IN_PLACE, done)
        return float(done[0] / done[1])

    def shifted(self, states: np.ndarray, sign: int = 1) -> np.ndarray:
        """The curve's samples at phases further on by the rotation, or (sign = -1) back."""
        return filtered(states, self.shift if sign > 0 else np.conj(self.shift))

    def images(self, states: np.ndarray) -> tuple[np.ndarray, list[PeriodMotion | None]]:
        """(N, 2 m): where the map takes each sample, and the motions of this rank's."""
        return images(self.comm, self._at, states)

    def derivatives(self, motions: list) -> CurveMaps:
        """Of the map at each sample."""
        return derivatives(self.comm, self._at, motions, modes=self.period.modes)

    def _at(self, i: int) -> DrivenPeriod:
        return self.driven(i / self.samples)

    # ------------------------------------------------------------------ Newton's method
    def solve(self, states: np.ndarray | None = None) -> Curve:
        """The invariant curve near a guess; by default near the linear response.

        Raises
        ------
        SolveError
            If Newton's method does not converge, neither from the guess nor from where the map has taken it.
        """
        states = np.zeros((self.samples, 2 * self.period.modes)) if states is None else states
        try:
            return self._newton(states)
        except PetscFailure:
            raise
        except SolveError as error:
            first = error
        done = 0
        for target in SETTLING:
            while done < target:
                states = self.shifted(self.images(states)[0], -1)
                done += 1
            try:
                return self._newton(states)
            except PetscFailure:
                raise
            except SolveError:
                continue
        raise SolveError(f"{first}; neither from where {done} periods of the first tone take the curve")

    def _newton(self, states: np.ndarray) -> Curve:
        residuals: list[float] = []
        system: CurveSystem | None = None
        motions: list[PeriodMotion | None] = []
        for _ in range(ITERATIONS + 1):
            motions.clear()  # those of the former iteration take as much memory as the new ones
            ends, motions = self.images(states)
            residual = ends - self.shifted(states)
            residuals.append(float(np.linalg.norm(residual)) / np.sqrt(self.samples) / self.size)
            if residuals[-1] < CLOSED:
                return Curve(states, motions, tuple(residuals))
            if not np.isfinite(residuals[-1]) or residuals[-1] > 1e3 * residuals[0]:
                break
            if system is None or len(residuals) < 2 or residuals[-1] > KEPT * residuals[-2]:
                system = CurveSystem(self.derivatives(motions), self.shift)
            tolerance = max(LINEAR, 1e-2 * min(residuals[-1], 1.0), 0.1 * CLOSED / residuals[-1])
            states = states - system.solve(residual, min(tolerance, 1e-3))
        raise SolveError(
            f"quasi_periodic: Newton's method did not converge in {len(residuals) - 1} iterations: the "
            f"curve misses itself by {residuals[-1]:.1e} of the linear response, from {residuals[0]:.1e}; "
            "take more samples or steps, or smaller loads"
        )

    def exponents(self, maps: CurveMaps, count: int, turns: int) -> np.ndarray:
        """The largest Lyapunov exponents, 1/s; see `exponents`."""
        return exponents(maps, self.rotation, count, turns) * self.frequencies[0]


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


def images(
    comm: MPI.Comm, driven: Callable[[int], DrivenPeriod], states: np.ndarray
) -> tuple[np.ndarray, list[PeriodMotion | None]]:
    """(N, 2 m): where maps take samples (N, 2 m), and the motions of this rank's. Collective.

    Parameters
    ----------
    comm : MPI.Comm
        Ranks that share the samples: each takes those from its own number on in steps of their count.
    driven : callable
        The map of a sample's index.
    states : (N, 2 m) array

    Raises
    ------
    SolveError
        On all ranks, where one of the maps fails.
    """
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


def derivatives(
    comm: MPI.Comm,
    driven: Callable[[int], DrivenPeriod],
    motions: Sequence[PeriodMotion | None],
    parameters: tuple[str, ...] = (),
    *,
    modes: int,
) -> CurveMaps:
    """Of the maps of so many modes at each sample, along the state and named parameters."""
    mine, size = range(comm.rank, len(motions), comm.size), 2 * modes
    result, unit = np.empty((len(mine), size, size + len(parameters))), np.eye(size)
    for place, i in enumerate(mine):
        motion = motions[i]
        assert motion is not None  # this rank's
        result[place] = driven(i).carried(motion, unit, parameters)
    return CurveMaps(comm, len(motions), result)


def exponents(
    maps: CurveMaps,
    rotation: float,
    count: int,
    turns: int,
    tangents: np.ndarray | None = None,
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

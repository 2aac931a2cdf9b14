"""Quasi-periodic motions with a tone of their own, which leave a branch of periodic motions at a
Neimark-Sacker point.

At multiples of the period T of the loads the state runs round a closed curve z(theta), which the period map
takes to itself: P(z(theta)) = z(theta + rho). The rotation rho is unknown, the curve's beginning theta = 0
is free. Newton's unknowns are the curve's N samples, rho and the branch's parameter; a phase condition and a
plane that the point lies in close the system.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass, replace

import numpy as np

from ...errors import PetscFailure, SolveError
from ...motion.period_map import DrivenPeriod, Period, PeriodMotion
from ...petsc import MPI
from ..bifurcations import Bifurcation
from .curve_system import Border, CurveMaps, CurveSystem, filtered, require_room, resampled
from .torus import RESOLVED, derivatives, exponents, images, spectral_tail

# Newton's method: closing error relative to the curve's size, iterations, and the gain with which the
# derivative is kept for another one.
CLOSED, ITERATIONS, KEPT = 1e-10, 14, 0.05
# Phases at which a curve is looked for, in distances of its samples.
PHASES = (0.0, 0.5, 0.25, 0.75)
# The linear systems: relative residual.
LINEAR = 1e-10
# Points of a curve to which distances are taken.
DENSE = 2001
# The parameter's unit is this share of its value.
UNIT = 0.1
# Samples are doubled so many times at most where they do not resolve the curve.
DOUBLINGS = 2


@dataclass(frozen=True, eq=False)
class Circle:
    """An invariant curve with the rotation and the parameter it belongs to.

    Attributes
    ----------
    states : (N, 2 m) array
        (Omega q, q') at the phases i / N.
    rotation : float
        Turns in one application of the map.
    value : float
        Of the parameter: forcing frequency, Hz, or factor on the oscillating loads.
    motions : list of PeriodMotion or None
        From each of them, this rank's; empty for a guess.
    residuals : tuple of float
        Closing errors at each Newton iterate, relative to the states.
    """

    states: np.ndarray
    rotation: float
    value: float
    motions: tuple[PeriodMotion | None, ...] = ()
    residuals: tuple[float, ...] = ()

    @property
    def swing(self) -> float:
        """Root mean square distance of the curve from its middle."""
        return float(np.linalg.norm(self.states - self.states.mean(axis=0))) / np.sqrt(len(self.states))

    @property
    def resolved(self) -> bool:
        """Whether the samples resolve the curve."""
        return spectral_tail(self.states) <= RESOLVED


@dataclass(frozen=True, eq=False)
class OwnTone:
    """The map of one period of the loads, over a parameter, at N points of a curve.

    Attributes
    ----------
    period : Period
    parameter : {"frequency", "load"}
    frequency : float or None
        Forcing frequency, Hz, where the load is the parameter.
    samples : int
        Odd.
    comm : MPI.Comm
        Ranks that share the samples.
    """

    period: Period
    parameter: str
    frequency: float | None
    samples: int
    comm: MPI.Comm

    def conditions(self, value: float) -> tuple[float, float]:
        """Forcing frequency (Hz) and load factor of a value of the parameter."""
        return (value, 1.0) if self.frequency is None else (self.frequency, value)

    def driven(self, value: float) -> DrivenPeriod:
        """The map at a value of the parameter."""
        if not value > 0.0:
            raise SolveError(f"quasi_periodic: the {self.parameter} has become {value:.6g}")
        return self.period.at(*self.conditions(value))

    @functools.cached_property
    def orders(self) -> np.ndarray:
        """(N,) harmonics of the curve, in the order of the discrete Fourier transform."""
        return np.fft.fftfreq(self.samples, 1.0 / self.samples)

    def turned(self, states: np.ndarray, turns: float) -> np.ndarray:
        """The curve's samples at phases further on."""
        return filtered(states, np.exp(2j * np.pi * self.orders * turns))

    def tangents(self, states: np.ndarray, turns: float = 0.0) -> np.ndarray:
        """Derivative of the curve with its phase in turns, at phases further on."""
        return filtered(states, 2j * np.pi * self.orders * np.exp(2j * np.pi * self.orders * turns))

    def resampled(self, states: np.ndarray) -> np.ndarray:
        """A curve of another odd number of samples at this one's phases."""
        return resampled(states, self.samples)

    def require_room(self, owner: str) -> None:
        """Refuse a curve that would take more memory than is free. Collective."""
        orders, steps = len(self.period.excitation.orders), self.period.steps
        require_room(owner, self.period.reduced, self.comm, samples=self.samples, steps=steps, orders=orders)

    def finer(self, owner: str) -> list[OwnTone]:
        """The map with its samples, and with twice and four times as many where there is memory for them.
        Collective.
        """
        found = [self]
        for _ in range(DOUBLINGS):
            more = replace(found[-1], samples=2 * found[-1].samples - 1)
            try:
                more.require_room(owner)
            except ValueError:
                break
            found.append(more)
        return found

    def _images(self, driven: DrivenPeriod, states: np.ndarray):
        return images(self.comm, lambda _: driven, states)

    def _derivatives(self, driven: DrivenPeriod, motions, parameters: tuple[str, ...] = ()) -> CurveMaps:
        return derivatives(self.comm, lambda _: driven, motions, parameters, modes=self.period.modes)

    def _system(
        self, at: Circle, made: CurveMaps, rows: tuple[np.ndarray, np.ndarray], units: tuple[float, float]
    ) -> CurveSystem:
        """For the change of a curve, its rotation and its parameter, in their units."""
        by_rotation = -self.tangents(at.states, at.rotation) / units[0]
        by_value = made.along(0) * (units[1] / units[0])
        border = Border(np.array([by_rotation.ravel(), by_value.ravel()]), np.array(rows))
        return CurveSystem(made, np.exp(2j * np.pi * self.orders * at.rotation), border)

    # ------------------------------------------------------------------ scaled unknowns
    def units(self, circle: Circle) -> tuple[float, float]:
        """Units of the samples, in which a curve is a vector of length one, and of the parameter."""
        return max(float(np.linalg.norm(circle.states - self.period.rest)), 1e-300), UNIT * circle.value

    def packed(self, circle: Circle, units: tuple[float, float]) -> np.ndarray:
        """Samples, rotation and parameter in their units, one vector."""
        return np.concatenate([circle.states.ravel() / units[0], [circle.rotation, circle.value / units[1]]])

    def unpacked(self, vector: np.ndarray, units: tuple[float, float]) -> Circle:
        """The curve of such a vector."""
        states = vector[:-2].reshape(self.samples, -1) * units[0]
        return Circle(states, float(vector[-2]), float(vector[-1] * units[1]))

    # ------------------------------------------------------------------ Newton's method
    def solve(self, guess: Circle, plane: np.ndarray, reference: Circle) -> Circle:
        """The invariant curve in the plane through a guess across a direction.

        Parameters
        ----------
        guess : Circle
        plane : (N 2 m + 2,) array
            In the reference's units.
        reference : Circle
            Whose phase the curve takes, and units.

        Raises
        ------
        SolveError
            If Newton's method does not converge.
        """
        units = self.units(reference)
        begin = self.packed(guess, units)
        phase = np.zeros(len(begin))
        phase[:-2] = self.tangents(reference.states).ravel()
        phase /= np.linalg.norm(phase)
        along = phase @ self.packed(reference, units)
        point, residuals = guess, []
        system: CurveSystem | None = None
        for _ in range(ITERATIONS + 1):
            driven = self.driven(point.value)
            ends, motions = self._images(driven, point.states)
            vector = self.packed(point, units)
            missed = (ends - self.turned(point.states, point.rotation)).ravel() / units[0]
            residual = np.concatenate([missed, [phase @ vector - along, plane @ (vector - begin)]])
            residuals.append(float(np.linalg.norm(residual)))
            if residuals[-1] < CLOSED:
                return replace(point, motions=tuple(motions), residuals=tuple(residuals))
            if not np.isfinite(residuals[-1]) or residuals[-1] > 1e3 * residuals[0]:
                break
            if system is None or residuals[-1] > KEPT * residuals[-2]:
                made = self._derivatives(driven, motions, (self.parameter,))
                system = self._system(point, made, (phase, plane), units)
            point = self.unpacked(vector - system.solve(residual, LINEAR), units)
        raise SolveError(
            f"quasi_periodic: Newton's method did not converge in {len(residuals) - 1} iterations: the "
            f"curve misses itself by {residuals[-1]:.1e} of its size, from {residuals[0]:.1e}; take more "
            "samples or steps, or a motion nearer to the one that is known; or the motion's own tone is "
            "locked to the load there, so that it is periodic over some periods (`periodic(..., periods=n)`)"
        )

    def near(self, guess: Circle, plane: np.ndarray) -> Circle:
        """As `solve` with the guess as the reference, from other phases of the guess if one leads to none: of
        few samples some stand where pairs begin to touch.

        Raises
        ------
        SolveError
            The first one, if Newton's method converges from none.
        """
        failed: SolveError | None = None
        across = plane[:-2].reshape(self.samples, -1)
        for share in PHASES:
            turns = share / self.samples
            begin = replace(guess, states=self.turned(guess.states, turns)) if turns else guess
            try:
                return self.solve(begin, np.append(self.turned(across, turns), plane[-2:]), begin)
            except PetscFailure:
                raise
            except SolveError as error:
                failed = failed or error
        assert failed is not None
        raise failed

    def heading(self, circle: Circle, near: np.ndarray) -> np.ndarray:
        """Direction of unit length, in the curve's units, in which invariant curves follow one another;
        `near` is one not across it.
        """
        units = self.units(circle)
        phase = np.zeros(len(near))
        phase[:-2] = self.tangents(circle.states).ravel()
        phase /= np.linalg.norm(phase)
        driven = self.driven(circle.value)
        made = self._derivatives(driven, circle.motions, (self.parameter,))
        right = np.zeros(len(near))
        right[-1] = 1.0
        found = self._system(circle, made, (phase, near), units).solve(right, LINEAR)
        return found / np.linalg.norm(found)

    def exponents(self, circle: Circle, count: int, turns: int) -> np.ndarray:
        """The largest Lyapunov exponents, 1/s, without that along the curve, which is zero."""
        driven = self.driven(circle.value)
        made = self._derivatives(driven, circle.motions)
        found = exponents(made, circle.rotation, count, turns, self.tangents(circle.states))
        return found / driven.duration

    def strays(self, circle: Circle, periods: int) -> float:
        """Largest distance from a curve, in its swings, of a history that begins between two samples."""
        driven, farthest = self.driven(circle.value), 0.0
        dense = replace(self, samples=DENSE).resampled(circle.states)
        state = self.turned(circle.states, 0.5 / self.samples)[0]
        try:
            for _ in range(periods):
                state = state + driven.run(state).residual
                farthest = max(farthest, float(np.linalg.norm(dense - state, axis=1).min()))
        except SolveError:
            farthest = np.inf
        return self.comm.bcast(farthest / circle.swing)  # ranks may have rounded differently


def first_circle(own: OwnTone, bifurcation: Bifurcation, share: float) -> tuple[Circle, np.ndarray]:
    """A small curve about the periodic motion of a Neimark-Sacker point, and the plane of curves of its size.

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
    wave *= np.sqrt(own.samples) / np.linalg.norm(wave)
    states = bifurcation.state + share * own.period.size(bifurcation.state) * wave
    rotation = float(np.angle(multiplier)) / (2.0 * np.pi)
    plane = np.append(wave.ravel() / np.linalg.norm(wave), [0.0, 0.0])
    return Circle(states, rotation, bifurcation.own_value), plane

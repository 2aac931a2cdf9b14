"""A point of a locus on a family of motions: Newton's method on their surface, or bracketing.

Newton's corrections are split into one that leads back to the surface (the least one) and one within its
tangent plane, in which the multiplier's derivative is taken by differences.

The multiplier is continuous but not smooth over the steps' switches: on top of its course it scatters by some
1e-7. Where it hardly leaves the unit circle otherwise, as that of a mode of which many periods of the load
make one of its own, the scatter turns the slopes around that Newton's method goes by; the root is bracketed
then.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from scipy import linalg
from scipy.optimize import brentq

from .period_map import DrivenPeriod, Period, PeriodMotion
from .stability import multipliers

# Arc length: the state's relative change, the frequency's relative change times this, and the share of the
# second parameter's range, summed as squares; the largest step.
SPAN, LARGEST = 20.0, 0.2
ITERATIONS = 15
# A point is found when the residual, the multiplier's distance from the unit circle and the correction are
# below these.
RESIDUAL, CIRCLE, CORRECTION = 1e-9, 1e-6, 1e-6
# Step of the differences, in units of arc length.
APART = 1e-4
# Corrections of a few such steps that do not shrink to this share are the scatter's; roots are bracketed
# within so many of them to either side.
FEW, SHRINKS, WIDEST = 20.0, 0.5, 64.0


class Family:
    """The periods of a reduced model over the forcing frequency and a second parameter.

    Parameters
    ----------
    period : Period
    parameter : {"load", "damping", "gap"}
    factor : float
        On the oscillating loads, where the second parameter is another.
    """

    def __init__(self, period: Period, parameter: str, factor: float = 1.0):
        self.period, self.parameter, self.factor = period, parameter, factor
        self._kept: tuple[float, Period] = (math.nan, period)

    def at(self, frequency: float, value: float) -> DrivenPeriod:
        """The driven period of both parameters."""
        if self.parameter == "load":
            return self.period.at(frequency, value)
        if self._kept[0] != value:
            p, name = self.period, "initial_gap" if self.parameter == "gap" else "damping"
            reduced = replace(p.reduced, **{name: value * getattr(p.reduced, name)})
            self._kept = value, Period(reduced, p.excitation, p.steps, p.pairs > 0)
        return self._kept[1].at(frequency, self.factor)

    def derivative(self, driven: DrivenPeriod, motion: PeriodMotion, state: np.ndarray, value: float):
        """dx(T) along x(0), the frequency and the second parameter, (2 m, 2 m + 2)."""
        identity = np.eye(len(state))
        if self.parameter == "load":
            return driven.carried(motion, identity, ("frequency", "load"))
        step = 1e-6 * max(abs(value), 1e-3)
        ahead = self.at(driven.frequency, value + step).run(state)
        behind = self.at(driven.frequency, value - step).run(state)
        rate = (ahead.residual - behind.residual) / (2.0 * step)
        return np.column_stack([driven.carried(motion, identity, ("frequency",)), rate])

    def excess(
        self, kind: str, driven: DrivenPeriod, motion: PeriodMotion, value: float, near: complex
    ) -> tuple[float, complex]:
        """How far the multiplier of a kind is from its place, and the multiplier."""
        values = multipliers(driven, motion).values
        if kind == "Neimark-Sacker":
            found = values[values.imag > 1e-9]
            if not found.size:
                raise PointLost("the complex pair has become real")
            nearest = complex(found[np.argmin(np.abs(found - near))])
            return abs(nearest) - 1.0, nearest
        target = 1.0 if kind == "fold" else -1.0
        nearest = complex(values[np.argmin(np.abs(values - target))])
        return nearest.real - target, nearest


@dataclass(frozen=True, eq=False)
class LocusPoint:
    """A point of the locus: scaled state, frequency and factor; the multiplier; iterations."""

    scaled: np.ndarray
    multiplier: complex
    effort: int = 0


class PointLost(Exception):
    """A point was not found."""


class Corrector:
    """Points of a locus from guesses, in scaled unknowns.

    Parameters
    ----------
    family : Family
    kind : str
    extent : float
        Range of the second parameter.
    first : (array, float, float)
        State, frequency and factor that the scales are made of.
    """

    def __init__(self, family: Family, kind: str, extent: float, first: tuple[np.ndarray, float, float]):
        self.family, self.kind = family, kind
        state, frequency, value = first
        size = family.at(frequency, value).period.size(state)
        self.units = np.append(np.full(len(state), size), [frequency / SPAN, max(extent, 1e-300)])

    def correct(self, guess: np.ndarray, normal: np.ndarray, near: complex) -> LocusPoint:
        """The locus' point in the plane through a guess across a direction; `near` is its multiplier.

        Raises
        ------
        PointLost, SolveError, numpy.linalg.LinAlgError
            If none is found.
        """
        y, slopes, size = guess.copy(), None, np.inf
        known: tuple[np.ndarray, float] = (guess, 0.0)
        for iteration in range(1, ITERATIONS + 1):
            residual, matrix = self._motion(y)
            n = len(residual)
            q, r = linalg.qr(matrix.T)
            back = -q[:, :n] @ linalg.solve_triangular(r[:n], residual, trans="T")
            base = y + back
            excess, value = self._excess(base, near)
            if slopes is None:
                basis = q[:, n:]
                slopes = np.array(
                    [(self._excess(base + APART * t, value)[0] - excess) / APART for t in basis.T]
                )
            else:  # what the last step has shown of them
                step = basis.T @ (base - known[0])
                slopes += (excess - known[1] - slopes @ step) * step / (step @ step)
            known = base, excess
            along = np.linalg.solve(
                np.vstack([slopes, normal @ basis]), -np.array([excess, normal @ (base - guess)])
            )
            y = base + basis @ along
            last, size = size, float(np.linalg.norm(back) + np.linalg.norm(along))
            if size > 10.0 * LARGEST:
                raise PointLost("Newton's method leads away")
            if np.linalg.norm(residual) < RESIDUAL and abs(excess) < CIRCLE and size < CORRECTION:
                return LocusPoint(base, value, iteration)
            if SHRINKS * last < size < FEW * APART:
                break
        else:
            raise PointLost(f"not converged in {ITERATIONS} iterations")
        across = basis @ linalg.null_space((normal @ basis)[None])[:, 0]
        base = base - normal * (normal @ (base - guess)) / (normal @ normal)
        return replace(self._bracketed(base, normal, across, value), effort=iteration)

    def _bracketed(
        self, base: np.ndarray, normal: np.ndarray, across: np.ndarray, near: complex
    ) -> LocusPoint:
        """The locus' point in the plane through one near it, by the sign of the excess alone."""
        rows, found = np.vstack([normal, across]), {}

        def excess(distance: float) -> float:
            y = self._on_surface(base + distance * across, rows)
            value, multiplier = self._excess(y, near)
            found[distance] = LocusPoint(y, multiplier), value
            return value

        reach = APART
        while excess(-reach) * excess(reach) > 0.0:
            reach *= 2.0
            if reach > WIDEST * APART:
                raise PointLost("the multiplier does not pass the unit circle beside")
        root = brentq(excess, -reach, reach, xtol=CORRECTION)
        point, value = found[root]
        if abs(value) > CIRCLE:
            raise PointLost("the multiplier jumps over the unit circle, as where a pair begins to touch")
        return point

    def _on_surface(self, guess: np.ndarray, rows: np.ndarray) -> np.ndarray:
        """The motion whose products with two rows are those of a guess."""
        y = guess.copy()
        for _ in range(ITERATIONS):
            residual, matrix = self._motion(y)
            if np.linalg.norm(residual) < RESIDUAL:
                return y
            y -= np.linalg.solve(np.vstack([matrix, rows]), np.append(residual, rows @ (y - guess)))
        raise PointLost("no motion was found beside")

    def _motion(self, scaled: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """x(T) - x(0) and its derivative, (n,) and (n, n + 2), scaled."""
        actual = self._in_range(scaled)
        driven = self.family.at(*actual[-2:])
        motion = driven.run(actual[:-2])
        matrix = self.family.derivative(driven, motion, actual[:-2], float(actual[-1]))
        n = len(actual) - 2
        matrix[:, :n] -= np.eye(n)
        return motion.residual / self.units[0], matrix * (self.units / self.units[0])

    def _excess(self, scaled: np.ndarray, near: complex) -> tuple[float, complex]:
        """How far the locus' function is from zero, and the multiplier."""
        # at an end of the range the differences beside it lie outside
        y = self._in_range(scaled, 2.0 * APART)
        driven = self.family.at(*y[-2:])
        return self.family.excess(self.kind, driven, driven.run(y[:-2]), float(y[-1]), near)

    def _in_range(self, scaled: np.ndarray, slack: float = 0.0) -> np.ndarray:
        """State and parameters; negative damping would let motions grow without bounds."""
        actual = scaled * self.units
        if not (actual[-2] > 0.0 and scaled[-1] >= -slack):
            raise PointLost("the parameters have left their range")
        return actual

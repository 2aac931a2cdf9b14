"""Loci of bifurcations: curves in the plane of the forcing frequency and a second parameter.

With the motions x(T; f, p) - x(0) = 0 a two-dimensional surface over (f, p), a locus is the line on it along
which a multiplier stays on the unit circle. Newton's corrections are split into one that leads back to the
surface (the least one) and one within its tangent plane, in which the multiplier's derivative is taken by
differences; the step along the line is that of pseudo-arclength.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from scipy import linalg

from ..errors import SolveError
from ..writing import write_table
from .period_map import DrivenPeriod, Period, PeriodMotion
from .stability import multipliers

KINDS = ("fold", "period doubling", "Neimark-Sacker", "grazing")
PARAMETERS = ("load", "damping", "gap")
# Arc length of a step: the state's relative change, the frequency's relative change times this, and the share
# of the second parameter's range, summed as squares.
SPAN = 20.0
FIRST, LARGEST, SMALLEST = 0.02, 0.2, 1e-4
ITERATIONS = 15
# A point is found when the residual, the multiplier's distance from the unit circle and the correction are
# below these; the multiplier is continuous but not smooth over the steps' switches.
RESIDUAL, CIRCLE, CORRECTION = 1e-9, 1e-6, 1e-6
# Step of the differences, in units of arc length.
APART = 1e-4
CLOSED = "the line is closed"


@dataclass(frozen=True, eq=False)
class Locus:
    """A bifurcation followed over two parameters.

    Attributes
    ----------
    kind : {"fold", "period doubling", "Neimark-Sacker", "grazing"}
    parameter : {"load", "damping", "gap"}
        The second parameter: a factor on the oscillating loads, all damping ratios, or all initial gaps.
    frequency : (n,) array
        Forcing frequency, Hz.
    value : (n,) array
        The factor.
    states : (n, 2 m) array
        (Omega q, q') at t = 0.
    multiplier : (n,) complex array
        The one on the unit circle; nan for grazing.
    reasons : (str, str)
        Why either end is one.
    periods : int
        Forcing periods in the period of the motion.
    """

    kind: str
    parameter: str
    frequency: np.ndarray
    value: np.ndarray
    states: np.ndarray = field(repr=False)
    multiplier: np.ndarray = field(repr=False)
    reasons: tuple[str, str]
    periods: int = 1

    def __len__(self) -> int:
        return len(self.value)

    def __repr__(self) -> str:
        return (
            f"Locus({self.kind}, {len(self)} points, {self.frequency.min():.7g} to "
            f"{self.frequency.max():.7g} Hz, "
            f"factor on the {self.parameter} {self.value.min():.6g} to {self.value.max():.6g}; ends: "
            f"{self.reasons[0]}; {self.reasons[1]})"
        )

    def to_csv(self, path: str) -> None:
        """Write frequency, factor and multiplier as comma-separated values.

        Raises
        ------
        TypeError, ValueError
            If it cannot be written.
        """
        columns = {
            "frequency_Hz": self.frequency,
            f"{self.parameter}_factor": self.value,
            "multiplier_real": self.multiplier.real,
            "multiplier_imaginary": self.multiplier.imag,
        }
        write_table(path, columns)


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
                raise _Failure("the complex pair has become real")
            nearest = complex(found[np.argmin(np.abs(found - near))])
            return abs(nearest) - 1.0, nearest
        target = 1.0 if kind == "fold" else -1.0
        nearest = complex(values[np.argmin(np.abs(values - target))])
        return nearest.real - target, nearest


@dataclass(frozen=True, eq=False)
class _Point:
    """A point of the locus: scaled state, frequency and factor."""

    scaled: np.ndarray
    multiplier: complex
    effort: int = 0


class _Failure(Exception):
    """A point was not found."""


class _Follower:
    """Predictor and corrector of a locus in scaled unknowns."""

    def __init__(self, family: Family, kind: str, extent: float, first: tuple[np.ndarray, float, float]):
        self.family, self.kind = family, kind
        state, frequency, _ = first
        self.units = np.append(
            np.full(len(state), np.linalg.norm(state)), [frequency / SPAN, max(extent, 1e-300)]
        )

    def excess(self, scaled: np.ndarray, near: complex) -> tuple[float, complex]:
        """How far the locus' function is from zero, and the multiplier."""
        # at an end of the range the differences beside it lie outside
        y = self._in_range(scaled, 2.0 * APART)
        driven = self.family.at(*y[-2:])
        return self.family.excess(self.kind, driven, driven.run(y[:-2]), float(y[-1]), near)

    def _in_range(self, scaled: np.ndarray, slack: float = 0.0) -> np.ndarray:
        """State and parameters; negative damping would let motions grow without bounds."""
        actual = scaled * self.units
        if not (actual[-2] > 0.0 and scaled[-1] >= -slack):
            raise _Failure("the parameters have left their range")
        return actual

    def correct(self, guess: np.ndarray, normal: np.ndarray, near: complex) -> _Point:
        """The locus' point in the plane through a guess across a direction."""
        y, slopes = guess.copy(), None
        known: tuple[np.ndarray, float] = (guess, 0.0)
        for iteration in range(1, ITERATIONS + 1):
            actual = self._in_range(y)
            driven = self.family.at(*actual[-2:])
            motion = driven.run(actual[:-2])
            matrix = self.family.derivative(driven, motion, actual[:-2], float(actual[-1]))
            n = len(actual) - 2
            matrix[:, :n] -= np.eye(n)
            matrix = matrix * (self.units / self.units[0])
            residual = motion.residual / self.units[0]
            q, r = linalg.qr(matrix.T)
            back = -q[:, :n] @ linalg.solve_triangular(r[:n], residual, trans="T")
            base = y + back
            excess, value = self.excess(base, near)
            if slopes is None:
                basis = q[:, n:]
                slopes = np.array(
                    [(self.excess(base + APART * t, value)[0] - excess) / APART for t in basis.T]
                )
            else:  # what the last step has shown of them
                step = basis.T @ (base - known[0])
                slopes += (excess - known[1] - slopes @ step) * step / (step @ step)
            known = base, excess
            along = np.linalg.solve(
                np.vstack([slopes, normal @ basis]), -np.array([excess, normal @ (base - guess)])
            )
            y = base + basis @ along
            size = float(np.linalg.norm(back) + np.linalg.norm(along))
            if size > 10.0 * LARGEST:
                raise _Failure("Newton's method leads away")
            if np.linalg.norm(residual) < RESIDUAL and abs(excess) < CIRCLE and size < CORRECTION:
                return _Point(base, value, iteration)
        raise _Failure(f"not converged in {ITERATIONS} iterations")


class LocusStart(NamedTuple):
    """A motion at a bifurcation.

    Attributes
    ----------
    state : (2 m,) array
    frequency : float
        Hz.
    value : float
        Of the second parameter.
    multiplier : complex
        The one on the unit circle; nan for grazing.
    """

    state: np.ndarray
    frequency: float
    value: float
    multiplier: complex


def follow_locus(
    family: Family,
    kind: str,
    first: LocusStart,
    *,
    limits: tuple[float, float],
    points: int,
    report: Callable[[float], None] | None = None,
) -> Locus:
    """Follow a bifurcation over the frequency and a second parameter, from a known point to both sides.

    Parameters
    ----------
    family : Family
    kind : {"fold", "period doubling", "Neimark-Sacker", "grazing"}
    first : LocusStart
        Close to the locus.
    limits : (float, float)
        Of the second parameter, between which the locus is followed.
    points : int
        To either side, at most.
    report : callable, optional
        Called with the fraction done.

    Raises
    ------
    SolveError
        If no point is found near the first one.
    """
    lower, upper = limits
    follower = _Follower(family, kind, upper - lower, (first.state, first.frequency, first.value))
    guess = np.append(first.state, [first.frequency, first.value]) / follower.units
    last = np.eye(len(guess))[-1]
    near = first.multiplier if first.multiplier.imag >= 0.0 else first.multiplier.conjugate()
    try:
        # a fold's locus may run along the parameter's axis, the frequency then takes its place
        start = _any_plane(follower, guess, near)
    except (_Failure, SolveError, np.linalg.LinAlgError) as failure:
        raise SolveError(
            f"locus: no {kind} was found near {first.frequency:.8g} Hz and the factor {first.value:.6g}: "
            f"{failure}"
        ) from None
    sides, reasons = [], []
    for number, sign in enumerate((-1.0, 1.0)):
        if CLOSED in reasons:
            sides.append([start])
            reasons.append(CLOSED)
            break
        found, reason = _side(follower, start, sign * last, limits, points)
        sides.append(found)
        reasons.append(reason)
        if report is not None:
            report(0.5 * (number + 1))
    line = [*reversed(sides[0]), start, *sides[1]]
    y = np.array([p.scaled for p in line]) * follower.units
    return Locus(
        kind,
        family.parameter,
        y[:, -2].copy(),
        y[:, -1].copy(),
        y[:, :-2].copy(),
        np.array([p.multiplier for p in line]),
        (reasons[0], reasons[1]),
        family.period.excitation.periods,
    )


def _closed(line: list[_Point]) -> bool:
    """Whether the last step has passed the first point in the direction in which the line began."""
    if len(line) < 6:
        return False
    begin, before, last = line[0].scaled, line[-2].scaled, line[-1].scaled
    step, first = last - before, line[1].scaled - begin
    share = step @ (begin - before) / (step @ step)
    aside = np.linalg.norm(before + share * step - begin)
    return 0.0 < share <= 1.0 and step @ first > 0.0 and aside < 0.2 * np.linalg.norm(step)


def _any_plane(follower: _Follower, guess: np.ndarray, near: complex) -> _Point:
    """The first point, with the second parameter held, or the frequency."""
    try:
        return follower.correct(guess, np.eye(len(guess))[-1], near)
    except (_Failure, SolveError, np.linalg.LinAlgError):
        return follower.correct(guess, np.eye(len(guess))[-2], near)


def _side(
    follower: _Follower, start: _Point, direction: np.ndarray, limits: tuple[float, float], points: int
) -> tuple[list[_Point], str]:
    """Points from the start on towards a direction, and why the last is the last."""
    unit = follower.units[-1]
    line, length, reason = [start], FIRST, ""
    while len(line) <= points:
        if len(line) > 1:
            direction = line[-1].scaled - line[-2].scaled
            direction = direction / np.linalg.norm(direction)
        while True:
            guess = line[-1].scaled + length * direction
            normal, end = direction, None
            if not limits[0] < guess[-1] * unit < limits[1]:
                end = limits[0] if guess[-1] * unit <= limits[0] else limits[1]
                share = (end / unit - line[-1].scaled[-1]) / direction[-1] if direction[-1] else 0.0
                if share <= 1e-9:
                    return line[1:], f"end of the range at {end:g}"
                guess, normal = line[-1].scaled + share * direction, np.eye(len(guess))[-1]
                guess[-1] = end / unit
            try:
                point = follower.correct(guess, normal, line[-1].multiplier)
                step = point.scaled - line[-1].scaled
                if len(line) > 1 and step @ direction < 0.5 * np.linalg.norm(step):
                    raise _Failure("it turns too sharply")
                break
            except (_Failure, SolveError, np.linalg.LinAlgError) as failure:
                reason = str(failure)
                length *= 0.5
                if length < SMALLEST:
                    value = line[-1].scaled[-1] * unit
                    return line[1:], f"no further point beyond the factor {value:.6g}: {reason}"
        line.append(point)
        if _closed(line):
            return line[1:-1], CLOSED
        if end is not None:
            return line[1:], f"end of the range at {end:g}"
        length = min(LARGEST, length * (1.5 if point.effort <= 5 else 0.8))
    return line[1:], f"{points} points"

"""Loci of bifurcations: curves in the plane of the forcing frequency and a second parameter.

With the motions x(T; f, p) - x(0) = 0 a two-dimensional surface over (f, p), a locus is the line on it along
which a multiplier stays on the unit circle. It is followed by pseudo-arclength; how a point is found is in
`locus_point`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from ..errors import SolveError
from ..writing import write_table
from .locus_point import LARGEST, Corrector, Family, LocusPoint, PointLost

KINDS = ("fold", "period doubling", "Neimark-Sacker", "grazing")
PARAMETERS = ("load", "damping", "gap")
# Arc length of a step.
FIRST, SMALLEST = 0.02, 1e-4
CLOSED, AT_END = "the line is closed", "end of the range"


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
    follower = Corrector(family, kind, upper - lower, (first.state, first.frequency, first.value))
    guess = np.append(first.state, [first.frequency, first.value]) / follower.units
    last = np.eye(len(guess))[-1]
    near = first.multiplier if first.multiplier.imag >= 0.0 else first.multiplier.conjugate()
    try:
        # a fold's locus may run along the parameter's axis, the frequency then takes its place
        start = _any_plane(follower, guess, near)
    except (PointLost, SolveError, np.linalg.LinAlgError) as failure:
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


def _closed(line: list[LocusPoint]) -> bool:
    """Whether the last step has passed the first point in the direction in which the line began."""
    if len(line) < 6:
        return False
    begin, before, last = line[0].scaled, line[-2].scaled, line[-1].scaled
    step, first = last - before, line[1].scaled - begin
    share = step @ (begin - before) / (step @ step)
    aside = np.linalg.norm(before + share * step - begin)
    return 0.0 < share <= 1.0 and step @ first > 0.0 and aside < 0.2 * np.linalg.norm(step)


def _any_plane(follower: Corrector, guess: np.ndarray, near: complex) -> LocusPoint:
    """The first point, with the second parameter held, or the frequency."""
    try:
        return follower.correct(guess, np.eye(len(guess))[-1], near)
    except (PointLost, SolveError, np.linalg.LinAlgError):
        return follower.correct(guess, np.eye(len(guess))[-2], near)


def _side(
    follower: Corrector, start: LocusPoint, direction: np.ndarray, limits: tuple[float, float], points: int
) -> tuple[list[LocusPoint], str]:
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
                    return line[1:], f"{AT_END} at {end:g}"
                guess, normal = line[-1].scaled + share * direction, np.eye(len(guess))[-1]
                guess[-1] = end / unit
            try:
                point = follower.correct(guess, normal, line[-1].multiplier)
                step = point.scaled - line[-1].scaled
                if len(line) > 1 and step @ direction < 0.5 * np.linalg.norm(step):
                    raise PointLost("it turns too sharply")
                break
            except (PointLost, SolveError, np.linalg.LinAlgError) as failure:
                reason = str(failure)
                length *= 0.5
                if length < SMALLEST:
                    value = line[-1].scaled[-1] * unit
                    return line[1:], f"no further point beyond the factor {value:.6g}: {reason}"
        line.append(point)
        if _closed(line):
            return line[1:-1], CLOSED
        if end is not None:
            return line[1:], f"{AT_END} at {end:g}"
        length = min(LARGEST, length * (1.5 if point.effort <= 5 else 0.8))
    return line[1:], f"{points} points"

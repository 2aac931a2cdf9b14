"""Branches of quasi-periodic motions with a tone of their own: invariant curves by continuation."""

from __future__ import annotations

import functools
import math
from dataclasses import replace
from typing import ClassVar

import numpy as np

from ...errors import failed_solve
from ...motion.states import Point as Place
from ...record.record import derived, described, of_each, quantity
from ..events import refine
from ..follow import CLOSED, Line, Settings, points_of, ran_out
from ..line_file import LineFile
from ..orbit import UNASKED
from ..problem import Point, Range
from .driven_orbits import OverParameter
from .own_tone import beginning
from .tones import QuasiPeriodic, attracts, own_motion

# How a branch is followed; the first step is so long, relative to the first curve's swing.
PACE, FIRST = Settings(points=60, largest=0.2, smallest=1e-4, growth=1.5), 0.5
# Ways as short as this are not divided: of curves nearer than half of it the switches of pairs from one step
# of time to another tell more than the branch.
NOISE = 0.04
# How far a branch may first lead away from where it is to go, as a share of its parameter.
EXCURSION = 0.02


# Multiples of both tones of the lines in tables.
MAIN = {"f1": (1, 0), "f2": (0, 1), "f1_plus_f2": (1, 1), "f1_minus_f2": (1, -1)}

_over_points = of_each("motions", QuasiPeriodic, "point")


@described
class QuasiPeriodicBranch(OverParameter):
    """A branch of quasi-periodic motions with a tone of their own, in order of arc length."""

    labels: ClassVar = {"place": "points", "tone": "tones", "line": "main"}
    coordinates: ClassVar = ("value", "frequencies", "stable")
    # names of the tones, and of the lines that tables have
    tones = "f1", "f2"
    main = tuple(MAIN)

    motions: tuple[QuasiPeriodic, ...] = quantity(text="in order", part="QuasiPeriodic", detail=True)
    reason: str = quantity(text="why the curve ends")
    complete: bool = quantity("1", "whether it reached the end of the range, or has closed", row=True)

    def check(self) -> None:
        """Raise ValueError unless motions and values belong together."""
        fits = len(self.motions) == len(self.value) > 0
        for motion, value in zip(self.motions, self.value.tolist()):
            own = motion.own
            fits &= own is not None and own.parameter == self.parameter and motion.points == self.points
            fits &= self.parameter == "frequency" or getattr(own, self.parameter) == value
        if not fits:
            raise ValueError(f"it is over {self.parameter!r} and has {len(self.motions)} motions")

    @property
    def points(self) -> tuple[str, ...]:
        """Named points."""
        return self.motions[0].points

    frequencies = _over_points("frequencies", text="f1 and the motion's own f2")

    @derived("1", "whether small disturbances die out", "point", kinds="b")
    def stable(self) -> np.ndarray:
        """(n,) bool; False where it is not known: not asked for, or not resolved by the samples."""
        return np.array([motion.resolved and motion.stable is True for motion in self.motions])

    @property
    def unstable(self) -> np.ndarray:
        """(n,) bool: whether small disturbances grow, or the samples do not resolve the motion, which is none
        then.
        """
        return np.array([not motion.resolved or motion.stable is False for motion in self.motions])

    @property
    def stability_known(self) -> bool:
        """Whether stability was asked for."""
        return any(len(motion.exponents) for motion in self.motions)

    tail = _over_points("tail")
    contact_peak = _over_points("contact_peak")

    def line(self, m: int, n: int, point: Place, direction: str = "y") -> np.ndarray:
        """(n,) complex amplitudes at m f1 + n f2, m, of a named point, or of any point (x, y) in m.
        Collective for (x, y).
        """
        return np.array([motion.line(m, n, point, direction) for motion in self.motions])

    @derived("m", "amplitudes of u_y at the main lines", "point line place", called="amplitude")
    def amplitudes(self) -> np.ndarray:
        """(n, 4, points): at f1, f2, f1 + f2 and f1 - f2."""
        lines = [np.abs([self.line(*of, name) for name in self.points]) for of in MAIN.values()]
        return np.moveaxis(np.reshape(lines, (len(MAIN), len(self.points), len(self))), -1, 0)

    def __repr__(self) -> str:
        own = self.frequencies[:, 1]
        verdict = f"{self.unstable.sum()} unstable" if self.stability_known else UNASKED
        return (
            f"QuasiPeriodicBranch({points_of(len(self))} over {self.parameter} {self.value.min():.6g} to "
            f"{self.value.max():.6g}, own tone {own.min():.6g} to {own.max():.6g} Hz, "
            f"{verdict}, {self.reason})"
        )


def follow_curves(
    line: Line, stop: float, pace: Settings, *, stability: bool, run: LineFile
) -> QuasiPeriodicBranch:
    """Invariant curves from one on.

    Parameters
    ----------
    line : Line
        With the first curve, see `line_from`, or those of a former run.
    stop : float
        Value of the parameter at which the branch ends.
    pace : Settings
    stability : bool
        Compute exponents; behind a motion that a history stays with the branch ends before one that it
        leaves.
    run : LineFile
    """
    first = line.points[0]
    reach = max(EXCURSION * first.value, abs(stop - first.value))
    # a subcritical branch first leads away, and comes back through a fold
    ends = (first.value - reach, stop) if stop > first.value else (stop, first.value + reach)
    within = Range(*ends, 1 if stop > first.value else -1)
    swing = first.state.swing * math.sqrt(len(first.state.states))
    pace = replace(pace, first=FIRST * swing / first.state.scale)
    tell = functools.partial(_tell, line, stability)

    def share(value: float) -> float:
        return abs(value - first.value) / abs(stop - first.value)

    if run.follow([line], within, pace, lambda: _branch(line, stop), share, tell):
        _finish(line, stability)
    result = _branch(line, stop)
    run.update(lambda: result, [line], last=True)
    run.report(1.0)
    return result


def line_from(point: Point, growing: bool) -> Line:
    """A line that begins with a curve, by as many samples as resolve it, in the direction in which it grows,
    or else in that in which its value goes to the line's end.

    Raises
    ------
    SolveError
        If no samples resolve it.
    """
    if not point.state.resolved:
        found = point.problem.resolved(point, 0.0 * point.u)
        if found is None:
            raise failed_solve(f"quasi_periodic: {point.problem.unresolved(point)}")
        point = found
    return Line([beginning(point, point.problem.growing(point.u) if growing else None)])


def _tell(line: Line, stability: bool, point: Point) -> str | None:
    """Note the motion of a point; why the line ends before it where a history leaves it behind motions that
    histories have stayed with.
    """
    known = point.state.recorded is not None
    _tell_motion(stability, point)
    if known:
        return None
    *former, last = line.told("motions")
    if last.resolved or not any(attracts(motion) and motion.resolved for motion in former):
        return None
    return (
        f"no further curve at {line.points[-2].value:.8g}: histories from the next one leave "
        "it, though its exponents are negative: the tone locks, or more samples or steps are needed"
    )


def _tell_motion(stability: bool, point: Point) -> None:
    """Note the motion of a point."""
    point.told = {"motions": own_motion(point, stability)}


def _finish(line: Line, stability: bool) -> None:
    """Finer points where the tone's amplitude bends, but for those that a history leaves."""
    if ran_out(line.reason):
        return
    if not line.complete and line.advice not in line.reason:
        line.reason += f"; {line.advice}"
    names, followed = line.points[0].problem.period.reduced.points.names, list(line.points)

    def amplitudes() -> np.ndarray:
        lines = [[abs(motion.line(0, 1, name)) for name in names] for motion in line.told("motions")]
        return np.array(lines).T

    extent = float(np.ptp(line.values)) or 1.0
    refine(line, lambda: line.values / extent, amplitudes, functools.partial(_tell_motion, stability), NOISE)
    line.points[:] = [point for point in line.points if point.told["motions"].resolved or point in followed]


def _branch(line: Line, stop: float) -> QuasiPeriodicBranch:
    """The branch as it is."""
    values, motions = line.values, tuple(line.told("motions"))
    complete = bool(values[-1] == stop) or line.reason == CLOSED
    parameter = line.points[0].problem.tone.parameter
    return QuasiPeriodicBranch(parameter, values, motions, line.reason or "unfinished", complete)

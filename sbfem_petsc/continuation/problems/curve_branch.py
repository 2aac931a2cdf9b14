"""Branches of quasi-periodic motions with a tone of their own: invariant curves by continuation."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np

from ...checks import names_of
from ...errors import SolveError, on_all_ranks
from ...writing import write_table
from ..events import refine
from ..follow import CLOSED, Follower, Line, Settings
from ..problem import Point, Range
from .own_tone import beginning
from .tones import QuasiPeriodic, attracts, own_motion, told_motion

# How a branch is followed; the first step is so long, relative to the first curve's swing.
PACE, FIRST = Settings(points=60, largest=0.2, smallest=1e-4, growth=1.5), 0.5
# Ways as short as this are not divided: of curves nearer than half of it the switches of pairs from one step
# of time to another tell more than the branch.
NOISE = 0.04
# How far a branch may first lead away from where it is to go, as a share of its parameter.
EXCURSION = 0.02


@dataclass(frozen=True, eq=False)
class QuasiPeriodicBranch:
    """A branch of quasi-periodic motions with a tone of their own, in order of arc length.

    Attributes
    ----------
    parameter : {"frequency", "load", "damping", "gap"}
    value : (n,) array
        Forcing frequency (Hz), or factor on the oscillating loads, all damping ratios or all gaps.
    motions : tuple of QuasiPeriodic
    reason : str
        Why it ends.
    complete : bool
        Whether it reached the end of the range, or has closed.
    """

    parameter: str
    value: np.ndarray
    motions: tuple[QuasiPeriodic, ...]
    reason: str
    complete: bool

    def __len__(self) -> int:
        return len(self.motions)

    @property
    def frequencies(self) -> np.ndarray:
        """(n, 2): f1 and the motion's own f2, Hz."""
        return np.array([motion.frequencies for motion in self.motions])

    @property
    def stable(self) -> np.ndarray:
        """(n,) bool; True throughout where stability was not asked for, but for motions that their samples do
        not resolve, which are none.
        """
        return np.array([motion.resolved and motion.stable is not False for motion in self.motions])

    @property
    def tail(self) -> np.ndarray:
        """(n,) share of the highest quarter of the harmonics of the samples, `QuasiPeriodic.tail`."""
        return np.array([motion.tail for motion in self.motions])

    def _furthest(self, least: float = 0.0) -> float:
        """Largest displacement of a named point by its lines, m; less than `least` where that is known to be
        so.
        """
        return max((motion._furthest(least) for motion in self.motions), default=0.0)

    def line(self, m: int, n: int, point: str, direction: str = "y") -> np.ndarray:
        """(n,) complex amplitudes at m f1 + n f2, m."""
        return np.array([motion.line(m, n, point, direction) for motion in self.motions])

    def to_csv(self, path: str, points: tuple[str, ...] | None = None) -> None:
        """Write parameter, frequencies, verdict and the main lines of points (default: all) as
        comma-separated values.

        Raises
        ------
        TypeError, ValueError, KeyError
            If it cannot be written, or for an unknown point.
        """
        columns = {
            "frequency_Hz" if self.parameter == "frequency" else f"{self.parameter}_factor": self.value,
            "first_Hz": self.frequencies[:, 0],
            "own_Hz": self.frequencies[:, 1],
            "stable": self.stable.astype(int),
            "tail": self.tail,
        }
        for point in self.motions[0].points if points is None else names_of("to_csv", "points", points):
            for name, line in (
                ("f1", (1, 0)),
                ("f2", (0, 1)),
                ("f1_plus_f2", (1, 1)),
                ("f1_minus_f2", (1, -1)),
            ):
                columns[f"{name}_y_{point}_m"] = np.abs(self.line(*line, point))
        write_table(path, columns)

    def __repr__(self) -> str:
        own = self.frequencies[:, 1]
        return (
            f"QuasiPeriodicBranch({len(self)} points over {self.parameter} {self.value.min():.6g} to "
            f"{self.value.max():.6g}, own tone {own.min():.6g} to {own.max():.6g} Hz, "
            f"{int((~self.stable).sum())} unstable, {self.reason})"
        )


class BranchRecorder(Protocol):
    """Keeps a branch while it is followed."""

    def lines(self, problem: Any) -> list[Line]:
        """The branch of a former run that is resumed."""

    def update(self, result: Callable[[], Any], lines: Sequence[Line], last: bool = False) -> None:
        """Keep what has been found so far."""


def follow_curves(
    line: Line,
    stop: float,
    pace: Settings,
    *,
    stability: bool,
    recorder: BranchRecorder | None = None,
    report: Callable[[float], None] | None = None,
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
    recorder : BranchRecorder, optional
    report : callable, optional
        Called with the fraction done.
    """
    branch = _Branch(line, stop, stability)
    if not line.reason or line.reason.endswith(" points"):  # otherwise a former run has come to its end
        for point in Follower(line, branch.within, branch.settings(pace)):
            if not branch.add(line.points[-1], len(line.points) - 1):
                break
            if recorder is not None:
                recorder.update(branch.result, [line])
            if report is not None:
                report(min(1.0, abs(point.value - line.points[0].value) / abs(stop - line.points[0].value)))
        branch.finish()
    result = branch.result()
    if recorder is not None:
        recorder.update(lambda: result, [line], last=True)
    if report is not None:
        report(1.0)
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
            raise on_all_ranks(SolveError(f"quasi_periodic: {point.problem.unresolved(point)}"))
        point = found
    return Line([beginning(point, point.problem.growing(point.u) if growing else None)])


class _Branch:
    """What is told of a line while it is followed."""

    def __init__(self, line: Line, stop: float, stability: bool):
        self.line, self.stop, self.stability = line, stop, stability
        self.motions = [
            own_motion(point, stability) if point.state.told is None else told_motion(point)
            for point in line.points
        ]
        first = line.points[0].value
        reach = max(EXCURSION * first, abs(stop - first))
        # a subcritical branch first leads away, and comes back through a fold
        lower, upper = (first - reach, stop) if stop > first else (stop, first + reach)
        self.within = Range(lower, upper, 1 if stop > first else -1)

    def settings(self, pace: Settings) -> Settings:
        """With the length of the first step."""
        state = self.line.points[0].state
        return replace(pace, first=FIRST * state.swing * math.sqrt(len(state.states)) / state.scale)

    def add(self, point: Point, place: int) -> bool:
        """Tell of a point; False, and the line ends before it, where a history leaves it behind motions that
        histories have stayed with.
        """
        motion = own_motion(point, self.stability)
        if not motion.resolved and any(attracts(item) and item.resolved for item in self.motions[:place]):
            self.line.points.pop(place)
            self.line.reason = (
                f"no further curve at {self.line.points[-1].value:.8g}: histories from the next one leave "
                "it, though its exponents are negative: the tone locks, or more samples or steps are needed"
            )
            return False
        self.motions.insert(place, motion)
        return True

    def finish(self) -> None:
        """Finer points where the tone's amplitude bends, but for those that a history leaves."""
        line = self.line
        if line.reason.endswith(" points"):
            return
        if not line.complete and line.advice not in line.reason:
            line.reason += f"; {line.advice}"
        names, followed = line.points[0].problem.period.reduced.points.names, list(self.motions)

        def amplitudes() -> np.ndarray:
            lines = [[abs(motion.line(0, 1, name)) for name in names] for motion in self.motions]
            return np.array(lines).T

        def add(point: Point, place: int) -> None:
            self.motions.insert(place, own_motion(point, self.stability))

        extent = float(np.ptp(line.values)) or 1.0
        refine(line, lambda: line.values / extent, amplitudes, add, NOISE)
        kept = [motion.resolved or motion in followed for motion in self.motions]
        line.points[:] = [point for point, keep in zip(line.points, kept) if keep]
        self.motions = [motion for motion, keep in zip(self.motions, kept) if keep]

    def result(self) -> QuasiPeriodicBranch:
        """The branch as it is."""
        line, values = self.line, self.line.values
        complete = bool(values[-1] == self.stop) or line.reason == CLOSED
        own, reason = line.points[0].problem.tone, line.reason or "unfinished"
        return QuasiPeriodicBranch(own.parameter, values, tuple(self.motions), reason, complete)

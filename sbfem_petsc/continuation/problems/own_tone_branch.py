"""Branches of quasi-periodic motions with a tone of their own, by pseudo-arclength continuation of invariant
curves.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...checks import names_of
from ...errors import PetscFailure, SolveError
from ...writing import write_table
from .own_tone import Circle, OwnTone
from .tones import QuasiPeriodic
from .torus import RESOLVED, spectral_tail

# Steps in units of the curve: the first one relative to its swing, the largest, the smallest.
FIRST, LARGEST, SMALLEST = 0.5, 0.2, 1e-4
# Newton iterations of a step after which the next one may be longer, and the cosine of a turn between two
# that is too sharp.
COMFORT, TURN = 5, 0.5
# Of the swing of the curve before: a curve that is none any more.
SHRUNK = 0.1
# Curves nearer than this give no direction: the switches of pairs from one step of time to another move them.
NOISE = 0.02
# How far a branch may first lead away from where it is to go, as a share of its parameter.
EXCURSION = 0.02


@dataclass(frozen=True, eq=False)
class QuasiPeriodicBranch:
    """A branch of quasi-periodic motions with a tone of their own, in order of arc length.

    Attributes
    ----------
    parameter : {"frequency", "load"}
    value : (n,) array
        Forcing frequency (Hz) or factor on the oscillating loads.
    motions : tuple of QuasiPeriodic
    reason : str
        Why it ends.
    complete : bool
        Whether it reached the end of the range.
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
            "frequency_Hz" if self.parameter == "frequency" else "load_factor": self.value,
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


def follow_circles(
    maps: Sequence[OwnTone],
    first: Circle,
    stop: float,
    *,
    points: int,
    largest_step: float = math.inf,
    report: Callable[[float], None] | None = None,
) -> tuple[list[Circle], str]:
    """Invariant curves from a converged one on, in the direction in which they grow, and why the last is one.

    Parameters
    ----------
    maps : sequence of OwnTone
        With more and more samples; where those of one no longer resolve the curve the next is taken.
    first : Circle
        With its trajectories, of the first map's samples.
    stop : float
        Value of the parameter at which the branch ends.
    points : int
        Most curves.
    largest_step : float
        Largest change of the parameter from one to the next.
    report : callable, optional
        Called with the fraction done.

    Raises
    ------
    SolveError
        If no map's samples resolve the first curve.
    """
    own, *finer = maps
    if not first.resolved:
        own, first, _ = _resolved(finer, first, np.eye(1, first.states.size + 2, first.states.size + 1)[0])
    extent = abs(stop - first.value)
    reach = max(EXCURSION * abs(first.value), extent)
    # a subcritical branch first leads away, and comes back through a fold
    lower, upper = (first.value - reach, stop) if stop > first.value else (stop, first.value + reach)
    found, since = [first], 0
    direction = _growing(own, first)
    length = FIRST * first.swing / (np.linalg.norm(first.states - own.period.rest) / math.sqrt(own.samples))
    while len(found) < points:
        last = found[-1]
        units = own.units(last)
        here = own.packed(last, units)
        for other in reversed(found[since:-1]):
            secant = here - own.packed(other, units)
            direction = secant / np.linalg.norm(secant)
            if np.linalg.norm(secant) > NOISE:
                break
        step = min(length, LARGEST, largest_step / (units[1] * max(abs(direction[-1]), 1e-300)))
        while True:  # until a step is short enough
            target = last.value + step * direction[-1] * units[1]
            end, plane = None, direction
            if not lower < target < upper:
                end = lower if target <= lower else upper
                step, plane = (
                    (end - last.value) / (direction[-1] * units[1]),
                    np.eye(1, len(here), len(here) - 1)[0],
                )
            guess = own.unpacked(here + step * direction, units)
            if end is not None:
                guess = replace(guess, value=end)
            try:
                point = own.solve(guess, plane, last)
                chord = own.packed(point, units) - here
                if point.swing < SHRUNK * last.swing:  # a point is an invariant curve as well
                    raise SolveError("it shrinks onto the periodic motion")
                if step > NOISE and chord @ direction < TURN * np.linalg.norm(chord):
                    raise SolveError("it turns too sharply")
                if not point.resolved and not finer:
                    raise SolveError(unresolved(point))
                break
            except PetscFailure:
                raise
            except SolveError as error:
                step *= 0.5
                if step < SMALLEST:
                    return found, f"no further curve at {last.value:.8g}: {error}"
        if not point.resolved:
            try:
                own, found[-1], direction = _resolved(finer, last, direction)
                since = len(found) - 1
            except PetscFailure:
                raise
            except SolveError:  # shorter steps then
                finer.clear()
            continue
        if _through_the_middle(last, point):
            return found, f"it shrinks onto the periodic motion at {point.value:.8g}"
        found.append(point)
        length = step * (1.5 if len(point.residuals) <= COMFORT else 0.8)
        if report is not None:
            report(min(1.0, abs(point.value - first.value) / extent))
        if end is not None:
            found[-1] = replace(point, value=end)  # but for rounding it is
            return found, f"end of the range at {end:.8g}"
    return found, f"{points} points"


def unresolved(circle: Circle) -> str:
    """Why a curve is none."""
    return (
        f"{len(circle.states)} samples do not resolve it, {spectral_tail(circle.states):.2g} of it is in the "
        f"highest quarter of their harmonics, more than {RESOLVED:g}: the tone locks, or more samples or "
        "steps are needed"
    )


def _resolved(
    finer: list[OwnTone], circle: Circle, direction: np.ndarray
) -> tuple[OwnTone, Circle, np.ndarray]:
    """The first of finer maps, which is taken from the list, whose samples resolve a curve, the curve and the
    branch's direction there.
    """
    problem = unresolved(circle)
    while finer:
        own = finer.pop(0)
        guess = Circle(own.resampled(circle.states), circle.rotation, circle.value)
        along = own.resampled(direction[:-2].reshape(circle.states.shape)) * math.sqrt(
            len(circle.states) / own.samples
        )
        plane = np.append(along, direction[-2:])
        plane /= np.linalg.norm(plane)
        try:
            point = own.near(guess, plane)
            if point.resolved:
                heading = own.heading(point, plane)
                return own, point, heading if heading @ plane > 0.0 else -heading
            problem = unresolved(point)
        except PetscFailure:
            raise
        except SolveError as error:
            problem = str(error)
    raise SolveError(f"quasi_periodic: the curve at {circle.value:.8g} is not resolved: {problem}")


def _growing(own: OwnTone, circle: Circle) -> np.ndarray:
    """The branch's direction in which the curve grows."""
    outwards = np.append((circle.states - circle.states.mean(axis=0)).ravel(), [0.0, 0.0])
    outwards /= np.linalg.norm(outwards)
    heading = own.heading(circle, outwards)
    return heading if heading @ outwards > 0.0 else -heading


def _through_the_middle(one: Circle, other: Circle) -> bool:
    """Whether a curve has passed the periodic motion: it is then another one begun half a turn later."""
    return bool(
        ((one.states - one.states.mean(axis=0)) * (other.states - other.states.mean(axis=0))).sum() < 0.0
    )

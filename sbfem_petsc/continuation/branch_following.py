"""Follows a branch of periodic motions: what is kept of each point, finer points where it bends, its end."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from meshing.warnings import BranchWarning

from ..contact.law import peak_of
from ..errors import SolveError, on_all_ranks, warn, wrong_input
from ..motion.contact_work import StepsTooLong, times_more, warn_of_contact_work
from ..motion.excitation import one_sided
from ..motion.period_map import Period
from .bifurcations import Bifurcation, by_steps, locate, unlocated
from .branch import Branch
from .events import Way, insert, refine, turns_twice
from .extrapolation import uncertainty_at
from .follow import CLOSED, Follower, Line, Settings, points_of
from .harmonic_errors import harmonic_error_estimates
from .line_file import LineFile
from .multipliers import FLOOR, ambiguous, excursion, hurried, passages
from .orbit import LOWEST, NEAR, largest_error
from .problem import Point, Range
from .problems.driven_orbits import Orbits, ParameterRange, distances, minimal_periods
from .problems.unreduced import UnreducedOrbits

# Harmonics kept of every point.
HARMONICS = 20
# Frequencies of a linear response: so many over the range, and so many about each resonance.
EVEN, ABOUT = 201, 41
# A stretch with a period doubling and a fold in it is halved so often at most.
HALVINGS = 8
# Step along a branch, relative to the state, by which its distance from shorter motions is differentiated.
DIFFERENCE = 1e-4
# The multipliers' uncertainty is measured at every so many points, and where the largest modulus is off 1 by
# no more than so many times that of its neighbours.
SPARSE, FAR = 32, 5.0
# Each meeting of few pairs that is gained or lost between two points may make multipliers jump, and is
# enclosed up to this share of the value.
ENCLOSED = 1e-3
# A branch that first leads away from its range may do so by this share of the parameter or of the range.
EXCURSION = 0.02
# Errors of harmonics that nobody has asked for.
NOT_TOLD = np.full(LOWEST, np.nan)


@dataclass(frozen=True)
class BranchSettings(Settings):
    """How a branch of periodic motions is followed.

    Attributes
    ----------
    points, largest_step, first, largest, smallest, growth, turn
        See `Settings`.
    stability : bool
        Whether Floquet multipliers and bifurcations are computed.
    leave : bool
        The first motion is next to a period doubling, and the branch goes away from it.
    most_steps : int
        Steps of the period which may be halved up to these, for the whole branch, where contact does work.
    more : str
        How there could be more points, for the warning of a branch that ends after so many.
    """

    stability: bool = True
    leave: bool = False
    most_steps: int = 0
    more: str = "raise points"


@dataclass(frozen=True)
class Followed:
    """A branch that has been followed.

    Attributes
    ----------
    problem : Orbits or UnreducedOrbits
    settings : BranchSettings
    line : Line
    new : bool
        Whether it is not one that a former run has come to the end of.
    worst : Point
        The least accurate of those that are judged.
    told : (3, 5) array
        What is told of its errors.
    errors : (5,) array
        The largest errors of harmonics of any of them.
    """

    problem: Orbits | UnreducedOrbits
    settings: BranchSettings
    line: Line
    new: bool
    worst: Point
    told: np.ndarray
    errors: np.ndarray

    @property
    def stops(self) -> bool:
        """Whether it has come to a stop within the range."""
        line = self.line
        return not (line.complete or line.full or line.reason.startswith("back"))

    def ended(self, run: LineFile, missing: str = "") -> Branch:
        """The branch with what is told of it as a whole; bifurcations are not located where that is missing
        of its accuracy.

        Raises
        ------
        SolveError
            If it comes to a stop within the range; the points so far are the error's attribute `branch`.

        Warns
        -----
        BranchWarning
            If it ends after the most points that are allowed, where it began, or away from its range.
        StepWarning
            If contact does much work all the same.
        """
        line, problem, settings = self.line, self.problem, self.settings
        if self.new and settings.stability and not missing:
            _separate(line, functools.partial(_tell, settings))
        result = _branch(line, problem, self.errors, missing, settings.stability)
        work = max(point.state.contact_work for point in line.points)
        warn_of_contact_work(problem.parameter.owner, work, problem.period.told_steps)
        run.update(lambda: result, [line], last=True)
        self._warn(result)
        return result

    def _warn(self, result: Branch) -> None:
        """Warn of, or raise, why a branch has not come to the end of its range."""
        what, last = self.problem.parameter.owner, float(result.value[-1])
        line, settings, stop, text = self.line, self.settings, self.problem.parameter.stop, ""
        if line.full and result.complete:
            text = (
                f"has all the {settings.points} points that it may have, and would have more where it bends "
                f"or multipliers pass the unit circle; {settings.more}"
            )
        elif line.complete and not result.complete and last != result.value[0]:
            text = (
                f"begins away from {stop:.8g} and has come to {last:.8g} without turning back: it is "
                "followed no further; go on from its last motion, or begin from another (guess)"
            )
        elif line.complete and not result.complete:
            turn = max(result.value, key=lambda value: abs(value - last))
            text = (
                f"has turned about at {turn:.8g} and come back to {last:.8g}, where it began, on other "
                f"motions: it does not lead to {stop:.8g}; begin there, or from another motion (guess)"
            )
        elif line.full:
            text = (
                f"ends at {last:.8g} after {settings.points} points, before {stop:.8g}; {settings.more}, or "
                "take more steps a period if it zigzags"
            )
        elif line.reason.startswith("back"):
            text = f"is {line.reason}"
        if text:
            warn(f"{what}: the curve {text}", BranchWarning)
        elif self.stops:
            why = "; ".join(filter(None, (line.reason, line.advice)))
            error = SolveError(f"{what}: the curve stops at {last:.8g} after {points_of(len(result))}: {why}")
            error.branch = result  # type: ignore[attr-defined]
            raise on_all_ranks(error)


def follow_response(
    problem: Orbits | UnreducedOrbits,
    first: Callable[[], np.ndarray],
    *,
    settings: BranchSettings,
    run: LineFile,
) -> Followed:
    """Follow a branch over a range of its parameter.

    Parameters
    ----------
    problem : Orbits or UnreducedOrbits
    first : callable
        State of a motion at the start.
    settings : BranchSettings
    run : LineFile

    Raises
    ------
    StepsTooLong
        If contact does too much work at a point, and there may be more steps.
    """
    parameter = problem.parameter
    what = parameter.owner
    if not problem.period.excitation.orders.any():
        raise wrong_input(f"{what}: no load oscillates; give a number, the amplitude of sin(2 pi f t)")
    line = run.line(problem) or Line([Point.known(problem, np.append(first(), parameter.start))])
    within, new = parameter.range, not line.complete
    if settings.leave:
        within = led_away(line, within)
    if new:
        line.reason = ""  # what has stopped a former run is met again
    tell = functools.partial(_tell, settings)
    run.follow(
        [line],
        within,
        settings,
        lambda: _branch(line, problem),
        lambda value: abs(value - parameter.start) / within.extent,
        tell,
    )
    new &= line.complete or not within.holds(line.points[-1].value)
    if new:
        refine(line, lambda: line.values / within.extent, lambda: line.told("point_amplitudes").T, tell)
    return Followed(problem, settings, line, new, *_judged(line))


def led_away(line: Line, within: Range) -> Range:
    """The range of a branch of several periods that begins in the direction in which it parts from shorter
    motions.

    Behind a subcritical period doubling that is away from where the range lies; the branch comes back through
    a fold, so the range is extended on that side.
    """
    first = line.points[0]
    orbits, fixed = first.problem, first.state
    before = distances(fixed.driven, fixed.motion)
    if not before or minimal_periods(fixed) < orbits.period.excitation.periods:
        return within
    tangent = Follower(Line([first]), within, Settings()).tangent()
    next_point = first.u + DIFFERENCE * orbits.units(first.u)[0] * tangent
    driven = orbits.driven(float(next_point[-1]))
    after = distances(driven, driven.run(next_point[:-1]))
    nearest = min(before, key=lambda fewer: before[fewer])
    if after[nearest] >= before[nearest]:
        return within
    reach = max(EXCURSION * abs(first.value), within.extent)
    if within.direction > 0:
        return Range(max(first.value - reach, 1e-9 * within.upper), within.upper, -1)
    return Range(within.lower, first.value + reach, 1)


def _tell(settings: BranchSettings, point: Point) -> None:
    """Note what is kept of a point.

    Raises
    ------
    StepsTooLong
        If contact does too much work in its steps, and there may be more of them.
    """
    state, problem = point.state, point.problem
    periods = problem.period.excitation.periods
    if (times := times_more(state.contact_work, problem.period.steps, settings.most_steps)) > 1:
        raise StepsTooLong(times)
    u, resultant = state.seen()
    spectrum = np.moveaxis(one_sided(u), 0, -1)
    point.told = {
        "states": np.zeros(0) if problem.map is None else state.state,
        "point_harmonics": spectrum[..., ::periods][..., : HARMONICS + 1],
        "point_amplitudes": 0.5 * np.ptp(u[..., -1], axis=0),
        "multipliers": state.multipliers.values if settings.stability else np.zeros(0, dtype=complex),
        "point_subharmonics": spectrum[..., :periods],
        "contact_peak": peak_of(resultant),
        "iterations": point.iterations,
    }


def _judged(line: Line) -> tuple[Point, np.ndarray, np.ndarray]:
    """Of the ends and where the amplitude and harmonics 2 to 4 are largest: the point whose told errors are
    largest, (3, 5) these, see `harmonic_error_estimates`, and (5,) the largest of all of them.
    """
    if not isinstance(line.points[0].problem.period, Period):
        return line.points[0], NOT_TOLD[None], NOT_TOLD
    spectra = np.abs(line.told("point_harmonics"))
    sizes = np.linalg.norm(spectra.reshape(len(spectra), -1, spectra.shape[-1]), axis=1)
    peaks = {int(np.linalg.norm(line.told("point_amplitudes"), axis=1).argmax())}
    peaks |= {int(np.argmax(size)) for size in sizes[:, 2:LOWEST].T}
    points = [line.points[k] for k in sorted({0, *peaks, len(line.points) - 1})]
    found = [harmonic_error_estimates(point.state) for point in points]
    worst = int(np.argmax([largest_error(errors.sum(axis=0)) for errors in found]))
    return points[worst], found[worst], np.max([errors.sum(axis=0) for errors in found], axis=0)


def _branch(
    line: Line,
    problem: Orbits | UnreducedOrbits,
    errors: np.ndarray = NOT_TOLD,
    missing: str = "",
    stability: bool = False,
) -> Branch:
    """The branch as it is, with bifurcations and uncertainties where its stability is asked for."""
    parameter = problem.parameter
    bifurcations = tuple(locate(line)) if stability and not missing else ()
    return Branch(
        **line.columns,
        parameter=parameter.name,
        value=line.values,
        multiplier_error=_uncertainty(line, bifurcations) if stability else np.full(len(line.points), np.nan),
        bifurcations=bifurcations,
        reason=line.reason or "unfinished",
        complete=len(line.points) > 1 and (parameter.reached(line.points[-1].value) or line.reason == CLOSED),
        periods=problem.period.excitation.periods,
        names=problem.period.points,
        map=problem.map,
        fixed_frequency=parameter.frequency,
        mode_error=errors,
        unlocated=unlocated(line, missing) if stability and missing else "",
    )


def _separate(line: Line, tell: Callable[[Point], object]) -> None:
    """Points between those with several passages of the unit circle between them, until each has its own
    place.
    """
    for _ in range(HALVINGS):
        places = {
            k: 0.5 if _gained(*line.points[k : k + 2]) else _unseen(line, k)
            for k in range(len(line.points) - 1)
        }
        for k, place in reversed(places.items()):
            if place is not None:
                insert(line, k, place, tell)
        if line.full or not any(places.values()):
            break


def _gained(one: Point, other: Point) -> bool:
    """Whether few pairs meet more often, or less, at a point than at the one before, which is far from it."""
    far = abs(other.value - one.value) > ENCLOSED * abs(one.value)
    return far and bool((one.state.meetings != other.state.meetings).any())


def _unseen(line: Line, k: int) -> float | None:
    """Where between points k and k + 1 a further one tells passages of the unit circle apart."""
    one, other = (point.state.multipliers for point in line.points[k : k + 2])
    passing = passages(one, other)
    if passing > 1 or ambiguous(one, other) or (not passing and hurried(one, other)):
        return 0.5
    if turns_twice(line, k, passing > 0, by_steps(line.points[k])):
        return 0.5
    outer = Way(line, k).neighbours()
    if passing or len(outer) < 2:
        return None
    around = {**outer, 0.0: line.points[k], 1.0: line.points[k + 1]}
    return excursion([(place, around[place].state.multipliers) for place in sorted(around)])


def _uncertainty(line: Line, bifurcations: tuple[Bifurcation, ...]) -> np.ndarray:
    """(n,): uncertainty of the largest modulus where the verdict may depend on it, nan elsewhere.

    Beside bifurcations it is expected to be as much as the modulus changes over what the steps move these.
    Where the modulus is near 1 it is measured here and there, at the nearest point of each stretch of one
    verdict, and wherever it is not far from 1 beside what is expected there or known next to it.
    """
    largest = np.abs(line.told("multipliers")[:, 0])
    result, off = np.full(len(largest), np.nan), np.abs(largest - 1.0)
    if len(largest) < 2:
        return result
    changes = np.flatnonzero(np.diff(largest > 1.0 + FLOOR)) + 1
    nearest = {begin + int(part.argmin()) for begin, part in zip([0, *changes], np.split(off, changes))}
    asked = {*range(0, len(largest), SPARSE), *(nearest - {*changes, *(changes - 1)})}
    for item in bifurcations:
        pair = np.array([item.after - 1, item.after])
        one, other = (line.points[k] for k in pair)
        moved = math.inf if math.isnan(item.error) else abs(item.value - item.own_value) + item.error
        expected = moved * np.ptp(largest[pair]) / max(abs(other.value - one.value), 1e-300)
        asked |= {*pair[off[pair] < FAR * expected]}
    while asked:
        k = asked.pop()
        if not np.isnan(result[k]) or off[k] > NEAR:
            continue
        result[k] = uncertainty_at(line, k, largest)
        neighbours = {max(k - 1, 0), min(k + 1, len(largest) - 1)}
        asked |= {n for n in neighbours if result[k] > FLOOR and off[n] < FAR * result[k]}
    return result


def linear_branch(period: Period, start: float, stop: float) -> tuple[Branch, np.ndarray]:
    """The response without contact, closed form, and (3, 5) what is told of the errors of its worst point."""
    r = period.reduced
    lower, upper = min(start, stop), max(start, stop)
    inside = [(f, z) for f, z in zip(r.frequencies, r.damping) if lower < f < upper]
    # an even number leaves out a resonance without damping
    near = [
        f * (1.0 + max(z, 1e-4) * np.tan(np.linspace(-1.45, 1.45, ABOUT if z else ABOUT - 1)))
        for f, z in inside
    ]
    values = np.unique(np.concatenate([np.linspace(lower, upper, EVEN), *near]))
    values = values[(values >= lower) & (values <= upper)]
    values = values if stop > start else values[::-1]
    orbits = Orbits(period, ParameterRange("frequency", start, stop))
    line = Line([], reason=f"end of the range at {values[-1]:g}", complete=True)
    for value in values.tolist():
        line.points.append(Point.known(orbits, np.append(period.at(value).linear_state, value)))
        _tell(BranchSettings(stability=False), line.points[-1])
    _, told, errors = _judged(line)
    return _branch(line, orbits, errors), told

"""Steady states under periodic loads: the periodic motion itself, by shooting, and its stability."""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..checks import instance
from ..continuation.accuracy import Accuracy, Told
from ..continuation.harmonic_errors import added, begun, harmonic_error_estimates, known_derivative
from ..continuation.newton import attempt
from ..continuation.orbit import UNTOLD, Orbit, make_orbit, orbit_stability
from ..continuation.problems.driven_orbits import ParameterRange
from ..continuation.problems.segments import at_segments, segmented_stability, shoot_segments
from ..continuation.problems.unreduced import UnreducedOrbits, UnreducedSteady
from ..continuation.search import NEWTON_ALONE, NEWTON_NEARBY, Search, find_steady_state
from ..continuation.shooting import WHOLE, shoot
from ..errors import SolveError, failed_solve, wrong_input
from ..motion.contact_work import MOST, contact_work, times_more, warn_of_contact_work
from ..motion.loading import communicator
from ..motion.period_map import FixedPoint, Period
from ..motion.preparation import (
    LONGEST,
    PeriodSettings,
    beginning,
    check_reduction,
    finer,
    following,
    prepare,
    require_unreduced,
    tells_stability,
)
from ..motion.unreduced.period import prepare_unreduced
from ..progress import Progress, progress_bar
from ..ranks.parallel import collective
from ..reduction.reduced_model import ReducedModel
from ..system.model import Model
from .analysis import analysis
from .options import PeriodicOptions

# Times the steps are doubled to meet a tolerance.
DOUBLINGS = 7
# Of an attempt in more modes and steps, what finding the motion takes; the rest is telling its error.
HALF = 0.5
# A motion, by what it was found first, and what is told of it.
_Told = Told[Period, tuple[FixedPoint, str]]


@analysis(PeriodicOptions, rubs=True)
def periodic(
    model: Model | ReducedModel,
    load,
    frequency: float,
    *,
    periods: int | None = None,
    steps: int | None = None,
    modes: int | None = None,
    contact: bool = True,
    reduction: str | None = "modes",
    guess: Orbit | None = None,
    jacobian: str = "auto",
    stability: bool | None = None,
    longest: int = LONGEST,
    tolerance: float | None = None,
    accuracy: float | None = None,
    search: Search | None = None,
    segments: int = 1,
    progress: Progress = "auto",
) -> Orbit:
    """Find the periodic response to periodic loads by shooting.

    Parameters
    ----------
    model : Model or ReducedModel
        Its damping ratio is that of all modes. A model is reduced once for the places of its loads.
    load : PointForce, EdgeLoad, SupportMotion, EdgeMotion, a sum or a sequence of them
        For a system of matrices a value for each of its unit loads. A number is the amplitude of
        sin(2 pi f t); signals stand for themselves (`Constant`: a preload; `Harmonic`: a further tone).
        Beside signals that vary a number is refused: `Constant` or `Harmonic` says what it means.
    frequency : float
        Forcing frequency f, Hz.
    periods : int, optional
        Forcing periods in one period of the motion: more than one for subharmonic motions and for tones that
        are not multiples of f. Default: the fewest in which all tones fit, or
        several times as many where no motion of that period is found and a history settles on a longer one.
    steps : int, optional
        Time steps a forcing period, all of one length. Default: 512, or as many as keep the step below 0.8 of
        the shortest modal period (coarser ones let contact excite modes falsely) and below 1 / 32 of the
        shortest load period; these are halved, and the motion is found again, while contact, which does no
        work between smooth faces, does more of it than 1e-3 of what the loads exchange with the modes (see
        `motion.contact_work`), to 32 times as many at most.
    modes : int, optional
        Default: as many as `accuracy` needs; where that is none those of `guess`, or all modes up to 8 times
        the loads' highest frequency, at least 80, whatever is told of their error.
    contact : bool
        False: the faces may overlap.
    reduction : "modes" or None
        None: the unreduced model, distributed and without a matrix (see `motion.unreduced.period`).
    guess : Orbit, optional
        A motion to begin from, of the same model, in any number of modes. Default: the response without
        contact.
    jacobian : {"auto", "dense", "matrix-free", "differences"}
        See `shooting.shoot`.
    stability : bool, optional
        Compute the Floquet multipliers. Default: of a reduced model; those of an unreduced one are not
        computed, nor those under a `static_friction` of its own.
    longest : int
        Most forcing periods in a common period of tones.
    tolerance : float, optional
        The steps are doubled until the displacements of all named points change by less than this, relative
        L2 over the period; the change is `step_error`.
    accuracy : float, optional
        Of harmonics 1 to 4 of the named points and of the contact resultant, `largest_mode_error`: modes and
        steps that are not given are as many as that needs. To begin with those of `guess`, or modes up to 12
        sqrt(1e-3 / accuracy) times the loads' highest frequency, at least 12 (80 where that is not known),
        and some ten vectors that stand for all others, in 64 ceil(8 sqrt(1e-3 / accuracy)) steps or what
        modes and loads ask for; more of them, from the motion found on, where its told error is above, to
        320 modes, or no more than the 80 where 320 would be far from enough. Where faces rub `friction_loss`
        may be ten times as far off, of which nothing is told. Default: 1e-3 of a Model with named points
        where neither modes nor steps nor `tolerance` is given and `segments` is 1, else none.
    search : continuation.search.Search, optional
        How far a motion is looked for where Newton's method does not converge from the first guess.
    segments : int
        More than 1: multiple shooting over so many parts of the period, from `guess` or the linear response
        alone, without a search; for periods in which disturbances grow by 1e6 or more, and for many periods
        of a fast tone in one of a slow one. The period's steps are a multiple of it; the default is.
    progress : callable, "auto" or None
        As for `transient`: the share that is behind of the search where Newton's method does not converge at
        once, of each attempt in more modes and steps, and of an unreduced model's iteration.

    Raises
    ------
    ValueError, TypeError, KeyError
        For input that makes no sense, tones without a common period, an undamped mode driven at its own
        frequency.
    SolveError
        If no motion is found, by Newton's method, behind a history, or along a ramp of the load, the damping
        or the frequency (see `continuation.search`), or the tolerance is not met.

    Warns
    -----
    LargeDisplacementWarning
        If displacements of named points are more than 5 % of the body.
    AccuracyWarning
        If the told error is above `accuracy` in the modes or steps given, or in as many as there may be.
    StepWarning
        If contact does more than 1e-2 of what the loads exchange with the modes, in given steps or in 32
        times the default ones.
    """
    settings = PeriodSettings(periods, steps, modes, contact, jacobian, longest, segments, accuracy=accuracy)
    with collective(communicator(model)):
        check_reduction("periodic", reduction, model)
        if guess is not None:
            instance("periodic", "guess", guess, Orbit, "an Orbit")
        if search is not None:
            instance("periodic", "search", search, Search, "a continuation.search.Search")
            if not contact or segments > 1:
                raise ValueError(
                    "periodic: search is for a reduced model with contact and segments = 1; without contact "
                    "the motion is that of linear modes, and in segments it is found from guess alone"
                )
        if segments > 1:
            model.require_frictionless("periodic in segments")
        if reduction is None:
            asked: dict[str, Any] = {"guess": guess, "tolerance": tolerance, "search": search}
            asked |= {"segments": segments, "accuracy": accuracy, "jacobian": jacobian}
            asked["stability"] = stability
            require_unreduced("periodic", model, asked, PeriodicOptions.of_reduced)
    if reduction is None:
        assert isinstance(model, Model)
        return _unreduced(model, load, frequency, settings, progress)
    search = search if contact else NEWTON_ALONE
    task = _Task(model, load, frequency, stability, search, progress)
    if tolerance is not None:
        return _refined(task, settings, guess, tolerance)
    return _shot(task, settings if segments > 1 else following(settings, model), guess)


@dataclass(frozen=True, eq=False)
class _Task:
    """What an orbit is asked for, whatever its steps."""

    model: Model | ReducedModel
    load: Any
    frequency: float
    stability: bool | None
    search: Search | None
    progress: Progress

    def found(
        self,
        settings: PeriodSettings,
        period: Period,
        state: np.ndarray,
        derivative: Callable[[], np.ndarray] | None,
    ) -> tuple[FixedPoint, str]:
        """The motion near a state, where its derivative may about be known, in so many times the steps as
        contact asks for.
        """
        find = functools.partial(
            find_steady_state, jacobian=settings.jacobian, search=self.search, progress=self.progress
        )
        driven, known, path = period.at(self.frequency), None, "Newton"
        if derivative is not None:
            shot = functools.partial(shoot, driven, state, settings.jacobian)
            hurries = period.friction is not None
            known = attempt(lambda: shot(near=derivative(), hurries=hurries), SolveError)
        if known is None:
            known, path = find(driven, state, multiples=settings.periods is None)
        fixed = known
        period = fixed.driven.period
        most = period.steps * (MOST if settings.steps is None else 1)
        while (times := _times_more(fixed, most)) > 1:
            period = finer("periodic", period, times)
            fixed, path = find(period.at(self.frequency), fixed.state, multiples=False)
        return fixed, path


def _shot(task: _Task, settings: PeriodSettings, guess: Orbit | None) -> Orbit:
    """The orbit at given steps, or in as many modes and steps as an accuracy asks for."""
    settings = beginning(settings, guess)

    def prepared(settings: PeriodSettings, near: _Told | None) -> Period:
        if near is not None:
            settings = replace(settings, periods=near.where.excitation.periods)
        period = prepare("periodic", task.model, task.load, task.frequency, settings=settings, guess=guess)
        tells_stability("periodic", period, task.stability)
        return period

    def found(period: Period, near: _Told | None) -> _Told:
        if near is None:
            fixed, path = task.found(settings, period, begun(guess, period.at(task.frequency)), None)
            return Told(fixed.driven.period, (fixed, path), harmonic_error_estimates(fixed))
        former, (fixed, path) = near.where, near.found
        state = period.at(task.frequency).linear_state + added(fixed, period)
        alone = replace(task, search=NEWTON_NEARBY, progress=None)  # a search might find another motion
        words = f"steady state in {period.reduced.in_words}"
        with progress_bar(period.comm, words, task.progress) as report:
            # more steps alone, whose derivative their error has been told by
            more = period.unknowns == former.unknowns <= WHOLE
            derivative = functools.partial(known_derivative, fixed) if more else None
            fixed, _ = alone.found(settings, period, state, derivative)
            report(HALF)
            errors = harmonic_error_estimates(fixed)
            report(1.0)
        return Told(fixed.driven.period, (fixed, path), errors)

    if settings.segments > 1:
        period, most = prepared(settings, None), MOST if settings.steps is None else 1
        return _in_segments(task, settings.segments, period, guess, most * period.steps)
    accuracy = Accuracy("periodic", task.model, settings)
    period, (fixed, path), errors = accuracy.reached(prepared, found)
    accuracy.tell(period, errors)
    tells = tells_stability("periodic", period, task.stability)
    return make_orbit(fixed, path, orbit_stability(fixed) if tells else UNTOLD, errors.sum(axis=0))


def _times_more(fixed: FixedPoint, most: int) -> int:
    """Times the steps that a motion is to have."""
    period, work = fixed.driven.period, contact_work(fixed.driven, fixed.motion)
    times = times_more(work, period.steps, most)
    if times == 1:
        warn_of_contact_work("periodic", work, period.told_steps)
    return times


def _in_segments(task: _Task, segments: int, period: Period, guess: Orbit | None, most: int) -> Orbit:
    """The orbit by multiple shooting, in so many steps at most."""
    if period.steps % segments:
        raise wrong_input(
            f"periodic: {period.steps} steps a period are no multiple of segments = {segments}; "
            "give another number of either"
        )
    states = None if guess is None else at_segments(guess, period, task.frequency, segments)
    fixed, parts = shoot_segments(period, task.frequency, segments, states)
    if (times := _times_more(fixed, most)) > 1:
        found = make_orbit(fixed, "multiple shooting")
        return _in_segments(task, segments, finer("periodic", period, times), found, most)
    told = UNTOLD if task.stability is False else segmented_stability(parts)
    return make_orbit(fixed, "multiple shooting", told)


def _refined(task: _Task, settings: PeriodSettings, guess: Orbit | None, tolerance: float) -> Orbit:
    """An orbit whose displacements do not change by more than a tolerance when its steps are doubled."""
    found = _shot(task, settings, guess)
    for _ in range(DOUBLINGS):
        steps = 2 * len(found.time) // found.periods
        settings = replace(settings, steps=steps, periods=found.periods)
        finer = _shot(task, settings, found)
        one, other = (
            np.concatenate([orbit.displacement(point)[::stride] for point in found.points])
            for orbit, stride in ((found, 1), (finer, 2))
        )
        error = float(np.linalg.norm(one - other) / max(float(np.linalg.norm(other)), 1e-300))
        found = replace(finer, step_error=error)
        if error < tolerance:
            return found
    raise failed_solve(
        f"periodic: with {steps} steps a period the displacements still change by {error:.2g} when the "
        f"steps are doubled; a tolerance of {tolerance:g} is not met"
    )


def _unreduced(model: Model, load, frequency: float, settings: PeriodSettings, progress: Progress) -> Orbit:
    """The orbit of the unreduced model, in an odd number of steps."""
    with (
        prepare_unreduced("periodic", model, load, frequency, settings=settings) as period,
        progress_bar(period.comm, "steady state", progress) as report,
    ):
        driven = period.at(frequency)
        orbits = UnreducedOrbits(period, ParameterRange("frequency", frequency, frequency))
        found = UnreducedSteady(orbits, frequency, report)
        return Orbit(
            np.arange(period.steps) * driven.march.step,
            driven.states(found.state),
            frequency,
            period.excitation.periods,
            tuple(found.residuals),
            found.path,
            products=period.products,
        )

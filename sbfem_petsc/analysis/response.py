"""Nonlinear response curves: branches of periodic motions over the frequency, the load, the damping or the
gaps.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass, replace
from typing import Any, TypeAlias

import numpy as np

from ..continuation.accuracy import Accuracy, Told
from ..continuation.branch import Branch
from ..continuation.branch_following import (
    HARMONICS,
    BranchSettings,
    Followed,
    follow_response,
    linear_branch,
)
from ..continuation.harmonic_errors import begun
from ..continuation.line_file import LineFile, conditions_of
from ..continuation.orbit import Orbit, require_at
from ..continuation.problems.driven_orbits import Orbits, ParameterRange
from ..continuation.problems.unreduced import UnreducedOrbits, UnreducedSteady
from ..continuation.search import find_steady_state
from ..motion.contact_work import MOST, StepsTooLong
from ..motion.loading import amplitudes_only, communicator
from ..motion.period_map import Period
from ..motion.preparation import (
    PeriodSettings,
    beginning,
    check_reduction,
    finer,
    following,
    prepare,
    require_unreduced,
    tells_stability,
)
from ..motion.unreduced.period import UnreducedPeriod, prepare_unreduced
from ..progress import Progress
from ..ranks.capacity import points_in_room
from ..ranks.parallel import collective
from ..reduction.build import MOST_OF_MANY
from ..reduction.reduced_model import ReducedModel
from ..system.model import Model
from .analysis import analysis
from .options import CurveOptions, FrequencyResponseOptions, LoadResponseOptions

# `Orbit.path` of a motion next to a period doubling.
DOUBLED = "period doubling"
# Instants a period at which a linear response is evaluated.
INSTANTS = 256
# Linear responses, and curves, with what is told of their errors.
_Linear: TypeAlias = Told[Period, Branch]
_Told: TypeAlias = Told[Period, Followed]


@analysis(FrequencyResponseOptions, rubs=True)
def frequency_response(
    model: Model | ReducedModel,
    load,
    start: float,
    stop: float,
    *,
    contact: bool = True,
    periods: int | None = None,
    steps: int | None = None,
    modes: int | None = None,
    guess: Orbit | None = None,
    points: int = 400,
    largest_step: float | None = None,
    stability: bool | None = None,
    accuracy: float | None = None,
    reduction: str | None = "modes",
    file: str | None = None,
    resume: bool = False,
    progress: Progress = "auto",
) -> Branch:
    """Follow the periodic response over the forcing frequency, through folds; without contact the linear
    response.

    Parameters
    ----------
    model : Model or ReducedModel
    load : PointForce, EdgeLoad, SupportMotion, EdgeMotion, a sum or a sequence of them
        For a system of matrices a value for each of its unit loads. Numbers are amplitudes of
        sin(2 pi f t) at the swept frequency; `Constant` signals are preloads.
    start, stop : float
        Hz; `stop` below `start` sweeps downwards.
    contact : bool
    periods, steps, modes
        See `periodic`. Default steps are halved for the whole curve, which is followed again, where contact
        does too much work in them at any of its points.
    guess : Orbit, optional
        A motion to begin from: one at `start` on the branch that is wanted, of its own number of periods.
        Default: the one that `periodic` finds. From one that `switch_branch` has found the branch goes away
        from the period doubling, if need be through a fold outside the range.
    points : int
        Points at most.
    largest_step : float, optional
        Largest change of the frequency (Hz) from a point to the next one, for a finer curve.
    stability : bool, optional
        Compute Floquet multipliers and bifurcations. Default: of a reduced model; those of an unreduced one
        are not computed.
    accuracy : float, optional
        Of harmonics 1 to 4 of the points and the resultant, `largest_mode_error`, for which modes and steps
        that are not given are as many as it needs, see `periodic`. The curve is followed again where its told
        error is above at an end or the peak; where it stays so bifurcations are not located (`unlocated`).
        Default: as of `periodic`, in 160 modes at most, and bifurcations are located whatever is told.
    reduction : "modes" or None
        None: motions of the unreduced model, as `periodic` finds them.
    file : str, optional
        Journal that is kept up to date (`read` reads it, also meanwhile), with FILE.state beside it.
    resume : bool
        Go on from `file` if it exists, with the same model, loads and settings.
    progress : callable, "auto" or None
        As for `transient`.

    Raises
    ------
    ValueError, TypeError, KeyError
        For input that makes no sense.
    SolveError
        If there is no first point, or if the curve comes to a stop within the range; the points so far are
        its attribute `branch`, and in `file`.

    Warns
    -----
    AccuracyWarning
        If the told error is above `accuracy` in the modes or steps given, or in as many as there may be.
    """
    over = ParameterRange("frequency", start, stop)
    with collective(communicator(model)):
        if not contact and (file is not None or guess is not None or reduction is None):
            raise ValueError(
                "frequency_response: the linear response, contact = False, takes neither file nor guess nor "
                "reduction = None"
            )
        amplitudes_only("frequency_response", load)
    highest = max(start, stop)
    settings = PeriodSettings(periods, steps, modes, contact, band=highest, accuracy=accuracy, vectors=False)
    if not contact:
        settings = replace(following(settings, model), steps=INSTANTS, periods=periods or 1)
        aim = Accuracy(over.owner, model, settings)

        def prepared(settings: PeriodSettings, near: _Linear | None) -> Period:
            return prepare(over.owner, model, load, highest, settings=settings)

        def found(period: Period, near: _Linear | None) -> _Linear:
            return Told(period, *linear_branch(period, start, stop))

        period, branch, errors = aim.reached(prepared, found)
        aim.tell(period, errors)
        return branch
    asked = BranchSettings(points, largest_step or math.inf)
    run = _Run(model, load, over, settings, guess, asked, stability, file, resume, progress)
    return run.followed(reduction)


@analysis(LoadResponseOptions, rubs=True)
def load_response(
    model: Model | ReducedModel,
    load,
    frequency: float,
    start: float = 0.0,
    *,
    stop: float = 1.0,
    parameter: str = "load",
    periods: int | None = None,
    steps: int | None = None,
    modes: int | None = None,
    guess: Orbit | None = None,
    points: int = 400,
    largest_step: float | None = None,
    stability: bool | None = None,
    accuracy: float | None = None,
    reduction: str | None = "modes",
    file: str | None = None,
    resume: bool = False,
    progress: Progress = "auto",
) -> Branch:
    """Follow the periodic response over a factor at a fixed frequency: on the oscillating loads (constant
    ones stay), on all damping ratios or on all initial gaps.

    Parameters
    ----------
    model : Model or ReducedModel
    frequency : float
        Forcing frequency, Hz.
    start, stop : float
        Factors; not negative.
    parameter : {"load", "damping", "gap"}
        What the factor is on, as in `locus`; of an unreduced model the load alone.
    largest_step : float, optional
        Largest change of the factor from a point to the next one, for a finer curve.
    load, periods, steps, modes, guess, points, stability, accuracy, reduction, file, resume, progress
        See `frequency_response`; `guess` is an orbit at the factor `start`.
    """
    over = ParameterRange(parameter, start, stop, frequency)
    settings = PeriodSettings(periods, steps, modes, accuracy=accuracy, vectors=False)
    asked = BranchSettings(points, largest_step or math.inf)
    run = _Run(model, load, over, settings, guess, asked, stability, file, resume, progress)
    return run.followed(reduction)


@dataclass(frozen=True)
class _Run:
    """A curve over any parameter, and where it is kept."""

    model: Model | ReducedModel
    load: Any
    over: ParameterRange
    settings: PeriodSettings
    guess: Orbit | None
    asked: BranchSettings
    stability: bool | None
    file: str | None
    resume: bool
    progress: Progress

    @property
    def begins(self) -> float:
        """The forcing frequency of its first motion, Hz."""
        return self.over.frequency or self.over.start

    def kept(self) -> LineFile:
        """Where it is kept, and whom it tells."""
        shown: dict[str, Any] = {"task": f"{self.over.name} response", "progress": self.progress}
        return LineFile(self.model.comm, self.file, "branch", resume=self.resume, **shown)

    def conditions(self) -> dict[str, Any]:
        """What a run must have been begun with to be gone on with."""
        step, accuracy, over = self.asked.largest_step, self.settings.accuracy, self.over
        return {
            **({} if accuracy is None else {"accuracy": accuracy}),
            "parameter": over.name,
            "start": over.start,
            "stop": over.stop,
            "largest_step": step if math.isfinite(step) else "none",
            "fixed_frequency": over.frequency or 0.0,
        }

    def _begun(self) -> _Run:
        """With what it begins in and is asked for: an orbit's periods and steps, an accuracy by default."""
        settings, asked = replace(self.settings, periods=self.settings.periods or 1), self.asked
        guess = self.guess
        if guess is not None and guess.path == DOUBLED:  # which more modes might lose, or other vectors
            settings = replace(settings, vectors=guess.reduced is not None and guess.reduced.vectors > 0)
            asked = replace(asked, leave=True)
        else:
            settings = following(settings, self.model, MOST_OF_MANY)
        if guess is not None:  # from one beside a period doubling away from it
            own = len(guess.time) // guess.periods
            settings = beginning(replace(settings, periods=guess.periods, least=own), guess)
            if settings.accuracy is None:
                settings = replace(settings, steps=settings.steps or own)
        return replace(self, settings=settings, asked=asked)

    def followed(self, reduction: object) -> Branch:
        """Of the model as it is or of a reduced one."""
        what = self.over.owner
        with collective(communicator(self.model)):
            check_reduction(what, reduction, self.model)
            if reduction is not None:
                require_at(what, "guess", self.guess, self.begins, self.settings.periods)
        if reduction is None:
            return self._unreduced()
        begun = self._begun()
        accuracy = Accuracy(what, self.model, begun.settings)
        with self.kept() as file:
            curve = _Curve(begun, self.conditions(), accuracy, file)
            period, followed, errors = accuracy.reached(curve.prepared, curve.found)
            if period is not curve.period:  # it was lost in another
                curve.anew(period)
            return followed.ended(file, accuracy.tell(period, errors))

    def _unreduced(self) -> Branch:
        what, over = self.over.owner, self.over
        given: dict[str, Any] = {"parameter": over.name, "guess": self.guess, "stability": self.stability}
        given["accuracy"] = self.settings.accuracy
        with collective(self.model.comm):
            require_unreduced(what, self.model, given, CurveOptions.of_reduced)
        assert isinstance(self.model, Model)
        settings = replace(self.settings, periods=self.settings.periods or 1)
        with (
            self.kept() as run,
            prepare_unreduced(what, self.model, self.load, self.begins, settings=settings) as period,
        ):
            if self.file is not None:
                march = period.march(self.begins)
                told = {**self.conditions(), "contact": period.contact, "steps": period.steps}
                told |= {"fingerprint": march.fingerprint(), **conditions_of(period.excitation)}
                run.begin(None, told, np.array([over.start]), period.pencil)
            asked = replace(_with_room(what, period, self.asked), stability=False)
            orbits = UnreducedOrbits(period, over)
            followed = follow_response(
                orbits, lambda: UnreducedSteady(orbits, over.start).state, settings=asked, run=run
            )
            return followed.ended(run)


@dataclass
class _Curve:
    """A curve of a reduced model, whose modes and steps may grow; `period` is the map of its file."""

    run: _Run
    conditions: dict[str, Any]
    accuracy: Accuracy
    file: LineFile
    period: Period | None = None

    def _mapped(self, settings: PeriodSettings) -> Period:
        run = self.run
        return prepare(run.over.owner, run.model, run.load, run.begins, settings=settings, guess=run.guess)

    def prepared(self, settings: PeriodSettings, near: _Told | None) -> Period:
        """The map in which the worst point of a curve is accurate; the first one is that of a run that is
        gone on with, in its modes, else as an accuracy asks for.
        """
        over = self.run.over
        if near is not None:
            worst = near.found.worst
            point = Told(near.where, worst.state, near.errors)
            return self.accuracy.enough(over, worst.value, point, self._mapped, settings)
        if settings.accuracy is None or self.period is not None:
            return self._mapped(settings)
        modes = self.file.modes()
        if modes is not None and settings.modes is None and isinstance(self.run.model, Model):
            settings = replace(settings, modes=modes)
        period = self._mapped(settings)
        if modes is not None or self.run.guess is not None:
            return period
        return self.accuracy.tried(over, period, self._mapped)

    def found(self, period: Period, near: _Told | None) -> _Told:
        """The curve in a map, and the errors of its worst point."""
        run, what = self.run, self.run.over.owner
        if near is not None and period is near.where:  # there is no memory for more
            return near
        asked = replace(run.asked, stability=tells_stability(what, period, run.stability))
        most = MOST if run.settings.steps is None else 1
        asked = _with_room(what, period, replace(asked, most_steps=most * period.steps))
        if self.period is None:  # in the steps of the file where none are asked for
            begin, any_steps = np.array([run.over.start]), most > 1
            self.period, _ = self.file.begin_period(period, self.conditions, begin, any_steps)
        else:
            self.anew(period)
        while True:
            period = self.period
            first = functools.partial(_first, period, run.over, run.guess)
            try:
                curve = follow_response(Orbits(period, run.over), first, settings=asked, run=self.file)
                break
            except StepsTooLong as error:
                self.anew(finer(what, period, error.times))
        if curve.stops and self.accuracy.further(period.reduced, period.told_steps, curve.told) is None:
            curve.ended(self.file, self.accuracy.tell(period, curve.told))  # raises what has stopped it
        return Told(period, curve, curve.told)

    def anew(self, period: Period) -> None:
        """Begin its file again, in another map."""
        self.period = self.file.anew(self.run.over.owner, period)


def _first(period: Period, over: ParameterRange, guess: Orbit | None) -> np.ndarray:
    """State of the first motion of a curve."""
    driven = over.at(period, over.start)
    return find_steady_state(driven, begun(guess, driven), multiples=False)[0].state


def _with_room(owner: str, period: Period | UnreducedPeriod, settings: BranchSettings) -> BranchSettings:
    """Settings with no more points than there is memory for: few branches take as many as they may.
    Collective.

    Raises
    ------
    ValueError
        If there is no room for `capacity.FEW`.
    """
    # the derivative and the monodromy of each, its state, its multipliers and what it is asked for; of an
    # unreduced model its state, which rank 0 gathers for the file
    size, matrices = period.unknowns, 2 if settings.stability else 1
    known = 3 * size if isinstance(period, UnreducedPeriod) else matrices * size**2 + 3 * size
    each = 8.0 * (known + 4 * len(period.points) * (HARMONICS + 1 + period.excitation.periods))
    told = {"what": f"a branch of {{}} points and {size} unknowns", "remedy": "give fewer modes (modes)"}
    most = points_in_room(owner, period.comm, settings.points, (each, 0.0), **told)
    if settings.points <= most:
        return settings
    return replace(settings, points=most, more="there is no memory for more points: give fewer modes")

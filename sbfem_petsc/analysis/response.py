"""Nonlinear response curves: branches of periodic motions over the frequency, the load, the damping or the
gaps.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..continuation.accuracy import Accuracy, TooInaccurate
from ..continuation.branch import Branch
from ..continuation.branch_following import HARMONICS, BranchSettings, follow_response, linear_branch
from ..continuation.harmonic_errors import begun
from ..continuation.line_file import LineFile, conditions_of
from ..continuation.orbit import Orbit, require_at
from ..continuation.problems.driven_orbits import Orbits, ParameterRange
from ..continuation.problems.unreduced import UnreducedOrbits, UnreducedSteady
from ..continuation.search import find_steady_state
from ..errors import PetscFailure, SolveError
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
    restarted,
    tells_stability,
)
from ..motion.unreduced.period import UnreducedPeriod, prepare_unreduced
from ..petsc import MPI
from ..progress import Progress
from ..ranks.capacity import FEW, require_memory, room
from ..ranks.parallel import collective
from ..reduction.build import MOST_OF_MANY
from ..reduction.reduced_model import ReducedModel
from ..system.model import Model
from .analysis import analysis
from .options import FrequencyResponseOptions, LoadResponseOptions

# `Orbit.path` of a motion next to a period doubling.
DOUBLED = "period doubling"
# Instants a period at which a linear response is evaluated.
INSTANTS = 256


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
    settings = PeriodSettings(periods, steps, modes, contact, band=highest, accuracy=accuracy)
    if not contact:
        settings = replace(following(settings, model), steps=INSTANTS, periods=periods or 1)
        aim = None if settings.accuracy is None else Accuracy(over.owner, model, settings)
        while True:
            try:
                period = prepare(over.owner, model, load, highest, settings=settings)
                return linear_branch(period, start, stop, aim)
            except TooInaccurate as error:
                settings = error.settings
    asked = BranchSettings(points, largest_step or math.inf, stability is not False)
    run = _Run(model, load, settings, guess, asked, file, resume, progress)
    return run.followed(over, reduction, stability)


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
    settings = PeriodSettings(periods, steps, modes, accuracy=accuracy)
    asked = BranchSettings(points, largest_step or math.inf, stability is not False)
    run = _Run(model, load, settings, guess, asked, file, resume, progress)
    return run.followed(over, reduction, stability)


@dataclass(frozen=True)
class _Run:
    """A curve over any parameter, and where it is kept."""

    model: Model | ReducedModel
    load: Any
    settings: PeriodSettings
    guess: Orbit | None
    asked: BranchSettings
    file: str | None
    resume: bool
    progress: Progress

    @property
    def comm(self) -> MPI.Comm:
        """The model's ranks."""
        return communicator(self.model)

    def _file(self, over: ParameterRange) -> LineFile:
        """Where it is kept, and whom it tells."""
        shown: dict[str, Any] = {"task": f"{over.name} response", "progress": self.progress}
        return LineFile(self.comm, self.file, "branch", resume=self.resume, **shown)

    def _conditions(self, over: ParameterRange) -> dict[str, Any]:
        """What a run must have been begun with to be gone on with."""
        step, accuracy = self.asked.largest_step, self.settings.accuracy
        return {
            **({} if accuracy is None else {"accuracy": accuracy}),
            "parameter": over.name,
            "start": over.start,
            "stop": over.stop,
            "largest_step": step if math.isfinite(step) else "none",
            "fixed_frequency": over.frequency or 0.0,
        }

    def _begins(self, owner: str) -> tuple[PeriodSettings, BranchSettings]:
        """What a curve begins in and is asked for: an orbit's periods and steps, an accuracy by default."""
        settings, asked = replace(self.settings, periods=self.settings.periods or 1), self.asked
        guess = self.guess
        leaves = guess is not None and guess.path == DOUBLED  # which more modes might lose
        settings = settings if leaves else following(settings, self.model, MOST_OF_MANY)
        if guess is not None:  # from one beside a period doubling away from it
            own = len(guess.time) // guess.periods
            settings = beginning(replace(settings, periods=guess.periods, least=own), guess)
            if settings.accuracy is None:
                settings = replace(settings, steps=settings.steps or own)
            asked = replace(asked, leave=leaves)
        if settings.accuracy is not None:
            asked = replace(asked, accuracy=Accuracy(owner, self.model, settings))
        return settings, asked

    def followed(self, over: ParameterRange, reduction: object, stability: bool | None) -> Branch:
        """Over a parameter, of the model as it is or of a reduced one."""
        if reduction is None:
            return self._unreduced(over, stability)
        what, guess, most = over.owner, self.guess, MOST if self.settings.steps is None else 1
        begins = over.frequency or over.start
        with collective(self.comm):
            check_reduction(what, reduction)
            require_at(what, "guess", guess, begins, self.settings.periods)
        settings, asked = self._begins(what)

        def prepared(settings: PeriodSettings) -> Period:
            return prepare(what, self.model, self.load, begins, settings=settings, guess=guess)

        with self._file(over) as run:
            period = self._begun(over, asked.accuracy, prepared, settings, run)
            asked = replace(asked, stability=tells_stability(what, period, stability))
            asked = _with_room(what, period, replace(asked, most_steps=most * period.steps))
            # in the steps of the file where none are asked for
            any_steps, begin = asked.most_steps > period.steps, np.array([over.start])
            period, _ = run.begin_period(period, self._conditions(over), begin, any_steps)
            followed: Period | None = None  # that was told to be less accurate
            while True:
                first = functools.partial(_first, period, over, guess)
                try:
                    return follow_response(Orbits(period, over), first, settings=asked, run=run)
                except StepsTooLong as error:
                    period = run.anew(what, finer(what, period, error.times))
                    continue
                except TooInaccurate as error:
                    assert asked.accuracy is not None  # that raised it
                    followed, period = period, asked.accuracy.more(over, error, prepared)
                except PetscFailure:
                    raise
                except SolveError:
                    again = restarted(settings, period.reduced)
                    if again is not None:
                        period = prepared(again)
                    elif followed is None or asked.accuracy is None:
                        raise
                    else:
                        asked.accuracy.stays(asked.accuracy.lost(period))
                        period, followed = followed, None
                asked = _with_room(what, period, replace(asked, most_steps=most * period.steps))
                period = run.anew(what, period)

    def _begun(
        self,
        over: ParameterRange,
        accuracy: Accuracy | None,
        prepared: Callable[[PeriodSettings], Period],
        settings: PeriodSettings,
        run: LineFile,
    ) -> Period:
        """The map to begin with: of a run that is gone on with in its modes, else as an accuracy asks for."""
        if accuracy is None:
            return prepared(settings)
        modes = run.modes()
        if modes is not None and settings.modes is None and isinstance(self.model, Model):
            settings = replace(settings, modes=modes)
        period = prepared(settings)
        return (
            period if modes is not None or self.guess is not None else accuracy.tried(over, period, prepared)
        )

    def _unreduced(self, over: ParameterRange, stability: bool | None) -> Branch:
        what = over.owner
        with collective(self.comm):
            # damping and gaps are in the model's matrices
            given = {"parameter": over.name} if over.name in ("damping", "gap") else {}
            require_unreduced(
                what,
                self.model,
                {
                    **given,
                    "guess": self.guess,
                    "stability": stability or None,
                    "accuracy": self.settings.accuracy,
                },
            )
        assert isinstance(self.model, Model)
        settings = replace(self.settings, periods=self.settings.periods or 1)
        begins = over.frequency or over.start
        with (
            self._file(over) as run,
            prepare_unreduced(what, self.model, self.load, begins, settings=settings) as period,
        ):
            if self.file is not None:
                march = period.march(begins)
                told = {**self._conditions(over), "contact": period.contact, "steps": period.steps}
                told |= {"fingerprint": march.fingerprint(), **conditions_of(period.excitation)}
                run.begin(None, told, np.array([over.start]), period.pencil)
            asked = replace(_with_room(what, period, self.asked), stability=False)
            orbits = UnreducedOrbits(period, over)
            return follow_response(
                orbits, lambda: UnreducedSteady(orbits, over.start).state, settings=asked, run=run
            )


def _first(period: Period, over: ParameterRange, guess: Orbit | None) -> np.ndarray:
    """State of the first motion of a curve."""
    driven = over.at(period, over.start)
    state = period.begun(driven.linear_state)
    if guess is not None and guess.reduced is not None:  # checked
        state = begun(guess.state, guess.reduced, driven)
    return find_steady_state(driven, state, multiples=False)[0].state


def _with_room(what: str, period: Period | UnreducedPeriod, settings: BranchSettings) -> BranchSettings:
    """Settings with no more points than there is memory for: few branches take as many as they may.
    Collective.

    Raises
    ------
    ValueError
        If there is no room for `FEW`.
    """
    # the derivative and the monodromy of each, its state, its multipliers and what it is asked for; of an
    # unreduced model its state, which rank 0 gathers for the file
    size, matrices = period.unknowns, 2 if settings.stability else 1
    known = 3 * size if isinstance(period, UnreducedPeriod) else matrices * size**2 + 3 * size
    each = 8.0 * (known + 4 * len(period.points) * (HARMONICS + 1 + period.excitation.periods))
    few = min(settings.points, FEW)
    require_memory(
        what,
        period.comm,
        few * each,
        f"a branch of {few} points and {size} unknowns",
        lambda share: "give fewer modes (modes)",
    )
    most = max(few, room(period.comm, each))
    if settings.points <= most:
        return settings
    return replace(settings, points=most, more="there is no memory for more points: give fewer modes")

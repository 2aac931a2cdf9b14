"""Nonlinear response curves: branches of periodic motions over the frequency or the load."""

from __future__ import annotations

import contextlib
import functools
import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from ..capacity import FEW, require_memory, room
from ..checks import instance
from ..continuation.branch import Branch
from ..continuation.branch_following import HARMONICS, BranchSettings, follow_response, linear_branch
from ..continuation.orbit import Orbit
from ..continuation.problems.driven_orbits import ParameterRange
from ..continuation.search import find_steady_state
from ..continuation.shooting import shoot
from ..motion.contact_work import MOST, StepsTooLong
from ..motion.loading import amplitudes_only, communicator
from ..motion.period_map import Period
from ..motion.preparation import PeriodSettings, finer, prepare
from ..parallel import collective
from ..petsc import MPI
from ..progress import progress_bar
from ..recording.branch_file import BranchFile
from ..reduction.reduced_model import ReducedModel
from ..system.model import Model
from .analysis import analysis
from .options import FrequencyResponseOptions, LoadResponseOptions

# `Orbit.path` of a motion next to a period doubling.
DOUBLED = "period doubling"
# Instants a period at which a linear response is evaluated.
INSTANTS = 256


@analysis(FrequencyResponseOptions)
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
    stability: bool = True,
    file: str | None = None,
    resume: bool = False,
    progress: Callable[[float], None] | str | None = "auto",
) -> Branch:
    """Follow the periodic response over the forcing frequency, through folds; without contact the linear
    response.

    Parameters
    ----------
    model : Model or ReducedModel
    load : PointForce, EdgeLoad, a sum or a sequence of them
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
    stability : bool
        Compute Floquet multipliers and bifurcations.
    file : str, optional
        HDF5 file that is kept up to date (`read_branch`).
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
    """
    what, comm = "frequency_response", communicator(model)
    with collective(comm):
        if not contact and (file is not None or guess is not None):
            raise ValueError(f"{what}: the linear response, contact = False, takes neither file nor guess")
        check_begin(what, guess, start, periods)
        amplitudes_only(what, load)
    over, highest = ParameterRange("frequency", start, stop), max(start, stop)
    most = MOST if steps is None else 1
    steps, periods = _of_guess(guess, steps, periods)
    if not contact:
        linear = PeriodSettings(periods, INSTANTS, modes, contact)
        return linear_branch(prepare(what, model, load, highest, settings=linear), start, stop)

    def begin(period: Period) -> np.ndarray:
        state = period.at(over.start).linear_state if guess is None else guess.state
        return find_steady_state(period, over.start, state, multiples=False)[0].state

    with _file(comm, file, resume) as record:
        settings = PeriodSettings(periods, steps, modes, band=highest)
        period = prepare(what, model, load, over.start, settings=settings, guess=guess)
        asked = _continuation(points, largest_step, stability, guess, most * period.steps)
        return _follow(period, over, begin, asked, record, progress)


@analysis(LoadResponseOptions)
def load_response(
    model: Model | ReducedModel,
    load,
    frequency: float,
    start: float = 0.0,
    *,
    stop: float = 1.0,
    periods: int | None = None,
    steps: int | None = None,
    modes: int | None = None,
    guess: Orbit | None = None,
    points: int = 400,
    largest_step: float | None = None,
    stability: bool = True,
    file: str | None = None,
    resume: bool = False,
    progress: Callable[[float], None] | str | None = "auto",
) -> Branch:
    """Follow the periodic response over a factor on the oscillating loads at a fixed frequency; constant
    loads stay.

    Parameters
    ----------
    model : Model or ReducedModel
    frequency : float
        Forcing frequency, Hz.
    start, stop : float
        Factors; not negative.
    largest_step : float, optional
        Largest change of the factor from a point to the next one, for a finer curve.
    load, periods, steps, modes, guess, points, stability, file, resume, progress
        See `frequency_response`; `guess` is an orbit at the factor `start`.
    """
    what, comm = "load_response", communicator(model)
    with collective(comm):
        check_begin(what, guess, frequency, periods)
    most = MOST if steps is None else 1
    steps, periods = _of_guess(guess, steps, periods)

    def begin(period: Period) -> np.ndarray:
        state = guess.state if guess is not None else period.at(frequency, start).linear_state
        return shoot(period, state, frequency, start).state

    with _file(comm, file, resume) as record:
        settings = PeriodSettings(periods, steps, modes)
        period = prepare(what, model, load, frequency, settings=settings, guess=guess)
        asked = _continuation(points, largest_step, stability, guess, most * period.steps)
        over = ParameterRange("load", start, stop, frequency)
        return _follow(period, over, begin, asked, record, progress)


def _file(
    comm: MPI.Comm, file: str | None, resume: bool
) -> contextlib.AbstractContextManager[BranchFile | None]:
    """The file of the branch, if there is to be one."""
    return contextlib.nullcontext() if file is None else BranchFile(comm, file, resume=resume)


def _follow(
    period: Period,
    parameter: ParameterRange,
    begin: Callable[[Period], np.ndarray],
    settings: BranchSettings,
    record: BranchFile | None,
    progress: Callable[[float], None] | str | None,
) -> Branch:
    comm = period.reduced.comm
    settings = _with_room(period, parameter, settings)
    what = f"{parameter.name}_response"
    if record is not None:
        # in the steps of the file where none are asked for
        reduced, steps = record.begin(period, parameter, any_steps=settings.most_steps > period.steps)
        period = Period(reduced, period.excitation, steps, period.pairs > 0)
    with progress_bar(comm, f"{parameter.name} response", progress) as report:
        while True:
            first = functools.partial(begin, period)
            try:
                found = follow_response(
                    period, parameter, first, settings=settings, recorder=record, report=report
                )
                break
            except StepsTooLong as error:
                period = finer(what, period, error.times)
                if record is not None:
                    record.former = None
    return found


def _with_room(period: Period, parameter: ParameterRange, settings: BranchSettings) -> BranchSettings:
    """Settings with no more points than there is memory for: few branches take as many as they may.
    Collective.

    Raises
    ------
    ValueError
        If there is no room for `FEW`.
    """
    size, named = 2 * period.modes, len(period.reduced.points.names)
    # the derivative and the monodromy of each, its state, its multipliers and what it is asked for
    matrices = 2 if settings.stability else 1
    each = 8.0 * (matrices * size**2 + 3 * size + 4 * named * (HARMONICS + 1 + period.excitation.periods))
    few = min(settings.points, FEW)
    require_memory(
        f"{parameter.name}_response",
        period.reduced.comm,
        few * each,
        f"a branch of {few} points and {period.modes} modes",
        lambda share: "give fewer modes (modes)",
    )
    most = max(few, room(period.reduced.comm, each))
    if settings.points <= most:
        return settings
    return replace(settings, points=most, more="there is no memory for more points: give fewer modes")


def _of_guess(guess: Orbit | None, steps: int | None, periods: int | None) -> tuple[int | None, int | None]:
    """Steps and periods of the motion that a branch begins from."""
    if guess is None:
        return steps, 1 if periods is None else periods
    return (len(guess.time) // guess.periods if steps is None else steps), guess.periods


def _continuation(
    points: int, largest_step: float | None, stability: bool, guess: Orbit | None, most_steps: int
) -> BranchSettings:
    """How a branch is followed: from a motion beside a period doubling away from it."""
    leave = guess is not None and guess.path == DOUBLED
    return BranchSettings(points, largest_step or math.inf, stability, leave, most_steps)


def check_begin(what: str, guess: Orbit | None, frequency: float, periods: int | None = None) -> None:
    """Raise unless a motion to begin from, if there is one, is at a frequency and of so many periods."""
    if guess is None:
        return
    instance(what, "guess", guess, Orbit, "an Orbit")
    if abs(guess.frequency - frequency) > 1e-9 * frequency:
        raise ValueError(f"{what}: guess is at {guess.frequency:g} Hz, not at {frequency:g} Hz")
    if periods not in (None, guess.periods):
        raise ValueError(f"{what}: guess takes {guess.periods} forcing periods, not periods = {periods}")

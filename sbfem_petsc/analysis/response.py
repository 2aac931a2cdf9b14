"""Nonlinear response curves: branches of periodic motions over the frequency or the load."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from ..capacity import FEW, require_memory, room
from ..checks import Bounds, flag, instance, integer, path, positive, real
from ..checks import frequency as check_frequency
from ..checks import progress as check_progress
from ..dynamics.branch import Branch
from ..dynamics.branch_following import HARMONICS, BranchSettings, follow_response, linear_branch
from ..dynamics.driven_orbits import ParameterRange
from ..dynamics.loading import communicator
from ..dynamics.orbit import Orbit
from ..dynamics.period_map import Period
from ..dynamics.preparation import PeriodSettings, prepare
from ..dynamics.shooting import shoot
from ..dynamics.steady import find_steady_state
from ..loads import as_loads
from ..parallel import agreed, collective
from ..petsc import MPI
from ..progress import progress_bar
from ..recording.branch_file import BranchFile
from ..reduction.reduced_model import ReducedModel
from ..signals.signal import Constant, Signal
from ..system.model import Model
from ..system.plausibility import warn_of_amplitudes

# `Orbit.path` of a motion next to a period doubling.
DOUBLED = "period doubling"
# Instants a period at which a linear response is evaluated.
INSTANTS = 256


@agreed()
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
    first: Orbit | None = None,
    points: int = 400,
    largest_step: float = math.inf,
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
    load : PointForce, EdgeLoad, a sum or a sequence of them; for a system of matrices a value for each of its
    unit loads
        Numbers are amplitudes of sin(2 pi f t) at the swept frequency; `Constant` signals are preloads.
    start, stop : float
        Hz; `stop` below `start` sweeps downwards.
    contact : bool
    periods, steps, modes
        See `periodic`.
    first : Orbit, optional
        A motion at `start` on the branch that is wanted, of its own number of periods. Default: the one
        `periodic` finds. From one that `switch_branch` has found the branch goes away from the period
        doubling, if need be through a fold outside the range.
    points : int
        Points at most.
    largest_step : float
        Largest change of the frequency (Hz) from a point to the next one, for a finer curve.
    stability : bool
        Compute Floquet multipliers and bifurcations.
    file : str, optional
        HDF5 file that is kept up to date (`read_branch`).
    resume : bool
        Continue `file` if it exists, with the same model, loads and settings.
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
    what = "frequency_response"
    comm = communicator(model)
    with collective(comm):
        start, stop = check_frequency(what, "start", start), check_frequency(what, "stop", stop)
        PeriodSettings(periods, steps, modes, contact).checked(what)
        if first is not None:
            instance(what, "first", first, Orbit, "an Orbit")
        if start == stop:
            raise ValueError(f"{what}: start and stop are both {start:g} Hz; give a range, or use periodic")
        if not contact and (file is not None or first is not None):
            raise ValueError(f"{what}: the linear response, contact = False, takes neither file nor first")
        flag(what, "contact", contact)
        settings = _checked(what, points, largest_step, stability, first, start)
        _check_file(what, file, resume)
        check_progress(what, progress)
        amplitudes_only(what, load)
        if first is not None and periods not in (None, first.periods):
            raise ValueError(f"{what}: first takes {first.periods} forcing periods, not periods = {periods}")
    steps, periods = _of_first(first, steps, periods)
    highest = max(start, stop)
    shooting = PeriodSettings(periods, steps, modes, contact)
    if not contact:
        linear = replace(shooting, steps=INSTANTS)
        found = linear_branch(prepare(what, model, load, highest, settings=linear), start, stop)
        warn_of_amplitudes(what, found)
        return found

    def begin(period: Period) -> np.ndarray:
        guess = period.at(start).linear_state if first is None else first.state
        return find_steady_state(period, start, guess, multiples=False)[0].state

    with _file(comm, file, resume) as record:
        wide = replace(shooting, band=highest)
        period = prepare(what, model, load, start, settings=wide, first=first)
        return _follow(period, ParameterRange("frequency", start, stop), begin, settings, record, progress)


@agreed()
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
    first: Orbit | None = None,
    points: int = 400,
    largest_step: float = math.inf,
    stability: bool = True,
    file: str | None = None,
    resume: bool = False,
    progress: Callable[[float], None] | str | None = "auto",
) -> Branch:
    """Follow the periodic response over a factor on the oscillating loads at a fixed frequency; constant
    loads stay.

    Parameters
    ----------
    start, stop : float
        Factors; not negative.
    load, frequency, periods, steps, modes, first, points, largest_step, stability, file, resume,
    progress
        See `frequency_response`; `first` is an orbit at the factor `start`.
    """
    what = "load_response"
    comm = communicator(model)
    with collective(comm):
        start, stop = (
            real(what, name, value, within=Bounds(least=0.0, most=1e15))
            for name, value in (("start", start), ("stop", stop))
        )
        if start == stop:
            raise ValueError(f"{what}: start and stop are both {start:g}; give a range, or use periodic")
        check_progress(what, progress)
        frequency = check_frequency(what, "frequency", frequency)
        PeriodSettings(periods, steps, modes).checked(what)
        settings = _checked(what, points, largest_step, stability, first, frequency)
        _check_file(what, file, resume)
    steps, periods = _of_first(first, steps, periods)
    shooting = PeriodSettings(periods, steps, modes)

    def begin(period: Period) -> np.ndarray:
        guess = first.state if first is not None else period.at(frequency, start).linear_state
        return shoot(period, guess, frequency, start).state

    with _file(comm, file, resume) as record:
        period = prepare(what, model, load, frequency, settings=shooting, first=first)
        parameter = ParameterRange("load", start, stop, frequency)
        return _follow(period, parameter, begin, settings, record, progress)


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
    if record is not None:
        period = Period(record.begin(period, parameter), period.excitation, period.steps, period.pairs > 0)
    with progress_bar(comm, f"{parameter.name} response", progress) as report:
        found = follow_response(
            period, parameter, lambda: begin(period), settings=settings, recorder=record, report=report
        )
    warn_of_amplitudes(f"{parameter.name}_response", found)
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


def _of_first(first: Orbit | None, steps: int | None, periods: int | None) -> tuple[int | None, int | None]:
    """Steps and periods of the motion that a branch starts from."""
    if first is None:
        return steps, 1 if periods is None else periods
    return (len(first.time) // first.periods if steps is None else steps), first.periods


def _checked(
    what: str,
    points: int,
    largest_step: float,
    stability: bool,
    first: Orbit | None,
    frequency: float,
) -> BranchSettings:
    points = integer(what, "points", points, least=2)
    if not (isinstance(largest_step, float) and largest_step == math.inf):
        positive(what, "largest_step", largest_step)
    flag(what, "stability", stability)
    if first is not None:
        instance(what, "first", first, Orbit, "an Orbit")
        if abs(first.frequency - frequency) > 1e-9 * frequency:
            raise ValueError(f"{what}: first is at {first.frequency:g} Hz, not at {frequency:g} Hz")
    leave = first is not None and first.path == DOUBLED
    return BranchSettings(points, float(largest_step), stability, leave)


def _check_file(what: str, file: str | None, resume: bool) -> None:
    if file is not None:
        path(what, "file", file)
    flag(what, "resume", resume)
    if resume and file is None:
        raise ValueError(f"{what}: resume = True needs the file to continue, file = 'branch.h5'")


def amplitudes_only(what: str, load) -> None:
    """Refuse signals other than constants where the frequency is swept."""
    values = load if isinstance(load, (list, tuple)) else (load,)
    named = [("load", value) for value in values if isinstance(value, Signal)]
    if not named and not all(isinstance(value, (int, float)) for value in values):
        named = [
            (name, value)
            for item in as_loads(load).parts
            for name, value in item.components.items()
            if isinstance(value, Signal)
        ]
    for name, value in named:
        if isinstance(value, Signal) and not isinstance(value, Constant):
            raise ValueError(
                f"{what}: {name} = {value!r} does not follow the swept frequency; give a number, the "
                "amplitude of sin(2 pi f t), or a Constant"
            )

"""Steady states under periodic loads: the periodic motion itself, by shooting, and its stability."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..checks import Bounds, flag, instance, integer, real
from ..checks import frequency as check_frequency
from ..dynamics.loading import communicator
from ..dynamics.multiple_shooting import segmented_stability, shoot_segments
from ..dynamics.orbit import Orbit, make_orbit, orbit_stability
from ..dynamics.period_map import Period
from ..dynamics.preparation import LONGEST, PeriodSettings, check_reduction, prepare
from ..dynamics.states import ModalStates
from ..dynamics.steady import NEWTON_ALONE, Search, find_steady_state
from ..dynamics.unreduced_shooting import unreduced_periodic
from ..errors import SolveError, on_all_ranks
from ..parallel import agreed, collective
from ..reduction.reduced_model import ReducedModel
from ..system.model import Model
from ..system.plausibility import warn_of_motion

# Stands for True of a reduced model; the multipliers of an unreduced one are not computed.
_OF_REDUCED = object()
# Times the steps are doubled to meet a tolerance.
DOUBLINGS = 7


@agreed()
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
    start: Orbit | None = None,
    jacobian: str = "auto",
    stability: Any = _OF_REDUCED,
    longest: int = LONGEST,
    tolerance: float | None = None,
    search: Search | None = None,
    segments: int = 1,
) -> Orbit:
    """Find the periodic response to periodic loads by shooting.

    Parameters
    ----------
    model : Model or ReducedModel
        Its damping ratio is that of all modes. A model is reduced once for the places of its loads.
    load : PointForce, EdgeLoad, SupportMotion, a sum or a sequence of them
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
        Time steps a forcing period. Default: 512, or as many as keep the step below 0.8 of the shortest modal
        period (coarser ones let contact excite modes falsely) and below 1 / 32 of the shortest load period.
    modes : int, optional
        Default: all modes up to 8 times the loads' highest frequency, at least 80.
    contact : bool
        False: the faces may overlap.
    reduction : "modes" or None
        None: the unreduced model, distributed and without a matrix (see `dynamics.unreduced_shooting`).
    start : Orbit, optional
        First guess, of the same model. Default: the response without contact.
    jacobian : {"auto", "dense", "matrix-free", "differences"}
        See `shooting.shoot`.
    stability : bool, optional
        Compute the Floquet multipliers. Default: True of a reduced model; those of an unreduced one are not
        computed.
    longest : int
        Most forcing periods in a common period of tones.
    tolerance : float, optional
        The steps are doubled until the displacements of all named points change by less than this, relative
        L2 over the period; the change is `step_error`.

    search : dynamics.steady.Search, optional
        How far a motion is looked for where Newton's method does not converge from the first guess.
    segments : int
        More than 1: multiple shooting over so many parts of the period, from `start` or the linear response
        alone, without a search; for periods in which disturbances grow by 1e6 or more, and for many periods
        of a fast tone in one of a slow one. The period's steps are a multiple of it; the default is.

    Raises
    ------
    ValueError, TypeError, KeyError
        For input that makes no sense, tones without a common period, an undamped mode driven at its own
        frequency.
    SolveError
        If no motion is found, by Newton's method, behind a history, or along a ramp of the load, the damping
        or the frequency (see `dynamics.steady`), or the tolerance is not met.

    Warns
    -----
    LargeDisplacementWarning
        If displacements of named points are more than 5 % of the body.
    """
    with collective(communicator(model)):
        segments = integer("periodic", "segments", segments, least=1, most=10**4)
        settings = PeriodSettings(periods, steps, modes, contact, jacobian, longest, segments)
        stability = reduction is not None if stability is _OF_REDUCED else stability
        flag("periodic", "stability", stability)
        settings = settings.checked("periodic")
        check_reduction("periodic", reduction)
        frequency = check_frequency("periodic", "frequency", frequency)
        if search is not None:
            instance("periodic", "search", search, Search, "a dynamics.steady.Search")
        if tolerance is not None:
            real("periodic", "tolerance", tolerance, "relative", within=Bounds(above=0.0, below=1.0))
        if segments > 1 and (search is not None or jacobian != "auto" or reduction is None):
            raise ValueError(
                f"periodic: segments = {segments} takes neither search nor jacobian nor reduction = None"
            )
        if search is not None and not contact:
            raise ValueError(
                "periodic: search has no use without contact: the motion is that of linear modes"
            )
        if reduction is None:
            _check_unreduced(model, settings, start, tolerance)
            if search is not None or stability:
                raise ValueError(
                    "periodic: search and stability = True are for the reduced model; the unreduced one is "
                    "looked for behind a history if need be, and its multipliers are not computed"
                )
    if reduction is None:
        assert isinstance(model, Model)
        found = unreduced_periodic(model, load, frequency, settings=settings)
        warn_of_motion("periodic", model, found)
        return found
    task = _Task(model, load, frequency, stability, search if contact else NEWTON_ALONE, segments)
    found = _shot(task, settings, start) if tolerance is None else _refined(task, settings, start, tolerance)
    warn_of_motion("periodic", model, found)
    return found


@dataclass(frozen=True, eq=False)
class _Task:
    """What an orbit is asked for, whatever its steps."""

    model: Model | ReducedModel
    load: Any
    frequency: float
    stability: bool
    search: Search | None
    segments: int


def _shot(task: _Task, settings: PeriodSettings, start: Orbit | None) -> Orbit:
    """The orbit at given steps."""
    period = prepare("periodic", task.model, task.load, task.frequency, settings=settings, first=start)
    if task.segments > 1:
        return _in_segments(task, period, start)
    guess = period.at(task.frequency).linear_state if start is None else start.state
    fixed, path = find_steady_state(
        period,
        task.frequency,
        guess,
        jacobian=settings.jacobian,
        multiples=settings.periods is None,
        search=task.search,
    )
    if not task.stability:
        return make_orbit(fixed, np.zeros(0, dtype=complex), math.nan, path)
    return make_orbit(fixed, *orbit_stability(fixed.driven.period, fixed, task.frequency), path)


def _in_segments(task: _Task, period: Period, start: Orbit | None) -> Orbit:
    """The orbit by multiple shooting."""
    if period.steps % task.segments:
        raise on_all_ranks(
            ValueError(
                f"periodic: {period.steps} steps a period are no multiple of segments = {task.segments}; "
                "give another number of either"
            )
        )
    guess = None if start is None else _at_segments(start, period, task)
    fixed, segmented, motions = shoot_segments(period, task.frequency, task.segments, guess)
    if not task.stability:
        return make_orbit(fixed, np.zeros(0, dtype=complex), 0.0, "multiple shooting")
    return make_orbit(fixed, *segmented_stability(segmented, motions), "multiple shooting")


def _at_segments(start: Orbit, period: Period, task: _Task) -> np.ndarray:
    """(segments, 2 m): a motion at the segments' beginnings, in differences to the linear response; one under
    a multiple of the frequency is repeated as often as it takes.
    """
    driven = period.at(task.frequency)
    instants = np.arange(task.segments) * (period.steps // task.segments)
    # in forcing periods: motions under neighbouring frequencies keep their phase
    times = max(1, round(start.frequency / task.frequency))
    places = times * instants * period.excitation.periods / period.steps / start.periods * len(start.time)
    assert isinstance(start.states, ModalStates)  # of the same reduced model
    states = np.concatenate([period.weights * start.states.q, start.states.v], axis=1)
    before = np.floor(places + 1e-9).astype(int)
    share = (places - before)[:, None]
    states = (1.0 - share) * states[before % len(states)] + share * states[(before + 1) % len(states)]
    q, v = (
        period.over_time(part)[instants] for part in (driven.amplitudes, driven.speeds * driven.amplitudes)
    )
    linear = np.concatenate([period.weights * q, v], axis=1)
    return states - linear


def _refined(task: _Task, settings: PeriodSettings, start: Orbit | None, tolerance: float) -> Orbit:
    """An orbit whose displacements do not change by more than a tolerance when its steps are doubled."""
    found = _shot(task, settings, start)
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
    raise on_all_ranks(
        SolveError(
            f"periodic: with {steps} steps a period the displacements still change by {error:.2g} when the "
            f"steps are doubled; a tolerance of {tolerance:g} is not met"
        )
    )


def _check_unreduced(model, settings: PeriodSettings, start, tolerance) -> None:
    """What shooting on the unreduced model cannot do."""
    if not isinstance(model, Model):
        raise ValueError("periodic: reduction = None needs the model itself, not a reduced one")
    if tolerance is not None:
        raise ValueError(
            "periodic: tolerance is for the reduced model; repeat the unreduced one with more steps"
        )
    if start is not None or settings.jacobian not in ("auto", "matrix-free"):
        raise ValueError(
            "periodic: start and jacobian are for the reduced model; the unreduced one starts from its "
            "linear response, without a matrix"
        )

"""Histories with a slowly swept frequency: what an experiment sees of a response curve."""

from __future__ import annotations

import functools
import math
from dataclasses import replace

import numpy as np

from ..continuation.accuracy import Accuracy
from ..continuation.orbit import Orbit, require_at
from ..continuation.problems.driven_orbits import ParameterRange
from ..errors import wrong_input
from ..loads import Load, Loads
from ..motion.loading import amplitudes_only, communicator, loading
from ..motion.period_map import Period
from ..motion.preparation import PeriodSettings, check_guess, following, prepare, serving, steps_of
from ..motion.states import ModalStates
from ..motion.swept import SweptLoads, SweptResponse, directions, settling_cycles
from ..progress import Progress, progress_bar
from ..ranks.capacity import require_memory
from ..ranks.parallel import collective
from ..reduction import build
from ..reduction.build import MOST_OF_MANY
from ..reduction.reduced_model import ReducedModel, share_modes
from ..signals.waves import Chirp
from ..system.model import Model
from .analysis import analysis
from .options import LONGEST, SweptOptions
from .periodic import periodic

# Steps a period of the highest frequency: the load is linear over a step, an error of 3e-5.
STEPS = 320
# Relative distance of a steady state that is given from the one that is found from it.
SAME = 1e-6


@analysis(SweptOptions, rubs=True)
def swept_response(
    model: Model | ReducedModel,
    load,
    start: float,
    stop: float,
    *,
    duration: float,
    initial: Orbit | None = None,
    steps: int | None = None,
    modes: int | None = None,
    accuracy: float | None = None,
    progress: Progress = "auto",
) -> SweptResponse:
    """Integrate a motion under a forcing frequency that runs linearly from `start` to `stop`, from a steady
    state, and keep its amplitude in each cycle.

    Parameters
    ----------
    model : Model or ReducedModel
    load : PointForce, EdgeLoad, SupportMotion, EdgeMotion, a sum or a sequence of them
        For a system of matrices a value for each of its unit loads. Numbers are amplitudes of the
        swept sine; `Constant` signals are preloads.
    start, stop : float
        Hz; `stop` below `start` sweeps downwards.
    duration : float
        s. The motion keeps up with the steady states where the frequency changes in the time in which
        disturbances fall to 1/e, 1 / (zeta omega), by little of the half-power bandwidth 2 zeta f.
    initial : Orbit, optional
        The steady state at t = 0, at `start`, of this model and load. Default: the one that `periodic` finds.
    steps : int, optional
        Steps in a period of the higher frequency. Default: 320, or as many as keep the step below 0.8 of the
        shortest modal period.
    modes : int, optional
        Default: as many as `accuracy` needs; where that is none all modes up to 8 times the loads' highest
        frequency, at least 80.
    accuracy : float, optional
        Of harmonics 1 to 4 of the steady states at both ends and at the linear peak between them, as of
        `periodic`, told in `mode_error`: modes and steps that are not given are as many as it needs.
        Default: as of `periodic`, in 160 modes at most.
    progress : callable, "auto" or None
        As for `transient`.

    Returns
    -------
    SweptResponse

    Raises
    ------
    ValueError, TypeError, KeyError
        For input that makes no sense, and for a sweep of less than two cycles or more than 1e9 steps.
    SolveError
        If a contact problem is not solved, or no steady state is found at `start`.

    Warns
    -----
    AccuracyWarning
        If the told error is above `accuracy` in the modes or steps given, or in as many as there may be.
    """
    what, comm = "swept_response", communicator(model)
    with collective(comm):
        require_at(what, "initial", initial, start)
        amplitudes_only(what, load)
        loads = loading(what, model, load, lambda value: Chirp(value, start, stop, duration))
        loads = loads.over(what, duration, rest=False)
        if not any(isinstance(signal, Chirp) and signal.amplitude for signal in loads.signals):
            raise ValueError(f"{what}: no load oscillates; give a number, the amplitude of the swept sine")
    highest = max(start, stop)
    told, least = math.nan, STEPS
    settings = PeriodSettings(1, steps, modes, band=highest, accuracy=accuracy, vectors=False)
    settings = following(settings, model, MOST_OF_MANY)
    if settings.accuracy is None:
        reduced = serving(what, model, loads, settings, highest)
    else:
        period, told = _accurate(model, load, (start, stop), settings)
        reduced, least = period.reduced, max(least, period.steps)
    asked = replace(settings, least=least)
    steps = steps_of(what, reduced, asked, (highest, highest), "period of the higher frequency")
    count = math.ceil(duration * highest * steps)
    if count > LONGEST:
        raise wrong_input(f"{what}: duration = {duration:g} s takes {count:.3g} steps; shorten it")
    points = len(reduced.points.names)
    require_memory(
        what,
        comm,
        8.0 * (count + 1) * (points * directions(reduced) + 1),
        f"{count:,d} steps at {points} points",
        lambda share: f"sweep in {duration * share:.3g} s, or in parts",
    )
    if initial is None:
        initial = periodic(reduced, load, start, stability=False, progress=progress)
    else:
        initial = _steady(initial, reduced, load)
    state = initial.states
    assert isinstance(state, ModalStates)
    drive = SweptLoads.of(
        loads.signals,
        (start, stop),
        duration=duration,
        steps=count,
        q=state.q[0],
        v=state.v[0],
        slip=state.gap[-1, reduced.gaps :],  # faces remember the instant before
    )
    with progress_bar(comm, "swept response", progress) as report:
        amplitudes, contact = drive.motion(reduced, reduced.points, report)
    return SweptResponse(
        1.0 / np.diff(drive.ends),
        drive,
        amplitudes[:, :, -1],
        contact,
        settling_cycles(reduced, (start, stop)),
        reduced,
        None if reduced.of_rows else amplitudes[:, :, 0],
        told,
    )


def _accurate(
    model: Model | ReducedModel, load, ends: tuple[float, float], settings: PeriodSettings
) -> tuple[Period, float]:
    """The map of steady states that are as accurate as asked, if these may be had, and what is told."""
    what, over = "swept_response", ParameterRange("frequency", *ends)
    accuracy = Accuracy(what, model, settings)

    def prepared(settings: PeriodSettings) -> Period:
        return prepare(what, model, load, ends[0], settings=settings)

    period = accuracy.tried(over, prepared(settings), prepared)
    return period, accuracy.told(over, period)


def _steady(initial: Orbit, reduced: ReducedModel, load) -> Orbit:
    """A motion in the modes of a reduced model, refused where it is none under this load."""
    what, own = "swept_response", initial.reduced
    with collective(communicator(reduced)):
        check_guess(what, initial, reduced, carried=True)
    assert own is not None  # checked
    same = share_modes(reduced, own)
    find = functools.partial(
        periodic,
        load=load,
        frequency=initial.frequency,
        periods=initial.periods,
        guess=initial,
        stability=False,
        progress=None,
    )
    # under this load and with this damping, which are not those that it was reduced for
    system: Model | ReducedModel = reduced
    if not same and reduced.model is not None:
        parts = load if isinstance(load, (list, tuple)) else (load,)
        system = reduced.model  # in its modes, and vectors of the loads that act, as periodic begins from it
        if not all(isinstance(part, (Load, Loads)) for part in parts):  # but those of this reduced model
            system = build.reduced(reduced.model, reduced.loads, own.natural, own.vectors > 0)
    found = find(system, steps=len(initial.time) // initial.periods)
    alike = found.state.shape == initial.state.shape  # vectors are those of other loads
    if not alike or np.linalg.norm(found.state - initial.state) > SAME * np.linalg.norm(found.state):
        raise wrong_input(
            f"{what}: initial = {initial!r} is no steady state under this load; leave it out, or give one"
        )
    return initial if same else find(reduced)

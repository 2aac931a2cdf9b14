"""Histories with a slowly swept frequency: what an experiment sees of a response curve."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from ..capacity import require_memory
from ..checks import frequency as check_frequency
from ..checks import instance, optional_integer, positive
from ..checks import progress as check_progress
from ..dynamics.integration import Steps
from ..dynamics.loading import communicator, loading, serving
from ..dynamics.orbit import Orbit
from ..dynamics.preparation import check_first
from ..dynamics.reduced_history import ReducedIntegrator
from ..dynamics.states import ModalStates
from ..dynamics.step_plan import CONTACT_STEP
from ..dynamics.swept import SweptResponse, cycle_ends, over_cycles, settling_cycles
from ..errors import on_all_ranks
from ..parallel import agreed, collective
from ..progress import progress_bar
from ..reduction.reduced_model import ReducedModel
from ..signals.waves import Chirp
from ..system.model import Model
from .periodic import periodic
from .response import amplitudes_only

# Steps a period of the highest frequency: the load is linear over a step, an error of 3e-5.
STEPS = 320
# Relative distance of a steady state that is given from the one that is found from it.
SAME = 1e-6
# More steps than this are refused: hours.
MOST = 10**9


@agreed()
def swept_response(
    model: Model | ReducedModel,
    load,
    start: float,
    stop: float,
    *,
    duration: float,
    first: Orbit | None = None,
    steps: int | None = None,
    modes: int | None = None,
    progress: Callable[[float], None] | str | None = "auto",
) -> SweptResponse:
    """Integrate a motion under a forcing frequency that runs linearly from `start` to `stop`, from a steady
    state, and keep its amplitude in each cycle.

    Parameters
    ----------
    model : Model or ReducedModel
    load : PointForce, EdgeLoad, a sum or a sequence of them; for a system of matrices a value for each of its
    unit loads
        Numbers are amplitudes of the swept sine; `Constant` signals are preloads.
    start, stop : float
        Hz; `stop` below `start` sweeps downwards.
    duration : float
        s. The motion keeps up with the steady states where the frequency changes in the time in which
        disturbances fall to 1/e, 1 / (zeta omega), by little of the half-power bandwidth 2 zeta f.
    first : Orbit, optional
        Steady state at `start`, of this model and load. Default: the one that `periodic` finds.
    steps : int, optional
        Steps in a period of the higher frequency. Default: 320, or as many as keep the step below 0.8 of the
        shortest modal period.
    modes : int, optional
        Default: as for `frequency_response`.
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
    """
    what = "swept_response"
    comm = communicator(model)
    with collective(comm):
        start, stop = check_frequency(what, "start", start), check_frequency(what, "stop", stop)
        if start == stop:
            raise ValueError(f"{what}: start and stop are both {start:g} Hz; give a range, or use periodic")
        duration = positive(what, "duration", duration, "s")
        steps = optional_integer(what, "steps", steps, least=48, most=10**7)
        modes = optional_integer(what, "modes", modes, least=1)
        if first is not None:
            instance(what, "first", first, Orbit, "an Orbit")
            if abs(first.frequency - start) > 1e-9 * start:
                raise ValueError(f"{what}: first is at {first.frequency:g} Hz, not at {start:g} Hz")
        check_progress(what, progress)
        amplitudes_only(what, load)
        if not 2.0 <= 0.5 * (start + stop) * duration <= MOST:
            raise ValueError(
                f"{what}: duration = {duration:g} s holds {0.5 * (start + stop) * duration:.3g} cycles; a "
                f"sweep of 2 to {MOST:g} is expected"
            )
        loads = loading(what, model, load, lambda value: Chirp(value, start, stop, duration))
        loads = loads.over(duration, rest=False)
        if not any(isinstance(signal, Chirp) and signal.amplitude for signal in loads.signals):
            raise ValueError(f"{what}: no load oscillates; give a number, the amplitude of the swept sine")
    highest = max(start, stop)
    reduced = serving(what, model, loads, modes, highest)
    if steps is None:
        steps = STEPS
        if len(reduced.initial_gap):
            steps = max(steps, math.ceil(float(reduced.frequencies.max()) / (CONTACT_STEP * highest)))
    count = math.ceil(duration * highest * steps)
    if count > MOST:
        raise on_all_ranks(
            ValueError(f"{what}: duration = {duration:g} s takes {count:.3g} steps; shorten it")
        )
    points = len(reduced.points.names)
    require_memory(
        what,
        comm,
        8.0 * (count + 1) * (points + 1),
        f"{count:,d} steps at {points} points",
        lambda share: f"sweep in {duration * share:.3g} s, or in parts",
    )
    first = (
        periodic(reduced, load, start, stability=False) if first is None else _checked(first, reduced, load)
    )
    state = first.states
    assert isinstance(state, ModalStates)
    plan = Steps(count, duration / count, True, "exact", 1)
    integrator = ReducedIntegrator(reduced, loads.signals, plan, (state.q[0], state.v[0]))
    displacements = np.empty((count + 1, len(reduced.points.names)))
    contact = np.empty((count + 1, 1))

    def keep(at: int, rows) -> None:
        part = reduced.points(rows["modal_displacement"], rows["amplitudes"], rows["contact_force"])
        displacements[at : at + len(part)] = part[:, :, 1]
        contact[at : at + len(part), 0] = rows["contact_force"].sum(axis=1)

    keep(0, integrator.first())
    with progress_bar(comm, "swept response", progress) as report:
        done = 0
        while done < count:
            size = min(integrator.chunk, count - done)
            keep(done + 1, integrator.advance(done, size, 1))
            done += size
            if report is not None:
                report(done / count)
    ends = cycle_ends(start, stop, duration)
    low, high = over_cycles(ends, plan.step, displacements)
    return SweptResponse(
        1.0 / np.diff(ends),
        duration,
        0.5 * (high - low),
        over_cycles(ends, plan.step, contact)[1][:, 0],
        settling_cycles(reduced, (start, stop)),
        reduced,
    )


def _checked(first: Orbit, reduced: ReducedModel, load) -> Orbit:
    """The motion to begin from, if it is one under this load."""
    what, steps = "swept_response", len(first.time) // first.periods
    with collective(communicator(reduced)):
        check_first(what, first, reduced)
    found = periodic(
        reduced, load, first.frequency, periods=first.periods, steps=steps, start=first, stability=False
    )
    if np.linalg.norm(found.state - first.state) > SAME * np.linalg.norm(found.state):
        raise on_all_ranks(
            ValueError(
                f"{what}: first = {first!r} is no steady state under this load; leave it out, or give one"
            )
        )
    return first

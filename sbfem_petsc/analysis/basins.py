"""Which steady state the histories from many initial states settle on."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..checks import shown
from ..contact.repeating import Patience
from ..continuation.attraction import Attraction
from ..continuation.basins import Basins, StartAxis, count_of, initial_states, state_of
from ..continuation.orbit import Orbit, require_at
from ..motion.loading import communicator
from ..motion.preparation import PeriodSettings, beginning, check_guess, prepare, refuse_falling
from ..petsc import MPI
from ..progress import Progress, progress_bar
from ..ranks.capacity import require_memory
from ..ranks.parallel import checked_communicator, collective
from ..reduction.reduced_model import ReducedModel
from ..system.model import Model
from .analysis import analysis
from .options import BasinsOptions


@analysis(BasinsOptions, rubs=True)
def basins(
    model: Model | ReducedModel,
    load,
    frequency: float,
    starts: Sequence[StartAxis] | tuple[np.ndarray, np.ndarray],
    *,
    orbits: Sequence[Orbit] = (),
    around: Orbit | None = None,
    steps: int | None = None,
    modes: int | None = None,
    longest: int = 8,
    tolerance: float = 1e-7,
    limit: int = 2000,
    progress: Progress = "auto",
    comm: MPI.Comm | None = None,
) -> Basins:
    """Find which steady state histories from a grid or a sample of initial states settle on.

    Histories are shared by the ranks of `comm`.

    Parameters
    ----------
    model : Model or ReducedModel
    load : PointForce, EdgeLoad, SupportMotion, EdgeMotion, a sum or a sequence of them
        For a system of matrices a value for each of its unit loads. As for `periodic`.
    frequency : float
        Hz.
    starts : sequence of StartAxis, or (q, v)
        Axes of a grid of states at t = 0, or arrays (..., m) of modal coordinates and their rates.
    orbits : sequence of Orbit
        Steady states that are known, stable or not, of the same model, load and frequency: with them
        histories end sooner, and unstable ones stand in the picture. Others are found, and those in other
        steps found again.
    around : Orbit, optional
        The motion to whose state at t = 0 the axes' values are added: an impulse upon a steady state.
        Default: rest.
    steps, modes : int, optional
        See `periodic`; steps by default the most of those of `orbits` and `around`.
    longest : int
        Most periods of the loads after which a steady state may repeat itself.
    tolerance : float
        Relative change of the state over its period below which a history has settled.
    limit : int
        Periods of the loads that a history is followed at most.
    progress : callable, "auto" or None
        As for `transient`.
    comm : mpi4py communicator, optional
        Default: the model's; of a system of matrices each rank's own.

    Returns
    -------
    Basins

    Raises
    ------
    TypeError, ValueError, KeyError
        For input that makes no sense, for an orbit that is no motion of this model under this load, and if
        the initial states would take more memory than is free.
    SolveError
        If a contact problem is not solved.
    """
    what = "basins"
    own = communicator(model)
    with collective(own):
        ranks = own if comm is None else checked_communicator(what, comm)
    with collective(ranks):
        orbits = _checked_orbits(orbits, around, frequency)
        count = count_of(starts)
    given = [*orbits, *([] if around is None else [around])]
    if given and steps is None:
        steps = max(len(orbit.time) // orbit.periods for orbit in given)
    settings = beginning(PeriodSettings(None, steps, modes), given[0] if given else None)
    period = prepare(what, model, load, frequency, settings=settings, guess=given[0] if given else None)
    # the grid and the product it is summed from, flat copies of the parts, their ends
    require_memory(
        what,
        ranks,
        4.0 * 16 * period.modes * count,
        f"{count:,d} initial states of {period.modes} modes",
        lambda share: f"give at most {int(share * count):,d}, or fewer modes",
    )
    refuse_falling(what, period.friction)
    with collective(ranks):
        for orbit in given:
            check_guess(what, orbit, period.reduced)
        origin = np.zeros(period.unknowns) if around is None else state_of(around, period.unknowns)
        axes, states = initial_states(starts, period.reduced, period.weights, origin)
        if not period.excitation.oscillating.amplitudes.any():
            raise ValueError(f"basins: no load oscillates at {frequency:g} Hz; give one that is not zero")
        attraction = Attraction(period, frequency, Patience(longest, tolerance, limit), ranks)
        for orbit in orbits:
            state_of(orbit, period.unknowns)
            attraction.add(orbit)
    flat = states.reshape(-1, states.shape[-1])
    with progress_bar(ranks, "basins", progress) as report:
        reached, periods = attraction.follow(flat, report)
    shape, moving = states.shape[:-1], states[..., : 2 * period.modes]
    return Basins(
        frequency, tuple(attraction.orbits), reached.reshape(shape), periods.reshape(shape), moving, axes
    )


def _checked_orbits(orbits, around, frequency: float) -> tuple[Orbit, ...]:
    if not isinstance(orbits, (list, tuple)) or any(orbit is None for orbit in orbits):
        raise TypeError(f"basins: orbits = {shown(orbits)} must be a sequence of Orbit")
    named = [(f"orbits[{k}]", orbit) for k, orbit in enumerate(orbits)]
    for name, orbit in [*named, ("around", around)]:
        require_at("basins", name, orbit, frequency)
    return tuple(orbits)

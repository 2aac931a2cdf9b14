"""A history in modes and steps in which its displacements are as accurate as was asked for."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from meshing.warnings import StepWarning

from ..continuation.accuracy import Accuracy, Words
from ..continuation.harmonic_errors import beyond
from ..continuation.orbit import LOWEST
from ..motion.history import History
from ..motion.loading import Loading
from ..motion.preparation import PeriodSettings
from ..motion.step_plan import CONTACT_STEP
from ..reduction.build import modes_for, reduced, wider
from ..reduction.reduced_model import ReducedModel
from ..system.model import Model

WORDS = Words("displacements over time", "", "give a shorter step")


def accurate_history(
    model: Model | ReducedModel,
    loads: Loading,
    asked: tuple[float, int | None, float | None],
    run: Callable[[ReducedModel, float | None, int | None], History],
) -> History:
    """A history whose told error, see `_errors`, is within an accuracy as far as modes and steps may grow.
    Collective.

    Parameters
    ----------
    asked : (float, int or None, float or None)
        The accuracy; modes and step where they are given.
    run : callable
        The history of a reduced model in a step (s), every so many of which are kept; None: the default.
    """
    accuracy, modes, step = asked
    count = modes
    if modes is None and isinstance(model, Model):
        # loads that jump move all modes
        count = modes_for(model, 0.0 if loads.sudden else loads.highest_frequency, accuracy)
    wanted = None
    while True:
        r = model if isinstance(model, ReducedModel) else reduced(model, loads.units, count or 0)
        found = run(r, step, None)
        steps = round(loads.duration / found.step)
        if wanted is None:
            settings = PeriodSettings(
                steps=None if asked[2] is None else steps, modes=modes, accuracy=accuracy, least=steps
            )
            wanted = Accuracy("transient", model, settings, WORDS)
        errors = np.zeros((2, LOWEST))
        errors[:, 1] = _errors(r, found, run)
        if (more := wanted.further(r, steps, errors)) is None:
            wanted.tell(r, steps, errors)
            return replace(found, mode_error=float(errors.sum()))
        count, step = more[0] or count, loads.duration / more[1]


def _errors(
    own: ReducedModel, found: History, run: Callable[[ReducedModel, float | None, int | None], History]
) -> tuple[float, float]:
    """Errors of the displacements of all named points, relative L2 over them and the instants, by left-out
    modes and by the steps: the history again in shorter steps, half of them or such as half as many modes
    again ask for, and in these in so many modes. nan where nothing is known of the left-out modes or no point
    is named.
    """
    more = wider(own)
    if more is None or not found.points or len(found.time) < 2:
        return math.nan, math.nan
    every = round(float(found.time[1]) / found.step)
    times = 2
    if len(own.initial_gap):
        times = max(2, math.ceil(found.step * more.frequencies.max() / CONTACT_STEP - 1e-9))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", StepWarning)  # it was told of the history itself
        shorter = run(own, found.step / times, times * every)
        by_steps = times**2 / (times**2 - 1.0) * distance(found, shorter)
        factor = beyond(own, more)
        if not math.isfinite(factor) or more is own:
            return (0.0 if more is own else math.inf), by_steps
        return factor * distance(shorter, run(more, found.step / times, times * every)), by_steps


def distance(one: History, other: History) -> float:
    """Relative to the second, L2 over all named points and instants."""
    if one.time.shape != other.time.shape:
        return math.inf
    found, exact = (np.stack([h.displacement(p) for p in h.points]) for h in (one, other))
    off = float(np.linalg.norm(found - exact))
    return off / max(float(np.linalg.norm(exact)), 1e-300) if off else 0.0

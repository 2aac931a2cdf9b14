"""Errors of a history by integrating it again, with finer steps and with more modes."""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass
from typing import Any

import numpy as np

from meshing.warnings import StepWarning

from ..checks import instance
from ..errors import wrong_input
from ..motion.history import History
from ..ranks.parallel import collective
from ..system.model import Model
from .analysis import analysis
from .options import ErrorOptions
from .transient import distance, kind_of, transient

# Relative difference of a history that is made again from a file on other ranks: 2e-12 was met.
REPEATED = 1e-6


@dataclass(frozen=True)
class ErrorEstimate:
    """Relative L2 distance of the displacements of all named points to a refined history.

    Attributes
    ----------
    step : float
        To half of the step.
    modes : float
        To half as many modes again.
    """

    step: float
    modes: float


@analysis(ErrorOptions)
def estimate_error(
    model: Model,
    load,
    history: History,
    *,
    contact: bool = True,
    scheme: str = "exact",
    initial: Any = "rest",
    decimation: int | None = None,
) -> ErrorEstimate:
    """Estimate a history's errors by integrating it again, with half of the step and with half as many modes
    again. Collective.

    It is repeated with its own step and modes before that: a history of another model, or made with other
    loads or options than those given, would tell errors that are none.

    Parameters
    ----------
    model : Model
    load : the history's loads
    history : History
        Of the reduced model.
    contact, scheme, initial, decimation
        As the history was made with; see `transient`. The decimation need not be given.

    Raises
    ------
    ValueError, TypeError
        If the history is that of another or of an unreduced model, or another one than the model, the loads
        and the options make, or of a model without named points.
    """
    instance("estimate_error", "model", model, Model, "the Model that the history was made of")
    with collective(model.comm):
        instance("estimate_error", "history", history, History, "a History")
        modes, every = _kept_of(model, history)
        modal = kind_of(initial) == "coordinates"
        if decimation is not None and every != decimation:
            raise ValueError(
                f"estimate_error: decimation = {decimation!r} is not that of the history, which keeps every "
                f"{every} steps"
            )
    duration = float(history.time[-1])

    def again(finer: int, more: int) -> History:
        return transient(
            model,
            load,
            duration,
            history.step / finer,
            modes=modes + more,
            contact=contact,
            scheme=scheme,
            # further modes begin at rest
            initial=tuple(np.pad(part, (0, more)) for part in initial) if modal else initial,
            decimation=finer * every,
        )

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", StepWarning)  # it was told when the history was made
        off = distance(history, again(1, 0))
    if not off < REPEATED:
        raise wrong_input(
            f"estimate_error: made again with its own step, the history differs by {off:.2g}; give the "
            "loads and the options that it was made with"
        )
    # at half of the step too: more modes need a finer one where there is contact
    halved, richer = again(2, 0), again(2, math.ceil(0.5 * modes))
    return ErrorEstimate(distance(history, halved), distance(halved, richer))


def _kept_of(model: Model, history: History) -> tuple[int, int]:
    """Number of modes and decimation of a history that can be repeated of a model; ValueError of another."""
    own, why = history.reduced, ""
    if own is None:
        why = "is that of an unreduced model; repeat it with half of the step"
    elif own.model not in (model, None) or history.points != tuple(model.points):
        why = f"is that of another model than {model!r}; give the one that it was made of"
    elif own.vectors:
        why = f"is in {own.in_words}, which are not made in more; make it of the model, modes = {own.natural}"
    elif not history.points:
        why = "has no named points whose displacements could be compared; give its mesh points={...}"
    elif len(history.time) < 2:
        why = "has one instant only; give one that was integrated"
    if own is None or why:
        raise ValueError(f"estimate_error: the history {why}")
    return len(own.omega), round(float(history.time[1]) / history.step)

"""Time histories with unilateral contact, in modal coordinates with massless contact or of the unreduced model."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..checks import choice, flag, integer, positive
from ..dynamics.history import History
from ..dynamics.initial import modal_start
from ..dynamics.integration import Steps, integrate
from ..dynamics.loading import communicator, loading, serving
from ..dynamics.reduced_history import ReducedIntegrator
from ..dynamics.unreduced_history import UnreducedIntegrator
from ..parallel import collective
from ..progress import progress_bar
from ..reduction.build import default_modes
from ..reduction.reduced_model import ReducedModel
from ..system.model import Model

# Steps a period of the highest load frequency by default: loads are interpolated linearly, an error of (omega
# h)^2 / 12 = 3e-5.
STEPS_A_PERIOD = 320
# With contact, the default step is at most this share of the highest mode's period: pairs that open and close
# excite all modes, however slow the load is. Measured on beams of several proportions, cracks open and closed,
# 40 to 160 modes: up to 0.9 the errors of displacement and contact resultant are below 1e-5 and 1e-3; from 1
# on, where modes go through whole periods in a step, up to 1e-3 and 1e-2.
CONTACT_STEP = 0.8
# Fewer steps a period than this, and the user is warned.
COARSE = 20


class StepWarning(UserWarning):
    """The time step is coarse for the load's highest frequency, or for contact."""


def transient(
    model: Model | ReducedModel,
    load,
    duration: float,
    step: float | None = None,
    *,
    modes: int | None = None,
    contact: bool = True,
    scheme: str = "exact",
    start: Any = "rest",
    decimation: int = 1,
    reduction: str | None = "modes",
    progress: Callable[[float], None] | str | None = "auto",
    file: str | None = None,
    restart: bool = False,
    in_memory: bool = True,
) -> History:
    """Integrate the equations of motion with unilateral contact.

    Parameters
    ----------
    model : Model or ReducedModel
        Its `damping` is the modal damping ratio of all modes, to which `rayleigh` adds a / (2 omega) + b
        omega / 2. A model is reduced once for the places of its loads, and kept so for further analyses.
    load : PointForce, EdgeLoad, SupportMotion, a sum or a sequence of them
        For a system of matrices a number or signal for each of its unit loads.
        Components are numbers (constant from t = 0) or signals.
    duration : float
        s.
    step : float, optional
        s. Default: 1/320 of the shortest period of the loads, with contact at most 0.8 of the period of the
        highest mode; shortened to divide `duration`.
    modes : int, optional
        Default: all modes up to 8 times the loads' highest frequency, at least 80. Of the unreduced model:
        those that are damped.
    contact : bool
        False: the faces may overlap.
    scheme : {"exact", "newmark", "paper"}
        "exact": every mode advanced exactly for loads linear over a step and contact forces held at the mean
        of its ends, so that contact works precisely by force times change of gap and cannot feed energy in,
        whatever the step; "newmark": average acceleration, which does the same with a period error of (omega
        h)^2 / 12; "paper": eqs. (28)-(34) on the unreduced model, which stops when its energy runs away.
    start : {"rest", "equilibrium"}, (displacement, velocity) or (q, v)
        Zero displacement and velocity; static equilibrium, contact included, under the loads at t = 0;
        functions of x and y (m, arrays) that give (u_x, u_y) in m and m/s, None for zero; or modal
        coordinates and their velocities, (m,) arrays, of a reduced model.
    decimation : int
        Every so many steps are kept.
    reduction : "modes" or None
        "modes": lowest modes and residual flexibility; None: the unreduced model by Newmark's average
        acceleration with implicit contact (see `dynamics.unreduced_history`).
    progress : callable, "auto" or None
        Called with the fraction done after each chunk of steps; "auto": a bar on rank 0, on a terminal only.
    file : str, optional
        HDF5 file that records the history as it runs (`results.history.read_history` reads it, also after
        Ctrl-C or a kill).
    restart : bool
        Continue `file` if it exists, with the same model, loads and settings; the history is that of an
        uninterrupted run. A longer `duration` continues a shorter run, at its step. False: replace it.
    in_memory : bool
        False: what has been written to `file` is let go of, and the arrays of the history are read from there
        as they are used; memory holds some thousand steps at a time.

    Raises
    ------
    ValueError, TypeError, KeyError
        For input that makes no sense.
    SolveError
        If a contact problem is not solved, the energy runs away or `file` cannot be written any more.

    Warns
    -----
    StepWarning
        If the step takes fewer than 20 steps a period of the highest load frequency, or is longer than the
        period of the highest mode of a reduced model and pairs close.
    """
    comm = communicator(model)
    with collective(comm):
        loads = loading("transient", model, load)
        _check(duration, step, modes, contact, scheme, start, decimation)
        _check_reduction(model, reduction)
        unreduced = reduction is None or scheme == "paper"
        if unreduced and isinstance(model, ReducedModel):
            raise ValueError(
                "transient: reduction = None and scheme = 'paper' need the model itself, not a reduced one"
            )
        flag("transient", "restart", restart)
        flag("transient", "in_memory", in_memory)
        if restart and file is None:
            raise ValueError("transient: restart = True needs the file to continue, file = 'history.h5'")
        if not in_memory and file is None:
            raise ValueError(
                "transient: in_memory = False needs a file to hold the history, file = 'history.h5'"
            )
        if unreduced and isinstance(start, tuple) and not _by_functions(start):
            raise ValueError(
                "transient: start in modal coordinates is for the reduced model; give functions of x and y"
            )
    highest = loads.highest_frequency
    if isinstance(model, Model) and unreduced:
        touching = contact and len(model.gap_operator) > 0
        needed = bool(model.damping) or (touching and step is None)
        damped = (modes or default_modes(model, highest)) if needed else 0
        top = float(model.modes(damped).frequencies[-1]) if touching and step is None else 0.0
    else:
        reduced = serving("transient", model, loads, modes, highest)
        top = float(reduced.frequencies[-1]) if contact and len(reduced.initial_gap) else 0.0
        if isinstance(start, tuple) and _by_functions(start):
            start = modal_start(reduced, start)
    count, step = _steps(duration, step, highest, top)
    _warn_if_coarse(highest, step)
    with progress_bar(comm, "transient", progress) as report:
        if isinstance(model, Model) and unreduced:
            steps = Steps(count, step, contact, "paper" if scheme == "paper" else "implicit", decimation)
            with UnreducedIntegrator(
                model, loads.units, loads.signals, steps=steps, start=start, modes=damped
            ) as integrator:
                return integrate(integrator, steps, None, report)
        steps = Steps(count, step, contact, scheme, decimation)
        history = integrate(ReducedIntegrator(reduced, loads.signals, steps, start), steps, None, report)
    if step * top > 1.0 and history.states.contact.any():
        warnings.warn(
            f"the step of {step:.3g} s is longer than the period of the highest mode ({top:.6g} Hz), and "
            "pairs closed: errors of 1e-3 in displacements and 1e-2 in contact forces, and false spectral "
            f"lines, are likely; use a step of {CONTACT_STEP / top:.2g} s, the default, or fewer modes",
            StepWarning,
            stacklevel=2,
        )
    return history


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


def estimate_error(model: Model, load, history: History, **options) -> ErrorEstimate:
    """Estimate a history's errors by integrating it again, with half of the step and with half as many modes
    again.

    Parameters
    ----------
    model : Model
    load : the history's loads
    history : History
        Of the reduced model.
    options
        Those that the history was made with (`scheme`, `start`, `contact`, `decimation`).

    Raises
    ------
    ValueError
        If the history is that of an unreduced model.
    """
    if history.reduced is None:
        raise ValueError(
            "estimate_error: the history is that of an unreduced model; repeat it with half of the step"
        )
    duration, decimation = float(history.time[-1]), options.pop("decimation", 1)
    modes, step = len(history.reduced.omega), 0.5 * history.step
    halved = transient(model, load, duration, step, modes=modes, decimation=2 * decimation, **options)
    # at half of the step too: more modes need a finer one where there is contact
    richer = transient(
        model, load, duration, step, modes=math.ceil(1.5 * modes), decimation=2 * decimation, **options
    )

    def distance(one: History, other: History) -> float:
        found, exact = (np.stack([h.displacement(p) for p in h.points]) for h in (one, other))
        return float(np.linalg.norm(found - exact) / max(np.linalg.norm(exact), 1e-300))

    return ErrorEstimate(distance(history, halved), distance(halved, richer))


def _check(duration, step, modes, contact, scheme, start, decimation) -> None:
    positive("transient", "duration", duration, "s")
    if step is not None:
        positive("transient", "step", step, "s")
        if step > duration:
            raise ValueError(f"transient: step = {step!r} s is longer than duration = {duration!r} s")
    if modes is not None:
        integer("transient", "modes", modes, least=1)
    integer("transient", "decimation", decimation, least=1)
    flag("transient", "contact", contact)
    choice("transient", "scheme", scheme, ("exact", "newmark", "paper"))
    if not (isinstance(start, tuple) and len(start) == 2):
        choice("transient", "start", start, ("rest", "equilibrium"))


def _check_reduction(model, reduction) -> None:
    if reduction is not None and reduction != "modes":
        raise TypeError(
            f"transient: reduction = {reduction!r} must be 'modes' or None; a reduced model is given in the place of "
            "the model"
        )


def _by_functions(start: tuple) -> bool:
    return all(part is None or callable(part) for part in start)


def _steps(duration: float, step: float | None, highest: float, top: float) -> tuple[int, float]:
    """Number of steps and the step that divides `duration`; `highest` of the loads, `top` of the modes, Hz."""
    if step is None:
        step = 1.0 / (STEPS_A_PERIOD * highest) if highest > 0.0 else duration / 2000.0
        step = min(step, CONTACT_STEP / top) if top > 0.0 else step
    count = max(1, math.ceil(duration / step * (1.0 - 1e-9)))
    return count, duration / count


def _warn_if_coarse(highest: float, step: float) -> None:
    if highest * step > 1.0 / COARSE:
        warnings.warn(
            f"the step of {step:.3g} s takes {1.0 / (highest * step):.1f} steps a period of the highest load "
            f"frequency {highest:g} Hz; at least {COARSE} are advisable",
            StepWarning,
            stacklevel=3,
        )

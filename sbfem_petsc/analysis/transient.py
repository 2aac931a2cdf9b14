"""Time histories with unilateral contact, in modal coordinates with massless contact or of the unreduced
model.
"""

from __future__ import annotations

import contextlib
import math
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from meshing.warnings import StepWarning

from ..capacity import KEPT, require_compiler
from ..checks import choice, flag, instance, optional_integer, path, positive, real_array, shown
from ..checks import progress as check_progress
from ..dynamics.history import History
from ..dynamics.initial import modal_start
from ..dynamics.integration import Steps, integrate, row_size
from ..dynamics.loading import Loading, communicator, loading, serving
from ..dynamics.preparation import check_reduction
from ..dynamics.reduced_history import ReducedIntegrator, reduced_columns
from ..dynamics.step_plan import COARSE, CONTACT_STEP, default_step, plan_steps, require_room
from ..dynamics.steps import DEEPEST, HALVING
from ..dynamics.unreduced_history import UnreducedIntegrator, unreduced_columns
from ..errors import caller_level, on_all_ranks
from ..parallel import agreed, collective
from ..progress import progress_bar
from ..recording.history_file import HistoryFile
from ..reduction.build import default_modes
from ..reduction.reduced_model import ReducedModel
from ..system.model import Model
from ..system.plausibility import warn_of_motion

# Work of contact in parts of steps that cannot be halved further, relative to what is supplied, from which on
# it is told.
WORKED = 1e-4


@agreed()
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
    decimation: int | None = None,
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
        s. Default: 1/320 of the shortest period of the loads, with contact or loads that jump at most 0.8 of
        the period of the highest mode; shortened to divide `duration`. Where a load jumps within a step, the
        step is taken in two parts.
    modes : int, optional
        Default: all modes up to 8 times the loads' highest frequency, at least 80. Of the unreduced model:
        those that are damped.
    contact : bool
        False: the faces may overlap.
    scheme : {"exact", "newmark", "paper"}
        "exact": every mode advanced exactly for loads linear over a step and contact forces held at the mean
        of its ends; "newmark": average acceleration, with a period error of (omega h)^2 / 12; "paper": eqs.
        (28)-(34) on the unreduced model, which stops when its energy runs away. In the first two contact
        works precisely by mean force times change of gap: nothing in steps in which no pair changes sides,
        in the others what they are in error, of either sign. Where that is more than 1e-6 of the modes'
        energy the step is taken as two halves, and these as halves again, ten times at most; only the ends of
        the equal steps are kept.
    start : {"rest", "equilibrium"}, (displacement, velocity) or (q, v)
        Zero displacement and velocity; static equilibrium, contact included, under the loads at t = 0;
        functions of x and y (m, arrays) that give (u_x, u_y) in m and m/s, None for zero; or modal
        coordinates and their velocities, (m,) arrays, of a reduced model.
    decimation : int, optional
        Every so many steps are kept; the step is shortened so that the last one is among them. Default: every
        one, unless the history would take more than 1 GB; then the fewest that are left out to stay below,
        with a warning.
    reduction : "modes" or None
        "modes": lowest modes and residual flexibility; None: the unreduced model by Newmark's average
        acceleration with implicit contact, which takes energy and never gives any: some 1e-3 to 1e-2 of what
        is supplied in lightly damped bodies (`energy.contact` tells it), and little less in shorter steps,
        which are therefore not halved (see `dynamics.unreduced_history`).
    progress : callable, "auto" or None
        Called with the fraction done after each chunk of steps; "auto": a bar on rank 0, on a terminal only.
    file : str, optional
        HDF5 file that records the history as it runs (`read_history` reads it, also after Ctrl-C or a kill).
    restart : bool
        Continue `file` if it exists, with the same model, loads and settings; the history is that of an
        uninterrupted run. A longer `duration` continues a shorter run, at its step. False: replace it.
    in_memory : bool
        False: what has been written to `file` is let go of, and the arrays of the history are read from there
        as they are used; memory holds some thousand steps at a time.

    Raises
    ------
    ValueError, TypeError, KeyError
        For input that makes no sense, and if the history would take more memory or disk than is free.
    SolveError
        If a contact problem is not solved, there is no equilibrium to start from, the energy runs away or
        `file` cannot be written any more.

    Warns
    -----
    StepWarning
        If the step takes fewer than 20 steps a period of the highest load frequency, or is longer than the
        period of the highest mode of a reduced model and pairs close; if contact does work in parts of steps
        that were halved ten times, and in all more than 1e-4 of what is supplied; or if not every step is
        kept though `decimation` was not given.
    LargeDisplacementWarning
        If displacements of named points are more than 5 % of the body, in a history kept in memory.
    """
    comm = communicator(model)
    with collective(comm):
        loads = loading("transient", model, load)
        duration = positive("transient", "duration", duration, "s")
        step = None if step is None else positive("transient", "step", step, "s")
        modes = optional_integer("transient", "modes", modes, least=1)
        decimation = optional_integer("transient", "decimation", decimation, least=1)
        _check(duration, step, contact, scheme)
        _check_start(start)
        loads = loads.over(duration, isinstance(start, str) and start == "rest")
        check_reduction("transient", reduction)
        check_progress("transient", progress)
        if file is not None:
            path("transient", "file", file)
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
    require_compiler("transient", comm)
    highest, jumps = loads.highest_frequency, loads.jumps
    with contextlib.ExitStack() as stack:
        record = None
        if file is not None:
            kind = "unreduced" if unreduced else "reduced"
            record = stack.enter_context(
                HistoryFile(comm, file, kind=kind, restart=restart, in_memory=in_memory)
            )
        if isinstance(model, Model) and unreduced:
            touching = contact and len(model.gap_operator) > 0
            limited = (touching or jumps) and step is None
            damped = (modes or default_modes(model, highest)) if model.damping or limited else 0
            top = float(model.modes(damped).frequencies[-1]) if limited else 0.0
            row = row_size(unreduced_columns(model))
        else:
            reduced = serving("transient", model, loads, modes, highest)
            reduced = reduced if record is None else record.adopt(reduced)
            limited = (contact and len(reduced.initial_gap) > 0) or jumps
            top = float(reduced.frequencies[-1]) if limited else 0.0
            row = row_size(reduced_columns(reduced))
            if isinstance(start, tuple) and _by_functions(start):
                start = modal_start(reduced, start)
        former = record.former if record is not None else None
        step = default_step(duration, highest, top) if step is None and former is None else step
        count, step, every = plan_steps(duration, step, decimation, row, former)
        _warn_if_coarse(highest, step)
        if every > 1 and decimation is None and former is None:
            warnings.warn(
                f"transient: of {count:,d} steps every {every} are kept, for all of them would take more "
                f"than {KEPT / 1e9:g} GB; decimation = 1 keeps all",
                StepWarning,
                stacklevel=caller_level(),
            )
        steps = Steps(count, step, contact, "implicit" if unreduced and scheme != "paper" else scheme, every)
        require_room(comm, steps, row, file, in_memory=in_memory, former=former)
        report = stack.enter_context(progress_bar(comm, "transient", progress))
        if isinstance(model, Model) and unreduced:
            integrator = stack.enter_context(
                UnreducedIntegrator(model, loads.units, loads.signals, steps=steps, start=start, modes=damped)
            )
            if record is not None:
                _begin_unreduced(record, integrator, loads, start)
            history = integrate(integrator, steps, record, report)
            if in_memory:
                warn_of_motion("transient", model, history)
            return history
        advanced = ReducedIntegrator(reduced, loads.signals, steps, start)
        if record is not None:
            _begin_reduced(record, advanced, loads, start)
        history = integrate(advanced, steps, record, report)
    _warn_of_work(advanced, history)
    if step * top > 1.0 and history.states.contact.any():
        warnings.warn(
            f"the step of {step:.3g} s is longer than the period of the highest mode ({top:.6g} Hz), and "
            "pairs closed: errors of 1e-3 in displacements and 1e-2 in contact forces, and false spectral "
            f"lines, are likely; use a step of {CONTACT_STEP / top:.2g} s, the default, or fewer modes",
            StepWarning,
            stacklevel=caller_level(),
        )
    if in_memory:  # one that is left in its file is not read again
        warn_of_motion("transient", model, history)
    return history


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


@agreed()
def estimate_error(
    model: Model,
    load,
    history: History,
    *,
    contact: bool = True,
    scheme: str = "exact",
    start: Any = "rest",
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
    contact, scheme, start, decimation
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
        choice("estimate_error", "scheme", scheme, ("exact", "newmark"))
        every = _kept_of(model, history)
        if decimation is not None and every != optional_integer("estimate_error", "decimation", decimation):
            raise ValueError(
                f"estimate_error: decimation = {decimation!r} is not that of the history, which keeps every "
                f"{every} steps"
            )
    modes, duration = len(history.reduced.omega), float(history.time[-1])

    modal = isinstance(start, tuple) and not _by_functions(start)

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
            start=tuple(np.pad(part, (0, more)) for part in start) if modal else start,
            decimation=finer * every,
        )

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", StepWarning)  # it was told when the history was made
        off = _distance(history, again(1, 0))
    if not off < REPEATED:
        raise on_all_ranks(
            ValueError(
                f"estimate_error: made again with its own step, the history differs by {off:.2g}; give the "
                "loads and the options that it was made with"
            )
        )
    # at half of the step too: more modes need a finer one where there is contact
    halved, richer = again(2, 0), again(2, math.ceil(0.5 * modes))
    return ErrorEstimate(_distance(history, halved), _distance(halved, richer))


def _kept_of(model: Model, history: History) -> int:
    """The decimation of a history that can be repeated of a model; ValueError of another."""
    if history.reduced is None:
        raise ValueError(
            "estimate_error: the history is that of an unreduced model; repeat it with half of the step"
        )
    if history.reduced.model not in (model, None) or history.points != tuple(model.points):
        raise ValueError(
            f"estimate_error: the history is that of another model than {model!r}; give the one that it was "
            "made of"
        )
    if not history.points:
        raise ValueError(
            "estimate_error: the model has no named points whose displacements could be compared; give its "
            "mesh points={...}"
        )
    if len(history.time) < 2:
        raise ValueError("estimate_error: the history has one instant only; give one that was integrated")
    return round(float(history.time[1]) / history.step)


def _distance(one: History, other: History) -> float:
    """Relative to the second, L2 over all named points and instants."""
    if one.time.shape != other.time.shape:
        return math.inf
    found, exact = (np.stack([h.displacement(p) for p in h.points]) for h in (one, other))
    off = float(np.linalg.norm(found - exact))
    return off / max(float(np.linalg.norm(exact)), 1e-300) if off else 0.0


def _warn_of_work(integrator: ReducedIntegrator, history: History) -> None:
    """Warn where contact has done work that halving its steps did not take away."""
    done, supplied = history.energy.contact, integrator.ledger.supplied
    if integrator.unresolved and np.abs(done).max() > WORKED * supplied:
        warnings.warn(
            f"transient: in {integrator.unresolved:,d} parts of steps that were halved {DEEPEST} times "
            f"contact still does work of more than {HALVING.tolerance:g} of the energy; it has done "
            f"{done[-1]:.3g} J in all beside {supplied:.3g} J supplied; use a step smaller than "
            f"{history.step:.3g} s",
            StepWarning,
            stacklevel=3,
        )


def _check(duration, step, contact, scheme) -> None:
    if step is not None and step > duration:
        raise ValueError(f"transient: step = {step!r} s is longer than duration = {duration!r} s")
    flag("transient", "contact", contact)
    choice("transient", "scheme", scheme, ("exact", "newmark", "paper"))


def _check_start(start) -> None:
    if not isinstance(start, tuple):
        choice("transient", "start", start, ("rest", "equilibrium"))
    elif len(start) != 2:
        raise ValueError(f"transient: start = {shown(start)} must be two functions or two arrays")
    elif not _by_functions(start):
        sizes = [len(real_array("transient", f"start[{k}]", part, 1)) for k, part in enumerate(start)]
        if sizes[0] != sizes[1]:
            raise ValueError(
                f"transient: start has {sizes[0]} modal coordinates and {sizes[1]} velocities; give as many"
            )


def _by_functions(start: tuple) -> bool:
    return all(part is None or callable(part) for part in start)


def _settings(steps: Steps, start, norms, chunk: int) -> dict[str, Any]:
    """What a file must have been written with to be continued."""
    return {
        "count": steps.count,
        "step": steps.step,
        "contact": steps.contact,
        "scheme": steps.scheme,
        "start": start,
        "start_norms": np.array(norms, dtype=float),
        "decimation": steps.decimation,
        "chunk": chunk,
    }


def _begin_reduced(record: HistoryFile, integrator: ReducedIntegrator, loads: Loading, start) -> None:
    """Tell a file what a reduced model's history will hold."""
    norms = []
    if not isinstance(start, str):
        norms = [np.linalg.norm(integrator.reduced.omega * start[0]), np.linalg.norm(start[1])]
    name = start if isinstance(start, str) else "modal"
    settings = _settings(integrator.steps, name, norms, integrator.chunk)
    record.begin(integrator.columns, settings, loads.signals)


def _begin_unreduced(record: HistoryFile, integrator: UnreducedIntegrator, loads: Loading, start) -> None:
    """Tell a file what an unreduced model's history will hold."""
    model, march = integrator.model, integrator.march
    norms = np.sqrt(march.summed(np.array([march.u @ march.u, march.v @ march.v])))
    name = start if isinstance(start, str) else "functions"
    settings = _settings(integrator.steps, name, norms, integrator.chunk) | {
        "damping": model.damping,
        "damped_modes": len(march.omega),
        "rayleigh": np.array(model.rayleigh),
        "pairs": model.gap_operator.pairs,
        "continued_fraction": model.continued_fraction,
        "unknowns": model.unknowns,
    }
    texts = {"points": tuple(model.points), "tips": model.tips.names}
    record.begin(integrator.columns, settings, loads.signals, texts=texts, fingerprint=march.fingerprint())


def _warn_if_coarse(highest: float, step: float) -> None:
    if highest * step > 1.0 / COARSE:
        warnings.warn(
            f"the step of {step:.3g} s takes {1.0 / (highest * step):.1f} steps a period of the highest load "
            f"frequency {highest:g} Hz; at least {COARSE} are advisable",
            StepWarning,
            stacklevel=caller_level(),
        )

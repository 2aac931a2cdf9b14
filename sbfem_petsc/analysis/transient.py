"""Time histories with unilateral contact, in modal coordinates with massless contact or of the unreduced
model.
"""

from __future__ import annotations

import contextlib
import functools
import math
import warnings
from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from meshing.warnings import StepWarning

from ..checks import choice, flag, real_array, shown
from ..continuation.accuracy import Accuracy, Told, Words
from ..continuation.harmonic_errors import beyond
from ..continuation.orbit import LOWEST
from ..errors import warn
from ..motion.files.history_file import HistoryFile
from ..motion.history import History, of_instants
from ..motion.initial import modal_start
from ..motion.integration import Integrator, Steps, chunks
from ..motion.loading import Loading, communicator, loading, moved_up_to, warn_of_unreduced
from ..motion.preparation import PeriodSettings, check_reduction, serving
from ..motion.reduced_history import ReducedIntegrator
from ..motion.reduced_history import row_size as reduced_row
from ..motion.states import Rows
from ..motion.step_plan import COARSE, CONTACT_STEP, default_step, plan_steps, require_room
from ..motion.steps import DEEPEST, HALVING
from ..motion.unreduced.history import UnreducedIntegrator
from ..motion.unreduced.history import row_size as unreduced_row
from ..progress import Progress, progress_bar
from ..ranks.capacity import KEPT, require_compiler
from ..ranks.parallel import collective
from ..reduction.build import default_modes, modes_for, reduced, wider
from ..reduction.reduced_model import ReducedModel
from ..system.model import Model
from .analysis import analysis
from .options import TransientOptions

# Work of contact in parts of steps that cannot be halved further, relative to what is supplied, from which on
# it is told.
WORKED = 1e-4
# What an accuracy is of, in sentences.
WORDS = Words("displacements over time", "", "give a shorter step", "the history fails")


class _Stepped(NamedTuple):
    """Modes of a history and its steps; 0: by default."""

    reduced: ReducedModel
    told_steps: int


_Told = Told[_Stepped, History]


@analysis(TransientOptions, rubs=True)
def transient(
    model: Model | ReducedModel,
    load,
    duration: float,
    step: float | None = None,
    *,
    modes: int | None = None,
    contact: bool = True,
    scheme: str = "exact",
    initial: Any = "rest",
    decimation: int | None = None,
    accuracy: float | None = None,
    reduction: str | None = "modes",
    progress: Progress = "auto",
    file: str | None = None,
    resume: bool = False,
    in_memory: bool = True,
) -> History:
    """Integrate the equations of motion with unilateral contact.

    Parameters
    ----------
    model : Model or ReducedModel
        Its `damping` is the modal damping ratio of all modes, to which `rayleigh` adds a / (2 omega) + b
        omega / 2. A model is reduced once for the places of its loads, and kept so for further analyses.
        Faces that rub (`Coulomb`) have never been loaded before t = 0.
    load : PointForce, EdgeLoad, SupportMotion, EdgeMotion, a sum or a sequence of them
        For a system of matrices a number or signal for each of its unit loads.
        Components are numbers (constant from t = 0) or signals.
    duration : float
        s.
    step : float, optional
        s. Default: 1/320 of the shortest period of the loads, with contact at most 0.8 of the period of the
        highest mode, under loads that jump at most 0.8 of that of the highest mode in which more than 3e-5 of
        the displacement under them is ("exact"; of the highest one otherwise); shortened to divide
        `duration`. Where a load jumps within a step, the step is taken in two parts.
    modes : int, optional
        Default: all modes up to 8 times the loads' highest frequency, at least 80. Of the unreduced model:
        those that are damped.
    contact : bool
        False: the faces may overlap.
    scheme : {"exact", "newmark"}
        "exact": every mode advanced exactly for loads linear over a step and contact forces held at the mean
        of its ends; "newmark": average acceleration, with a period error of (omega h)^2 / 12. Contact
        works precisely by mean force times change of gap: nothing in steps in which no pair changes sides,
        in the others what they are in error, of either sign, beside what friction takes. Where the error is
        more than 1e-6 of the modes' energy the step is taken as two halves, and these as halves again, ten
        times at most; only the ends of the equal steps are kept.
    initial : {"rest", "equilibrium"}, (displacement, velocity) or (q, v)
        The state at t = 0: zero displacement and velocity; static equilibrium, contact included, under the
        loads there; functions of x and y (m, arrays) that give (u_x, u_y) in m and m/s, None for zero; or
        modal coordinates and their velocities, (m,) arrays, of a reduced model. None of them tells of slips:
        a history with friction goes on by `file` and `resume`.
    decimation : int, optional
        Every so many steps are kept; the step is shortened so that the last one is among them. Default: every
        one, unless the history would take more than 1 GB; then the fewest that are left out to stay below,
        with a warning.
    accuracy : float, optional
        Of the displacements of all named points over time, relative L2, `History.mode_error`: modes and step
        that are not given are as many, or as short, as that needs. To begin with modes as for `periodic`, and
        the default step; more of them, shorter ones, where the told error is above. It is told by the history
        in shorter steps and, in these, in half as many modes again; all of these are kept in memory. Of the
        reduced model; a run that goes on with a `file` finds its modes and step again.
    reduction : "modes" or None
        "modes": lowest modes and residual flexibility; None: the unreduced model by Newmark's average
        acceleration with implicit contact, which takes energy and never gives any: some 1e-3 to 1e-2 of what
        is supplied in lightly damped bodies (`energy.contact` tells it), and little less in shorter steps,
        which are therefore not halved (see `motion.unreduced.history`).
    progress : callable, "auto" or None
        Called with the fraction done after each chunk of steps; "auto": a bar on rank 0, on a terminal only.
    file : str, optional
        Journal that records the history as it runs (`read` reads it, also meanwhile, and after Ctrl-C or a
        kill); what `resume` goes on from stands beside it, in FILE.state.
    resume : bool
        Go on from `file` if it exists, with the same model, loads and settings; the history is that of an
        uninterrupted run, bit by bit; of an unreduced model on another number of ranks to 1e-6. A longer
        `duration` continues a shorter run, at its step. False: replace it.
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
    AccuracyWarning
        If the told error is above `accuracy` in the modes or the step given, or in all that the mesh has.
    StepWarning
        If the step takes fewer than 20 steps a period of the highest load frequency, or is longer than the
        period of the highest mode of a reduced model and pairs close; if contact does work in parts of steps
        that were halved ten times, and in all more than 1e-4 of what is supplied; or if not every step is
        kept though `decimation` was not given.
    LargeDisplacementWarning
        If displacements of named points are more than 5 % of the body, in a history kept in memory.
    """
    comm, unreduced = communicator(model), reduction is None
    with collective(comm):
        check_reduction("transient", reduction, model)
        if not flag("transient", "in_memory", in_memory) and file is None:
            raise ValueError(
                "transient: in_memory = False needs a file to hold the history, file = 'history.journal'"
            )
        begun = kind_of(initial)
        if begun == "coordinates" and unreduced:
            raise ValueError(
                "transient: initial in modal coordinates is for the reduced model; give functions of x and y"
            )
        loads = loading("transient", model, load).over("transient", duration, begun == "rest")
        if accuracy is not None and (unreduced or begun == "coordinates"):
            raise ValueError(
                f"transient: accuracy = {accuracy:g} is for the reduced model from a state that is not given "
                "in modal coordinates: leave it out"
            )
    require_compiler("transient", comm)
    if accuracy is not None:
        given: dict[str, Any] = {"contact": contact, "scheme": scheme, "initial": initial}
        again = functools.partial(transient, load=load, duration=duration, progress=progress, **given)
        recorded = {"decimation": decimation, "file": file, "resume": resume, "in_memory": in_memory}
        return _accurate(model, loads, (accuracy, modes, step), again, recorded)
    with contextlib.ExitStack() as stack:
        kind = "unreduced" if unreduced else "reduced"
        record = HistoryFile(comm, file, kind=kind, resume=resume, in_memory=in_memory)
        stack.enter_context(record)
        if isinstance(model, Model) and unreduced:
            problem = _unreduced(model, loads, initial, modes, contact, step is not None)
        else:
            asked = PeriodSettings(modes=modes)
            served = serving("transient", model, loads, asked, loads.highest_frequency)
            problem = _reduced(record.adopt(served), loads, initial, contact, scheme)
        count, step, every = _planned(problem, step, decimation, record.former)
        integration = "implicit" if unreduced else scheme
        steps = Steps(count, step, contact, integration, every)
        require_room(comm, steps, problem.row, file, in_memory=in_memory, former=record.former)
        report = stack.enter_context(progress_bar(comm, "transient", progress))
        integrator = problem.integrator(steps, stack)
        first = integrator.first()
        record.begin(loads.signals, integrator, first)
        history = _integrated(integrator, first, record, report)
    if isinstance(integrator, ReducedIntegrator):
        _warn_of_work(integrator, history)
        _warn_if_long(step, problem.highest, history)
    return history


def _accurate(
    model: Model | ReducedModel,
    loads: Loading,
    asked: tuple[float, int | None, float | None],
    history: Callable[..., History],
    recorded: dict[str, Any],
) -> History:
    """The history whose told error, see `_errors`, is within an accuracy as far as modes and steps may grow,
    and once more into a file where that is wanted. Collective.

    Parameters
    ----------
    asked : (float, int or None, float or None)
        The accuracy; modes and step where they are given.
    history : callable
        Of a reduced model, with `step` (s; None: the default) and `decimation`.
    """
    accuracy, modes, step = asked
    count, duration = modes or 0, loads.duration
    if modes is None and isinstance(model, Model):
        # loads that jump move all modes
        count = modes_for(model, 0.0 if loads.sudden else loads.highest_frequency, accuracy)

    def stepped(count: int | None, steps: int = 0) -> _Stepped:
        return _Stepped(
            model if isinstance(model, ReducedModel) else reduced(model, loads.units, count or 0), steps
        )

    def found(where: _Stepped, near: _Told | None) -> _Told:
        own = step if near is None else duration / where.told_steps
        found = history(where.reduced, step=own, decimation=recorded["decimation"])
        errors = np.zeros((2, LOWEST))
        errors[:, 1] = _errors(where.reduced, found, history)
        return Told(where._replace(told_steps=round(duration / found.step)), found, errors)

    first = found(stepped(count), None)
    steps = first.where.told_steps
    settings = PeriodSettings(
        steps=None if step is None else steps, modes=modes, accuracy=accuracy, least=steps
    )
    aim = Accuracy("transient", model, settings, WORDS)
    where, result, errors = aim.reached(
        lambda settings, _: stepped(settings.modes, settings.least), found, first
    )
    aim.tell(where, errors)
    if recorded["file"] is not None:
        result = history(where.reduced, step=result.step, **recorded)
    return replace(result, mode_error=float(errors.sum()))


def _errors(own: ReducedModel, found: History, history: Callable[..., History]) -> tuple[float, float]:
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
    again = functools.partial(history, step=found.step / times, decimation=times * every)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", StepWarning)  # it was told of the history itself
        shorter = again(own)
        by_steps = times**2 / (times**2 - 1.0) * distance(found, shorter)
        factor = beyond(own, more)
        if not math.isfinite(factor) or more is own:
            return (0.0 if more is own else math.inf), by_steps
        return factor * distance(shorter, again(more)), by_steps


def distance(one: History, other: History) -> float:
    """Relative to the second, L2 over all named points and instants."""
    if one.time.shape != other.time.shape:
        return math.inf
    found, exact = (np.stack([h.displacement(p) for p in h.points]) for h in (one, other))
    off = float(np.linalg.norm(found - exact))
    return off / max(float(np.linalg.norm(exact)), 1e-300) if off else 0.0


class _Problem(NamedTuple):
    """What is integrated.

    Attributes
    ----------
    highest : float
        Highest frequency of the modes, Hz, where that limits the step; 0 elsewhere.
    row : int
        Bytes of an instant.
    integrator : callable
        Of steps, what is to be freed on a stack.
    """

    loads: Loading
    highest: float
    row: int
    integrator: Callable[[Steps, contextlib.ExitStack], ReducedIntegrator | UnreducedIntegrator]


def _reduced(reduced: ReducedModel, loads: Loading, initial: Any, contact: bool, scheme: str) -> _Problem:
    """In modal coordinates."""
    limited = (contact and len(reduced.initial_gap) > 0) or (loads.jumps and scheme != "exact")
    highest = float(reduced.frequencies[-1]) if limited else 0.0
    if loads.jumps and not limited:  # a step that ends at a jump is exact: those behind it only tell of it
        highest = moved_up_to(reduced, loads)
    if kind_of(initial) == "functions":
        initial = modal_start(reduced, initial)

    def integrator(steps: Steps, _: contextlib.ExitStack) -> ReducedIntegrator:
        return ReducedIntegrator(reduced, loads.signals, steps, initial)

    return _Problem(loads, highest, reduced_row(reduced), integrator)


def _unreduced(
    model: Model, loads: Loading, initial: Any, modes: int | None, contact: bool, given: bool
) -> _Problem:
    """The model itself; its integrator warns of cells too large for the loads."""
    touching = contact and len(model.contact) > 0
    limited = (touching or loads.jumps) and not given
    needed = model.damping or limited
    damped = (modes or default_modes(model, loads.highest_frequency)) if needed else 0
    highest = float(model.modes(damped).frequencies[-1]) if limited else 0.0

    def integrator(steps: Steps, stack: contextlib.ExitStack) -> UnreducedIntegrator:
        made = UnreducedIntegrator(model, loads, stack, steps=steps, initial=initial, modes=damped)
        warn_of_unreduced("transient", model, loads, damped)
        return made

    return _Problem(loads, highest, unreduced_row(model), integrator)


def _integrated(
    integrator: Integrator, first: History, recorder: HistoryFile, report: Callable[[float], None]
) -> History:
    """Advance a system over all steps."""
    behind, begin_with, former = 0, first.instants(), recorder.resume()
    kept: Rows = {}
    if recorder.in_memory:  # made at once, so that nothing is held twice
        count = integrator.steps.kept
        kept = {name: np.empty((count, *values.shape[1:])) for name, values in begin_with.items()}
    if former is not None:
        behind, begin_with, checkpoint = former
        integrator.restore(checkpoint)
    last = 0
    for done, rows in chunks(integrator, begin_with, report, behind):
        begin, last = last, last + len(rows.get("time", ()))
        for name, values in kept.items():
            values[begin:last] = rows[name]
        if former is None or done > behind:
            recorder.append(done, rows, integrator)
    return of_instants(first, kept or recorder.recorded(), exchanges=integrator.exchanges)


def _planned(
    problem: _Problem, step: float | None, decimation: int | None, former: Steps | None
) -> tuple[int, float, int]:
    """Number of steps, the step, and every how many are kept."""
    fastest, duration = problem.loads.highest_frequency, problem.loads.duration
    if step is None and former is None:
        step = default_step(duration, fastest, problem.highest)
    count, step, every = plan_steps(duration, step, decimation, problem.row, former)
    if fastest * step > 1.0 / COARSE:
        warn(
            f"the step of {step:.3g} s takes {1.0 / (fastest * step):.1f} steps a period of the highest load "
            f"frequency {fastest:g} Hz; at least {COARSE} are advisable",
            StepWarning,
        )
    if every > 1 and decimation is None and former is None:
        warn(
            f"transient: of {count:,d} steps every {every} are kept, for all of them would take more "
            f"than {KEPT / 1e9:g} GB; decimation = 1 keeps all",
            StepWarning,
        )
    return count, step, every


def _warn_of_work(integrator: ReducedIntegrator, history: History) -> None:
    """Warn where contact has done work that halving its steps did not take away."""
    done, supplied = history.energy.contact, integrator.ledger.supplied
    if integrator.unresolved and np.abs(done).max() > WORKED * supplied:
        warn(
            f"transient: in {integrator.unresolved:,d} parts of steps that were halved {DEEPEST} times "
            f"contact still does work of more than {HALVING.tolerance:g} of the energy; it has done "
            f"{done[-1]:.3g} J in all beside {supplied:.3g} J supplied; use a step smaller than "
            f"{history.step:.3g} s",
            StepWarning,
        )


def _warn_if_long(step: float, highest: float, history: History) -> None:
    """Warn of steps in which modes go through whole periods while contact excites them."""
    if step * highest > 1.0 and history.states.contact.any():
        warn(
            f"the step of {step:.3g} s is longer than the period of the highest mode ({highest:.6g} Hz), and "
            "pairs closed: errors of 1e-3 in displacements and 1e-2 in contact forces, and false spectral "
            f"lines, are likely; use a step of {CONTACT_STEP / highest:.2g} s, the default, or fewer modes",
            StepWarning,
        )


def kind_of(initial: Any) -> str:
    """What an initial state is: "rest", "equilibrium", two "functions" of position, or two arrays of modal
    "coordinates"; ValueError or TypeError for anything else.
    """
    if not isinstance(initial, tuple):
        return str(choice("transient", "initial", initial, ("rest", "equilibrium")))
    if len(initial) != 2:
        raise ValueError(f"transient: initial = {shown(initial)} must be two functions or two arrays")
    if all(part is None or callable(part) for part in initial):
        return "functions"
    sizes = [len(real_array("transient", f"initial[{k}]", part, 1)) for k, part in enumerate(initial)]
    if sizes[0] != sizes[1]:
        raise ValueError(
            f"transient: initial has {sizes[0]} modal coordinates and {sizes[1]} velocities; give as many"
        )
    return "coordinates"

"""Time histories with unilateral contact, in modal coordinates with massless contact."""

from __future__ import annotations

import math
import numbers
import warnings
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..contact.complementarity import solve_complementarity
from ..contact.marching import march, thin_factors
from ..dynamics.energy import Energy, Ledger, guard
from ..dynamics.history import ModalHistory
from ..dynamics.initial import modal_start
from ..dynamics.steps import step_coefficients
from ..dynamics.unreduced_history import FullTransient, full_transient
from ..errors import SolveError, on_all_ranks
from ..loads import separate
from ..parallel import collective
from ..progress import progress_bar
from ..reduction.reduced_model import Reduction, check_reduction, communicator, reduce
from ..signals import as_signal
from ..system.model import Model
from .modal import modal

# Steps a period of the highest load frequency by default: loads are interpolated linearly, an error of (omega
# h)^2 / 12 = 3e-5.
STEPS_A_PERIOD = 320
# With contact, the default step is at most this share of the highest mode's period: pairs that open and close
# excite all modes, however slow the load is. Measured on beams of several proportions, cracks open and
# closed, 40 to 160 modes: up to 0.9 the errors of displacement and contact resultant are below 1e-5 and 1e-3;
# from 1 on, where modes go through whole periods in a step, up to 1e-3 and 1e-2.
CONTACT_STEP = 0.8
# Fewer steps a period than this, and the user is warned.
COARSE = 20
# Modes by default: all up to this multiple of the highest load frequency, and at least so many.
BAND, LEAST_MODES = 8.0, 80
CHUNK = 4096


class StepWarning(UserWarning):
    """The time step is coarse for the load's highest frequency, or for contact."""


@dataclass(frozen=True, eq=False)
class Transient(ModalHistory):
    """A time history; its instants are the kept steps, from t = 0.

    Attributes
    ----------
    energy : Energy
    step : float
        Time step of the integration, s.
    exchanges : int
        Exchanges of active sets in all steps.
    """

    energy: Energy
    step: float
    exchanges: int

    def __repr__(self) -> str:
        return (
            f"Transient({len(self.time)} instants to {self.time[-1]:.6g} s, step {self.step:.3g} s, "
            f"{len(self.reduction.omega)} modes, "
            f"{self.contact_force.shape[1]} pairs, peak contact resultant "
            f"{self.contact_resultant.max(initial=0.0):.6g} N, "
            f"largest energy error {np.abs(self.energy.balance).max():.2e} J)"
        )


def transient(
    model: Model | Reduction,
    load,
    duration: float,
    step: float | None = None,
    modes: int | None = None,
    contact: bool = True,
    scheme: str = "exact",
    start="rest",
    decimation: int = 1,
    reduction: Reduction | str | None = "modes",
    progress: Callable[[float], None] | str | None = "auto",
    file: str | None = None,
    restart: bool = False,
    in_memory: bool = True,
) -> Transient | FullTransient:
    """Integrate the equations of motion with unilateral contact.

    Parameters
    ----------
    model : Model or Reduction
        Its `damping` is the modal damping ratio of all modes, to which `rayleigh` adds a / (2 omega) + b
        omega / 2. A Reduction, such as `reduce_matrices` makes, stands for itself.
    load : PointForce, EdgeLoad, a sum or a sequence of them; for a Reduction a number or signal for each of
    its unit loads
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
    reduction : "modes", Reduction or None
        "modes": lowest modes and residual flexibility; a Reduction of the same model and loads, from an
        earlier history; None: the unreduced model by Newmark's average acceleration with implicit contact
        (see `full_transient`; a `FullTransient` is returned).
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
        if isinstance(model, Reduction):
            unit_loads = load if isinstance(load, (list, tuple)) else (load,)
            signals, reduction = [as_signal(value) for value in unit_loads], model
            if len(signals) != model.load_modes.shape[1]:
                raise ValueError(
                    f"transient: the reduction has {model.load_modes.shape[1]} unit loads, the load has "
                    f"{len(signals)}; give a number or signal for each"
                )
            if scheme == "paper" or (isinstance(start, tuple) and _by_functions(start)):
                raise ValueError(
                    "transient: scheme = 'paper' and a start by functions of x and y need the model itself, "
                    "not a Reduction"
                )
        else:
            model.checked_loads(load, constant=False)
            unit_loads, signals = separate(load)
            if isinstance(reduction, Reduction):
                check_reduction(model, reduction, unit_loads, "transient")
            elif reduction is not None and not (isinstance(reduction, str) and reduction == "modes"):
                raise TypeError(f"transient: reduction = {reduction!r} must be 'modes', a Reduction or None")
        highest = max((s.highest_frequency or 0.0 for s in signals), default=0.0)
        _check(duration, step, modes, scheme, start, decimation)
        full = reduction is None or scheme == "paper"
        if restart and file is None:
            raise ValueError("transient: restart = True needs the file to continue, file = 'history.h5'")
        if not in_memory and file is None:
            raise ValueError(
                "transient: in_memory = False needs a file to hold the history, file = 'history.h5'"
            )
        if full and isinstance(start, tuple) and not _by_functions(start):
            raise ValueError(
                "transient: start in modal coordinates is for the reduced model; give functions of x and y"
            )
    touching = contact and len(reduction.initial_gap if isinstance(reduction, Reduction) else model.pairs) > 0
    if full:
        needed = bool(model.damping) or (touching and step is None)
        modes = (modes or default_modes(model, highest)) if needed else 0
        top = float(modal(model, modes).frequencies[-1]) if touching and step is None else 0.0
    else:
        if reduction == "modes":
            reduction = reduce(model, unit_loads, modes or default_modes(model, highest))
        top = float(reduction.frequencies[-1]) if touching else 0.0
        if isinstance(start, tuple) and _by_functions(start):
            start = modal_start(model, reduction, start)
    count, step = _steps(comm, duration, step, highest, top, file if restart else None)
    if highest * step > 1.0 / COARSE:
        warnings.warn(
            f"the step of {step:.3g} s takes {1.0 / (highest * step):.1f} steps a period of the highest load "
            f"frequency {highest:g} Hz; at least {COARSE} are advisable",
            StepWarning,
            stacklevel=2,
        )
    with progress_bar(comm, "transient", progress) as told:
        if full:
            return full_transient(
                model,
                load,
                count,
                step,
                contact,
                "paper" if scheme == "paper" else "implicit",
                decimation,
                start,
                modes,
                told,
                file,
                restart,
                in_memory,
            )
        if file is None:
            history = integrate(reduction, signals, count, step, contact, scheme, start, decimation, told)
        else:
            from ..results.history import HistoryFile  # stands above this module

            with HistoryFile(
                comm,
                file,
                restart,
                reduction,
                signals,
                count,
                step,
                contact,
                scheme,
                start,
                decimation,
                in_memory,
            ) as record:
                history = integrate(
                    record.reduction, signals, count, step, contact, scheme, start, decimation, told, record
                )
    if step * top > 1.0 and history.contact_force.any():
        warnings.warn(
            f"the step of {step:.3g} s is longer than the period of the highest mode ({top:.6g} Hz), and "
            "pairs closed: errors of 1e-3 in displacements and 1e-2 in contact forces, and false spectral "
            "lines, are likely; "
            f"use a step of {CONTACT_STEP / top:.2g} s, the default, or fewer modes",
            StepWarning,
            stacklevel=2,
        )
    return history


def default_modes(model: Model, highest: float) -> int:
    """Number of modes up to `BAND` times the highest load frequency, at least `LEAST_MODES`."""
    most = model.boundary_unknowns // 4
    count = min(LEAST_MODES, most)
    while count < most and modal(model, count).frequencies[-1] < BAND * highest:
        count = min(math.ceil(1.5 * count), most)
    return count


def integrate(
    reduction: Reduction,
    signals,
    count: int,
    step: float,
    contact: bool = True,
    scheme: str = "exact",
    start="rest",
    decimation: int = 1,
    progress: Callable[[float], None] | None = None,
    record=None,
) -> Transient:
    """Integrate a reduced model over `count` steps, recorded in a `HistoryFile` if one is given; see
    `transient`.
    """
    r = reduction
    coefficients = step_coefficients(r.omega, r.damping, step, scheme)
    pairs = len(r.initial_gap)
    rows = r.gap_modes if contact else r.gap_modes[:0]
    flexibility = (rows * coefficients[4]) @ rows.T + r.gap_flexibility[: len(rows), : len(rows)]
    factors = thin_factors(rows)
    amplitude = np.stack([s(np.zeros(1)) for s in signals], axis=-1) if signals else np.zeros((1, 0))
    q, v, force, active = _start(r, amplitude[0], contact, start)
    ledger = Ledger(r, step, smooth=scheme != "newmark")
    keep = {
        "time": [np.zeros(1)],
        "q": [q[None].copy()],
        "v": [v[None].copy()],
        "s": [amplitude],
        "force": [_padded(force[None].copy(), pairs)],
    }
    energies = [ledger.start(q, v, amplitude[0], _padded(force[None], pairs)[0])]
    done, exchanges = (
        record.begin(keep, energies, q, v, force, active, ledger) if record is not None else (0, 0)
    )
    while done < count:
        steps = min(CHUNK, count - done)
        time = (done + np.arange(steps + 1)) * step
        amplitude = np.stack([s(time) for s in signals], axis=-1) if signals else np.zeros((steps + 1, 0))
        states, velocities, forces = (
            np.empty((steps, len(q))),
            np.empty((steps, len(q))),
            np.empty((steps, len(rows))),
        )
        reached, exchanged = march(
            coefficients,
            *factors,
            flexibility,
            amplitude @ r.load_modes.T,
            amplitude @ r.gap_loads[: len(rows)].T + r.initial_gap[: len(rows)],
            q,
            v,
            force,
            active,
            states,
            velocities,
            forces,
        )
        if reached < steps:
            raise on_all_ranks(
                SolveError(
                    f"transient: the contact problem at t = {time[reached + 1]:.6g} s was not solved; use a "
                    "smaller step or more pairs of like size"
                )
            )
        forces = _padded(forces, pairs)
        chunk = ledger.account(states, velocities, amplitude, forces)
        guard(chunk, ledger, time)
        chosen = np.flatnonzero((done + 1 + np.arange(steps)) % decimation == 0)
        for name, values in (
            ("time", time[1:]),
            ("q", states),
            ("v", velocities),
            ("s", amplitude[1:]),
            ("force", forces),
        ):
            keep[name].append(values[chosen])
        energies.append(chunk[:, chosen])
        done, exchanges = done + steps, exchanges + exchanged
        if record is not None:
            record.append(done, exchanges, keep, energies, q, v, force, active, ledger)
        if progress is not None:
            progress(done / count)
    if record is None or record.in_memory:
        # one list after another is given up, so that not everything is held twice
        whole, energies = (
            {name: np.concatenate(keep.pop(name)) for name in tuple(keep)},
            np.concatenate(energies, axis=1),
        )
    else:
        whole, energies = record.history()
    return Transient(
        whole["time"],
        whole["q"],
        whole["v"],
        whole["s"],
        whole["force"],
        r,
        Energy(*energies),
        step,
        exchanges,
    )


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


def estimate_error(model: Model, load, history: Transient, **options) -> ErrorEstimate:
    """Estimate a history's errors by integrating it again, with half of the step and with half as many modes
    again.

    Parameters
    ----------
    model : Model
    load : the history's loads
    history : Transient
    options
        Those that the history was made with (`scheme`, `start`, `contact`, `decimation`).
    """
    duration, decimation = history.time[-1], options.pop("decimation", 1)
    halved = transient(
        model,
        load,
        duration,
        step=0.5 * history.step,
        reduction=history.reduction,
        decimation=2 * decimation,
        **options,
    )
    # at half of the step too: more modes need a finer one where there is contact
    richer = transient(
        model,
        load,
        duration,
        step=0.5 * history.step,
        modes=math.ceil(1.5 * len(history.reduction.omega)),
        decimation=2 * decimation,
        **options,
    )

    def distance(one: Transient, other: Transient) -> float:
        found, exact = (np.stack([h.displacement(p) for p in h.reduction.points]) for h in (one, other))
        return float(np.linalg.norm(found - exact) / max(np.linalg.norm(exact), 1e-300))

    return ErrorEstimate(distance(history, halved), distance(halved, richer))


def _start(r: Reduction, amplitude: np.ndarray, contact: bool, start):
    """q, v, contact forces and active set at t = 0."""
    q, v = np.zeros(len(r.omega)), np.zeros(len(r.omega))
    balanced = isinstance(start, str) and start == "equilibrium"
    if not isinstance(start, str):
        q, v = (np.array(part, dtype=float) for part in start)
        if q.shape != r.omega.shape or v.shape != r.omega.shape or not np.isfinite([q, v]).all():
            raise on_all_ranks(
                ValueError(
                    f"transient: start must be two finite arrays of {len(r.omega)} modal values, not of "
                    f"shapes {q.shape} and {v.shape}"
                )
            )
    if not contact:
        if balanced:
            q = r.load_modes @ amplitude / r.omega**2
        return q, v, np.zeros(0), np.zeros(0, dtype=bool)
    flexibility, gap = r.gap_flexibility, r.gap_loads @ amplitude + r.gap_modes @ q + r.initial_gap
    if balanced:
        flexibility = flexibility + (r.gap_modes / r.omega**2) @ r.gap_modes.T
        gap = gap + (r.gap_modes / r.omega**2) @ (r.load_modes @ amplitude)
    found = solve_complementarity(flexibility, gap)
    if balanced:
        q = (r.load_modes @ amplitude + r.gap_modes.T @ found.force) / r.omega**2
    return q, v, found.force.copy(), found.active.copy()


def _padded(forces: np.ndarray, pairs: int) -> np.ndarray:
    """(n, pairs): zero forces where contact is switched off."""
    return forces if forces.shape[1] == pairs else np.zeros((len(forces), pairs))


def _check(duration, step, modes, scheme, start, decimation) -> None:
    for name, value in (("duration", duration), ("step", step)):
        if value is None and name == "step":
            continue
        if isinstance(value, bool) or not isinstance(value, numbers.Real):
            raise TypeError(f"transient: {name} = {value!r} must be a number of seconds")
        if not (math.isfinite(value) and value > 0):
            raise ValueError(f"transient: {name} = {value!r} s must be positive and finite")
    if step is not None and step > duration:
        raise ValueError(f"transient: step = {step!r} s is longer than duration = {duration!r} s")
    for name, value in (("modes", modes), ("decimation", decimation)):
        if value is not None and (
            isinstance(value, bool) or not isinstance(value, numbers.Integral) or value < 1
        ):
            raise ValueError(f"transient: {name} = {value!r} must be a positive integer")
    for name, value, known in (
        ("scheme", scheme, ("exact", "newmark", "paper")),
        ("start", start, ("rest", "equilibrium")),
    ):
        if name == "start" and isinstance(value, tuple) and len(value) == 2:
            continue
        if value not in known:
            raise ValueError(
                f"transient: {name} = {value!r} is unknown; use one of {', '.join(map(repr, known))}"
            )


def _by_functions(start: tuple) -> bool:
    return all(part is None or callable(part) for part in start)


def _steps(
    comm, duration: float, step: float | None, highest: float, top: float, file: str | None
) -> tuple[int, float]:
    """Number of steps and the step: that of the file which is to be continued if none or the same was asked
    for, otherwise one that divides `duration`.
    """
    if file is not None:
        from ..results.history_file import recorded_steps  # stands above this module

        former = recorded_steps(comm, file)
        if former is not None and (
            step is None or max(1, math.ceil(math.prod(former) / step * (1.0 - 1e-9))) == former[0]
        ):
            return max(1, math.ceil(duration / former[1] * (1.0 - 1e-9))), former[1]
    if step is None:
        step = 1.0 / (STEPS_A_PERIOD * highest) if highest > 0.0 else duration / 2000.0
        step = min(step, CONTACT_STEP / top) if top > 0.0 else step
    count = max(1, math.ceil(duration / step * (1.0 - 1e-9)))
    return count, duration / count

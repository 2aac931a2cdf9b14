"""Time histories with unilateral contact, in modal coordinates with massless contact."""

from __future__ import annotations

import math
import numbers
import warnings
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..contact.complementarity import solve_complementarity
from ..contact.marching import march
from ..errors import SolveError, UnknownName, on_all_ranks
from ..loads import separate
from ..parallel import collective
from ..progress import progress_bar
from ..reduction import Reduction, reduce
from ..system.model import Model
from .energy import Energy, Ledger, guard
from .full_transient import FullTransient, full_transient
from .steps import step_coefficients

# Steps a period of the highest load frequency by default: loads are interpolated linearly, an error of (omega h)^2 / 12 = 3e-5.
STEPS_A_PERIOD = 320
# Fewer steps a period than this, and the user is warned.
COARSE = 20
# Modes by default: all up to this multiple of the highest load frequency, and at least so many.
BAND, LEAST_MODES = 8.0, 80
CHUNK = 4096


class StepWarning(UserWarning):
    """The time step is coarse for the load's highest frequency."""


@dataclass(frozen=True, eq=False)
class Transient:
    """A time history.

    Attributes
    ----------
    time : (n,) array
        s, from 0.
    modal_displacement, modal_velocity : (n, m) arrays
        q and its derivative.
    amplitudes : (n, loads) array
        Values of the load signals.
    contact_force : (n, pairs) array
        N, compression positive.
    energy : Energy
    step : float
        Time step of the integration, s.
    exchanges : int
        Exchanges of active sets in all steps.
    reduction : Reduction
    """

    time: np.ndarray
    modal_displacement: np.ndarray
    modal_velocity: np.ndarray
    amplitudes: np.ndarray
    contact_force: np.ndarray
    energy: Energy
    step: float
    exchanges: int
    reduction: Reduction

    @property
    def modal_acceleration(self) -> np.ndarray:
        """(n, m): second derivative of q, from the equations of motion."""
        r = self.reduction
        return (self.amplitudes @ r.load_modes.T + self.contact_force @ r.gap_modes
                - 2.0 * r.damping * r.omega * self.modal_velocity - r.omega**2 * self.modal_displacement)

    @property
    def contact_resultant(self) -> np.ndarray:
        """(n,): sum of the contact forces, N."""
        return self.contact_force.sum(axis=1)

    @property
    def gap(self) -> np.ndarray:
        """(n, pairs): gaps, m."""
        r = self.reduction
        return self.modal_displacement @ r.gap_modes.T + self.contact_force @ r.gap_flexibility.T + self.amplitudes @ r.gap_loads.T + r.initial_gap

    def displacement(self, point: str) -> np.ndarray:
        """(n, 2): displacement of a named point, m."""
        k, r = self._index(point), self.reduction
        return self.modal_displacement @ r.sensor_modes[k].T + self.amplitudes @ r.sensor_loads[k].T + self.contact_force @ r.sensor_pairs[k].T

    def velocity(self, point: str) -> np.ndarray:
        """(n, 2): velocity of a named point, m/s, of the modes (the residual flexibility moves without inertia and is left out)."""
        return self.modal_velocity @ self.reduction.sensor_modes[self._index(point)].T

    def acceleration(self, point: str) -> np.ndarray:
        """(n, 2): acceleration of a named point, m/s^2, of the modes (see `velocity`)."""
        return self.modal_acceleration @ self.reduction.sensor_modes[self._index(point)].T

    def stress_intensity(self, crack: str = "crack1") -> np.ndarray:
        """(n, 2): K_I and K_II of a tip, Pa m^(1/2)."""
        r = self.reduction
        if crack not in r.tips:
            raise UnknownName(f"crack {crack!r} does not exist; the model has {', '.join(map(repr, r.tips)) or 'none'}")
        k = r.tips.index(crack)
        return self.modal_displacement @ r.tip_modes[k].T + self.amplitudes @ r.tip_loads[k].T + self.contact_force @ r.tip_pairs[k].T

    def _index(self, point: str) -> int:
        if point not in self.reduction.points:
            raise UnknownName(f"point {point!r} does not exist; the model has {', '.join(map(repr, self.reduction.points))}")
        return self.reduction.points.index(point)

    def __repr__(self) -> str:
        return (f"Transient({len(self.time)} instants to {self.time[-1]:.6g} s, step {self.step:.3g} s, {len(self.reduction.omega)} modes, "
                f"{self.contact_force.shape[1]} pairs, peak contact resultant {self.contact_resultant.max(initial=0.0):.6g} N, "
                f"largest energy error {np.abs(self.energy.balance).max():.2e} J)")


def transient(model: Model, load, duration: float, step: float | None = None, modes: int | None = None, contact: bool = True, scheme: str = "exact",
              start="rest", decimation: int = 1, reduction: Reduction | str | None = "modes", progress: Callable[[float], None] | str | None = "auto",
              file: str | None = None, restart: bool = False) -> Transient | FullTransient:
    """Integrate the equations of motion with unilateral contact.

    Parameters
    ----------
    model : Model
        Its `damping` is the modal damping ratio of all modes.
    load : PointForce, EdgeLoad, a sum or a sequence of them
        Components are numbers (constant from t = 0) or signals.
    duration : float
        s.
    step : float, optional
        s. Default: 1/320 of the shortest period of the loads; shortened to divide `duration`.
    modes : int, optional
        Default: all modes up to 8 times the loads' highest frequency, at least 80.
    contact : bool
        False: the faces may overlap.
    scheme : {"exact", "newmark", "paper"}
        "exact": every mode advanced exactly for loads linear over a step and contact forces held at the mean of its ends, so that
        contact works precisely by force times change of gap and cannot feed energy in, whatever the step; "newmark": average
        acceleration, which does the same with a period error of (omega h)^2 / 12; "paper": eqs. (28)-(34) on the unreduced model, which
        stops when its energy runs away.
    start : {"rest", "equilibrium"} or (q, v)
        Zero displacement and velocity; static equilibrium, contact included, under the loads at t = 0; or modal coordinates and their
        velocities, (m,) arrays (`reduction.translation @ (vx, vy)` is a uniform velocity).
    decimation : int
        Every so many steps are kept.
    reduction : "modes", Reduction or None
        "modes": lowest modes and residual flexibility; a Reduction of the same model and loads, from an earlier history; None: the
        unreduced model by Newmark's average acceleration with implicit contact, from rest (see `full_transient`; a `FullTransient` is returned).
    progress : callable, "auto" or None
        Called with the fraction done after each chunk of steps; "auto": a bar on rank 0, on a terminal only.
    file : str, optional
        HDF5 file that records the history as it runs (`results.history.read_history` reads it, also after Ctrl-C or a kill).
    restart : bool
        Continue `file` if it exists, with the same model, loads and settings; the history is that of an uninterrupted run. False: replace it.

    Raises
    ------
    ValueError, TypeError, KeyError
        For input that makes no sense.
    SolveError
        If a contact problem is not solved, the energy runs away or `file` cannot be written any more.

    Warns
    -----
    StepWarning
        If the step takes fewer than 20 steps a period of the highest load frequency.
    """
    with collective(model.comm):
        model.checked_loads(load, constant=False)
        unit_loads, signals = separate(load)
        highest = max((s.highest_frequency or 0.0 for s in signals), default=0.0)
        _check(duration, step, modes, scheme, start, decimation)
        count, step = _steps(duration, step, highest)
        if restart and file is None:
            raise ValueError("transient: restart = True needs the file to continue, file = 'history.h5'")
        if file is not None and (reduction is None or scheme == "paper"):
            raise ValueError("transient: file is for the reduced model; write what is wanted of the unreduced history after it")
    if highest * step > 1.0 / COARSE:
        warnings.warn(f"the step of {step:.3g} s takes {1.0 / (highest * step):.1f} steps a period of the highest load frequency {highest:g} Hz; at least {COARSE} are advisable", StepWarning, stacklevel=2)
    if reduction is None or scheme == "paper":
        if not (isinstance(start, str) and start == "rest"):
            raise on_all_ranks(ValueError(f"transient: start = {start!r} is for the reduced model; the unreduced one starts from rest"))
        return full_transient(model, load, count, step, contact, "paper" if scheme == "paper" else "implicit", decimation)
    if reduction == "modes":
        reduction = reduce(model, unit_loads, modes or default_modes(model, highest))
    with progress_bar(model.comm, "transient", progress) as told:
        if file is None:
            return integrate(reduction, signals, count, step, contact, scheme, start, decimation, told)
        from ..results.history import HistoryFile  # stands above this module

        with HistoryFile(model.comm, file, restart, reduction, signals, count, step, contact, scheme, start, decimation) as record:
            return integrate(record.reduction, signals, count, step, contact, scheme, start, decimation, told, record)


def default_modes(model: Model, highest: float) -> int:
    """Number of modes up to `BAND` times the highest load frequency, at least `LEAST_MODES`."""
    from .modal import modal

    most = model.boundary_unknowns // 4
    count = min(LEAST_MODES, most)
    while count < most and modal(model, count).frequencies[-1] < BAND * highest:
        count = min(math.ceil(1.5 * count), most)
    return count


def integrate(reduction: Reduction, signals, count: int, step: float, contact: bool = True, scheme: str = "exact", start="rest", decimation: int = 1,
              progress: Callable[[float], None] | None = None, record=None) -> Transient:
    """Integrate a reduced model over `count` steps, recorded in a `HistoryFile` if one is given; see `transient`."""
    r = reduction
    coefficients = step_coefficients(r.omega, r.damping, step, scheme)
    pairs = len(r.initial_gap)
    rows = r.gap_modes if contact else r.gap_modes[:0]
    flexibility = (rows * coefficients[4]) @ rows.T + r.gap_flexibility[: len(rows), : len(rows)]
    amplitude = np.stack([s(np.zeros(1)) for s in signals], axis=-1) if signals else np.zeros((1, 0))
    q, v, force, active = _start(r, amplitude[0], contact, start)
    ledger = Ledger(r, step, smooth=scheme != "newmark")
    keep = {"time": [np.zeros(1)], "q": [q[None].copy()], "v": [v[None].copy()], "s": [amplitude], "force": [_padded(force[None].copy(), pairs)]}
    energies = [ledger.start(q, v, amplitude[0], _padded(force[None], pairs)[0])]
    done, exchanges = record.begin(keep, energies, q, v, force, active, ledger) if record is not None else (0, 0)
    while done < count:
        steps = min(CHUNK, count - done)
        time = (done + np.arange(steps + 1)) * step
        amplitude = np.stack([s(time) for s in signals], axis=-1) if signals else np.zeros((steps + 1, 0))
        states, velocities, forces = np.empty((steps, len(q))), np.empty((steps, len(q))), np.empty((steps, len(rows)))
        reached, exchanged = march(coefficients, np.ascontiguousarray(rows), flexibility, amplitude @ r.load_modes.T,
                                   amplitude @ r.gap_loads[: len(rows)].T + r.initial_gap[: len(rows)], q, v, force, active, states, velocities, forces)
        if reached < steps:
            raise on_all_ranks(SolveError(f"transient: the contact problem at t = {time[reached + 1]:.6g} s was not solved; use a smaller step or more pairs of like size"))
        forces = _padded(forces, pairs)
        chunk = ledger.account(states, velocities, amplitude, forces)
        guard(chunk, ledger, time)
        chosen = np.flatnonzero((done + 1 + np.arange(steps)) % decimation == 0)
        for name, values in (("time", time[1:]), ("q", states), ("v", velocities), ("s", amplitude[1:]), ("force", forces)):
            keep[name].append(values[chosen])
        energies.append(chunk[:, chosen])
        done, exchanges = done + steps, exchanges + exchanged
        if record is not None:
            record.append(done, exchanges, keep, energies, q, v, force, active, ledger)
        if progress is not None:
            progress(done / count)
    whole = {name: np.concatenate(parts) for name, parts in keep.items()}
    return Transient(whole["time"], whole["q"], whole["v"], whole["s"], whole["force"], Energy(*np.concatenate(energies, axis=1)), step, exchanges, r)


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
    """Estimate a history's errors by integrating it again, with half of the step and with half as many modes again.

    Parameters
    ----------
    model : Model
    load : the history's loads
    history : Transient
    options
        Those that the history was made with (`scheme`, `start`, `contact`, `decimation`).
    """
    duration, decimation = history.time[-1], options.pop("decimation", 1)
    halved = transient(model, load, duration, step=0.5 * history.step, reduction=history.reduction, decimation=2 * decimation, **options)
    richer = transient(model, load, duration, step=history.step, modes=math.ceil(1.5 * len(history.reduction.omega)), decimation=decimation, **options)

    def distance(other: Transient) -> float:
        exact, found = (np.stack([h.displacement(p) for p in h.reduction.points]) for h in (other, history))
        return float(np.linalg.norm(found - exact) / max(np.linalg.norm(exact), 1e-300))

    return ErrorEstimate(distance(halved), distance(richer))


def _start(r: Reduction, amplitude: np.ndarray, contact: bool, start):
    """q, v, contact forces and active set at t = 0."""
    q, v = np.zeros(len(r.omega)), np.zeros(len(r.omega))
    balanced = isinstance(start, str) and start == "equilibrium"
    if not isinstance(start, str):
        q, v = (np.array(part, dtype=float) for part in start)
        if q.shape != r.omega.shape or v.shape != r.omega.shape or not np.isfinite([q, v]).all():
            raise on_all_ranks(ValueError(f"transient: start must be two finite arrays of {len(r.omega)} modal values, not of shapes {q.shape} and {v.shape}"))
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
        if value is not None and (isinstance(value, bool) or not isinstance(value, numbers.Integral) or value < 1):
            raise ValueError(f"transient: {name} = {value!r} must be a positive integer")
    for name, value, known in (("scheme", scheme, ("exact", "newmark", "paper")), ("start", start, ("rest", "equilibrium"))):
        if name == "start" and isinstance(value, tuple) and len(value) == 2:
            continue
        if value not in known:
            raise ValueError(f"transient: {name} = {value!r} is unknown; use one of {', '.join(map(repr, known))}")


def _steps(duration: float, step: float | None, highest: float) -> tuple[int, float]:
    """Number of steps and the step that divides `duration`."""
    if step is None:
        step = 1.0 / (STEPS_A_PERIOD * highest) if highest > 0.0 else duration / 2000.0
    count = max(1, math.ceil(duration / step * (1.0 - 1e-9)))
    return count, duration / count

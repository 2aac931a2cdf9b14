"""Time histories with unilateral contact, in modal coordinates with massless contact."""

from __future__ import annotations

import math
import numbers
import warnings
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy import linalg

from ..contact.complementarity import solve_complementarity
from ..contact.marching import march
from ..errors import SolveError, UnknownName, on_all_ranks
from ..loads import separate
from ..parallel import collective
from ..reduction import Reduction, reduce
from ..system.model import Model
from .full_transient import FullTransient, full_transient

# Steps a period of the highest load frequency by default: loads are interpolated linearly, an error of (omega h)^2 / 12 = 3e-5.
STEPS_A_PERIOD = 320
# Fewer steps a period than this, and the user is warned.
COARSE = 20
# Modes by default: all up to this multiple of the highest load frequency, and at least so many.
BAND, LEAST_MODES = 8.0, 80
CHUNK = 4096
# Work of the contact forces, relative to the energy supplied, beyond which a history is refused.
WORK_LIMIT = 0.01


class StepWarning(UserWarning):
    """The time step is coarse for the load's highest frequency."""


@dataclass(frozen=True, eq=False)
class Energy:
    """Energies and work since the start, (n,) arrays, J.

    Attributes
    ----------
    kinetic, strain : (n,) arrays
        The strain energy includes the residual flexibility's.
    external, damping, contact : (n,) arrays
        Work of the loads, energy dissipated by modal damping, work of the contact forces (zero but for the steps in which pairs close or open).
    """

    kinetic: np.ndarray
    strain: np.ndarray
    external: np.ndarray
    damping: np.ndarray
    contact: np.ndarray

    @property
    def total(self) -> np.ndarray:
        """(n,): kinetic and strain energy."""
        return self.kinetic + self.strain

    @property
    def balance(self) -> np.ndarray:
        """(n,): what kinetic and strain energy gained beyond the work done; zero but for the integrator's error."""
        gained = self.total - self.total[0]
        return gained - (self.external + self.contact - self.damping)


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
              start="rest", decimation: int = 1, reduction: Reduction | str | None = "modes", progress: Callable[[float], None] | None = None) -> Transient | FullTransient:
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
    progress : callable, optional
        Called with the fraction done after each chunk of steps.

    Raises
    ------
    ValueError, TypeError, KeyError
        For input that makes no sense.
    SolveError
        If a contact problem is not solved or the energy runs away.

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
    if highest * step > 1.0 / COARSE:
        warnings.warn(f"the step of {step:.3g} s takes {1.0 / (highest * step):.1f} steps a period of the highest load frequency {highest:g} Hz; at least {COARSE} are advisable", StepWarning, stacklevel=2)
    if reduction is None or scheme == "paper":
        if not (isinstance(start, str) and start == "rest"):
            raise on_all_ranks(ValueError(f"transient: start = {start!r} is for the reduced model; the unreduced one starts from rest"))
        return full_transient(model, load, count, step, contact, "paper" if scheme == "paper" else "implicit", decimation)
    if reduction == "modes":
        reduction = reduce(model, unit_loads, modes or default_modes(model, highest))
    return integrate(reduction, signals, count, step, contact, scheme, start, decimation, progress)


def default_modes(model: Model, highest: float) -> int:
    """Number of modes up to `BAND` times the highest load frequency, at least `LEAST_MODES`."""
    from .modal import modal

    most = model.boundary_unknowns // 4
    count = min(LEAST_MODES, most)
    while count < most and modal(model, count).frequencies[-1] < BAND * highest:
        count = min(math.ceil(1.5 * count), most)
    return count


def integrate(reduction: Reduction, signals, count: int, step: float, contact: bool = True, scheme: str = "exact", start="rest", decimation: int = 1,
              progress: Callable[[float], None] | None = None) -> Transient:
    """Integrate a reduced model over `count` steps; see `transient`."""
    r = reduction
    coefficients = step_coefficients(r.omega, r.damping, step, scheme)
    pairs = len(r.initial_gap)
    rows = r.gap_modes if contact else r.gap_modes[:0]
    flexibility = (rows * coefficients[4]) @ rows.T + r.gap_flexibility[: len(rows), : len(rows)]
    amplitude = np.stack([s(np.zeros(1)) for s in signals], axis=-1) if signals else np.zeros((1, 0))
    q, v, force, active = _start(r, amplitude[0], contact, start)
    ledger = _Ledger(r, step, smooth=scheme != "newmark")
    keep = {"time": [np.zeros(1)], "q": [q[None].copy()], "v": [v[None].copy()], "s": [amplitude], "force": [_padded(force[None].copy(), pairs)]}
    energies = [ledger.start(q, v, amplitude[0], _padded(force[None], pairs)[0])]
    done = exchanges = 0
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
        _guard(chunk, ledger, time)
        chosen = np.flatnonzero((done + 1 + np.arange(steps)) % decimation == 0)
        for name, values in (("time", time[1:]), ("q", states), ("v", velocities), ("s", amplitude[1:]), ("force", forces)):
            keep[name].append(values[chosen])
        energies.append(chunk[:, chosen])
        done, exchanges = done + steps, exchanges + exchanged
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


def step_coefficients(omega: np.ndarray, damping: np.ndarray, step: float, scheme: str) -> np.ndarray:
    """(10, m) coefficients of one step of each mode, see `contact.marching`.

    Parameters
    ----------
    omega, damping : (m,) arrays
        rad/s and damping ratios.
    step : float
        s.
    scheme : {"exact", "newmark"}
    """
    return (_exact if scheme == "exact" else _newmark)(omega, damping, step)


def _exact(omega: np.ndarray, damping: np.ndarray, step: float) -> np.ndarray:
    """Exact for loads linear over the step and contact forces held at the mean of its ends: exponential of [q, v, p, p'] of each mode."""
    generator = np.zeros((len(omega), 4, 4))
    generator[:, 0, 1] = generator[:, 1, 2] = generator[:, 2, 3] = step
    generator[:, 1, 0], generator[:, 1, 1] = -(omega**2) * step, -2.0 * damping * omega * step
    e = linalg.expm(generator)
    rows = []
    for k in (0, 1):
        slope = e[:, k, 3] / step
        rows += [e[:, k, 0], e[:, k, 1], e[:, k, 2] - slope, slope, 0.5 * e[:, k, 2]]
    return np.array(rows)


def _newmark(omega: np.ndarray, damping: np.ndarray, step: float) -> np.ndarray:
    """Average acceleration (beta = 1/4, gamma = 1/2)."""
    stiffness, friction = 0.25 * (step * omega) ** 2, 0.5 * step * damping * omega
    one = np.ones_like(omega)
    left = np.moveaxis(np.array([[one + stiffness, step * friction], [2.0 * stiffness / step, one + 2.0 * friction]]), 2, 0)
    right = np.moveaxis(np.array([[one - stiffness, step * (one - friction), 0.25 * step**2 * one], [-2.0 * stiffness / step, one - 2.0 * friction, 0.5 * step * one]]), 2, 0)
    s = np.linalg.solve(left, right)
    return np.array([row for k in (0, 1) for row in (s[:, k, 0], s[:, k, 1], s[:, k, 2], s[:, k, 2], s[:, k, 2])])


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


class _Ledger:
    """Energies and work, carried from chunk to chunk."""

    def __init__(self, reduction: Reduction, step: float, smooth: bool):
        # average acceleration moves by the mean of the ends' forces, so the plain trapezoidal rule is its own work
        self.r, self.step, self.smooth = reduction, step, smooth
        self.flexibility = np.block([[reduction.load_flexibility, reduction.gap_loads.T], [reduction.gap_loads, reduction.gap_flexibility]])

    def start(self, q, v, amplitude, force) -> np.ndarray:
        """(5, 1) energies and work at t = 0."""
        self.work = np.zeros(3)
        self.last = self._instants(q[None], v[None], amplitude[None], force[None])
        self.supplied = float(self.last[2].sum())
        return np.concatenate([self.last[2].T, np.zeros((3, 1))])

    def account(self, states, velocities, amplitudes, forces) -> np.ndarray:
        """(5, n): kinetic, strain, external, damping, contact after each step; `amplitudes` (n + 1, loads) begins with the step before."""
        now = self._instants(states, velocities, amplitudes[1:], forces)
        drives, moves, _, losses, rates = (np.concatenate(pair) for pair in zip(self.last, now))
        loads = amplitudes.shape[1]
        # integral of the force over the displacement: the displacement's mean over a step from its ends and the rates there
        increments = 0.5 * (drives[1:] + drives[:-1]) * np.diff(moves, axis=0)
        if self.smooth:
            increments[:, :loads] += np.diff(drives[:, :loads], axis=0) * np.diff(rates, axis=0) * (self.step / 12.0)
        steps = np.stack([increments[:, :loads].sum(axis=1), 0.5 * self.step * (losses[1:] + losses[:-1]), increments[:, loads:].sum(axis=1)])
        work = self.work[:, None] + np.cumsum(steps, axis=1)
        self.work, self.last = work[:, -1], tuple(part[-1:] for part in now)
        return np.concatenate([now[2].T, work])

    def _instants(self, q, v, amplitudes, forces):
        """Driving forces, the displacements they work on, stored energies (n, 2), dissipated power (n,), velocities at the loads."""
        r = self.r
        drive = np.concatenate([amplitudes, forces], axis=1)
        flexible = drive @ self.flexibility
        moved = q @ np.concatenate([r.load_modes, r.gap_modes.T], axis=1) + flexible
        stored = np.stack([0.5 * (v**2).sum(axis=1), 0.5 * ((r.omega * q) ** 2).sum(axis=1) + 0.5 * (drive * flexible).sum(axis=1)], axis=1)
        return drive, moved, stored, (2.0 * r.damping * r.omega * v**2).sum(axis=1), v @ r.load_modes


def _guard(chunk: np.ndarray, ledger: _Ledger, time: np.ndarray) -> None:
    """Stop where contact has fed or taken energy: it may do no work, and what it does in steps that switch is the integration's error."""
    total, external, contact = chunk[0] + chunk[1], np.abs(chunk[2]), np.abs(chunk[4])
    ledger.supplied = max(ledger.supplied, float(external.max()))
    if not np.isfinite(total).all() or contact[-1] > WORK_LIMIT * ledger.supplied:
        raise on_all_ranks(SolveError(f"transient: by t = {time[-1]:.6g} s the contact forces have done work of {contact[-1]:.3g} J beside {ledger.supplied:.3g} J supplied: "
                                      "the history is wrong; use a smaller step, or fewer modes if hardly any flexibility is left to the contact"))


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

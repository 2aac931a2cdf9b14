"""Steady states under periodic loads: the periodic motion itself, by shooting, and its stability."""

from __future__ import annotations

import math
import numbers
from dataclasses import dataclass, replace

import numpy as np

from ..dynamics.steady import Search, find_steady_state
from ..errors import SolveError, on_all_ranks
from ..loads import separate
from ..material import positive
from ..parallel import collective
from ..reduction import Reduction, check_reduction, communicator, reduce
from ..signals import Harmonic, as_signal
from ..system.model import Model
from .harmonic import Drive, one_sided
from .modal_history import ModalHistory
from .shooting import JACOBIANS, DrivenPeriod, Motion, Period, Shot, shoot
from .stability import multipliers
from .transient import CONTACT_STEP, default_modes

STEPS, LONGEST = 512, 64
# Modes of the unreduced model's preconditioner.
FULL_MODES = 40
# Times the steps are doubled to meet a tolerance.
DOUBLINGS = 7
# Bytes that the arrays of one period may take.
MEMORY = 8e9
# Uncertainty of multipliers below which rounding is all there is.
FLOOR = 1e-9


@dataclass(frozen=True, eq=False)
class Orbit(ModalHistory):
    """A periodic motion; its instants are the equal steps of one period, the end left out.

    Attributes
    ----------
    frequency : float
        Forcing frequency f, Hz.
    periods : int
        Forcing periods in one period of the motion.
    state : (2 m,) array
        (Omega q, q') at t = 0.
    multipliers : (k,) complex array
        Floquet multipliers over the motion's period, by falling modulus; empty if they were not asked for.
    multiplier_error : float
        Uncertainty of their largest modulus: its change with the time grid moved by half a step.
    residuals : tuple of float
        Norm of x(T) - x(0) at each Newton iterate.
    path : str
        How it was reached: "Newton", "history" (some periods integrated before it), "ramp of the load", "ramp
        of the damping", "neighbouring frequency", "point of a curve" or "period doubling".
    converged : bool
    step_error : float
        Relative change of the displacements from half as many steps; nan unless a tolerance was given.
    """

    frequency: float
    periods: int
    state: np.ndarray
    multipliers: np.ndarray
    multiplier_error: float
    residuals: tuple[float, ...]
    path: str
    converged: bool = True
    step_error: float = math.nan

    @property
    def iterations(self) -> int:
        """Newton iterations of the last solve."""
        return len(self.residuals) - 1

    @property
    def period(self) -> float:
        """s."""
        return self.periods / self.frequency

    @property
    def stable(self) -> bool | None:
        """Whether small disturbances die out: no multiplier outside the unit circle, by more than the
        uncertainty; None if the multipliers were not asked for.
        """
        return (
            bool(np.abs(self.multipliers[0]) <= 1.0 + np.nan_to_num(self.multiplier_error, nan=FLOOR))
            if len(self.multipliers)
            else None
        )

    def spectrum(self, point: str, direction: str = "y") -> np.ndarray:
        """Complex amplitudes at the multiples of f / periods: u(t) = Re sum_j a_j exp(i 2 pi j f t /
        periods), a_0 the mean.
        """
        return one_sided(self.displacement(point)[:, _axis(direction)])

    def harmonics(self, point: str, direction: str = "y") -> np.ndarray:
        """Complex amplitudes at the multiples of f: u(t) = Re sum_k c_k exp(i 2 pi k f t), c_0 the mean,
        m.
        """
        return self.spectrum(point, direction)[:: self.periods]

    def subharmonics(self, point: str, direction: str = "y") -> np.ndarray:
        """(periods,) complex amplitudes at j f / periods, j = 0 .. periods - 1; beside the mean, zero unless
        the motion truly takes several forcing periods.
        """
        return self.spectrum(point, direction)[: self.periods]

    def amplitude(self, point: str) -> float:
        """Half the peak-to-peak of the y displacement of a point, m."""
        return 0.5 * float(np.ptp(self.displacement(point)[:, 1]))

    def __repr__(self) -> str:
        verdict = {True: "stable", False: "unstable", None: "stability not asked for"}[self.stable]
        largest = f" (largest multiplier {np.abs(self.multipliers[0]):.7f})" if len(self.multipliers) else ""
        return (
            f"Orbit(at {self.frequency:.6g} Hz, {self.periods} forcing period{'s' * (self.periods > 1)}, "
            f"{len(self.time)} steps, {len(self.reduction.omega)} modes, "
            f"{self.contact_force.shape[1]} pairs, {self.iterations} Newton iterations, {verdict}{largest}, "
            f"peak contact resultant {self.contact_resultant.max(initial=0.0):.6g} N)"
        )


def periodic(
    model: Model | Reduction,
    load,
    frequency: float,
    periods: int | None = None,
    steps: int | None = None,
    modes: int | None = None,
    contact: bool = True,
    reduction: Reduction | str | None = "modes",
    start: Orbit | None = None,
    jacobian: str = "auto",
    stability: bool = True,
    longest: int = LONGEST,
    tolerance: float | None = None,
    search: Search | None = None,
) -> Orbit | FullOrbit:
    """Find the periodic response to periodic loads by shooting.

    Parameters
    ----------
    model : Model or Reduction
        Its damping ratio is that of all modes. A Reduction, such as `reduce_matrices` makes, stands for
        itself.
    load : PointForce, EdgeLoad, a sum or a sequence of them; for a Reduction a number or signal for each of
    its unit loads
        A number is the amplitude of sin(2 pi f t); signals stand for themselves (`Constant`: a preload;
        `Harmonic`: a further tone).
    frequency : float
        Forcing frequency f, Hz.
    periods : int, optional
        Forcing periods in one period of the motion: more than one for subharmonic motions and for tones that
        are not multiples of f. Default: the fewest in which all tones fit, or several times as many where no
        motion of that period is found and a history settles on a longer one.
    steps : int, optional
        Time steps a forcing period. Default: 512, or as many as keep the step below 0.8 of the shortest modal
        period: coarser ones let contact excite modes falsely.
    modes : int, optional
        Default: all modes up to 8 times the loads' highest frequency, at least 80.
    contact : bool
        False: the faces may overlap.
    reduction : "modes", Reduction or None
        A Reduction of the same model and loads, from an earlier orbit, saves its cost; None: the unreduced
        model (see `full_shooting.full_periodic`; a `FullOrbit` is returned).
    start : Orbit, optional
        First guess, of the same reduction. Default: the response without contact.
    jacobian : {"auto", "dense", "matrix-free", "differences"}
        See `shooting.shoot`.
    stability : bool
        Compute the Floquet multipliers.
    longest : int
        Most forcing periods in a common period of tones.
    tolerance : float, optional
        The steps are doubled until the displacements of all named points change by less than this, relative
        L2 over the period; the change is `step_error`.

    search : dynamics.steady.Search, optional
        How far a motion is looked for where Newton's method does not converge from the first guess.

    Raises
    ------
    ValueError, TypeError, KeyError
        For input that makes no sense, tones without a common period, an undamped mode driven at its own
        frequency.
    SolveError
        If no motion is found, by Newton's method, behind a history, or along a ramp of the load, the damping
        or the frequency (see `dynamics.steady`), or the tolerance is not met.
    """
    if tolerance is not None:
        positive("periodic", "tolerance", tolerance, "relative")
        if reduction is None:
            raise on_all_ranks(
                ValueError(
                    "periodic: tolerance is for the reduced model; repeat the unreduced one with more steps"
                )
            )
        return _refined(
            model,
            load,
            frequency,
            tolerance,
            periods=periods,
            steps=steps,
            modes=modes,
            contact=contact,
            reduction=reduction,
            start=start,
            jacobian=jacobian,
            stability=stability,
            longest=longest,
        )
    if reduction is None:
        from .full_shooting import full_periodic  # needs this module

        with collective(communicator(model)):
            positive("periodic", "frequency", frequency, "Hz")
            check_counts(periods, steps, modes, longest)
        if start is not None or jacobian not in ("auto", "matrix-free"):
            raise on_all_ranks(
                ValueError(
                    "periodic: start and jacobian are for the reduced model; the unreduced one starts from "
                    "its linear response, without a matrix"
                )
            )
        return full_periodic(
            model, load, frequency, periods, steps or STEPS, modes or FULL_MODES, contact, longest
        )
    period = prepare(
        model, load, frequency, periods, steps, modes, contact, reduction, start, jacobian, longest
    )
    guess = period.at(frequency).linear_state if start is None else start.state
    if contact:
        shot, path = find_steady_state(
            period, frequency, guess, jacobian=jacobian, multiples=periods is None, search=search
        )
    else:
        shot, path = shoot(period, guess, frequency, jacobian=jacobian), "Newton"
    values, uncertainty = (
        orbit_stability(shot.driven.period, shot, frequency)
        if stability
        else (np.zeros(0, dtype=complex), 0.0)
    )
    return make_orbit(shot, values, uncertainty, path)


def _refined(model, load, frequency: float, tolerance: float, **options) -> Orbit:
    """An orbit whose displacements do not change by more than a tolerance when its steps are doubled."""
    found = periodic(model, load, frequency, **options)
    for _ in range(DOUBLINGS):
        options.update(
            steps=2 * len(found.time) // found.periods,
            reduction=found.reduction,
            start=found,
            periods=found.periods,
        )
        finer = periodic(model, load, frequency, **options)
        one, other = (
            np.concatenate([orbit.displacement(point)[::stride] for point in found.reduction.points])
            for orbit, stride in ((found, 1), (finer, 2))
        )
        error = float(np.linalg.norm(one - other) / max(np.linalg.norm(other), 1e-300))
        found = replace(finer, step_error=error)
        if error < tolerance:
            return found
    raise on_all_ranks(
        SolveError(
            f"periodic: with {options['steps']} steps a period the displacements still change by {error:.2g} "
            f"when the steps are doubled; a tolerance of {tolerance:g} is not met"
        )
    )


def check_counts(periods, steps, modes, longest) -> None:
    """Raise TypeError or ValueError for counts that make no sense."""
    for name, value, least in (
        ("periods", periods, 1),
        ("steps", steps, 48),
        ("modes", modes, 1),
        ("longest", longest, 1),
    ):
        if value is None and name in ("periods", "steps", "modes"):
            continue
        if isinstance(value, bool) or not isinstance(value, numbers.Integral):
            raise TypeError(f"periodic: {name} = {value!r} must be an integer")
        if value < least:
            raise ValueError(f"periodic: {name} = {value!r} must be at least {least}")


def prepare(
    model: Model | Reduction,
    load,
    frequency,
    periods,
    steps,
    modes,
    contact,
    reduction,
    start,
    jacobian,
    longest,
) -> Period:
    """The period map of checked input."""
    with collective(communicator(model)):
        positive("periodic", "frequency", frequency, "Hz")
        check_counts(periods, steps, modes, longest)
        if jacobian not in JACOBIANS:
            raise ValueError(
                f"periodic: jacobian = {jacobian!r} must be one of {', '.join(map(repr, JACOBIANS))}"
            )

        def tone(value):
            return Harmonic(value, frequency)

        if isinstance(model, Reduction):
            unit_loads = load if isinstance(load, (list, tuple)) else (load,)
            signals = [
                tone(value) if isinstance(value, numbers.Real) else as_signal(value) for value in unit_loads
            ]
            reduction = model
        else:
            model.checked_loads(load, constant=False)
            unit_loads, signals = separate(load, number=tone)
        drive = Drive.of(signals, frequency, periods, longest)
    if isinstance(reduction, str) and reduction == "modes":
        highest = float(drive.orders.max(initial=0)) * frequency / drive.periods
        reduction = (
            start.reduction
            if start is not None
            else reduce(model, unit_loads, modes or default_modes(model, highest))
        )
    with collective(communicator(model)):
        if not isinstance(reduction, Reduction):
            raise TypeError(f"periodic: reduction = {reduction!r} must be 'modes' or a Reduction")
        if isinstance(model, Reduction):
            if reduction.load_modes.shape[1] != len(unit_loads):
                raise ValueError(
                    f"periodic: the reduction has {reduction.load_modes.shape[1]} unit loads, the load has "
                    f"{len(unit_loads)}; give a value for each"
                )
        else:
            check_reduction(model, reduction, unit_loads, "periodic")
        if start is not None and len(start.state) != 2 * len(reduction.omega):
            raise ValueError(
                f"periodic: start has {len(start.state) // 2} modes, the reduction {len(reduction.omega)}; "
                "give the start's own reduction"
            )
    if steps is None:
        steps = max(
            STEPS,
            math.ceil(reduction.frequencies.max(initial=0.0) / (CONTACT_STEP * frequency))
            if contact and len(reduction.initial_gap)
            else 0,
        )
    size = 8.0 * steps * drive.periods * (6 * len(reduction.omega) + 3 * len(reduction.initial_gap))
    if size > MEMORY:
        raise on_all_ranks(
            ValueError(
                f"periodic: {steps * drive.periods:,d} steps a period of {len(reduction.omega)} modes at "
                f"{frequency:g} Hz would take {size / 1e9:.0f} GB; give fewer steps or modes, or use static "
                "for so slow a load"
            )
        )
    return Period(reduction, drive, steps * drive.periods, contact)


def orbit_stability(
    period: Period, shot: Shot, frequency: float, factor: float = 1.0
) -> tuple[np.ndarray, float]:
    """Multipliers of an orbit and the uncertainty of the largest modulus."""
    found = multipliers(shot.driven, shot.motion).values
    return found, multiplier_error(period, shot, frequency, found, factor)


def multiplier_error(
    period: Period, shot: Shot, frequency: float, found: np.ndarray, factor: float = 1.0
) -> float:
    """Change of the largest modulus with the time grid moved by half a step: pairs then close and open
    elsewhere in their steps; nan if there is no motion on that grid.
    """
    moved = moved_by_half_a_step(period)
    first, second = (state_at(shot, k) for k in (0, 1))
    try:
        other = shoot(moved, 0.5 * (first + second), frequency, factor)
    except SolveError:
        return math.nan
    return max(FLOOR, abs(np.abs(multipliers(other.driven, other.motion).values[0]) - np.abs(found[0])))


def moved_by_half_a_step(period: Period) -> Period:
    """The same period on a time grid between the first one's instants."""
    drive = period.drive
    turned = drive.amplitudes * np.exp(1j * np.pi * drive.orders[:, None] / period.steps)
    return Period(period.reduction, replace(drive, amplitudes=turned), period.steps, period.pairs > 0)


def state_at(shot: Shot, k: int) -> np.ndarray:
    """x at the k-th instant."""
    q, v = modal_motion(shot.driven, shot.motion)
    return np.concatenate([shot.driven.period.weights * q[k], v[k]])


def modal_motion(driven: DrivenPeriod, motion: Motion) -> tuple[np.ndarray, np.ndarray]:
    """Modal displacement and velocity, (n + 1, m) each: the linear steady state and what contact adds."""
    phases = driven.period.phases
    return (phases @ driven.amplitudes).real + motion.states, (
        phases @ (driven.speeds * driven.amplitudes)
    ).real + motion.velocities


def make_orbit(shot: Shot, values: np.ndarray, uncertainty: float, path: str) -> Orbit:
    """An `Orbit` from a fixed point."""
    driven, motion, p = shot.driven, shot.motion, shot.driven.period
    q, v = modal_motion(driven, motion)
    forces = np.zeros((p.steps, len(p.reduction.initial_gap)))
    forces[:, : p.pairs] = motion.forces[:-1]
    return Orbit(
        np.arange(p.steps) * driven.step,
        q[:-1],
        v[:-1],
        driven.loads[:-1],
        forces,
        p.reduction,
        driven.frequency,
        p.drive.periods,
        shot.state,
        values,
        uncertainty,
        shot.residuals,
        path,
    )


def _axis(direction: str) -> int:
    if direction not in ("x", "y"):
        raise ValueError(f"direction = {direction!r} must be 'x' or 'y'")
    return "xy".index(direction)

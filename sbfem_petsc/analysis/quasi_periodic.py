"""Steady states under two tones whose frequencies need no common multiple: vibro-acoustic modulation as it is
measured.
"""

from __future__ import annotations

import math
import numbers
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from ..capacity import require_compiler, require_memory
from ..checks import flag, instance, integer, numbers_of
from ..dynamics.excitation import Excitation
from ..dynamics.loading import communicator, loading, serving
from ..dynamics.orbit import axis_number
from ..dynamics.preparation import CONTACT_STEP, period_memory
from ..dynamics.torus import RESTART, Curve, Torus
from ..errors import SolveError, at_point, on_all_ranks
from ..parallel import agree, collective
from ..petsc import MPI
from ..reduction.reduced_model import ReducedModel
from ..signals import Constant, Harmonic, Signal, Sum, as_signal
from ..system.model import Model

STEPS, SAMPLES = 512, 21
# Most steps, samples or modes: more is a slip.
MOST = 10**5
# Multiples of a tone that a load may have, and the relative distance from one that rounding explains.
MULTIPLES, SAME = 16, 1e-9
# Multiples of the first tone of which lines are kept.
LINES = 20
# Lyapunov exponents that are followed, and turns of the map they are averaged over.
EXPONENTS, TURNS = 4, 400


@dataclass(frozen=True, eq=False)
class QuasiPeriodic:
    """A steady state under two tones: u = Re sum c_mn exp(2 pi i (m f1 + n f2) t).

    Attributes
    ----------
    frequencies : (float, float)
        f1, f2, Hz.
    samples : int
        Phases of the slower tone.
    steps : int
        In a period of the faster one.
    reduced : ReducedModel
    states : (samples, 2 m) array
        Differences (Omega q, q') to the linear response at the beginning of a period of the faster tone.
    residuals : tuple of float
        Of Newton's method, relative to the linear response.
    exponents : (k,) array
        Largest Lyapunov exponents, 1/s; empty if they were not asked for. The one along the second tone's
        phase, zero, is not among them.
    contact_peak : float
        Largest contact resultant, N.
    """

    frequencies: tuple[float, float]
    samples: int
    steps: int
    reduced: ReducedModel
    states: np.ndarray
    residuals: tuple[float, ...]
    exponents: np.ndarray
    contact_peak: float
    _lines: np.ndarray = field(repr=False)
    _swapped: bool = field(repr=False)

    @property
    def stable(self) -> bool | None:
        """Whether disturbances die out; None if the exponents were not asked for."""
        return bool(self.exponents[0] < 0.0) if len(self.exponents) else None

    @property
    def points(self) -> tuple[str, ...]:
        """Named points."""
        return self.reduced.points.names

    @property
    def orders(self) -> np.ndarray:
        """(k,): multiples of the slower tone in `harmonics`."""
        return np.arange(self._lines.shape[1]) - self._lines.shape[1] // 2

    def harmonics(self, point: str, direction: str = "y") -> np.ndarray:
        """(21, k) complex: amplitudes at the multiples 0 to 20 of the faster tone plus those of `orders` of
        the slower one, m.
        """
        index = at_point({name: k for k, name in enumerate(self.points)}, point)
        return self._lines[:, :, index, axis_number(direction)]

    def line(self, m: int, n: int, point: str, direction: str = "y") -> complex:
        """Complex amplitude at m f1 + n f2, m; at (0, 0) the mean.

        Raises
        ------
        ValueError
            If the line is beyond what the samples and steps resolve.
        """
        m, n = integer("line", "m", m), integer("line", "n", n)
        fast, slow = (n, m) if self._swapped else (m, n)
        lines = self.harmonics(point, direction)
        if fast < 0 or (fast == 0 and slow < 0):
            return np.conj(self.line(-m, -n, point, direction))
        middle = lines.shape[1] // 2
        if fast >= len(lines) or abs(slow) > middle:
            raise ValueError(
                f"line ({m}, {n}) is not resolved: {self.samples} samples and {self.steps} steps give "
                f"multiples up to {len(lines) - 1} of the faster tone and {middle} of the slower one"
            )
        return complex(lines[fast, middle + slow])

    def modulation_index(self, point: str, direction: str = "y") -> float:
        """(|c_1,1| + |c_1,-1|) / |c_1,0|: sidebands of the first tone over itself."""
        sidebands = sum(abs(self.line(1, n, point, direction)) for n in (1, -1))
        return sidebands / abs(self.line(1, 0, point, direction))

    def __repr__(self) -> str:
        verdict = {True: "stable", False: "unstable", None: "stability not asked for"}[self.stable]
        return (
            f"QuasiPeriodic({self.frequencies[0]:.6g} and {self.frequencies[1]:.6g} Hz, {self.samples} "
            f"samples, {self.steps} steps, {len(self.reduced.omega)} modes, {len(self.residuals) - 1} "
            f"Newton iterations, {verdict}, peak contact resultant {self.contact_peak:.6g} N)"
        )


def quasi_periodic(
    model: Model | ReducedModel,
    load,
    frequencies: tuple[float, float],
    *,
    samples: int = SAMPLES,
    steps: int | None = None,
    modes: int | None = None,
    start: QuasiPeriodic | None = None,
    stability: bool = True,
) -> QuasiPeriodic:
    """Find the steady response to two tones of any frequencies by shooting of an invariant curve.

    The trajectories from the samples are shared by the model's ranks.

    Parameters
    ----------
    model : Model or ReducedModel
    load : PointForce, EdgeLoad, a sum or a sequence of them; for a ReducedModel a signal for each unit load
        Made of `Harmonic` signals at f1, f2 or multiples of either; `Constant` signals are preloads.
    frequencies : (float, float)
        f1, f2, Hz; in the usual words the probe and the pump.
    samples : int
        Phases of the slower tone: multiples up to half as many are resolved.
    steps : int, optional
        Time steps in a period of the faster tone. Default: 512, or as many as keep the step below 0.8 of the
        shortest modal period.
    modes : int, optional
        Default: as for `periodic`.
    start : QuasiPeriodic, optional
        First guess, of the same model and number of modes. Default: the linear response.
    stability : bool
        Compute the largest Lyapunov exponents.

    Raises
    ------
    ValueError, TypeError
        For input that makes no sense, a tone that belongs to neither frequency is named; and if it would take
        more memory than is free.
    SolveError
        If Newton's method does not converge, neither from the first guess nor behind a history of the curve.
    """
    comm = communicator(model)
    with collective(comm):
        frequencies = _checked(frequencies, samples, steps, modes)
        flag("quasi_periodic", "stability", stability)
        if start is not None:
            instance("quasi_periodic", "start", start, QuasiPeriodic, "an earlier result of quasi_periodic")
        loads = loading("quasi_periodic", model, load, _tone)
        swapped = frequencies[1] > frequencies[0]
        ordered = frequencies[::-1] if swapped else frequencies
        drives = _drives(loads.signals, ordered)
    agree(
        comm,
        "quasi_periodic",
        load=load,
        frequencies=frequencies,
        samples=samples,
        steps=steps,
        modes=modes,
        start=None if start is None else (start.frequencies, start.samples),
        stability=stability,
    )
    if modes is None and start is not None and isinstance(model, Model):
        modes = start.states.shape[1] // 2
    reduced = serving("quasi_periodic", model, loads, modes, _highest(drives, ordered))
    with collective(comm):
        guess = _guess(start, samples, reduced, ordered[1] / ordered[0])
    if steps is None:
        contact = len(reduced.initial_gap) > 0
        shortest = math.ceil(float(reduced.frequencies.max(initial=0.0)) / (CONTACT_STEP * ordered[0]))
        steps = max(STEPS, shortest if contact else 0)
    require_compiler("quasi_periodic", comm)
    _require_room(reduced, drives, samples, steps, comm)
    try:
        torus = Torus(reduced, drives, ordered, samples=samples, steps=steps, comm=comm)
        curve = torus.solve(guess)
    except SolveError as error:
        raise on_all_ranks(error) from None
    exponents = (
        torus.exponents(torus.derivatives(curve.motions), EXPONENTS, TURNS) if stability else np.zeros(0)
    )
    lines, peak = _lines(torus, curve)
    return QuasiPeriodic(
        frequencies, samples, steps, reduced, curve.states, curve.residuals, exponents, peak, lines, swapped
    )


def _require_room(
    reduced: ReducedModel, drives: tuple[Excitation, Excitation], samples: int, steps: int, comm: MPI.Comm
) -> None:
    """Refuse a curve whose motions and derivatives would take more memory than is free. Collective."""
    size, rows = 2 * len(reduced.omega), len(reduced.initial_gap)
    # the derivatives, the preconditioner's inverses, both of the former iteration too, and this rank's work
    derivatives = 8.0 * samples * size**2 * (4 + 3 / comm.size)
    # of this rank's samples
    motions = 8.0 * math.ceil(samples / comm.size) * steps * (size + rows)
    krylov = 8.0 * samples * size * RESTART
    period = period_memory(reduced, steps, max(len(drive.orders) for drive in drives))
    require_memory(
        "quasi_periodic",
        comm,
        derivatives + motions + krylov + period,
        f"{samples:,d} samples of {steps:,d} steps and {size // 2} modes",
        lambda share: "give fewer samples, steps or modes, or take more ranks on more machines",
    )


def _tone(value) -> Signal:
    if isinstance(value, numbers.Real) and value == 0:
        return Constant(0.0)
    if isinstance(value, numbers.Real):
        raise TypeError(
            f"quasi_periodic: load {value!r} does not say to which tone it belongs; give Harmonic({value!r}, "
            "frequency), or a Constant for a preload"
        )
    return as_signal(value)


def _checked(frequencies, samples, steps, modes) -> tuple[float, float]:
    wanted = "two numbers, (f1, f2), Hz"
    pair = numbers_of("quasi_periodic", "frequencies", frequencies, 2, wanted, above=0.0)
    if pair[0] == pair[1]:
        raise ValueError(f"quasi_periodic: both frequencies are {pair[0]:g} Hz; use periodic for one tone")
    for name, value, least in (("samples", samples, 3), ("steps", steps, 48), ("modes", modes, 1)):
        if value is None and name != "samples":
            continue
        integer("quasi_periodic", name, value, least=least, most=MOST)
    return pair[0], pair[1]


def _drives(signals: Sequence[Signal], frequencies: tuple[float, float]) -> tuple[Excitation, Excitation]:
    """Loads at multiples of the faster tone, constants included, and of the slower one."""
    found: tuple[dict, dict] = ({}, {})
    for k, signal in enumerate(signals):
        for part in signal.parts if isinstance(signal, Sum) else (signal,):
            if isinstance(part, Constant):
                tone, order, value = 0, 0, part.value
            elif isinstance(part, Harmonic):
                tone, order = _belongs(part, frequencies)
                value = -1j * part.amplitude * np.exp(1j * part.phase)
            else:
                raise ValueError(
                    f"quasi_periodic: the signal {part!r} is neither a Harmonic nor a Constant; two tones "
                    "are given as Harmonic signals"
                )
            found[tone].setdefault(order, np.zeros(len(signals), dtype=complex))[k] += value
    for tone, frequency in enumerate(frequencies):
        if not any(found[tone][order].any() for order in found[tone] if order):
            raise ValueError(
                f"quasi_periodic: no load oscillates at {frequency:g} Hz; give Harmonic(amplitude, "
                f"{frequency:g}), or use periodic for one tone"
            )
    first, second = (
        Excitation(np.array(sorted(part)), np.array([part[order] for order in sorted(part)]), 1)
        for part in found
    )
    return first, second


def _belongs(part: Harmonic, frequencies: tuple[float, float]) -> tuple[int, int]:
    """Which tone a harmonic is a multiple of, the fundamental first, and the multiple."""
    for order in range(1, MULTIPLES + 1):
        for tone, frequency in enumerate(frequencies):
            if abs(part.frequency - order * frequency) <= SAME * part.frequency:
                return tone, order
    raise ValueError(
        f"quasi_periodic: {part!r} belongs to neither tone; its frequency must be {frequencies[0]:.12g} Hz "
        f"or {frequencies[1]:.12g} Hz or a multiple of one of them"
    )


def _highest(drives: tuple[Excitation, Excitation], frequencies: tuple[float, float]) -> float:
    return max(float(drive.orders.max(initial=0)) * f for drive, f in zip(drives, frequencies))


def _guess(start, samples: int, reduced: ReducedModel, rotation: float) -> np.ndarray | None:
    """The start's curve at the phases wanted."""
    if start is None:
        return None
    modes = len(reduced.omega)
    same = start.reduced is reduced or (reduced.model is not None and start.reduced.model is reduced.model)
    if not same or start.states.shape[1] != 2 * modes:
        raise ValueError(
            "quasi_periodic: start belongs to another model or number of modes "
            f"({start.states.shape[1] // 2}, not {modes}); give one of the same model"
        )
    harmonics = np.fft.rfft(start.states, axis=0) / start.samples
    kept = np.zeros((samples // 2 + 1, 2 * modes), dtype=complex)
    common = min(len(harmonics), len(kept))
    kept[:common] = harmonics[:common]
    return np.fft.irfft(kept * samples, samples, axis=0)


def _lines(torus: Torus, curve: Curve) -> tuple[np.ndarray, float]:
    """(21, k, points, 2) lines of all named points, m, and the largest contact resultant, N."""
    r, p = torus.reduced, torus.period
    steps, samples, half = p.steps, torus.samples, torus.samples // 2
    lines = min(LINES, steps // 2 - 1)
    forward = np.exp(-2j * np.pi * np.arange(lines + 1)[:, None] * np.arange(steps) / steps) / steps
    orders = np.arange(-half, half + 1)
    found = np.zeros((lines + 1, len(orders), len(r.points.names), 2), dtype=complex)
    peak = 0.0
    for i in torus.mine:
        motion = curve.motions[i]
        assert motion is not None  # this rank's
        forces = motion.forces[:-1]
        peak = max(peak, float(forces.sum(axis=1).max(initial=0.0)))
        u = np.einsum("pim,nm->npi", r.points.modes, motion.states[:-1], optimize=True)
        u += np.einsum("pic,nc->npi", r.points.contact[..., : p.pairs], forces, optimize=True)
        theta = i / samples + torus.rotation * np.arange(steps) / steps
        for j, order in enumerate(orders):
            turned = np.exp(-2j * np.pi * order * theta)[:, None] * u.reshape(steps, -1)
            found[:, j] += (forward @ turned).reshape(lines + 1, len(r.points.names), 2) / samples
    torus.comm.Allreduce(MPI.IN_PLACE, found)
    peak = torus.comm.allreduce(peak, MPI.MAX)
    found *= 2.0
    found[0, half] *= 0.5
    if samples % 2 == 0:  # both ends of the range are the same harmonic of the samples
        found[:, [0, -1]] *= 0.5
    for tone, (drive, amplitudes) in enumerate(zip(torus.drives, (torus.base.amplitudes, torus.pumped))):
        linear = np.einsum("pim,km->kpi", r.points.modes, amplitudes)
        linear += np.einsum("pil,kl->kpi", r.points.loads, drive.amplitudes)
        for order, value in zip(drive.orders, linear):
            place = (order, half) if tone == 0 else (0, half + order)
            if place[0] <= lines and place[1] < len(orders):
                found[place] += value
    return found, peak

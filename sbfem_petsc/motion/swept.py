"""Motions under a slowly swept frequency: amplitude cycle by cycle, and jumps."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from scipy.special import wofz

from ..checks import choice, positive
from ..contact.law import peak_of, peaks_of
from ..errors import SolveError
from ..progress import silent
from ..record.record import Record, derived, described, quantity
from ..reduction.outputs import LinearOutput
from ..reduction.reduced_model import OfReduced, ReducedModel
from ..signals.signal import Constant, Signal
from ..signals.waves import Chirp
from ..system.fields.places import checked_place
from .excitation import parts_of
from .integration import Steps, chunks
from .reduced_history import ReducedIntegrator
from .states import Point

# Settling times between the means that are compared.
APART = 3
# Rates below which the change is proportional to the rate.
SLOW = 1e-3
# Rate at which a half-power bandwidth takes a settling time; of faster sweeps jumps are not told.
FASTEST = 2.0


@dataclass(frozen=True)
class Jump:
    """A jump from one steady state to another.

    Attributes
    ----------
    frequency : float
        Where the amplitude has changed half-way, Hz.
    before, after : float
        Amplitude on either side, m.
    """

    frequency: float
    before: float
    after: float


@described
class SweptLoads(Record):
    """What a swept motion is integrated from, whenever it is: loads, equal steps and the state at t = 0."""

    limits: tuple[float, float] = quantity("Hz", "first and last frequency", "end", least=0.0)
    duration: float = quantity("s", "of the sweep", least=1e-300)
    steps: int = quantity("1", "time steps", least=1)
    constant: np.ndarray = quantity("unit of the load", "constant parts", "load")
    swept: np.ndarray = quantity("unit of the load", "amplitudes of the swept sines", "load")
    q: np.ndarray = quantity("m sqrt(kg)", "modal coordinates at t = 0", "mode")
    v: np.ndarray = quantity("m sqrt(kg)/s", "their rates", "mode")
    slip: np.ndarray = quantity("m", "slips of faces that rub, just before", "slip")

    @classmethod
    def of(cls, signals: Sequence[Signal], limits: tuple[float, float], **more: Any) -> SweptLoads:
        """Of constants and chirps over these limits, and sums of them."""
        parts = [parts_of(signal) for signal in signals]
        constant = [sum(p.value for p in each if isinstance(p, Constant)) for each in parts]
        swept = [sum(p.amplitude for p in each if isinstance(p, Chirp)) for each in parts]
        return cls(limits, constant=np.array(constant, float), swept=np.array(swept, float), **more)

    @property
    def ends(self) -> np.ndarray:
        """Times (s) at which whole cycles end, the first at 0."""
        return cycle_ends(*self.limits, self.duration)

    def motion(
        self, reduced: ReducedModel, outputs: LinearOutput, report: Callable[[float], None]
    ) -> tuple[np.ndarray, np.ndarray]:
        """(cycles, places, directions), m, and (cycles,), N: half the peak-to-peak of displacements in each
        cycle, of rows the one that they have, and the contact resultant of largest modulus.
        """
        pairs = zip(self.constant.tolist(), self.swept.tolist())
        signals = [Constant(still) + Chirp(moved, *self.limits, self.duration) for still, moved in pairs]
        plan = Steps(self.steps, self.duration / self.steps, True, "exact", 1)
        integrator = ReducedIntegrator(reduced, signals, plan, (self.q, self.v, self.slip))
        displacements = np.empty((self.steps + 1, len(outputs.modes), directions(reduced)))
        contact = np.empty((self.steps + 1, 1))
        for done, rows in chunks(integrator, integrator.first().instants(), report):
            part = outputs(rows["modal_displacement"], rows["amplitudes"], rows["contact_force"])
            kept = slice(done + 1 - len(part), done + 1)
            displacements[kept] = part[:, :, -displacements.shape[2] :]
            contact[kept, 0] = rows["contact_force"][:, : reduced.gaps].sum(axis=1)
        low, high = over_cycles(self.ends, plan.step, displacements)
        return 0.5 * (high - low), peaks_of(*over_cycles(self.ends, plan.step, contact))[:, 0]


@described
class SweptResponse(OfReduced):
    """A motion under a swept frequency, one entry for each cycle of the drive.

    `settling` is that of the mode with the least decay among those in the range, or of the nearest one; 0
    without damping.
    """

    coordinates: ClassVar = ("frequency",)

    frequency: np.ndarray = quantity(
        "Hz", "mean forcing frequency of a cycle, rising or falling", "cycle", least=1e-300
    )
    loads: SweptLoads = quantity(
        text="what it is integrated from", part="SweptLoads", detail=True, repr=False
    )
    point_amplitudes: np.ndarray = quantity(
        "m", "half the peak-to-peak of u_y in a cycle", "cycle place", called="amplitude", least=0.0
    )
    contact_peak: np.ndarray = quantity("N", "contact resultant of largest modulus in a cycle", "cycle")
    settling: int = quantity("1", "cycles in which a disturbance falls to 1/e", least=0)
    reduced: ReducedModel = quantity(text="the reduced model", part="ReducedModel", detail=True, repr=False)
    x_amplitudes: np.ndarray | None = quantity(
        "m",
        "half the peak-to-peak of u_x in a cycle; none of rows, which have one direction each",
        "cycle place",
        called="amplitude_x",
        kinds="f",
        default=None,
        least=0.0,
    )
    mode_error: float = quantity(
        "1",
        "largest error of harmonics 1 to 4, each by its order, by left-out modes and the steps, of steady "
        "states at both ends and the linear peak; nan unless an accuracy was asked for",
        default=math.nan,
        finite=False,
    )

    def check(self) -> None:
        """Raise ValueError unless it has cycles, and the points of its model."""
        both = [a for a in (self.point_amplitudes, self.x_amplitudes) if a is not None]
        if not len(self.frequency) or any(a.shape[1] != len(self.points) for a in both):
            shapes = [a.shape for a in both]
            raise ValueError(f"{len(self.frequency)} cycles and amplitudes of shapes {shapes} do not fit")

    @property
    def upwards(self) -> bool:
        """Whether the frequency rises."""
        return bool(self.frequency[-1] > self.frequency[0])

    @property
    def rate(self) -> float:
        """Change of the frequency, rad/s^2, in units of the square of the decay: 2 / rate settling times pass
        while the frequency changes by a half-power bandwidth; inf without damping.
        """
        if self.settling == 0:
            return math.inf
        ends = self.loads.ends
        between = 0.5 * (ends[-1] + ends[-2] - ends[1])  # of the middles of the first and the last cycle
        change = abs(self.frequency[-1] - self.frequency[0]) / between
        return 2.0 * math.pi * float(change) * self._settling_time**2

    @property
    def tells_jumps(self) -> bool:
        """Whether jumps are told: there is damping, the sweep is longer than four settling times, and the
        frequency takes a settling time at least to change by a half-power bandwidth.
        """
        return not self._why_no_jumps()

    @derived("s", "of the sweep")
    def duration(self) -> float:
        """Of the sweep, s."""
        return self.loads.duration

    def amplitude(self, point: Point, direction: str = "y") -> np.ndarray:
        """(n,): half the peak-to-peak of a point's displacement, or of that along x, in each cycle, m. At a
        place (x, y), m, the motion is integrated again. Collective for (x, y).
        """
        along = choice("amplitude", "direction", direction, ("x", "y"))
        if not isinstance(point, str):
            place = checked_place("amplitude", point)
            found = self._at_place(place, lambda of: self.loads.motion(self.reduced, of, silent)[0][:, 0])
            return found[:, ("x", "y").index(along)]
        table = self.point_amplitudes if along == "y" else self.x_amplitudes
        if table is None:
            raise SolveError(
                "amplitude: direction = 'x' is not known of rows, which have one direction each; leave it out"
            )
        return table[:, self._index(point)]

    def _furthest(self, least: float = 0.0) -> float:
        """Largest amplitude of a named point, m."""
        return float(self.point_amplitudes.max(initial=0.0))

    def jumps(self, point: Point, least: float = 0.2, direction: str = "y") -> tuple[Jump, ...]:
        """Where the amplitude of a point changes within four settling times by more than a share beyond what
        a linear resonance does at most at the same rate, while contact acts.

        Compared are means over a settling time, two such times apart, so that the beats behind a jump are no
        jumps. Without contact in these four settling times the motion is linear and has none. With it the
        change must exceed, by the share `least`, the largest one of a linear resonance with this settling
        time at this rate (a factor of 1.02 for a `rate` of 0.01; 1.15 upwards and 1.18 downwards for 0.1, 1.4
        and 1.8 for 0.3, 2.4 and 4.0 for 1). Smaller jumps are told by a slower sweep, which also tells a fold
        from a flank that contact makes far steeper than a linear one. Motions that do not settle at all, as
        chaotic ones, may change so much again and again.

        Parameters
        ----------
        point : str or (x, y)
            See `amplitude`.
        least : float
            Relative change: the larger over the smaller amplitude, divided by that of a linear resonance,
            less 1.
        direction : {"y", "x"}
            Of the amplitude.

        Raises
        ------
        ValueError
            Without damping, and for a sweep that is too short or too fast, see `tells_jumps`.
        """
        amplitude = self.amplitude(point, direction)
        least = positive("jumps", "least", least)
        if why := self._why_no_jumps():
            raise ValueError(f"jumps: {why}")
        ends, span = self.loads.ends, self._settling_time
        # of all cycles behind whose beginning there are four settling times
        begin = ends[: np.searchsorted(ends, ends[-1] - (APART + 1) * span, side="right")]
        sums = np.concatenate([[0.0], np.cumsum(amplitude * np.diff(ends))])

        def means(time: np.ndarray) -> np.ndarray:
            total = np.interp(time + span, ends, sums) - np.interp(time, ends, sums)
            return np.maximum(total / span, 1e-300)

        before, after = means(begin), means(begin + APART * span)
        change = np.log(after / before)
        rise, fall = (bound + math.log1p(least) for bound in linear_changes(self.rate))
        touching = np.concatenate([[0], np.cumsum(self.contact_peak != 0.0)])
        last = np.searchsorted(ends, begin + (APART + 1) * span)
        contact = touching[np.minimum(last, len(amplitude))] > touching[: len(begin)]
        code = np.where(contact & ((change > rise) | (change < -fall)), np.sign(change), 0.0)
        found = []
        for run in np.split(np.arange(len(code)), np.flatnonzero(np.diff(code)) + 1):  # of one sign
            if not code[run].any():
                continue
            k = run[np.argmax(np.abs(change[run]))]
            between = np.searchsorted(ends, begin[k] + span * np.array([1.0, APART]))
            passed = amplitude[slice(*between)] > 0.5 * (before[k] + after[k])
            half = between[0] + int(np.argmax(passed == (after[k] > before[k])))
            found.append(Jump(float(self.frequency[half]), float(before[k]), float(after[k])))
        return tuple(found)

    @property
    def _settling_time(self) -> float:
        """s."""
        return self.settling / len(self.frequency) * float(self.loads.ends[-1])

    def _why_no_jumps(self) -> str:
        """What keeps jumps from being told; "" where nothing does."""
        w, cycles = self.settling, len(self.frequency)
        if w == 0:
            return "without damping no motion settles and nothing tells a jump from a beat"
        if 4 * w >= cycles:
            return (
                f"{cycles} cycles are no longer than four settling times of {w} cycles, where nothing tells "
                "a jump from a beat; sweep more slowly"
            )
        if self.rate <= FASTEST:
            return ""
        return (
            f"the frequency changes by a half-power bandwidth in {2.0 / self.rate:.2g} settling times of "
            f"{w} cycles, where nothing tells a jump from the passage through a resonance; sweep in "
            f"{self.duration * self.rate / FASTEST:.3g} s or more"
        )

    def __repr__(self) -> str:
        told = "" if math.isnan(self.mode_error) else f"error of harmonics {self.mode_error:.2g}, "
        return (
            f"SweptResponse({self.frequency[0]:.7g} to {self.frequency[-1]:.7g} Hz in {self.duration:.6g} s, "
            f"{len(self.frequency)} cycles, {told}peak contact resultant {peak_of(self.contact_peak):.6g} N)"
        )


def directions(reduced: ReducedModel) -> int:
    """How many displacements a named point has."""
    return 1 if reduced.of_rows else 2


def cycle_ends(start: float, stop: float, duration: float) -> np.ndarray:
    """Times (s) at which whole cycles of a linear chirp end, the first at 0."""
    count = int(0.5 * (start + stop) * duration * (1.0 + 1e-12))
    phase, rate = np.arange(count + 1.0), (stop - start) / duration
    return 2.0 * phase / (start + np.sqrt(np.maximum(start**2 + 2.0 * rate * phase, 0.0)))


def over_cycles(ends: np.ndarray, step: float, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Least and largest values (cycles, ...) in each cycle of (n, ...) values at equal steps from 0, the
    instants at both of its ends included.
    """
    first = np.minimum(np.ceil(ends / step - 1e-9).astype(int), len(values) - 1)
    low, high = (
        operation.reduceat(values[: first[-1] + 1], first[:-1], axis=0)
        for operation in (np.minimum, np.maximum)
    )
    return np.minimum(low, values[first[1:]]), np.maximum(high, values[first[1:]])


def settling_cycles(reduced: ReducedModel, limits: Sequence[float]) -> int:
    """Cycles at the middle of a range of frequencies (Hz) in which a disturbance falls to 1/e."""
    f, middle = reduced.frequencies, 0.5 * (limits[0] + limits[1])
    inside = (f >= min(limits)) & (f <= max(limits))
    if not inside.any():
        inside[np.argmin(np.abs(f - middle))] = True
    decay = float((reduced.damping * reduced.omega)[inside].min())
    return max(1, int(np.ceil(middle / decay))) if decay > 0.0 else 0


@functools.lru_cache(maxsize=16)
def linear_changes(rate: float) -> tuple[float, float]:
    """Largest rise and fall of the logarithm of the mean amplitude of a linear resonance over a settling
    time, to that of the settling time `APART` of them later.

    With s the time in settling times 1 / delta (delta = zeta omega), counted from resonance, and R = r /
    delta^2 the rate r (rad/s^2) in those units, the complex amplitude of a mode under a force of one size and
    swept frequency obeys, where damping and detuning are small beside omega,

        y' = -(1 + i R s) y + 1,    y(s) = sqrt(pi / (2 R)) w(i z) exp(i c),
        z = (1 + i R s) exp(i pi / 4) / sqrt(2 R)

    with a constant phase c and the Faddeeva function w(iz) = exp(z^2) erfc(z).

    Parameters
    ----------
    rate : float
        Of the frequency, R.
    """
    if rate < SLOW:
        return linear_changes(SLOW)
    # a few bandwidths on either side, and until the free vibration has died out; its beats with the forced
    # one are the fastest there is to be resolved
    reach = int(np.ceil(4.0 / rate + 12.0))
    n = int(np.ceil(8.0 + 2.0 * rate * reach))
    s = np.arange(-reach * n, reach * n + 1) / n
    z = (1.0 + 1j * rate * s) * np.exp(0.25j * np.pi) / np.sqrt(2.0 * rate)
    amplitude = np.abs(wofz(1j * z))
    sums = np.concatenate([[0.0], np.cumsum(amplitude[1:] + amplitude[:-1])])
    means = sums[n:] - sums[:-n]
    change = np.log(means[APART * n :] / means[: -APART * n])
    return float(change.max()), float(-change.min())

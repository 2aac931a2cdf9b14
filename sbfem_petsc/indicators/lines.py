"""Lines of known frequencies in records: tones, harmonics, subharmonics, sidebands."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..checks import integer, positive
from ..record.record import Record, derived, described, quantity
from .record import COHERENT, checked_record, checked_tones, coherent_length, numbers

# Rows of the fit that are held in memory at a time.
SLAB = 16384


def tones(time, values, frequencies) -> np.ndarray:
    """Complex amplitudes of tones of known frequencies.

    In a coherent trailing part of the record these are its Fourier coefficients; otherwise a least-squares
    fit, weighted by a Hann window when the record is long enough, which keeps out what is at other
    frequencies.

    Parameters
    ----------
    time, values : (n,) arrays
        Uniform times, s, and what was recorded.
    frequencies : (m,) sequence of float
        Different frequencies, Hz; 0 is the mean.

    Returns
    -------
    (m,) complex array

    Raises
    ------
    ValueError
        If a frequency is not below half the sampling rate, or the record too short to tell them apart.
    """
    return _fit("tones", checked_record("tones", time, values), frequencies)


def _fit(owner: str, record: tuple[np.ndarray, np.ndarray, float], tones) -> np.ndarray:
    """Complex amplitudes of tones in a record that has been checked."""
    t, u, step = record
    frequencies = checked_tones(owner, tones, step, zero=True)
    # A tone has an image at minus its frequency: the one nearest to zero is parted from its own by twice its
    # frequency.
    spacing = np.diff(np.sort(np.concatenate([-frequencies[frequencies > 0.0], frequencies]))).min(
        initial=np.inf
    )
    if spacing * len(t) * step < 1.0 - COHERENT:
        raise ValueError(
            f"{owner}: the record of {len(t) * step:g} s is too short to tell apart lines {spacing:g} Hz "
            f"apart; at least {1.0 / spacing:g} s are needed"
            if spacing
            else f"{owner}: a frequency is given twice; different ones are expected"
        )
    length = coherent_length(len(t), step, frequencies[frequencies > 0.0])
    if length * step * spacing > 1.0 - COHERENT:
        t, u, weights = t[-length:], u[-length:], np.ones(length)
    else:
        from scipy.signal import get_window  # slow to load, for all that know cases

        weights = get_window("hann", len(t) + 1)[1:] if len(t) * step * spacing >= 2.0 else np.ones(len(t))
    # The normal equations of nearly orthogonal columns: nothing is lost by them.
    waves = 2 * len(frequencies)
    normal, right = np.zeros((waves, waves)), np.zeros(waves)
    for first in range(0, len(t), SLAB):
        part = slice(first, first + SLAB)
        angle = 2.0 * np.pi * np.outer(t[part], frequencies)
        columns = np.hstack([np.cos(angle), np.sin(angle)])
        weighted = columns * weights[part, None]
        normal += weighted.T @ columns
        right += weighted.T @ u[part]
    normal[np.diag_indices(waves)] += normal.diagonal() == 0.0  # the sine of frequency 0
    cosines, sines = np.split(np.linalg.solve(normal, right), 2)
    return cosines - 1j * sines


def harmonics(time, values, frequency: float, count: int = 20) -> np.ndarray:
    """Harmonics of a record: u(t) = Re sum c_k exp(i 2 pi k f t).

    Parameters
    ----------
    time, values : (n,) arrays
        Uniform times, s, and what was recorded: at least one period.
    frequency : float
        f, Hz.
    count : int
        Highest k.

    Returns
    -------
    (count + 1,) complex array
        c_0 (the mean) to c_count; exact to round-off if the record holds nothing else, or whole periods in a
        whole number of steps.
    """
    record = checked_record("harmonics", time, values)
    count = integer("harmonics", "count", count, least=1, most=len(record[0]))
    first = positive("harmonics", "frequency", frequency, "Hz")
    return _fit("harmonics", record, first * np.arange(count + 1))


def _amplitudes(owner: str, c, least: int) -> np.ndarray:
    """|c_k| of the last axis."""
    amplitude = np.abs(numbers(owner, "c", c, "an array of harmonics, complex or real numbers"))
    if amplitude.ndim < 1 or amplitude.shape[-1] <= least:
        raise ValueError(
            f"{owner}: harmonics of shape {amplitude.shape} were given; c_0 to c_{least} are needed along "
            "the last axis"
        )
    if not (np.isfinite(amplitude).all() and (amplitude[..., 1] > 0.0).all()):
        raise ValueError(f"{owner}: harmonics must be finite and A_1 = |c_1| not zero")
    return amplitude


def harmonic_ratios(c) -> np.ndarray:
    """A_n / A_1 for n = 0, 1, ... along the last axis, from harmonics c_0, c_1, ... as `harmonics` gives
    them.
    """
    amplitude = _amplitudes("harmonic_ratios", c, 1)
    return amplitude / amplitude[..., 1:2]


def beta(c) -> np.ndarray:
    """Second-order nonlinearity A_2 / A_1^2 (1/m for displacements) of harmonics c_0, c_1, ... along the last
    axis.
    """
    amplitude = _amplitudes("beta", c, 2)
    return amplitude[..., 2] / amplitude[..., 1] ** 2


def gamma(c) -> np.ndarray:
    """Third-order nonlinearity A_3 / A_1^3 (1/m^2 for displacements) of harmonics c_0, c_1, ... along the
    last axis.
    """
    amplitude = _amplitudes("gamma", c, 3)
    return amplitude[..., 3] / amplitude[..., 1] ** 3


@dataclass(frozen=True, eq=False)
class Subharmonics:
    """Lines of a record at k / divisor of the drive.

    Attributes
    ----------
    drive : float
        Driving frequency, Hz.
    divisor : int
    amplitude : (count * divisor + 1,) complex array
        At k drive / divisor; the mean first.
    """

    drive: float
    divisor: int
    amplitude: np.ndarray

    @property
    def frequency(self) -> np.ndarray:
        """Frequencies of the lines, Hz."""
        return self.drive / self.divisor * np.arange(len(self.amplitude))

    @property
    def ratio(self) -> float:
        """The largest |amplitude| of the lines that are no harmonic of the drive, over that at the drive."""
        between = np.arange(len(self.amplitude)) % self.divisor != 0
        at_drive = abs(self.amplitude[self.divisor])
        return float(np.abs(self.amplitude[between]).max() / at_drive) if at_drive > 0.0 else math.inf

    def __repr__(self) -> str:
        return (
            f"Subharmonics(drive {self.drive:.6g} Hz / {self.divisor}: {abs(self.amplitude[1]):.4g} at "
            f"{self.frequency[1]:.6g} Hz, {abs(self.amplitude[self.divisor]):.4g} at the drive, largest "
            f"ratio {self.ratio:.3g})"
        )


def subharmonics(time, values, frequency: float, divisor: int = 2, *, count: int = 3) -> Subharmonics:
    """Lines at k frequency / divisor up to harmonic `count` of the driving `frequency` (Hz)."""
    record = checked_record("subharmonics", time, values)
    divisor = integer("subharmonics", "divisor", divisor, least=2, most=len(record[0]))
    count = integer("subharmonics", "count", count, least=1, most=len(record[0]))
    drive = positive("subharmonics", "frequency", frequency, "Hz")
    lines = drive / divisor * np.arange(divisor * count + 1)
    return Subharmonics(drive, divisor, _fit("subharmonics", record, lines))


@described
class Sidebands(Record):
    """Sidebands of a carrier at carrier -+ n modulation, of displacements; others have their own unit."""

    carrier: float = quantity("Hz", "high tone")
    modulation: float = quantity("Hz", "low tone")
    centre: complex = quantity("m", "complex amplitude at the high tone")
    lower: np.ndarray = quantity(
        "m", "complex amplitudes at high - n low, n = 1, 2, ...", "sideband", kinds="c"
    )
    upper: np.ndarray = quantity("m", "complex amplitudes at high + n low", "sideband", kinds="c")
    inseparable: tuple[int, ...] = quantity(
        "1",
        "harmonics of the low tone that the record cannot tell from one of the lines, where they are counted",
        "harmonic",
        default=(),
        detail=True,
    )

    @derived("1", "(|lower| + |upper|) / |centre| of each pair", "sideband", finite=False)
    def indices(self) -> np.ndarray:
        """(order,) modulation indices (A_L + A_R)/A_0 of the pairs of order n, |lower| + |upper| over
        |centre|.
        """
        with np.errstate(divide="ignore", invalid="ignore"):
            return (np.abs(self.lower) + np.abs(self.upper)) / np.abs(self.centre)

    @derived("1", "that of the first pair", finite=False)
    def modulation_index(self) -> float:
        """(A_L + A_R)/A_0 of the first pair; m for a carrier multiplied by 1 + m sin (sidebands m A_0 / 2
        each).
        """
        return float(self.indices[0])

    def __repr__(self) -> str:
        text = f"Sidebands(carrier {self.carrier:.6g} Hz: {abs(self.centre):.4g}; " + ", ".join(
            f"-+{n} x {self.modulation:.6g} Hz: {abs(low):.4g}, {abs(high):.4g}"
            for n, (low, high) in enumerate(zip(self.lower, self.upper), 1)
        )
        held = (
            f"; lines include harmonics {', '.join(map(str, self.inseparable))} of the modulation"
            if self.inseparable
            else ""
        )
        return f"{text}; modulation index (A_L + A_R)/A_0 = {self.modulation_index:.4g}{held})"


def sidebands(time, values, carrier: float, modulation: float, *, order: int = 1) -> Sidebands:
    """Amplitudes at carrier -+ n modulation and the modulation index (A_L + A_R)/A_0.

    The mean, the modulation's own harmonics and two further pairs of sidebands are fitted beside them, so
    that they do not leak into the lines.

    Parameters
    ----------
    time, values : (n,) arrays
        Uniform times, s, and what was recorded: at least two periods of the modulation.
    carrier, modulation : float
        Hz; carrier > order * modulation.
    order : int
        Pairs of sidebands.
    """
    t, u, step = checked_record("sidebands", time, values)
    order = integer("sidebands", "order", order, least=1)
    carrier = positive("sidebands", "carrier", carrier, "Hz")
    modulation = positive("sidebands", "modulation", modulation, "Hz")
    if carrier <= order * modulation:
        raise ValueError(
            f"sidebands: carrier = {carrier:g} Hz must be above order * modulation = {order * modulation:g} "
            "Hz"
        )
    duration = len(t) * step
    if duration * modulation < 2.0 - COHERENT:
        raise ValueError(
            f"sidebands: the record of {duration:g} s is too short for sidebands {modulation:g} Hz apart; at "
            f"least {2.0 / modulation:g} s are needed"
        )
    pairs = np.arange(-order, order + 1)
    lines = checked_tones("sidebands", carrier + pairs * modulation, step)
    # Closer than this to another line, a further one cannot be fitted; in a coherent record all lines are
    # orthogonal.
    apart = (0.5 if coherent_length(len(t), step, np.array([carrier, modulation])) else 2.0) / duration
    around = np.arange(-order - 2, order + 3) * modulation
    own = np.unique(np.concatenate([np.arange(6), np.round((carrier + around) / modulation)])).astype(int)
    own = own[own >= 0]
    held = tuple(int(k) for k in own if k and np.abs(lines - k * modulation).min() < apart)
    fitted = list(lines)
    for further in np.concatenate([own * modulation, carrier + around]):
        if (
            0.0 <= further < 0.5 / step - apart
            and min(abs(further - line) for line in fitted) > apart
            and (further == 0.0 or further > 0.5 * apart)
        ):
            fitted.append(further)
    amplitude = _fit("sidebands", (t, u, step), np.array(fitted))[: 2 * order + 1]
    return Sidebands(
        carrier, modulation, complex(amplitude[order]), amplitude[:order][::-1], amplitude[order + 1 :], held
    )

"""Damage indicators of time histories: spectra, harmonics, subharmonics, sidebands, contact duty, frequency
shifts.

Everything works on plain arrays with a uniform time step. Complex amplitudes are one-sided and refer to the
given times: u(t) = Re sum c_k exp(i 2 pi f_k t), c_0 the mean.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction

import numpy as np
from scipy.fft import rfft, rfftfreq
from scipy.signal import detrend as remove_trend
from scipy.signal import get_window
from scipy.stats import chi2, ncx2

from .checks import choice, integer, positive, real, real_array, shown

# A record is coherent with a tone if it holds whole periods of it to this fraction of a period.
COHERENT = 1e-6
# Steps are uniform if no time is further from its place than this fraction of a step.
UNIFORM = 1e-6
# Rows of the fit that are held in memory at a time.
SLAB = 16384


def _record(owner: str, time, values, columns: bool = False) -> tuple[np.ndarray, np.ndarray, float]:
    """Checked time and values as arrays of floats, and the step."""
    arrays = []
    for name, given in (("time", time), ("values", values)):
        shape = getattr(given, "shape", ())
        if len(shape) > 1 and not (columns and name == "values"):
            raise ValueError(
                f"{owner}: {name} has the shape {shape}; one dimension is expected (one component, "
                "such as values[:, 1])"
            )
        arrays.append(real_array(owner, name, given, max(len(shape), 1)))
    t, u = arrays
    if len(t) != len(u):
        raise ValueError(f"{owner}: {len(t)} times and {len(u)} values were given; their numbers must agree")
    if len(t) < 4:
        raise ValueError(f"{owner}: the number of samples is {len(t)}; at least 4 are needed")
    step = (t[-1] - t[0]) / (len(t) - 1)
    if not step > 0.0:
        raise ValueError(f"{owner}: time runs from {t[0]:g} s to {t[-1]:g} s; times must rise")
    error = np.abs(t - (t[0] + step * np.arange(len(t))))
    if error.max() > UNIFORM * step + 8.0 * np.finfo(float).eps * np.abs(t).max():
        worst = int(np.argmax(np.abs(np.diff(t) - step)))
        raise ValueError(
            f"{owner}: the step after time[{worst}] is {t[worst + 1] - t[worst]:g} s and the mean step "
            f"{step:g} s; uniform steps are expected"
        )
    return t, u, float(step)


def _tones(owner: str, frequencies, step: float, zero: bool = False) -> np.ndarray:
    """Checked frequencies below half the sampling rate."""
    one = not isinstance(frequencies, (list, tuple, np.ndarray))
    tones = real_array(owner, "frequencies", frequencies, 0 if one else 1, "Hz").reshape(-1)
    if not tones.size:
        raise ValueError(
            f"{owner}: frequencies = {shown(frequencies)} must be a number or a sequence of numbers, in Hz"
        )
    for tone in tones:
        if not (np.isfinite(tone) and (tone > 0.0 or zero and tone == 0.0)):
            raise ValueError(
                f"{owner}: frequency {tone:g} Hz must be {'zero or ' if zero else ''}positive and finite"
            )
        if not tone * step < 0.5:
            raise ValueError(
                f"{owner}: frequency {tone:.10g} Hz is not below half the sampling rate, {0.5 / step:.10g} "
                "Hz; a smaller step is needed"
            )
    return tones


def _off(cycles: np.ndarray) -> np.ndarray:
    return np.abs(cycles - np.round(cycles))


def _coherent_length(samples: int, step: float, tones: np.ndarray) -> int:
    """Most samples, up to `samples`, that hold whole periods of all tones; 0 if no number does."""
    lengths = np.arange(samples, 0, -1)
    for tone in np.sort(tones)[::-1]:
        cycles = lengths * step * tone
        lengths = lengths[(_off(cycles) <= COHERENT) & (cycles > 0.5)]
    return int(lengths[0]) if lengths.size else 0


def coherent_record(time, values, frequencies) -> tuple[np.ndarray, np.ndarray]:
    """The longest trailing part of a record that holds whole periods of all tones.

    Parameters
    ----------
    time : (n,) array
        s, uniform.
    values : (n, ...) array
    frequencies : float or sequence of float
        Tones, Hz.

    Returns
    -------
    time, values : (m,) and (m, ...) arrays
        The last m samples; m steps are whole periods of each tone to 1e-6 of a period.

    Raises
    ------
    ValueError
        If there is none; the sentence proposes the nearest tones that fit, and a longer record if one would
        do.
    """
    t, u, step = _record("coherent_record", time, values, columns=True)
    tones = _tones("coherent_record", frequencies, step)
    if length := _coherent_length(len(t), step, tones):
        return t[-length:], u[-length:]
    if len(t) * step * tones.min() < 1.0 - COHERENT:
        raise ValueError(
            f"coherent_record: the record of {len(t) * step:g} s is shorter than one period of "
            f"{tones.min():.9g} Hz, {1.0 / tones.min():g} s"
        )
    lengths = np.arange(len(t) // 2, len(t) + 1)
    nearest = int(lengths[np.argmin(np.max([_off(lengths * step * tone) for tone in tones], axis=0))])
    fitting = np.maximum(np.round(nearest * step * tones), 1.0) / (nearest * step)
    text = (
        f"coherent_record: no trailing part of the {len(t)} samples (step {step:g} s, {len(t) * step:g} s in "
        f"all) holds whole periods of {_listed(tones)}; the nearest, {nearest} samples, would for "
        f"{_listed(fitting)}"
    )
    needed = math.lcm(*(Fraction(tone * step).limit_denominator(10**7).denominator for tone in tones))
    if len(t) < needed <= 10**8 and _off(needed * step * tones).max() <= COHERENT:
        text += f", and {needed} samples ({needed * step:g} s) for the given ones"
    raise ValueError(text)


def _listed(tones: np.ndarray) -> str:
    names = [f"{tone:.9g} Hz" for tone in tones]
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"


@dataclass(frozen=True, eq=False)
class Spectrum:
    """One-sided spectrum of a record.

    Attributes
    ----------
    frequency : (m,) array
        Hz, from 0 to half the sampling rate.
    amplitude : (m,) complex array
        Divided by the window's mean: a tone A sin in the middle of a line has |amplitude| = A. The mean at
        frequency 0.
    window : str, tuple or None
    coherent : bool
        Whether the record holds whole periods, so that without a window no line leaks: of the tones that were
        named, else of the strongest line (to 1e-3 of a line, as far as it can be told from its neighbours).
    weights : (n,) array
        The window's values.
    start, step : float
        First time and time step, s.
    """

    frequency: np.ndarray
    amplitude: np.ndarray
    window: str | tuple | None
    coherent: bool
    weights: np.ndarray
    start: float
    step: float

    def at(self, frequency: float) -> complex:
        """Amplitude of a lone tone between the lines: the nearest line, divided by what the window leaves of
        it there (scalloping).
        """
        tone = _tones("Spectrum", frequency, self.step)[0]
        line = int(np.clip(round(tone / self.frequency[1]), 1, len(self.frequency) - 2))
        turn = np.exp(
            2j
            * np.pi
            * (tone - self.frequency[line])
            * (self.start + self.step * np.arange(len(self.weights)))
        )
        return complex(self.amplitude[line] * self.weights.sum() / (self.weights @ turn))

    def __repr__(self) -> str:
        strongest = 1 + int(np.argmax(np.abs(self.amplitude[1:])))
        return (
            f"Spectrum({len(self.frequency)} lines every {self.frequency[1]:.6g} Hz up to "
            f"{self.frequency[-1]:.6g} Hz, window={self.window!r}, "
            f"{'coherent' if self.coherent else 'not coherent'}; strongest line "
            f"{abs(self.amplitude[strongest]):.4g} at {self.frequency[strongest]:.6g} Hz)"
        )


def spectrum(
    time, values, window: str | tuple | None = None, detrend: str | None = None, frequencies=None
) -> Spectrum:
    """Amplitude spectrum of a record.

    Parameters
    ----------
    time, values : (n,) arrays
        Uniform times, s, and what was recorded.
    window : None, str or tuple
        None for a coherent record; otherwise "hann", "flattop" (0.11 % low at most between the lines) or
        another name of `scipy.signal.get_window`.
    detrend : {None, "constant", "linear"}
        What is taken off first.
    frequencies : float or sequence of float, optional
        Tones in the record, Hz, by which `coherent` is judged.
    """
    t, u, step = _record("spectrum", time, values)
    if detrend is not None:
        u = remove_trend(u, type=choice("spectrum", "detrend", detrend, ("constant", "linear")))
    if window is not None and not isinstance(window, (str, tuple)):
        raise TypeError(f"spectrum: window = {shown(window)} must be None, a name such as 'hann', or a tuple")
    try:
        weights = np.ones(len(u)) if window is None else get_window(window, len(u))
    except (ValueError, TypeError) as error:
        raise ValueError(
            f"spectrum: window = {window!r} is unknown to scipy.signal.get_window ({error}); use None, "
            '"hann" or "flattop"'
        ) from None
    frequency = rfftfreq(len(u), step)
    one_sided = np.full(len(frequency), 2.0)
    one_sided[0] = 1.0
    if len(u) % 2 == 0:
        one_sided[-1] = 1.0  # this line is its own mirror image
    if frequencies is None:
        coherent = _strongest_is_centred(rfft(u))
    else:
        coherent = bool((_off(len(u) * step * _tones("spectrum", frequencies, step)) <= COHERENT).all())
    amplitude = rfft(weights * u) * one_sided / weights.sum() * np.exp(-2j * np.pi * frequency * t[0])
    return Spectrum(frequency, amplitude, window, coherent, weights, float(t[0]), step)


def _strongest_is_centred(lines: np.ndarray) -> bool:
    k = 1 + int(np.argmax(np.abs(lines[1:-1])))
    if abs(lines[k]) <= 1e-12 * np.abs(lines).max():
        return True  # nothing but a mean
    # Jacobsen's estimate of a tone's distance from the line, exact for a single complex tone in a long
    # record.
    curvature = 2.0 * lines[k] - lines[k - 1] * (k > 1) - lines[k + 1]
    return bool(abs(lines[k - 1] * (k > 1) - lines[k + 1]) <= 1e-3 * abs(curvature))


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
    t, u, step = _record("tones", time, values)
    return _fit("tones", t, u, step, _tones("tones", frequencies, step, zero=True))


def _fit(owner: str, t: np.ndarray, u: np.ndarray, step: float, frequencies: np.ndarray) -> np.ndarray:
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
    length = _coherent_length(len(t), step, frequencies[frequencies > 0.0])
    if length * step * spacing > 1.0 - COHERENT:
        t, u, weights = t[-length:], u[-length:], np.ones(length)
    else:
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
    t, u, step = _record("harmonics", time, values)
    count = integer("harmonics", "count", count, least=1, most=len(t))
    return _fit(
        "harmonics",
        t,
        u,
        step,
        _tones(
            "harmonics",
            positive("harmonics", "frequency", frequency, "Hz") * np.arange(count + 1),
            step,
            zero=True,
        ),
    )


def _amplitudes(owner: str, c, least: int) -> np.ndarray:
    """|c_k| of the last axis."""
    try:
        array = np.asarray(c)
    except ValueError:  # rows of different lengths
        array = np.asarray(None)
    if array.dtype.kind not in "iufc":
        raise TypeError(f"{owner}: c = {shown(c)} must be an array of harmonics, complex or real numbers")
    amplitude = np.abs(array)
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


def subharmonics(time, values, frequency: float, divisor: int = 2, count: int = 3) -> Subharmonics:
    """Lines at k frequency / divisor up to harmonic `count` of the driving `frequency` (Hz)."""
    t, u, step = _record("subharmonics", time, values)
    divisor = integer("subharmonics", "divisor", divisor, least=2, most=len(t))
    count = integer("subharmonics", "count", count, least=1, most=len(t))
    drive = positive("subharmonics", "frequency", frequency, "Hz")
    lines = _tones("subharmonics", drive / divisor * np.arange(divisor * count + 1), step, zero=True)
    return Subharmonics(drive, divisor, _fit("subharmonics", t, u, step, lines))


@dataclass(frozen=True, eq=False)
class Sidebands:
    """Sidebands of a carrier at carrier -+ n modulation.

    Attributes
    ----------
    carrier, modulation : float
        Hz.
    centre : complex
        Amplitude at the carrier.
    lower, upper : (order,) complex arrays
        Amplitudes at carrier - n modulation and carrier + n modulation, n = 1 to order.
    inseparable : tuple of int
        Harmonics of the modulation that this record cannot tell from one of the lines: what they hold is
        counted there.
    """

    carrier: float
    modulation: float
    centre: complex
    lower: np.ndarray
    upper: np.ndarray
    inseparable: tuple[int, ...] = ()

    @property
    def indices(self) -> np.ndarray:
        """(order,) modulation indices (A_L + A_R)/A_0 of the pairs of order n, |lower| + |upper| over
        |centre|.
        """
        with np.errstate(divide="ignore", invalid="ignore"):
            return (np.abs(self.lower) + np.abs(self.upper)) / np.abs(self.centre)

    @property
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


def sidebands(time, values, carrier: float, modulation: float, order: int = 1) -> Sidebands:
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
    t, u, step = _record("sidebands", time, values)
    order = integer("sidebands", "order", order, least=1)
    carrier, modulation = (
        positive("sidebands", "carrier", carrier, "Hz"),
        positive("sidebands", "modulation", modulation, "Hz"),
    )
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
    lines = _tones("sidebands", carrier + pairs * modulation, step)
    # Closer than this to another line, a further one cannot be fitted; in a coherent record all lines are
    # orthogonal.
    apart = (0.5 if _coherent_length(len(t), step, np.array([carrier, modulation])) else 2.0) / duration
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
    amplitude = _fit("sidebands", t, u, step, np.array(fitted))[: 2 * order + 1]
    return Sidebands(
        carrier, modulation, complex(amplitude[order]), amplitude[:order][::-1], amplitude[order + 1 :], held
    )


@dataclass(frozen=True, eq=False)
class ContactDuty:
    """Fractions of the time in contact.

    Attributes
    ----------
    pairs : (pairs,) array
        Of each pair.
    any, all : float
        Of at least one pair, and of all at once.
    """

    pairs: np.ndarray
    any: float
    all: float

    def __repr__(self) -> str:
        return (
            f"ContactDuty({len(self.pairs)} pairs: any in contact {100 * self.any:.4g} %, all "
            f"{100 * self.all:.4g} % of the time)"
        )


def contact_duty(time, contact_force, threshold: float = 0.0) -> ContactDuty:
    """Fraction of the time in which pairs carry more than `threshold` (N).

    `contact_force` is (n,) or (n, pairs), N, compression positive; each sample stands for one step.
    """
    _, force, _ = _record("contact_duty", time, contact_force, columns=True)
    if force.ndim > 2 or force.size == 0:
        raise ValueError(
            f"contact_duty: contact_force has the shape {force.shape}; (times,) or (times, pairs) is expected"
        )
    threshold = real("contact_duty", "threshold", threshold, "N")
    touching = force.reshape(len(force), -1) > threshold
    return ContactDuty(
        touching.mean(axis=0), float(touching.any(axis=1).mean()), float(touching.all(axis=1).mean())
    )


def frequency_shift(cracked: Sequence[float], healthy: Sequence[float]) -> np.ndarray:
    """(cracked - healthy) / healthy of natural frequencies, mode by mode; negative where the crack lowers
    them.

    The modes must have been paired before, by their shapes where frequencies cross.
    """
    pair = [
        real_array("frequency_shift", name, given, max(len(getattr(given, "shape", ())), 1), "Hz")
        for name, given in (("cracked", cracked), ("healthy", healthy))
    ]
    if pair[0].shape != pair[1].shape:
        raise ValueError(
            f"frequency_shift: {pair[0].shape} cracked and {pair[1].shape} healthy frequencies were given; "
            "their shapes must agree"
        )
    for name, array in zip(("cracked", "healthy"), pair):
        if not (np.isfinite(array) & (array > 0.0)).all():
            raise ValueError(f"frequency_shift: {name} frequencies must be positive and finite, in Hz")
    return (pair[0] - pair[1]) / pair[1]


def detection_probability(values, noise: float, false_alarm: float = 0.01) -> np.ndarray:
    """Probability that a crack is seen in quantities that are zero without it and measured with noise.

    The sum of squares of the measured quantities is compared with the threshold that noise alone exceeds with
    the probability `false_alarm`. With normal noise it has a chi-square distribution, noncentral where there
    is a crack (Kay, Fundamentals of Statistical Signal Processing: Detection Theory, 1998, chapter 2).

    Parameters
    ----------
    values : (..., k) array
        Indicators in the last axis: relative frequency shifts, or complex amplitudes of lines of a spectrum
        (two quantities each, real and imaginary part).
    noise : float
        Standard deviation of each quantity, in the unit of the values.
    false_alarm : float
        Probability of an alarm without a crack, between 0 and 1.

    Returns
    -------
    (...) array
        Between `false_alarm` (values 0) and 1.

    Raises
    ------
    ValueError
        For values that are not finite or have no last axis, noise or a probability out of range.
    """
    owner = "detection_probability"
    try:
        array = np.asarray(values)
    except ValueError:  # rows of different lengths
        array = np.asarray(None)
    if array.dtype.kind not in "iufc":
        raise TypeError(f"{owner}: values = {shown(values)} must be an array of real or complex numbers")
    if array.ndim < 1 or array.shape[-1] < 1:
        raise ValueError(
            f"{owner}: values of shape {array.shape} were given; indicators stand in a last axis"
        )
    if not np.isfinite(array).all():
        raise ValueError(f"{owner}: values must be finite; leave out rows that failed")
    noise = positive(owner, "noise", noise)
    false_alarm = positive(owner, "false_alarm", false_alarm)
    if false_alarm >= 1.0:
        raise ValueError(f"{owner}: false_alarm = {false_alarm:g} must be between 0 and 1, for example 0.01")
    freedom = array.shape[-1] * (2 if array.dtype.kind == "c" else 1)
    energy = np.sum((np.abs(array) / noise) ** 2, axis=-1)
    threshold = chi2.isf(false_alarm, freedom)
    # beyond this the far tail of the distribution is no longer summed; the probability is 1 to round-off
    seen = ncx2.sf(threshold, freedom, np.minimum(energy, 1e4 + 4.0 * threshold))
    return np.where(energy > 0.0, np.clip(seen, false_alarm, 1.0), false_alarm)

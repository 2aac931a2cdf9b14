"""Signals: functions of time that drive forces, tractions or the motion of a support.

A signal is a frozen value: called with times (s) it gives values of the same shape, in the unit of what it
drives (N as a component of a force). Signals add with `+`, also with numbers, and are scaled with `*` and
`/`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from functools import cached_property
from numbers import Real
from typing import Any, ClassVar, cast

import numpy as np
from scipy.fft import rfft
from scipy.interpolate import CubicSpline

from .checks import choice, positive, real, real_array, shown
from .checks import path as checked_path

# Share of the oscillation's energy below `Samples.highest_frequency`.
ENERGY_SHARE = 0.9999
# Relative to a step: times that miss an end by less are at it, since k * dt is rounded.
ROUND_OFF = 1e-9


class Signal:
    """What all signals have in common.

    Attributes
    ----------
    highest_frequency : float or None
        Top of the band that matters, Hz; 0 for steps and constants; None if it is not known.
    end : float
        Time after which the signal keeps its value, s; inf if it never does.
    """

    _units: ClassVar[dict[str, str]] = {}
    # numpy leaves `number * signal` to the signal.
    __array_ufunc__ = None

    @property
    def highest_frequency(self) -> float | None:
        return 0.0

    @property
    def end(self) -> float:
        return math.inf

    def __call__(self, t) -> np.ndarray:
        """Values at the times `t` (s), of the same shape."""
        times = np.asarray(t)
        if times.dtype.kind not in "iuf":
            raise TypeError(f"{type(self).__name__}: t = {shown(t)} must be times, numbers in s")
        return self._values(times.astype(float))[()]

    def _values(self, t: np.ndarray) -> np.ndarray:
        raise NotImplementedError

    def _scaled(self, factor: float) -> Signal:
        signal: Any = self  # every signal has an amplitude, or scales itself
        return replace(signal, amplitude=factor * signal.amplitude)

    def __add__(self, other) -> Signal:
        return _total((self, as_signal(other)))

    def __radd__(self, other) -> Signal:
        return _total((as_signal(other), self))

    def __sub__(self, other) -> Signal:
        return self + -1.0 * as_signal(other)

    def __rsub__(self, other) -> Signal:
        return as_signal(other) + -1.0 * self

    def __neg__(self) -> Signal:
        return -1.0 * self

    def __mul__(self, factor: float) -> Signal:
        return self._scaled(real(type(self).__name__, "factor", factor))

    __rmul__ = __mul__

    def __truediv__(self, divisor: float) -> Signal:
        if real(type(self).__name__, "divisor", divisor) == 0.0:
            raise ValueError(f"{type(self).__name__}: divisor = {divisor!r} must not be zero")
        return self._scaled(1.0 / divisor)

    def __repr__(self) -> str:
        parts, signal = [], cast(Any, self)
        for field in fields(signal):
            value, unit = getattr(self, field.name), self._units.get(field.name, "")
            text = f"{value:.10g}" if isinstance(value, float) else repr(value)
            parts.append(f"{field.name}={text}{unit and ' ' + unit}")
        return f"{type(self).__name__}({', '.join(parts)})"

    def _check(self, **checks: Callable) -> None:
        """Replace the named fields by checked floats."""
        for name, check in checks.items():
            object.__setattr__(
                self, name, check(type(self).__name__, name, getattr(self, name), self._units.get(name, ""))
            )


def _not_negative(owner: str, name: str, value: Any, unit: str = "") -> float:
    return real(owner, name, value, unit, least=0.0)


@dataclass(frozen=True, repr=False)
class Constant(Signal):
    """`value` at all times."""

    value: float

    end = 0.0

    def __post_init__(self) -> None:
        self._check(value=real)

    def _values(self, t: np.ndarray) -> np.ndarray:
        return np.full(t.shape, self.value)

    def _scaled(self, factor: float) -> Constant:
        return Constant(factor * self.value)


@dataclass(frozen=True, repr=False)
class Harmonic(Signal):
    """amplitude * sin(2 pi frequency t + phase), at all times; frequency in Hz, phase in radian."""

    amplitude: float
    frequency: float
    phase: float = 0.0

    _units = {"frequency": "Hz", "phase": "rad"}

    def __post_init__(self) -> None:
        self._check(amplitude=real, frequency=positive, phase=real)

    @property
    def highest_frequency(self) -> float:
        return self.frequency

    def _values(self, t: np.ndarray) -> np.ndarray:
        return self.amplitude * np.sin(2.0 * np.pi * self.frequency * t + self.phase)


@dataclass(frozen=True, repr=False)
class ToneBurst(Signal):
    """Tone burst of eq. (39): F sin(2 pi fc t) (1 - cos(2 pi fc t / n)) for 0 <= t <= n / fc, zero elsewhere.

    F is `amplitude`, fc the carrier's `frequency` in Hz, n its `cycles` in the burst. The envelope peaks at 2
    F.
    """

    amplitude: float
    frequency: float
    cycles: float

    _units = {"frequency": "Hz"}

    def __post_init__(self) -> None:
        self._check(amplitude=real, frequency=positive, cycles=positive)

    @property
    def end(self) -> float:
        return self.cycles / self.frequency

    @property
    def highest_frequency(self) -> float:
        """Upper zero of the spectrum's main lobe, fc (1 + 2 / n), Hz."""
        return self.frequency * (1.0 + 2.0 / self.cycles)

    def _values(self, t: np.ndarray) -> np.ndarray:
        phase = 2.0 * np.pi * self.frequency * t
        return np.where(
            (t >= 0.0) & (t <= self.end),
            self.amplitude * np.sin(phase) * (1.0 - np.cos(phase / self.cycles)),
            0.0,
        )


@dataclass(frozen=True, repr=False)
class Chirp(Signal):
    """Sine whose frequency runs linearly from `start` to `stop` (Hz) for 0 <= t <= duration (s); zero
    elsewhere.

    A falling chirp is legal. `phase` (radian) is that at t = 0; over `taper` (s) it rises as half a cosine at
    its beginning and falls at its end.
    """

    amplitude: float
    start: float
    stop: float
    duration: float
    phase: float = 0.0
    taper: float = 0.0

    _units = {"start": "Hz", "stop": "Hz", "duration": "s", "phase": "rad", "taper": "s"}

    def __post_init__(self) -> None:
        self._check(
            amplitude=real,
            start=_not_negative,
            stop=_not_negative,
            duration=positive,
            phase=real,
            taper=_not_negative,
        )
        if self.start == self.stop == 0.0:
            raise ValueError(
                "Chirp: start = 0 Hz and stop = 0 Hz leave no oscillation; one of them must be positive"
            )
        if self.taper > 0.5 * self.duration:
            raise ValueError(
                f"Chirp: taper = {self.taper:g} s must be at most half the duration, {0.5 * self.duration:g} "
                "s"
            )

    @property
    def end(self) -> float:
        return self.duration

    @property
    def highest_frequency(self) -> float:
        return max(self.start, self.stop)

    def _values(self, t: np.ndarray) -> np.ndarray:
        cycles = (self.start + 0.5 * (self.stop - self.start) * t / self.duration) * t
        edge = np.minimum(t, self.duration - t)
        envelope = (edge >= 0.0) * _smooth(edge, self.taper)
        return self.amplitude * envelope * np.sin(2.0 * np.pi * cycles + self.phase)


def _smooth(t: np.ndarray, rise: float) -> np.ndarray:
    """Half a cosine from 0 at t = 0 to 1 at t = rise; 1 everywhere if rise is 0."""
    if rise == 0.0:
        return np.ones(t.shape)
    return 0.5 * (1.0 - np.cos(np.pi * np.clip(t / rise, 0.0, 1.0)))


@dataclass(frozen=True, repr=False)
class Step(Signal):
    """Zero before `time`, `amplitude` from then on; over `rise` (s) it grows as half a cosine."""

    amplitude: float
    time: float = 0.0
    rise: float = 0.0

    _units = {"time": "s", "rise": "s"}

    def __post_init__(self) -> None:
        self._check(amplitude=real, time=real, rise=_not_negative)

    @property
    def end(self) -> float:
        return self.time + self.rise

    def _values(self, t: np.ndarray) -> np.ndarray:
        return (
            self.amplitude
            * (t >= self.time - 1e-3 * ROUND_OFF * abs(self.time))
            * _smooth(t - self.time, self.rise)
        )


@dataclass(frozen=True, repr=False, eq=False)
class Samples(Signal):
    """Sampled data, interpolated between the samples and zero outside them.

    Parameters
    ----------
    time : (n,) array
        Rising times, s; the steps may differ.
    value : (n,) array
    interpolation : {"linear", "cubic"}
        Cubic is a spline with continuous curvature.
    """

    time: np.ndarray
    value: np.ndarray
    interpolation: str = "linear"

    def __post_init__(self) -> None:
        for name in ("time", "value"):
            object.__setattr__(self, name, _column(name, getattr(self, name)))
        if len(self.time) != len(self.value):
            raise ValueError(
                f"Samples: {len(self.time)} times and {len(self.value)} values were given; their numbers "
                "must agree"
            )
        if len(self.time) < 2:
            raise ValueError(f"Samples: the number of samples is {len(self.time)}; at least 2 are needed")
        if (bad := np.flatnonzero(np.diff(self.time) <= 0.0)).size:
            raise ValueError(
                f"Samples: time[{bad[0] + 1}] = {self.time[bad[0] + 1]:g} s follows {self.time[bad[0]]:g} s; "
                "times must rise"
            )
        choice("Samples", "interpolation", self.interpolation, ("linear", "cubic"))

    @classmethod
    def from_csv(
        cls, path, interpolation: str = "linear", time_scale: float = 1.0, value_scale: float = 1.0
    ) -> Samples:
        """Samples from a text file with two columns, time and value.

        Columns are parted by comma, semicolon, tab or blanks; lines that begin with # and empty lines at the
        end are left out, and the first line may be a header.

        Parameters
        ----------
        path : path-like
        interpolation : {"linear", "cubic"}
        time_scale, value_scale : float
            Factors on the columns, 1e-3 for a file in ms.

        Raises
        ------
        ValueError
            With one sentence that names the file and the line: missing or unreadable file, gap, text, number
            that is not finite, time that does not rise.
        """
        scales = (
            positive("Samples", "time_scale", time_scale, "s per unit of the file"),
            real("Samples", "value_scale", value_scale),
        )
        time, value = (_read_csv(path) * scales).T
        return cls(time, value, interpolation)

    @property
    def end(self) -> float:
        return float(self.time[-1])

    @cached_property
    def highest_frequency(self) -> float:
        """Frequency below which 99.99 % of the oscillation's energy lies, Hz, and at most half the sampling
        rate.
        """
        count = int(np.clip(round((self.time[-1] - self.time[0]) / np.diff(self.time).min()), 2, 2**20))
        t, step = np.linspace(self.time[0], self.time[-1], count, endpoint=False, retstep=True)
        # Without the line between the ends: their difference would pass for a jump and fill the spectrum.
        line = self.value[0] + (self.value[-1] - self.value[0]) * (t - t[0]) / (self.time[-1] - self.time[0])
        energy = np.cumsum(np.abs(rfft(self(t) - line)[1:]) ** 2)
        if not energy[-1] > (1e-14 * np.abs(self.value).max() * count) ** 2:
            return 0.0
        return float((1 + np.searchsorted(energy, ENERGY_SHARE * energy[-1])) / (count * step))

    @cached_property
    def _spline(self) -> CubicSpline:
        return CubicSpline(self.time, self.value)

    def _values(self, t: np.ndarray) -> np.ndarray:
        slack = ROUND_OFF * (self.time[-1] - self.time[0]) / (len(self.time) - 1)
        inside = (t >= self.time[0] - slack) & (t <= self.time[-1] + slack)
        at = np.clip(t, self.time[0], self.time[-1])
        return np.where(
            inside,
            np.interp(at, self.time, self.value) if self.interpolation == "linear" else self._spline(at),
            0.0,
        )

    def _scaled(self, factor: float) -> Samples:
        return replace(self, value=factor * self.value)

    def _key(self) -> tuple:
        return self.time.tobytes(), self.value.tobytes(), self.interpolation

    def __eq__(self, other) -> bool:
        return self._key() == other._key() if isinstance(other, Samples) else NotImplemented

    def __hash__(self) -> int:
        return hash(self._key())

    def __repr__(self) -> str:
        return (
            f"Samples({len(self.time)} samples from {self.time[0]:.6g} s to {self.time[-1]:.6g} s, values "
            f"from {self.value.min():.6g} to {self.value.max():.6g}, {self.interpolation})"
        )


def _column(name: str, values: Any) -> np.ndarray:
    """A checked copy that cannot be written."""
    column = real_array("Samples", name, values, 1)
    column.flags.writeable = False
    return column


def _read_csv(path) -> np.ndarray:
    """(n, 2) numbers of a file."""
    path = checked_path("Samples.from_csv", "path", path)
    try:
        with open(path, encoding="utf-8-sig") as file:
            lines = file.read().rstrip().splitlines()
    except OSError as error:
        raise ValueError(f"{path}: cannot be read: {error.strerror or error}") from None
    except UnicodeDecodeError:
        raise ValueError(
            f"{path}: is no text file; two columns of numbers, time and value, are expected"
        ) from None
    content = [
        (f"{path}, line {number}", line)
        for number, line in enumerate(lines, 1)
        if not line.lstrip().startswith("#")
    ]
    rows: list[list[float]] = []
    for index, (where, line) in enumerate(content):
        entries = _entries(line)
        if index == 0 and any(entries) and all(_as_number(entry) is None for entry in entries):
            continue  # the header
        rows.append(_row(where, entries))
        if len(rows) > 1 and not rows[-1][0] > rows[-2][0]:
            raise ValueError(f"{where}: time {rows[-1][0]:g} follows {rows[-2][0]:g}; times must rise")
    if len(rows) < 2:
        raise ValueError(
            f"{path}, line {max(len(lines), 1)}: the number of samples is {len(rows)} where the file ends; "
            "at least 2 are needed"
        )
    return np.array(rows)


def _entries(line: str) -> list[str]:
    separator = next((mark for mark in ";\t," if mark in line), None)
    return [entry.strip(" \t\"'") for entry in line.split(separator)]


def _row(where: str, entries: list[str]) -> list[float]:
    """Time and value of a line."""
    numbers: list[float] = []
    for entry in entries[:2]:
        number = _as_number(entry)
        if not entry:
            raise ValueError(f"{where}: a number is missing; a time and a value are expected")
        if number is None:
            raise ValueError(f"{where}: {entry!r} is not a number")
        if not math.isfinite(number):
            raise ValueError(f"{where}: {entry!r} is not finite")
        numbers.append(number)
    if len(entries) != 2:
        raise ValueError(
            f"{where}: the number of columns is {len(entries)}; two, time and value, are expected"
            if any(entries)
            else f"{where}: the line is empty; a time and a value are expected"
        )
    return numbers


def _as_number(text: str) -> float | None:
    try:
        return float(text)
    except ValueError:
        return None


@dataclass(frozen=True, repr=False)
class Custom(Signal):
    """amplitude * function(t), for a function that takes an (n,) array of times (s) and returns one finite
    number for each.

    `highest_frequency` is the top of the band that matters, Hz, or None if it is not known. The function is
    tried at two times here and checked whenever it is called.
    """

    function: Callable[[np.ndarray], np.ndarray]
    highest_frequency: float | None = None
    amplitude: float = 1.0

    _units = {"highest_frequency": "Hz"}

    def __post_init__(self) -> None:
        if not callable(self.function):
            raise TypeError(
                f"Custom: function = {shown(self.function)} cannot be called; a function of an array of "
                "times is "
                "expected"
            )
        self._check(amplitude=real)
        if self.highest_frequency is not None:
            self._check(highest_frequency=_not_negative)
        self._values(np.array([0.0, 1e-6]))

    @property
    def _name(self) -> str:
        return getattr(self.function, "__name__", None) or type(self.function).__name__

    def _values(self, t: np.ndarray) -> np.ndarray:
        times = t.ravel()
        try:
            result = np.asarray(self.function(times))
        except Exception as error:
            reason = " ".join(f"{type(error).__name__}: {error}".split())
            raise ValueError(
                f"Custom: {self._name} failed for an array of {times.size} times ({reason}); it must take an "
                f"array, as numpy.vectorize({self._name}) does"
            ) from error
        if result.dtype.kind not in "iuf":
            raise TypeError(
                f"Custom: {self._name} returned values of type {result.dtype}; real numbers are expected"
            )
        if result.shape != times.shape:
            raise ValueError(
                f"Custom: {self._name} returned the shape {result.shape} for {times.size} times; one number "
                "for each is expected"
            )
        if (bad := np.flatnonzero(~np.isfinite(result))).size:
            raise ValueError(
                f"Custom: {self._name} returned {result[bad[0]]} at t = {times[bad[0]]:g} s; finite numbers "
                "are expected"
            )
        return self.amplitude * result.reshape(t.shape)

    def __repr__(self) -> str:
        band = "unknown" if self.highest_frequency is None else f"{self.highest_frequency:.10g} Hz"
        return f"Custom({self._name}, highest_frequency={band}, amplitude={self.amplitude:.10g})"


@dataclass(frozen=True, repr=False)
class Sum(Signal):
    """Several signals acting together; made by adding signals."""

    parts: tuple[Signal, ...]

    def __post_init__(self) -> None:
        parts = tuple(as_signal(part) for part in self.parts)
        if not parts:
            raise ValueError("Sum: no signals were given; at least one is expected")
        object.__setattr__(self, "parts", parts)

    @property
    def end(self) -> float:
        return max(part.end for part in self.parts)

    @property
    def highest_frequency(self) -> float | None:
        """The highest one of the parts, Hz; None if one is not known."""
        bands = [part.highest_frequency for part in self.parts]
        known = [band for band in bands if band is not None]
        return max(known) if len(known) == len(bands) else None

    def _values(self, t: np.ndarray) -> np.ndarray:
        return np.sum([part._values(t) for part in self.parts], axis=0)

    def _scaled(self, factor: float) -> Sum:
        return Sum(tuple(part._scaled(factor) for part in self.parts))

    def __repr__(self) -> str:
        return " + ".join(map(repr, self.parts))


def _total(signals: tuple[Signal, ...]) -> Signal:
    """The sum, flat, with at most one constant and none that is zero."""
    parts = [part for signal in signals for part in (signal.parts if isinstance(signal, Sum) else (signal,))]
    constant = sum(part.value for part in parts if isinstance(part, Constant))
    parts = [part for part in parts if not isinstance(part, Constant)]
    if constant != 0.0 or not parts:
        parts.insert(0, Constant(constant))
    return parts[0] if len(parts) == 1 else Sum(tuple(parts))


def as_signal(value) -> Signal:
    """A number as a `Constant`, a function of time as a `Custom` of unknown band, a signal as it is; else a
    TypeError.
    """
    if isinstance(value, Signal):
        return value
    if isinstance(value, Real) and not isinstance(value, (bool, np.bool_)):
        return Constant(float(value))
    if callable(value) and not isinstance(value, type):
        return Custom(value)
    raise TypeError(f"signal {shown(value)} is neither a number nor a signal nor a function of time")

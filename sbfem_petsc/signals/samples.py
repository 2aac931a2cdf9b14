"""Sampled signals, and their text files."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.fft import rfft

from meshing.whole_file import require_regular

from ..checks import choice, positive, real, real_array
from ..checks import path as checked_path
from .signal import ROUND_OFF, STEPS_A_PERIOD, Signal

if TYPE_CHECKING:
    from scipy.interpolate import CubicSpline

# Share of the oscillation's energy below `Samples.highest_frequency`.
ENERGY_SHARE = 0.9999
# What a corner within a step of the default length may do to the value, as a share of the largest one, before
# a step has to end at it.
CORNER = 0.01
# Lines between samples nearer to each other than this share of their mean distance are jumps as far as bands
# go: steps end at both of their ends, and a line is exact in a step of any length.
STEEP = 1e-3
# Farthest time (s) and largest value, whose squares a spectrum still holds.
LATEST, LARGEST = 1e15, 1e140


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
        for name, most, unit in (("time", LATEST, "s"), ("value", LARGEST, "")):
            far = float(np.abs(getattr(self, name)).max())
            if far > most:
                raise ValueError(f"Samples: {name} reaches {far:g} {unit}; at most {most:g} is expected")
        if (span := float(self.time[-1] - self.time[0])) < 1.0 / LATEST:
            raise ValueError(f"Samples: the times span {span:g} s; at least {1.0 / LATEST:g} s is expected")
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
        rate; without lines so steep that they are jumps.
        """
        rest = replace(self, value=self.value - np.cumsum(np.append(0.0, self._steep * np.diff(self.value))))
        nearest = np.diff(self.time)[~self._steep].min()
        count = int(np.clip(round((self.time[-1] - self.time[0]) / nearest), 2, 2**20))
        t, step = np.linspace(self.time[0], self.time[-1], count, endpoint=False, retstep=True)
        # Without the line between the ends: their difference would pass for a jump and fill the spectrum.
        line = rest.value[0] + (rest.value[-1] - rest.value[0]) * (t - t[0]) / (self.time[-1] - self.time[0])
        energy = np.cumsum(np.abs(rfft(rest(t) - line)[1:]) ** 2)
        if not energy[-1] > (1e-14 * np.abs(self.value).max() * count) ** 2:
            return 0.0
        return float((1 + np.searchsorted(energy, ENERGY_SHARE * energy[-1])) / (count * step))

    @cached_property
    def _steep(self) -> np.ndarray:
        """(n - 1,): which lines between samples are as good as jumps."""
        apart = np.diff(self.time)
        return (apart < STEEP * apart.mean()) & (self.interpolation == "linear")

    def _leaps(self, duration: float) -> bool:
        """Whether the value jumps in 0 <= t < duration, lines as good as jumps included."""
        begin = self.time[:-1][self._steep & (np.diff(self.value) != 0.0)]
        return super()._leaps(duration) or bool(((begin >= 0.0) & (begin < duration)).any())

    @cached_property
    def _spline(self) -> CubicSpline:
        from scipy.interpolate import CubicSpline  # slow to load, for all analyses that know signals

        return CubicSpline(self.time, self.value)

    @cached_property
    def breaks(self) -> tuple[float, ...]:
        """The ends if the values there are not zero, and corners of steep lines."""
        sharp = np.zeros(len(self.time), dtype=bool)
        if self.interpolation == "linear" and self.highest_frequency > 0.0:
            turns = np.abs(np.diff(np.diff(self.value) / np.diff(self.time)))
            step = 1.0 / (STEPS_A_PERIOD * self.highest_frequency)
            sharp[1:-1] = 0.125 * turns * step > CORNER * np.abs(self.value).max()
        sharp[:-1] |= self._steep
        sharp[1:] |= self._steep
        sharp[[0, -1]] = self.value[[0, -1]] != 0.0
        return tuple(self.time[sharp].tolist())

    def _values(self, t: np.ndarray, side: int = 0) -> np.ndarray:
        slack = ROUND_OFF * (self.time[-1] - self.time[0]) / (len(self.time) - 1)
        begin = t >= self.time[0] - slack if side >= 0 else t > self.time[0] + slack
        inside = begin & (t <= self.time[-1] + slack if side <= 0 else t < self.time[-1] - slack)
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
        require_regular(path)
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

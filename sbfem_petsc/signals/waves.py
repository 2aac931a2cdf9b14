"""Signals of a formula: tones, bursts, chirps, steps."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ..checks import positive, real
from .signal import JUST, Signal, not_negative


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

    def _values(self, t: np.ndarray, side: int = 0) -> np.ndarray:
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

    def _values(self, t: np.ndarray, side: int = 0) -> np.ndarray:
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
    phase: float = field(default=0.0, kw_only=True)
    taper: float = field(default=0.0, kw_only=True)

    _units = {"start": "Hz", "stop": "Hz", "duration": "s", "phase": "rad", "taper": "s"}

    def __post_init__(self) -> None:
        self._check(
            amplitude=real,
            start=not_negative,
            stop=not_negative,
            duration=positive,
            phase=real,
            taper=not_negative,
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

    @property
    def breaks(self) -> tuple[float, ...]:
        return () if self.taper else (0.0, self.duration)

    def _values(self, t: np.ndarray, side: int = 0) -> np.ndarray:
        cycles = (self.start + 0.5 * (self.stop - self.start) * t / self.duration) * t
        edge = np.minimum(t, self.duration - t)
        inside = _from(t, 0.0, side) & ~_from(t, self.duration, 1 if side > 0 else -1)
        envelope = inside * _smooth(edge, self.taper)
        return self.amplitude * envelope * np.sin(2.0 * np.pi * cycles + self.phase)


def _from(t: np.ndarray, begin: float, side: int) -> np.ndarray:
    """Whether times are at `begin` or later; at it only for a side that is not negative."""
    return t >= begin - JUST * abs(begin) if side >= 0 else t > begin + JUST * abs(begin)


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
        self._check(amplitude=real, time=real, rise=not_negative)

    @property
    def end(self) -> float:
        return self.time + self.rise

    @property
    def highest_frequency(self) -> float:
        """That of the half cosine, 1 / (2 rise), Hz; 0 for a jump, which has no highest one."""
        return 0.5 / self.rise if self.rise else 0.0

    @property
    def breaks(self) -> tuple[float, ...]:
        return () if self.rise else (self.time,)

    def _values(self, t: np.ndarray, side: int = 0) -> np.ndarray:
        return self.amplitude * _from(t, self.time, side) * _smooth(t - self.time, self.rise)

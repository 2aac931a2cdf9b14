"""Signals of a formula: tones, bursts, chirps, steps."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ..checks import said
from .signal import JUST, Signal

_AMPLITUDE = said("amplitude, in the unit of the component")


@dataclass(frozen=True, repr=False)
class Harmonic(Signal):
    """amplitude * sin(2 pi frequency t + phase), at all times; frequency in Hz, phase in radian."""

    amplitude: float = field(metadata=_AMPLITUDE)
    frequency: float = field(metadata=said("frequency", "Hz", gt=0))
    phase: float = field(default=0.0, metadata=said("phase", "rad"))

    @property
    def highest_frequency(self) -> float:
        return self.frequency

    def _values(self, t: np.ndarray, side: int = 0) -> np.ndarray:
        return self.amplitude * np.sin(2.0 * np.pi * self.frequency * t + self.phase)


@dataclass(frozen=True, repr=False)
class ToneBurst(Signal):
    """amplitude * sin(2 pi frequency t) * (1 - cos(2 pi frequency t / cycles)) from 0 to cycles / frequency,
    zero elsewhere: the tone burst of eq. (39), whose envelope peaks at 2 * amplitude.
    """

    amplitude: float = field(metadata=said("half the peak, in the unit of the component"))
    frequency: float = field(metadata=said("carrier frequency", "Hz", gt=0))
    cycles: float = field(metadata=said("cycles in the burst", gt=0))

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

    amplitude: float = field(metadata=_AMPLITUDE)
    start: float = field(metadata=said("first frequency", "Hz", ge=0))
    stop: float = field(metadata=said("last frequency", "Hz", ge=0))
    duration: float = field(metadata=said("duration", "s", gt=0))
    phase: float = field(default=0.0, kw_only=True, metadata=said("phase at the start", "rad"))
    taper: float = field(default=0.0, kw_only=True, metadata=said("time of rise and of fall", "s", ge=0))

    def __post_init__(self) -> None:
        super().__post_init__()
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

    amplitude: float = field(metadata=said("value after the step, in the unit of the component"))
    time: float = field(default=0.0, metadata=said("instant of the step", "s"))
    rise: float = field(default=0.0, metadata=said("time of the rise", "s", ge=0))

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

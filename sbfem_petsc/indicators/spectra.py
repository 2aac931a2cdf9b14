"""Amplitude spectra of records."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.fft import rfft, rfftfreq

from ..checks import choice, shown
from .record import COHERENT, checked_record, checked_tones, off


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
        tone = checked_tones("Spectrum", frequency, self.step)[0]
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
    time, values, window: str | tuple | None = None, detrend: str | None = None, *, frequencies=None
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
    t, u, step = checked_record("spectrum", time, values)
    if detrend is not None:
        from scipy.signal import detrend as remove_trend  # slow to load, for all that know public names

        u = remove_trend(u, type=choice("spectrum", "detrend", detrend, ("constant", "linear")))
    if window is not None and not isinstance(window, (str, tuple)):
        raise TypeError(f"spectrum: window = {shown(window)} must be None, a name such as 'hann', or a tuple")
    weights = np.ones(len(u))
    if window is not None:
        from scipy.signal import get_window

        try:
            weights = get_window(window, len(u))
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
        coherent = bool((off(len(u) * step * checked_tones("spectrum", frequencies, step)) <= COHERENT).all())
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

"""Loads of two tones, split by the tone that they are multiples of."""

from __future__ import annotations

import numbers
from collections.abc import Sequence

from ..signals.signal import Constant, Signal, as_signal
from ..signals.waves import Harmonic
from .excitation import Excitation, by_formula, parts_of

# Multiples of a tone that a load may have, and the relative distance from one that rounding explains.
MULTIPLES, SAME = 16, 1e-9


def tone(value: object) -> Signal:
    """A load's value as a signal; TypeError for a number, which belongs to neither tone."""
    if isinstance(value, numbers.Real) and value == 0:
        return Constant(0.0)
    if isinstance(value, numbers.Real):
        raise TypeError(
            f"quasi_periodic: load {value!r} does not say to which tone it belongs; give Harmonic({value!r}, "
            "frequency), or a Constant for a preload"
        )
    return as_signal(value)


def drives(signals: Sequence[Signal], frequencies: tuple[float, float]) -> tuple[Excitation, Excitation]:
    """Loads at multiples of the faster tone, constants included, and of the slower one.

    Parameters
    ----------
    signals : sequence of Signal
    frequencies : (float, float)
        Of the faster tone and of the slower one, Hz.

    Raises
    ------
    ValueError
        If a signal belongs to neither tone, or a tone has no load.
    """
    parts: tuple[list[list[Signal]], ...] = tuple([[] for _ in signals] for _ in frequencies)
    for k, signal in enumerate(signals):
        for part in parts_of(signal):
            if not isinstance(part, (Constant, Harmonic)):
                raise ValueError(
                    f"quasi_periodic: the signal {part!r} is neither a Harmonic nor a Constant; two tones "
                    "are given as Harmonic signals"
                )
            tone = _belongs(part, frequencies) if isinstance(part, Harmonic) else 0
            parts[tone][k].append(part)
    first, second = (
        Excitation(*by_formula(loads, frequency, 1), 1) for loads, frequency in zip(parts, frequencies)
    )
    for drive, frequency in zip((first, second), frequencies):
        if not drive.oscillating.amplitudes.any():
            raise ValueError(
                f"quasi_periodic: no load oscillates at {frequency:g} Hz; give Harmonic(amplitude, "
                f"{frequency:g}), or use periodic for one tone"
            )
    return first, second


def _belongs(part: Harmonic, frequencies: tuple[float, float]) -> int:
    """Which tone a harmonic is a multiple of, the lowest multiple first."""
    for order in range(1, MULTIPLES + 1):
        for tone, frequency in enumerate(frequencies):
            if abs(part.frequency - order * frequency) <= SAME * part.frequency:
                return tone
    raise ValueError(
        f"quasi_periodic: {part!r} belongs to neither tone; its frequency must be {frequencies[0]:.12g} Hz "
        f"or {frequencies[1]:.12g} Hz or a multiple of one of them, up to {MULTIPLES} times"
    )


def highest(drives: tuple[Excitation, Excitation], frequencies: tuple[float, float]) -> float:
    """The highest frequency of both, Hz."""
    return max(float(drive.orders.max(initial=0)) * f for drive, f in zip(drives, frequencies))

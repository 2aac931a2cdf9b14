"""Damping of modes as it is measured: one ratio, ratios of each mode or by frequency, Rayleigh's factors."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .checks import Bounds, numbers_of, positive, real, shown

RATIO = Bounds(least=0.0, below=1.0)


@dataclass(frozen=True)
class DampingTable:
    """Modal damping ratios by frequency: on straight lines between the given ones, constant beyond them.

    Parameters
    ----------
    points : sequence of (float, float)
        Frequencies (Hz), ascending, and damping ratios there. A mode has the ratio at its own frequency,
        without damping and contact.

    Raises
    ------
    ValueError, TypeError
        One sentence that names the point and what was expected.
    """

    points: tuple[tuple[float, float], ...]

    def __post_init__(self) -> None:
        pairs = "pairs of a frequency in Hz and a damping ratio, [(50.0, 0.01), (400.0, 0.02)]"
        if not isinstance(self.points, (list, tuple, np.ndarray)) or getattr(self.points, "ndim", 2) != 2:
            raise TypeError(f"DampingTable: points = {shown(self.points)} must be {pairs}")
        if not len(self.points):
            raise ValueError(f"DampingTable: points is empty; give {pairs}")
        points: list[tuple[float, float]] = []
        for k, point in enumerate(self.points):
            name = f"points[{k}]"
            frequency, ratio = numbers_of("DampingTable", name, point, 2, "a frequency in Hz and a ratio")
            real("DampingTable", f"{name}[0]", frequency, "Hz", within=Bounds(least=0.0))
            real("DampingTable", f"{name}[1]", ratio, within=RATIO)
            if points and frequency <= points[-1][0]:
                raise ValueError(
                    f"DampingTable: {name} is at {frequency:g} Hz, not above the {points[-1][0]:g} Hz before "
                    "it; give ascending frequencies"
                )
            points.append((frequency, ratio))
        object.__setattr__(self, "points", tuple(points))


# As a user gives it, checked: of all modes, of each mode, by frequency. None at all is 0.0.
ModalDamping = float | tuple[float, ...] | DampingTable


def checked_damping(owner: str, value: object) -> ModalDamping:
    """Modal damping of a call; TypeError or ValueError for what is none."""
    if isinstance(value, DampingTable):
        return value if any(ratio for _, ratio in value.points) else 0.0
    if isinstance(value, (list, tuple, np.ndarray)) and getattr(value, "ndim", 1) == 1:
        if not len(value):
            raise ValueError(f"{owner}: damping is empty; give a ratio for one mode at least")
        ratios = tuple(real(owner, f"damping[{k}]", item, within=RATIO) for k, item in enumerate(value))
        return ratios if any(ratios) else 0.0
    if isinstance(value, (list, tuple, np.ndarray, str)) or not hasattr(value, "__float__"):
        raise TypeError(
            f"{owner}: damping = {shown(value)} must be a ratio, ratios of the lowest modes or a DampingTable"
        )
    return real(owner, "damping", value, within=RATIO)


def modal_ratios(damping: ModalDamping, omega: np.ndarray) -> np.ndarray:
    """Ratios of modes with ascending angular frequencies (rad/s).

    Ratios of each mode are those of the lowest modes that vibrate; the last one holds for all further modes.
    """
    if isinstance(damping, DampingTable):
        return np.interp(omega / (2.0 * np.pi), *np.array(damping.points).T)
    if isinstance(damping, tuple):
        order = np.cumsum(omega > 0.0) - 1  # rigid-body motions are not counted
        return np.array(damping)[np.clip(order, 0, len(damping) - 1)]
    return np.full(len(omega), damping)


def ratios_by_frequency(damping: ModalDamping) -> np.ndarray:
    """(k, 2): frequencies (Hz), nan unless ratios are by frequency, and ratios, as they were given."""
    if isinstance(damping, DampingTable):
        return np.array(damping.points)
    ratios = np.atleast_1d(np.array(damping, dtype=float))
    return np.stack([np.full(len(ratios), np.nan), ratios], axis=1)


def rayleigh_ratios(factors: tuple[float, float], omega: np.ndarray) -> np.ndarray:
    """a / (2 omega) + b omega / 2, the ratios of a M + b K; of rigid-body motions 0."""
    a, b = factors
    reciprocal = np.divide(a, omega, out=np.zeros(len(omega)), where=omega > 0.0)
    return 0.5 * (reciprocal + b * omega)


def checked_rayleigh(owner: str, value: object) -> tuple[float, float]:
    """a and b of a call; TypeError or ValueError for what is none."""
    what = "two numbers, a in 1/s and b in s of a M + b K"
    a, b = numbers_of(owner, "rayleigh", value, 2, what, within=Bounds(least=0.0))
    return a, b


def rayleigh_factors(low: float, low_ratio: float, high: float, high_ratio: float) -> tuple[float, float]:
    """a (1/s) and b (s) of a damping matrix a M + b K from the ratios of two modes.

    Between the two frequencies the ratio is smaller than on the straight line between them, above the higher
    one it grows with the frequency if b > 0, below the lower one with its inverse if a > 0.

    Parameters
    ----------
    low, high : float
        Two frequencies, Hz.
    low_ratio, high_ratio : float
        Damping ratios there. One may be up to high / low times the other: beyond, a or b would be negative
        and feed energy into other modes.

    Raises
    ------
    ValueError, TypeError
        One sentence that names the value and what was expected.
    """
    low = positive("rayleigh_factors", "low", low, "Hz")
    high = positive("rayleigh_factors", "high", high, "Hz")
    low_ratio = real("rayleigh_factors", "low_ratio", low_ratio, within=RATIO)
    high_ratio = real("rayleigh_factors", "high_ratio", high_ratio, within=RATIO)
    if low >= high:
        raise ValueError(f"rayleigh_factors: low = {low:g} Hz must be below high = {high:g} Hz")
    mass, stiffness = low_ratio * high - high_ratio * low, high_ratio * high - low_ratio * low
    if min(mass, stiffness) < -1e-12 * high * max(low_ratio, high_ratio):  # beyond round-off
        raise ValueError(
            f"rayleigh_factors: high_ratio = {high_ratio:g} must be from {low_ratio * low / high:.6g} to "
            f"{low_ratio * high / low:.6g}, or a M + b K feeds energy into other modes; give the measured "
            "ratios as damping=DampingTable(...)"
        )
    spread = (high - low) * (high + low)
    mass, stiffness = max(mass, 0.0), max(stiffness, 0.0)
    return 4.0 * math.pi * low * high * mass / spread, stiffness / (math.pi * spread)


def in_words(damping: ModalDamping, rayleigh: Sequence[float]) -> str:
    """Of a model, for its repr."""
    if isinstance(damping, DampingTable):
        low, high = damping.points[0], damping.points[-1]
        text = f"damping ratios from {low[1]:g} at {low[0]:g} Hz to {high[1]:g} at {high[0]:g} Hz"
    elif isinstance(damping, tuple):
        text = f"damping ratios {', '.join(f'{ratio:g}' for ratio in damping[:4])}"
        text += ", ..." if len(damping) > 4 else ""
    else:
        text = f"damping ratio {damping:g}"
    if not any(rayleigh):
        return text
    return f"{text}, Rayleigh damping {rayleigh[0]:g} 1/s M + {rayleigh[1]:g} s K"

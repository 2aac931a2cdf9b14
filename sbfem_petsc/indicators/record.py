"""Records with a uniform time step, the tones in them, and the part that holds whole periods."""

from __future__ import annotations

import math
from fractions import Fraction

import numpy as np

from ..checks import real_array, refuse_masked, shown

# A record is coherent with a tone if it holds whole periods of it to this fraction of a period.
COHERENT = 1e-6
# Steps are uniform if no time is further from its place than this fraction of a step.
UNIFORM = 1e-6


def checked_record(owner: str, time, values, columns: bool = False) -> tuple[np.ndarray, np.ndarray, float]:
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


def checked_tones(owner: str, frequencies, step: float, zero: bool = False) -> np.ndarray:
    """Checked frequencies below half the sampling rate."""
    one = not isinstance(frequencies, (list, tuple, np.ndarray))
    tones = real_array(owner, "frequencies", frequencies, 0 if one else 1, "Hz").reshape(-1)
    if not tones.size:
        raise ValueError(
            f"{owner}: frequencies = {shown(frequencies)} must be a number or a sequence of numbers, in Hz"
        )
    for tone in tones:
        if not (tone > 0.0 or zero and tone == 0.0):
            raise ValueError(
                f"{owner}: frequency {tone:g} Hz must be {'zero or ' if zero else ''}positive and finite"
            )
        if not tone * step < 0.5:
            raise ValueError(
                f"{owner}: frequency {tone:.10g} Hz is not below half the sampling rate, {0.5 / step:.10g} "
                "Hz; a smaller step is needed"
            )
    return tones


def numbers(owner: str, name: str, value, wanted: str) -> np.ndarray:
    """An array of real or complex numbers; a TypeError that names what is `wanted` otherwise."""
    refuse_masked(owner, name, value)
    try:
        array = np.asarray(value)
    except ValueError:  # rows of different lengths
        array = np.asarray(None)
    if array.dtype.kind not in "iufc":
        raise TypeError(f"{owner}: {name} = {shown(value)} must be {wanted}")
    return array


def off(cycles: np.ndarray) -> np.ndarray:
    """How far numbers of cycles are from whole ones."""
    return np.abs(cycles - np.round(cycles))


def coherent_length(samples: int, step: float, tones: np.ndarray) -> int:
    """Most samples, up to `samples`, that hold whole periods of all tones; 0 if no number does."""
    lengths = np.arange(samples, 0, -1)
    for tone in np.sort(tones)[::-1]:
        cycles = lengths * step * tone
        lengths = lengths[(off(cycles) <= COHERENT) & (cycles > 0.5)]
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
    t, u, step = checked_record("coherent_record", time, values, columns=True)
    tones = checked_tones("coherent_record", frequencies, step)
    if length := coherent_length(len(t), step, tones):
        return t[-length:], u[-length:]
    if len(t) * step * tones.min() < 1.0 - COHERENT:
        raise ValueError(
            f"coherent_record: the record of {len(t) * step:g} s is shorter than one period of "
            f"{tones.min():.9g} Hz, {1.0 / tones.min():g} s"
        )
    lengths = np.arange(len(t) // 2, len(t) + 1)
    nearest = int(lengths[np.argmin(np.max([off(lengths * step * tone) for tone in tones], axis=0))])
    fitting = np.maximum(np.round(nearest * step * tones), 1.0) / (nearest * step)
    text = (
        f"coherent_record: no trailing part of the {len(t)} samples (step {step:g} s, {len(t) * step:g} s in "
        f"all) holds whole periods of {_listed(tones)}; the nearest, {nearest} samples, would for "
        f"{_listed(fitting)}"
    )
    needed = math.lcm(*(Fraction(tone * step).limit_denominator(10**7).denominator for tone in tones))
    if len(t) < needed <= 10**8 and off(needed * step * tones).max() <= COHERENT:
        text += f", and {needed} samples ({needed * step:g} s) for the given ones"
    raise ValueError(text)


def _listed(tones: np.ndarray) -> str:
    names = [f"{tone:.9g} Hz" for tone in tones]
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"

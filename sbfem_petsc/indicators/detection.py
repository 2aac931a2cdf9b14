"""Contact over time, and what tells a cracked structure from a healthy one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..checks import positive, real, real_array
from .record import checked_record, numbers


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
    _, force, _ = checked_record("contact_duty", time, contact_force, columns=True)
    if force.ndim > 2 or force.size == 0:
        raise ValueError(
            f"contact_duty: contact_force has the shape {force.shape}; (times,) or (times, pairs) is expected"
        )
    threshold = real("contact_duty", "threshold", threshold, "N")
    touching = force.reshape(len(force), -1) > threshold
    return ContactDuty(
        touching.mean(axis=0), float(touching.any(axis=1).mean()), float(touching.all(axis=1).mean())
    )


def friction_power(time, slip, friction_force, slid=None) -> np.ndarray:
    """(pairs,): mean power lost to friction over the time, W, of each pair.

    `slip` (m) and `friction_force` (N) are (n, pairs), as histories, periods and states over time have them;
    friction changes linearly from a time to the next. `slid` (m), of the same shape, is how far each pair has
    slid since the time before, as states of a `load_history` know it; default: the change of its slip, which
    for a pair that lands in between counts what it did before. Its sum is that of the pairs alone, without
    the faces inside tip elements.
    """
    at = real_array("friction_power", "time", time, 1, "s")
    slip = real_array("friction_power", "slip", slip, 2, "m")
    force = np.abs(real_array("friction_power", "friction_force", friction_force, 2, "N"))
    ways = np.abs(np.diff(slip, axis=0, prepend=slip[:1]))
    if slid is not None:
        ways = real_array("friction_power", "slid", slid, 2, "m")
    if slip.shape != force.shape or len(slip) != len(at) or ways.shape != slip.shape:
        given = f" and slid of shape {ways.shape}" if slid is not None else ""
        raise ValueError(
            f"friction_power: {len(at)} times, slip of shape {slip.shape}, friction_force of shape "
            f"{force.shape}{given} were given; (times, pairs) are expected of each"
        )
    if len(at) < 2 or not at[-1] > at[0]:
        raise ValueError("friction_power: time does not rise from its first value to its last")
    lost = 0.5 * (force[1:] + force[:-1]) * ways[1:]
    return lost.sum(axis=0) / float(at[-1] - at[0])


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
        if not (array > 0.0).all():
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
    array = numbers(owner, "values", values, "an array of real or complex numbers")
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
    with np.errstate(over="ignore"):  # as large as numbers go is seen
        energy = np.sum((np.abs(array) / noise) ** 2, axis=-1)
    from scipy.stats import chi2, ncx2  # slow to load, for all that know cases

    threshold = chi2.isf(false_alarm, freedom)
    # beyond this the far tail of the distribution is no longer summed; the probability is 1 to round-off
    seen = ncx2.sf(threshold, freedom, np.minimum(energy, 1e4 + 4.0 * threshold))
    return np.where(energy > 0.0, np.clip(seen, false_alarm, 1.0), false_alarm)

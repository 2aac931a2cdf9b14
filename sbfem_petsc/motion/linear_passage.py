"""Passage through a linear resonance: how fast its amplitude changes at most.

With s the time in settling times 1 / delta (delta = zeta omega), counted from resonance, and R = r / delta^2
the rate r (rad/s^2) in those units, the complex amplitude of a mode under a force of one size and swept
frequency obeys, where damping and detuning are small beside omega,

    y' = -(1 + i R s) y + 1,    y(s) = sqrt(pi / (2 R)) w(i z) exp(i c),
    z = (1 + i R s) exp(i pi / 4) / sqrt(2 R)

with a constant phase c and the Faddeeva function w(iz) = exp(z^2) erfc(z).
"""

from __future__ import annotations

import functools

import numpy as np
from scipy.special import wofz

# Settling times between the means that are compared.
APART = 3
# Rates below which the change is proportional to the rate.
SLOW = 1e-3


@functools.lru_cache(maxsize=16)
def linear_changes(rate: float) -> tuple[float, float]:
    """Largest rise and fall of the logarithm of the mean amplitude of a linear resonance over a settling
    time, to that of the settling time `APART` of them later.

    Parameters
    ----------
    rate : float
        Of the frequency, R.
    """
    if rate < SLOW:
        return linear_changes(SLOW)
    # a few bandwidths on either side, and until the free vibration has died out; its beats with the forced
    # one are the fastest there is to be resolved
    reach = int(np.ceil(4.0 / rate + 12.0))
    n = int(np.ceil(8.0 + 2.0 * rate * reach))
    s = np.arange(-reach * n, reach * n + 1) / n
    z = (1.0 + 1j * rate * s) * np.exp(0.25j * np.pi) / np.sqrt(2.0 * rate)
    amplitude = np.abs(wofz(1j * z))
    sums = np.concatenate([[0.0], np.cumsum(amplitude[1:] + amplitude[:-1])])
    means = sums[n:] - sums[:-n]
    change = np.log(means[APART * n :] / means[: -APART * n])
    return float(change.max()), float(-change.min())

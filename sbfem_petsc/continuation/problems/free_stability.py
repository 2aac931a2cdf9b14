"""Floquet multipliers of free motions, without those that every free motion has."""

from __future__ import annotations

import math

import numpy as np
from scipy import linalg

from .free import FreeMotion, FreeSystem


def free_multipliers(system: FreeSystem, point: FreeMotion, *, damped: bool) -> np.ndarray:
    """Multipliers of a free motion by falling modulus, complex; in conjugate pairs.

    Without that along the motion, which is 1; without damping less a second 1, along the branch; with damping
    less what the self-excitation gives to every disturbance alike.

    The two at 1, or near to it, lie in one Jordan block, or nearly: the steps' error splits them by its root,
    on the real axis or off it, but not their product, which the steps keep. They are told by their share in
    the velocity along the motion, which the others have none in; with damping their product over 1 is the one
    that remains.
    """
    values, vectors = linalg.eig(point.driven.monodromy(point.motion), check_finite=False)
    share = np.abs(linalg.lstsq(vectors, _velocity(system, point).astype(complex), check_finite=False)[0])
    along = int(share.argmax())
    # the real ones are even in number
    partner = values == values[along].conj() if values[along].imag else values.imag == 0.0
    partner[along] = False
    other = int(np.where(partner, share, -1.0).argmax())
    rest = np.delete(values, [along, other])
    if damped:
        rest = np.append(rest, (values[along] * values[other]).real)
        rest = rest * math.exp(-0.5 * point.excitation * point.driven.duration)
    return rest[np.argsort(-np.abs(rest), kind="stable")]


def _velocity(system: FreeSystem, point: FreeMotion) -> np.ndarray:
    """(2 m,): dx/dt at t = 0; what contact adds to the force is in the slope of the energy."""
    m, r = system.modes, system.reduced
    displacement, velocity = point.state[:m], point.state[m:]
    decay = np.where(r.omega > 0.0, 2.0 * r.damping * r.omega - point.excitation, 0.0)
    contact = system.weights * (displacement - system.energy(point.state)[1][:m])
    return np.concatenate([system.weights * velocity, contact - r.omega * displacement - decay * velocity])

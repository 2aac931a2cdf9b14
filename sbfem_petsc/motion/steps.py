"""Coefficients of one time step of modal equations."""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence

import numpy as np
from scipy import linalg

from ..contact.marching import step_constants
from ..contact.step_data import NEVER, Halving, StepConstants
from ..contact.tangent import Propagation
from ..reduction.reduced_model import ReducedModel

# Most terms of the power series of phi_2 for |z| < 1, and what |z|^(n - 2) is to stay below that n of them
# leave out no more than rounding of its imaginary part.
TERMS = 20
ROUND_OFF = [0.01 * np.finfo(float).eps * math.factorial(n + 1) for n in range(TERMS + 1)]


# Steps are halved where contact does more work than this share of the modes' energy. The works are of either
# sign: over 20,000 default steps of an undamped beam with a closed crack their sum is 4e-4 of the energy.
HALVING = Halving(1e-6, 0.0)
# Halvings of a step at most. Work falls by four with each: this is what a step with a work as large as the
# energy itself needs.
DEEPEST = 10


def step_coefficients(omega: np.ndarray, damping: np.ndarray, step: float, scheme: str) -> np.ndarray:
    """(10, m) coefficients of one step of each mode, see `contact.marching`.

    Parameters
    ----------
    omega, damping : (m,) arrays
        rad/s and damping ratios.
    step : float
        s.
    scheme : {"exact", "newmark"}
    """
    return (_exact if scheme == "exact" else _newmark)(omega, damping, step)


def _exact(omega: np.ndarray, damping: np.ndarray, step: float) -> np.ndarray:
    """Exact for loads linear over the step and contact forces held at the mean of its ends.

    With z = (-zeta omega + i omega_d) h, the displacement that a unit force makes in a step h is the
    imaginary part of h phi_1(z) / omega_d, and that of a force which grows to one is that of
    h phi_2(z) / omega_d; phi_1 = (exp z - 1) / z, phi_2 = (phi_1 - 1) / z. Near critical damping, which a
    self-excitation may make negative, and for motions as a rigid body the exponential of a matrix is taken.
    """
    swings = (omega > 0.0) & (np.abs(damping) < 0.9)
    if not swings.all():
        result = np.empty((10, len(omega)))
        result[:, ~swings] = _by_exponential(omega[~swings], damping[~swings], step)
        result[:, swings] = _exact(omega[swings], damping[swings], step)
        return result
    decay, turn = damping * omega, omega * np.sqrt(1.0 - damping**2)
    z = np.empty(len(omega), dtype=complex)
    z.real, z.imag = -step * decay, step * turn
    e = np.exp(z)
    small = np.abs(step * omega) < 1.0
    largest = abs(step) * float(omega.max(where=small, initial=0.0))
    terms = next(n for n in range(3, TERMS + 1) if largest ** (n - 2) < ROUND_OFF[n])
    within = z if small.all() else np.where(small, z, 0.0)
    series = np.ones_like(z)
    for n in range(terms, 2, -1):  # differences would lose digits
        series *= within / n
        series += 1.0
    first, second = 1.0 + 0.5 * z * series, 0.5 * series
    if not small.all():
        first = np.where(small, first, (e - 1.0) / z)
        second = np.where(small, second, (first - 1.0) / z)
    sine = e.imag / turn
    by_force, by_slope = step * first.imag / turn, step * second.imag / turn
    rate = first.imag / turn
    return np.array(
        [
            e.real + decay * sine,
            sine,
            by_force - by_slope,
            by_slope,
            0.5 * by_force,
            -(omega**2) * sine,
            e.real - decay * sine,
            sine - rate,
            rate,
            0.5 * sine,
        ]
    )


def _by_exponential(omega: np.ndarray, damping: np.ndarray, step: float) -> np.ndarray:
    """The same from the exponential of [q, v, p, p'] of each mode."""
    generator = np.zeros((len(omega), 4, 4))
    generator[:, 0, 1] = generator[:, 1, 2] = generator[:, 2, 3] = step
    generator[:, 1, 0], generator[:, 1, 1] = -(omega**2) * step, -2.0 * damping * omega * step
    e = linalg.expm(generator)
    rows = []
    for k in (0, 1):
        slope = e[:, k, 3] / step
        rows += [e[:, k, 0], e[:, k, 1], e[:, k, 2] - slope, slope, 0.5 * e[:, k, 2]]
    return np.array(rows)


def _newmark(omega: np.ndarray, damping: np.ndarray, step: float) -> np.ndarray:
    """Average acceleration (beta = 1/4, gamma = 1/2): a step adds d to q, and v0 + v1 = 2 d / h."""
    rate = 2.0 / step
    by_force = 1.0 / (rate**2 + 2.0 * rate * damping * omega + omega**2)
    moved = np.array([-2.0 * omega**2, np.full_like(omega, 2.0 * rate), *np.ones((3, len(omega)))]) * by_force
    speeds = rate * moved
    moved[0] += 1.0
    speeds[1] -= 1.0
    return np.concatenate([moved, speeds])


def free_motion(
    modes: tuple[np.ndarray, np.ndarray], step: float, weights: np.ndarray, size: int
) -> np.ndarray:
    """(size, size): where a step takes states without contact, as of `free_resolvent`, and 0 behind them."""
    a, b, _, _, _, c, d, _, _, _ = step_coefficients(*modes, step, "exact")
    result, m = np.zeros((size, size)), len(weights)
    q, v = np.arange(m), np.arange(m, 2 * m)
    result[q, q], result[q, v], result[v, q], result[v, v] = a, weights * b, c / weights, d
    return result


def free_resolvent(
    modes: tuple[np.ndarray, np.ndarray], step: float, weights: np.ndarray, vectors: np.ndarray
) -> np.ndarray:
    """(Phi - 1)^-1 of free motions over a step, mode by mode, and -1 for what stands behind them.

    Parameters
    ----------
    modes : (omega, damping)
        (m,) arrays, rad/s and damping ratios.
    step : float
        s.
    weights : (m,) array
        What displacements are multiplied with in a state, rad/s.
    vectors : (2 m + k, ...) array
        Like states.
    """
    a, b, _, _, _, c, d, _, _, _ = step_coefficients(*modes, step, "exact")
    a, b, c, d = a - 1.0, weights * b, c / weights, d - 1.0
    determinant = a * d - b * c
    x, y, behind = np.split(vectors, [len(weights), 2 * len(weights)])
    return np.concatenate([(d * x - b * y) / determinant, (a * y - c * x) / determinant, -behind])


def constants_of(
    reduced: ReducedModel, coefficients: Sequence[np.ndarray], halving: Halving = NEVER
) -> StepConstants:
    """What the steps of a reduced model need, by the coefficients of a step and of its halves .."""
    rows = reduced.contact_laws, reduced.closed_sets.rubbing
    return step_constants(coefficients, reduced.thin_gaps, reduced.gap.contact, rows, reduced.omega, halving)


class StepLength:
    """Coefficients of a step of some length, W, and the free motion over all steps, whatever the loads.

    Parameters
    ----------
    reduced : ReducedModel
    damping : (m,) array
        Ratios.
    step : float
        s.
    steps : int
    """

    def __init__(self, reduced: ReducedModel, damping: np.ndarray, step: float, steps: int):
        self._modes, self._step, self._steps = (reduced.omega, damping), step, steps
        self.coefficients = step_coefficients(reduced.omega, damping, step, "exact")
        self.constants = constants_of(reduced, [self.coefficients])

    @functools.cached_property
    def propagation(self) -> Propagation:
        """For derivatives."""
        return Propagation(self.coefficients, *self._modes, self._step, self._steps)

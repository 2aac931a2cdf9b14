"""Multiple shooting: a period in segments, for long periods and motions that are strongly unstable.

The unknowns are the states at the beginning of each segment, so that a disturbance grows over one segment
alone before Newton's method sees it.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy import sparse

from ...errors import SolveError, called, failed_solve
from ...motion.period_map import FixedPoint, Period
from ...motion.period_motion import PeriodMotion
from ...motion.states import ModalStates
from ..harmonic_errors import alike, in_modes
from ..linear import Sparse
from ..newton import attempt, correct
from ..orbit import Orbit, uncertainty_of
from ..problem import Lost, Problem

# Rounds until subspaces part, at most; what is left between subspaces that part; how many times as large as
# one another moduli of one subspace are at most, as in its product small ones lose as many digits; what is
# rounding in a factor.
ROUNDS, PARTED, SPREAD, ZERO = 300, 1e-10, 1e6, 1e-15


class SegmentedMotion(Problem):
    """Unknowns are the states at the segments' beginnings, as differences to the linear steady state, and a
    number that is held at zero.

    Parameters
    ----------
    period : Period
    frequency : float
        Hz.
    count : int
        Segments of equal numbers of steps, of which the period has a multiple of it.
    """

    # to rounding, as steady states are found; where pairs switch, a step may lead up before it leads down
    closed, settled, patience = 1e-12, 1e-12, 5

    def __init__(self, period: Period, frequency: float, count: int):
        short = period.in_steps(period.steps // count)
        self.period, self.count, self.driven = period, count, period.at(frequency)
        self.parts = [self.driven.part(short, k * short.steps) for k in range(count)]

    def at(self, u: np.ndarray) -> Segments:
        """See `Problem`."""
        return Segments(self, u)

    def units(self, u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """See `Problem`: of the whole motion, not of what is left of it without the linear one, which is
        nothing before contact.
        """
        size = max(float(np.linalg.norm(u)), self.driven.oscillation * self.count**0.5, 1e-300)
        return np.append(np.full(len(u) - 1, size), 1.0), np.ones(len(u))


class Segments:
    """The motions of all segments from their beginnings."""

    def __init__(self, problem: SegmentedMotion, u: np.ndarray):
        self.problem, self.states = problem, u[:-1].reshape(problem.count, -1)
        self.motions = [part.run(state) for part, state in zip(problem.parts, self.states)]
        ends = self.states + np.array([motion.residual for motion in self.motions])
        # how far each segment's end is from the next one's beginning
        self.residual = (ends - np.roll(self.states, -1, axis=0)).ravel()
        size = max(float(np.linalg.norm(problem.driven.linear_state)), float(np.linalg.norm(u)), 1e-300)
        self.scale = size * problem.count**0.5

    def derivatives(self, located: bool) -> np.ndarray:
        """(count, 2 m, 2 m): dx(end) / dx(begin) of each segment."""
        unit, pairs = np.eye(self.states.shape[1]), zip(self.problem.parts, self.motions)
        return np.array([part.carried(motion, unit, located=located) for part, motion in pairs])

    def linear(self, smooth: bool = False) -> Sparse:
        """See `problem.State`."""
        count, size = self.states.shape
        following = sparse.kron(np.roll(np.eye(count), 1, axis=1), np.eye(size))
        along = sparse.block_diag(self.derivatives(smooth)) - following
        return Sparse(sparse.hstack([along, np.zeros((count * size, 1))]))

    def forget(self) -> None:
        """See `problem.State`."""

    def joined(self, residuals: tuple[float, ...] = ()) -> FixedPoint:
        """The motion of all segments as one period's."""

        def whole(name: str) -> np.ndarray:
            parts = [getattr(motion, name) for motion in self.motions]
            return np.concatenate([part[:-1] for part in parts] + [parts[-1][-1:]])

        residual = self.states[-1] + self.motions[-1].residual - self.states[0]
        work, driven = np.concatenate([motion.work for motion in self.motions]), self.problem.driven
        motion = PeriodMotion(residual, whole("states"), whole("velocities"), whole("forces"), work)
        return FixedPoint(self.states[0] + driven.linear_state, driven, motion, residuals)


def at_segments(guess: Orbit, period: Period, frequency: float, segments: int) -> np.ndarray:
    """(segments, 2 m): a motion at the segments' beginnings, in differences to the linear response; one under
    a multiple of the frequency is repeated as often as it takes, and further modes are as without contact.
    """
    driven = period.at(frequency)
    instants = np.arange(segments) * (period.steps // segments)
    # in forcing periods: motions under neighbouring frequencies keep their phase
    times = max(1, round(guess.frequency / frequency))
    places = times * instants * period.excitation.periods / period.steps / guess.periods * len(guess.time)
    assert isinstance(guess.states, ModalStates)  # of the same model
    own = guess.states.reduced
    states = in_modes(np.concatenate([guess.states.q, guess.states.v], axis=1), own, period.reduced)
    states[:, : period.modes] *= period.weights
    before = np.floor(places + 1e-9).astype(int)
    share = (places - before)[:, None]
    states = (1.0 - share) * states[before % len(states)] + share * states[(before + 1) % len(states)]
    q, v = (
        period.over_time(part)[instants] for part in (driven.amplitudes, driven.speeds * driven.amplitudes)
    )
    linear = np.concatenate([period.weights * q, v], axis=1)
    known = np.arange(period.modes) < alike(own, period.reduced)
    return np.where(np.tile(known, 2), states - linear, 0.0)


def shoot_segments(
    period: Period, frequency: float, count: int, states: np.ndarray | None = None
) -> tuple[FixedPoint, Segments]:
    """A periodic motion by multiple shooting, whole and in its segments.

    Parameters
    ----------
    period : Period
    frequency : float
        Hz.
    count : int
        Segments.
    states : (count, 2 m) array, optional
        First guess, differences to the linear steady state. Default: none.

    Raises
    ------
    SolveError
        If Newton's method does not converge.
    """
    problem = SegmentedMotion(period, frequency, count)
    guess = np.zeros((count, 2 * period.modes)) if states is None else states
    try:
        point = correct(problem, np.append(guess, 0.0), problem.value)
    except Lost as error:
        raise failed_solve(
            f"{called()}: over {count} segments {error}; start from a neighbour, or take more segments "
            "or steps"
        ) from None
    return point.state.joined(tuple(point.state.scale * missed for missed in point.residuals)), point.state


def segmented_stability(segments: Segments) -> tuple[np.ndarray, Callable[[], float]]:
    """Multipliers of a motion, as the eigenvalues of the product of its segments' derivatives, and what
    computes the uncertainty of the largest modulus, by the same motion in twice the steps.
    """
    values = product_eigenvalues(segments.derivatives(located=True))
    frequency, period = segments.problem.driven.frequency, segments.problem.period
    begins = [
        np.append(period.weights * motion.states[0], motion.velocities[0]) for motion in segments.motions
    ]

    def error() -> float:
        finer = period.in_steps(2 * period.steps)
        found = attempt(lambda: shoot_segments(finer, frequency, len(begins), np.array(begins)), SolveError)
        if found is None:
            return np.nan
        derivatives = found[1].derivatives(located=True)
        return uncertainty_of(abs(values[0]) - abs(product_eigenvalues(derivatives)[0]))

    return values, error


# ---------------------------------------------------------------------- eigenvalues of a product
def product_eigenvalues(factors: np.ndarray) -> np.ndarray:
    """Eigenvalues of F_n ... F_2 F_1 by falling modulus, without the product, in whose rounding small ones
    are lost.

    Orthogonal Q_k and triangular R_k with F_k Q_(k-1) = Q_k R_k are carried through all factors, and again
    from the last Q: subspaces of eigenvalues of different moduli part (F. L. Bauer, Z. Angew. Math. Phys. 8,
    214, 1957), and those in one of them are the eigenvalues of the product of the R_k's diagonal blocks
    there.

    Each is that of factors which differ from the given ones by about 1e-15 of their norms: relative errors
    are that times the condition of the eigenvalue, whatever its size beside the largest.

    Parameters
    ----------
    factors : (n, s, s) array

    Raises
    ------
    SolveError
        If the factors are not finite, or the iteration does not end.
    """
    norms, size = np.abs(factors).max(axis=(1, 2)), factors.shape[1]
    if not np.isfinite(norms).all():
        raise failed_solve("Floquet multipliers: the derivative of a segment is not finite")
    if not norms.all():
        return np.zeros(size, dtype=complex)
    turned, triangles, enough, taken = np.eye(size), np.empty(factors.shape), 0, 0
    while not enough or taken < enough:
        taken += 1
        begin = turned
        for k, factor in enumerate(factors / norms[:, None, None]):
            turned, triangles[k] = np.linalg.qr(factor @ turned)
        closing = begin.T @ turned
        parted = [k for k in range(1, size) if np.abs(closing[k:, :k]).max() < PARTED]
        blocks = [slice(*ends) for ends in zip([0, *parted], [*parted, size])]
        # what is rounding in a factor is zero
        moduli = np.log(np.maximum(np.abs(np.einsum("kii->ki", triangles)), ZERO)).sum(axis=0)
        if not enough and max(float(np.ptp(moduli[block])) for block in blocks) < np.log(SPREAD):
            enough = 2 * taken if parted else taken  # in as many again what is left squares
        if not enough and taken == ROUNDS:
            raise failed_solve(
                f"Floquet multipliers: subspaces of {size} eigenvalues have not parted in {ROUNDS} "
                "rounds through the segments; take another number of them"
            )
    values = np.concatenate(
        [_of_block(closing[block, block], triangles[:, block, block]) for block in blocks]
    )
    with np.errstate(over="ignore", under="ignore"):
        values = values * np.exp(np.log(norms).sum())
    return values[np.argsort(-np.abs(values), kind="stable")]


def _of_block(closing: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Eigenvalues of the product of triangular matrices and an orthogonal one behind it."""
    product, logarithm = np.eye(len(closing)), 0.0
    for triangle in triangles:
        product = triangle @ product
        scale = float(np.abs(product).max()) or 1.0
        product, logarithm = product / scale, logarithm + np.log(scale)
    return np.linalg.eigvals(closing @ product) * np.exp(logarithm)

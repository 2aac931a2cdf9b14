"""Multiple shooting: a period in segments, for long periods and motions that are strongly unstable.

The unknowns are the states at the beginning of each segment, so that a disturbance grows over one segment
alone before Newton's method sees it. The linear systems are cyclic in blocks; they are condensed by
orthogonal transformations (S. J. Wright, SIAM J. Sci. Stat. Comput. 13, 742, 1992), which multiply no
derivatives.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..errors import SolveError, on_all_ranks
from .fixed_point import FixedPoint
from .orbit import uncertainty_of
from .period_map import DrivenPeriod, Period, PeriodMotion
from .periodic_schur import product_eigenvalues
from .shooting import RELATIVE, ROUND_OFF

ITERATIONS = 40
# Shares of Newton's step of which the first is taken whose residual is below one of the last few: where pairs
# switch, a step may lead up before it leads down.
SHARES, MEMORY = (1.0, 0.5, 0.2, 0.05), 5


class SegmentedPeriod:
    """A driven period in segments of equal numbers of steps; states are differences to the linear one.

    Parameters
    ----------
    driven : DrivenPeriod
    count : int
        Segments; the steps are a multiple of it.
    """

    def __init__(self, driven: DrivenPeriod, count: int):
        self.driven, self.steps = driven, driven.period.steps // count
        short = driven.period.of(self.steps)
        self.parts = [driven.part(short, k * self.steps) for k in range(count)]

    def run(self, states: np.ndarray) -> tuple[np.ndarray, list[PeriodMotion]]:
        """(count, 2 m): how far each segment's end is from the next one's beginning, and the motions."""
        motions = [part.run(state) for part, state in zip(self.parts, states)]
        ends = states + np.array([motion.residual for motion in motions])
        return ends - np.roll(states, -1, axis=0), motions

    def derivatives(self, motions: list[PeriodMotion], located: bool = False) -> np.ndarray:
        """(count, 2 m, 2 m): dx(end) / dx(begin) of each segment."""
        unit = np.eye(2 * self.driven.period.modes)
        return np.array(
            [part.carried(motion, unit, located=located) for part, motion in zip(self.parts, motions)]
        )

    def solve(self, states: np.ndarray) -> tuple[np.ndarray, list[PeriodMotion], tuple[float, ...]]:
        """The periodic motion near a guess (count, 2 m), by Newton's method: states, motions and the norms of
        the residual.

        Raises
        ------
        SolveError
            If it does not converge.
        """
        size = max(float(np.linalg.norm(self.driven.linear_state)), 1e-300)
        moving = self.driven.oscillation or size
        aim = ROUND_OFF * max(size, float(np.linalg.norm(states))) * np.sqrt(len(states))
        missed, motions = self.run(states)
        residuals = [float(np.linalg.norm(missed))]
        while len(residuals) <= ITERATIONS:
            if residuals[-1] <= max(aim, RELATIVE * residuals[0]):
                return states, motions, tuple(residuals)
            change = condensed(self.derivatives(motions), missed)
            for share in SHARES:
                try:
                    tried = self.run(states + share * change)
                except SolveError:
                    continue
                norm = float(np.linalg.norm(tried[0]))
                if norm < max(residuals[-MEMORY:]):
                    break
            else:
                break
            states, (missed, motions) = states + share * change, tried
            residuals.append(norm)
        raise on_all_ranks(
            SolveError(
                f"periodic: Newton's method over {len(states)} segments did not converge in "
                f"{len(residuals) - 1} iterations: their ends miss the next ones' beginnings by "
                f"{residuals[-1] / moving:.2e} of the linear motion's size, from {residuals[0] / moving:.2e}"
                "; start from a neighbour, or take more segments or steps"
            )
        )

    def joined(self, states: np.ndarray, motions: list[PeriodMotion], residuals) -> FixedPoint:
        """The motion of all segments as one period's."""

        def whole(name: str) -> np.ndarray:
            parts = [getattr(motion, name) for motion in motions]
            return np.concatenate([part[:-1] for part in parts] + [parts[-1][-1:]])

        residual = states[-1] + motions[-1].residual - states[0]
        motion = PeriodMotion(residual, whole("states"), whole("velocities"), whole("forces"))
        state = states[0] + self.driven.linear_state
        return FixedPoint(state, self.driven, motion, residuals)


def condensed(derivatives: np.ndarray, missed: np.ndarray) -> np.ndarray:
    """(n, s): the changes d of states for which D_k d_k - d_(k+1) = -missed_k, cyclic.

    Parameters
    ----------
    derivatives : (n, s, s) array
    missed : (n, s) array
    """
    count, size = missed.shape
    # A d_0 + B d_k = r for the segments up to k; one after the other d_k is eliminated by a QR factorisation
    first, last, right = derivatives[0], -np.eye(size), -missed[0]
    kept = []
    for derivative, miss in zip(derivatives[1:], missed[1:]):
        q, r = np.linalg.qr(np.concatenate([last, derivative]), mode="complete")
        rows = np.zeros((2 * size, 2 * size + 1))
        rows[:size, :size], rows[:size, -1] = first, right
        rows[size:, size:-1], rows[size:, -1] = -np.eye(size), -miss
        rows = q.T @ rows
        kept.append((r[:size], rows[:size]))
        first, last, right = rows[size:, :size], rows[size:, size:-1], rows[size:, -1]
    result = np.zeros((count, size))
    result[0] = np.linalg.solve(first + last, right)
    following = result[0]
    for k in range(count - 1, 0, -1):
        upper, rows = kept[k - 1]
        following = np.linalg.solve(
            upper, rows[:, -1] - rows[:, :size] @ result[0] - rows[:, size:-1] @ following
        )
        result[k] = following
    return result


def shoot_segments(
    period: Period, frequency: float, count: int, states: np.ndarray | None = None
) -> tuple[FixedPoint, SegmentedPeriod, list[PeriodMotion]]:
    """A periodic motion by multiple shooting, its segments and their motions.

    Parameters
    ----------
    period : Period
    frequency : float
        Hz.
    count : int
        Segments.
    states : (count, 2 m) array, optional
        First guess, differences to the linear steady state. Default: none.
    """
    segmented = SegmentedPeriod(period.at(frequency), count)
    guess = np.zeros((count, 2 * period.modes)) if states is None else states
    found, motions, residuals = segmented.solve(guess)
    return segmented.joined(found, motions, residuals), segmented, motions


def segmented_stability(
    segmented: SegmentedPeriod, motions: list[PeriodMotion]
) -> tuple[np.ndarray, Callable[[], float]]:
    """Multipliers of a motion, as the eigenvalues of the product of its segments' derivatives, and what
    computes the uncertainty of the largest modulus, by the same motion in twice the steps.
    """
    values = product_eigenvalues(segmented.derivatives(motions, located=True))
    frequency, period = segmented.driven.frequency, segmented.driven.period
    begins = [np.append(period.weights * motion.states[0], motion.velocities[0]) for motion in motions]

    def error() -> float:
        finer = period.in_steps(2 * period.steps)
        try:
            _, other, found = shoot_segments(finer, frequency, len(begins), np.array(begins))
        except SolveError:
            return np.nan
        changed = product_eigenvalues(other.derivatives(found, located=True))[0]
        return uncertainty_of(abs(values[0]) - abs(changed))

    return values, error

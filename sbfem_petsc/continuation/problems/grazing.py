"""Grazing: orbits whose least gap at a contact row that is open all the time is zero.

Where a row begins to touch, the orbit of the model is also one of the model without that row, on which the
row's least gap over the period passes through zero smoothly: that is what is solved for, from either side.
"""

from __future__ import annotations

import numpy as np
from scipy.optimize import root_scalar

from meshing.warnings import BranchWarning

from ...errors import SolveError, warn
from ...motion.period_map import DrivenPeriod, FixedPoint, Period
from ...motion.period_motion import PeriodMotion
from ...reduction.reduced_model import held_in
from ..bifurcations import Bifurcation
from ..branch import Branch
from ..extrapolation import extrapolated
from ..shooting import shoot
from .driven_orbits import Family

# Distance of a grazing point from the last one that is open, in steps of the branch: further away it belongs
# to another part of it.
NEAR = 3.0
# Gap of a root, beside the gaps at the points that it was sought between.
ZERO = 1e-6


class OpenRowFamily(Family):
    """The periods of a reduced model without one of its contact rows, whose gap is watched.

    Parameters
    ----------
    period : Period
        Of the whole model.
    row : int
    parameter, factor
        See `Family`.
    """

    def __init__(self, period: Period, row: int, parameter: str, factor: float = 1.0):
        others = np.delete(np.arange(len(period.reduced.initial_gap)), row)
        reduced = held_in(period.reduced, others)
        super().__init__(Period(reduced, period.excitation, period.steps), parameter, factor)
        self.whole, self.row = period, row
        gap = period.reduced.gap
        self._modes, self._loads = gap.modes[row], gap.loads[row]
        self._contact = np.delete(gap.contact[row], row)

    def gap(self, driven: DrivenPeriod, motion: PeriodMotion, value: float) -> np.ndarray:
        """(n + 1,): how far the row is from being held over the period, m."""
        p, factor = driven.period, value if self.parameter == "gap" else 1.0
        linear = p.over_time(driven.amplitudes @ self._modes) + driven.loads @ self._loads
        shut = motion.states @ self._modes + motion.forces @ self._contact
        gap = linear + shut + factor * float(self.whole.reduced.initial_gap[self.row])
        return self.whole.laws.room(gap, self.row)


def least(values: np.ndarray) -> float:
    """Minimum of equal samples of a period, between them by the parabola through the lowest three."""
    k = int(np.argmin(values))
    before, middle, after = values[k - 1], values[k], values[(k + 1) % len(values)]
    bend = before - 2.0 * middle + after
    return float(middle - 0.125 * (after - before) ** 2 / bend) if bend > 0.0 else float(middle)


def least_gaps(driven: DrivenPeriod, motion: PeriodMotion) -> np.ndarray:
    """(rows,): how far rows that are always free are from being held, m, at the least over the period; of the
    others minus the overlap that their largest force stands for; -inf of those that are never free.
    """
    p = driven.period
    gaps = driven.free_gap + motion.states @ p.right @ p.left.T + motion.forces @ p.residual_flexibility
    room, force = p.laws.room(gaps[:-1]), np.abs(motion.forces).max(axis=0)
    overlap = -force * np.diag(driven.constants.flexibility[0] + p.residual_flexibility)
    always = [least(row) if np.isfinite(row).all() else -np.inf for row in room.T]
    return np.where((force > 0.0) & np.isfinite(always), overlap, always)


def grazing_row(driven: DrivenPeriod, state: np.ndarray) -> int:
    """The row that is nearest to begin or cease touching on an orbit."""
    return int(np.argmin(np.abs(least_gaps(driven, driven.run(state)))))


def find_grazing(branch: Branch, every: bool) -> list[Bifurcation]:
    """Grazing points between the points of a branch.

    Parameters
    ----------
    branch : Branch
    every : bool
        Of every row; False: only where the motion without any contact begins or ends.

    Warns
    -----
    BranchWarning
        Of one that is not found.
    """
    period, result = branch.period, []
    touching = np.zeros((len(branch), period.pairs), dtype=bool)
    for k, (value, state) in enumerate(zip(branch.value, branch.states)):
        driven = branch.over.at(period, float(value))
        gaps = least_gaps(driven, driven.run(state))
        touching[k] = (gaps < 0.0) & np.isfinite(gaps)
    for k in range(1, len(branch)):
        changed = touching[k] != touching[k - 1]
        if not every and touching[k].any() == touching[k - 1].any():
            continue
        found = []
        for row in np.flatnonzero(changed):
            try:
                found.append(_grazing(branch, k, int(row), bool(touching[k, row])))
            except SolveError as error:
                warn(str(error), BranchWarning)
        if found and not every:  # of several rows the first that touches
            opened = not touching[k].any()
            open_end = float(branch.value[k if opened else k - 1])
            found = [min(found, key=lambda item: abs(item.value - open_end))]
        result += found
    return result


def _grazing(branch: Branch, k: int, row: int, closes: bool) -> Bifurcation:
    """Where a row begins (or ceases) to touch between the points k - 1 and k."""
    inside, outside = (k - 1, k) if closes else (k, k - 1)
    begin, end = float(branch.value[inside]), float(branch.value[outside])
    own = _LeastGap(branch, branch.period, row, branch.states[inside])
    reach = NEAR * max(abs(end - begin), 1e-9 * abs(begin))
    try:
        first, last = own(begin), own(end)
        if first * last <= 0.0:
            solved = root_scalar(own, bracket=(begin, end), xtol=1e-13 * abs(begin), rtol=1e-13)
            root, converged = float(solved.root), solved.converged
        else:  # the branch turns at the corner that grazing makes
            root, converged = own.root(begin, begin + 0.05 * (end - begin))
        # a change of sign is no zero where the orbit jumps to another motion
        missed = (
            not converged
            or abs(root - begin) > reach
            or not (abs(own(root)) <= ZERO * max(abs(first), abs(last), abs(first - last)))
        )
    except SolveError:
        root, missed = begin, True
    if missed:
        raise SolveError(
            f"grazing_points: where contact row {row} begins to touch between the points {k - 1} and {k} of "
            f"the branch, at {begin:.8g} and {end:.8g}, was not found; give a branch with a smaller "
            "largest_step"
        )
    state = own.found[root].state

    def located(times: int) -> float:
        finer = _LeastGap(branch, branch.period.in_steps(times * branch.period.steps), row, state)
        found, converged = finer.root(root, root + 1e-3 * (end - begin))
        if not converged or abs(found - root) > reach:
            raise SolveError(f"row {row} does not begin to touch there in {times} times the steps")
        return found

    value, error = extrapolated(root, located)
    direction = np.zeros(len(state), complex)
    return Bifurcation("grazing", value, complex(np.nan), state, direction, k, root, error, row)


class _LeastGap:
    """Least gap of a row on the motions of a period without it, over the parameter of a branch."""

    def __init__(self, branch: Branch, period: Period, row: int, state: np.ndarray):
        self.branch, self.first = branch, state
        over = branch.parameter if branch.parameter in ("damping", "gap") else "load"
        self.family = OpenRowFamily(period, row, over)
        self.found: dict[float, FixedPoint] = {}

    def __call__(self, value: float) -> float:
        driven, guess = self.branch.over.at(self.family.period, value), self.first
        if self.found:  # the nearest one that is known, moved as the linear motion does
            near = min(self.found, key=lambda other: abs(other - value))
            guess = self.found[near].state + driven.linear_state - self.found[near].driven.linear_state
        fixed = self.found[value] = shoot(driven, guess)
        return least(self.family.gap(fixed.driven, fixed.motion, value)[:-1])

    def root(self, one: float, other: float) -> tuple[float, bool]:
        """By secants from two values, and whether it has converged."""
        solved = root_scalar(self, x0=one, x1=other, xtol=1e-13 * abs(one), rtol=1e-13)
        return float(solved.root), bool(solved.converged)

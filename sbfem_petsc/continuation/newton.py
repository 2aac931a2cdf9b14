"""Newton's method on the equations of any problem and one condition: Broyden's updates of bordered solves."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import Any, TypeVar

import numpy as np

from ..errors import SolveError
from ..progress import refused
from .problem import Border, Condition, Linear, Lost, Point, Problem

# Iterations at most.
ITERATIONS = 30
# Where none gains, rounding is all there is if the step is no longer than this many times what settles.
ROUNDED = 10.0
Found = TypeVar("Found")
# What a step that leads nowhere ends with.
FAILURES = SolveError, np.linalg.LinAlgError, ValueError


def attempt(
    call: Callable[[], Found], failures: Any = FAILURES, told: list[Any] | None = None
) -> Found | None:
    """What a call gives, None where that leads nowhere, of which the failure is told."""
    try:
        return call()
    except failures as error:
        if refused(error):
            raise
        if told is not None:
            told.append(error)
        return None


class Updated:
    """The inverse of a bordered operator that dyads have been added to, by Sherman and Morrison's formula.

    C. G. Broyden, Mathematics of Computation 19, 577 (1965).
    """

    def __init__(self, border: Border, total: Callable[[float], float] = float):
        self.border, self.total = border, total
        self.dyads: list[tuple[np.ndarray, np.ndarray]] = []
        # the last right side, which after a whole step is also the next one, and its solution
        self._last: tuple[np.ndarray | None, np.ndarray] = (None, np.zeros(0))

    def add(self, left: np.ndarray, row: np.ndarray) -> None:
        """Add left row^T to the operator."""
        solved = self.solve(left)
        self.dyads.append((solved / (1.0 + self.total(float(row @ solved))), row))

    def solve(self, right: np.ndarray) -> np.ndarray:
        """The inverse times a right side."""
        if right is not self._last[0]:
            self._last = right, self.border.solve(right)
        result = self._last[1]
        for solved, row in self.dyads:
            result = result - solved * self.total(float(row @ result))
        return result


class _Iterate:
    """The unknowns of an iteration, the state there and how much is missed of the equations."""

    def __init__(self, problem: Problem, u: np.ndarray, condition: Condition, scale: float | None = None):
        self.u, self.state = u, problem.at(u)
        self.scale: float = self.state.scale if scale is None else scale
        missed, self.row = condition(u)
        residual = self.state.residual
        self.right = np.append(residual, missed)
        self.norm = math.hypot(problem.sum(float(residual @ residual)) ** 0.5 / self.scale, missed)
        if not math.isfinite(self.norm):
            raise Lost("the motion leaves the range of numbers")


def correct(
    problem: Problem, u: np.ndarray, condition: Condition, near: Linear | None = None, most: float = math.inf
) -> Point:
    """The solution near some unknowns on which a condition vanishes.

    Parameters
    ----------
    problem : Problem
    u : (n + 1,) array
    condition : callable
        In units of arc length.
    near : Linear, optional
        Linearised equations nearby, to begin with.
    most : float
        Iterations (`Point.effort`) beyond which it is given up.

    Raises
    ------
    Lost
        If there is none, with how far Newton's method has come.
    """
    try:
        return _Newton(problem, condition, near, most).solve(u)
    except Lost:
        raise
    except FAILURES as error:
        raise Lost(str(error)) from None


class _Newton:
    def __init__(self, problem: Problem, condition: Condition, near: Linear | None, most: float):
        self.problem, self.condition, self.near, self.most = problem, condition, near, most
        self.residuals: list[float] = []
        self.made = 0
        self.inverse: Updated | None = None
        self.exact = False

    @property
    def iterations(self) -> int:
        """How many have been taken."""
        return len(self.residuals) - 1

    @property
    def effort(self) -> float:
        """Iterations; those with an updated derivative count a third."""
        return self.made + (self.iterations - self.made) / 3.0

    def solve(self, u: np.ndarray) -> Point:
        """Iterate from some unknowns."""
        problem = self.problem
        self.units = problem.units(u)[0]
        here = _Iterate(problem, u, self.condition)
        self.residuals.append(here.norm)
        if self.near is not None and problem.gain:
            self.inverse = Updated(self.near.bordered(here.row), problem.sum)
        while here.norm > problem.closed:
            if self.effort > self.most:
                raise Lost(f"Newton's method takes more than {self.most:g} iterations")
            if self.effort >= ITERATIONS:
                raise self._failed(here.norm)
            self.exact = self.inverse is None
            if self.inverse is None:
                self.inverse = Updated(here.state.linear().bordered(here.row), problem.sum)
                self.made += 1
            whole = -self.inverse.solve(here.right)
            scaled = whole / self.units
            size = problem.sum(float(scaled @ scaled)) ** 0.5
            share, following = self._backtracked(here, whole)
            if following is None:
                if size <= ROUNDED * problem.settled or here.norm <= problem.scatter:
                    break
                if self.exact:
                    raise self._failed(here.norm)
                self.inverse = None  # the exact derivative, from where it is
                continue
            self.residuals.append(following.norm)
            ended = self.exact and problem.gain * here.norm < following.norm <= problem.scatter
            if ended or (share == 1.0 and size <= problem.settled):
                here = following
                break
            self._learn(here, following, share, whole)
            here = following
        value = problem.value(here.u)[0]
        return Point(problem, here.u, here.state, value, self.effort, tuple(self.residuals))

    def _backtracked(self, here: _Iterate, whole: np.ndarray) -> tuple[float, _Iterate | None]:
        """The first share of a step after which less is missed than at one of the last few iterates, and the
        iterate there.
        """
        bound = max(self.residuals[-self.problem.patience :])
        for share in self.problem.shares:
            iterate = partial(_Iterate, self.problem, here.u + share * whole, self.condition, here.scale)
            tried = attempt(iterate, SolveError)
            if tried is not None and tried.norm < bound:
                return share, tried
        return 0.0, None

    def _learn(self, here: _Iterate, following: _Iterate, share: float, whole: np.ndarray) -> None:
        """Broyden's update after a step, or none if it has gained too little."""
        assert self.inverse is not None
        if following.norm > self.problem.gain * here.norm:
            self.inverse = None
            return
        step = share * whole
        row = step / self.units**2
        row = row / self.problem.sum(float(row @ step))
        left = following.right if share == 1.0 else following.right - (1.0 - share) * here.right
        self.inverse.add(left, row)

    def _failed(self, norm: float) -> Lost:
        return Lost(
            f"Newton's method has not converged in {self.iterations} iterations, at {norm:.1e} of the "
            "motion's size"
        )

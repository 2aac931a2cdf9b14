"""Fixed points of the period of a reduced model (`period_map`): from a guess, along a branch, very near
another one.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy import linalg

from ..errors import SolveError
from .branch_range import ParameterRange
from .fixed_point import FixedPoint
from .newton import ROUND_OFF, Newton, TooManyIterations
from .period_map import DrivenPeriod, Period

# Residual relative to the linear oscillation at which a fixed point nearby is taken.
NEARBY = 1e-8
# Change of the state, relative to its size, after which a point along a branch is taken: what is left is
# less, as each iteration gains a factor of more than three.
SETTLED = 1e-9
JACOBIANS = ("auto", "dense", "matrix-free", "differences")
# Unknowns up to which matrices of the period map are made whole.
WHOLE = 1200
# Motions of so many modes and more are first looked for with so many times fewer steps, but so many at least
# to each order of the loads, to this residual relative to the first one; not from a state whose residual is
# no larger than what fewer steps cost.
MANY, COARSER, RESOLVED, ROUGHLY, ROUGH = 20, 8, 64, 1e-3, 1e-3


def shoot(
    period: Period,
    state: np.ndarray,
    frequency: float,
    factor: float = 1.0,
    jacobian: str = "auto",
    iterations: int | None = None,
) -> FixedPoint:
    """Fixed point of a period near a state, by SNES.

    Parameters
    ----------
    period : Period
    state : (2 m,) array
        First guess of x(0).
    frequency : float
        Hz.
    factor : float
        On the oscillating loads.
    jacobian : {"auto", "dense", "matrix-free", "differences"}
        "dense": the exact derivative as a matrix and its LU factors; "matrix-free": as products, with GMRES
        preconditioned by the motion without contact; "differences": finite differences, an integration for
        each unknown (the paper's way); "auto": matrix-free above 1200 unknowns, otherwise the dense one, with
        Broyden's rank-one updates from an iteration to the next while they gain enough.
    iterations : int, optional
        Newton iterations at most. Default: `ITERATIONS`.

    Raises
    ------
    SolveError
        If Newton's method does not converge; the message gives the residual.
    """

    def solve(kind: str) -> FixedPoint:
        newton = Newton(period, kind, (), None, iterations)
        return newton.solve(state, lambda _: period.at(frequency, factor), np.zeros(0))

    if jacobian != "auto":
        return solve(jacobian)
    if 2 * period.modes > WHOLE:
        return solve("matrix-free")
    if iterations is None and period.modes >= MANY:
        found = _from_fewer_steps(period, state, frequency, factor)
        if found is not None:
            return found
    try:
        return solve("updated")
    except SolveError:
        return solve("dense")


def _from_fewer_steps(
    period: Period, state: np.ndarray, frequency: float, factor: float
) -> FixedPoint | None:
    """As `shoot`, by way of the motion with far fewer steps; None if that leads to none."""
    steps = max(period.steps // COARSER, RESOLVED * int(period.excitation.orders.max(initial=1)))
    if 2 * steps > period.steps:
        return None
    driven = period.at(frequency, factor)
    coarse = Newton(period.in_steps(steps), "updated", (), None)
    coarse.relative = ROUGHLY
    fine = Newton(period, "updated", (), None)
    try:
        residual = driven.run(state).residual
        if np.linalg.norm(residual) <= ROUGH * driven.oscillation:
            return None
        rough = coarse.solve(state, lambda _: coarse.period.at(frequency, factor), np.zeros(0))
        fine.near = coarse.derivative
        return fine.solve(rough.state, lambda _: driven, np.zeros(0))
    except SolveError:
        return None


def shoot_along(
    period: Period,
    guess: tuple[np.ndarray, float],
    parameter: ParameterRange,
    condition: Callable[[np.ndarray, float], tuple[float, np.ndarray, float]] | None,
    near: np.ndarray | None = None,
    most: float = np.inf,
) -> FixedPoint:
    """Fixed point with one free parameter and one condition, or at a value of the parameter.

    Parameters
    ----------
    period : Period
    guess : (2 m,) array, float
        Of x(0) and of the parameter.
    parameter : ParameterRange
        The free one.
    condition : callable or None
        (state, change of the parameter) -> (c, row (2 m,), slope): the condition c = 0 and its derivatives;
        None: the parameter stays as it is guessed.
    near : (2 m, 2 m + 1) array, optional
        Derivative of x(T) at a fixed point nearby, to begin with.
    most : float
        Iterations (`FixedPoint.effort`) beyond which it is given up.

    Raises
    ------
    SolveError
        If Newton's method does not converge.
    """
    state, first = guess[0], np.array([guess[1]])
    free = (parameter.name,) if condition is not None else ()

    def solve(kind: str, near: np.ndarray | None) -> FixedPoint:
        newton = Newton(period, kind, free, condition)
        newton.near, newton.most, newton.settled = near, most, SETTLED
        if free:
            return newton.solve(state, lambda p: parameter.at(period, float(p[0])), first)
        driven = parameter.at(period, guess[1])
        return newton.solve(state, lambda _: driven, first[:0])

    if near is not None:
        try:
            return solve("updated", near if free else near[:, : len(state)])
        except TooManyIterations:
            raise
        except SolveError:
            pass
    return solve("dense", None)


def shoot_nearby(driven: DrivenPeriod, state: np.ndarray, derivative: np.ndarray) -> FixedPoint | None:
    """Fixed point very near a state, by Newton's method with a derivative of the period that is known about:
    that of a motion nearby, dx(T) / dx(0). None unless each iterate is at least ten times better.

    To 1e-8 of the linear oscillation, for which a few periods are integrated and no derivative is made.
    """
    factors, exchanged, singular = linalg.lapack.dgetrf(derivative - np.eye(len(state)))
    if singular:
        return None
    aim = max(NEARBY * driven.oscillation, ROUND_OFF * float(np.linalg.norm(driven.linear_state)))
    residuals: list[float] = []
    while True:
        motion = driven.run(state)
        residuals.append(float(np.linalg.norm(motion.residual)))
        if residuals[-1] <= aim:
            return FixedPoint(state, np.zeros(0), driven, motion, tuple(residuals))
        if len(residuals) > 1 and residuals[-1] > 0.1 * residuals[-2]:
            return None
        change, _ = linalg.lapack.dgetrs(factors, exchanged, motion.residual)
        state = state - change

"""Periodic motions of the unreduced model (`motion.unreduced.period`): a steady state by SNES, without a
matrix (prefix ``shooting_``), and branches of them over the frequency or the load.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable

import numpy as np

from ...errors import SolveError, called
from ...motion.unreduced.period import KRYLOV, UnreducedDriven, UnreducedMotion, UnreducedPeriod
from ...petsc import PETSc, finite, solving
from ...progress import silent
from ..linear import Krylov, Operator, operator, preconditioned
from ..newton import attempt
from ..problem import Problem
from ..shooting import Steady
from .driven_orbits import LEAST, REST, SPAN, ParameterRange

# The linear solves need no more than Newton's next iterate is good for.
RELATIVE, LINEAR, MOST = 1e-8, 1e-4, 20
# What rounding leaves of a period's steps, 2e-12 to 5e-11 of the state and more of slender bodies in long
# steps, is measured where Newton's next iterate may be at it: from this residual relative to the state on.
# A residual of so many times that is none: few slow modes carry it, and it scatters by five.
NEAR, ROUNDED = 1e-3, 10.0
EPSILON = float(np.finfo(float).eps)
# Difference of a parameter, relative, by which a motion's rate with it is found.
DIFFERENCE = 1e-5
# Periods integrated before another search, where Newton's method fails from the linear steady state: bodies
# that overlap in it are thrown apart, and no iterate shows how the motion settles.
SETTLING = (10, 40)


class UnreducedOrbits(Problem):
    """Unknowns are this rank's part of x(0), and the parameter, which all ranks have.

    Parameters
    ----------
    period : UnreducedPeriod
    parameter : ParameterRange
        Its frequency or load.
    """

    # a linear solve takes as long as a new derivative, which an updated one saves
    closed, settled, corners, gain = 1e-8, 1e-8, True, 0.0
    isolated = (
        "motions of one period are not isolated at {:.8g}, as those of a body without supports; hold it, or "
        "begin elsewhere"
    )
    advice = "take more steps a period or more stiffness-proportional damping"

    def __init__(self, period: UnreducedPeriod, parameter: ParameterRange):
        self.period, self.parameter, self.comm = period, parameter, period.comm
        self.extent = parameter.range.extent
        ends = [self.driven(value).linear_state for value in (parameter.start, parameter.stop)]
        self.least = REST * max(self.norm(end) for end in ends)

    def driven(self, value: float) -> UnreducedDriven:
        """The driven period of a value of the parameter. Collective."""
        return self.parameter.at(self.period, value)

    def sum(self, local: float) -> float:
        """See `Problem`."""
        return float(self.comm.allreduce(local))

    def norm(self, vector: np.ndarray) -> float:
        """Of this rank's part and those of the others. Collective."""
        return self.sum(float(vector @ vector)) ** 0.5

    def at(self, u: np.ndarray) -> UnreducedState:
        """See `Problem`."""
        return UnreducedState(self, u)

    def units(self, u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """See `Problem`; what all ranks have is summed over them."""
        size = max(self.norm(u[:-1]), self.least, 1e-300)
        unit = self.extent / SPAN or max(abs(float(u[-1])), LEAST)
        return np.append(np.full(len(u) - 1, size), unit * self.comm.size**0.5), np.ones(len(u))

    def value(self, u: np.ndarray) -> tuple[float, np.ndarray]:
        """See `Problem`; the gradient is this rank's share of it."""
        return float(u[-1]), np.eye(1, len(u), len(u) - 1)[0] / self.comm.size

    map = None

    def whole(self, u: np.ndarray) -> np.ndarray:
        """See `Problem`."""
        parts = self.comm.gather(u[:-1])
        return u if parts is None else np.concatenate([*parts, u[-1:]])

    def own(self, u: np.ndarray) -> np.ndarray:
        """See `Problem`."""
        sizes = self.comm.allgather(self.period.unknowns)
        begin = sum(sizes[: self.comm.rank])
        return np.append(u[begin : begin + sizes[self.comm.rank]], u[-1])


class UnreducedState:
    """A motion over one period, periodic or not; what of it takes memory is integrated again where it is
    asked for after `forget`.
    """

    contact_work = 0.0  # of implicit contact forces, which dissipate, nothing is told of the steps

    def __init__(self, problem: UnreducedOrbits, u: np.ndarray):
        self.problem, self.state, self.value = problem, u[:-1], float(u[-1])
        self.residual = self.motion.end - self.state
        self.touching = self.motion.sets.any(axis=0)
        self.scale = max(problem.norm(self.state), problem.least)

    @property
    def driven(self) -> UnreducedDriven:
        """The period at the motion's conditions."""
        return self.problem.driven(self.value)

    @functools.cached_property
    def motion(self) -> UnreducedMotion:
        """One period from the state."""
        return self.driven.run(self.state)

    def forget(self) -> None:
        """See `problem.State`."""
        self.__dict__.pop("motion", None)

    def linear(self, smooth: bool = False) -> UnreducedLinear:
        """See `problem.State`."""
        return UnreducedLinear(self)

    def round_off(self) -> float:
        """By how much x(T) - x(0) of two states that differ in the last digit are apart. Collective."""
        digits = np.where(np.arange(len(self.state)) % 2, 1.0 + EPSILON, 1.0 - EPSILON)
        state = self.state * digits
        return self.problem.norm(self.driven.run(state).end - state - self.residual)

    def seen(self) -> tuple[np.ndarray, np.ndarray]:
        """(n, points, 2), m: displacements of the named points, from t = 0 on; (n,), N: the contact
        resultant.
        """
        return self.motion.displacements, self.motion.resultant


class UnreducedLinear(Krylov):
    """The linearised equations of a motion: a product is a linearised period."""

    tolerance = LINEAR

    def __init__(self, state: UnreducedState):
        self.state, self.driven, self.sets = state, state.driven, state.motion.sets
        self.rows, self.size, self.comm = len(state.state), state.scale, state.problem.comm

    def products(self, vector: np.ndarray) -> np.ndarray:
        """See `Krylov`."""
        return self.driven.carried(vector, self.sets) - vector

    def nearby(self, right: np.ndarray) -> np.ndarray:
        """See `Krylov`."""
        return self.driven.linear_resolvent(right)

    @functools.cached_property
    def column(self) -> np.ndarray:
        """See `Krylov`."""
        state = self.state
        step = DIFFERENCE * max(abs(state.value), LEAST)
        ahead = state.problem.driven(state.value + step).run(state.state)
        return (ahead.end - state.state - state.residual) / step


class UnreducedSteady(Steady):
    """The periodic motion at a value of the parameter, from the linear response by SNES. Collective.

    Attributes
    ----------
    state : (n,) array
        x(0), this rank's part.
    path : str
        How it was reached: "Newton", or "history" behind some periods that were integrated.

    Raises
    ------
    SolveError
        If Newton's method or a linear solve does not converge.
    """

    iterations = MOST
    subject = "Newton's method on the unreduced model"
    remedy = "take more modes or more stiffness-proportional damping"

    def __init__(self, orbits: UnreducedOrbits, value: float, report: Callable[[float], None] = silent):
        super().__init__()
        self.orbits, self.value, self.comm, self._report = orbits, value, orbits.comm, report
        self._kept: UnreducedState | None = None
        self._product, self._nearby = Operator(), Operator()
        driven = orbits.driven(value)
        guess = driven.linear_state
        norm, failed = max(orbits.norm(guess), 1e-300), list[SolveError]()

        def solved() -> np.ndarray:
            with solving(called()):
                return self.by_snes(guess, RELATIVE, EPSILON * norm, norm)

        for periods, self.path in (0, "Newton"), *((count, "history") for count in SETTLING):
            for _ in range(periods):
                guess = driven.run(guess).end
            found = attempt(solved, SolveError, failed)
            if found is not None:
                self.state = found
                return
        raise failed[-1]

    def _operator(
        self, ksp: PETSc.KSP, pc: PETSc.PC, size: int
    ) -> tuple[PETSc.Mat, tuple[PETSc.Mat | PETSc.PC, ...]]:
        """See `Steady`."""
        matrix = operator(self.comm, size, self._product)
        return matrix, (matrix, preconditioned(ksp, KRYLOV, LINEAR, self._nearby))

    def _monitor(self, snes: PETSc.SNES, iteration: int, residual: float) -> None:
        """The share is that of the digits the residual is to lose."""
        super()._monitor(snes, iteration, residual)
        lost = max(residual, 1e-300) / max(self.residuals[0], 1e-300)
        self._report(min(1.0, max(0.0, math.log(lost) / math.log(RELATIVE))))

    def _at(self, array: np.ndarray) -> UnreducedState:
        same = self._kept is not None and np.array_equal(self._kept.state, array)
        if self._kept is None or self.orbits.sum(float(same)) < self.orbits.comm.size:
            self._kept = self.orbits.at(np.append(array, self.value))
        return self._kept

    def _function(self, snes: PETSc.SNES, x: PETSc.Vec, f: PETSc.Vec) -> None:
        f.array = self._at(x.array_r).residual

    def _jacobian(self, snes: PETSc.SNES, x: PETSc.Vec, matrix: PETSc.Mat, preconditioner: PETSc.Mat) -> None:
        state = self._at(x.array_r)
        if self.residuals[-1] <= NEAR * state.scale:
            rtol, atol, stol, most = snes.getTolerances()
            snes.setTolerances(rtol, max(atol, finite(ROUNDED * state.round_off())), stol, most)
        linear = state.linear()
        self._product.product, self._nearby.product = linear.products, linear.nearby
        matrix.assemble()

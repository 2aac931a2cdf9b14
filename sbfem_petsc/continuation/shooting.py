"""Steady states by SNES (prefix ``shooting_``), and fixed points of a reduced model's `period_map`."""

from __future__ import annotations

import abc
import functools
import math
import sys

import numpy as np

from ..errors import PetscFailure, SolveError, called, failed_solve, on_all_ranks, warn_of_options
from ..motion.period_map import DrivenPeriod, FixedPoint
from ..motion.period_motion import PeriodMotion
from ..petsc import (
    LEFT,
    MPI,
    PETSc,
    asked,
    chosen,
    configure,
    finite,
    free,
    reason_of,
    require_thread,
    scripted,
)
from .linear import PREFIX, Factors, Operator, by_operator, operator, preconditioned
from .newton import ITERATIONS, Updated, attempt
from .problem import GAIN, Lost

# SNES by default: residual relative to the first one, with updated derivatives, which converge more slowly,
# a smaller one, and relative to the state.
RELATIVE, RELATIVE_UPDATED, ROUND_OFF = 1e-10, 1e-11, 1e-12
# The same of a search that hurries, relative to the linear oscillation, and that below which its derivative
# is updated whatever that gains, relative to it.
ENOUGH, CLOSE = 1e-11, 10.0
# Iterations that do not halve the residual, after which a search that hurries is given up.
SLOW = 3
# Unknowns up to which matrices of the period map are made whole.
WHOLE = 1200
# Motions of so many modes and more are first looked for with so many times fewer steps, but so many at least
# to each order of the loads, to this residual relative to the first one; not from a state whose residual is
# no larger than what fewer steps cost.
MANY, COARSER, RESOLVED, ROUGHLY, ROUGH = 20, 8, 64, 1e-3, 1e-3
# Fewer steps at most, for derivatives by them cost more than all else where there are many.
COARSE = 1024


def shoot(
    driven: DrivenPeriod,
    state: np.ndarray,
    jacobian: str = "auto",
    iterations: int | None = None,
    near: np.ndarray | None = None,
    hurries: bool = False,
) -> FixedPoint:
    """Fixed point of a period near a state, by SNES.

    Parameters
    ----------
    driven : DrivenPeriod
    state : (2 m,) array
        First guess of x(0).
    jacobian : {"auto", "dense", "matrix-free", "differences"}
        "dense": the exact derivative as a matrix and its LU factors; "matrix-free": as products, with GMRES
        preconditioned by the motion without contact; "differences": finite differences, an integration for
        each unknown (the paper's way); "auto": matrix-free above 1200 unknowns, otherwise the dense one, with
        Broyden's rank-one updates from an iteration to the next while they gain enough.
    iterations : int, optional
        Newton iterations at most. Default: `newton.ITERATIONS`.
    near : (2 m, 2 m) array, optional
        dx(T) / dx(0) of a motion nearby, to begin with.
    hurries : bool
        Whether Newton's method is given up where it hardly gains.

    Raises
    ------
    SolveError
        If Newton's method does not converge; the message gives the residual.
    PetscFailure
        If the iterations that ``-shooting_snes_max_it`` allows are used up, or another method than Newton's,
        of ``-shooting_snes_type``, does not converge.
    """

    shooting = functools.partial(Shooting, driven, iterations=iterations, hurries=hurries)
    if jacobian != "auto":
        return shooting(jacobian).solve(state)
    if driven.period.unknowns > WHOLE:
        return shooting("matrix-free").solve(state)
    if iterations is None and near is None and driven.period.modes >= MANY:
        found = attempt(functools.partial(_from_fewer_steps, driven, state), SolveError)
        if found is not None:
            return found
    updated = shooting("updated")
    updated.near = None if near is None else near - np.eye(len(state))
    failed = list[SolveError]()
    found = attempt(functools.partial(updated.solve, state), SolveError, failed)
    if found is None and updated.made >= max(len(updated.residuals) - 1, 1):
        raise failed[0]  # none was updated, nor of a motion nearby: the dense way is the same
    return found or shooting("dense").solve(state)


def _from_fewer_steps(driven: DrivenPeriod, state: np.ndarray) -> FixedPoint | None:
    """As `shoot`, by way of the motion with far fewer steps, or by a good guess, where faces rub, of their
    derivative alone; None without any, or by a good guess.
    """
    fewer = in_fewer_steps(driven)
    if fewer is None:
        return None
    rubs = driven.period.friction is not None
    coarse, fine = Shooting(fewer, "updated"), Shooting(driven, "updated", hurries=rubs)
    missed = np.linalg.norm(fine.motion_at(state).residual)
    if missed <= ROUGH * driven.oscillation:
        if not rubs:
            return None
        fine.near = rough_derivative(driven, state) - np.eye(len(state))
        return fine.solve(state)
    coarse.relative = ROUGHLY
    rough = coarse.solve(state).state
    fine.near = coarse.derivative
    nearer = np.linalg.norm(fine.motion_at(rough).residual) <= missed
    return fine.solve(rough if nearer else state)


def in_fewer_steps(driven: DrivenPeriod) -> DrivenPeriod | None:
    """A driven period in far fewer steps, None where these were too coarse."""
    period = driven.period
    steps = max(min(period.steps // COARSER, COARSE), RESOLVED * int(period.excitation.orders.max(initial=1)))
    return None if 2 * steps > period.steps else driven.in_steps(steps)


def rough_derivative(driven: DrivenPeriod, state: np.ndarray) -> np.ndarray:
    """dx(T) / dx(0) near a state where faces rub, of many modes in far fewer steps: in all of them it costs
    several times what they do.
    """
    fewer = (in_fewer_steps(driven) if driven.period.modes >= MANY else None) or driven
    return fewer.carried(fewer.run(state), np.eye(len(state)), rough=True)


class Steady(abc.ABC):
    """SNES on x(T) - x(0) = 0 (prefix ``shooting_``); subclasses say what that is and how it is linearised.

    Attributes
    ----------
    residuals : list of float
        Norm of x(T) - x(0) at each Newton iterate.
    comm : MPI.Comm
    iterations : int
        At most.
    subject, remedy : str
        What has not converged, and what may help, for messages.
    """

    comm: MPI.Comm = MPI.COMM_SELF
    iterations = ITERATIONS
    subject, remedy = "Newton's method", "start from a neighbour, take more steps"

    def __init__(self) -> None:
        self.residuals: list[float] = []

    def by_snes(self, guess: np.ndarray, relative: float, absolute: float, size: float) -> np.ndarray:
        """The solution near a guess, this rank's part of both, to a residual relative to the first one or an
        absolute one; `size` is the motion's, for messages. Collective.
        """
        require_thread()
        self.residuals.clear()
        snes = PETSc.SNES().create(self.comm)
        snes.setOptionsPrefix(PREFIX)
        ksp = snes.getKSP()
        pc = ksp.getPC()
        matrix, in_python = self._operator(ksp, pc, len(guess))
        x, f = matrix.createVecs()
        x.array = guess
        snes.setFunction(self._function, f)
        snes.setJacobian(self._jacobian, matrix)
        snes.setTolerances(rtol=relative, atol=finite(absolute), stol=0.0, max_it=self.iterations)
        try:
            with scripted(*in_python):
                configure(snes)
                # behind the options, of which -shooting_snes_monitor_cancel is one
                snes.setMonitor(self._monitor)
                snes.solve(None, x)
                self._check(snes, max(relative * (self.residuals or [0.0])[0], absolute, LEFT * size), size)
            return x.array_r.copy()
        finally:
            # also what Python alone still holds: PETSc would only put it aside until all ranks collect
            free(self.comm, snes, ksp, pc, x, f, matrix, *in_python)

    def _monitor(self, snes: PETSc.SNES, iteration: int, residual: float) -> None:
        self.residuals.append(float(residual))

    @abc.abstractmethod
    def _operator(
        self, ksp: PETSc.KSP, pc: PETSc.PC, size: int
    ) -> tuple[PETSc.Mat, tuple[PETSc.Mat | PETSc.PC, ...]]:
        """The Jacobian and how it is solved with, and what of it is written in Python."""

    @abc.abstractmethod
    def _function(self, snes: PETSc.SNES, x: PETSc.Vec, f: PETSc.Vec) -> None:
        """f = x(T) - x(0)."""

    @abc.abstractmethod
    def _jacobian(self, snes: PETSc.SNES, x: PETSc.Vec, matrix: PETSc.Mat, preconditioner: PETSc.Mat) -> None:
        """Set what it is at x."""

    def _compare(self, snes: PETSc.SNES, expected: float, size: float) -> None:
        """Warn of what the options of the command line have left of x(T) - x(0) beyond what was expected."""
        missed = snes.getFunction()[0].duplicate()
        snes.computeFunction(snes.getSolution(), missed)  # not all of PETSc's methods do at their end
        left = missed.norm()
        missed.destroy()
        if left > expected:
            warn_of_options(
                f"-{PREFIX}snes_...",
                f"let Newton's method end ({reason_of(snes)}) with x(T) - x(0) at {left / size:.2e} of the "
                "motion's size, so that it is no steady state; leave them out, or ask for less to be left",
            )

    def _check(self, snes: PETSc.SNES, expected: float, size: float) -> None:
        if snes.getConvergedReason() > 0:
            if chosen(f"{PREFIX}snes_"):
                self._compare(snes, expected, size)
            return
        missed = (
            f"x(T) - x(0) is at {snes.getFunctionNorm() / size:.2e} of the motion's size, from "
            f"{(self.residuals or [math.nan])[0] / size:.2e}"
        )
        option, kind, taken = f"{PREFIX}snes_max_it", snes.getType(), snes.getIterationNumber()
        allowed, how = asked(option, 0), f"({reason_of(snes)} after {taken} iterations): {missed}"
        if not kind.startswith("newton"):  # what searches try would fail by it one after the other, for hours
            raise on_all_ranks(
                PetscFailure(
                    f"{called()}: -{PREFIX}snes_type {kind} did not converge {how}; leave the option out for "
                    "Newton's method and what is tried behind it"
                )
            )
        if snes.getConvergedReason() == PETSc.SNES.ConvergedReason.DIVERGED_MAX_IT and allowed is not None:
            raise on_all_ranks(
                PetscFailure(
                    f"{called()}: Newton's method has taken the {taken} iterations that -{option} {allowed} "
                    f"allows: {missed}; allow more, or leave the option out"
                )
            )
        raise failed_solve(
            f"{called()}: {self.subject} did not converge {how}; {self.remedy}, or see "
            f"-{PREFIX}snes_..., -{PREFIX}ksp_..."
        )


class Shooting(Steady):
    """SNES on x(T) - x(0) of a driven period.

    Parameters
    ----------
    driven : DrivenPeriod
    jacobian : {"updated", "dense", "matrix-free", "differences"}
    iterations : int, optional
    hurries : bool
    """

    def __init__(
        self, driven: DrivenPeriod, jacobian: str, iterations: int | None = None, hurries: bool = False
    ):
        super().__init__()
        self.driven, self.jacobian = driven, jacobian
        self.iterations = iterations or self.iterations
        self.relative = RELATIVE_UPDATED if jacobian == "updated" else RELATIVE
        # of what is missed an iteration with an updated derivative may leave so much
        self.gain = GAIN
        # whether a search that hardly gains is given up, and the residual that is enough to it: near a good
        # guess what is relative to the first one is rounding, for which derivatives would be made anew
        self.hurries, self.enough = hurries, ENOUGH * hurries * driven.oscillation
        # derivative of x(T) - x(0) to begin with, and the last iteration's
        self.near: np.ndarray | None = None
        self.derivative: np.ndarray | None = None
        # derivatives made
        self.made = 0
        # the inverse of the updated one, and whether it is that of the matrix PETSc solves with
        self.inverse = Updated(Factors(np.eye(1)))
        self.known = False
        self._key: bytes | None = None
        self._linearised: PeriodMotion | None = None
        self._last: tuple[np.ndarray, np.ndarray] | None = None

    def solve(self, state: np.ndarray) -> FixedPoint:
        """The fixed point near a state."""
        require_thread()
        if self.jacobian == "updated" and asked(f"{PREFIX}snes_test_jacobian") is not None:
            self.jacobian = "dense"  # PETSc's test is of the derivative, and not of updates of it
        driven = self.driven
        moving = max(driven.period.size(state), driven.oscillation, 1e-300)
        largest = max(float(np.linalg.norm(driven.linear_state)), float(np.linalg.norm(state)), 1e-300)
        try:
            found = self.by_snes(state, self.relative, max(ROUND_OFF * largest, self.enough), moving)
        except (PETSc.Error, Lost) as error:
            why = f"PETSc's error {error.ierr}" if isinstance(error, PETSc.Error) else error
            raise failed_solve(
                f"{called()}: the linear system of Newton's method cannot be solved ({why}): an undamped "
                "resonance, or a motion as a rigid body, leaves the periodic motion undetermined"
            ) from None
        return FixedPoint(found, driven, self.motion_at(found), tuple(self.residuals))

    def _operator(
        self, ksp: PETSc.KSP, pc: PETSc.PC, size: int
    ) -> tuple[PETSc.Mat, tuple[PETSc.Mat | PETSc.PC, ...]]:
        """See `Steady`: for its kind."""
        if self.jacobian == "matrix-free":
            matrix, nearby = operator(self.comm, size, Operator(self._product)), self.driven.linear_resolvent
            return matrix, (matrix, preconditioned(ksp, min(size, 200), 1e-11, Operator(nearby)))
        matrix = PETSc.Mat().createDense([size, size], comm=PETSc.COMM_SELF)
        matrix.setUp()
        ksp.setType(PETSc.KSP.Type.PREONLY)
        if self.jacobian != "updated":
            pc.setType(PETSc.PC.Type.LU)
            return matrix, ()
        update = Operator(lambda vector: self.inverse.solve(vector), self._renew)
        return matrix, (by_operator(pc, update),)

    def _product(self, vector: np.ndarray) -> np.ndarray:
        """Phi - 1 along a vector: one linearised period."""
        assert self._linearised is not None  # PETSc has asked for the derivative
        return self.driven.carried(self._linearised, vector[:, None])[:, 0] - vector

    def _renew(self, pc: PETSc.PC) -> None:
        """Factors of a matrix of PETSc's own, such as that of -shooting_snes_fd."""
        if not self.known:
            self.inverse = Updated(Factors(pc.getOperators()[1].getDenseArray()))
        self.known = False

    def motion_at(self, array: np.ndarray) -> PeriodMotion:
        """From a state; the last one is known."""
        key = array.tobytes()
        if key != self._key:
            self._key, self._kept = key, self.driven.run(array)
        return self._kept

    def _function(self, snes: PETSc.SNES, x: PETSc.Vec, f: PETSc.Vec) -> None:
        f.array[:] = self.motion_at(x.array_r).residual

    def _jacobian(self, snes: PETSc.SNES, x: PETSc.Vec, matrix: PETSc.Mat, preconditioner: PETSc.Mat) -> None:
        motion, state = self.motion_at(x.array_r), x.array_r.copy()
        if self.hurries and self.residuals[-1] > 0.5 * min(self.residuals[:-SLOW], default=math.inf):
            raise SolveError(f"{called()}: Newton's method hardly gains")
        if self.jacobian == "matrix-free":
            self._linearised = motion
        elif self.jacobian == "differences":
            self._by_differences(state, motion, matrix.getDenseArray())
        elif self.jacobian == "dense":
            matrix.getDenseArray()[:] = self._held(self._derivative(motion, rough=False))
        else:
            self._by_update(state, motion, matrix.getDenseArray())
        matrix.assemble()

    def _derivative(self, motion: PeriodMotion, rough: bool = True) -> np.ndarray:
        unit = np.eye(len(motion.residual))
        self.made += 1
        return self.driven.carried(motion, unit, rough=rough) - unit

    def _held(self, array: np.ndarray, rounding: float = sys.float_info.epsilon) -> np.ndarray:
        """A derivative by which places that nothing holds, of rigid-body motions that are free or slip, stay
        what they are: their pivot would be rounding alone, and a step would go anywhere.
        """
        if self.driven.period.reduced.omega.all():
            return array
        left, values, right = np.linalg.svd(array)
        free = values <= len(array) * rounding * values[0]
        return array + values[0] * left[:, free] @ right[free]

    def _by_differences(self, state: np.ndarray, motion: PeriodMotion, array: np.ndarray) -> None:
        step = np.sqrt(np.finfo(float).eps) * max(
            np.linalg.norm(state), np.linalg.norm(self.driven.linear_state), 1e-300
        )
        for k, unit in enumerate(np.eye(len(state))):
            array[:, k] = (self.driven.run(state + step * unit).residual - motion.residual) / step
        # slips that stay what they are, see `DrivenPeriod.carried`
        stay = ~array.any(axis=1)
        array[stay, stay] = -1.0
        array[:] = self._held(array, math.sqrt(sys.float_info.epsilon))

    def _by_update(self, state: np.ndarray, motion: PeriodMotion, array: np.ndarray) -> None:
        """Broyden's update of the last iteration's derivative, if that was good enough."""
        residual, last = motion.residual, self._last
        if last is None:
            array[:] = self._held(self._derivative(motion) if self.near is None else self.near)
            self.inverse = Updated(Factors(array))
        elif np.linalg.norm(residual) <= max(self.gain * np.linalg.norm(last[1]), CLOSE * self.enough):
            step = state - last[0]
            row = step / (step @ step)
            added = residual - last[1] - array @ step
            array += np.outer(added, row)
            self.inverse.add(added, row)
        else:
            array[:] = self._held(self._derivative(motion))
            self.inverse = Updated(Factors(array))
        self._last, self.known, self.derivative = (state, residual), True, array.copy()

"""Fixed points of the period of a reduced model (`period_map`) by SNES (prefix ``shooting_``)."""

from __future__ import annotations

import functools
import math

import numpy as np
from scipy import linalg

from ..errors import SolveError, on_all_ranks
from ..petsc import PETSc, configure
from .period_map import DrivenPeriod, Period, PeriodMotion

# SNES by default: residual relative to the first one, relative to the state, and Newton iterations.
RELATIVE, ROUND_OFF, ITERATIONS = 1e-10, 1e-12, 30
# An iteration with an updated derivative that gains less than this factor is the last one with it; so
# converging more slowly, a smaller residual is asked for.
GAIN, RELATIVE_UPDATED = 0.3, 1e-11
# Residual relative to the linear state at which a fixed point nearby is taken.
NEARBY = 1e-8
PREFIX = "shooting_"
JACOBIANS = ("auto", "dense", "matrix-free", "differences")
# Unknowns up to which matrices of the period map are made whole.
WHOLE = 1200
# Motions of so many modes and more are first looked for with so many times fewer steps, but so many at least
# to each order of the loads, to this residual relative to the first one; not from a state whose residual is
# no larger than what fewer steps cost.
MANY, COARSER, RESOLVED, ROUGHLY, ROUGH = 20, 8, 64, 1e-3, 1e-3
# The curve's points are solved to this residual relative to the state.
ALONG = 1e-10


class FixedPoint:
    """A fixed point of a period.

    Attributes
    ----------
    state : (2 m,) array
        x(0).
    parameters : (e,) array
        Values of the free parameters.
    driven : DrivenPeriod
    motion : PeriodMotion
    residuals : tuple of float
        Norm of x(T) - x(0), and of the conditions on the parameters, at each Newton iterate.
    derivatives : int
        How many of the iterations had a derivative of their own.
    """

    def __init__(
        self,
        state: np.ndarray,
        parameters: np.ndarray,
        driven: DrivenPeriod,
        motion: PeriodMotion,
        residuals: tuple[float, ...],
        derivatives: int = 0,
    ):
        self.state, self.parameters, self.residuals = state, parameters, residuals
        self.derivatives = derivatives
        self._driven: DrivenPeriod | None = driven
        self._motion: PeriodMotion | None = motion
        self._conditions = driven.period, driven.frequency, driven.factor

    @property
    def driven(self) -> DrivenPeriod:
        """The period at the point's conditions."""
        if self._driven is None:
            period, frequency, factor = self._conditions
            return period.at(frequency, factor)
        return self._driven

    @property
    def motion(self) -> PeriodMotion:
        """One period from the state."""
        return self.driven.run(self.state) if self._motion is None else self._motion

    @functools.cached_property
    def monodromy(self) -> np.ndarray:
        """(2 m, 2 m): dx(T) / dx(0), with switches located inside their steps."""
        return self.driven.monodromy(self.motion)

    def forget(self) -> None:
        """Let go of what takes memory; it is computed again where it is asked for."""
        self._driven = self._motion = None

    @property
    def effort(self) -> float:
        """Newton iterations; three with an updated derivative count as one."""
        return self.derivatives + (len(self.residuals) - 1 - self.derivatives) / 3.0


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
        newton = _Newton(period, kind, (), None, iterations)
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
    coarse = _Newton(period.in_steps(steps), "updated", (), None)
    coarse.relative = ROUGHLY
    fine = _Newton(period, "updated", (), None)
    try:
        residual = driven.run(state).residual
        if np.linalg.norm(residual) <= ROUGH * np.linalg.norm(driven.linear_state):
            return None
        rough = coarse.solve(state, lambda _: coarse.period.at(frequency, factor), np.zeros(0))
        fine.near = coarse.derivative
        return fine.solve(rough.state, lambda _: driven, np.zeros(0))
    except SolveError:
        return None


def shoot_along(
    period: Period,
    state: np.ndarray,
    value: float,
    driven,
    name: str,
    condition,
    near: np.ndarray | None = None,
) -> FixedPoint:
    """Fixed point with one free parameter and one condition.

    Parameters
    ----------
    period : Period
    state : (2 m,) array
        First guess of x(0).
    value : float
        First guess of the parameter.
    driven : callable
        DrivenPeriod of a parameter's value.
    name : {"frequency", "load"}
    condition : callable
        (state, change of the parameter) -> (c, row (2 m,), slope): the condition c = 0 and its derivatives.
    near : (2 m, 2 m + 1) array, optional
        Derivative of x(T) at a fixed point nearby, to begin with.
    """
    first = np.array([value])
    if near is not None:
        newton = _Newton(period, "updated", (name,), condition)
        newton.near, newton.absolute = near, ALONG
        try:
            return newton.solve(state, lambda p: driven(float(p[0])), first)
        except SolveError:
            pass
    return _Newton(period, "dense", (name,), condition).solve(state, lambda p: driven(float(p[0])), first)


def shoot_nearby(driven: DrivenPeriod, state: np.ndarray, derivative: np.ndarray) -> FixedPoint | None:
    """Fixed point very near a state, by Newton's method with a derivative of the period that is known about:
    that of a motion nearby, dx(T) / dx(0). None unless each iterate is at least ten times better.

    To 1e-8 of the linear state, for which a few periods are integrated and no derivative is made.
    """
    factors = linalg.lu_factor(derivative - np.eye(len(state)))
    aim, residuals = NEARBY * np.linalg.norm(driven.linear_state), []
    while True:
        motion = driven.run(state)
        residuals.append(float(np.linalg.norm(motion.residual)))
        if residuals[-1] <= aim:
            return FixedPoint(state, np.zeros(0), driven, motion, tuple(residuals))
        if len(residuals) > 1 and residuals[-1] > 0.1 * residuals[-2]:
            return None
        state = state - linalg.lu_solve(factors, motion.residual)


class _Newton:
    """SNES on the residual of a period and conditions on its free parameters."""

    def __init__(
        self,
        period: Period,
        jacobian: str,
        parameters: tuple[str, ...],
        condition,
        iterations: int | None = None,
    ):
        self.iterations = ITERATIONS if iterations is None else iterations
        self.period, self.jacobian, self.parameters, self.condition = period, jacobian, parameters, condition
        self.residuals: list[float] = []
        self.key: bytes | None = None
        self.relative, self.absolute = RELATIVE_UPDATED if jacobian == "updated" else RELATIVE, ROUND_OFF
        # derivative of x(T) to begin with, and that of the last iteration
        self.near: np.ndarray | None = None
        self.derivative: np.ndarray | None = None
        self.derivatives = 0
        self.last: tuple[np.ndarray, np.ndarray] | None = None

    def solve(self, state: np.ndarray, driven, values: np.ndarray) -> FixedPoint:
        m2, size = 2 * self.period.modes, 2 * self.period.modes + len(values)
        # parameters are solved for by their change, which rounding leaves more digits, in a unit that makes
        # all unknowns of one order
        self.driven, self.first = driven, values
        self.scale = (
            max(float(np.linalg.norm(state)), float(np.linalg.norm(driven(values).linear_state)), 1e-300)
            / max(abs(float(values[0])), 1e-300)
            if len(values)
            else 1.0
        )
        snes = PETSc.SNES().create(PETSc.COMM_SELF)
        snes.setOptionsPrefix(PREFIX)
        x, f = PETSc.Vec().createSeq(size), PETSc.Vec().createSeq(size)
        x.array = np.concatenate([state, np.zeros(len(values))])
        snes.setFunction(self._function, f)
        ksp = snes.getKSP()
        if self.jacobian == "matrix-free":
            matrix = PETSc.Mat().createPython([size, size], context=_Products(self), comm=PETSc.COMM_SELF)
            matrix.setUp()
            ksp.setType(PETSc.KSP.Type.GMRES)
            ksp.setGMRESRestart(min(size, 200))
            ksp.setTolerances(rtol=1e-11, max_it=2 * size)
            ksp.getPC().setType(PETSc.PC.Type.PYTHON)
            ksp.getPC().setPythonContext(_Uncoupled(self))
        else:
            matrix = PETSc.Mat().createDense([size, size], comm=PETSc.COMM_SELF)
            matrix.setUp()
            ksp.setType(PETSc.KSP.Type.PREONLY)
            ksp.getPC().setType(PETSc.PC.Type.LU)
        snes.setJacobian(self._jacobian, matrix)
        size_of_state = float(np.linalg.norm(driven(values).linear_state))
        snes.setTolerances(
            rtol=self.relative,
            atol=self.absolute * max(size_of_state, float(np.linalg.norm(state)), 1e-300),
            stol=0.0,
            max_it=self.iterations,
        )
        snes.setMonitor(lambda _, iteration, norm: self.residuals.append(float(norm)))
        configure(snes)
        try:
            try:
                snes.solve(None, x)
            except PETSc.Error as error:
                raise on_all_ranks(
                    SolveError(
                        "periodic: the linear system of Newton's method cannot be solved (PETSc's error "
                        f"{error.ierr}): an undamped resonance, or a motion as a rigid body, leaves the "
                        "periodic motion undetermined"
                    )
                ) from None
            self._check(snes, size_of_state)
            state, values = x.array_r[:m2].copy(), self.first + x.array_r[m2:] / self.scale
            driven, motion = self._motion(x.array_r)
            if self.jacobian == "updated" and self.last is not None:
                self.derivative = matrix.getDenseArray() + np.eye(size)
        finally:
            # also what Python alone still holds: PETSc would only put it aside until all ranks collect
            for item in (snes, ksp, x, f, matrix):
                item.destroy()
        own = self.derivatives if self.jacobian == "updated" else len(self.residuals) - 1
        return FixedPoint(state, values, driven, motion, tuple(self.residuals), own)

    def _motion(self, array: np.ndarray) -> tuple[DrivenPeriod, PeriodMotion]:
        key = array.tobytes()
        if key != self.key:
            m2 = 2 * self.period.modes
            driven = self.driven(self.first + array[m2:] / self.scale)
            self.key, self.kept = key, (driven, driven.run(array[:m2]))
        return self.kept

    def _function(self, snes, x, f) -> None:
        f.array[:] = self._residual(x.array_r)

    def _residual(self, array: np.ndarray) -> np.ndarray:
        m2 = 2 * self.period.modes
        _, motion = self._motion(array)
        if self.condition is None:
            return motion.residual
        return np.append(motion.residual, self.condition(array[:m2], float(array[m2] / self.scale))[0])

    def _jacobian(self, snes, x, matrix, preconditioner) -> None:
        if self.jacobian == "matrix-free":
            matrix.getPythonContext().at = self._motion(x.array_r)
        elif self.jacobian == "differences":
            self._by_differences(x.array_r.copy(), matrix.getDenseArray())
        elif self.jacobian == "dense":
            self._by_derivative(x.array_r, matrix.getDenseArray())
        else:
            self._by_update(x.array_r.copy(), matrix.getDenseArray())
        matrix.assemble()

    def _by_differences(self, state: np.ndarray, array: np.ndarray) -> None:
        driven, motion = self._motion(state)
        step = np.sqrt(np.finfo(float).eps) * max(
            np.linalg.norm(state), np.linalg.norm(driven.linear_state), 1e-300
        )
        for k, unit in enumerate(np.eye(len(state))):
            array[:, k] = (driven.run(state + step * unit).residual - motion.residual) / step

    def _by_derivative(self, x: np.ndarray, array: np.ndarray, near: np.ndarray | None = None) -> None:
        """The exact derivative, or one of x(T) that is given."""
        m2 = 2 * self.period.modes
        if near is None:
            driven, motion = self._motion(x)
            near = driven.carried(motion, np.eye(m2), self.parameters)
            self.derivatives += 1
        array[:m2] = near
        array[:m2, :m2] -= np.eye(m2)
        array[:m2, m2:] /= self.scale
        if self.condition is not None:
            _, row, slope = self.condition(x[:m2], float(x[m2] / self.scale))
            array[m2, :m2], array[m2, m2] = row, slope / self.scale

    def _by_update(self, x: np.ndarray, array: np.ndarray) -> None:
        """Broyden's update of the last iteration's derivative, if that was good enough."""
        residual = self._residual(x)
        if self.last is None:
            self._by_derivative(x, array, self.near)
        else:
            step, change = x - self.last[0], residual - self.last[1]
            if np.linalg.norm(residual) <= GAIN * np.linalg.norm(self.last[1]):
                array += np.outer((change - array @ step) / (step @ step), step)
            else:
                self._by_derivative(x, array)
        self.last = x, residual

    def _check(self, snes, size: float) -> None:
        reason = snes.getConvergedReason()
        if reason > 0:
            return
        raise on_all_ranks(
            SolveError(
                f"periodic: Newton's method did not converge ({snes_reason(reason)} after "
                f"{snes.getIterationNumber()} iterations): x(T) - x(0) is at "
                f"{snes.getFunctionNorm() / max(size, 1e-300):.2e} of the linear state's size, from "
                f"{(self.residuals or [math.nan])[0] / max(size, 1e-300):.2e}; start from a neighbour, take "
                f"more steps, or see -{PREFIX}snes_..."
            )
        )


def snes_reason(reason: int) -> str:
    """PETSc's name of a reason for which SNES stopped."""
    return next(
        (
            name
            for name, value in vars(PETSc.SNES.ConvergedReason).items()
            if isinstance(value, int) and value == reason
        ),
        str(reason),
    )


class _Products:
    """Phi - 1 as products: one linearised period each."""

    at: tuple[DrivenPeriod, PeriodMotion]

    def __init__(self, newton: _Newton):
        self.newton = newton

    def mult(self, matrix, x, y) -> None:
        driven, motion = self.at
        vector = x.array_r[:, None]
        y.array[:] = (driven.carried(motion, vector) - vector)[:, 0]


class _Uncoupled:
    """Preconditioner: the motion without contact, closed form."""

    def __init__(self, newton: _Newton):
        self.newton = newton

    def setUp(self, pc) -> None:
        pass

    def apply(self, pc, x, y) -> None:
        driven, _ = self.newton.kept
        y.array[:] = driven.linear_resolvent(x.array_r)

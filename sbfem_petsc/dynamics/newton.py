"""Newton's method for the period of a reduced model by SNES (prefix ``shooting_``)."""

from __future__ import annotations

import math

import numpy as np
from scipy import linalg

from ..errors import SolveError, on_all_ranks
from ..petsc import PETSc, configure, finite, require_thread, scripted
from .fixed_point import FixedPoint, effort
from .period_map import DrivenPeriod, Period, PeriodMotion

# SNES by default: residual relative to the first one, relative to the state, and Newton iterations.
RELATIVE, ROUND_OFF, ITERATIONS = 1e-10, 1e-12, 30
# An iteration with an updated derivative that gains less than this factor is the last one with it; so
# converging more slowly, a smaller residual is asked for.
GAIN, RELATIVE_UPDATED = 0.3, 1e-11
PREFIX = "shooting_"


class TooManyIterations(SolveError):
    """Newton's method has taken more iterations than it was to."""


class Newton:
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
        self.relative = RELATIVE_UPDATED if jacobian == "updated" else RELATIVE
        # change of the unknowns, relative to the motion's size, after which an iterate is taken
        self.settled = 0.0
        # derivative of x(T) to begin with, iterations at which to give up, the last one's derivative
        self.near: np.ndarray | None = None
        self.most = math.inf
        self.derivative: np.ndarray | None = None
        self.derivatives = 0
        self.last: tuple[np.ndarray, np.ndarray] | None = None
        self.inverse = _Updated()

    def solve(self, state: np.ndarray, driven, values: np.ndarray) -> FixedPoint:
        require_thread()
        m2, size = 2 * self.period.modes, 2 * self.period.modes + len(values)
        # parameters are solved for by their change, which rounding leaves more digits, in a unit that makes
        # all unknowns of one order
        self.driven, self.first = driven, values
        moving = max(self.period.size(state), driven(values).oscillation, 1e-300)
        self.scale = moving / max(abs(float(values[0])), 1e-300) if len(values) else 1.0
        snes = PETSc.SNES().create(PETSc.COMM_SELF)
        snes.setOptionsPrefix(PREFIX)
        x, f = PETSc.Vec().createSeq(size), PETSc.Vec().createSeq(size)
        x.array = np.concatenate([state, np.zeros(len(values))])
        snes.setFunction(self._function, f)
        ksp = snes.getKSP()
        pc = ksp.getPC()
        in_python: tuple[PETSc.Mat | PETSc.PC, ...] = ()
        if self.jacobian == "matrix-free":
            matrix = PETSc.Mat().createPython([size, size], context=_Products(self), comm=PETSc.COMM_SELF)
            matrix.setUp()
            ksp.setType(PETSc.KSP.Type.GMRES)
            ksp.setGMRESRestart(min(size, 200))
            ksp.setTolerances(rtol=1e-11, max_it=2 * size)
            pc.setType(PETSc.PC.Type.PYTHON)
            pc.setPythonContext(_Uncoupled(self))
            in_python = matrix, pc
        else:
            matrix = PETSc.Mat().createDense([size, size], comm=PETSc.COMM_SELF)
            matrix.setUp()
            ksp.setType(PETSc.KSP.Type.PREONLY)
            if self.jacobian == "updated":
                pc.setType(PETSc.PC.Type.PYTHON)
                pc.setPythonContext(self.inverse)
                in_python = (pc,)
            else:
                pc.setType(PETSc.PC.Type.LU)
        snes.setJacobian(self._jacobian, matrix)
        size_of_state = float(np.linalg.norm(driven(values).linear_state))
        snes.setTolerances(
            rtol=self.relative,
            atol=finite(ROUND_OFF * max(size_of_state, float(np.linalg.norm(state)), 1e-300)),
            stol=self.settled * min(1.0, moving / max(float(np.linalg.norm(state)), 1e-300)),
            max_it=self.iterations,
        )
        snes.setMonitor(lambda _, iteration, norm: self.residuals.append(float(norm)))
        try:
            try:
                with scripted(*in_python):
                    configure(snes)
                    snes.solve(None, x)
            except (PETSc.Error, np.linalg.LinAlgError) as error:
                why = f"PETSc's error {error.ierr}" if isinstance(error, PETSc.Error) else error
                raise on_all_ranks(
                    SolveError(
                        f"periodic: the linear system of Newton's method cannot be solved ({why}): an "
                        "undamped resonance, or a motion as a rigid body, leaves the periodic motion "
                        "undetermined"
                    )
                ) from None
            self._check(snes, moving)
            state, values = x.array_r[:m2].copy(), self.first + x.array_r[m2:] / self.scale
            driven, motion = self._motion(x.array_r)
            if self.jacobian == "updated" and self.last is not None:
                self.derivative = matrix.getDenseArray() + np.eye(size)
        finally:
            # also what Python alone still holds: PETSc would only put it aside until all ranks collect
            for item in (snes, ksp, pc, x, f, matrix):
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
        if effort(len(self.residuals), self.derivatives) > self.most:
            raise on_all_ranks(
                TooManyIterations(f"periodic: Newton's method takes more than {self.most:g} iterations")
            )
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
            self.inverse.begin(array)
        else:
            step, change = x - self.last[0], residual - self.last[1]
            if np.linalg.norm(residual) <= GAIN * np.linalg.norm(self.last[1]):
                added = (change - array @ step) / (step @ step)
                array += np.outer(added, step)
                self.inverse.add(added, step)
            else:
                self._by_derivative(x, array)
                self.inverse.begin(array)
        self.last = x, residual

    def _check(self, snes, size: float) -> None:
        reason = snes.getConvergedReason()
        if reason > 0:
            return
        raise on_all_ranks(
            SolveError(
                f"periodic: Newton's method did not converge ({snes_reason(reason)} after "
                f"{snes.getIterationNumber()} iterations): x(T) - x(0) is at "
                f"{snes.getFunctionNorm() / max(size, 1e-300):.2e} of the motion's size, from "
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


class _Updated:
    """Inverse of a matrix that dyads have been added to, by Sherman and Morrison's formula."""

    known = False

    def begin(self, matrix: np.ndarray) -> None:
        """Factorise a matrix.

        Raises
        ------
        LinAlgError
            If it is singular.
        """
        self._lu, self._exchanged, singular = linalg.lapack.dgetrf(matrix)
        if singular:
            raise np.linalg.LinAlgError(f"pivot {singular} of {len(matrix)} is zero")
        self._dyads: list[tuple[np.ndarray, np.ndarray]] = []
        self.known = True

    def add(self, left: np.ndarray, right: np.ndarray) -> None:
        """Add left right^T."""
        solved = self.solve(left)
        self._dyads.append((solved / (1.0 + right @ solved), right))
        self.known = True

    def solve(self, vector: np.ndarray) -> np.ndarray:
        """The inverse times a vector."""
        result, _ = linalg.lapack.dgetrs(self._lu, self._exchanged, vector)
        for solved, right in self._dyads:
            result -= solved * (right @ result)
        return result

    def setUp(self, pc) -> None:
        if not self.known:  # a matrix of PETSc's own, such as that of -shooting_snes_fd
            self.begin(pc.getOperators()[1].getDenseArray())
        self.known = False

    def apply(self, pc, x, y) -> None:
        y.array[:] = self.solve(x.array_r)


class _Products:
    """Phi - 1 as products: one linearised period each."""

    at: tuple[DrivenPeriod, PeriodMotion]

    def __init__(self, newton: Newton):
        self.newton = newton

    def mult(self, matrix, x, y) -> None:
        driven, motion = self.at
        vector = x.array_r[:, None]
        y.array[:] = (driven.carried(motion, vector) - vector)[:, 0]


class _Uncoupled:
    """Preconditioner: the motion without contact, closed form."""

    def __init__(self, newton: Newton):
        self.newton = newton

    def setUp(self, pc) -> None:
        pass

    def apply(self, pc, x, y) -> None:
        driven, _ = self.newton.kept
        y.array[:] = driven.linear_resolvent(x.array_r)

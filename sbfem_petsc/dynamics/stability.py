"""Floquet multipliers of a periodic motion and the verdict on its stability; SLEPc's prefix is
``floquet_``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..errors import SolveError, on_all_ranks
from ..petsc import PETSc, SLEPc
from .shooting import WHOLE, DrivenPeriod, PeriodMotion

PREFIX = "floquet_"
# With little damping all multipliers lie near the unit circle: only a large subspace finds those of the
# largest modulus.
LARGEST, SUBSPACE = 6, 400


@dataclass(frozen=True, eq=False)
class Multipliers:
    """Eigenvalues of the monodromy, by falling modulus.

    Attributes
    ----------
    values : (k,) complex array
    vectors : (2 m, k) complex array
        In the state x = (Omega q, q').
    """

    values: np.ndarray
    vectors: np.ndarray


def multipliers(driven: DrivenPeriod, motion: PeriodMotion, whole: bool | None = None) -> Multipliers:
    """Floquet multipliers of a periodic motion.

    Parameters
    ----------
    driven, motion : DrivenPeriod, PeriodMotion
        Of a converged fixed point.
    whole : bool, optional
        All of them from the monodromy matrix by LAPACK, or the largest by Krylov-Schur on products with it.
        Default: all up to 1200 unknowns.

    Raises
    ------
    SolveError
        If SLEPc finds fewer than were asked for.
    """
    size = 2 * driven.period.modes
    whole = size <= WHOLE if whole is None else whole
    if whole:
        matrix = PETSc.Mat().createDense(
            [size, size], array=np.asfortranarray(driven.monodromy(motion)), comm=PETSc.COMM_SELF
        )
    else:
        matrix = PETSc.Mat().createPython(
            [size, size], context=_Monodromy(driven, motion), comm=PETSc.COMM_SELF
        )
        matrix.setUp()
    solver = SLEPc.EPS().create(PETSc.COMM_SELF)
    solver.setOptionsPrefix(PREFIX)
    solver.setOperators(matrix)
    solver.setProblemType(SLEPc.EPS.ProblemType.NHEP)
    solver.setWhichEigenpairs(SLEPc.EPS.Which.LARGEST_MAGNITUDE)
    wanted = size if whole else min(LARGEST, size)
    if whole:
        solver.setType(SLEPc.EPS.Type.LAPACK)
    solver.setDimensions(wanted, min(size, SUBSPACE))
    solver.setTolerances(tol=1e-10, max_it=10000)
    solver.setFromOptions()
    try:
        solver.solve()
        found = solver.getConverged()
        if found < min(wanted, solver.getDimensions()[0]):
            raise on_all_ranks(
                SolveError(
                    f"Floquet multipliers: SLEPc found {found} of {wanted} (reason "
                    f"{solver.getConvergedReason()} after {solver.getIterationNumber()} iterations); see "
                    f"-{PREFIX}eps_..."
                )
            )
        values = np.array([solver.getEigenvalue(k) for k in range(found)])
        real, imaginary = matrix.createVecs()
        vectors = np.empty((size, found), dtype=complex)
        for k in range(found):
            solver.getEigenvector(k, real, imaginary)
            vectors[:, k] = real.array_r + 1j * imaginary.array_r
        real.destroy()
        imaginary.destroy()
    finally:
        solver.destroy()
        matrix.destroy()
    order = np.argsort(-np.abs(values), kind="stable")
    return Multipliers(values[order], vectors[:, order])


class _Monodromy:
    """dx(T) / dx(0) as products."""

    def __init__(self, driven: DrivenPeriod, motion: PeriodMotion):
        self.driven, self.motion = driven, motion

    def mult(self, matrix, x, y) -> None:
        y.array[:] = self.driven.carried(self.motion, x.array_r[:, None], located=True)[:, 0]

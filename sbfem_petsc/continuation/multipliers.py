"""Floquet multipliers of a periodic motion: all of them by LAPACK, or the largest by SLEPc (prefix
``floquet_``).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy import linalg

from ..errors import SolveError, on_all_ranks
from ..motion.period_map import DrivenPeriod, FixedPoint
from ..motion.period_motion import PeriodMotion
from ..petsc import PETSc, SLEPc, configure, scripted, stepping
from .shooting import WHOLE

PREFIX = "floquet_"
# With little damping all multipliers lie near the unit circle: only a large subspace finds those of the
# largest modulus.
LARGEST, SUBSPACE = 6, 400


class Multipliers:
    """Eigenvalues of the monodromy, by falling modulus.

    Parameters
    ----------
    values : (k,) complex array
    direction : callable
        The eigenvector of the k-th value, (2 m,) complex of unit length, in the state x = (Omega q, q'), a
        Floquet direction; its largest component is real and positive.
    monodromy : (2 m, 2 m) array or None
        Where it was made whole.
    """

    def __init__(
        self,
        values: np.ndarray,
        direction: Callable[[int], np.ndarray],
        monodromy: np.ndarray | None = None,
    ):
        self.values, self.monodromy = values, monodromy
        self._direction = direction

    def direction(self, k: int) -> np.ndarray:
        """(2 m,) complex: the Floquet direction of the k-th value."""
        found = self._direction(k)
        largest = found[np.abs(found).argmax()]
        return found * (largest.conjugate() / abs(largest) / np.linalg.norm(found))


def multipliers(
    driven: DrivenPeriod,
    motion: PeriodMotion,
    whole: bool | None = None,
    monodromy: Callable[[], np.ndarray] | None = None,
) -> Multipliers:
    """Floquet multipliers of a periodic motion.

    Parameters
    ----------
    driven, motion : DrivenPeriod, PeriodMotion
        Of a converged fixed point.
    whole : bool, optional
        All of them from the monodromy matrix by LAPACK, or the largest by SLEPc's Krylov-Schur method on
        products with it. Default: all up to 1200 unknowns.

    Raises
    ------
    SolveError
        If SLEPc finds fewer than were asked for.
    """
    size = driven.period.unknowns
    if size > WHOLE if whole is None else not whole:
        return _largest(driven, motion, size)
    matrix = driven.monodromy(motion) if monodromy is None else monodromy()
    values = eigenvalues(matrix)
    order = np.argsort(-np.abs(values), kind="stable")
    values = values[order]
    return Multipliers(values, lambda k: inverse_iteration(matrix, values[k]), matrix)


def eigenvalues(matrix: np.ndarray) -> np.ndarray:
    """All eigenvalues of a real matrix by LAPACK, complex. Zero stands by itself for each row or column of
    zeros, those of slips that are forgotten.
    """
    acts = matrix.any(axis=0) & matrix.any(axis=1)
    n = int(acts.sum())
    if n < len(matrix):
        return np.append(eigenvalues(matrix[np.ix_(acts, acts)]), np.zeros(len(matrix) - n))
    return linalg.eigvals(matrix, check_finite=False) if n else np.zeros(0, dtype=complex)


def multipliers_of(fixed: FixedPoint) -> Multipliers:
    """Those of a fixed point, whose monodromy matrix is made once."""
    return multipliers(fixed.driven, fixed.motion, monodromy=lambda: fixed.monodromy)


def inverse_iteration(matrix: np.ndarray, value: complex) -> np.ndarray:
    """Eigenvector of a value that is known to rounding."""
    shifted = matrix - (value if value.imag else value.real) * np.eye(len(matrix))
    factorise = linalg.lapack.zgetrf if np.iscomplexobj(shifted) else linalg.lapack.dgetrf
    factors, exchanged, _ = factorise(shifted)
    # as LAPACK's own inverse iteration does: pivots that are rounding alone, or less, stand for it
    rounding = np.finfo(float).eps * max(float(np.abs(matrix).max()), 1e-100)
    small = np.flatnonzero(np.abs(np.diagonal(factors)) < rounding)
    factors[small, small] = rounding
    vector = np.ones(len(matrix))
    for _ in range(3):
        vector = linalg.lu_solve((factors, exchanged), vector / np.linalg.norm(vector), check_finite=False)
    return vector.astype(complex)


def _largest(driven: DrivenPeriod, motion: PeriodMotion, size: int) -> Multipliers:
    matrix = PETSc.Mat().createPython([size, size], context=_Monodromy(driven, motion), comm=PETSc.COMM_SELF)
    matrix.setUp()
    solver = SLEPc.EPS().create(PETSc.COMM_SELF)
    solver.setOptionsPrefix(PREFIX)
    solver.setOperators(matrix)
    solver.setProblemType(SLEPc.EPS.ProblemType.NHEP)
    solver.setWhichEigenpairs(SLEPc.EPS.Which.LARGEST_MAGNITUDE)
    wanted = min(LARGEST, size)
    solver.setDimensions(wanted, min(size, SUBSPACE))
    solver.setTolerances(tol=1e-10, max_it=10000)
    try:
        with scripted(matrix):
            configure(solver)
            with stepping(solver):
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
    return Multipliers(values[order], lambda k: vectors[:, order[k]])


class _Monodromy:
    """dx(T) / dx(0) as products."""

    def __init__(self, driven: DrivenPeriod, motion: PeriodMotion):
        self.driven, self.motion = driven, motion

    def mult(self, matrix: PETSc.Mat, x: PETSc.Vec, y: PETSc.Vec) -> None:
        y.array[:] = self.driven.carried(self.motion, x.array_r[:, None], located=True)[:, 0]

"""Linear solves with the stiffness of a model, factorised once (prefix ``static_``)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..petsc import PETSc, check_ksp, free, make_ksp, solver_name

# Right-hand sides that are solved for at a time.
BLOCK = 64


class StaticSolver:
    """K^-1 for one and for many right-hand sides.

    Parameters
    ----------
    stiffness : PETSc.Mat
        Owned by the model.
    """

    def __init__(self, stiffness: PETSc.Mat):
        self.matrix = stiffness
        self.ksp = make_ksp(stiffness, "static_")
        self.name = solver_name(self.ksp)
        # products of a factor with a block of columns read it once; only a direct solve has one
        self._direct = self.ksp.getType() == "preonly" and self.ksp.getPC().getType() in ("cholesky", "lu")

    def solve(self, right: PETSc.Vec, solution: PETSc.Vec, what: str) -> None:
        """solution = K^-1 right; `what` names the solve in its error."""
        self.ksp.solve(right, solution)
        check_ksp(self.ksp, what)

    def columns(self, right: np.ndarray, what: str) -> np.ndarray:
        """K^-1 of (owned, k) columns, (owned, k)."""
        result = np.empty(right.shape, order="F")
        source, target = self.matrix.createVecs()
        comm = self.matrix.comm.tompi4py()
        try:
            if not self._direct or right.shape[1] < 2:
                for k in range(right.shape[1]):
                    source.array = right[:, k]
                    self.solve(source, target, what)
                    result[:, k] = target.array_r
                return result
            # one solve through the KSP: it factorises, and its reason tells a factorisation that failed
            source.array = right[:, 0]
            self.solve(source, target, what)
            sizes = (source.getSizes(), right.shape[1])
            given = PETSc.Mat().createDense(sizes, array=np.asfortranarray(right), comm=self.matrix.comm)
            found = PETSc.Mat().createDense(sizes, array=result, comm=self.matrix.comm)
            try:
                given.assemble()
                found.assemble()
                self.ksp.getPC().getFactorMatrix().matSolve(given, found)
                return found.getDenseArray().copy(order="F")
            finally:
                free(comm, given, found)
        finally:
            free(comm, source, target)

    def destroy(self) -> None:
        """Free the factors."""
        self.ksp.destroy()


@dataclass(frozen=True, eq=False)
class Compliance:
    """Static response to unit contact forces: the Delassus operator and what the outputs do.

    Attributes
    ----------
    gaps : (c, c) array
        W = G K^-1 G^T and the rows' own flexibility, symmetric, m/N.
    points : (points, 2, c) array
        m/N.
    tips : (tips, 2, c) array
        K_I and K_II, Pa m^(1/2)/N.
    """

    gaps: np.ndarray
    points: np.ndarray
    tips: np.ndarray


def compliance(model) -> Compliance:
    """Solve for every contact row, a block of them at a time."""
    gap = model.gap_operator
    outputs = (gap.rows, model.point_rows, model.tips.rows)
    found = [np.empty((len(rows), len(gap))) for rows in outputs]
    for first in range(0, len(gap), BLOCK):
        block = slice(first, min(first + BLOCK, len(gap)))
        solved = model.solver.columns(gap.rows.columns(block), "static contact")
        for target, rows in zip(found, outputs):
            target[:, block] = rows(solved)
    gaps, points, tips = found
    gaps = 0.5 * (gaps + gaps.T) + gap.flexibility
    tips += model.tips.contact
    count = len(gap)
    return Compliance(
        gaps, points.reshape(len(points) // 2, 2, count), tips.reshape(len(tips) // 2, 2, count)
    )

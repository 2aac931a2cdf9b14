"""Linear solves with the stiffness of a model, factorised once (prefix ``static_``)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..petsc import PETSc, block_solve, check_ksp, dense_columns, free, make_ksp, solver_name
from .rows import Rows

# Right-hand sides that are solved for at a time.
BLOCK = 256


class StaticSolver:
    """K^-1 for one and for many right-hand sides.

    Parameters
    ----------
    model : Structure

    Notes
    -----
    Solutions are refined where the round-off of the assembled stiffness would reach their digits: those of
    slender structures (`element_stiffness`).
    """

    def __init__(self, model):
        self.matrix, self.refinement = model.stiffness, model.refinement
        self._comm = self.matrix.comm.tompi4py()
        self.ksp = make_ksp(self.matrix, "static_")
        self.name = solver_name(self.ksp)
        # products of a factor with a block of columns read it once; only a direct solve has one
        self.direct = self.ksp.getType() == "preonly" and self.ksp.getPC().getType() in ("cholesky", "lu")
        self._checked = False

    def solve(self, right: PETSc.Vec, solution: PETSc.Vec, what: str) -> None:
        """solution = K^-1 right; `what` names the solve in its error."""
        self._solve(right, solution, what)
        if not self.refinement.needed(right.norm(), solution.norm()):
            return
        spare = solution.duplicate()

        def again(residual: np.ndarray) -> np.ndarray:
            change.array = residual
            self._solve(change, spare, what)
            return spare.array_r.copy()

        change = right.duplicate()
        try:
            solution.array = self.refinement.refine(right.array_r.copy(), solution.array_r.copy(), again)
        finally:
            change.destroy()
            spare.destroy()

    def _solve(self, right: PETSc.Vec, solution: PETSc.Vec, what: str) -> None:
        self.ksp.solve(right, solution)
        check_ksp(self.ksp, what)

    def columns(self, right: np.ndarray, what: str) -> np.ndarray:
        """K^-1 of (owned, k) columns, (owned, k)."""
        if not self.direct or right.shape[1] < 2:
            result = np.empty(right.shape, order="F")
            source, target = self.matrix.createVecs()
            try:
                for k in range(right.shape[1]):
                    source.array = right[:, k]
                    self.solve(source, target, what)
                    result[:, k] = target.array_r
            finally:
                free(self._comm, source, target)
            return result
        return self._refined(right, self._dense(right, what), what)

    def _dense(self, right: np.ndarray, what: str) -> np.ndarray:
        given = dense_columns(self.matrix, np.asfortranarray(right))
        try:
            return self._block(given, np.empty(right.shape, order="F"), what)
        finally:
            free(self._comm, given)

    def _refined(self, right: np.ndarray, solution: np.ndarray, what: str) -> np.ndarray:
        sums = self._comm.allreduce(np.stack([(right**2).sum(axis=0), (solution**2).sum(axis=0)]))
        if not any(self.refinement.needed(*pair) for pair in np.sqrt(sums).T):
            return solution
        return self.refinement.refine(right, solution, lambda residual: self._dense(residual, what))

    def of_rows(self, rows: Rows, chosen: slice, what: str) -> np.ndarray:
        """K^-1 of the transposes of some rows, (owned, k)."""
        if not (self.direct and self._sparse_right_sides):
            return self.columns(rows.columns(chosen), what)
        some = rows.matrix[chosen].tocsr()
        given = PETSc.Mat().createAIJ(
            (some.shape[0], self._sizes[0]),
            csr=(some.indptr.astype(PETSc.IntType), some.indices.astype(PETSc.IntType), some.data),
            comm=self.matrix.comm,
        )
        turned = PETSc.Mat().createTranspose(given)
        try:
            found = self._block(turned, np.empty((self._sizes[0], some.shape[0]), order="F"), what)
        finally:
            free(self._comm, turned, given)
        return self._refined(rows.columns(chosen), found, what)

    @property
    def _sizes(self) -> tuple[int, int]:
        return self.matrix.getSizes()[0]

    @property
    def _sparse_right_sides(self) -> bool:
        """Whether the direct solver passes over zeros of the right-hand sides: MUMPS, which takes them from
        one rank alone.
        """
        return self.matrix.comm.size == 1 and self.ksp.getPC().getFactorSolverType() == "mumps"

    def _block(self, given: PETSc.Mat, result: np.ndarray, what: str) -> np.ndarray:
        """The factor applied to a block of right-hand sides, into `result` (owned, k) in Fortran's order."""
        if not self._checked:
            # one solve through the KSP: it factorises, and its reason tells a factorisation that failed
            source, target = self.matrix.createVecs()
            try:
                source.set(1.0)
                self.solve(source, target, what)
            finally:
                free(self._comm, source, target)
            self._checked = True
        return block_solve(self.ksp, given, result)

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
        solved = model.solver.of_rows(gap.rows, block, "static contact")
        for target, rows in zip(found, outputs):
            target[:, block] = rows(solved)
    gaps, points, tips = found
    gaps = 0.5 * (gaps + gaps.T) + gap.flexibility
    tips += model.tips.contact
    count = len(gap)
    return Compliance(
        gaps, points.reshape(len(points) // 2, 2, count), tips.reshape(len(tips) // 2, 2, count)
    )

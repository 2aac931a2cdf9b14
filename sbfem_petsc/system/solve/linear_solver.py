"""A linear solver with checked solves: for vectors, for blocks of columns, for transposed rows."""

from __future__ import annotations

import numpy as np
from scipy import sparse

from ...petsc import MPI, PETSc, block_solve, check_ksp, chosen, dense_columns, freeing, judge_ksp, set_up
from ..elements.element_stiffness import ENOUGH, Refinement
from ..layout.rows import Rows


class LinearSolver:
    """The inverse that a KSP applies, for one and for many right-hand sides.

    Parameters
    ----------
    ksp : PETSc.KSP
    matrix : PETSc.Mat
        Its operator. Whoever has made them frees them.
    refinement : Refinement, optional
        Of solutions whose digits the round-off of the matrix would reach.

    Attributes
    ----------
    direct : bool
        Whether it is a factor and nothing else: products of a factor with a block of columns read it once.
    factorised : bool
        Whether the KSP is set up.
    most : int
        Most iterations of a solve so far.
    """

    def __init__(self, ksp: PETSc.KSP, matrix: PETSc.Mat, refinement: Refinement | None = None):
        self.ksp, self.matrix, self.refinement = ksp, matrix, refinement
        self.direct = ksp.getType() == "preonly" and ksp.getPC().getType() in ("cholesky", "lu")
        self.factorised, self.most = True, 0
        self._comm = self.matrix.comm.tompi4py()
        self._checked, self._told = False, chosen(ksp.getOptionsPrefix())

    def solve(self, right: PETSc.Vec, solution: PETSc.Vec, what: str) -> None:
        """Solve for one vector; `what` names the solve in its error."""
        self._solve(right, solution, what)
        if self.refinement is not None and self.refinement.needed(right.norm(), solution.norm()):
            solution.array = self.nearer(right.array_r[:, None], solution.array_r[:, None], what)[:, 0]

    def columns(self, right: np.ndarray, what: str) -> np.ndarray:
        """Solve for (owned, k) columns, (owned, k), or for one (owned,)."""
        if right.ndim == 1:
            return self.columns(right[:, None], what)[:, 0]
        return self._refined(right, self._columns(right, what), what)

    def of_rows(self, rows: Rows, chosen: slice, what: str) -> np.ndarray:
        """Solve for the transposes of some rows, (owned, k). Collective.

        MUMPS passes over the zeros of right-hand sides that rank 0 has without them.
        """
        if not self.direct or self.ksp.getPC().getFactorSolverType() != "mumps":
            return self.columns(rows.columns(chosen), what)
        self._check(what)
        first, size = self.matrix.getOwnershipRange()[0], self.matrix.getSize()[0]
        whole, (count, width) = _on_first_rank(rows.comm, rows.matrix[chosen].tocsr(), first, size)
        given = PETSc.Mat().createAIJ(
            ((count, None), (width, size)),
            csr=(whole.indptr.astype(PETSc.IntType), whole.indices.astype(PETSc.IntType), whole.data),
            comm=self.matrix.comm,
        )
        with freeing(rows.comm, given):
            found = block_solve(self.ksp, PETSc.Mat().createTranspose(given))
        return found if self.refinement is None else self._refined(rows.columns(chosen), found, what)

    def nearer(self, right: np.ndarray, near: np.ndarray, what: str, enough: float = ENOUGH) -> np.ndarray:
        """Solutions (owned, k) refined from what is near to them until corrections are so small."""
        assert self.refinement is not None
        return self.refinement.refine(right, near, lambda residual: self._columns(residual, what), enough)

    def _solve(self, right: PETSc.Vec, solution: PETSc.Vec, what: str) -> None:
        """Without refinement."""
        if not self.factorised:
            set_up(self.ksp)
            self.factorised = True
        self.ksp.solve(right, solution)
        check_ksp(self.ksp, what)
        if self._told:
            judge_ksp(self.ksp)
        self._checked = True
        self.most = max(self.most, self.ksp.getIterationNumber())

    def _columns(self, right: np.ndarray, what: str) -> np.ndarray:
        """Without refinement."""
        if self.direct and right.shape[1] > 1:
            self._check(what)
            return block_solve(self.ksp, dense_columns(self.matrix, np.asfortranarray(right)))
        result = np.empty(right.shape, order="F")
        with freeing(self._comm, *self.matrix.createVecs()) as (source, target):
            for k in range(right.shape[1]):
                source.array = right[:, k]
                self._solve(source, target, what)
                result[:, k] = target.array_r
        return result

    def _refined(self, right: np.ndarray, solution: np.ndarray, what: str) -> np.ndarray:
        if self.refinement is None or not self.refinement.needed_by(right, solution):
            return solution
        return self.nearer(right, solution, what)

    def _check(self, what: str) -> None:
        """A first solve through the KSP: it factorises, and its reason tells a factorisation that failed."""
        if not self._checked:
            with freeing(self._comm, *self.matrix.createVecs()) as (source, target):
                source.set(1.0)
                self._solve(source, target, what)


def _on_first_rank(
    comm: MPI.Comm, some: sparse.csr_matrix, first: int, size: int
) -> tuple[sparse.csr_matrix, tuple[int, int]]:
    """Rows over all unknowns on rank 0, none elsewhere, and their shape here. Collective."""
    if comm.size == 1:
        return some, some.shape
    entries = some.tocoo()
    parts = comm.gather((entries.data, entries.row, entries.col + first))
    if parts is None:
        return sparse.csr_matrix((0, 0)), (0, 0)
    values, numbers, unknowns = (np.concatenate(part) for part in zip(*parts))
    shape = (some.shape[0], size)
    return sparse.coo_matrix((values, (numbers, unknowns)), shape=shape).tocsr(), shape

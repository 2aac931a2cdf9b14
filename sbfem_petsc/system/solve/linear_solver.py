"""A linear solver with checked solves: for vectors, for blocks of columns, for transposed rows."""

from __future__ import annotations

import numpy as np
from scipy import sparse

from ...petsc import MPI, PETSc, block_solve, check_ksp, dense_columns, free
from ..layout.rows import Rows


class LinearSolver:
    """The inverse that a KSP applies, for one and for many right-hand sides.

    Parameters
    ----------
    ksp : PETSc.KSP
    matrix : PETSc.Mat
        Its operator. Whoever has made them frees them.

    Attributes
    ----------
    direct : bool
        Whether it is a factor and nothing else: products of a factor with a block of columns read it once.
    most : int
        Most iterations of a solve so far.
    """

    def __init__(self, ksp: PETSc.KSP, matrix: PETSc.Mat):
        self.ksp, self.matrix = ksp, matrix
        self.direct = ksp.getType() == "preonly" and ksp.getPC().getType() in ("cholesky", "lu")
        self.most = 0
        self._comm = self.matrix.comm.tompi4py()
        self._checked = False

    def solve(self, right: PETSc.Vec, solution: PETSc.Vec, what: str) -> None:
        """Solve for one vector; `what` names the solve in its error."""
        self.ksp.solve(right, solution)
        check_ksp(self.ksp, what)
        self.most = max(self.most, self.ksp.getIterationNumber())

    def columns(self, right: np.ndarray, what: str) -> np.ndarray:
        """Solve for (owned, k) columns, (owned, k)."""
        result = np.empty(right.shape, order="F")
        if self.direct and right.shape[1] > 1:
            self._check(what)
            given = dense_columns(self.matrix, np.asfortranarray(right))
            try:
                return block_solve(self.ksp, given, result)
            finally:
                free(self._comm, given)
        source, target = self.matrix.createVecs()
        try:
            for k in range(right.shape[1]):
                source.array = right[:, k]
                self.solve(source, target, what)
                result[:, k] = target.array_r
        finally:
            free(self._comm, source, target)
        return result

    def of_rows(self, rows: Rows, chosen: slice, what: str) -> np.ndarray:
        """Solve for the transposes of some rows, (owned, k). Collective.

        MUMPS passes over the zeros of right-hand sides that rank 0 has without them.
        """
        if not self.direct:
            return self.columns(rows.columns(chosen), what)
        self._check(what)
        some = rows.matrix[chosen].tocsr()
        result = np.empty((self.matrix.getLocalSize()[0], some.shape[0]), order="F")
        if self.ksp.getPC().getFactorSolverType() != "mumps":
            given = turned = dense_columns(self.matrix, rows.columns(chosen))
        else:
            first, size = self.matrix.getOwnershipRange()[0], self.matrix.getSize()[0]
            whole, (count, width) = _on_first_rank(rows.comm, some, first, size)
            given = PETSc.Mat().createAIJ(
                ((count, None), (width, size)),
                csr=(whole.indptr.astype(PETSc.IntType), whole.indices.astype(PETSc.IntType), whole.data),
                comm=self.matrix.comm,
            )
            turned = PETSc.Mat().createTranspose(given)
        try:
            return block_solve(self.ksp, turned, result)
        finally:
            free(rows.comm, turned, *([given] if turned is not given else []))

    def _check(self, what: str) -> None:
        """One solve through the KSP: it factorises, and its reason tells a factorisation that failed."""
        if self._checked:
            return
        source, target = self.matrix.createVecs()
        try:
            source.set(1.0)
            self.solve(source, target, what)
        finally:
            free(self._comm, source, target)
        self._checked = True


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

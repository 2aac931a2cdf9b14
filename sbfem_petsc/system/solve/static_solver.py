"""Linear solves with the stiffness of a model, factorised once (prefix ``static_``)."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from meshing.warnings import SolverWarning

from ...errors import warn
from ...petsc import PETSc, free, make_ksp, set_up, solver_name
from ..elements.element_stiffness import Refinement
from ..layout.layout import Layout
from ..layout.rows import Rows
from .linear_solver import LinearSolver

# Right-hand sides that are solved for at a time: as many as fit into so many bytes a rank, within limits;
# fewer would not use what MUMPS gains by blocks.
_BLOCK_BYTES, _LEAST, _MOST = 2**27, 64, 256

# Unknowns below which a factorisation costs less than multigrid, and above which its memory and its gain by
# more ranks become poor; iterations of a solve that multigrid stays below on structures that suit it.
_SMALL, _LARGE, _SUITED = 300_000, 5_000_000, 50


def block_width(layout: Layout) -> int:
    """Right-hand sides that are solved for at a time."""
    if layout.comm.size > 1:
        return _LEAST  # PETSc gathers the block for MUMPS on one rank, with lists of all its entries
    return min(max(_BLOCK_BYTES // (8 * max(1, layout.count)), _LEAST), _MOST)


class StaticSolver:
    """K^-1 for one and for many right-hand sides, factorised when it is first asked for.

    Parameters
    ----------
    matrix : PETSc.Mat
        The stiffness.
    refinement : Refinement
    by_ranks : callable
        Makes it as a MATIS, for solvers that ask for one.

    Attributes
    ----------
    factorised : bool

    Notes
    -----
    Solutions are refined where the round-off of the assembled stiffness would reach their digits: those of
    slender structures (`element_stiffness`).
    """

    def __init__(self, matrix: PETSc.Mat, refinement: Refinement, by_ranks: Callable[[], PETSc.Mat]):
        self.matrix, self.refinement = matrix, refinement
        self._comm = self.matrix.comm.tompi4py()
        self.ksp = make_ksp(self.matrix, "static_", by_ranks=by_ranks, later=True)
        self.factorised = False
        # the stiffness never changes, though it becomes a block of bordered matrices
        self.ksp.getPC().setReusePreconditioner(True)
        self.name = solver_name(self.ksp)
        self._unrefined = LinearSolver(self.ksp, self.matrix)
        self.direct = self._unrefined.direct

    def judge(self, owner: str) -> None:
        """Warn if another solver suits the structure better.

        Warns
        -----
        SolverWarning
        """
        unknowns = self.matrix.getSize()[0]
        told = None
        if self.direct:
            if unknowns > _LARGE:
                told = (
                    "a factorisation takes much memory, and gains little from many ranks; try "
                    "-static_ksp_type cg -static_pc_type gamg -static_pc_gamg_threshold 0.05"
                )
        elif self._unrefined.most > _SUITED:
            told = (
                f"{self._unrefined.most} iterations a solve are many, as of slender structures and steeply "
                "graded meshes; the direct solver, without -static_ksp_type and -static_pc_type, does not "
                "mind"
            )
        elif unknowns < _SMALL:
            told = "the direct solver, without -static_ksp_type and -static_pc_type, is faster"
        if told is not None:
            warn(f"{owner}: with {unknowns:,d} unknowns and {self.name}, {told}", SolverWarning)

    def _set_up(self) -> None:
        if not self.factorised:
            set_up(self.ksp)
            self.factorised = True

    def solve(self, right: PETSc.Vec, solution: PETSc.Vec, what: str) -> None:
        """solution = K^-1 right; `what` names the solve in its error."""
        self._set_up()
        self._unrefined.solve(right, solution, what)
        if not self.refinement.needed(right.norm(), solution.norm()):
            return
        change, spare = right.duplicate(), solution.duplicate()

        def again(residual: np.ndarray) -> np.ndarray:
            change.array = residual
            self._unrefined.solve(change, spare, what)
            return spare.array_r.copy()

        try:
            solution.array = self.refinement.refine(right.array_r.copy(), solution.array_r.copy(), again)
        finally:
            free(self._comm, change, spare)

    def columns(self, right: np.ndarray, what: str) -> np.ndarray:
        """K^-1 of (owned, k) columns, (owned, k)."""
        self._set_up()
        return self._refined(right, self._unrefined.columns(right, what), what)

    def of_rows(self, rows: Rows, chosen: slice, what: str) -> np.ndarray:
        """K^-1 of the transposes of some rows, (owned, k)."""
        self._set_up()
        return self._refined(rows.columns(chosen), self._unrefined.of_rows(rows, chosen, what), what)

    def _refined(self, right: np.ndarray, solution: np.ndarray, what: str) -> np.ndarray:
        sums = self._comm.allreduce(np.stack([(right**2).sum(axis=0), (solution**2).sum(axis=0)]))
        if not any(self.refinement.needed(*pair) for pair in np.sqrt(sums).T):
            return solution
        return self.refinement.refine(
            right, solution, lambda residual: self._unrefined.columns(residual, what)
        )

    def destroy(self) -> None:
        """Free the factors."""
        self.ksp.destroy()

"""Linear solves with the stiffness of a model, factorised once (prefix ``static_``)."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from meshing.warnings import SolverWarning

from ...errors import warn
from ...petsc import MPI, PETSc, make_ksp, solver_name, summed
from ..elements.element_stiffness import Refinement
from ..layout.layout import Layout
from .linear_solver import LinearSolver

# Right-hand sides that are solved for at a time: as many as fit into so many bytes a rank, within limits;
# fewer would not use what MUMPS gains by blocks.
_BLOCK_BYTES, _LEAST, _MOST = 2**27, 64, 256

# Unknowns below which a factorisation costs less than multigrid, and above which its memory and its gain by
# more ranks become poor; iterations of a solve that multigrid stays below on structures that suit it.
_SMALL, _LARGE, _SUITED = 300_000, 5_000_000, 50
# How many times larger displacements without contact may be than with it that are found from them.
_LOST = 2.0


def block_width(layout: Layout) -> int:
    """Right-hand sides that are solved for at a time."""
    if layout.comm.size > 1:
        return _LEAST  # PETSc gathers the block for MUMPS on one rank, with lists of all its entries
    return min(max(_BLOCK_BYTES // (8 * max(1, layout.count)), _LEAST), _MOST)


class StaticSolver(LinearSolver):
    """K^-1 for one and for many right-hand sides, factorised when it is first asked for.

    Parameters
    ----------
    matrix : PETSc.Mat
        The stiffness.
    refinement : Refinement
    by_ranks : callable
        Makes it as a MATIS, for solvers that ask for one.

    Notes
    -----
    Solutions are refined where the round-off of the assembled stiffness would reach their digits: those of
    slender structures (`element_stiffness`).
    """

    def __init__(self, matrix: PETSc.Mat, refinement: Refinement, by_ranks: Callable[[], PETSc.Mat]):
        super().__init__(make_ksp(matrix, "static_", by_ranks=by_ranks, later=True), matrix, refinement)
        self.factorised = False
        # the last load in units of its largest force, its displacements and their last correction
        self._last: tuple[np.ndarray, np.ndarray, float] | None = None
        # the stiffness never changes, though it becomes a block of bordered matrices
        self.ksp.getPC().setReusePreconditioner(True)
        self.name = solver_name(self.ksp)

    def of_load(self, load: np.ndarray) -> np.ndarray:
        """(owned,): displacements under a load (owned,) N, solved for in units of its largest force: once
        where loads are multiples of the one before, and with the same digits whatever came before.
        Collective.
        """
        assert self.refinement is not None
        largest = self._comm.allreduce(float(np.abs(load).max(initial=0.0)), MPI.MAX)
        unit = load / (largest or 1.0)
        if self._last is None or not self._comm.allreduce(np.array_equal(unit, self._last[0]), MPI.LAND):
            self._last = unit, self.columns(unit, "static"), self.refinement.correction
        _, found, self.refinement.correction = self._last
        return largest * found

    def of_contact(self, load: np.ndarray, free: np.ndarray, contact: np.ndarray) -> np.ndarray:
        """(owned,): displacements under a load and contact forces (owned,) N, from those under the load
        alone: what contact adds, unless it takes most of them away, which would leave few digits. Collective.
        """
        found = free + self.columns(contact, "static")
        squares = summed(self._comm, np.array([free @ free, found @ found]))
        return found if squares[0] <= _LOST**2 * squares[1] else self.columns(load + contact, "static")

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
        elif self.most > _SUITED:
            told = (
                f"{self.most} iterations a solve are many, as of slender structures and steeply "
                "graded meshes; the direct solver, without -static_ksp_type and -static_pc_type, does not "
                "mind"
            )
        elif unknowns < _SMALL:
            told = "the direct solver, without -static_ksp_type and -static_pc_type, is faster"
        if told is not None:
            warn(f"{owner}: with {unknowns:,d} unknowns and {self.name}, {told}", SolverWarning)

    def destroy(self) -> None:
        """Free the factors."""
        self.ksp.destroy()

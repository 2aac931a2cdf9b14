"""Contact of very many rows without any matrix of theirs: conjugate gradients on the contact forces.

The flexibility W = G K^-1 G^T + F of the rows is applied, a solve with the stiffness a time, never made. A
primal-dual active set (Newton's method on the complementarity) asks for ``W_aa force_a = -free gap_a``, which
PETSc's conjugate gradients solve (prefix ``contact_dual_``). No preconditioner: the lumped one of FETI, what
the stiffness alone does to the rows, saves a seventh of the iterations.
"""

from __future__ import annotations

import numpy as np

from ..contact.complementarity import Complementarity
from ..petsc import PETSc, check_ksp, configure, free, scripted, stage

# With an iterative solver of the stiffness a solve for each of more rows than this takes longer.
MANY = 200
# Relative residuals while the active set changes and of the last solve, and rounding of forces and gaps that
# this leaves, relative to the largest.
_LOOSE, _TIGHT, _ROUNDING = 1e-4, 1e-11, 1e-9
_MAXIMUM = 50


@stage("Contact")
def solve_dual(model, free_gap: np.ndarray) -> Complementarity | None:
    """Primal-dual active set of the model's contact rows, without their flexibility. Collective.

    Parameters
    ----------
    model : Model
    free_gap : (c,) array
        Gaps without contact forces, m.

    Returns
    -------
    Complementarity or None
        None where the iteration runs into a cycle.

    Raises
    ------
    SolveError
        If the conjugate gradients do not converge.
    """
    operator, laws = model.gap_operator, model.gap_operator.laws
    flexible = operator.rows.lengths() + np.abs(operator.flexibility.diagonal()) > 0.0
    active = flexible & laws.touched(free_gap)
    force, seen = np.zeros(len(active)), set()
    system = _ActiveRows(model)
    try:
        system.configure()
        tolerance = _LOOSE
        for iteration in range(1, _MAXIMUM + 1):
            force, gap = system.closed(active, force, free_gap, tolerance)
            off, most = (_ROUNDING * np.abs(values).max(initial=0.0) for values in (free_gap, force))
            pulls, overlaps = active & ~laws.tied & (force < -most), ~active & (gap < -off)
            wrong = flexible & (pulls | overlaps)
            if not wrong.any():
                if tolerance == _TIGHT:
                    force = np.where(laws.tied, force, np.maximum(force, 0.0))
                    return Complementarity(force, gap, active, iteration)
                tolerance = _TIGHT
                continue
            active = active ^ wrong
            if (active.tobytes(), tolerance) in seen:
                if tolerance == _TIGHT:
                    return None
                tolerance = _TIGHT  # what looks like a cycle may be the loose solves' doing
            seen.add((active.tobytes(), tolerance))
        return None
    finally:
        system.destroy()


class _ActiveRows:
    """W over the rows of an active set, and the identity over the others, for PETSc's conjugate gradients.

    Parameters
    ----------
    model : Model
    """

    def __init__(self, model):
        self._model, self._rows = model, model.gap_operator.rows
        comm, count = model.comm, len(model.gap_operator)
        self._vector = PETSc.Vec().createMPI(count, comm=comm)
        self._own = slice(*self._vector.getOwnershipRange())
        self._all, self._copy = PETSc.Scatter.toAll(self._vector)
        self._right, self._solution = model.stiffness.createVecs()
        self._active = np.zeros(count, dtype=bool)
        size = (self._vector.getSizes(), self._vector.getSizes())
        self._matrix = PETSc.Mat().createPython(size, context=_Operator(self), comm=comm)
        self._matrix.setUp()
        self._ksp = PETSc.KSP().create(comm)
        self._ksp.setOptionsPrefix("contact_dual_")
        self._ksp.setOperators(self._matrix)
        self._ksp.setType(PETSc.KSP.Type.CG)
        self._ksp.setInitialGuessNonzero(True)
        self._ksp.getPC().setType(PETSc.PC.Type.NONE)

    def configure(self) -> None:
        """Apply the options of the command line."""
        configure(self._ksp)

    def flexibility(self, force: np.ndarray) -> np.ndarray:
        """W force, (c,), on all ranks. Collective."""
        self._right.set(0.0)
        self._rows.add_to(self._right, force)
        self._model.solver.solve(self._right, self._solution, "static contact")
        return self._rows(self._solution.array_r) + self._model.gap_operator.flexibility @ force

    def closed(
        self, active: np.ndarray, start: np.ndarray, free_gap: np.ndarray, tolerance: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """Forces that keep the active rows closed, from a first guess, and the gaps under them.
        Collective.
        """
        self._active = active
        right, found = self._vector.duplicate(), self._vector.duplicate()
        try:
            right.array = np.where(active, -free_gap, 0.0)[self._own]
            found.array = np.where(active, start, 0.0)[self._own]
            self._ksp.setTolerances(rtol=tolerance, max_it=2000)
            with scripted():
                self._ksp.solve(right, found)
            check_ksp(self._ksp, "static contact")
            force = self._everywhere(found)
        finally:
            free(self._model.comm, right, found)
        gap = self.flexibility(force) + free_gap
        gap[active] = 0.0
        return force, gap

    def _everywhere(self, vector: PETSc.Vec) -> np.ndarray:
        self._all.scatter(vector, self._copy)
        return self._copy.array_r.copy()

    def product(self, given: PETSc.Vec, result: PETSc.Vec) -> None:
        """Of the matrix."""
        force = self._everywhere(given)
        product = self.flexibility(np.where(self._active, force, 0.0))
        result.array = np.where(self._active, product, force)[self._own]

    def destroy(self) -> None:
        """Free PETSc's objects."""
        self._matrix.setType(PETSc.Mat.Type.AIJ)
        items = (self._ksp, self._matrix, self._all, self._copy, self._vector)
        free(self._model.comm, *items, self._right, self._solution)


class _Operator:
    """Context of PETSc's matrix."""

    def __init__(self, rows: _ActiveRows):
        self._rows = rows

    def mult(self, matrix: PETSc.Mat, given: PETSc.Vec, result: PETSc.Vec) -> None:
        """PETSc's product."""
        self._rows.product(given, result)


def worthwhile(model, rows: int) -> bool:
    """Whether forces are iterated for: asked for by the option -contact_dual, or where every row would take
    an iterative solve of its own.
    """
    if PETSc.Options().hasName("contact_dual"):
        return PETSc.Options().getBool("contact_dual", True)
    return rows > MANY and not model.solver.direct and "compliance" not in model.__dict__

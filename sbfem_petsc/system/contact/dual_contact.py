"""Contact of very many rows without any matrix of theirs: conjugate gradients on the contact forces.

The flexibility W = G K^-1 G^T + F of the rows is applied, a solve with the stiffness a time, never made. A
primal-dual active set (Newton's method on the complementarity) asks for ``W_aa force_a = -free gap_a``, which
PETSc's conjugate gradients solve (prefix ``contact_dual_``). No preconditioner: the lumped one of FETI, what
the stiffness alone does to the rows, saves a seventh of the iterations.
"""

from __future__ import annotations

import numpy as np

from ...petsc import PETSc, asked, check_ksp, configure, free, freeing, judge_ksp, scripted, solving
from ..solve.stiffness import Stiffness
from .rows import Contact

# With an iterative solver of the stiffness a solve for each of more rows than this takes longer.
MANY = 200
# Relative residuals while the active set changes and of the last solve, and rounding of forces and gaps that
# this leaves, relative to the largest.
_LOOSE, _TIGHT, _ROUNDING = 1e-4, 1e-11, 1e-9
# A guess of the set before may be any distance from forces that are next to none: no sign of divergence.
_FAR = 1e30
_MAXIMUM = 50


class Dual:
    """The rows of contact by conjugate gradients, a `contact.complementarity.Backend`. Collective.

    PETSc's matrix is W over the rows of an active set, and the identity over the others.

    Parameters
    ----------
    stiffness : Stiffness
    contact : Contact

    Raises
    ------
    SolveError
        If the conjugate gradients do not converge.
    """

    maximum, rounding = _MAXIMUM, _ROUNDING

    def __init__(self, stiffness: Stiffness, contact: Contact):
        self._solver, self._contact, self._rows = stiffness.solver, contact, contact.rows
        self._tolerance = _LOOSE
        self.flexible = contact.flexible()
        self._comm = comm = stiffness.layout.comm
        count = len(contact)
        self._vector = PETSc.Vec().createMPI(count, comm=comm)
        self._own = slice(*self._vector.getOwnershipRange())
        self._all, self._copy = PETSc.Scatter.toAll(self._vector)
        self._active = np.zeros(count, dtype=bool)
        self._matrix = PETSc.Mat().createPython([self._vector.getSizes()] * 2, context=self, comm=comm)
        self._matrix.setUp()
        self._ksp = PETSc.KSP().create(comm)
        self._ksp.setOptionsPrefix("contact_dual_")
        self._ksp.setOperators(self._matrix)
        self._ksp.setType(PETSc.KSP.Type.CG)
        self._ksp.setInitialGuessNonzero(True)
        self._ksp.setTolerances(divtol=_FAR, max_it=2000)
        self._ksp.getPC().setType(PETSc.PC.Type.NONE)
        try:
            configure(self._ksp)
        except BaseException:
            self.close()
            raise

    @staticmethod
    def worthwhile(stiffness: Stiffness, contact: Contact) -> bool:
        """Whether forces are iterated for: asked for by the option -contact_dual, or where every row would
        take an iterative solve of its own.
        """
        if (wanted := asked("contact_dual", True)) is not None:
            return bool(wanted)
        return len(contact) > MANY and not stiffness.solver.direct and contact.kept_compliance is None

    def closed(self, active: np.ndarray, gap: np.ndarray, force: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """To the tolerance of now."""
        self._active = active
        with freeing(self._comm, self._vector.duplicate(), self._vector.duplicate()) as (right, found):
            right.array = np.where(active, -gap, 0.0)[self._own]
            found.array = np.where(active, force, 0.0)[self._own]
            self._ksp.setTolerances(rtol=self._tolerance)
            with solving("static contact"), scripted():
                self._ksp.solve(right, found)
                check_ksp(self._ksp, "static contact")
                if self._tolerance == _TIGHT:
                    judge_ksp(self._ksp)
            force = self._everywhere(found)
        return force, self._moved(force)

    def sharpen(self) -> bool:
        """From the loose tolerance to the tight one."""
        loose, self._tolerance = self._tolerance > _TIGHT, _TIGHT
        return loose

    def _moved(self, force: np.ndarray) -> np.ndarray:
        """W force, (c,), on all ranks."""
        moved = self._solver.columns(self._rows.forces(force), "static contact")
        return self._rows(moved) + self._contact.flexibility @ force

    def _everywhere(self, vector: PETSc.Vec) -> np.ndarray:
        self._all.scatter(vector, self._copy)
        return self._copy.array_r.copy()

    def mult(self, matrix: PETSc.Mat, given: PETSc.Vec, result: PETSc.Vec) -> None:
        """PETSc's product."""
        force = self._everywhere(given)
        product = self._moved(np.where(self._active, force, 0.0))
        result.array = np.where(self._active, product, force)[self._own]

    def close(self) -> None:
        """Free PETSc's objects."""
        self._matrix.setType(PETSc.Mat.Type.AIJ)
        free(self._comm, self._ksp, self._matrix, self._all, self._copy, self._vector)

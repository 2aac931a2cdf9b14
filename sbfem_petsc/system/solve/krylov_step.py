"""A step of SLEPc's Lanczos process: the solve, and how orthogonal its result is made to those before."""

from __future__ import annotations

from ...petsc import PETSc, SLEPc
from .pencil import CondensedSolve

# Gram-Schmidt once leaves a vector as orthogonal to the others as these are to each other, divided by the
# share of its length that is left: none is made orthogonal only once with a share below SHARE, nor more than
# ONCE of them one after the other, so that rounding, 1e-15, grows to 1e-15 / SHARE**ONCE = 1.5e-11 at the
# most. Frequencies are in error by as much (measured: 0.1 to 2 times it, not by its square).
SHARE, ONCE = 0.3, 8
# With two vectors made orthogonal twice where less is left than this share, SLEPc's own, it begins anew.
TWICE, CAREFUL = 2, 0.7071
CHOICES = ("bv_orthog_type", "bv_orthog_refine", "bv_orthog_eta", "bv_orthog_block")


class KrylovStep:
    """Python preconditioner of PETSc that solves, and tells SLEPc how often to make the result orthogonal."""

    def __init__(self, solve: CondensedSolve):
        self.solve, self.steps = solve, 0
        self.vectors: SLEPc.BV | None = None

    def watch(self, eps: SLEPc.EPS) -> None:
        """Take charge of the vectors of a solver that has its options, if these say nothing about it and the
        modes are the lowest ones: with a shift between frequencies the errors of vectors weigh in the
        residual of a low mode by the ratio of the shift to its omega^2.
        """
        options = PETSc.Options(eps.getOptionsPrefix())
        plain = eps.getType() == SLEPc.EPS.Type.KRYLOVSCHUR and not any(map(options.hasName, CHOICES))
        if plain and self.solve.shift <= 0.0:
            self.vectors = eps.getBV()

    def apply(self, pc: PETSc.PC, right: PETSc.Vec, left: PETSc.Vec) -> None:
        """left = (K - shift M)^-1 right."""
        if self.vectors is not None:
            once = self.steps % (ONCE + TWICE) < ONCE
            self.vectors.setOrthogonalization(eta=SHARE if once else CAREFUL)
            self.steps += 1
        self.solve.apply(pc, right, left)

    def release(self) -> None:
        """Let go of SLEPc's vectors: PETSc may keep this context longer than they are of use."""
        self.vectors = None

"""Lowest modes of sparse matrices by the solver of SLEPc's that options choose (prefix ``modal_eps_``)."""

from __future__ import annotations

import numpy as np
from scipy import sparse

from ..errors import SolveError
from ..petsc import PETSc, SLEPc, chosen, configure, solving, stage

TOLERANCE = 1e-11


def by_options() -> bool:
    """Whether options say something of SLEPc's eigensolver."""
    return chosen("modal_eps_")


def lowest_by_slepc(
    ksp: PETSc.KSP, inertia: PETSc.Mat, mass: sparse.csr_matrix, count: int, wanted: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """What `krylov.lowest` gives, each rank for itself, by the factor that a KSP has of its matrix; of
    `wanted` modes the lowest `count`.
    """
    eps = SLEPc.EPS().create(inertia.comm)
    try:
        eps.setOptionsPrefix("modal_")
        eps.setOperators(inertia, ksp.getOperators()[0])
        eps.setProblemType(SLEPc.EPS.ProblemType.GHEP)
        eps.setWhichEigenpairs(SLEPc.EPS.Which.LARGEST_REAL)
        eps.setDimensions(wanted)
        eps.setTolerances(TOLERANCE)
        eps.getST().setKSP(ksp)
        configure(eps)
        with stage("Modes"), solving("modal"):
            eps.solve()
        if eps.getConverged() < count:
            raise SolveError(
                f"modal: SLEPc found {eps.getConverged()} of {count} eigenpairs; raise -modal_eps_max_it or "
                "-modal_eps_ncv, or leave -modal_eps_ options out"
            )
        vector, columns = inertia.createVecRight(), np.empty((mass.shape[0], count), order="F")
        for k in range(count):
            eps.getEigenvector(k, vector)
            columns[:, k] = vector.array_r
        values = np.array([eps.getEigenvalue(k).real for k in range(count)])
        vector.destroy()
    finally:
        eps.getST().setKSP(PETSc.KSP().create(inertia.comm))  # which SLEPc takes along, and no factor of ours
        eps.destroy()
    heavy = mass @ columns
    lengths = np.sqrt((columns * heavy).sum(axis=0))
    return values, columns / lengths, heavy / lengths

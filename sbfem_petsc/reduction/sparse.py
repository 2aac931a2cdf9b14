"""Modes and residual flexibility of sparse matrices, by SLEPc and PETSc from one factorisation."""

from __future__ import annotations

import warnings

import numpy as np
from scipy import sparse

from meshing.warnings import SolverWarning

from ..errors import SolveError, caller_level
from ..petsc import (
    MPI,
    PETSc,
    SLEPc,
    block_solve,
    configure,
    count_pivots,
    dense_columns,
    direct_solver,
    factorise,
    free,
    negative_eigenvalues,
    pivot_signs,
    require_thread,
    solving,
)

# Relative residual of K x = b that a solve may have, and the energy of a mode, beside that of its parts, that
# is told from their round-off.
RESIDUAL, ZERO = 1e-6, 1e-14


def sparse_modes(
    mass: sparse.csr_matrix, stiffness: sparse.csr_matrix, columns: np.ndarray, count: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The lowest modes of K phi = w2 M phi and what is left of the flexibility, on each rank alike.

    The residual flexibility is P K^-1 P^T with the projector P = 1 - Phi Phi^T M, without the cancellation
    of K^-1 - Phi Omega^-2 Phi^T.

    Returns
    -------
    values, vectors, flexibility : (m,), (n, m), (n, k) arrays
        The last is that of the columns.

    Raises
    ------
    ValueError
        If the stiffness is indefinite, or admits rigid-body motions.
    SolveError
        If SLEPc does not find the modes, or has left some out.
    """
    require_thread()
    _require_mass(mass, count)
    k, m = _matrix(stiffness), _matrix(mass)
    eps = SLEPc.EPS().create(MPI.COMM_SELF)
    try:
        eps.setOptionsPrefix("modal_")
        eps.setOperators(k, m)
        eps.setProblemType(SLEPc.EPS.ProblemType.GHEP)
        eps.setDimensions(count, min(len(columns), max(2 * count, count + 20)))
        eps.setTolerances(1e-12, 200)
        eps.setWhichEigenpairs(SLEPc.EPS.Which.TARGET_MAGNITUDE)
        eps.setTarget(0.0)
        st = eps.getST()
        st.setType(SLEPc.ST.Type.SINVERT)
        st.setShift(0.0)
        ksp = st.getKSP()
        ksp.setOperators(k)
        ksp.setType(PETSc.KSP.Type.PREONLY)
        pc, (factorisation, package) = ksp.getPC(), direct_solver(MPI.COMM_SELF, positive_definite=False)
        pc.setType(factorisation)
        pc.setFactorSolverType(package)
        counts = count_pivots if package == "mumps" else None
        if counts is not None:
            counts(pc)
        configure(eps)
        with solving("modal"):
            factorise(pc, eps.setUp, counts)
            negative, zero, _ = (0, 0, 0) if counts is None else pivot_signs(pc, "modal")
            if negative:
                raise _indefinite(f"{negative} negative eigenvalues")
            if zero:
                raise _not_held()
            eps.solve()
        if eps.getConverged() < count:
            raise SolveError(
                f"modal: SLEPc found {eps.getConverged()} of {count} eigenpairs; raise "
                "-modal_eps_max_it or -modal_eps_ncv"
            )
        values, vectors = _pairs(eps, k, count)
        inertia = mass @ vectors
        if values[0] < 0.0:
            raise _indefinite(f"eigenvalue {values[0]:g} of M^-1 K")
        lowest = np.abs(vectors[:, 0])
        if values[0] * (lowest @ np.abs(inertia[:, 0])) <= ZERO * (lowest @ (abs(stiffness) @ lowest)):
            raise _not_held()
        vectors /= np.sqrt((vectors * inertia).sum(axis=0))
        inertia = mass @ vectors
        right = np.asfortranarray(columns - inertia @ (vectors.T @ columns))
        block = dense_columns(k, right)
        answers = np.empty_like(right, order="F")
        try:
            with solving("reduction"):
                block_solve(ksp, block, answers)
        finally:
            free(MPI.COMM_SELF, block)
        left = np.abs(stiffness @ answers - right).max(initial=0.0)
        if not left <= RESIDUAL * np.abs(right).max(initial=0.0):
            raise _not_held()
        _require_all(mass, stiffness, values)
        return values, vectors, answers - vectors @ (inertia.T @ answers)
    finally:
        free(MPI.COMM_SELF, eps, k, m)


def _require_mass(mass: sparse.csr_matrix, count: int) -> None:
    """Raise a ValueError unless the mass is positive semi-definite, with unknowns for so many modes."""
    diagonal = mass.diagonal()
    heavy = np.flatnonzero(diagonal)
    if len(heavy) < count:
        raise ValueError(
            f"reduce_matrices: mass has {len(heavy)} unknowns that are not without mass, for {count} modes; "
            "give modes as many or fewer"
        )
    coupled = abs(mass).sum(axis=1).A1 > 0.0
    wrong = (diagonal < 0.0) | (coupled & (diagonal == 0.0))
    negative = int(wrong.sum())
    negative = negative or _below(mass[heavy][:, heavy], 0.0) or 0
    if negative:
        raise ValueError(
            f"reduce_matrices: mass is indefinite ({negative} negative eigenvalues); a mass is at least 0"
        )


def _matrix(matrix: sparse.csr_matrix) -> PETSc.Mat:
    indices = (matrix.indptr.astype(PETSc.IntType), matrix.indices.astype(PETSc.IntType))
    result = PETSc.Mat().createAIJ(matrix.shape, csr=(*indices, matrix.data), comm=MPI.COMM_SELF)
    result.setOption(PETSc.Mat.Option.SYMMETRIC, True)
    return result


def _below(matrix: sparse.csr_matrix, shift: float, mass: sparse.csr_matrix | None = None) -> int | None:
    """Eigenvalues below a shift; None where PETSc has nothing that counts them."""
    shifted = _matrix(sparse.csr_matrix(matrix if mass is None else matrix - shift * mass))
    try:
        return negative_eigenvalues(shifted, "modal")
    finally:
        free(MPI.COMM_SELF, shifted)


def _indefinite(why: str) -> ValueError:
    return ValueError(f"reduce_matrices: stiffness is indefinite ({why})")


def _not_held() -> ValueError:
    return ValueError(
        "reduce_matrices: stiffness admits rigid-body motions; hold the system, by weak "
        "springs if it is free, or give dense matrices"
    )


def _pairs(eps: SLEPc.EPS, k: PETSc.Mat, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Eigenpairs in ascending order."""
    values = np.array([eps.getEigenvalue(i).real for i in range(count)])
    vectors = np.empty((k.size[0], count), order="F")
    x = k.createVecRight()
    for column, i in enumerate(np.argsort(values)):
        eps.getEigenvector(int(i), x)
        vectors[:, column] = x.array_r
    x.destroy()
    return np.sort(values), vectors


def _require_all(mass: sparse.csr_matrix, stiffness: sparse.csr_matrix, values: np.ndarray) -> None:
    """Raise a SolveError if the inertia below the last eigenvalue says that some are missing."""
    last = values[-1] * (1.0 - 1e-6)
    below, found = _below(stiffness, last, mass), int((values < last).sum())
    if below is None:
        warnings.warn(
            "reduce_matrices: this PETSc has no MUMPS, which counts eigenvalues: whether modes are missing, "
            "or a matrix is indefinite, is not known; use one with MUMPS",
            SolverWarning,
            stacklevel=caller_level(),
        )
    elif below > found:
        raise SolveError(
            f"modal: {below} eigenvalues lie below the last, but the eigensolver found {found}; raise "
            "-modal_eps_ncv or ask for more modes"
        )

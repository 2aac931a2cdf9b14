"""Modes and residual flexibility of sparse matrices, by SLEPc and PETSc from one factorisation."""

from __future__ import annotations

import warnings

import numpy as np
from scipy import linalg, sparse

from meshing.warnings import SolverWarning

from ..errors import SolveError, caller_level, on_all_ranks
from ..petsc import (
    MPI,
    PETSc,
    SLEPc,
    check_ksp,
    configure,
    count_pivots,
    dense_columns,
    factorise,
    free,
    make_ksp,
    negative_eigenvalues,
    pivot_signs,
    require_thread,
    solving,
)
from ..system.solve.linear_solver import LinearSolver

# Relative residual of K x = b that a solve may have, and the energy of a mode, beside that of its parts, that
# is told from their round-off.
RESIDUAL, ZERO = 1e-6, 1e-14
# Of the squares of the highest frequencies, about: what makes a stiffness definite where 0 is an eigenvalue;
# and of that, what 0 is told by.
SHIFT, SAME = 1e-9, 1e-4
# Relative residual of K^-1 M x = x / w2, at most, that a mode has.
TOLERANCE = 1e-11


def sparse_modes(
    mass: sparse.csr_matrix,
    stiffness: sparse.csr_matrix,
    columns: sparse.csr_matrix,
    count: int,
    comm: MPI.Comm = MPI.COMM_SELF,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The lowest modes of K phi = w2 M phi and what is left of the flexibility, on each rank alike.
    Collective.

    The residual flexibility is P K^-1 P^T with the projector P = 1 - Phi Phi^T M, without the cancellation
    of K^-1 - Phi Omega^-2 Phi^T.

    Returns
    -------
    values, vectors, flexibility : (m,), (n, m), (n, k) arrays
        The last is that of the columns.

    Raises
    ------
    ValueError
        If the stiffness is indefinite, or rigid-body motions are more than modes; on all ranks.
    SolveError
        If modes are not found, or some have been left out; on all ranks.
    """
    require_thread()
    _require_mass(comm, mass, count)
    found = _solved((mass, stiffness), columns, count, comm, 0.0)
    if found is None:  # with rigid-body motions
        heavy = mass.diagonal() > 0.0
        shift = SHIFT * float(np.median(stiffness.diagonal()[heavy] / mass.diagonal()[heavy]))
        found = _solved((mass, stiffness), columns, count, comm, shift)
    assert found is not None
    return found


def _solved(
    matrices: tuple[sparse.csr_matrix, sparse.csr_matrix],
    columns: sparse.csr_matrix,
    count: int,
    comm: MPI.Comm,
    shift: float,
) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
    """See `sparse_modes`, by K + shift M; None where a shift of 0 meets rigid-body motions."""
    mass, stiffness = matrices
    definite = sparse.csr_matrix(stiffness + shift * mass) if shift else stiffness
    k, m = _matrix(comm, definite), _matrix(comm, mass)
    ksp = make_ksp(k, "modal_st_", positive_definite=False, later=True)
    eps = SLEPc.EPS().create(comm)
    try:
        if not _factorised(ksp, sure=shift > 0.0):
            return None
        values, vectors, inertia = _none_left_out(eps, ksp, k, m, count)
        whole, values = _whole(comm, vectors), values - shift
        if not shift:
            first = np.abs(_whole(comm, np.stack([vectors[:, 0], inertia[:, 0]], axis=1)))
            if values[0] * (first[:, 0] @ first[:, 1]) <= ZERO * (
                first[:, 0] @ (abs(stiffness) @ first[:, 0])
            ):
                return None
        values = np.where(np.abs(values) <= SAME * shift, 0.0, values)
        if values[0] < 0.0:
            raise _indefinite(f"eigenvalue {values[0]:g} of M^-1 K")
        own = slice(*k.getOwnershipRange())
        right = np.asfortranarray(columns[own].toarray())
        right -= inertia @ _summed(comm, vectors.T @ right)
        if shift:
            answers = _pinned(comm, stiffness, whole[:, values == 0.0], right)
        else:
            answers = LinearSolver(ksp, k).columns(right, "reduction")
        left = np.abs(stiffness[own] @ _whole(comm, answers) - right).max(initial=0.0)
        if not comm.allreduce(left, MPI.MAX) <= RESIDUAL * comm.allreduce(
            np.abs(right).max(initial=0.0), MPI.MAX
        ):
            raise _not_held(count)
        answers -= vectors @ _summed(comm, inertia.T @ answers)
        return values, whole, _whole(comm, answers)
    finally:
        free(comm, eps, ksp, k, m)


def _pinned(comm: MPI.Comm, stiffness: sparse.csr_matrix, rigid: np.ndarray, right: np.ndarray) -> np.ndarray:
    """A displacement under forces in equilibrium, with as many unknowns held at 0 as there are rigid-body
    motions: those that tell them apart best.
    """
    pins = linalg.qr(rigid.T, pivoting=True, mode="r")[1][: rigid.shape[1]]
    loose = np.ones(len(rigid))
    loose[pins] = 0.0
    held = sparse.diags(loose) @ stiffness @ sparse.diags(loose)
    matrix = _matrix(comm, sparse.csr_matrix(held + sparse.diags((1.0 - loose) * stiffness.diagonal())))
    ksp = make_ksp(matrix, "modal_pinned_", positive_definite=False, later=True)
    try:
        if not _factorised(ksp, sure=False):  # more motions without energy than modes that show them
            raise _not_held(rigid.shape[1])
        own = slice(*matrix.getOwnershipRange())
        forces = np.asfortranarray(loose[own, None] * right)
        return LinearSolver(ksp, matrix).columns(forces, "reduction")
    finally:
        free(comm, ksp, matrix)


def _factorised(ksp: PETSc.KSP, sure: bool) -> bool:
    """Whether a matrix is positive definite, as far as the package counts signs of pivots; ValueError where
    it is sure to be but for an indefinite stiffness.
    """
    pc = ksp.getPC()
    counts = count_pivots if pc.getFactorSolverType() == "mumps" else None
    if counts is not None:
        counts(pc)
    with solving("modal"):
        factorise(pc, ksp.setUp, counts)
    negative, zero, _ = (0, 0, 0) if counts is None else pivot_signs(pc, "modal")
    if negative and sure:
        raise _indefinite(f"{negative} negative eigenvalues")
    return not negative and not zero


def _none_left_out(
    eps: SLEPc.EPS, ksp: PETSc.KSP, k: PETSc.Mat, m: PETSc.Mat, count: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """`_lowest`, with more of them where the inertia below the last one says that some are missing: SLEPc
    meets the second vector of a multiple eigenvalue through round-off only.
    """
    wanted, most = count, max(count, k.getSize()[0] - 1)
    for _ in range(4):
        values, *vectors = _lowest(eps, ksp, k, m, wanted)
        last = values[count - 1] * (1.0 - 1e-6)
        below, found = _below(k, m, last), int((values < last).sum())
        if below is None:
            warnings.warn(
                "reduce_matrices: this PETSc has no MUMPS, which counts eigenvalues: whether modes are "
                "missing, or a matrix is indefinite, is not known; use one with MUMPS",
                SolverWarning,
                stacklevel=caller_level(),
            )
        if below is None or below <= found:
            return values[:count], vectors[0][:, :count], vectors[1][:, :count]
        wanted = min(wanted + below - found + 4, most)
    raise on_all_ranks(
        SolveError(
            f"modal: {below} eigenvalues lie below the last of {count}, but {found} were found; raise "
            "-modal_eps_ncv or tighten -modal_eps_tol"
        )
    )


def _lowest(
    eps: SLEPc.EPS, ksp: PETSc.KSP, k: PETSc.Mat, m: PETSc.Mat, count: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Lowest eigenvalues, mass-normalised vectors and M times these, this rank's rows, by SLEPc (prefix
    ``modal_``), which resets the factor with its own end. It begins out of K^-1 M, where vectors have no part
    in what has no mass.
    """
    comm, n = k.comm.tompi4py(), k.getSize()[0]
    start, light = k.createVecs()
    try:
        eps.setOptionsPrefix("modal_")
        eps.setOperators(k, m)
        eps.setProblemType(SLEPc.EPS.ProblemType.GHEP)
        eps.setDimensions(count, min(n, max(2 * count, count + 20)))
        eps.setTolerances(TOLERANCE, 200)
        eps.setWhichEigenpairs(SLEPc.EPS.Which.TARGET_MAGNITUDE)
        eps.setTarget(0.0)
        st = eps.getST()
        st.setType(SLEPc.ST.Type.SINVERT)
        st.setShift(0.0)
        st.setKSP(ksp)
        m.getDiagonal(light)
        # a further solve a vector, for the parts of rounding in what has no mass
        eps.setPurify(light.min()[1] <= 0.0)
        start.setRandom()
        m.mult(start, light)
        ksp.solve(light, start)
        check_ksp(ksp, "modal")
        eps.setInitialSpace(start)
        configure(eps)
        with solving("modal"):
            eps.solve()
        if eps.getConverged() < count:
            raise on_all_ranks(
                SolveError(
                    f"modal: SLEPc found {eps.getConverged()} of {count} eigenpairs; raise "
                    "-modal_eps_max_it or -modal_eps_ncv"
                )
            )
        found = np.array([eps.getEigenvalue(i).real for i in range(count)])
        if found.min() < 0.0:
            raise _indefinite(f"eigenvalue {found.min():g} of M^-1 K")
        vectors = np.empty((len(start.array_r), count), order="F")
        for column, i in enumerate(np.argsort(found)):
            eps.getEigenvector(int(i), start)
            vectors[:, column] = start.array_r
    finally:
        free(comm, start, light)
    inertia = _times(m, vectors)
    lengths = np.sqrt(_summed(comm, (vectors * inertia).sum(axis=0)))
    return np.sort(found), vectors / lengths, inertia / lengths


def _times(matrix: PETSc.Mat, columns: np.ndarray) -> np.ndarray:
    """A matrix times this rank's rows of columns, in Fortran's order."""
    given = dense_columns(matrix, columns)
    product = matrix.matMult(given)
    try:
        return product.getDenseArray().copy(order="F")
    finally:
        free(matrix.comm.tompi4py(), given, product)


def _summed(comm: MPI.Comm, array: np.ndarray) -> np.ndarray:
    if comm.size > 1:
        array = np.ascontiguousarray(array)
        comm.Allreduce(MPI.IN_PLACE, array)
    return array


def _whole(comm: MPI.Comm, own: np.ndarray) -> np.ndarray:
    """(n, k): the rows of all ranks."""
    if comm.size == 1:
        return own
    rows = np.array(comm.allgather(len(own)))
    result = np.empty((rows.sum(), own.shape[1]))
    comm.Allgatherv(np.ascontiguousarray(own), (result, rows * own.shape[1]))
    return result


def _require_mass(comm: MPI.Comm, mass: sparse.csr_matrix, count: int) -> None:
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
    if not negative:
        made = _matrix(comm, mass[heavy][:, heavy])
        try:
            negative = negative_eigenvalues(made, "modal") or 0
        finally:
            free(comm, made)
    if negative:
        raise ValueError(
            f"reduce_matrices: mass is indefinite ({negative} negative eigenvalues); a mass is at least 0"
        )


def _matrix(comm: MPI.Comm, matrix: sparse.csr_matrix) -> PETSc.Mat:
    """This rank's rows of a matrix that every rank has."""
    n = matrix.shape[0]
    first, end = (n * (comm.rank + k) // comm.size for k in range(2))
    own = matrix[first:end]
    indices = (own.indptr.astype(PETSc.IntType), own.indices.astype(PETSc.IntType))
    size = (end - first, n)
    result = PETSc.Mat().createAIJ((size, size), csr=(*indices, own.data), comm=comm)
    result.setOption(PETSc.Mat.Option.SYMMETRIC, True)
    return result


def _below(k: PETSc.Mat, m: PETSc.Mat, shift: float) -> int | None:
    """Eigenvalues below a shift; None where PETSc has nothing that counts them."""
    shifted = k.copy()
    try:
        shifted.axpy(-shift, m)
        return negative_eigenvalues(shifted, "modal")
    finally:
        free(k.comm.tompi4py(), shifted)


def _indefinite(why: str) -> Exception:
    return on_all_ranks(ValueError(f"reduce_matrices: stiffness is indefinite ({why})"))


def _not_held(count: int) -> Exception:
    return on_all_ranks(
        ValueError(
            f"reduce_matrices: stiffness admits motions that take no energy beside the lowest {count} modes; "
            "keep more modes than there are rigid-body motions, hold the system, or give dense matrices"
        )
    )

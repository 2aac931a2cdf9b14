"""Modes and residual flexibility of sparse matrices from one factorisation by PETSc."""

from __future__ import annotations

import warnings

import numpy as np
from scipy import linalg, sparse

from meshing.warnings import SolverWarning

from ..errors import SolveError, caller_level, on_all_ranks
from ..petsc import (
    MPI,
    PETSc,
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
# Vectors that are solved for at a time, relative residual of K^-1 M x = x / w2 that a mode may have, what is
# left of a vector that is in the space of others, and vectors a mode at most.
BLOCK, TOLERANCE, NOTHING, MOST = 8, 1e-9, 1e-10, 8


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
    _require_all(comm, mass, stiffness, found[0])
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
    try:
        if not _factorised(ksp, sure=shift > 0.0):
            return None
        solver = LinearSolver(ksp, k)
        values, vectors, inertia = _lowest(solver, m, count)
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
            answers = solver.columns(right, "reduction")
        left = np.abs(stiffness[own] @ _whole(comm, answers) - right).max(initial=0.0)
        if not comm.allreduce(left, MPI.MAX) <= RESIDUAL * comm.allreduce(
            np.abs(right).max(initial=0.0), MPI.MAX
        ):
            raise _not_held(count)
        answers -= vectors @ _summed(comm, inertia.T @ answers)
        return values, whole, _whole(comm, answers)
    finally:
        free(comm, ksp, k, m)


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


def _lowest(solver: LinearSolver, m: PETSc.Mat, count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Lowest eigenvalues, mass-normalised vectors and M times these, this rank's rows, by Lanczos' method in
    blocks (Grimes, Lewis and Simon 1994).

    A factor is read once for 8 vectors, which takes twice the time of one, and multiple eigenvalues are met.
    All vectors are kept, and made orthogonal twice; out of K^-1 M they have no part in what has no mass.
    """
    comm, (first, end), n = m.comm.tompi4py(), m.getOwnershipRange(), m.getSize()[0]
    most = min(n, max(MOST * count, 20 * BLOCK))
    basis, heavy = (np.empty((end - first, most + BLOCK), order="F") for _ in range(2))
    products, size = np.zeros((most + BLOCK, most + BLOCK)), 0
    start = np.random.default_rng(0).standard_normal((n, min(BLOCK, n)))[first:end]  # on any ranks alike
    block, last = solver.columns(_times(m, np.asfortranarray(start)), "modal"), slice(0, 0)
    while True:
        old, old_heavy = basis[:, :size], heavy[:, :size]
        for _ in range(2 if size else 0):
            shares = _summed(comm, old_heavy.T @ block)
            block -= old @ shares
            products[:size, last] += shares
        block, inertia, rest = _orthonormal(comm, block, _times(m, block))
        if size >= min(2 * count, most) or not len(rest):
            found, parts = np.linalg.eigh(products[:size, :size], UPLO="U")
            order = np.argsort(-np.abs(found))[:count]
            found, parts = found[order], parts[:, order]
            beyond = rest @ parts[last]
            done = np.linalg.norm(beyond, axis=0) <= TOLERANCE * np.abs(found)
            if done.all() or size >= most or not len(rest):
                break
        last = slice(size, size + len(rest))
        basis[:, last], heavy[:, last], size = block, inertia, last.stop
        block = solver.columns(heavy[:, last], "modal")
    if found.min() < 0.0:
        raise _indefinite(f"eigenvalue {1.0 / found.min():g} of M^-1 K")
    if done.sum() < count:
        raise on_all_ranks(
            SolveError(f"modal: {done.sum()} of {count} modes were found by {size} vectors; give fewer modes")
        )
    # the next step of the iteration is known: no solve
    vectors, inertia = old @ parts + block @ (beyond / found), old_heavy @ parts + inertia @ (beyond / found)
    lengths = np.sqrt(_summed(comm, (vectors * inertia).sum(axis=0)))
    return 1.0 / found, vectors / lengths, inertia / lengths


def _orthonormal(
    comm: MPI.Comm, block: np.ndarray, inertia: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Mass-orthonormal vectors of the space of a block, in its place, M times these, and the block's factors
    in them.
    """
    width, count = block.shape[1], 0
    factors, sizes = np.zeros((width, width)), _summed(comm, (block * inertia).sum(axis=0))
    for j in range(width):
        x, y = block[:, j].copy(), inertia[:, j].copy()
        for _ in range(2):
            shares = _summed(comm, inertia[:, :count].T @ x)
            x -= block[:, :count] @ shares
            y -= inertia[:, :count] @ shares
            factors[:count, j] += shares
        square = float(_summed(comm, np.array([x @ y]))[0])
        if square > NOTHING**2 * sizes[j]:
            factors[count, j] = np.sqrt(square)
            block[:, count], inertia[:, count] = x / factors[count, j], y / factors[count, j]
            count += 1
    return block[:, :count], inertia[:, :count], factors[:count]


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
    negative = negative or _below(comm, mass[heavy][:, heavy]) or 0
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


def _below(comm: MPI.Comm, matrix: sparse.csr_matrix) -> int | None:
    """Negative eigenvalues; None where PETSc has nothing that counts them."""
    made = _matrix(comm, matrix)
    try:
        return negative_eigenvalues(made, "modal")
    finally:
        free(comm, made)


def _indefinite(why: str) -> Exception:
    return on_all_ranks(ValueError(f"reduce_matrices: stiffness is indefinite ({why})"))


def _not_held(count: int) -> Exception:
    return on_all_ranks(
        ValueError(
            f"reduce_matrices: stiffness admits motions that take no energy beside the lowest {count} modes; "
            "keep more modes than there are rigid-body motions, hold the system, or give dense matrices"
        )
    )


def _require_all(
    comm: MPI.Comm, mass: sparse.csr_matrix, stiffness: sparse.csr_matrix, values: np.ndarray
) -> None:
    """Raise a SolveError if the inertia below the last eigenvalue says that some are missing."""
    last = values[-1] * (1.0 - 1e-6)
    below, found = _below(comm, stiffness - last * mass), int((values < last).sum())
    if below is None:
        warnings.warn(
            "reduce_matrices: this PETSc has no MUMPS, which counts eigenvalues: whether modes are missing, "
            "or a matrix is indefinite, is not known; use one with MUMPS",
            SolverWarning,
            stacklevel=caller_level(),
        )
    elif below > found:
        raise on_all_ranks(
            SolveError(
                f"modal: {below} eigenvalues lie below the last, but {found} were found; ask for more modes"
            )
        )

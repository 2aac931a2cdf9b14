"""Modes and residual flexibility of sparse matrices from one factorisation by PETSc."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import closing
from functools import partial

import numpy as np
from scipy import linalg, sparse
from scipy.sparse.csgraph import connected_components

from meshing.warnings import SolverWarning

from ..errors import SolveError, failed_solve, warn, wrong_input
from ..petsc import (
    MPI,
    PETSc,
    count_pivots,
    factorise,
    freeing,
    make_ksp,
    negative_eigenvalues,
    pivot_signs,
    require_thread,
    solving,
)
from ..ranks.parallel import collective
from ..system.layout.rows import Rows
from ..system.solve.linear_solver import LinearSolver
from .chosen import by_options, lowest_by_slepc
from .krylov import by_columns, lowest, share, whole

# Relative residual of K x = b that a solve may have, and the energy of a mode, beside that of its parts, that
# is told from their round-off; the residual above which a second solve gives digits back.
RESIDUAL, ZERO, DIGITS = 1e-6, 1e-14, 1e-10
# Of the squares of the highest frequencies, about: what makes a stiffness definite where 0 is an eigenvalue;
# and of that, what tells other eigenvalues from it. Beside the next frequency's square, that of motions which
# are soft alone and held like rigid ones, and solves that these take at most.
SHIFT, SAME, APART, TIMES = 1e-9, 1e-4, 1e-6, 2
# Parts of a mass that are counted by themselves, at most; of its diagonal, what rounding leaves below 0.
MANY, ROUNDED = 6, 1e-10
# Unknowns of a node, or half as many of a shell's.
WIDTHS = (3, 2)
# Right-hand sides at a time: more of them share a pass over the factor, fewer make a smaller space.
WIDTH = 12


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
    of K^-1 - Phi Omega^-2 Phi^T. Each rank has a factor of its own, and solves for its share of the columns.

    Returns
    -------
    values, vectors, flexibility : (m,), (n, m), (n, k) arrays
        The last is that of the columns.

    Raises
    ------
    ValueError
        If a matrix is indefinite, or rigid-body motions are more than modes; on all ranks.
    SolveError
        If modes are not found, or some have been left out; on all ranks.
    """
    require_thread()
    heavy = _heavy(mass, count)
    carried = mass.diagonal() > 0.0
    ratio = float(np.median(stiffness.diagonal()[carried] / mass.diagonal()[carried]))
    for shift in (0.0, SHIFT * ratio):  # the latter with rigid-body motions
        definite = sparse.csr_matrix(stiffness + shift * mass) if shift else stiffness
        for doubled in range(4):
            with closing(_Columns(comm, definite, "modal_st_")) as solver:
                if not solver.factorised(sure=shift > 0.0):
                    break
                found = _solved(solver, (mass, heavy, stiffness), columns, (count, WIDTH << doubled), shift)
            if found is None:
                break
            known, below, result = found
            if below is None:
                warn(
                    "reduce_matrices: this PETSc has no MUMPS, which counts eigenvalues: whether modes are "
                    "missing, or a matrix is indefinite, is not known; use one with MUMPS",
                    SolverWarning,
                )
            if below is None or below <= known:
                return result
        else:
            raise failed_solve(
                f"modal: {below} eigenvalues lie below the last of {count}, but {known} were found; keep "
                "another number of modes"
            )
    raise failed_solve(
        f"modal: the stiffness is singular to working precision even with {shift:.3g} of the mass "
        "added: its entries lie too far apart; hold the body, or make what is near rigid softer"
    )


def _solved(
    solver: _Columns,
    matrices: tuple[sparse.csr_matrix, sparse.csr_matrix, sparse.csr_matrix],
    columns: sparse.csr_matrix,
    sizes: tuple[int, int],
    shift: float,
) -> tuple[int, int | None, tuple[np.ndarray, np.ndarray, np.ndarray]] | None:
    """How many modes are below the last one, how many there are, and what `sparse_modes` gives, by a factor
    of K + shift M, in whose place eigenvalues are counted; None where a shift of 0 meets rigid-body motions,
    or some so soft beside all others that they would take digits of these.

    As many vectors of a multiple eigenvalue are found as there are right-hand sides at a time, further ones
    through round-off only.
    """
    (mass, heavy, stiffness), (count, width), comm = matrices, sizes, solver.comm
    try:
        values, vectors, inertia = _lowest(solver, mass, count, width, shift)
    except (ValueError, SolveError):
        _require_mass(solver.counted(*_negative_parts(heavy)))
        if shift or by_options():
            raise
        return None  # pivots of rigid-body motions that rounding has left above 0 give these alone
    rigid = values[-1] <= shift * (1.0 + SAME)
    last = shift * (1.0 + SAME) if rigid else values[-1] * (1.0 - 1e-6)
    known, values = int((values < last).sum()), values - shift
    if shift:  # which costs frequencies digits, but quotients of shapes have few errors of these
        values, parts = linalg.eigh(vectors.T @ (stiffness @ vectors), vectors.T @ inertia)
        vectors, inertia = vectors @ parts, inertia @ parts
    low = np.flatnonzero(values <= max(shift, values[0]))
    sizes, pushed = np.abs(vectors[:, low]), np.abs(inertia[:, low])
    parts = (sizes * (abs(stiffness) @ sizes)).sum(axis=0)
    energies = values[low] * (sizes * pushed).sum(axis=0)
    apart = np.flatnonzero(values[:-1] <= APART * values[1:])
    if not shift and energies[0] <= (SHIFT if len(apart) else ZERO) * parts[0]:
        return None
    values[low[energies <= ZERO * parts]] = 0.0
    own, modes = columns[:, share(comm, columns.shape[1])], (values, vectors, inertia)
    soft = max((values == 0.0).sum(), (1 + apart[values[apart] <= shift]).max(initial=0))
    answers = _left_out(solver, own, stiffness, modes, shift=shift, soft=int(soft))
    below, *negative = solver.counted(partial(solver.below, last, mass), *_negative_parts(heavy))
    _require_mass(negative)
    if rigid and below is not None and below > known:
        raise _not_held(count)
    return known, below, (values, vectors, whole(comm, answers.T, columns.shape[1]).T)


def _left_out(
    solver: _Columns,
    columns: sparse.csr_matrix,
    stiffness: sparse.csr_matrix,
    modes: tuple[np.ndarray, np.ndarray, np.ndarray],
    *,
    shift: float,
    soft: int,
) -> np.ndarray:
    """P K^-1 P^T of this rank's columns: P K^-1 of these as they are, whose zeros a factor passes over. Where
    low modes, which P takes out, have taken digits, a solve for what is missed gives them back. With a shift
    unknowns are held in the place of the `soft` lowest. Collective.
    """
    (values, vectors, inertia), comm = modes, solver.comm

    def beside(forces: np.ndarray) -> np.ndarray:
        return forces - inertia @ (vectors.T @ forces)

    def missed(answers: np.ndarray) -> float:
        return comm.allreduce(np.abs(stiffness @ (answers @ mixture) - forces).max(), MPI.MAX)

    def flexible(answers: np.ndarray) -> np.ndarray:
        answers -= vectors @ (inertia.T @ answers)
        return answers

    def again(solve: Callable[[np.ndarray], np.ndarray], answers: np.ndarray) -> np.ndarray:
        left = beside(columns.toarray()) - stiffness @ answers
        return flexible(answers + solve(np.asfortranarray(left)))

    mixture = np.random.default_rng(0).uniform(1.0, 2.0, columns.shape[1])  # which tells of any column
    given = columns @ mixture
    forces = beside(given)  # rounding alone, where kept modes take all of them
    largest = comm.allreduce(max(np.abs(forces).max(), RESIDUAL * np.abs(given).max()), MPI.MAX)
    if shift:
        with closing(_Pinned(comm, stiffness, vectors, soft)) as held:
            answers = again(held.own, np.zeros(columns.shape))
            for _ in range(int(values[:soft].any()) and TIMES):
                answers = again(held.own, answers)
    else:
        answers = flexible(solver.of_few(columns))
        if missed(answers) <= DIGITS * largest:
            return answers
        answers += solver.own(np.asfortranarray(beside(columns.toarray()) - stiffness @ answers))
    if not missed(answers) <= RESIDUAL * largest:
        raise _not_held(len(values))
    if (left := missed(flexible(answers))) > RESIDUAL * largest:
        warn(
            f"reduce_matrices: the softest of the lowest {len(values)} modes takes digits of the others, and "
            f"the flexibility beside them misses its equations by {left / largest:.1g}; hold the system more "
            "stiffly, or give dense matrices",
            SolverWarning,
        )
    return answers


class _Columns:
    """Solves for columns that ranks share out, each by a factor of its own."""

    def __init__(self, comm: MPI.Comm, matrix: sparse.csr_matrix, prefix: str):
        self.comm, self.csr, self.matrix = comm, matrix, _matrix(matrix)
        self.ksp = make_ksp(self.matrix, prefix, positive_definite=False, later=True)
        self.solver = LinearSolver(self.ksp, self.matrix)

    def factorised(self, sure: bool) -> bool:
        """Whether the matrix is positive definite, as far as the package counts signs of pivots; ValueError
        where it is sure to be but for an indefinite stiffness. Collective.
        """
        pc = self.ksp.getPC()
        counts = count_pivots if pc.getFactorSolverType() == "mumps" else None
        with collective(self.comm):
            if counts is not None:
                counts(pc)
            with solving("modal"):
                factorise(pc, self.ksp.setUp, counts)
            negative, zero, _ = (0, 0, 0) if counts is None else pivot_signs(pc, "modal")
            if negative and sure:
                raise wrong_input(
                    f"reduce_matrices: stiffness is indefinite ({negative} negative eigenvalues)"
                )
        return not negative and not zero

    def own(self, right: np.ndarray) -> np.ndarray:
        """Solve for (n, k) columns of this rank's. Collective."""
        with collective(self.comm):
            return self.solver.columns(right, "reduction")

    def of_few(self, columns: sparse.csr_matrix) -> np.ndarray:
        """Solve for (n, k) columns of few entries of this rank's. Collective."""
        with collective(self.comm):
            if not columns.shape[1]:
                return columns.toarray(order="F")
            return self.solver.of_rows(Rows(MPI.COMM_SELF, columns.T.tocsr()), slice(None), "reduction")

    def shared(self, rows: np.ndarray) -> np.ndarray:
        """Solve for columns of which each rank has its rows, (own, k). Collective."""
        return by_columns(self.comm, rows, self.csr.shape[0], self.own)

    def of_all(self, right: np.ndarray) -> np.ndarray:
        """Solve for (n, k) columns that all ranks have. Collective."""
        found = self.own(right[:, share(self.comm, right.shape[1])])
        return whole(self.comm, found.T, right.shape[1]).T

    def by_slepc(
        self, mass: sparse.csr_matrix, count: int, width: int
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """See `lowest_by_slepc`, with some more modes as further vectors of multiple ones. Collective."""
        with freeing(MPI.COMM_SELF, _matrix(mass)) as (inertia,), collective(self.comm):
            wanted = min(count + width, mass.shape[0])
            return lowest_by_slepc(self.ksp, inertia, mass, count, wanted)

    def counted(self, *counts: Callable[[], int | None]) -> list[int | None]:
        """What counts give, which ranks share out. Collective."""
        with collective(self.comm):
            found = [count() for count in counts[self.comm.rank :: self.comm.size]]
        told = self.comm.allgather(found)
        return [told[k % self.comm.size][k // self.comm.size] for k in range(len(counts))]

    def below(self, value: float, mass: sparse.csr_matrix) -> int | None:
        """Eigenvalues below one; None where PETSc has nothing that counts them. The factor is lost."""
        pc = self.ksp.getPC()
        if pc.getFactorSolverType() == "mumps" and _within(mass, self.csr):  # its order stays
            with freeing(MPI.COMM_SELF, _matrix(mass)) as (added,):
                self.matrix.axpy(-value, added, PETSc.Mat.Structure.SUBSET_NONZERO_PATTERN)
            with solving("modal"):
                factorise(pc, pc.setUp, count_pivots)
            return pivot_signs(pc, "modal")[0]
        return _negative(sparse.csr_matrix(self.csr - value * mass))

    def close(self) -> None:
        """Destroy what PETSc has of it."""
        self.ksp.destroy()
        self.matrix.destroy()


class _Pinned(_Columns):
    """Displacements under forces in equilibrium, with as many unknowns held at 0 as there are rigid-body
    motions: those that tell them apart best. Motions that springs hardly hold are as good as rigid.
    """

    def __init__(self, comm: MPI.Comm, stiffness: sparse.csr_matrix, modes: np.ndarray, soft: int):
        pins = linalg.qr(modes[:, :soft].T, pivoting=True, mode="r")[1][:soft]
        self.loose = np.ones(len(modes))
        self.loose[pins] = 0.0
        held = sparse.diags(self.loose) @ stiffness @ sparse.diags(self.loose)
        super().__init__(
            comm,
            sparse.csr_matrix(held + sparse.diags((1.0 - self.loose) * stiffness.diagonal())),
            "modal_pinned_",
        )
        if not self.factorised(sure=False):  # more motions without energy than modes that show them
            self.close()
            raise _not_held(modes.shape[1])

    def own(self, right: np.ndarray) -> np.ndarray:
        """Solve for (n, k) columns of this rank's. Collective."""
        return super().own(np.asfortranarray(self.loose[:, None] * right))


def _lowest(
    solver: _Columns, mass: sparse.csr_matrix, count: int, width: int, shift: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Lowest eigenvalues of K + shift M, mass-normalised vectors and M times these, by so many right-hand
    sides at a time.
    """
    if shift and by_options():
        raise failed_solve(
            "modal: -modal_eps_ options are for bodies that are held: of others rigid motions take the "
            "digits of what SLEPc finds; leave these options out, or hold the body"
        )
    if by_options():
        inverse, vectors, inertia = solver.by_slepc(mass, count, width)
        again = solver.of_all(inertia) / inverse
        missed = float(np.sqrt(((again - vectors) * (mass @ (again - vectors))).sum(axis=0)).max())
        if not missed <= RESIDUAL:
            raise failed_solve(
                f"modal: SLEPc's modes miss their equations by {missed:.1g}, above {RESIDUAL:g}; "
                "lower -modal_eps_tol, raise -modal_eps_ncv, or leave -modal_eps_ options out"
            )
    else:
        inverse, vectors, inertia = lowest(solver.comm, solver.shared, mass, count, width)
    if mass.diagonal().min() <= 0.0:  # rounding in what has no mass
        vectors = solver.of_all(inertia) / inverse
        inertia = mass @ vectors
        lengths = np.sqrt((vectors * inertia).sum(axis=0))
        vectors, inertia = vectors / lengths, inertia / lengths
    return 1.0 / inverse, vectors, inertia


def _heavy(mass: sparse.csr_matrix, count: int) -> sparse.csr_matrix:
    """The mass of unknowns that are not without; ValueError unless it may be positive definite and so many
    modes can be of it.
    """
    diagonal = mass.diagonal()
    heavy = np.flatnonzero(diagonal)
    if len(heavy) < count:
        raise ValueError(
            f"reduce_matrices: mass has {len(heavy)} unknowns that are not without mass, for {count} modes; "
            "give modes as many or fewer"
        )
    coupled = np.bincount(mass.indices[mass.data != 0.0], minlength=len(diagonal)) > 0  # it is symmetric
    _require_mass([int(((diagonal < 0.0) | (coupled & (diagonal == 0.0))).sum())])
    if len(heavy) == len(diagonal):
        return mass
    return sparse.csr_matrix(mass + sparse.diags(np.where(diagonal == 0.0, diagonal.max(), 0.0)))


def _within(one: sparse.csr_matrix, other: sparse.csr_matrix) -> bool:
    """Whether one matrix has entries where the other has, and nowhere else."""
    both = [sparse.csr_matrix((np.ones(a.nnz), a.indices, a.indptr), a.shape) for a in (one, other)]
    return int((both[0] + both[1]).nnz) == other.nnz


def _negative_parts(mass: sparse.csr_matrix) -> list[Callable[[], int | None]]:
    """What counts negative eigenvalues of a mass by parts that nothing couples, those along x, y and z say,
    alike ones once; of all of it where they are many. Single unknowns have none, see `_heavy`.
    """
    part = connected_components(mass, directed=False)[1]
    several = np.flatnonzero(np.bincount(part) > 1)
    if len(several) > MANY:
        return [partial(_negative, mass)]
    parts = list[list[sparse.csr_matrix]]()
    for own in (mass[part == k][:, part == k] for k in several):
        alike = [some for some in parts if own.shape == some[0].shape and not (own != some[0]).nnz]
        if alike:
            alike[0].append(own)
        else:
            parts.append([own])
    return [partial(_negative, alike[0], len(alike)) for alike in parts]


def _negative(matrix: sparse.csr_matrix, times: int = 1) -> int | None:
    """Negative eigenvalues of so many alike, beyond rounding of those that are 0, as of masses that are
    integrated at few points; None where PETSc has nothing that counts them.
    """
    lifted = sparse.csr_matrix(matrix + ROUNDED * sparse.diags(matrix.diagonal()))
    with freeing(MPI.COMM_SELF, _matrix(lifted)) as (made,):
        found = negative_eigenvalues(made, "modal")
    return None if found is None else times * found


def _require_mass(negative: Sequence[int | None]) -> None:
    """ValueError where parts of a mass have negative eigenvalues."""
    if count := sum(filter(None, negative)):
        raise wrong_input(
            f"reduce_matrices: mass is indefinite ({count} negative eigenvalues); a mass is at least 0"
        )


def _matrix(matrix: sparse.csr_matrix) -> PETSc.Mat:
    """A matrix of this rank's alone, with the number of a node's unknowns where all have as many."""
    matrix = matrix.sorted_indices()  # a copy, for PETSc takes these arrays as its own
    indices = (
        matrix.indptr.astype(PETSc.IntType, copy=False),
        matrix.indices.astype(PETSc.IntType, copy=False),
    )
    result = PETSc.Mat().createAIJWithArrays(matrix.shape, (*indices, matrix.data), comm=MPI.COMM_SELF)
    result.setOption(PETSc.Mat.Option.SYMMETRIC, True)
    result.setBlockSize(next((width for width in WIDTHS if _of_nodes(matrix, width)), 1))
    return result


def _of_nodes(matrix: sparse.csr_matrix, width: int) -> bool:
    """Whether each `width` rows in turn have entries in the same ones of as many columns each."""
    if matrix.shape[0] % width:
        return False
    ones = np.ones(matrix.nnz, dtype=bool)
    blocks = sparse.csr_matrix((ones, matrix.indices // width, matrix.indptr.copy()))
    blocks.sum_duplicates()
    first, *others = (blocks[k::width] for k in range(width))
    return not any(
        (first.indptr != other.indptr).any() or (first.indices != other.indices).any() for other in others
    )


def _not_held(count: int) -> Exception:
    return wrong_input(
        f"reduce_matrices: stiffness admits motions that take no energy beside the lowest {count} modes; "
        "keep more modes than there are rigid-body motions, hold the system, or give dense matrices"
    )

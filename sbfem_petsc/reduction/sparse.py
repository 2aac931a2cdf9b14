"""Modes and residual flexibility of sparse matrices from one factorisation by PETSc."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import closing
from functools import partial
from typing import Any

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
from .krylov import lowest, share, whole

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
# Squares of frequencies, modes and M times these, or what is left of flexibilities.
Modes = tuple[np.ndarray, np.ndarray, np.ndarray]
# Right-hand sides at a time: more of them share a pass over the factor, fewer make a smaller space.
WIDTH = 12


def sparse_modes(
    mass: sparse.csr_matrix,
    stiffness: sparse.csr_matrix,
    columns: sparse.csr_matrix,
    count: int,
    comm: MPI.Comm = MPI.COMM_SELF,
) -> Modes:
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
    with collective(comm):
        _require_mass(_negative_parts(_heavy(mass, count)))
    carried = mass.diagonal() > 0.0
    ratio = float(np.median(stiffness.diagonal()[carried] / mass.diagonal()[carried]))
    for shift in (0.0, SHIFT * ratio):  # the latter with rigid-body motions
        definite = sparse.csr_matrix(stiffness + shift * mass) if shift else stiffness
        for doubled in range(4):
            with closing(_Columns(comm, definite, "modal_st_")) as solver:
                if not solver.factorised(sure=shift > 0.0):
                    break
                found = _solved(solver, (mass, stiffness), columns, (count, WIDTH << doubled), shift)
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
    matrices: tuple[sparse.csr_matrix, sparse.csr_matrix],
    columns: sparse.csr_matrix,
    sizes: tuple[int, int],
    shift: float,
) -> tuple[int, int | None, Modes] | None:
    """How many modes are below the last one, how many there are, and what `sparse_modes` gives, by a factor
    of K + shift M, in whose place eigenvalues are counted; None where a shift of 0 meets rigid-body motions,
    or some so soft beside all others that they would take digits of these.

    As many vectors of a multiple eigenvalue are found as there are right-hand sides at a time, further ones
    through round-off only.
    """
    (mass, stiffness), comm = matrices, solver.comm
    own = columns[:, share(comm, columns.shape[1])]
    try:
        answers = None if shift else solver.of_few(own)  # by the factor of K, which modes take the place of
        (values, vectors, inertia), known, below = _lowest(solver, mass, sizes, shift)
    except (ValueError, SolveError):
        if shift or by_options():
            raise
        return None  # pivots of rigid-body motions that rounding has left above 0 give these alone
    rigid = values[-1] <= shift * (1.0 + SAME)
    last = shift * (1.0 + SAME) if rigid else values[-1] * (1.0 - 1e-6)
    if again := rigid or known != below:
        known = int((values < last).sum())
    values = values - shift
    if shift:  # which costs frequencies digits, but quotients of shapes have few errors of these
        values, parts = linalg.eigh(vectors.T @ (stiffness @ vectors), vectors.T @ inertia)
        vectors, inertia = vectors @ parts, inertia @ parts
    low = np.flatnonzero(values <= max(shift, values[0]))
    parts = parts_of_energy(stiffness, vectors[:, low])
    energies = values[low] * np.abs(vectors[:, low] * inertia[:, low]).sum(axis=0)
    apart = np.flatnonzero(values[:-1] <= APART * values[1:])
    if not shift and energies[0] <= (SHIFT if len(apart) else ZERO) * parts[0]:
        return None
    values[low[energies <= ZERO * parts]] = 0.0
    soft = max((values == 0.0).sum(), (1 + apart[values[apart] <= shift]).max(initial=0))
    answers = _left_out(solver, (own, answers), matrices, (values, vectors, inertia), soft=int(soft))
    below = solver.below(last, mass) if again else below
    if rigid and below is not None and below > known:
        raise _not_held(len(values))
    return known, below, (values, vectors, whole(comm, answers.T, columns.shape[1]).T)


def parts_of_energy(stiffness: Any, shapes: np.ndarray) -> np.ndarray:
    """(k,): twice the strain energies of shapes (n, k), each of whose terms counts as positive."""
    sizes = np.abs(shapes)
    found: np.ndarray = (sizes * (abs(stiffness) @ sizes)).sum(axis=0)
    return found


def _left_out(
    solver: _Columns,
    given: tuple[sparse.csr_matrix, np.ndarray | None],
    matrices: tuple[sparse.csr_matrix, sparse.csr_matrix],
    modes: Modes,
    *,
    soft: int,
) -> np.ndarray:
    """P K^-1 P^T of this rank's columns, given with their K^-1: P K^-1 of these as they are. Where low modes,
    which P takes out, have taken digits, a solve for what is missed gives them back. Where K^-1 is not given
    unknowns are held in the place of the `soft` lowest. Collective.
    """
    (columns, answers), (mass, stiffness) = given, matrices
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
    pushed = columns @ mixture
    forces = beside(pushed)  # rounding alone, where kept modes take all of them
    largest = comm.allreduce(max(np.abs(forces).max(), RESIDUAL * np.abs(pushed).max()), MPI.MAX)
    if answers is None:
        with closing(_Pinned(comm, stiffness, vectors, soft)) as held:
            answers = again(held.own, np.zeros(columns.shape))
            for _ in range(int(values[:soft].any()) and TIMES):
                answers = again(held.own, answers)
    else:
        answers = flexible(answers)
        if missed(answers) <= DIGITS * largest:
            return answers
        if solver.place:
            solver.below(0.0, mass)
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
        self.comm, self.csr, self.matrix, self.place = comm, matrix, _matrix(matrix), 0.0
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
            if not columns.nnz:  # which MUMPS refuses at times
                return columns.toarray(order="F")
            return self.solver.of_rows(Rows(MPI.COMM_SELF, columns.T.tocsr()), slice(None), "reduction")

    def of_modes(self, values: np.ndarray, inertia: np.ndarray) -> np.ndarray:
        """Modes of such eigenvalues by a mass times these, which all ranks have. Collective."""
        own = share(self.comm, len(values))
        found = self.own(inertia[:, own]) * (values[own] - self.place)
        return whole(self.comm, found.T, len(values)).T

    def by_slepc(self, mass: sparse.csr_matrix, count: int, width: int) -> Modes:
        """See `lowest_by_slepc`, with some more modes as further vectors of multiple ones. Collective."""
        with freeing(MPI.COMM_SELF, _matrix(mass)) as (inertia,), collective(self.comm):
            wanted = min(count + width, mass.shape[0])
            return lowest_by_slepc(self.ksp, inertia, mass, count, wanted)

    def movable(self, mass: sparse.csr_matrix) -> bool:
        """Whether the factor can be that of the matrix less masses with entries where it has some."""
        ones = [sparse.csr_matrix((np.ones(a.nnz), a.indices, a.indptr), a.shape) for a in (mass, self.csr)]
        return self.ksp.getPC().getFactorSolverType() == "mumps" and sum(ones).nnz == self.csr.nnz

    def below(self, value: float, mass: sparse.csr_matrix) -> int | None:
        """Eigenvalues below one; None where PETSc has nothing that counts them. The factor is that of the
        matrix less so many masses afterwards, if it is `movable`, in the same order. Collective.
        """
        pc = self.ksp.getPC()
        with collective(self.comm):
            if not self.movable(mass):
                return _negative(sparse.csr_matrix(self.csr - value * mass))
            with freeing(MPI.COMM_SELF, _matrix(mass)) as (added,):
                self.matrix.axpy(self.place - value, added, PETSc.Mat.Structure.SUBSET_NONZERO_PATTERN)
            self.place = value
            with solving("modal"):
                factorise(pc, pc.setUp, count_pivots)
            return pivot_signs(pc, "modal")[0]

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
    solver: _Columns, mass: sparse.csr_matrix, sizes: tuple[int, int], shift: float
) -> tuple[Modes, int, int | None]:
    """Lowest eigenvalues of K + shift M, so many, mass-normalised vectors and M times these, by so many
    right-hand sides at a time, and how many are found and counted, see `lowest`.
    """
    if shift and by_options():
        raise failed_solve(
            "modal: -modal_eps_ options are for bodies that are held: of others rigid motions take the "
            "digits of what SLEPc finds; leave these options out, or hold the body"
        )
    if not by_options():
        near = partial(solver.below, mass=mass) if solver.movable(mass) else None
        (inverse, vectors, inertia), known, below = lowest(solver.comm, solver.own, mass, sizes, near)
    else:
        (inverse, vectors, inertia), known, below = solver.by_slepc(mass, *sizes), 0, None
        again = solver.of_modes(1.0 / inverse, inertia)
        missed = float(np.sqrt(((again - vectors) * (mass @ (again - vectors))).sum(axis=0)).max())
        if not missed <= RESIDUAL:
            raise failed_solve(
                f"modal: SLEPc's modes miss their equations by {missed:.1g}, above {RESIDUAL:g}; "
                "lower -modal_eps_tol, raise -modal_eps_ncv, or leave -modal_eps_ options out"
            )
    if mass.diagonal().min() <= 0.0:  # rounding in what has no mass
        vectors = solver.of_modes(1.0 / inverse, inertia)
        inertia = mass @ vectors
        parts = linalg.inv(linalg.cholesky(vectors.T @ inertia))  # a solve leaves digits of them
        vectors, inertia = vectors @ parts, inertia @ parts
    return (1.0 / inverse, vectors, inertia), known, below


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


def _negative_parts(mass: sparse.csr_matrix) -> list[int | None]:
    """Negative eigenvalues of a mass, beyond rounding of those that are 0, as of one that is integrated at
    few points; by parts that nothing couples, those along x, y and z say, alike ones once; of all of it
    where they are many. Single unknowns have none, see `_heavy`.
    """
    mass = sparse.csr_matrix(mass + ROUNDED * sparse.diags(mass.diagonal()))
    part = connected_components(mass, directed=False)[1]
    several = np.flatnonzero(np.bincount(part) > 1)
    if len(several) > MANY:
        return [_negative(mass)]
    parts = [mass[part == k][:, part == k] for k in several]
    alike = all(own.shape == parts[0].shape and not (own != parts[0]).nnz for own in parts)
    return [_negative(parts[0])] * len(parts) if alike and parts else [_negative(own) for own in parts]


def _negative(matrix: sparse.csr_matrix) -> int | None:
    """Negative eigenvalues; None where PETSc has nothing that counts them."""
    with freeing(MPI.COMM_SELF, _matrix(matrix)) as (made,):
        return negative_eigenvalues(made, "modal")


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
    ones, shape = np.ones(matrix.nnz, dtype=bool), (matrix.shape[0], matrix.shape[1] // width)
    blocks = sparse.csr_matrix((ones, matrix.indices // width, matrix.indptr.copy()), shape)
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

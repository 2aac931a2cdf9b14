"""Contact of many rows without their flexibility: the active rows border the stiffness.

The flexibility W of n contact rows takes n solves and n^2 numbers. Where a static problem is all that is
asked for, an active set costs less as one factorisation of

    [ K      -c G_a^T ] [ u         ]   [ f     ]
    [ -c G_a -c^2 F_a ] [ force / c ] = [ c gap ]

which is quasi-definite; c brings the rows to the scale of the stiffness, and the gap is that of u = 0. With
the load f the stiffness itself need not be factorised, where a first set is expected; without it u is the
change from a state that is known. The sets that follow differ in few rows: each row that joins or leaves
borders the factorised matrix once more, a solve with its factor.
"""

from __future__ import annotations

import numpy as np
from scipy import sparse

from ...petsc import MPI, PETSc, block_solve, check_ksp, dense_columns, direct_solver, free, freeing, make_ksp
from ...ranks.capacity import give_back
from ..solve.assembly import from_rows
from ..solve.stiffness import Stiffness
from .rows import Contact

# From about so many rows on a few factorisations cost less than a solve for each row: a third of its time
# with 985 rows of 30,000 unknowns, on one rank.
MANY = 500
# The primal-dual iteration seldom needs more than ten sets; a cycle is left to the flexibility.
_MAXIMUM = 30
# Rows that may join or leave a factorised set (a factorisation costs as much as 120 to 200 of a block),
# and those that are solved for at a time.
_CLOSE, _BLOCK = 128, 64
# Relative residual of the bordered system beyond which its factorisation is not trusted (rows that depend
# on each other).
_TRUSTED = 1e-9


class Bordered:
    """The rows of contact with the active ones as borders, a `contact.complementarity.Backend`. Collective.

    Parameters
    ----------
    stiffness : Stiffness
    contact : Contact
    forces : (owned,) array, optional
        Of a load, N, which moves gaps as the forces of the rows do. Default: none.
    """

    maximum, rounding = _MAXIMUM, 0.0

    def __init__(self, stiffness: Stiffness, contact: Contact, forces: np.ndarray | None = None):
        self._stiffness, self._contact, self._forces = stiffness, contact, forces
        self._factorised: _Factorised | None = None
        self.flexible = contact.flexible()

    @staticmethod
    def worthwhile(stiffness: Stiffness, contact: Contact) -> bool:
        """Whether factorisations are expected to cost less than the flexibility of all rows, and the direct
        solver factorises indefinite matrices.
        """
        if len(contact) <= MANY or contact.kept_compliance is not None:
            return False
        return stiffness.solver.direct and direct_solver(stiffness.layout.comm)[1] in (
            "mumps",
            "superlu_dist",
        )

    def closed(
        self, active: np.ndarray, gap: np.ndarray, force: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray] | None:
        """None if a system is not solved to round-off, and of a load without active rows, whose matter the
        stiffness itself is.
        """
        if not active.any():
            return (np.zeros(len(gap)), np.zeros(len(gap))) if self._forces is None else None
        if self._factorised is None or not self._factorised.reaches(active):
            self.close()
            self._factorised = _Factorised(self._stiffness, self._contact, active, self._forces)
        return self._factorised.closed(active, gap)

    def displacements(self, active: np.ndarray, force: np.ndarray, moved: np.ndarray) -> np.ndarray:
        """(owned,) of the last set and its forces, which with the load have moved the gaps so far."""
        assert self._factorised is not None
        return self._factorised.displacements(active, force, moved)

    def sharpen(self) -> bool:
        """The solves are exact."""
        return False

    def close(self) -> None:
        """Free the factor."""
        if self._factorised is not None:
            self._factorised.destroy()
            self._factorised = None


class _Factorised:
    """The bordered matrix of one active set, factorised, and what rows that join or leave the set do.

    Forces are those that close given gaps of the active rows, displacements those of forces and load, from
    the state that has these gaps.

    Parameters
    ----------
    stiffness : Stiffness
    contact : Contact
    active : (c,) bool array
    load : (owned,) array or None
    """

    def __init__(self, stiffness: Stiffness, contact: Contact, active: np.ndarray, load: np.ndarray | None):
        self._stiffness, self._contact, self._active = stiffness, contact, active
        self._comm, own = stiffness.layout.comm, stiffness.layout.owned
        self._index = np.flatnonzero(active)
        self._scale = stiffness.elements.modulus * stiffness.elements.thickness
        self._matrix = _bordered(stiffness, contact, self._index, self._scale)
        self._ksp = make_ksp(self._matrix, "static_contact_", positive_definite=False)
        self._owned = own.stop - own.start
        self._load = np.zeros(self._owned) if load is None else load
        # largest displacement under the load, of which given gaps, often zero, tell nothing
        self._loaded, self._moved = load is not None, 0.0
        self._last = self._comm.size - 1
        # Of the rows that have joined or left so far: gaps (c, k) and forces / c (active, k) of the factor's
        # answers.
        self._rows = np.zeros(0, dtype=int)
        self._gaps, self._forces = np.zeros((len(active), 0)), np.zeros((len(self._index), 0))
        self._own, self._trusted = np.full(len(self._index), np.nan), False

    def reaches(self, active: np.ndarray) -> bool:
        """Whether a set is so close to the factorised one that solves cost less than a factorisation."""
        changed = np.flatnonzero(active ^ self._active)
        direct = self._ksp.getType() == "preonly"
        return len(changed) == 0 or (direct and len(np.union1d(changed, self._rows)) <= _CLOSE)

    def closed(self, active: np.ndarray, given: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
        """Forces that close given gaps of a set, and what they add to all; None if the factorisation is not
        to be trusted.
        """
        if not self._solve_own(given[self._index]):
            return None
        operator, scale = self._contact, self._scale
        force = np.zeros(len(active))
        changed = np.flatnonzero(active ^ self._active)
        self._respond(np.setdiff1d(changed, self._rows))
        at = np.array([int(np.flatnonzero(self._rows == row)[0]) for row in changed], dtype=int)
        answers, forces = self._gaps[:, at], self._forces[:, at]
        joins = active[changed]
        own = operator.flexibility[changed][:, self._index].toarray()
        # the further border over the factor's answers, C^T M^-1 C, and over the first solution
        known = np.where(joins, scale * given[changed], 0.0)
        border = -scale * answers[changed] - scale**2 * (own @ forces)
        first = -scale * self._first_gap[changed] - scale**2 * (own @ self._first_force)
        places = np.searchsorted(self._index, changed[~joins])
        border[~joins], first[~joins] = forces[places], self._first_force[places]
        both = np.outer(joins, joins)
        corner = np.where(both, -(scale**2) * operator.flexibility[changed][:, changed].toarray(), 0.0)
        further = corner - border
        # rows that join have gaps, rows that leave forces, twenty powers of ten apart
        weight = 1.0 / np.sqrt(np.abs(np.diagonal(further)))
        try:
            more = weight * np.linalg.solve(weight[:, None] * further * weight, weight * (known - first))
        except np.linalg.LinAlgError:
            return None
        force[self._index] = scale * (self._first_force - forces @ more)
        force[changed] = np.where(joins, scale * more, 0.0)
        moved = self._first_gap - answers @ more + operator.flexibility @ force
        off = np.abs((moved + given)[active]).max(initial=0.0)
        return (force, moved) if off <= _TRUSTED * max(np.abs(given).max(), self._moved) else None

    def displacements(self, active: np.ndarray, force: np.ndarray, moved: np.ndarray) -> np.ndarray:
        """(owned,) of the last set's forces, which with the load have moved the gaps so far: rows of the
        factorised set have their gaps, the forces of others are given.
        """
        if np.array_equal(active, self._active):
            return self._first
        operator = self._contact
        other = force.copy()
        other[self._index] = 0.0
        gaps = (operator.flexibility @ other - moved)[self._index]
        solution, _ = self._solve(self._load + operator.rows.matrix.T @ other, gaps)
        return solution[: self._owned]

    def _solve_own(self, given: np.ndarray) -> bool:
        """Solution of the factorised set for its gaps: gaps (c,) and forces / c, kept for the next time;
        whether its residual is round-off.
        """
        if np.array_equal(given, self._own):
            return self._trusted
        self._own = given
        solution, missed = self._solve(self._load, given)
        self._first_gap, self._first_force = self._parts(solution)
        self._first = solution[: self._owned]
        if self._loaded:
            most = np.abs(self._first).max(initial=0.0)
            self._moved = self._comm.allreduce(float(most), MPI.MAX)
        self._trusted = missed <= _TRUSTED
        return self._trusted

    def _solve(self, forces: np.ndarray, gaps: np.ndarray) -> tuple[np.ndarray, float]:
        """This rank's part of the solution, and its residual relative to the right-hand side."""
        right, solution = self._matrix.createVecs()
        with freeing(self._comm, right.duplicate(), right, solution) as (residual, *_):
            right.array[: self._owned] = forces
            if self._comm.rank == self._last:
                right.array[self._owned :] = self._scale * gaps
            self._ksp.solve(right, solution)
            check_ksp(self._ksp, "static contact")
            self._matrix.mult(solution, residual)
            residual.axpy(-1.0, right)
            return solution.array_r.copy(), residual.norm() / max(right.norm(), np.finfo(float).tiny)

    def _respond(self, rows: np.ndarray) -> None:
        """Answers of the factor to the further borders of some rows."""
        operator = self._contact
        columns = np.zeros((self._matrix.getLocalSize()[0], len(rows)), order="F")
        joins = ~self._active[rows]
        columns[: self._owned, joins] = -self._scale * operator.rows.columns(rows[joins])
        if self._comm.rank == self._last:
            own = operator.flexibility[rows[joins]][:, self._index].toarray()
            columns[self._owned :, joins] = -(self._scale**2) * own.T
            leaves = np.flatnonzero(~joins)
            columns[self._owned + np.searchsorted(self._index, rows[leaves]), leaves] = 1.0
        for start in range(0, len(rows), _BLOCK):
            some = np.asfortranarray(columns[:, start : start + _BLOCK])
            gaps, forces = self._parts(block_solve(self._ksp, dense_columns(self._matrix, some)))
            self._gaps = np.concatenate([self._gaps, gaps], axis=1)
            self._forces = np.concatenate([self._forces, forces], axis=1)
        self._rows = np.concatenate([self._rows, rows])

    def _parts(self, solution: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Gaps of the displacements and the forces / c, of one or several solutions, on all ranks."""
        forces = np.array(solution[self._owned :]) if self._comm.rank == self._last else None
        return (
            self._contact.rows(solution[: self._owned]),
            self._comm.bcast(forces, self._last),
        )

    def destroy(self) -> None:
        """Free the factor."""
        free(self._comm, self._ksp, self._matrix)
        give_back(self._stiffness.layout.count)


def _bordered(stiffness: Stiffness, operator: Contact, index: np.ndarray, scale: float) -> PETSc.Mat:
    """The bordered matrix; the last rank owns the rows of the forces."""
    comm, ranges = stiffness.layout.comm, stiffness.layout.ranges
    count, last = len(index), comm.size - 1
    border = -scale * operator.rows.matrix[index]
    borders = comm.gather(border, last)
    rows = sparse.csr_matrix((0, int(ranges[-1])))
    own = sparse.csr_matrix((0, count))
    if comm.rank == last:
        rows = sparse.hstack(borders, format="csr")
        every = np.arange(count)
        # PETSc wants the places of the diagonal even where it is zero
        own = sparse.csr_matrix(-(scale**2) * operator.flexibility[index][:, index])
        own = own + sparse.csr_matrix((np.zeros(count), (every, every)), shape=own.shape)
    ends = np.where(np.arange(comm.size + 1) > last, count, 0)
    blocks = [
        from_rows(comm, rows_of, columns_of, _compressed(part), symmetric=False)
        for rows_of, columns_of, part in (
            (ranges, ends, border.T),
            (ends, ranges, rows),
            (ends, ends, own),
        )
    ]
    # PETSc puts them together without copies in between, which would be the most that contact needs
    nest = PETSc.Mat().createNest([[stiffness.matrix, blocks[0]], blocks[1:]], comm=comm)
    matrix = nest.convert("aij", PETSc.Mat())
    free(comm, nest, *blocks)
    matrix.setOption(PETSc.Mat.Option.SYMMETRIC, True)
    return matrix


def _compressed(matrix: sparse.spmatrix) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rows = matrix.tocsr()
    rows.sort_indices()
    return rows.indptr, rows.indices, rows.data

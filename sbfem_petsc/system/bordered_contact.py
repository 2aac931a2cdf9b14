"""Contact of many rows without their flexibility: the active rows border the stiffness.

The flexibility W of n contact rows takes n solves and n^2 numbers. Where a static problem is all that is
asked for, each active set of the iteration costs less as one factorisation of

    [ K      -c G_a^T ] [ change of u ]   [ 0          ]
    [ -c G_a -c^2 F_a ] [ force / c   ] = [ c free gap ]

which is quasi-definite; c brings the rows to the scale of the stiffness.
"""

from __future__ import annotations

import numpy as np
from scipy import sparse

from ..contact.complementarity import Complementarity
from ..petsc import PETSc, check_ksp, direct_solver, make_ksp
from .assembly import from_rows

# From about so many rows on a few factorisations cost less than a solve for each row.
MANY = 1000
# The primal-dual iteration seldom needs more than ten sets; a cycle is left to the flexibility.
_MAXIMUM = 30
# Relative residual of the bordered system beyond which its factorisation is not trusted (rows that depend
# on each other).
_TRUSTED = 1e-9


def solve_bordered(model, free_gap: np.ndarray) -> Complementarity | None:
    """Primal-dual active set of the model's contact rows. Collective.

    Parameters
    ----------
    model : Model
    free_gap : (c,) array
        Gaps without contact forces, m.

    Returns
    -------
    Complementarity or None
        None where the iteration runs into a cycle or a system is not solved to round-off.
    """
    gap_operator, laws = model.gap_operator, model.gap_operator.laws
    flexible = gap_operator.rows.lengths() + np.abs(gap_operator.flexibility.diagonal()) > 0.0
    active = flexible & laws.touched(free_gap)
    seen = set()
    for iteration in range(1, _MAXIMUM + 1):
        found = _closed(model, free_gap, active)
        if found is None:
            return None
        force, gap = found
        wrong = flexible & laws.wrong(active, force, gap)
        if not wrong.any():
            return Complementarity(force, gap, active, iteration)
        active = active ^ wrong
        if active.tobytes() in seen:
            return None
        seen.add(active.tobytes())
    return None


def _closed(model, free_gap: np.ndarray, active: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
    """Forces that keep the active rows closed, and the gaps under them: of the change from the state without
    contact forces, whose gaps are known.
    """
    operator, index = model.gap_operator, np.flatnonzero(active)
    if len(index) == 0:
        return np.zeros(len(active)), free_gap.copy()
    scale = max(material.modulus for material in model.materials) * model.thickness
    matrix = _bordered(model, index, scale)
    ksp = make_ksp(matrix, "static_contact_", positive_definite=False)
    right, solution = matrix.createVecs()
    residual = right.duplicate()
    try:
        count, last = model.owned.stop - model.owned.start, model.comm.rank == model.comm.size - 1
        if last:
            right.array[count:] = scale * free_gap[index]
        ksp.solve(right, solution)
        check_ksp(ksp, "static contact")
        matrix.mult(solution, residual)
        residual.axpy(-1.0, right)
        if not residual.norm() <= _TRUSTED * right.norm():
            return None
        found = solution.array_r[count:] if last else np.empty(len(index))
        force = np.zeros(len(active))
        force[index] = scale * model.comm.bcast(np.array(found), model.comm.size - 1)
        gap = operator.rows(solution.array_r[:count]) + operator.flexibility @ force + free_gap
        gap[index] = 0.0
        return force, gap
    finally:
        for item in (ksp, right, solution, residual, matrix):
            item.destroy()


def _bordered(model, index: np.ndarray, scale: float) -> PETSc.Mat:
    """The bordered matrix; the last rank owns the rows of the forces."""
    comm, operator = model.comm, model.gap_operator
    count, last = len(index), comm.size - 1
    starts, columns, values = model.stiffness.getValuesCSR()
    owned, width = len(starts) - 1, int(model.ranges[-1])
    border = -scale * operator.rows.matrix[index]
    rows = sparse.hstack(
        [sparse.csr_matrix((values, columns, starts), shape=(owned, width)), border.T], format="csr"
    )
    borders = comm.gather(border, last)
    if comm.rank == last:
        own = -(scale**2) * operator.flexibility[index][:, index]
        rows = sparse.vstack([rows, sparse.hstack([*borders, own])], format="csr")
        # PETSc wants the places of the diagonal even where it is zero
        rows = rows + sparse.csr_matrix(
            (np.zeros(count), (owned + np.arange(count), width + np.arange(count))), shape=rows.shape
        )
    rows.sort_indices()
    ranges = model.ranges.copy()
    ranges[-1] += count
    matrix = from_rows(comm, ranges, ranges, (rows.indptr, rows.indices, rows.data), symmetric=False)
    matrix.setOption(PETSc.Mat.Option.SYMMETRIC, True)
    return matrix


def worthwhile(model, rows: int) -> bool:
    """Whether bordered factorisations are expected to cost less than the flexibility of all rows, and the
    direct solver factorises indefinite matrices.
    """
    if rows <= MANY or "compliance" in model.__dict__:
        return False
    return model.solver.direct and direct_solver(model.comm)[1] in ("mumps", "superlu_dist")

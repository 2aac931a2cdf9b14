"""Delassus operator: flexibility of the structure seen by its contact pairs."""

from __future__ import annotations

import numpy as np

from ..petsc import MPI, PETSc, check_ksp


class ContactRows:
    """Rows of the gap operator G on their ranks.

    The gaps are few (nodes of crack faces) and every rank holds all of them; the displacement unknowns stay
    distributed.
    """

    def __init__(self, model):
        self.comm = model.comm
        first, last = model.ranges[self.comm.rank], model.ranges[self.comm.rank + 1]
        self.rows = []
        for numbers, values in model.contact_rows():
            mine = (numbers >= first) & (numbers < last)
            self.rows.append((numbers[mine] - first, values[mine]))

    def local(self, owned: np.ndarray) -> np.ndarray:
        """This rank's share of G times (owned, n) columns, (pairs, n): sum over the ranks for the whole."""
        return np.array([values @ owned[numbers] for numbers, values in self.rows]).reshape(
            len(self.rows), *owned.shape[1:]
        )

    def gaps(self, vector: PETSc.Vec) -> np.ndarray:
        """G u, (pairs,), on all ranks."""
        result = self.local(vector.array_r)
        self.comm.Allreduce(MPI.IN_PLACE, result)
        return result

    def add_forces(self, vector: PETSc.Vec, forces: np.ndarray) -> None:
        """vector += G^T forces."""
        array = vector.array
        for (numbers, values), force in zip(self.rows, forces):
            if force != 0.0:
                array[numbers] += values * force


def delassus(rows: ContactRows, ksp: PETSc.KSP, what: str) -> np.ndarray:
    """W = G K^-1 G^T, (pairs, pairs), m/N: one linear solve a pair with the solver of K."""
    count = len(rows.rows)
    right, solution = ksp.getOperators()[0].createVecs()
    result = np.empty((count, count))
    unit = np.eye(count)
    for k in range(count):
        right.set(0.0)
        rows.add_forces(right, unit[k])
        ksp.solve(right, solution)
        check_ksp(ksp, what)
        result[:, k] = rows.gaps(solution)
    right.destroy()
    solution.destroy()
    return 0.5 * (result + result.T)

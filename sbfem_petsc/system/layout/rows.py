"""Linear forms of the displacement unknowns whose values every rank knows: gaps, points, stress
intensities.
"""

from __future__ import annotations

import functools
from collections.abc import Iterable

import numpy as np
from scipy import sparse

from ...petsc import MPI, summed
from ..solve.assembly import Triples, route

_NONE = np.empty(0, dtype=np.int64)


class Rows:
    """Few rows over the distributed displacement unknowns; each rank holds the columns it owns.

    Parameters
    ----------
    comm : Comm
    matrix : (rows, owned) sparse matrix
        This rank's columns.
    """

    def __init__(self, comm: MPI.Comm, matrix: sparse.csr_matrix):
        self.comm, self.matrix = comm, matrix
        self._transposed = matrix.T.tocsr()

    @classmethod
    def gathered(cls, comm: MPI.Comm, ranges: np.ndarray, blocks: Iterable[Triples], count: int) -> Rows:
        """Rows of which each is known to one rank, or several of which each knows a part; those that all know
        are given by one. Collective.

        Parameters
        ----------
        blocks : iterable of (rows, unknowns, coefficients)
            This rank's, as of `flat`; unknowns that are -1 (held fixed) are dropped, and what stands twice is
            summed.
        count : int
            Number of rows.
        """
        numbers, unknowns, values = flat(blocks)
        free = unknowns >= 0
        numbers, unknowns, values = numbers[free], unknowns[free], values[free]
        if comm.size > 1:
            unknowns, numbers, values = route(comm, ranges, unknowns, numbers, values)
        first, last = int(ranges[comm.rank]), int(ranges[comm.rank + 1])
        placed = (values, (numbers, unknowns - first))
        return cls(comm, sparse.coo_matrix(placed, shape=(count, last - first)).tocsr())

    def __len__(self) -> int:
        return self.matrix.shape[0]

    def __getitem__(self, chosen: slice | np.ndarray) -> Rows:
        return Rows(self.comm, self.matrix[chosen])

    @functools.cached_property
    def _compact(self) -> tuple[np.ndarray, sparse.csr_matrix]:
        """Unknowns that a row has an entry of, and the rows over these alone."""
        used, places = np.unique(self.matrix.indices, return_inverse=True)
        shape = (len(self), len(used))
        return used, sparse.csr_matrix((self.matrix.data, places, self.matrix.indptr), shape=shape)

    def lengths(self) -> np.ndarray:
        """(rows,): sums of the moduli of the coefficients, on all ranks. Collective."""
        return summed(self.comm, np.asarray(abs(self.matrix).sum(axis=1)).ravel())

    def local(self, owned: np.ndarray) -> np.ndarray:
        """This rank's share of the values of one field (owned,) or of n fields (owned, n)."""
        used, matrix = self._compact
        return matrix @ np.ascontiguousarray(owned[used])

    def __call__(self, owned: np.ndarray) -> np.ndarray:
        """Values (rows,) or (rows, n) of one or n fields, on all ranks. Collective."""
        return summed(self.comm, self.local(owned))

    def forces(self, weights: np.ndarray) -> np.ndarray:
        """(owned,): rows^T weights."""
        return self._transposed @ weights

    def columns(self, chosen: slice | np.ndarray) -> np.ndarray:
        """(owned, k) dense transposes of some rows."""
        return self._transposed[:, chosen].toarray(order="F")


def flat(blocks: Iterable[Triples]) -> Triples:
    """Rows, columns and values of all entries of blocks: rows (k,), columns (n,) or (k, n), and values
    (k, n).
    """
    whole = [np.broadcast_arrays(rows[:, None], columns, values) for rows, columns, values in blocks]
    rows, columns, values = zip(
        (_NONE, _NONE, np.empty(0)), *([part.ravel() for part in one] for one in whole)
    )
    return np.concatenate(rows), np.concatenate(columns), np.concatenate(values)

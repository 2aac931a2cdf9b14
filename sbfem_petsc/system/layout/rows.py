"""Linear forms of the displacement unknowns whose values every rank knows: gaps, points, stress
intensities.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence

import numpy as np
from scipy import sparse

from ...petsc import MPI
from ..solve.assembly import Triples, route


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
    def of(cls, comm: MPI.Comm, ranges: np.ndarray, rows: Sequence[tuple[np.ndarray, np.ndarray]]) -> Rows:
        """Rows that every rank knows whole.

        Parameters
        ----------
        comm : Comm
        ranges : (ranks + 1,) int array
            Ownership of the unknowns.
        rows : sequence of (unknowns, coefficients)
            Global numbers; -1 (held fixed) is dropped, and what stands twice is summed.
        """
        first, last = int(ranges[comm.rank]), int(ranges[comm.rank + 1])
        lengths = [len(numbers) for numbers, _ in rows]
        numbers = np.concatenate([n for n, _ in rows] or [np.empty(0, dtype=int)])
        values = np.concatenate([v for _, v in rows] or [np.empty(0)])
        places = np.repeat(np.arange(len(rows)), lengths)
        mine = (numbers >= first) & (numbers < last)
        entries = (values[mine], (places[mine], numbers[mine] - first))
        return cls(comm, sparse.coo_matrix(entries, shape=(len(rows), last - first)).tocsr())

    @classmethod
    def gathered(cls, comm: MPI.Comm, ranges: np.ndarray, entries: Triples, count: int) -> Rows:
        """Rows of which each is known to one rank, or several of which each knows a part. Collective.

        Parameters
        ----------
        entries : (rows, unknowns, coefficients)
            This rank's, flat; unknowns that are -1 (held fixed) are dropped, and what stands twice is summed.
        count : int
            Number of rows.
        """
        numbers, unknowns, values = (np.asarray(part) for part in entries)
        free = unknowns >= 0
        numbers, unknowns, values = (
            numbers[free].astype(np.int64),
            unknowns[free].astype(np.int64),
            values[free],
        )
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
        result = np.asarray(abs(self.matrix).sum(axis=1)).ravel()
        self.comm.Allreduce(MPI.IN_PLACE, result)
        return result

    def local(self, owned: np.ndarray) -> np.ndarray:
        """This rank's share of the values of one field (owned,) or of n fields (owned, n)."""
        used, matrix = self._compact
        return matrix @ np.ascontiguousarray(owned[used])

    def __call__(self, owned: np.ndarray) -> np.ndarray:
        """Values (rows,) or (rows, n) of one or n fields, on all ranks. Collective."""
        result = np.ascontiguousarray(self.local(owned))
        self.comm.Allreduce(MPI.IN_PLACE, result)
        return result

    def forces(self, weights: np.ndarray) -> np.ndarray:
        """(owned,): rows^T weights."""
        return self._transposed @ weights

    def columns(self, chosen: slice | np.ndarray) -> np.ndarray:
        """(owned, k) dense transposes of some rows."""
        return self._transposed[:, chosen].toarray(order="F")


def flat_entries(rows: dict[int, tuple[np.ndarray, np.ndarray]]) -> Triples:
    """(rows, unknowns, coefficients) of a dict of row numbers to (unknowns, coefficients)."""
    numbers = np.repeat(
        np.array(list(rows), dtype=np.int64), [len(unknowns) for unknowns, _ in rows.values()]
    )
    return (
        numbers,
        np.concatenate([np.empty(0, dtype=np.int64), *(unknowns for unknowns, _ in rows.values())]),
        np.concatenate([np.empty(0), *(values for _, values in rows.values())]),
    )

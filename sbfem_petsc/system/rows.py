"""Linear forms of the displacement unknowns whose values every rank knows: gaps, points, stress intensities."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy import sparse

from ..petsc import MPI, PETSc


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
    def gathered(cls, comm: MPI.Comm, ranges: np.ndarray, rows: dict[int, tuple], count: int) -> Rows:
        """Rows of which each is known to one rank, or several of which each knows a part. Collective.

        Parameters
        ----------
        rows : dict of int to (unknowns, coefficients)
            This rank's, by their numbers.
        count : int
            Number of rows.
        """
        parts: list[list] = [[] for _ in range(count)]
        for known in comm.allgather(rows):
            for number, row in known.items():
                parts[number].append(row)
        empty = (np.empty(0, dtype=int), np.empty(0))
        return cls.of(
            comm,
            ranges,
            [tuple(np.concatenate(column) for column in zip(*part)) if part else empty for part in parts],
        )

    def __len__(self) -> int:
        return self.matrix.shape[0]

    def __getitem__(self, chosen) -> Rows:
        return Rows(self.comm, self.matrix[chosen])

    def local(self, owned: np.ndarray) -> np.ndarray:
        """This rank's share of the values of one field (owned,) or of n fields (owned, n)."""
        return self.matrix @ owned

    def __call__(self, owned: np.ndarray) -> np.ndarray:
        """Values (rows,) or (rows, n) of one or n fields, on all ranks. Collective."""
        result = np.ascontiguousarray(self.local(owned))
        self.comm.Allreduce(MPI.IN_PLACE, result)
        return result

    def add_to(self, vector: PETSc.Vec, weights: np.ndarray) -> None:
        """vector += rows^T weights."""
        used = np.flatnonzero(weights)
        if len(used):
            vector.array[:] += self.matrix[used].T @ weights[used]

    def columns(self, chosen: slice | np.ndarray) -> np.ndarray:
        """(owned, k) dense transposes of some rows."""
        return np.asfortranarray(self._transposed[:, chosen].toarray())

"""Fields on their way from the ranks to rank 0, piece by piece."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..petsc import MPI

# Rows of a field that rank 0 holds at a time: 1 MB of plane vectors.
SLAB = 65536


def global_size(comm: MPI.Comm, numbers: np.ndarray) -> int:
    """One more than the largest number on any rank."""
    return int(comm.allreduce(int(numbers.max(initial=-1)), MPI.MAX)) + 1


def stream(
    comm: MPI.Comm,
    numbers: np.ndarray,
    values: np.ndarray,
    size: int,
    consume: Callable[[int, np.ndarray], None],
    slab: int = SLAB,
) -> None:
    """Bring rows of a distributed field to rank 0 in the order of their global numbers, one slab after the
    other.

    Parameters
    ----------
    comm : Comm
    numbers : (m,) int array
        Global numbers of this rank's rows, ascending; a row that several ranks hold has the same values on
        all of them.
    values : (m, ...) array
    size : int
        Number of global rows.
    consume : callable
        ``consume(first, rows)`` on rank 0 for the rows ``first`` to ``first + len(rows) - 1``. Its error does
        not stop the exchange, since the other ranks would wait forever; it is raised on rank 0 at the end.
    """
    values = np.ascontiguousarray(values)
    starts = np.append(np.arange(0, size, slab), size)
    cuts = np.searchsorted(numbers, starts)
    counts = comm.gather(np.diff(cuts))
    error: Exception | None = None
    for k, first in enumerate(starts[:-1]):
        mine = slice(cuts[k], cuts[k + 1])
        if comm.rank:
            if mine.stop > mine.start:
                comm.Send(np.ascontiguousarray(numbers[mine], dtype=np.int64), 0, tag=1)
                comm.Send(values[mine], 0, tag=2)
            continue
        assert counts is not None  # on rank 0
        rows = np.zeros((starts[k + 1] - first, *values.shape[1:]), dtype=values.dtype)
        rows[numbers[mine] - first] = values[mine]
        for rank in range(1, comm.size):
            count = counts[rank][k]
            if count:
                where, what = (
                    np.empty(count, dtype=np.int64),
                    np.empty((count, *values.shape[1:]), dtype=values.dtype),
                )
                comm.Recv(where, rank, tag=1)
                comm.Recv(what, rank, tag=2)
                rows[where - first] = what
        if error is None:
            try:
                consume(int(first), rows)
            except Exception as problem:
                error = problem
    if error is not None:
        raise error

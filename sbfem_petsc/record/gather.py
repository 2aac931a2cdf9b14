"""Fields of several ranks, whole on rank 0."""

from __future__ import annotations

import numpy as np

from ..petsc import MPI


def whole(comm: MPI.Comm, numbers: np.ndarray, values: np.ndarray) -> np.ndarray | None:
    """Rows of all ranks by their global numbers, on rank 0; None elsewhere. Collective.

    Parameters
    ----------
    comm : Comm
    numbers : (m,) int array
        Global numbers of this rank's rows; a row that several ranks hold is the same on all of them.
    values : (m, ...) array
    """
    parts = comm.gather((numbers, np.ascontiguousarray(values)))
    if parts is None:
        return None
    size = 1 + max(int(rows.max(initial=-1)) for rows, _ in parts)
    found = np.zeros((size, *values.shape[1:]), dtype=values.dtype)
    for rows, part in parts:
        found[rows] = part
    return found

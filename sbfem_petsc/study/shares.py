"""Who computes which row of a sweep: counters on one rank that all groups of ranks take numbers from."""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from typing import Any

import numpy as np
from mpi4py import MPI

from ..ranks.parallel import alone


class Shares(contextlib.AbstractContextManager["Shares"]):
    """Rows of structures, each for one group of ranks. Collective to make and to leave.

    Whoever is free takes a structure that nobody has begun, so that each is made once; when there is none
    left, one that others are at work on. A row is taken when the structure has been made for it: those that
    join others cost these no time, whatever a structure costs.

    Parameters
    ----------
    comm : Comm
        All ranks; the counters are on the first.
    size : int
        Ranks that compute a row together.
    rows : sequence of int
        Number of rows of each structure, the same on all ranks.

    Attributes
    ----------
    group : Comm
        Ranks that compute a row together with this one.
    """

    def __init__(self, comm: Any, size: int, rows: Sequence[int]):
        self.comm, self.group = comm, comm.Split(comm.rank // size, comm.rank)
        self._rows = np.array(rows, dtype=np.int64)
        # the number of structures begun, then of rows taken of each
        count = 1 + len(rows)
        self._window = MPI.Win.Allocate(8 * count if comm.rank == 0 else 0, 8, comm=comm)
        if comm.rank == 0:
            counters: Any = self._window.tomemory()
            np.frombuffer(counters, dtype=np.int64)[:] = 0
        comm.Barrier()

    def __exit__(self, *_: object) -> None:
        # an error on one rank alone ends the program; waiting for the others here would hide it
        if not alone(self.comm):
            self.comm.Barrier()
            self._window.Free()
            self.group.Free()

    def structure(self) -> int | None:
        """Number of a structure to work on; None when no help is needed. Collective over the group."""
        found = None
        if self.group.rank == 0:
            found = self._taken(0)
            if found >= len(self._rows):
                left = self.left()
                # a last row is left to those who are there: a structure made for it alone comes too late
                found = int(left.argmax()) if left.max(initial=0) > 1 else None
        return self.group.bcast(found)

    def row(self, structure: int) -> int | None:
        """Number of a row, from 0, that nobody has taken of a structure; None if there is none. Collective
        over the group.
        """
        found = self._taken(1 + structure) if self.group.rank == 0 else None
        found = int(self.group.bcast(found))
        return found if found < self._rows[structure] else None

    def left(self) -> np.ndarray:
        """Number of rows of each structure that nobody has taken."""
        counters = np.empty(1 + len(self._rows), dtype=np.int64)
        self._window.Lock(0, MPI.LOCK_SHARED)
        self._window.Get(counters, 0)
        self._window.Unlock(0)
        return np.maximum(self._rows - counters[1:], 0)

    def _taken(self, counter: int) -> int:
        one, found = np.ones(1, dtype=np.int64), np.empty(1, dtype=np.int64)
        self._window.Lock(0, MPI.LOCK_SHARED)
        self._window.Fetch_and_op(one, found, 0, counter, MPI.SUM)
        self._window.Unlock(0)
        return int(found[0])

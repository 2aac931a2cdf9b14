"""Errors and small exchanges between the ranks of a communicator."""

from __future__ import annotations

import sys
import traceback
from typing import Literal

from mpi4py import MPI


class collective:
    """Context in which an error on one rank is raised on all of them.

    The body must not communicate. Every rank of `comm` enters it; after it, the error of the lowest failing
    rank is raised on every rank that had none, so that no rank waits for another that has given up.
    """

    def __init__(self, comm: MPI.Comm):
        self.comm = comm

    def __enter__(self) -> collective:
        return self

    def __exit__(self, kind, error, trace) -> Literal[False]:
        if error is not None and not isinstance(error, Exception):
            return False
        mine = None if error is None else (kind, error.args)
        first = next((e for e in self.comm.allgather(mine) if e is not None), None)
        if first is None:
            return False
        if error is None:
            error = first[0](*first[1])
        error.on_all_ranks = True
        raise error.with_traceback(trace)


def on_root(comm: MPI.Comm, work):
    """`work()` on rank 0, None elsewhere; an error of it is raised on every rank."""
    result = None
    with collective(comm):
        if comm.rank == 0:
            result = work()
    return result


def install_abort(comm: MPI.Comm) -> None:
    """Let an uncaught error of one rank end all ranks instead of leaving them waiting for it.

    An error known to all ranks is printed once, by rank 0, and every rank exits with code 1.
    """
    if comm.size == 1 or getattr(sys.excepthook, "aborts_communicator", False):
        return
    previous = sys.excepthook

    def hook(kind, error, trace):
        if getattr(error, "on_all_ranks", False):
            if comm.rank == 0:
                previous(kind, error, trace)
            return
        traceback.print_exception(kind, error, trace)
        sys.stderr.write(f"rank {comm.rank} of {comm.size} failed: all ranks are stopped\n")
        sys.stderr.flush()
        comm.Abort(1)

    hook.aborts_communicator = True  # type: ignore[attr-defined]
    sys.excepthook = hook

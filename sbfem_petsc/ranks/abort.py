"""How a program on several ranks ends: no rank waits for one that has failed or left.

Installed when the package is imported under an MPI launcher; mpi4py is not imported here, for that starts
MPI.
"""

from __future__ import annotations

import atexit
import signal
import sys
import time
from types import TracebackType
from typing import Any

# Of the message by which a rank tells the others that its program has ended.
LEAVING = 29_876
# Seconds that ranks which end together may be apart.
PATIENCE = 2.0
# Seconds after which a rank that asks the launcher to end all, and is not answered, ends itself.
UNANSWERED = 10


class _State:
    """What is known of this process' end."""

    installed = False
    # of a `SystemExit` on its way through what all ranks call
    status: Any = None
    # the communicator of the latest exchange: the one whose ranks share an error
    latest: Any = None


def install() -> None:
    """Let an uncaught error of one rank, or `sys.exit` in a function that a solver calls, end all ranks
    instead of leaving them waiting for it. Who leaves elsewhere is missed where the others next meet.

    An error known to all ranks of a communicator is printed once, by its rank 0. To be called again when
    PETSc is loaded, whose own end would otherwise come first and wait for the other ranks.
    """
    atexit.unregister(_at_exit)
    atexit.register(_at_exit)
    if _State.installed:
        return
    _State.installed = True
    previous = sys.excepthook

    def hook(kind: type[BaseException], error: BaseException, trace: TracebackType | None) -> None:
        world = several_ranks()
        if world is None:  # the launcher ends the others when it sees the exit code
            previous(kind, error, trace)
        elif getattr(error, "on_all_ranks", False):
            _end_together(world, lambda: previous(kind, error, trace))
        else:
            previous(kind, error, trace)
            sys.stderr.write(f"rank {world.rank} of {world.size} failed: all ranks are stopped\n")
            _stop(world, 1)

    sys.excepthook = hook


def several_ranks() -> Any:
    """COMM_WORLD if MPI runs on several ranks, else None."""
    mpi = sys.modules.get("mpi4py.MPI")
    if mpi is None or not mpi.Is_initialized() or mpi.Is_finalized():
        return None
    return mpi.COMM_WORLD if mpi.COMM_WORLD.size > 1 else None


def noted(comm: Any) -> None:
    """Remember the communicator whose ranks exchange something."""
    _State.latest = comm


def leaves(error: SystemExit) -> None:
    """Remember how this rank leaves what all ranks call, which only the interpreter sees outside of it."""
    _State.status = error.code


def left(comm: Any) -> int | None:
    """A rank of `comm` whose program has ended, None if there is none."""
    world = several_ranks()
    if world is None:
        return None
    from mpi4py import MPI

    status = MPI.Status()
    if not world.Iprobe(source=MPI.ANY_SOURCE, tag=LEAVING, status=status):
        return None
    ours = MPI.Group.Translate_ranks(world.group, [status.source], comm.group)[0]
    return None if ours == MPI.UNDEFINED else ours


def _end_together(world: Any, report: Any) -> None:
    """End the ranks that share an error; those that do not are stopped."""
    comm = _State.latest or world
    if comm.rank == 0:
        report()
    if comm.size < world.size:
        if comm.rank > 0:  # rank 0 speaks first
            time.sleep(PATIENCE)
        _stop(world, 1)


def _at_exit() -> None:
    """Tell the other ranks that this one leaves; if it was with a status out of what all of them call, they
    leave too, or are stopped.
    """
    world = several_ranks()
    if world is None:
        return
    others = [rank for rank in range(world.size) if rank != world.rank]
    requests = [world.Isend(b"", dest=rank, tag=LEAVING) for rank in others]
    status = _State.status
    if status is None or status == 0:
        return
    waited = time.monotonic()
    while others and time.monotonic() - waited < PATIENCE:
        others = [rank for rank in others if not world.Iprobe(source=rank, tag=LEAVING)]
        time.sleep(0.01)
    if others:
        sys.stderr.write(
            f"rank {world.rank} of {world.size} has left by sys.exit({status!r}): all ranks are stopped\n"
        )
        _stop(world, status if isinstance(status, int) else 1)
    del requests


def _stop(world: Any, code: int) -> None:
    sys.stdout.flush()
    sys.stderr.flush()
    # a launcher that does not answer the call would leave this rank in it: its death is seen in any case
    signal.signal(signal.SIGALRM, signal.SIG_DFL)
    signal.alarm(UNANSWERED)
    world.Abort(code)

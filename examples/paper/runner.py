"""Share the parts out among the ranks, each on its own models, and collect what they found."""

from __future__ import annotations

import contextlib
import sys
import time
import traceback
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from .bench import Bench
from .findings import Finding, Part
from .store import Store

# What a part may fail with for a reason that is one sentence; anything else is a mistake in the program and
# is shown with its stack.
EXPECTED = (ValueError, TypeError, KeyError, RuntimeError, OSError)
DONE = 7
# Seconds between looks at whether the others have ended: a rank that waits within MPI takes a core from them.
PAUSE = 0.1


@dataclass(frozen=True)
class Outcome:
    """What became of a part.

    Attributes
    ----------
    finding : Finding or None
    seconds : float
    error : str
        The sentence if it failed.
    reused : bool
    """

    finding: Finding | None
    seconds: float
    error: str = ""
    reused: bool = False


def share_out(parts: Sequence[Part], ranks: int) -> list[list[Part]]:
    """Parts of each rank: the longest first, each to the rank with the least to do."""
    shares, loads = [[] for _ in range(ranks)], [0.0] * ranks
    for part in sorted(parts, key=lambda p: -p.seconds):
        rank = loads.index(min(loads))
        shares[rank].append(part)
        loads[rank] += part.seconds
    return shares


def run_parts(
    parts: Sequence[Part],
    store: Store,
    comm,
    fresh: bool,
    pictures: bool,
    told: Callable[[str, float, Outcome], None],
) -> dict[str, Outcome]:
    """Compute parts, or take them from the store. Collective.

    Parameters
    ----------
    parts : sequence of Part
    store : Store
    comm : mpi4py communicator
    fresh : bool
        Whether stored parts are computed again.
    pictures : bool
    told : callable
        On rank 0, with a finished part's name, the fraction done and the outcome without its curves.

    Returns
    -------
    dict of str to Outcome, on all ranks
    """
    stored = {}
    if comm.rank == 0 and not fresh:
        found = {part.name: store.load(part, pictures) for part in parts}
        stored = {name: Outcome(*result, reused=True) for name, result in found.items() if result is not None}
    stored = comm.bcast(stored)
    missing = [part for part in parts if part.name not in stored]
    bench, mine = Bench(), {}
    total, done = sum(part.seconds for part in missing), 0.0

    def tell(name: str, outcome: Outcome) -> None:
        nonlocal done
        done += next(part.seconds for part in missing if part.name == name)
        told(name, done / total, outcome)

    shares = share_out(missing, comm.size)
    sent, awaited = [], len(missing) - len(shares[0])

    def listen() -> None:
        nonlocal awaited
        while comm.iprobe(tag=DONE):
            tell(*comm.recv(tag=DONE))
            awaited -= 1

    for part in shares[comm.rank]:
        mine[part.name] = outcome = attempt(part, bench, store, pictures)
        short = Outcome(None, outcome.seconds, outcome.error)
        if comm.rank:
            sent.append(comm.isend((part.name, short), dest=0, tag=DONE))
        else:
            tell(part.name, short)
            listen()
    ended = comm.Ibarrier()
    while not ended.Test():
        time.sleep(PAUSE)
        if comm.rank == 0:
            listen()
    for _ in range(awaited if comm.rank == 0 else 0):
        tell(*comm.recv(tag=DONE))
    for request in sent:
        request.wait()
    outcomes = dict(stored)
    for share in comm.allgather(mine):
        outcomes.update(share)
    return {part.name: outcomes[part.name] for part in parts}


def attempt(part: Part, bench: Bench, store: Store, pictures: bool) -> Outcome:
    """Compute, draw and store a part; a failure is its own alone."""
    began = time.perf_counter()
    try:
        store.forget(part)
        finding = part.compute(bench)
        seconds = time.perf_counter() - began
        store.save(part, finding, seconds, pictures)
        return Outcome(finding, time.perf_counter() - began)
    except EXPECTED as error:
        # str() of a KeyError is the repr of its text
        return Outcome(
            None,
            time.perf_counter() - began,
            str(error.args[0]) if isinstance(error, KeyError) and error.args else str(error),
        )
    except Exception as error:
        traceback.print_exc()
        return Outcome(None, time.perf_counter() - began, f"{type(error).__name__}: {error}")


@contextlib.contextmanager
def progress(comm, out):
    """A callable that tells of a finished part: a bar on rank 0 and a terminal, a line elsewhere."""

    def line(name: str, fraction: float, outcome: Outcome) -> None:
        out.print(
            f"[{100 * fraction:3.0f} %] {name}: {outcome.error or f'{outcome.seconds:.1f} s'}", markup=False
        )

    if comm.rank > 0 or not sys.stderr.isatty():
        yield line
        return
    from rich.console import Console
    from rich.progress import Progress

    with Progress(console=Console(file=sys.stderr), transient=True) as bar:
        task = bar.add_task("reproduce_paper", total=1.0)
        yield lambda name, fraction, outcome: bar.update(
            task, completed=fraction, description=f"{name}: {'failed' if outcome.error else 'done'}"
        )

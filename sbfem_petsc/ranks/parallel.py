"""Errors, agreement and small exchanges between the ranks of a communicator."""

from __future__ import annotations

import contextlib
import contextvars
import functools
import inspect
import pickle
import sys
import time
from collections.abc import Callable, Mapping
from types import TracebackType
from typing import Any, Literal, ParamSpec, TypeVar

import numpy as np
from mpi4py import MPI

from ..checks import callback, shown
from ..errors import TOLD, SolveError, SolverFailure, UnknownName, on_all_ranks
from . import abort
from .fingerprint import Fingerprint, fingerprint

# Seconds after which an exchange with a rank that has left is given up: its last word may be on the way.
GRACE = 1.0
# A wait first looks this many times without a pause, then for PROMPT seconds as often as the core is free,
# then every PAUSE seconds: where there are more ranks than cores, those that work need them.
SPIN, PROMPT, PAUSE = 1000, 0.05, 1e-3
# Relative difference of numbers that different processors explain.
ROUND_OFF = 1e-9
WIDTH = 17  # bytes of an exchange: its kind and a digest
TAG = 29_875  # of its messages
FINE, FAILED, AGREE = b"\0", b"\1", b"\2"

# Arguments that each rank may have of its own: what is told to a person.
OWN = {"progress", "watch"}
# Attributes by which a result leads to the ranks that share it, and entries of a sequence that are asked.
SHARED, MOST = ("comm", "reduced", "model", "own", "states", "fields", "motions"), 10

# What an error that cannot be sent is on other ranks: the first of these that it is.
_KINDS: dict[str, type[Exception]] = {
    kind.__name__: kind
    for kind in (
        UnknownName,
        SolveError,
        SolverFailure,
        KeyError,
        TypeError,
        ValueError,
        OSError,
        ArithmeticError,
    )
}

Result = TypeVar("Result")
Parameters = ParamSpec("Parameters")
# Whether other ranks wait for this one, which works alone (`on_root`).
_waited_for: contextvars.ContextVar[bool] = contextvars.ContextVar("waited for", default=False)


class RanksDiffer(ValueError):
    """Ranks were given different arguments, or call different functions."""


class collective:
    """Context in which an error on one rank is raised on all of them.

    The body must not communicate. Every rank of `comm` enters it; after it, the error of the lowest failing
    rank is raised on every rank that had none or another one, so that no rank waits for another that has
    given up, and all go on at the same place.
    """

    def __init__(self, comm: MPI.Comm):
        self.comm = comm

    def __enter__(self) -> collective:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> Literal[False]:
        if error is not None and not isinstance(error, Exception):
            return False
        comm = self.comm
        abort.noted(comm)
        if comm.size == 1:
            if error is not None:
                on_all_ranks(error)
            return False
        told = _exchange(comm, FINE if error is None else FAILED)
        if all(word[:1] == FINE for word in told):
            return False
        if any(word[:1] == AGREE for word in told):
            raise on_all_ranks(_apart(comm, told))
        messages = comm.allgather(None if error is None else _packed(error))
        first = next(message for message in messages if message is not None)
        mine = messages[comm.rank]
        if error is None or mine is None or mine[1:] != first[1:]:
            raise on_all_ranks(_unpacked(first))
        on_all_ranks(error)
        return False


def on_root(comm: MPI.Comm, work: Callable[[], Result]) -> Result | None:
    """`work()` on rank 0, None elsewhere; an error of it is raised on every rank.

    Raises
    ------
    SolveError
        If `work` calls what is called on all ranks, such as `save` of a result that they share: it would wait
        for them for ever.
    """
    comm = checked_communicator("on_root", comm)
    callback("on_root", "work", work)
    result = None
    with collective(comm):
        if comm.rank == 0:
            token = _waited_for.set(comm.size > 1 or _waited_for.get())
            try:
                result = work()
            finally:
                _waited_for.reset(token)
    return result


def agree(comm: MPI.Comm, owner: str, arguments: Mapping[str, Any]) -> None:
    """Refuse arguments that differ between the ranks of `comm`, which would mix into a wrong result.
    Collective.

    Numbers may differ by rounding. A rank that calls another function meanwhile is told of too.

    Parameters
    ----------
    comm : Comm
    owner : str
        The function, for messages.
    arguments : dict by name
        What every rank was given.

    Raises
    ------
    RanksDiffer
        On all ranks, with the name of the first argument that differs.
    """
    abort.noted(comm)
    if comm.size == 1:
        return
    marks = {name: fingerprint(value) for name, value in arguments.items()}
    whole = fingerprint((owner, [mark.digest for mark in marks.values()])).digest
    told = _exchange(comm, AGREE + whole)
    if all(word == told[0] for word in told):
        return
    if any(word[:1] != AGREE for word in told):
        raise on_all_ranks(_apart(comm, told))
    texts = {name: shown(value) for name, value in arguments.items()}
    calls: list[tuple[str, dict[str, Fingerprint], dict[str, str]]] = comm.allgather((owner, marks, texts))
    names = [call[0] for call in calls]
    if len(set(names)) > 1:
        other = next(rank for rank, name in enumerate(names) if name != names[0])
        raise on_all_ranks(
            RanksDiffer(
                f"rank 0 calls {names[0]} while rank {other} calls {names[other]}; call the same on all ranks"
            )
        )
    for name, first in calls[0][1].items():
        for rank, (_, others, texts) in enumerate(calls):
            if not first.same(others[name], ROUND_OFF):
                raise on_all_ranks(
                    RanksDiffer(
                        f"{owner}: {name} differs between the ranks: {calls[0][2][name]} on rank 0, "
                        f"{texts[name]} on rank {rank}; give every rank the same"
                    )
                )


def agreed(*own: str) -> Callable[[Callable[Parameters, Result]], Callable[Parameters, Result]]:
    """Decorator of what all ranks call together: before it begins, its arguments are compared by `agree` over
    the ranks of every communicator among them, those that share a model or a result included.

    Every public function that communicates has it; a test finds those that have not. On one rank it costs
    nothing.

    Parameters
    ----------
    own : str
        Arguments that each rank may have of its own, beside those of `OWN`.
    """

    def decorated(function: Callable[Parameters, Result]) -> Callable[Parameters, Result]:
        signature = inspect.signature(function)
        apart = {*own, *OWN} | ({"self"} if function.__name__ == "__init__" else set())
        owner = function.__qualname__.removesuffix(".__init__").replace("._", ".")

        @functools.wraps(function)
        def call(*args: Parameters.args, **kwargs: Parameters.kwargs) -> Result:
            if MPI.COMM_WORLD.size > 1:
                _compare(owner, _given(signature, args, kwargs, apart), "comm" in signature.parameters)
            token = TOLD.set(set()) if TOLD.get() is None else None
            try:
                return function(*args, **kwargs)
            except SystemExit as error:
                abort.leaves(error)
                raise
            finally:
                if token is not None:
                    TOLD.reset(token)

        call.own = apart  # type: ignore[attr-defined]
        return call

    return decorated


def _given(
    signature: inspect.Signature, args: tuple, kwargs: dict[str, Any], apart: set[str]
) -> dict[str, Any] | None:
    """Arguments of a call by name, defaults included; None for one that Python refuses."""
    try:
        bound = signature.bind(*args, **kwargs)
    except TypeError:
        return None
    bound.apply_defaults()
    given = {name: value for name, value in bound.arguments.items() if name not in apart}
    for name, parameter in signature.parameters.items():
        if parameter.kind is parameter.VAR_KEYWORD:
            given |= given.pop(name)
    return given


def _compare(owner: str, given: dict[str, Any] | None, everywhere: bool) -> None:
    """`agree` on the arguments of a call over every communicator among them, or over COMM_WORLD where there
    is none and that is the default.
    """
    if given is None:
        return
    found: list[MPI.Comm] = []
    for value in given.values():
        comm = ranks_of(value)
        if comm is not None and comm not in found:
            found.append(comm)
    if not found and everywhere and given["comm"] is None:
        found.append(MPI.COMM_WORLD)
    for comm in found:
        agree(comm, owner, given)


def ranks_of(value: Any, depth: int = 0) -> MPI.Comm | None:
    """Ranks that share a model or a result, or the first of several; None for what is a rank's own."""
    if isinstance(value, MPI.Comm):
        return value if isinstance(value, MPI.Intracomm) and value != MPI.COMM_NULL else None
    if depth > 4:
        return None
    parts: Any = ()
    if isinstance(value, (list, tuple)):
        parts = value[:MOST]
    elif isinstance(value, Mapping):
        parts = list(value.values())[:MOST]
    elif type(value).__module__.startswith(f"{__package__.partition('.')[0]}."):
        parts = (getattr(value, name, None) for name in SHARED)
    return next((comm for comm in (ranks_of(part, depth + 1) for part in parts) if comm is not None), None)


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


def checked_communicator(owner: str, comm: Any) -> MPI.Comm:
    """A communicator of mpi4py, COMM_WORLD for None; TypeError or ValueError otherwise."""
    if comm is None:
        return MPI.COMM_WORLD
    if not isinstance(comm, MPI.Intracomm):
        raise TypeError(
            f"{owner}: comm = {shown(comm)} must be a communicator of mpi4py, such as MPI.COMM_WORLD"
        )
    if comm == MPI.COMM_NULL:
        raise ValueError(
            f"{owner}: comm = MPI.COMM_NULL has no ranks; leave the model to the ranks that have one"
        )
    return comm


def alone(comm: MPI.Comm) -> bool:
    """Whether an error is on its way that other ranks of `comm` do not know of: nothing collective may be
    done then, such as the end of a factorisation, for they would be waited for.
    """
    error = sys.exc_info()[1]
    return comm.size > 1 and error is not None and not getattr(error, "on_all_ranks", False)


def _exchange(comm: MPI.Comm, word: bytes) -> list[bytes]:
    """The words of all ranks; an error if one of them has ended its program.

    By messages through rank 0, which can be given up while they are waited for; a collective operation would
    be matched by those with which PETSc and MPI end on a rank that has left.
    """
    if _waited_for.get():
        raise SolveError(
            "what several ranks share is used on rank 0 alone, inside on_root, while the others wait for it; "
            "call it on all ranks"
        )
    mine = np.frombuffer(word.ljust(WIDTH, b"\0"), dtype=np.uint8)
    table = np.empty((comm.size, WIDTH), dtype=np.uint8)
    if comm.rank > 0:
        sent = comm.Isend(mine, dest=0, tag=TAG)
        _wait(comm, [sent, comm.Irecv(table, source=0, tag=TAG)])
    else:
        table[0] = mine
        _wait(comm, [comm.Irecv(table[rank], source=rank, tag=TAG) for rank in range(1, comm.size)])
        _wait(comm, [comm.Isend(table, dest=rank, tag=TAG) for rank in range(1, comm.size)])
    return [row.tobytes() for row in table]


def _wait(comm: MPI.Comm, requests: list[MPI.Request]) -> None:
    """Wait for messages, but not for ever for those of a rank that has left; a long wait leaves the core to
    others.
    """
    begun, missing, since, turns = time.monotonic(), None, 0.0, 0
    while not MPI.Request.Testall(requests):
        turns += 1
        if turns < SPIN:
            continue
        now = time.monotonic()
        time.sleep(0.0 if now - begun < PROMPT else PAUSE)
        if missing is None:
            missing, since = abort.left(comm), now
        elif now - since > GRACE:
            raise SolveError(
                f"rank {missing} has ended its program, but rank {comm.rank} of {comm.size} still waits for "
                "it: what works on a model, or with its results on several ranks, is called on all of them"
            )


def _apart(comm: MPI.Comm, told: list[bytes]) -> RanksDiffer:
    """Ranks that are at different places of a program."""
    kinds = [word[:1] for word in told]
    other = next(rank for rank, kind in enumerate(kinds) if kind != kinds[0])
    return RanksDiffer(
        f"rank {other} of {comm.size} is at another place of the program than rank 0; what works on a model "
        "is called on all ranks, in the same order"
    )


def _packed(error: Exception) -> tuple[bytes | None, str, str]:
    """An error as it can be sent: itself if it survives that, the nearest known type and its text."""
    kind = next((name for name, kind in _KINDS.items() if isinstance(error, kind)), "")
    whole = None
    with contextlib.suppress(Exception):  # whatever a foreign class does when it is copied
        sent = pickle.dumps(error)
        copy = pickle.loads(sent)
        whole = sent if type(copy) is type(error) and str(copy) == str(error) else None
    return whole, kind, str(error)


def _unpacked(message: tuple[bytes | None, str, str]) -> Exception:
    """The error of another rank."""
    whole, kind, text = message
    if whole is not None:
        with contextlib.suppress(Exception):  # a class that this rank does not know
            known: Exception = pickle.loads(whole)
            return known
    plain = _KINDS.get(kind, RuntimeError)
    return UnknownName(text) if plain is KeyError else plain(text)

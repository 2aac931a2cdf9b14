"""Memory and disk that a run will need, compared with what there is before it starts."""

from __future__ import annotations

import contextlib
import ctypes
import math
import os
import resource
import shutil
from collections.abc import Callable
from typing import NamedTuple

from mpi4py import MPI

from ..errors import OutOfMemory
from .parallel import collective

# Bytes of rows that a history keeps by default; longer ones are decimated.
KEPT = 1_000_000_000
# Share of the free memory or disk that a run may take: others want some too.
SHARE = 0.9
# Points of a branch that there must be room for at the least.
FEW = 20
# Bytes of address space that the compiler of the time steps may need, which ends the process if it has none.
COMPILER = 200_000_000
# Unknowns from which freed factors are worth a look at the heap.
_MUCH = 50_000


def default_decimation(count: int, row: int) -> int:
    """Every so many of `count` steps are kept if their rows, of so many bytes, are to stay below `KEPT`."""
    return max(1, math.ceil(count * row / KEPT))


def available_memory() -> float:
    """Bytes that this process may still take: of the machine, its control groups and its limits."""
    return max(0, min(machine_memory(), address_space()))


def machine_memory() -> float:
    """Bytes that the processes of this machine and control group may still take; inf where nothing tells."""
    free = math.inf
    # some systems know the pages that there are, not those that are free
    with contextlib.suppress(OSError, ValueError):
        free = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
        free = os.sysconf("SC_AVPHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    with contextlib.suppress(OSError, ValueError, StopIteration):
        with open("/proc/meminfo", encoding="ascii") as file:
            line = next(line for line in file if line.startswith("MemAvailable:"))
        free = 1024 * int(line.split()[1])  # caches that are given up count as well
    return min(free, control_group_memory())


def control_group_memory(system: str = "/") -> float:
    """Bytes that the limits of this process' control groups leave, those above it included; inf without any.

    Parameters
    ----------
    system : str
        Folder in which proc and sys/fs/cgroup stand.
    """
    free = math.inf
    with contextlib.suppress(OSError, ValueError):
        with open(os.path.join(system, "proc/self/cgroup"), encoding="utf-8") as file:
            groups = [line.rstrip("\n").split(":", 2) for line in file]
        for _, controllers, path in groups:
            if controllers == "":  # version 2
                root, (most, used), kind = "sys/fs/cgroup", ("memory.max", "memory.current"), ""
            elif "memory" in controllers.split(","):
                root, kind = "sys/fs/cgroup/memory", "total_"
                most, used = "memory.limit_in_bytes", "memory.usage_in_bytes"
            else:
                continue
            # a container may see the path of its host, and its own group at the root
            parts = [part for part in path.split("/") if part not in ("", "..")]
            for depth in range(len(parts) + 1):
                folder = os.path.join(system, root, *parts[:depth])
                with contextlib.suppress(OSError, ValueError):  # no such group, or "max": no limit
                    limit, taken = (int(_read(folder, name)) for name in (most, used))
                    statistics = dict(line.split() for line in _read(folder, "memory.stat").splitlines())
                    # files in the cache are given up before anything is refused
                    cached = sum(
                        int(statistics.get(f"{kind}{age}_file", 0)) for age in ("active", "inactive")
                    )
                    free = min(free, limit - taken + cached)
    return free


def _read(folder: str, name: str) -> str:
    with open(os.path.join(folder, name), encoding="ascii") as file:
        return file.read()


def address_space() -> float:
    """Bytes of address space that this process' limit leaves; inf without one."""
    soft, _ = resource.getrlimit(resource.RLIMIT_AS)
    if soft != resource.RLIM_INFINITY:
        with contextlib.suppress(OSError, ValueError):
            with open("/proc/self/statm", encoding="ascii") as file:
                return soft - int(file.read().split()[0]) * os.sysconf("SC_PAGE_SIZE")
    return math.inf


def require_compiler(owner: str, comm: MPI.Comm) -> None:
    """Refuse a run on a rank whose limit leaves no address space to compile the time steps in. Collective.

    Raises
    ------
    OutOfMemory
        On all ranks.
    """
    with collective(comm):
        left = address_space()
        if left < COMPILER:
            raise OutOfMemory(
                f"{owner}: the limit of this process leaves {in_bytes(max(left, 0.0))} of address space, and "
                f"to compile the time steps takes up to {in_bytes(COMPILER)}; raise it (ulimit -v)"
            )


def give_back(unknowns: int) -> None:
    """Give what has been freed back to the system, of which the C library keeps gigabytes after the factor of
    a large matrix; where it has a way to (glibc).
    """
    if unknowns >= _MUCH:
        with contextlib.suppress(OSError, AttributeError):
            ctypes.CDLL(None).malloc_trim(0)


def require_memory(
    owner: str, comm: MPI.Comm, needed: float, what: str, remedy: Callable[[float], str]
) -> None:
    """Refuse a run whose ranks on this machine would together take more memory than is free. Collective.

    Parameters
    ----------
    needed : float
        Bytes a rank.
    what : str
        What would take them, for the message.
    remedy : callable
        Text from the share of it that there is room for.

    Raises
    ------
    ValueError
        On all ranks.
    """
    ranks = _neighbours(comm)
    together = needed * ranks
    with collective(comm):
        _require(f"{owner}: {what}", together, "memory", SHARE * ranks * _share(ranks), "", remedy)


def _neighbours(comm: MPI.Comm) -> int:
    """Ranks on this machine. Collective."""
    if comm.size == 1:
        return 1
    node = comm.Split_type(MPI.COMM_TYPE_SHARED)
    ranks: int = node.size
    node.Free()
    return ranks


def _share(ranks: int) -> float:
    """Bytes for each of the ranks here: they share the machine's memory, each has its own address space."""
    free = available_memory()
    return free if ranks == 1 else max(0.0, min(machine_memory() / ranks, free))


def room(comm: MPI.Comm, each: float, beside: float = 0.0) -> int:
    """How many things of `each` bytes a rank, and `beside` of all of them, find room in the free memory of
    every machine. Collective.
    """
    free = SHARE * comm.allreduce(_share(_neighbours(comm)), MPI.MIN)
    return int(min((free - beside) / each, 1e9))


def points_in_room(
    owner: str, comm: MPI.Comm, points: int, needed: tuple[float, float], *, what: str, remedy: str
) -> int:
    """How many of so many points of a branch there is memory for, of which each and all together need so many
    bytes a rank: few branches take as many as they may. `what` they are has a place for their number, for the
    message. Collective.

    Raises
    ------
    ValueError
        On all ranks, if there is no room for `FEW`.
    """
    few, (each, beside) = min(points, FEW), needed
    require_memory(owner, comm, few * each + beside, what.format(few), lambda share: remedy)
    return min(points, max(few, room(comm, each, beside)))


class PlannedFile(NamedTuple):
    """A file that a run writes.

    Attributes
    ----------
    path : str
    size : float
        Bytes of the whole file.
    continued : bool
        Whether the file exists and is written on in its place.
    """

    path: str
    size: float
    continued: bool = False


def require_disk(
    owner: str, comm: MPI.Comm, file: PlannedFile, *, what: str, remedy: Callable[[float], str]
) -> None:
    """Refuse a run whose file, written by rank 0, would not fit beside others on its disk. Collective.

    Parameters
    ----------
    file : PlannedFile
    what, remedy
        See `require_memory`.
    """
    with collective(comm):
        if comm.rank == 0:
            folder = os.path.dirname(os.path.realpath(file.path))
            if not os.path.isdir(folder):
                return  # told by who opens the file
            needed = file.size - (os.stat(file.path).st_blocks * 512 if file.continued else 0)
            free = SHARE * shutil.disk_usage(folder).free
            _require(f"{owner}: {what}", needed, "disk", free, f" in {folder!r}", remedy)


def _require(
    what: str, needed: float, of: str, free: float, where: str, remedy: Callable[[float], str]
) -> None:
    """Raise ValueError where more bytes are needed than are free."""
    if needed > free:
        raise ValueError(
            f"{what} would take {in_bytes(needed)} of {of}, {in_bytes(free)} are free{where}; "
            f"{remedy(free / needed)}"
        )


def in_bytes(value: float) -> str:
    """A size with its unit, three digits."""
    for unit in ("bytes", "kB", "MB", "GB"):
        if value < 1000.0:
            return f"{value:.3g} {unit}"
        value /= 1000.0
    return f"{value:.3g} TB"

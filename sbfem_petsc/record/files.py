"""Records in HDF5 files, laid out as netCDF-4: named dimensions, units, words, and HDF5's own checksums.

The layout is that of HDF5 1.10, in which all headers and indices have checksums. Small data stand in the
headers, others bear Fletcher's; texts have a fixed length, for HDF5 keeps those of any length without one.
"""

from __future__ import annotations

import contextlib
import importlib
import io
import os
import signal
import threading
import zlib
from collections.abc import Iterator, Mapping
from types import FrameType
from typing import Any

import h5py
import numpy as np

from meshing.folder_index import home_of
from meshing.whole_file import replaced

from ..checks import path as checked_path
from ..checks import shown
from ..petsc import MPI
from ..ranks.capacity import available_memory, in_bytes
from ..ranks.parallel import agreed, collective, ranks_of
from .about import each
from .journal import may_be_replaced
from .layout import bare, groups_of, records_in, text, text_of, write
from .record import Record

# Of the layout: files of another one are refused.
SCHEMA = 11
WHAT = "result file"
# Where the model of a journal's head is for what is beside it.
MODEL = "/model"
# What compression gains at most; how much time it may take, of 9.
DEFLATE, SPARE = 1032, 1
# What reading of what is not there, or is something else, ends in.
_WRONG = (ValueError, TypeError, AttributeError, LookupError, ArithmeticError)
UNSOUND = (*_WRONG, OSError, RuntimeError, zlib.error)


@agreed()
def save(path: Any, result: Any) -> None:
    """Write a result; the file takes its name when it is whole. Collective for those of several ranks: their
    rank 0 writes, with its own of what each rank has for itself.

    Parameters
    ----------
    path : str
        An HDF5 file that xarray (`open_dataset`, `open_datatree`), h5py and MATLAB read.
    result : any result, a sequence of results, or a dict of them by name

    Raises
    ------
    TypeError, ValueError
        If it is none, its parts are of other ranks, or the file cannot be written; on all ranks.
    """
    parts = each(result)
    comm = _writers(parts)
    with collective(comm):
        _check(result, parts)
    whole: dict[int, dict[str, Any]] = {}
    bodies: dict[int, Record | None] = {}
    for part in parts:
        _gather(part, whole, bodies)
    with collective(comm):
        if comm.rank == 0:
            with written(path) as file:
                seen: dict[int, str] = {}
                for group, part in groups_of(file, result):
                    write(group, part, whole, seen=seen)


def _writers(parts: list[Any]) -> MPI.Comm:
    """Ranks that share what is written; this one alone where it is all its own.

    Raises
    ------
    ValueError
        If some of it is shared by other ranks than the rest.
    """
    found = [comm for comm in map(ranks_of, parts) if comm is not None and comm.size > 1]
    alike = (MPI.IDENT, MPI.CONGRUENT)
    if any(MPI.Comm.Compare(found[0], comm) not in alike for comm in found):
        raise ValueError(
            f"save: of {len(parts)} results some are of {min(c.size for c in found)} ranks and some of "
            f"{max(c.size for c in found)}, or of other ones; write them to files of their own"
        )
    return found[0] if found else MPI.COMM_SELF


def _check(result: Any, parts: list[Any]) -> None:
    """Raise unless all parts are records, at least one, and have names where they need one."""
    if not parts:
        raise ValueError(f"save: result = {shown(result)} holds no result; give one or more")
    for part in parts:
        if not isinstance(part, Record):
            raise TypeError(f"save: result = {shown(part)} is no result that can be written")
    for name in result if isinstance(result, Mapping) else ():
        if not (isinstance(name, str) and name.strip(". ") and name.isprintable() and "/" not in name):
            raise ValueError(f"save: the name {name!r} of a result must be a text without '/'")


def _gather(record: Record, whole: dict[int, dict[str, Any]], bodies: dict[int, Record | None]) -> None:
    """What is distributed of a record and of those in it, by their identity, and the body that each field is
    of, once a model. Collective.
    """
    found = whole[id(record)] = record._gathered()
    model = getattr(record, "model", None)
    if found and model is not None:
        if id(model) not in bodies:
            bodies[id(model)] = model.record()
        found["body"] = bodies[id(model)]
    for _, about, part in record.parts():
        for one in each(part) if about.stored else ():
            if id(one) not in whole:
                _gather(one, whole, bodies)


def image(record: Record, model: Record | None = None) -> np.ndarray:
    """A record as the compressed bytes of a file, for a journal; without the model, which its head has."""
    target = io.BytesIO()
    with _new_file(target) as file:
        write(file, record, seen={} if model is None else {id(model): MODEL})
    return np.frombuffer(zlib.compress(target.getbuffer(), SPARE), dtype=np.uint8)


def from_image(data: np.ndarray, beside: Mapping[str, Record] = {}) -> Any:
    """What `image` made, with what stands beside it."""
    packed, free = zlib.decompressobj(), int(available_memory())
    whole = packed.decompress(data.tobytes(), free)
    if not packed.eof:
        raise ValueError(
            f"it is cut off, or would take more than the {in_bytes(free)} of memory that are free"
        )
    with h5py.File(io.BytesIO(whole), "r") as file:
        require_own(file, len(whole))
        return records_in(file, beside)


@contextlib.contextmanager
def written(path: Any, what: str = WHAT) -> Iterator[h5py.File]:
    """A new file, which takes its name when it is whole.

    Raises
    ------
    TypeError, ValueError
        See `replaced`; if what stands there is whole and no results.
    """
    path = checked_path(what, "path", path)
    if home_of(path) is None and not may_be_replaced(path) and _of_others(path):
        raise ValueError(f"{what} {path!r} would replace a file that holds no results; name another one")
    with replaced(path, what) as temporary, for_hdf5(temporary) as target, _new_file(target) as file:
        file.attrs["sbfem_petsc"] = text_of(importlib.import_module("..", __package__).__version__)
        file.attrs["schema"] = SCHEMA
        yield file


def _of_others(path: str) -> bool:
    """Whether a file is no HDF5, or of another program; one that is torn does not tell."""
    if not h5py.is_hdf5(path):
        return True
    try:
        with h5py.File(path, "r") as file:
            return "schema" not in file.attrs
    except UNSOUND:
        return False


class _Target(io.FileIO):
    """A file for HDF5, which ends the process sooner or later where it could not write all that it has: it is
    told of no failure, and handlers of signals, which Python runs within `write` too, wait for `let_signals`
    or `close`.
    """

    failure: OSError | None = None

    def __init__(self, path: str):
        super().__init__(path, "w+")
        self.waiting = list[tuple[int, FrameType | None]]()
        main = threading.current_thread() is threading.main_thread()  # others run none
        numbers = signal.valid_signals() if main else ()
        self.handlers: dict[int, Any] = {n: own for n in numbers if callable(own := signal.getsignal(n))}
        for number in self.handlers:
            signal.signal(number, lambda *come: self.waiting.append(come))

    def let_signals(self) -> None:
        """Run the handlers of signals that have come, where HDF5 does not."""
        while self.waiting:
            number, frame = self.waiting.pop(0)
            self.handlers[number](number, frame)

    def close(self) -> None:
        """Close it; handlers stand again, and those that have waited run."""
        try:
            super().close()
        finally:
            for number, handler in self.handlers.items():
                signal.signal(number, handler)
            self.let_signals()

    def write(self, data: Any) -> int:
        """Write it all, or nothing any more."""
        rest = memoryview(data).cast("B")
        with self._kept():
            while self.failure is None and len(rest):
                rest = rest[super().write(rest) :]
        return len(data)

    def truncate(self, size: int | None = None) -> int:
        """Cut it, or add to it."""
        with self._kept():
            super().truncate(size)
        return self.tell() if size is None else size

    @contextlib.contextmanager
    def _kept(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            self.failure = self.failure or error


@contextlib.contextmanager
def for_hdf5(path: str) -> Iterator[_Target]:
    """A new file for `h5py.File` to write; what the system has refused is raised when that is closed, and
    handlers of signals run then.

    Raises
    ------
    OSError
    """
    with _Target(path) as target:
        try:
            yield target
        finally:
            if target.failure is not None:
                raise target.failure


def _new_file(target: io.RawIOBase | io.BytesIO) -> h5py.File:
    """An empty file, in which links keep their order."""
    access, made = (h5py.h5p.create(kind) for kind in (h5py.h5p.FILE_ACCESS, h5py.h5p.FILE_CREATE))
    access.set_libver_bounds(h5py.h5f.LIBVER_V110, h5py.h5f.LIBVER_V110)
    access.set_fclose_degree(h5py.h5f.CLOSE_STRONG)
    access.set_fileobj_driver(h5py.h5fd.fileobj_driver, target)
    made.set_link_creation_order(h5py.h5p.CRT_ORDER_TRACKED)  # an index of it takes a tenth of a small file
    return h5py.File(h5py.h5f.create(b"new", h5py.h5f.ACC_TRUNC, fcpl=made, fapl=access))


@contextlib.contextmanager
def opened(path: Any, what: str = WHAT) -> Iterator[h5py.File]:
    """A file to read.

    Raises
    ------
    TypeError, ValueError
        If it is missing, truncated, damaged, of another kind or another version, or if what is read of it is
        not there or not what it should be: one sentence that names it.
    """
    path = checked_path(what, "path", path)
    if not os.path.isfile(path):
        lacking = "is no regular file" if os.path.exists(path) else "does not exist"
        raise ValueError(f"{what} {path!r} {lacking}")
    with sentences(path, what), contextlib.ExitStack() as stack:
        try:
            file = stack.enter_context(h5py.File(path, "r"))
        except OSError as error:
            raise ValueError(f"{what} {path!r} is truncated, damaged or no HDF5 file ({error})") from None
        if "schema" not in file.attrs:
            raise ValueError(f"{path!r} is an HDF5 file of another kind than this program's")
        if file.attrs["schema"] != SCHEMA:
            raise ValueError(
                f"{what} {path!r} has schema {file.attrs['schema']} of version "
                f"{text(file.attrs['sbfem_petsc'])}; this program reads schema {SCHEMA}; compute it again"
            )
        require_own(file, os.path.getsize(path))
        yield file


@contextlib.contextmanager
def sentences(path: str, what: str = WHAT) -> Iterator[None]:
    """Failures of reading as one sentence that names the file."""
    try:
        yield
    except UNSOUND as error:
        if path in str(error) or type(error).__module__.startswith("sbfem"):
            raise
        said = " ".join(str(error).split())
        raise ValueError(f"{what} {path!r} is damaged or does not hold what it should: {said}") from None


def require_own(file: h5py.File, size: int) -> None:
    """Raise ValueError unless everything in a file is its own, there once, and no larger than the file can
    hold: no links, no storage in other files, no data that only memory would have room for.
    """
    seen, waiting, total = {h5py.h5o.get_info(file.id).addr}, [file["/"].id], 0
    while waiting:
        group = waiting.pop()
        for name in group:
            if group.links.get_info(name).type != h5py.h5l.TYPE_HARD:
                raise ValueError(f"{name.decode()!r} leads elsewhere")
            item = h5py.h5o.open(group, name)
            address = h5py.h5o.get_info(item).addr
            if address in seen:
                raise ValueError(f"{name.decode()!r} is there twice")
            seen.add(address)
            if isinstance(item, h5py.h5g.GroupID):
                waiting.append(item)
            elif isinstance(item, h5py.h5d.DatasetID):
                made = item.get_create_plist()
                if made.get_external_count() or made.get_layout() == h5py.h5d.VIRTUAL:
                    raise ValueError(f"{name.decode()!r} is stored elsewhere")
                count = item.get_space().get_simple_extent_npoints() * item.get_type().get_size()
                if count > (DEFLATE if made.get_nfilters() else 1) * size and not bare(h5py.Dataset(item)):
                    raise ValueError(f"{name.decode()!r} is larger than the file")
                total += count
    if total > size and total > available_memory():
        raise ValueError(f"it would take {in_bytes(total)} of memory, more than is free")

"""HDF5 files of this program: made whole, opened with every check; a checksum tells of changed bytes."""

from __future__ import annotations

import contextlib
import json
import os
import struct
import zlib
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import h5py
import numpy as np

from meshing.whole_file import reason

from ..checks import path as checked_path
from ..record.files import require_own
from ..writing import replaced

# Groups whose data sets are written while a run goes on, and have checksums of their own.
RUNNING = ("rows", "running")
# Bytes that are read at a time for a checksum.
BLOCK = 1 << 24
# What reading of what is not there, or is something else, ends in.
_UNSOUND = (
    ValueError,
    KeyError,
    IndexError,
    TypeError,
    AttributeError,
    OSError,
    RuntimeError,
    OverflowError,
    UnicodeDecodeError,
    json.JSONDecodeError,
)
# What ends a file: length and CRC-32 of the text before it, which holds the file's own.
_END, _MAGIC = struct.Struct("<II8s"), b"sbfemcrc"


@contextlib.contextmanager
def new_hdf5(path: Any, what: str, form: str, version: int) -> Iterator[h5py.File]:
    """A new HDF5 file, which takes its name when it has been filled.

    Parameters
    ----------
    path : str or path
    what : str
        Kind of file, for messages: "orbit file".
    form, version
        What `opened` is to find.

    Raises
    ------
    TypeError, ValueError
        See `writing.replaced`.
    """
    with replaced(path, what) as temporary, writing():
        file = h5py.File(temporary, "w")
        try:
            file.attrs["format"], file.attrs["format_version"] = form, version
            yield file
            running = _running(file)
            file.close()
        except BaseException:
            with contextlib.suppress(Exception):  # a full disk is met again
                file.close()
            raise
        _seal(temporary, running)


@contextlib.contextmanager
def writing() -> Iterator[None]:
    """HDF5's failures of writing as errors of the system."""
    try:
        yield
    except RuntimeError as error:
        if type(error) is not RuntimeError:
            raise
        raise OSError(reason(error)) from None


@contextlib.contextmanager
def opened(path: Any, what: str, forms: Mapping[str, int]) -> Iterator[h5py.File]:
    """A file open for reading, after a look at its checksum: HDF5 may crash on changed bytes.

    Parameters
    ----------
    path : str or path
    what : str
        Kind of file, for messages.
    forms : dict of str to int
        Formats that are expected, with the version that this program writes.

    Raises
    ------
    TypeError, ValueError
        If the file is missing, truncated, changed, of another kind or of another version, or if what is read
        of it is not there or not what it should be: one sentence that names it.
    """
    path = checked_path(what, "path", path)
    if not os.path.isfile(path):
        raise ValueError(f"{what} {path!r} does not exist")
    with contextlib.ExitStack() as stack:
        try:
            sealed = _sealed(path)
            if sealed is False:
                raise ValueError(f"{what} {path!r} is damaged: it does not fit its checksum; write it again")
            file = stack.enter_context(h5py.File(path, "r"))
            form, version = file.attrs.get("format"), file.attrs.get("format_version", 0)
        except (OSError, RuntimeError, LookupError) as error:
            raise ValueError(f"{what} {path!r} is truncated, damaged or no HDF5 file ({error})") from None
        if not isinstance(form, str) or form not in forms:
            raise ValueError(f"{path!r} is an HDF5 file of another kind, not {' or '.join(forms)}")
        if not isinstance(version, (int, np.integer)):
            raise ValueError(f"{what} {path!r} has format version {version!r}, which is no whole number")
        if version != forms[form]:
            age = "newer" if version > forms[form] else "older"
            raise ValueError(
                f"{what} {path!r} has format version {version}, {age} than this program's {forms[form]}"
            )
        if sealed is None:
            raise ValueError(
                f"{what} {path!r} has lost its checksum: its end is missing, or another program has written "
                "to it; write it again"
            )
        try:
            require_own(file, os.path.getsize(path))
            yield file
        except _UNSOUND as error:
            if type(error) not in _UNSOUND or path in str(error):
                raise
            said = " ".join(str(error).split())
            raise ValueError(f"{what} {path!r} does not hold what it should: {said}") from None


# ---------------------------------------------------------------------- the checksum behind HDF5's last byte
def _running(file: h5py.File) -> list[tuple[int, int]]:
    """First byte and number of bytes of all data that are written while a run goes on."""
    places = [
        (data.id.get_offset(), data.id.get_storage_size())
        for name in RUNNING
        for data in file.get(name, {}).values()
    ]
    return sorted(place for place in places if place[1])


def _seal(path: str, running: Sequence[tuple[int, int]]) -> None:
    """Write the checksum of all bytes but some behind them; HDF5 does not look there."""
    facts = {"crc": _checksum(path, os.path.getsize(path), running), "running": running}
    text = json.dumps(facts).encode()
    with open(path, "ab") as file:
        file.write(text + _END.pack(len(text), zlib.crc32(text), _MAGIC))


def _sealed(path: str) -> bool | None:
    """Whether a file is what was written; None if it bears no checksum."""
    size = os.path.getsize(path)
    with open(path, "rb") as file:
        if size < _END.size:
            return None
        file.seek(size - _END.size)
        length, total, magic = _END.unpack(file.read())
        if magic != _MAGIC or length > size - _END.size:
            return None
        file.seek(size - _END.size - length)
        text = file.read(length)
    if zlib.crc32(text) != total:
        return False
    try:
        facts = json.loads(text)
        running = [(int(first), int(count)) for first, count in facts["running"]]
    except (TypeError, ValueError, KeyError):
        return False
    crc = facts.get("crc")
    inside = all(first >= 0 and count >= 0 and first + count <= size for first, count in running)
    return inside and _checksum(path, size - _END.size - length, running) == crc


def _checksum(path: str, size: int, skipped: Sequence[Sequence[int]]) -> int:
    """CRC-32 of the first bytes of a file but for some parts."""
    total, place = 0, 0
    with open(path, "rb") as file:
        for first, length in (*skipped, (size, 0)):
            file.seek(place)
            while place < first:
                part = file.read(min(BLOCK, first - place))
                if not part:
                    return -1
                total, place = zlib.crc32(part, total), place + len(part)
            place = first + length
    return total

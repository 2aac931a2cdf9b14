"""HDF5 files of this program: made whole, opened with every check; a checksum tells of changed bytes."""

from __future__ import annotations

import contextlib
import os
import zlib
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import h5py
import numpy as np

from ..writing import reason, replaced

# Groups whose data sets are written while a run goes on, and have checksums of their own.
RUNNING = ("rows", "running")
# Bytes that are read at a time for a checksum.
BLOCK = 1 << 24
_SEAL = "checksum"


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
            seal(file)
            file.close()
        except BaseException:
            with contextlib.suppress(Exception):  # a full disk is met again
                file.close()
            raise


@contextlib.contextmanager
def writing() -> Iterator[None]:
    """HDF5's failures of writing as errors of the system."""
    try:
        yield
    except RuntimeError as error:
        if type(error) is not RuntimeError:
            raise
        raise OSError(reason(error)) from None


def seal(file: h5py.File) -> None:
    """Note the checksum of all that the file holds but for what is written while a run goes on."""
    file.attrs[_SEAL] = np.uint32(_checksum(file))


@contextlib.contextmanager
def opened(path: Any, what: str, forms: Mapping[str, int]) -> Iterator[h5py.File]:
    """A file open for reading.

    Parameters
    ----------
    path : str or path
    what : str
        Kind of file, for messages.
    forms : dict of str to int
        Formats that are expected, with the version that this program writes.

    Raises
    ------
    ValueError
        If the file is missing, truncated, changed, of another kind or of another version.
    """
    if not isinstance(path, (str, os.PathLike)):
        raise TypeError(f"{what}: path = {path!r} must be a string or a path")
    path = os.fspath(path)
    if not os.path.isfile(path):
        raise ValueError(f"{what} {path!r} does not exist")
    with contextlib.ExitStack() as stack:
        try:
            file = stack.enter_context(h5py.File(path, "r"))
            form, version = file.attrs.get("format"), file.attrs.get("format_version")
            right = form in forms and isinstance(version, (int, np.integer))
            intact = not right or version != forms[form] or file.attrs.get(_SEAL) == _checksum(file)
        except (OSError, RuntimeError, LookupError, ValueError, TypeError, ArithmeticError, MemoryError) as e:
            raise ValueError(f"{what} {path!r} is truncated, damaged or no HDF5 file ({e})") from None
        if not right:
            raise ValueError(f"{path!r} is an HDF5 file of another kind, not {' or '.join(forms)}")
        if version != forms[form]:
            age = "newer" if version > forms[form] else "older"
            raise ValueError(
                f"{what} {path!r} has format version {version}, {age} than this program's {forms[form]}"
            )
        if not intact:
            raise ValueError(f"{what} {path!r} is damaged: it does not fit its checksum; write it again")
        yield file


def _checksum(file: h5py.File) -> int:
    """CRC-32 of all attributes and data sets by their names, but for the values in the groups `RUNNING`."""
    size = os.path.getsize(file.filename)

    def of(group: h5py.Group | h5py.Dataset, total: int, values: bool) -> int:
        for name in sorted(group.attrs):
            if name != _SEAL:
                value = group.attrs[name]
                text = repr((name, value if isinstance(value, str) else np.asarray(value).tolist()))
                total = zlib.crc32(text.encode(), total)
        if isinstance(group, h5py.Dataset):
            if group.nbytes > size:
                raise ValueError(f"data set {group.name} is larger than the file")
            total = zlib.crc32(repr((group.dtype.str, group.shape)).encode(), total)
            for part in _parts(group) if values else ():
                total = zlib.crc32(np.ascontiguousarray(part).tobytes(), total)
            return total
        for name in sorted(group):
            fixed = values and (group.name != "/" or name not in RUNNING)
            total = of(group[name], zlib.crc32(name.encode(), total), fixed)
        return total

    return of(file, 0, True)


def _parts(dataset: h5py.Dataset) -> Iterator[np.ndarray]:
    """A data set slab by slab."""
    if not dataset.ndim or not dataset.size:
        yield np.asarray(dataset[()])
        return
    rows = max(1, BLOCK // max(1, dataset.nbytes // len(dataset)))
    for first in range(0, len(dataset), rows):
        yield dataset[first : first + rows]


def put(group: h5py.Group, name: str, values: Any, unit: str, description: str) -> None:
    """A data set with its unit ("1" without dimension) and what it is."""
    dataset = group.create_dataset(name, data=np.asarray(values))
    dataset.attrs["unit"], dataset.attrs["description"] = unit, description


def put_texts(group: h5py.Group, name: str, values: Sequence[str]) -> None:
    """A list of texts as an attribute; it may be empty."""
    group.attrs.create(name, list(values), shape=(len(values),), dtype=h5py.string_dtype())

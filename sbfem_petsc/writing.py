"""Files that are written whole or not at all: under another name first, which is then exchanged for their
own.
"""

from __future__ import annotations

import contextlib
import csv
import os
import re
import tempfile
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from .checks import path as checked_path
from .folder_index import claim


def destination(path: Any, what: str) -> str:
    """The absolute path of a file that is to be written, a symbolic link's goal; in an output folder, where
    no link is followed, it is entered into the index.

    Raises
    ------
    TypeError, ValueError
        If it is no path, or the place of something that must not be replaced: a folder, a device, a pipe, or
        what an output folder does not list.
    """
    text = checked_path(what, "path", path)
    place = claim(text, what)
    if place is not None:
        return place
    real = os.path.realpath(text)
    if os.path.lexists(real) and not os.path.isfile(real):
        kind = "a folder" if os.path.isdir(real) else "no regular file"
        raise ValueError(f"{what} {text!r} cannot be written: {real!r} is {kind}; name another one")
    return real


def reason(error: Exception) -> str:
    """What the system says of a failure, also through HDF5's messages."""
    told = re.search(r"error message = '([^']*)'", str(error))
    return told[1] if told else getattr(error, "strerror", None) or str(error)


@contextlib.contextmanager
def replaced(path: Any, what: str) -> Iterator[str]:
    """A name to write to; what stands there at the end takes the place of `path`, whole.

    Nothing is left behind by a failure, and a former file stays as it was.

    Parameters
    ----------
    path : str or path
    what : str
        Kind of file, for messages: "picture".

    Raises
    ------
    TypeError, ValueError
        See `destination`; or if the system refuses, as on a full disk.
    """
    place = destination(path, what)
    folder, name = os.path.split(place)
    temporary = os.path.join(folder, f".{name}.{os.getpid()}.part")
    try:
        yield temporary
        synchronise(temporary)
        os.replace(temporary, place)
        with contextlib.suppress(OSError):  # not every file system knows this of folders
            synchronise(folder)
    except OSError as error:
        raise ValueError(f"{what} {os.fspath(path)!r} cannot be written: {reason(error)}") from None
    finally:
        with contextlib.suppress(OSError):
            os.remove(temporary)


@contextlib.contextmanager
def spare_folder() -> Iterator[str]:
    """A folder for files that nobody keeps.

    Raises
    ------
    ValueError
        If the system has no place for one, as on a full disk.
    """
    try:
        folder = tempfile.TemporaryDirectory()
    except OSError as error:
        raise ValueError(
            f"there is no folder for temporary files ({error.strerror or error}); make room, or name one in "
            "the environment variable TMPDIR"
        ) from None
    with folder as name:
        yield name


def synchronise(path: str) -> None:
    """Bring a file or folder to the disk."""
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def write_table(path: Any, columns: Mapping[str, Any]) -> None:
    """Write columns of equal length as comma-separated values, numbers with all their digits.

    Raises
    ------
    TypeError, ValueError
        See `replaced`.
    """
    texts = [[_text(value) for value in np.asarray(values).tolist()] for values in columns.values()]
    with replaced(path, "table") as temporary, open(temporary, "w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(columns)
        writer.writerows(zip(*texts))


def _text(value: Any) -> str:
    return value if isinstance(value, str) else repr(value)

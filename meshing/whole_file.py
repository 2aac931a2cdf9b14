"""Files that are read whole, and files that are there as a whole or not at all."""

from __future__ import annotations

import contextlib
import errno
import os
import shutil
import stat
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from .folder_index import claim, home_of
from .input_checks import path as checked_path


def require_regular(path: str | os.PathLike[str]) -> None:
    """Raise OSError for what is there but no file: a pipe would be waited for, and a device has no end."""
    mode = os.stat(path).st_mode
    if stat.S_ISDIR(mode):
        raise OSError(errno.EISDIR, os.strerror(errno.EISDIR))
    if not stat.S_ISREG(mode):
        raise OSError(errno.EINVAL, "it is no regular file")


def read_whole(path: Path) -> bytes:
    """Content of a regular file.

    Raises
    ------
    ValueError
        There is none, or it cannot be read.
    """
    try:
        require_regular(path)
        return path.read_bytes()
    except (FileNotFoundError, NotADirectoryError):
        raise ValueError(f"{path}: there is no such file.") from None
    except OSError as error:
        raise ValueError(f"{path}: it cannot be read ({error.strerror or error}).") from None


def destination(path: Any, what: str) -> str:
    """The absolute path of a file that is to be written, a symbolic link's goal; in an output folder, where
    no link is followed, it is entered into the index.

    Raises
    ------
    TypeError, ValueError
        If it is no path; if a folder, a device or a pipe stands there, or what an output folder does not
        list.
    """
    path = checked_path(what, "path", path)
    listed = claim(path, what)
    if listed is not None:
        return listed
    real = os.path.realpath(path)
    if os.path.lexists(real) and not os.path.isfile(real):
        kind = "a folder" if os.path.isdir(real) else "no regular file"
        raise ValueError(f"{what} {path!r} cannot be written: {real!r} is {kind}; name another one")
    return real


def reason(error: Exception) -> str:
    """What the system says of a failure."""
    return getattr(error, "strerror", None) or str(error)


@contextlib.contextmanager
def replaced(path: Any, what: str) -> Iterator[str]:
    """A file to write, of the same name in a folder of its own; at the end it takes the place of `path`.

    What was written beside it then stands beside `path`. Nothing is left behind by a failure, and a former
    file stays as it was; its permissions are kept.

    Parameters
    ----------
    path : str or path-like
    what : str
        Kind of file, for messages: "picture".

    Raises
    ------
    TypeError, ValueError
        See `destination`; if the system refuses, as on a full disk; if what was written beside it would
        replace a file that does not belong to it.
    """
    path = checked_path(what, "path", path)
    place = destination(path, what)
    folder, name = os.path.split(place)
    spare = None
    try:
        spare = tempfile.mkdtemp(prefix=f".{name}.", suffix=".part", dir=folder)
        yield os.path.join(spare, name)
        others = sorted(set(os.listdir(spare)) - {name})
        foreign = [other for other in others if os.path.lexists(os.path.join(folder, other))]
        if foreign and not os.path.exists(place) and home_of(place) is None:  # where `claim` knows better
            raise ValueError(
                f"{what} {path!r} cannot be written: {foreign[0]!r}, which belongs to it, would replace a "
                "file that is there; name another one"
            )
        if os.path.exists(place):
            os.chmod(os.path.join(spare, name), stat.S_IMODE(os.stat(place).st_mode))
        for other in others:
            claim(os.path.join(folder, other), what)
        for file in (*others, name):
            synchronise(os.path.join(spare, file))
        for file in (*others, name):  # the file itself last
            os.replace(os.path.join(spare, file), os.path.join(folder, file))
        with contextlib.suppress(OSError):  # not every file system knows this of folders
            synchronise(folder)
    except OSError as error:
        raise ValueError(f"{what} {path!r} cannot be written: {reason(error)}") from None
    finally:
        if spare is not None:
            shutil.rmtree(spare, ignore_errors=True)


def synchronise(path: str) -> None:
    """Bring a file or folder to the disk."""
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)

"""Files that are there as a whole or not at all."""

from __future__ import annotations

import contextlib
import os
import shutil
import stat
from collections.abc import Callable
from pathlib import Path

from meshing.input_checks import shown


class BadTarget(ValueError):
    """A file that is not replaced."""


def checked_path(item: str, path: object) -> Path:
    """`path` as a Path, or the error that names it.

    Raises
    ------
    TypeError
        Neither str nor a path.
    ValueError
        Empty, or with a character that no file's name has.
    """
    text = os.fspath(path) if isinstance(path, (str, os.PathLike)) else None
    if not isinstance(text, str):
        raise TypeError(f"{item}: path is {shown(path)}, a file's name (str or Path) was expected.")
    if not text or "\0" in text:
        raise ValueError(f"{item}: path is {text!r}, a file's name was expected.")
    return Path(text)


def read_whole(path: Path) -> bytes:
    """Content of a regular file.

    Raises
    ------
    ValueError
        There is none, or it cannot be read.
    """
    try:
        kind = path.stat().st_mode
        if stat.S_ISDIR(kind):
            raise ValueError(f"{path}: it is a folder, a file was expected.")
        if not stat.S_ISREG(kind):
            raise ValueError(f"{path}: it is no regular file.")
        return path.read_bytes()
    except (FileNotFoundError, NotADirectoryError):
        raise ValueError(f"{path}: there is no such file.") from None
    except OSError as error:
        raise ValueError(f"{path}: it cannot be read ({error.strerror or error}).") from None


def write_whole(path: Path, fill: Callable[[Path], None]) -> None:
    """Write a file, and what is written beside it, under temporary names, and put them in place once they
    are complete.

    Parameters
    ----------
    path : path
        An existing file is replaced; a link is followed.
    fill : callable
        Called with a path of the same name in a folder of its own; may write further files beside it.

    Raises
    ------
    OSError
        As the system says; then nothing is left behind and an existing file is as it was.
    BadTarget
        The target is no regular file, or a file that belongs to it would replace one that does not.
    """
    target = Path(os.path.realpath(path))
    if target.exists() and not target.is_file():
        raise BadTarget(f"{path}: it is no regular file and is not replaced; give another name.")
    fresh = not target.exists()
    folder = target.with_name(f".{target.name}.{os.getpid()}.part")
    folder.mkdir()
    try:
        fill(folder / target.name)
        written = sorted(folder.iterdir(), key=lambda file: file.name == target.name)  # the file itself last
        for file in written[:-1]:
            if fresh and target.with_name(file.name).exists():
                raise BadTarget(
                    f"{path}: {file.name}, which belongs to it, would replace a file that is there."
                )
        for file in written:
            with open(file, "rb") as stored:
                os.fsync(stored.fileno())
        for file in written:
            os.replace(file, target.with_name(file.name))
    finally:
        with contextlib.suppress(OSError):
            shutil.rmtree(folder)

"""Output folders: what the program makes in one stands in an index there; nothing else is replaced or
removed, and no link leads out of it.
"""

from __future__ import annotations

import contextlib
import fcntl
import json
import os
import re
import shutil
import stat
from collections.abc import Iterator

# The index: a JSON string a line, folders with "/" at their end. It also carries the lock of a run.
INDEX = ".sbfem-index"
# Folders above a file in which an index is looked for.
UP = 4
# Names of folders in which files are made.
UNFINISHED = re.compile(r"\.(.+)\.\w{8}\.part")

_NOT_OURS = "move it away, or name another folder with --output"


def open_regular(path: str, flags: int) -> int:
    """Handle of a regular file that is no link; never waits for the other end of a pipe.

    Raises
    ------
    ValueError
        If something else stands there.
    OSError
        As the system says.
    """
    if os.path.islink(path):
        raise ValueError(f"{path!r} is a link, which is not followed; put the file itself there")
    handle = os.open(path, flags | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC, 0o666)
    if not stat.S_ISREG(os.fstat(handle).st_mode):
        os.close(handle)
        raise ValueError(f"{path!r} is no regular file; move it away")
    return handle


def hold(handle: int, *, shared: bool = False) -> bool:
    """Keep an open file to this process, or to those that share it, until it is closed or the process ends,
    however it does; whether nobody else has it. On a file system without locks nobody is known.
    """
    try:
        fcntl.flock(handle, (fcntl.LOCK_SH if shared else fcntl.LOCK_EX) | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:
        pass
    return True


def regular_file(folder: str, *names: str) -> str | None:
    """Path of a regular file below a folder; None if there is none.

    Raises
    ------
    ValueError
        If it is, or stands behind, a link, or is a folder, a pipe or a device.
    """
    place = folder
    for number, name in enumerate(names, 1):
        place = os.path.join(place, name)
        try:
            mode = os.lstat(place).st_mode
        except FileNotFoundError:
            return None
        if not (stat.S_ISREG(mode) if number == len(names) else stat.S_ISDIR(mode)):
            kind = "is a link, which is not followed" if stat.S_ISLNK(mode) else "is not what a run has made"
            raise ValueError(f"{place!r} {kind}; move it away")
    return place


def home_of(path: str) -> str | None:
    """The folder with an index that a file or folder is to stand in, None without one.

    Raises
    ------
    ValueError
        If a link stands between them.
    """
    found: str | None = None
    links: list[str] = []
    place = os.path.abspath(path)
    for _ in range(UP):
        place, below = os.path.dirname(place), place
        if os.path.lexists(os.path.join(place, INDEX)):
            if links:
                raise ValueError(f"{links[-1]!r} is a link, which is not followed; {_NOT_OURS}")
            found = found or place
        if os.path.islink(place):
            links.append(place)
        if place == below:
            break
    return found


def claim(path: str, what: str) -> str | None:
    """Enter a file that is to be written into the index of the folder above it, before it is made.

    Returns
    -------
    str or None
        The absolute path; None if no folder above has an index.

    Raises
    ------
    ValueError
        If something stands there that the index does not list, or a link.
    """
    home = home_of(path)
    if home is None:
        return None
    place = os.path.abspath(path)
    there = os.path.lexists(place)  # before the index is read: another rank lists it before it makes it
    name = os.path.relpath(place, home)
    if name not in listed(home):
        if there:
            raise ValueError(
                f"{what} {path!r} cannot be written: something that this program has not made stands in its "
                "place; move it away, or name another one"
            )
        _enter(home, name)
    elif there and not stat.S_ISREG(os.lstat(place).st_mode):
        raise ValueError(f"{what} {path!r} cannot be written: a link or no regular file stands in its place")
    return place


def make_folder(path: str) -> None:
    """Make a folder if it is missing, and list it in the index above it if there is one.

    Raises
    ------
    ValueError
        If an index above it does not list what stands there, or the system refuses.
    """
    home = home_of(path)
    if home is not None:
        name = f"{os.path.relpath(os.path.abspath(path), home)}/"
        there = os.path.lexists(path)
        if name not in listed(home):
            if there:
                raise ValueError(f"{path!r} is not what this program has made; {_NOT_OURS}")
            _enter(home, name)
        elif there and not stat.S_ISDIR(os.lstat(path).st_mode):
            raise ValueError(f"{path!r} is a link or no folder; {_NOT_OURS}")
    try:
        os.makedirs(path, exist_ok=True)
    except OSError as error:
        raise ValueError(
            f"output folder {path!r} cannot be made ({error.strerror or error}); name another one or free "
            "its place"
        ) from None


def make_output_folder(path: str) -> None:
    """`make_folder`; one that stands in no other output folder is to have an index of its own.

    Raises
    ------
    ValueError
        See `make_folder`, or if it holds what this program has not made.
    """
    make_folder(path)
    if home_of(path) is None:
        _begin(os.path.abspath(path))


def listed(folder: str) -> set[str]:
    """Names in the index of a folder; lines that a kill has cut off are none."""
    found = set()
    with os.fdopen(open_regular(os.path.join(folder, INDEX), os.O_RDONLY), "rb") as file:
        for line in file.read().splitlines():
            with contextlib.suppress(ValueError):
                name = json.loads(line)
                if isinstance(name, str) and _inside(name.removesuffix("/")):
                    found.add(name)
    return found


def _inside(name: str) -> bool:
    return bool(name) and not os.path.isabs(name) and os.path.normpath(name) == name and name[:2] != ".."


def _enter(folder: str, name: str) -> None:
    """Add a name to an index; it is on the disk when this returns."""
    handle = open_regular(os.path.join(folder, INDEX), os.O_WRONLY | os.O_APPEND)
    try:
        os.write(handle, f"\n{json.dumps(name)}\n".encode())
        os.fsync(handle)
    finally:
        os.close(handle)


def _begin(folder: str) -> None:
    """Begin an index in a folder without anything else."""
    others = sorted(set(os.listdir(folder)) - {INDEX})
    # looked for behind the others: whoever else begins here makes it before all else
    if others and not os.path.lexists(os.path.join(folder, INDEX)):
        raise ValueError(
            f"output folder {folder!r} holds {others[0]!r}, which this program has not made there; "
            f"{_NOT_OURS}"
        )
    os.close(open_regular(os.path.join(folder, INDEX), os.O_WRONLY | os.O_CREAT))


class HeldFolder:
    """An output folder that one process works in, until `close`, or several that share it.

    Parameters
    ----------
    path : str
        An existing folder.
    shared : bool
        Others that share it may work in it too; nothing of theirs is removed.

    Raises
    ------
    ValueError
        If another process works in it, or it holds anything that its index does not list; then nothing in it
        has been touched.
    """

    def __init__(self, path: str, shared: bool = False):
        self.path = path
        _begin(path)
        self._handle: int | None = open_regular(os.path.join(path, INDEX), os.O_RDWR)
        try:
            if not hold(self._handle, shared=shared):
                raise ValueError(
                    f"another process is at work in {path!r}; wait for it, or name another folder with "
                    "--output"
                )
            leftovers = list(self._leftovers())
        except BaseException:
            self.close()
            raise
        for place in () if shared else leftovers:
            shutil.rmtree(place, ignore_errors=True)

    def _leftovers(self, below: str = "") -> Iterator[str]:
        """What killed processes have left of files that they were making, after a look at everything."""
        with os.scandir(os.path.join(self.path, below)) as entries:
            found = sorted(entries, key=lambda entry: entry.name)
        names = listed(self.path)  # behind the look: others list what they make before they make it
        for entry in found:
            name = os.path.join(below, entry.name)
            unfinished = UNFINISHED.fullmatch(entry.name)
            if entry.is_dir(follow_symlinks=False):
                if unfinished is not None and os.path.join(below, unfinished[1]) in names:
                    yield entry.path
                    continue
                known = f"{name}/" in names
                if known and not os.path.lexists(os.path.join(entry.path, INDEX)):
                    yield from self._leftovers(name)
            elif not entry.is_file(follow_symlinks=False):
                known = False
            else:
                known = name in names or name == INDEX
            if not known:
                raise ValueError(
                    f"output folder {self.path!r} holds {name!r}, which this program has not made there; "
                    f"{_NOT_OURS}"
                )

    def clear(self) -> None:
        """Remove what the index lists."""
        assert self._handle is not None
        for name in sorted(listed(self.path), reverse=True):  # what is in a folder before the folder
            place = os.path.join(self.path, name)
            with contextlib.suppress(OSError):
                os.rmdir(place) if name.endswith("/") else os.remove(place)
        os.ftruncate(self._handle, 0)

    def close(self) -> None:
        """Leave the folder to others."""
        if self._handle is not None:
            os.close(self._handle)
            self._handle = None

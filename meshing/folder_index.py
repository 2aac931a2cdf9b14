"""The index of an output folder: what the program makes in one stands there; nothing else is replaced or
removed, and no link leads out of it.
"""

from __future__ import annotations

import contextlib
import errno
import json
import os
import stat

# The index: a JSON string a line, folders with "/" at their end. It also carries the lock of a run.
INDEX = ".sbfem-index"
# Folders above a file in which an index is looked for.
UP = 4
ELSEWHERE = "name another folder with --output"
NOT_OURS = f"move it away, or {ELSEWHERE}"


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
                raise ValueError(f"{links[-1]!r} is a link, which is not followed; {NOT_OURS}")
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
        enter(home, name)
    elif there and not stat.S_ISREG(os.lstat(place).st_mode):
        raise ValueError(f"{what} {path!r} cannot be written: a link or no regular file stands in its place")
    return place


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


def enter(folder: str, name: str) -> None:
    """Add a name to an index; it is on the disk when this returns.

    Raises
    ------
    ValueError
        If the system refuses, as on a full disk.
    """
    line = f"\n{json.dumps(name)}\n".encode()
    try:
        handle = open_regular(os.path.join(folder, INDEX), os.O_WRONLY | os.O_APPEND)
        try:
            if os.write(handle, line) < len(line):
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            os.fsync(handle)
        finally:
            os.close(handle)
    except OSError as error:
        place = os.path.join(folder, name)
        raise ValueError(f"{place!r} cannot be made ({error.strerror}); make room, or {ELSEWHERE}") from None

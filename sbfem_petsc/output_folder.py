"""Output folders: made, held to one process, and cleared of what their index lists alone."""

from __future__ import annotations

import contextlib
import fcntl
import os
import re
import shutil
import stat
from collections.abc import Iterator

from meshing.folder_index import INDEX, NOT_OURS, enter, home_of, listed, open_regular

# Names of folders in which files are made.
UNFINISHED = re.compile(r"\.(.+)\.\w{8}\.part")


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
                raise ValueError(f"{path!r} is not what this program has made; {NOT_OURS}")
            enter(home, name)
        elif there and not stat.S_ISDIR(os.lstat(path).st_mode):
            raise ValueError(f"{path!r} is a link or no folder; {NOT_OURS}")
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


def _begin(folder: str) -> None:
    """Begin an index in a folder without anything else."""
    others = sorted(set(os.listdir(folder)) - {INDEX})
    # looked for behind the others: whoever else begins here makes it before all else
    if others and not os.path.lexists(os.path.join(folder, INDEX)):
        raise ValueError(
            f"output folder {folder!r} holds {others[0]!r}, which this program has not made there; {NOT_OURS}"
        )
    os.close(open_regular(os.path.join(folder, INDEX), os.O_WRONLY | os.O_CREAT))


@contextlib.contextmanager
def one_at_a_time(folder: str) -> Iterator[None]:
    """Wait until no other process is within this for the folder; on a file system without locks for none."""
    handle = os.open(folder, os.O_RDONLY)
    try:
        with contextlib.suppress(OSError):
            fcntl.flock(handle, fcntl.LOCK_EX)
        yield
    finally:
        os.close(handle)


class HeldFolder:
    """An output folder that one process works in, until `close`, or several that share it.

    Parameters
    ----------
    path : str
        An existing folder.
    shared : bool
        Others that share it may work in it too, from `share` on; nothing of theirs is removed.

    Attributes
    ----------
    others : bool
        Whether others that share it were at work in it before.

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
            alone = hold(self._handle)
            self.others = shared and not alone
            if self.others:
                self.share()
            elif not alone:
                raise self._taken()
            leftovers = list(self._leftovers())
        except BaseException:
            self.close()
            raise
        for place in () if shared else leftovers:
            shutil.rmtree(place, ignore_errors=True)

    def share(self) -> None:
        """Let others that share it work in it too."""
        assert self._handle is not None
        if not hold(self._handle, shared=True):
            raise self._taken()

    def _taken(self) -> ValueError:
        return ValueError(
            f"another process is at work in {self.path!r}; wait for it, or name another folder with --output"
        )

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
                    f"{NOT_OURS}"
                )

    def keeps_beside(self, path: str) -> bool:
        """Whether a file that the index lists has content, one aside."""
        files = {os.path.join(self.path, name) for name in listed(self.path)} - {path}
        return any(os.path.isfile(file) and os.path.getsize(file) for file in files)

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

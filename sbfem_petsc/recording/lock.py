"""One writer a file: a second run that would write the same one is refused."""

from __future__ import annotations

import contextlib
import fcntl
import os
import platform

from meshing.folder_index import claim, open_regular
from meshing.whole_file import reason


class WriterLock:
    """Right to write a file, held until `release` or the end of the process, however it ends.

    A hidden file beside it carries the lock, as the file itself may be exchanged for another one.

    Parameters
    ----------
    path : str
    what : str
        Kind of file, for messages.

    Raises
    ------
    ValueError
        If another run holds it, or the folder cannot be written.
    """

    def __init__(self, path: str, what: str):
        folder, name = os.path.split(path)
        self._path = os.path.join(folder, f".{name}.lock")
        claim(self._path, what)
        while True:
            try:
                self._handle = open_regular(self._path, os.O_RDWR | os.O_CREAT)
            except OSError as error:
                raise ValueError(f"{what} {path!r} cannot be written: {reason(error)}") from None
            try:
                fcntl.flock(self._handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                holder = os.read(self._handle, 200).decode(errors="replace").strip() or "another run"
                os.close(self._handle)
                raise ValueError(
                    f"{what} {path!r} is being written by {holder}; wait for its end, or name another file"
                ) from None
            except OSError:  # a file system without locks
                break
            with contextlib.suppress(FileNotFoundError):
                if os.path.samestat(os.fstat(self._handle), os.stat(self._path)):
                    break
            os.close(self._handle)  # its former holder has just removed it
        os.ftruncate(self._handle, 0)
        os.pwrite(self._handle, f"process {os.getpid()} on {platform.node()}\n".encode(), 0)

    def release(self) -> None:
        """Give the right up."""
        with contextlib.suppress(FileNotFoundError):
            os.remove(self._path)
        os.close(self._handle)

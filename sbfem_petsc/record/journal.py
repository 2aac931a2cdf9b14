"""What is kept while it runs: frames that are only appended, each with checksums, and a state beside them.

A journal begins with a mark and a head, which says what is run; its frames hold what has been found. The file
PATH.state, replaced as a whole, holds what can be gone on with, and says how many frames it vouches for. A
kill leaves whole frames and at most a torn one at the end, which is cut off; bytes that have changed are told
of, and nothing behind them is cut.

A frame: its length and the CRC-32 of that, the CRC-32 of the rest, a line of JSON (numbers, texts; types and
shapes of arrays in their places), the arrays' bytes. Nothing in it is executed.
"""

from __future__ import annotations

import contextlib
import json
import os
import shutil
import struct
import zlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from meshing.folder_index import open_regular
from meshing.whole_file import destination, reason, replaced, require_regular

from ..errors import SolveError
from ..output_folder import hold

MAGIC = b"sbfem journal 7\n"
# By what the type and shape of an array stand in a line of JSON.
ARRAY = "array of"
# Of a frame: length of what follows, its CRC-32, CRC-32 of what follows.
HEAD = struct.Struct("<QII")
Frame = dict[str, Any]


def is_journal(path: str) -> bool:
    """Whether a file begins as a journal does."""
    return _begin(path) == MAGIC[:8]


def may_be_replaced(path: str) -> bool:
    """Whether nothing of a user's is lost with a file: one of a run, torn or whole, or none."""
    return MAGIC.startswith(_begin(path))


def _begin(path: str) -> bytes:
    try:
        require_regular(path)
        with open(path, "rb") as file:
            return file.read(8)
    except PermissionError:
        return b"?"  # whatever a user has there
    except OSError:
        return b""


def packed(frame: Mapping[str, Any]) -> list[Any]:
    """Numbers, texts and arrays by name, also in lists and dicts, as buffers."""
    arrays: list[np.ndarray] = []

    def stand_in(value: Any) -> Any:
        if isinstance(value, np.generic):
            return value.item()
        if not isinstance(value, np.ndarray):
            raise TypeError(f"{value!r} has no place in a journal")
        arrays.append(np.ascontiguousarray(value))
        return {ARRAY: [value.dtype.str, value.shape]}

    line = json.dumps(dict(frame), default=stand_in).encode() + b"\n"
    parts: list[Any] = [line, *(v.reshape(-1).view(np.uint8) for v in arrays if v.size)]
    crc = 0
    for part in parts:
        crc = zlib.crc32(part, crc)
    size = sum(map(len, parts))
    return [HEAD.pack(size, zlib.crc32(struct.pack("<Q", size)), crc), *parts]


def write(file: int, parts: list[Any]) -> None:
    """Buffers, one behind the other."""
    for part in parts:
        view = memoryview(part).cast("B")
        while view:
            view = view[os.write(file, view) :]


def unpacked(payload: bytes) -> Frame:
    """What `packed` packed; lists in the place of tuples."""
    line, _, data = payload.partition(b"\n")
    end = 0

    def restored(item: dict[str, Any]) -> Any:
        nonlocal end
        if ARRAY not in item:
            return item
        kind, shape = item[ARRAY]
        dtype, count = np.dtype(str(kind)), int(np.prod(shape, dtype=np.int64))
        if dtype.hasobject or count < 0:
            raise ValueError(f"an array is of {dtype}")
        begin, end = end, end + count * dtype.itemsize
        return np.frombuffer(data, dtype, count, begin).reshape(shape).copy()

    frame: Frame = json.loads(line, object_hook=restored)
    return frame


def _of_no_use(path: str, words: str) -> ValueError:
    return ValueError(f"{path!r} {words}; run it again without resume")


def frames(path: str) -> Iterator[tuple[int, bytes]]:
    """Whole frames and where each ends, up to a torn one.

    Raises
    ------
    ValueError
        If a byte has changed.
    """
    with os.fdopen(open_regular(path, os.O_RDONLY), "rb") as file:
        size, begin = os.fstat(file.fileno()).st_size, file.read(len(MAGIC))
        if begin != MAGIC[: len(begin)]:
            raise ValueError(
                f"{path!r} is damaged, or no journal of this version of the program; compute it again"
            )
        while len(head := file.read(HEAD.size)) == HEAD.size:
            length, of_length, crc = HEAD.unpack(head)
            sound = zlib.crc32(head[:8]) == of_length
            if sound and length > size - file.tell():
                return  # torn by a kill
            payload = file.read(length) if sound else b""
            if not sound or zlib.crc32(payload) != crc:
                at = file.tell() - len(payload)
                raise _of_no_use(path, f"is damaged at byte {at:,d}: its checksum does not fit")
            yield file.tell(), payload


@dataclass(frozen=True, eq=False)
class Kept:
    """What a journal holds.

    Attributes
    ----------
    path : str
    head : dict
        What is run.
    ends : tuple of int
        Where the head and each frame end, bytes.
    state : dict
        The newest; empty where it is missing.
    """

    path: str
    head: Frame
    ends: tuple[int, ...]
    state: Frame

    def frames(self, count: int | None = None) -> Iterator[Frame]:
        """The first of the frames, or all of them."""
        wanted = len(self.ends) if count is None else count + 1
        for number, (_, payload) in zip(range(wanted), frames(self.path)):
            if number:
                yield unpacked(payload)

    @property
    def vouched(self) -> int:
        """Frames that the state vouches for."""
        return int(self.state.get("frames", 0))


def read(path: str) -> Kept:
    """What a journal holds, all of its checksums looked at.

    Raises
    ------
    ValueError
        If it is damaged, or holds nothing yet.
    """
    state: Frame = {}
    with contextlib.suppress(FileNotFoundError):
        state = next((unpacked(payload) for _, payload in frames(f"{path}.state")), {})
    ends, head = [], None
    for end, payload in frames(path):
        head = unpacked(payload) if head is None else head
        ends.append(end)
    if head is None and state:
        raise _of_no_use(path, "is damaged: its beginning is missing")
    if head is None:
        raise ValueError(f"{path!r} holds nothing yet: its run has not come to a first result")
    if state and state["of"] != head["id"]:
        raise _of_no_use(path, f"and {f'{path}.state'!r} are not of the same run")
    if state and state["frames"] > len(ends) - 1:
        raise _of_no_use(path, f"is damaged: {len(ends) - 1} of {state['frames']} recorded parts are left")
    return Kept(path, head, tuple(ends), state)


class Journal:
    """A journal that this process alone writes, until `close`.

    Parameters
    ----------
    path : str
    what : str
        Kind of file, for messages.
    resume : bool
        Go on with what is there; False: it is replaced when a run begins.

    Attributes
    ----------
    former : Kept or None
        What a former run has left.

    Raises
    ------
    TypeError, ValueError
        If it is being written by another run, is damaged, is something else, or cannot be written.
    """

    def __init__(self, path: Any, what: str, *, resume: bool):
        self.what, self.path, self.former = what, destination(path, what), None
        self._count, self._id, self._fresh = 0, "", not os.path.lexists(self.path)
        try:
            self._file = open_regular(self.path, os.O_RDWR | os.O_CREAT | os.O_APPEND)
        except OSError as error:
            raise ValueError(f"{what} {path!r} cannot be written: {reason(error)}") from None
        try:
            if not hold(self._file):
                raise ValueError(
                    f"{what} {self.path!r} is being written by another run; wait for its end, or name "
                    "another file"
                )
            for own in (self.path, f"{self.path}.state"):
                if not may_be_replaced(own):
                    raise ValueError(f"{what} {own!r} is no file of a run; name another file")
            self._clear()
            if resume and next(frames(self.path), None) is not None:  # not killed before its head was whole
                self.former = read(self.path)
        except BaseException:
            self.close()
            raise

    def _clear(self) -> None:
        """Remove what a kill has left of a state that was being written."""
        folder, name = os.path.split(self.path)
        for other in os.listdir(folder):
            if other.startswith(f".{name}.state.") and other.endswith(".part"):
                shutil.rmtree(os.path.join(folder, other), ignore_errors=True)

    def begin(self, head: Mapping[str, Any], count: int = 0) -> None:
        """Begin anew with a head, or go on behind the first frames of the former run."""
        with self._writing():
            if self.former is not None:
                self._count, self._id = count, self.former.head["id"]
                os.truncate(self._file, self.former.ends[count])
                return
            with contextlib.suppress(FileNotFoundError):
                os.remove(destination(f"{self.path}.state", self.what))
            os.truncate(self._file, 0)
            self._count, self._id = 0, os.urandom(8).hex()
            write(self._file, [MAGIC, *packed({**head, "id": self._id})])
        self.checkpoint({})  # from here on a state that is missing has been lost

    def append(self, frame: Mapping[str, Any]) -> None:
        """Add a frame; it is in the system's hands when this returns: a kill of the process leaves it."""
        with self._writing():
            if not os.path.exists(self.path) or not os.path.samestat(
                os.fstat(self._file), os.stat(self.path)
            ):
                raise OSError("it has been removed or replaced during the run")
            write(self._file, packed(frame))
        self._count += 1

    def checkpoint(self, state: Mapping[str, Any]) -> None:
        """A state that vouches for all frames so far, in the place of the former one, on the disk when this
        returns.
        """
        with self._writing():
            os.fsync(self._file)
            with replaced(f"{self.path}.state", self.what) as temporary, open(temporary, "wb") as file:
                file.writelines([MAGIC, *packed({**state, "frames": self._count, "of": self._id})])

    @contextlib.contextmanager
    def _writing(self) -> Iterator[None]:
        try:
            yield
        except (OSError, ValueError) as error:
            raise SolveError(
                f"{self.what} {self.path!r} cannot be written any more ({reason(error)}); what it holds "
                "stays readable, and resume=True continues from there"
            ) from None

    def close(self) -> None:
        """Give it up to others; nothing is left of one that has not begun."""
        with contextlib.suppress(OSError):
            if self._fresh and not os.fstat(self._file).st_size:
                os.remove(self.path)
        os.close(self._file)

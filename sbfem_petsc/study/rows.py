"""Rows of a sweep on the disk: each group of ranks appends to a file of its own. A row is a journal of one
frame, so that what a kill has cut off, or bytes that have changed, cost no other row.
"""

from __future__ import annotations

import contextlib
import os
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from meshing.folder_index import claim, open_regular
from meshing.whole_file import reason

from ..output_folder import hold
from ..record.journal import HEAD, MAGIC, packed, unpacked
from .kinds.kind import Values


@dataclass(frozen=True, eq=False)
class Row:
    """One finished row.

    Attributes
    ----------
    number : int
    reason : str
        Why it failed; empty if it did not.
    seconds : float
    values : dict of str to (array, str)
        And units, by path, "steady/harmonics/A".
    """

    number: int
    reason: str
    seconds: float
    values: Values = field(default_factory=dict)


@contextlib.contextmanager
def held(path: str, what: str) -> Iterator[None]:
    """Keep a file of rows to this process, until the end or until it ends, however it does.

    Parameters
    ----------
    path : str
    what : str
        Which rows, for messages.

    Raises
    ------
    ValueError
        If another process has it.
    """
    claim(path, "rows of the sweep")
    with os.fdopen(open_regular(path, os.O_RDWR | os.O_CREAT), "r+b") as file:
        if not hold(file.fileno()):
            raise ValueError(f"{what} are computed by another process; wait for its end")
        yield


def append(path: str, row: Row) -> None:
    """Add a row to a file; it is on the disk when this returns.

    Raises
    ------
    ValueError
        If the system refuses, as on a full disk.
    """
    units = {name: unit for name, (_, unit) in row.values.items()}
    facts = {"number": row.number, "reason": row.reason, "seconds": row.seconds, "units": units}
    values = {f"/{name}": np.asarray(value) for name, (value, _) in row.values.items()}
    try:
        with os.fdopen(open_regular(path, os.O_WRONLY | os.O_APPEND | os.O_CREAT), "ab") as file:
            file.writelines([MAGIC, *packed(facts | values)])
            file.flush()
            os.fsync(file.fileno())
    except OSError as error:
        raise ValueError(f"rows of the sweep in {path!r} cannot be written: {reason(error)}") from None


def read(folder: str) -> dict[int, Row]:
    """All whole rows in a folder's files by number, a success before a failure."""
    return {row.number: row for row in sorted(every(folder), key=lambda row: not row.reason)}


def every(folder: str) -> Iterator[Row]:
    """All whole rows in a folder's files, as often as they were written."""
    for name in sorted(os.listdir(folder)):
        if name.endswith(".rows"):
            yield from of_file(os.path.join(folder, name))


def of_file(path: str) -> Iterator[Row]:
    """All whole rows in a file, whatever stands between them: what a kill has cut off, or bytes that have
    changed.
    """
    with os.fdopen(open_regular(path, os.O_RDONLY), "rb") as file:
        data = file.read()
    place = 0
    while (place := data.find(MAGIC, place)) >= 0:
        place += len(MAGIC)
        head = data[place : place + HEAD.size]
        if len(head) < HEAD.size or zlib.crc32(head[:8]) != HEAD.unpack(head)[1]:
            continue
        length, _, checksum = HEAD.unpack(head)
        payload = data[place + HEAD.size : place + HEAD.size + length]
        if len(payload) == length and zlib.crc32(payload) == checksum:
            yield _unpacked(path, payload)
            place += HEAD.size + length


def _unpacked(path: str, payload: bytes) -> Row:
    try:
        found = unpacked(payload)
        units = found["units"]
        values = {name: (found[f"/{name}"], str(units[name])) for name in units}
        return Row(int(found["number"]), str(found["reason"]), float(found["seconds"]), values)
    except (ValueError, TypeError, KeyError, AttributeError) as error:
        raise ValueError(
            f"rows of the sweep in {path!r} are not what a sweep has written ({error}); give --replace to "
            "compute them again"
        ) from None

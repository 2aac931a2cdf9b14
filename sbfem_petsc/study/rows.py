"""Rows of a sweep on the disk: each group of ranks appends to a file of its own, and what a kill "
"cuts off is seen."""

from __future__ import annotations

import io
import json
import os
import struct
import zipfile
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..writing import reason

_HEAD = struct.Struct("<4sQI")  # mark, length, checksum
_MARK = b"row\0"


@dataclass(frozen=True, eq=False)
class Row:
    """One finished row.

    Attributes
    ----------
    number : int
    reason : str
        Why it failed; empty if it did not.
    seconds : float
    values : dict of str to array
        By path, "steady/harmonics/A".
    units : dict of str to str
    """

    number: int
    reason: str
    seconds: float
    values: dict[str, np.ndarray] = field(default_factory=dict)
    units: dict[str, str] = field(default_factory=dict)


def append(path: str, row: Row) -> None:
    """Add a row to a file; it is on the disk when this returns.

    Raises
    ------
    ValueError
        If the system refuses, as on a full disk.
    """
    buffer = io.BytesIO()
    facts = {"number": row.number, "reason": row.reason, "seconds": row.seconds, "units": row.units}
    names = list(row.values)
    np.savez(
        buffer,
        facts=np.array(json.dumps({**facts, "names": names})),
        **{f"v{k}": row.values[name] for k, name in enumerate(names)},
    )
    payload = buffer.getvalue()
    try:
        with open(path, "ab") as file:
            file.write(_HEAD.pack(_MARK, len(payload), zlib.crc32(payload)) + payload)
            file.flush()
            os.fsync(file.fileno())
    except OSError as error:
        raise ValueError(f"rows of the sweep in {path!r} cannot be written: {reason(error)}") from None


def read(folder: str) -> dict[int, Row]:
    """All whole rows in a folder's files by number, a success before a failure; what a kill left behind in a
    file is cut off, so that it can be appended to.
    """
    found: dict[int, Row] = {}
    for name in sorted(os.listdir(folder)):
        if name.endswith(".rows"):
            for row in _rows(os.path.join(folder, name)):
                if row.number not in found or not row.reason:
                    found[row.number] = row
    return found


def count(folder: str) -> int:
    """Number of whole rows, without reading them."""
    total = 0
    for name in os.listdir(folder):
        if name.endswith(".rows"):
            with open(os.path.join(folder, name), "rb") as file:
                size = os.fstat(file.fileno()).st_size
                while len(head := file.read(_HEAD.size)) == _HEAD.size:
                    length = _HEAD.unpack(head)[1]
                    if length > size - file.tell():
                        break
                    file.seek(length, os.SEEK_CUR)
                    total += 1
    return total


def _rows(path: str) -> Iterator[Row]:
    whole, size = 0, os.path.getsize(path)
    with open(path, "rb") as file:
        while True:
            head = file.read(_HEAD.size)
            if len(head) < _HEAD.size:
                break
            mark, length, checksum = _HEAD.unpack(head)
            if mark != _MARK or length > size - file.tell():
                break
            payload = file.read(length)
            if zlib.crc32(payload) != checksum:
                break
            whole = file.tell()
            yield _unpacked(path, payload)
    if whole < size:
        os.truncate(path, whole)


def _unpacked(path: str, payload: bytes) -> Row:
    try:
        with np.load(io.BytesIO(payload), allow_pickle=False) as arrays:
            facts: dict[str, Any] = json.loads(str(arrays["facts"]))
            values = {str(name): arrays[f"v{k}"] for k, name in enumerate(facts["names"])}
        units = {str(name): str(unit) for name, unit in facts["units"].items()}
        row = Row(int(facts["number"]), str(facts["reason"]), float(facts["seconds"]), values, units)
    except (ValueError, TypeError, KeyError, AttributeError, OSError, EOFError, zipfile.BadZipFile) as error:
        raise ValueError(
            f"rows of the sweep in {path!r} are not what a sweep has written ({error}); give --replace to "
            "compute them again"
        ) from None
    return row

"""Layout of the file of a time history, written while the motion is integrated and readable at every instant.

The HDF5 file is laid out once, every data set of the groups "rows" and "running" contiguous and at its final
size with nothing allocated on the disk; the run then writes plain bytes at known places. No structure of the
file changes any more, so that there is no instant at which a killed run leaves one that HDF5 cannot read.
(Appending to chunked data sets changes trees and headers at every flush; files open for SWMR have to be
repaired by h5clear after a kill, and every rank would need a file of its own.)

rows/NAME        a row an instant, for each column
running/A, B     checkpoints, written in turn: a head, the state of every writer, the newer one counts
running/blocks   for each recorded chunk the number of rows up to its end, and their CRC-32
running/recorded number of rows that are valid

A head holds counter, steps done, rows, blocks, a CRC-32 of every writer's state, and its own; it is written
last, and vouches for all that was written before it.
"""

from __future__ import annotations

import os
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import h5py
import numpy as np

from meshing.whole_file import reason

from ..errors import SolveError
from ..signals.signal import Signal
from ..system.tip_facts import TipFacts
from .hdf5 import opened, put, put_texts
from .sound import number, numbers, text, texts, whole
from .tip_facts import read_tip_facts, write_tip_facts

WHAT, FORM, VERSION = "history file", "sbfem-petsc history", 2
SLOTS = ("running/A", "running/B")
# Instants at which the signals of a resumed run are compared with the former run's.
SIGNAL_CHECKS = 4097
# Numbers of a head before the sums of the writers' states.
HEAD = 4

Rows = dict[str, np.ndarray]


class Head(NamedTuple):
    """What a checkpoint vouches for."""

    counter: int
    done: int
    rows: int
    blocks: int
    sums: tuple[int, ...]

    @classmethod
    def read(cls, slot: h5py.Dataset, writers: int) -> Head | None:
        """None where it is not whole."""
        values = slot[: HEAD + writers + 1]
        if not values[0] > 0 or checksum(values[:-1]) != values[-1]:
            return None
        counter, done, rows, blocks, *sums = map(int, values[:-1])
        return cls(counter, done, rows, blocks, tuple(sums))

    def array(self) -> np.ndarray:
        """As it stands in the file."""
        values = np.array([*self[:HEAD], *self.sums], dtype="<f8")
        return np.append(values, checksum(values))


class ColumnLike(NamedTuple):
    """What a row holds under a name."""

    shape: tuple[int, ...]
    unit: str
    description: str


@dataclass(frozen=True, eq=False)
class Contents:
    """All that a file says beside its rows and checkpoints.

    Attributes
    ----------
    kind : {"reduced", "unreduced"}
        Of the model.
    settings : dict
        Numbers, texts and arrays by name, "count", "step", "decimation" and "chunk" among them.
    columns : dict of str to (shape, unit, description)
    sizes : tuple of int
        Lengths of the writers' states.
    signal_checks : (SIGNAL_CHECKS, loads) array
    texts : dict of str to tuple of str
        Further names: points.
    arrays : dict of str to array
        What tells the model from others.
    tips : TipFacts or None
        Of an unreduced model; a reduced one knows its own.
    """

    kind: str
    settings: Mapping[str, Any]
    columns: Mapping[str, ColumnLike]
    sizes: tuple[int, ...]
    signal_checks: np.ndarray
    texts: Mapping[str, Sequence[str]]
    arrays: Mapping[str, np.ndarray]
    tips: TipFacts | None = None

    @property
    def instants(self) -> int:
        """Rows of a whole run."""
        return 1 + self.settings["count"] // self.settings["decimation"]

    @property
    def head(self) -> int:
        """Length of a head."""
        return HEAD + len(self.sizes) + 1

    def lay_out(self, file: h5py.File, former_blocks: int = 0) -> None:
        """All groups and data sets; those that the run writes to are left without a value."""
        file.attrs["kind"] = self.kind
        file.create_group("settings").attrs.update(self.settings)
        put(
            file,
            "signal_checks",
            self.signal_checks,
            "unit of the load",
            "values that tell load signals apart",
        )
        put(
            file,
            "checkpoint_sizes",
            np.array(self.sizes, dtype=np.int64),
            "1",
            "lengths of the writers' states",
        )
        names = file.create_group("names")
        for name, values in self.texts.items():
            put_texts(names, name, values)
        for name, array in self.arrays.items():
            put(file.require_group("identity"), name, array, "SI", "tells models apart")
        if self.tips is not None:
            write_tip_facts(file.create_group("tip_facts"), self.tips)
        for name, (shape, unit, description) in self.columns.items():
            dataset = _reserve(file, f"rows/{name}", (self.instants, *shape))
            dataset.attrs["unit"], dataset.attrs["description"] = unit, description
        for slot in SLOTS:
            _reserve(file, slot, (self.head + sum(self.sizes),))
        blocks = former_blocks + 2 + -(-self.settings["count"] // self.settings["chunk"])
        _reserve(file, "running/blocks", (blocks, 2))
        _reserve(file, "running/recorded", (1,))

    @classmethod
    def read(cls, file: h5py.File) -> Contents:
        """What `lay_out` wrote.

        Raises
        ------
        ValueError
            If it does not fit together.
        """
        kind, group = text(file, "kind"), file["settings"]
        if kind not in ("reduced", "unreduced"):
            raise ValueError(f"kind = {kind!r} is unknown")
        for name in ("count", "decimation", "chunk"):
            whole(group, name, least=1)
        number(group, "step", least=1e-300)
        columns = {
            name: ColumnLike(data.shape[1:], text(data, "unit"), text(data, "description"))
            for name, data in file["rows"].items()
        }
        found = cls(
            kind,
            {name: _plain(value) for name, value in group.attrs.items()},
            columns,
            tuple(numbers(file, "checkpoint_sizes", None, kinds="iu", least=0).tolist()),
            numbers(file, "signal_checks", SIGNAL_CHECKS, None),
            {name: texts(file["names"], name) for name in file["names"].attrs},
            {name: data[()] for name, data in file.get("identity", {}).items()},
            None
            if kind == "reduced"
            else read_tip_facts(file["tip_facts"], columns["contact_force"].shape[0]),
        )
        if not found.sizes:
            raise ValueError("'checkpoint_sizes' is empty")
        lengths = {f"rows/{name}": (found.instants, *column.shape) for name, column in columns.items()}
        lengths |= {slot: (found.head + sum(found.sizes),) for slot in SLOTS} | {"running/recorded": (1,)}
        for name, shape in lengths.items():
            if not _is_reserved(file[name]) or file[name].shape != shape:
                raise ValueError(f"{name!r} is not laid out as {shape} numbers")
        if not _is_reserved(file["running/blocks"]) or file["running/blocks"].shape[1:] != (2,):
            raise ValueError("'running/blocks' is not laid out as pairs of numbers")
        return found


def newest(file: h5py.File, contents: Contents) -> tuple[Head, np.ndarray, int]:
    """The newer of the checkpoints that are whole, the states of all writers, and how many rows are said to
    be recorded behind it: of a run that was killed none are, whenever that was.
    """
    found = []
    for name in SLOTS:
        head, states = Head.read(file[name], len(contents.sizes)), file[name][contents.head :]
        if head is not None:
            parts = np.split(states, np.cumsum(contents.sizes)[:-1])
            if all(checksum(part) == total for part, total in zip(parts, head.sums)):
                found.append((head, states))
    if not found:
        raise ValueError(f"{WHAT} {file.filename!r} holds no recorded instant")
    head, states = max(found, key=lambda pair: pair[0].counter)
    fits = 0 < head.rows <= contents.instants and 0 <= head.done <= contents.settings["count"]
    if not fits or not 0 < head.blocks <= len(file["running/blocks"]) or not np.isfinite(states).all():
        raise ValueError(f"{head.rows} rows of {head.done} steps are said to be recorded")
    recorded = file["running/recorded"][0]
    if not (0.0 <= recorded <= contents.instants and recorded == int(recorded)):
        raise ValueError(f"{recorded} rows are said to be recorded")
    return head, states, max(0, int(recorded) - head.rows)


def mapped(path: str, names: Sequence[str], count: int) -> Rows:
    """The first `count` rows as memory-mapped arrays, read when they are used."""
    with opened(path, WHAT, {FORM: VERSION}) as file:
        places = {
            name: (file[f"rows/{name}"].id.get_offset(), (count, *file[f"rows/{name}"].shape[1:]))
            for name in names
        }
    return {
        name: np.memmap(path, "<f8", "r", place, shape) if np.prod(shape) else np.zeros(shape)
        for name, (place, shape) in places.items()
    }


def verified(path: str, contents: Contents, head: Head) -> Rows:
    """The recorded rows, memory-mapped, after a look at every one of their checksums.

    Raises
    ------
    ValueError
        If a row is not what was recorded.
    """
    rows, first = mapped(path, tuple(contents.columns), head.rows), 0
    with opened(path, WHAT, {FORM: VERSION}) as file:
        blocks = file["running/blocks"][: head.blocks]
    if not np.isfinite(blocks).all():
        raise ValueError(f"{WHAT} {path!r} is damaged: the table of its rows holds no numbers")
    for end, total in blocks:
        if not first <= end <= head.rows or block_sum(rows, first, int(end)) != total:
            raise ValueError(
                f"{WHAT} {path!r} is damaged: its rows {first + 1} to {int(min(end, head.rows))} do not fit "
                "their checksum; run it again without resume"
            )
        if not all(np.isfinite(values[first : int(end)]).all() for values in rows.values()):
            raise ValueError(
                f"{WHAT} {path!r} is damaged: its rows {first + 1} to {int(end)} are not all finite numbers"
            )
        first = int(end)
    if first != head.rows:
        raise ValueError(f"{WHAT} {path!r} is damaged: {head.rows - first} of its rows have no checksum")
    return rows


def block_sum(rows: Rows, first: int, end: int) -> int:
    """CRC-32 of some rows of all columns, by their names."""
    total = 0
    for name in sorted(rows):
        total = zlib.crc32(np.ascontiguousarray(rows[name][first:end], dtype="<f8").tobytes(), total)
    return total


def checksum(values: np.ndarray) -> int:
    """CRC-32 of numbers."""
    return zlib.crc32(np.ascontiguousarray(values, dtype="<f8").tobytes())


def signal_checks(signals: Sequence[Signal], duration: float) -> np.ndarray:
    """(SIGNAL_CHECKS, loads): values that tell load signals apart."""
    times = np.linspace(0.0, duration, SIGNAL_CHECKS)
    return np.stack([s(times) for s in signals], axis=-1) if signals else np.zeros((SIGNAL_CHECKS, 0))


class OpenRows:
    """A file that is written at known places.

    Parameters
    ----------
    path : str
    columns : names of the rows' data sets
    """

    def __init__(self, path: str, columns: Sequence[str]):
        self._path = path
        names = [*(f"rows/{name}" for name in columns), *SLOTS, "running/blocks", "running/recorded"]
        with opened(path, WHAT, {FORM: VERSION}) as file:
            self._offsets = {name: file[name].id.get_offset() for name in names}
        self._handle = os.open(path, os.O_RDWR)

    def check_place(self) -> None:
        """A deleted file can be written on without an error, and would be lost."""
        if not os.path.exists(self._path) or not os.path.samestat(
            os.fstat(self._handle), os.stat(self._path)
        ):
            raise OSError("it has been removed or replaced during the run")

    def put(self, name: str, values: np.ndarray, first: int = 0) -> None:
        """Write rows from the one numbered `first` on."""
        values = np.ascontiguousarray(values, dtype="<f8")
        if values.size == 0:
            return
        place, data = self._offsets[name] + first * values[0].size * 8, memoryview(values.tobytes())
        while len(data):
            written = os.pwrite(self._handle, data, place)
            place, data = place + written, data[written:]

    def synchronise(self) -> None:
        """Bring all to the disk."""
        os.fsync(self._handle)

    def close(self) -> None:
        """Give the file up."""
        os.close(self._handle)


def cannot_go_on(path: str, error: Exception) -> SolveError:
    """What is told when a file cannot be written any more."""
    return SolveError(
        f"transient: {WHAT} {path!r} cannot be written any more ({reason(error)}); what it holds stays "
        "readable, and resume=True continues from there"
    )


def _reserve(file: h5py.File, name: str, shape: tuple[int, ...]) -> h5py.Dataset:
    """A contiguous data set with a place in the file, but not written: file systems with holes give no blocks
    to it.
    """
    layout = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
    layout.set_layout(h5py.h5d.CONTIGUOUS)
    layout.set_alloc_time(h5py.h5d.ALLOC_TIME_EARLY)
    layout.set_fill_time(h5py.h5d.FILL_TIME_NEVER)
    file.require_group(os.path.dirname(name))
    h5py.h5d.create(file.id, name.encode(), h5py.h5t.IEEE_F64LE, h5py.h5s.create_simple(shape), layout)
    return file[name]


def _is_reserved(item: Any) -> bool:
    """Whether a data set is as `_reserve` makes them: its numbers stand in the file one after the other."""
    return (
        isinstance(item, h5py.Dataset)
        and item.dtype == np.dtype("<f8")
        and item.chunks is None
        and (item.size == 0 or item.id.get_offset() is not None)
    )


def _plain(value: Any) -> Any:
    return value.item() if isinstance(value, np.generic) else value

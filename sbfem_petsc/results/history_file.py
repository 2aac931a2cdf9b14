"""What the history files of reduced and of unreduced models have in common: layout, writing in place,
settings.
"""

from __future__ import annotations

import contextlib
import os
import warnings

import h5py
import numpy as np

from ..errors import SolveError
from ..parallel import collective, on_root
from ..petsc import MPI

FORMAT, UNREDUCED, FORMAT_VERSION = "sbfem-petsc history", "sbfem-petsc history of an unreduced model", 1
# Relative differences of the same model on other numbers of ranks.
SAME = 1e-5
# Instants at which the signals of a restart are compared with the former run's.
SIGNAL_CHECKS = 4097
SLOTS = ("state/A", "state/B")


class IncompleteHistory(UserWarning):
    """The run that wrote the file has not ended, or not yet."""


def warn_unless(complete: bool, path: str, done: int, count: int, level: int) -> None:
    """Warn of a file whose run has not ended."""
    if not complete:
        warnings.warn(
            f"history file {path!r} is incomplete: its run has recorded {done} of {count} steps; "
            "restart=True continues it",
            IncompleteHistory,
            stacklevel=level + 1,
        )


def recorded_steps(comm: MPI.Comm, path: str) -> tuple[int, float] | None:
    """Number of steps and time step (s) of a history file, on all ranks; None if there is no file.
    Collective.
    """

    def read():
        if not os.path.lexists(path):
            return None
        with opened(os.path.abspath(os.fspath(path)), None) as file:
            return int(file.attrs["count"]), float(file.attrs["step"])

    return comm.bcast(on_root(comm, read))


@contextlib.contextmanager
def opened(path: str, form: str | None = FORMAT):
    """A history file open for reading, of one form or (None) of any; every failure as a ValueError of one
    sentence.
    """
    if not os.path.isfile(path):
        raise ValueError(f"history file {path!r} does not exist")
    try:
        with h5py.File(path, "r") as file:
            found = file.attrs.get("format")
            if found not in (FORMAT, UNREDUCED) if form is None else found != form:
                raise ValueError(f"{path!r} is an HDF5 file of another kind, not {form or FORMAT}")
            if int(file.attrs["format_version"]) > FORMAT_VERSION:
                raise ValueError(
                    f"history file {path!r} has format version {file.attrs['format_version']}, newer than "
                    f"this program's {FORMAT_VERSION}"
                )
            yield file
    except (OSError, KeyError, RuntimeError, IndexError) as error:
        raise ValueError(f"history file {path!r} is truncated or no HDF5 file ({error})") from None


class RunningFile:
    """A file that is written in place; a context manager.

    Attributes
    ----------
    comm : Comm
    path : str
    """

    def __init__(self, comm: MPI.Comm, path: str):
        self.comm, self.path = comm, os.path.abspath(os.fspath(path))
        self._handle = None

    def __enter__(self) -> RunningFile:
        return self

    def __exit__(self, *_) -> None:
        if self._handle is not None:
            os.close(self._handle)
            self._handle = None

    def _open(self, names) -> None:
        """Open for writing and note the places of datasets."""
        with h5py.File(self.path, "r") as file:
            self._offsets = {name: file[name].id.get_offset() for name in names}
        self._handle = os.open(self.path, os.O_RDWR)

    def _check_place(self) -> None:
        """A deleted file can be written on without an error, and would be lost."""
        mine = os.fstat(self._handle)
        if not os.path.exists(self.path) or not os.path.samestat(mine, os.stat(self.path)):
            raise OSError("it has been removed or replaced during the run")

    def _put(self, name: str, values: np.ndarray, first: int = 0) -> None:
        values = np.ascontiguousarray(values, dtype="<f8")
        if values.size == 0:
            return
        place, data = self._offsets[name] + first * values[0].size * 8, memoryview(values).cast("B")
        while len(data):
            written = os.pwrite(self._handle, data, place)
            place, data = place + written, data[written:]

    def recorded(self, names, count: int) -> dict[str, np.ndarray]:
        """The first `count` rows as they lie in the file, read when they are used, on all ranks.
        Collective.
        """
        with collective(self.comm):
            try:
                return mapped_rows(self.path, names, count)
            except (OSError, ValueError) as error:
                raise SolveError(
                    f"transient: rank {self.comm.rank} cannot read history file {self.path!r} ({error}); "
                    "in_memory = False needs a folder that all ranks share"
                ) from None

    def _finish(self) -> None:
        os.fsync(self._handle)
        os.close(self._handle)
        self._handle = None
        with h5py.File(self.path, "r+") as file:
            file.attrs.modify("complete", True)


def mapped_rows(path: str, names, count: int) -> dict[str, np.ndarray]:
    """The first `count` rows of contiguous datasets as memory-mapped arrays."""
    with h5py.File(path, "r") as file:
        places = {name: (file[name].id.get_offset(), (count, *file[name].shape[1:])) for name in names}
    return {
        name: np.memmap(path, "<f8", "r", place, shape) if np.prod(shape) else np.zeros(shape)
        for name, (place, shape) in places.items()
    }


@contextlib.contextmanager
def new_file(path: str):
    """An incomplete file under another name, which takes its own when it has been filled."""
    temporary = os.path.join(os.path.dirname(path), f".{os.path.basename(path)}.{os.getpid()}.part")
    try:
        with h5py.File(temporary, "w") as file:
            file.attrs["complete"] = False
            yield file
            file.flush()
        os.replace(temporary, path)
    finally:
        if os.path.exists(temporary):
            os.remove(temporary)


def reserve_rows(file: h5py.File, shapes: dict, descriptions: dict, former: dict | None) -> None:
    """Places for all rows of a run, the first of them filled with a shorter run's."""
    for name, shape in shapes.items():
        _reserve(file, name, shape)
        file[name].attrs["unit"], file[name].attrs["description"] = descriptions[name]
        if former is not None and file[name].size:
            file[name][: len(former[name])] = former[name]


def reserve_states(file: h5py.File, size: int, states: dict | None) -> None:
    """Places for the two states, with those of a shorter run."""
    for slot in SLOTS:
        _reserve(file, slot, (size,))
        if states is not None:
            file[slot][...] = states[slot]


def _reserve(file: h5py.File, name: str, shape: tuple) -> None:
    """A contiguous dataset with a place in the file, but not written: file systems with holes give no blocks
    to it.
    """
    layout = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
    layout.set_layout(h5py.h5d.CONTIGUOUS)
    layout.set_alloc_time(h5py.h5d.ALLOC_TIME_EARLY)
    layout.set_fill_time(h5py.h5d.FILL_TIME_NEVER)
    if "/" in name:
        file.require_group(os.path.dirname(name))
    h5py.h5d.create(file.id, name.encode(), h5py.h5t.IEEE_F64LE, h5py.h5s.create_simple(shape), layout)


def signal_checks(signals, duration: float) -> np.ndarray:
    """(SIGNAL_CHECKS, loads): values that tell load signals apart."""
    times = np.linspace(0.0, duration, SIGNAL_CHECKS)
    return np.stack([s(times) for s in signals], axis=-1) if signals else np.zeros((SIGNAL_CHECKS, 0))


def check_settings(file: h5py.File, settings: dict, signals) -> None:
    """Refuse a file of other settings or signals, and one that reaches beyond what is asked for."""
    path = file.filename
    for name, value in settings.items():
        if name != "count" and not close(file.attrs[name], value):
            raise ValueError(
                f"history file {path!r} was written with {name} = {file.attrs[name]}, not {value}; restart "
                "with the same value, or name another file"
            )
    count, step = int(file.attrs["count"]), float(file.attrs["step"])
    if count > settings["count"]:
        raise ValueError(
            f"history file {path!r} is that of a run of {count * step:.6g} s, longer than "
            f"{settings['count'] * step:.6g} s; read it, or name another file"
        )
    if not close(file["signal_checks"][()], signal_checks(signals, count * step)):
        raise ValueError(
            f"history file {path!r} was written for other load signals; restart with the same loads, or name "
            "another file"
        )


def close(one, other) -> bool:
    if isinstance(one, str) or isinstance(other, str):
        return one == other
    one, other = 1.0 * np.asarray(one), 1.0 * np.asarray(other)
    return one.shape == other.shape and bool(
        np.allclose(
            one,
            other,
            rtol=1e-9 if one.ndim == 0 else SAME,
            atol=SAME * np.abs(other).max(initial=0.0) if one.ndim else 0.0,
        )
    )

"""A time history on disk while it is integrated: readable after Ctrl-C, kill -9 or a full disk, and the start of a further run.

The HDF5 file is laid out once, every dataset contiguous and at its final size with nothing allocated on the disk; the run then writes plain bytes at
known places. No structure of the file changes any more, so that there is no instant at which a killed run leaves one that HDF5 cannot read. What is
valid is told by the newer of two states, "A" and "B", written in turn after the rows they vouch for.
"""

from __future__ import annotations

import contextlib
import os
import warnings
import zlib
from dataclasses import dataclass, fields, replace

import h5py
import numpy as np

from ..analysis import transient as analysis
from ..analysis.transient import Energy, Transient
from ..errors import SolveError
from ..parallel import collective
from ..petsc import MPI
from ..reduction import Reduction

FORMAT, FORMAT_VERSION = "sbfem-petsc history", 1
# Relative differences of the same model's reduction on other numbers of ranks.
SAME = 1e-5
# Instants at which the signals of a restart are compared with the former run's.
SIGNAL_CHECKS = 4097
_ROWS = {"time": ("s", "instants"), "modal_displacement": ("m sqrt(kg)", "modal coordinates q"), "modal_velocity": ("m sqrt(kg)/s", "derivative of q"),
         "amplitudes": ("unit of the load", "values of the load signals"), "contact_force": ("N", "forces of the contact pairs, compression positive"),
         "energies": ("J", "kinetic, strain, external, damping, contact")}


class IncompleteHistory(UserWarning):
    """The run that wrote the file has not ended, or not yet."""


@dataclass(frozen=True, eq=False, repr=False)
class RecordedTransient(Transient):
    """A history read from a file.

    Attributes
    ----------
    complete : bool
        Whether the run that wrote it reached its end.
    """

    complete: bool = True


class HistoryFile:
    """The file of a running history; rank 0 writes, an error of it is raised on every rank. A context manager.

    Parameters
    ----------
    comm : Comm
    path : str
    restart : bool
        Continue the file if it exists; False: replace it.
    reduction : Reduction
    signals : sequence of Signal
    count, step, contact, scheme, start, decimation
        See `analysis.transient.integrate`.

    Attributes
    ----------
    reduction : Reduction
        That of the file in a restart, so that the continued history is the same to the last bit; otherwise the one given. Arrays are
        contiguous in both cases: BLAS rounds products of others differently.

    Raises
    ------
    ValueError
        If the file is no history, of another model, load or setting, or cannot be made.
    """

    def __init__(self, comm: MPI.Comm, path: str, restart: bool, reduction: Reduction, signals, count: int, step: float, contact: bool, scheme: str, start, decimation: int):
        self.comm, self.path, self.count, self.decimation = comm, os.path.abspath(os.fspath(path)), count, decimation
        self._handle, self._counter = None, 0
        state = "modal" if not isinstance(start, str) else start
        given = [float(np.linalg.norm(part)) for part in ((reduction.omega * start[0], start[1]) if state == "modal" else ())]
        settings = {"count": count, "step": step, "contact": bool(contact), "scheme": scheme, "start": state, "start_norms": np.array(given), "decimation": decimation, "chunk": analysis.CHUNK}
        times = np.linspace(0.0, count * step, SIGNAL_CHECKS)
        checks = np.stack([s(times) for s in signals], axis=-1) if signals else np.zeros((SIGNAL_CHECKS, 0))
        self._sizes = _state_sizes(len(reduction.omega), len(reduction.initial_gap) if contact else 0, len(reduction.initial_gap), checks.shape[1])
        found = None
        with collective(comm):
            if comm.rank == 0:
                try:
                    if restart and os.path.lexists(self.path):
                        found = _read_for_restart(self.path, reduction, settings, checks)
                    else:
                        _lay_out(self.path, reduction, settings, checks, sum(self._sizes) + 2)
                    with h5py.File(self.path, "r") as file:
                        self._offsets = {name: file[name].id.get_offset() for name in (*_ROWS, "state/A", "state/B")}
                    self._handle = os.open(self.path, os.O_RDWR)
                except (OSError, RuntimeError) as error:
                    raise ValueError(f"history file {self.path!r} cannot be written ({getattr(error, 'strerror', None) or error}); name another folder or change its permissions") from None
        self._found = comm.bcast(found)
        self.reduction = _in_rows(self._found[0] if self._found else reduction)

    def __enter__(self) -> "HistoryFile":
        return self

    def __exit__(self, *_) -> None:
        if self._handle is not None:
            os.close(self._handle)
            self._handle = None

    def begin(self, keep: dict, energies: list, q, v, force, active, ledger) -> tuple[int, int]:
        """Record the initial state, or put the file's rows and state in its place; steps done and exchanges of active sets."""
        if self._found is None:
            self._write(0, 0, {**{long: keep[short][0] for short, long in _SHORT.items()}, "energies": energies[0].T}, 0, q, v, force, active, ledger)
            return 0, 0
        _, state, rows = self._found
        self._counter = state["counter"]
        for short, long in _SHORT.items():
            keep[short][:] = [rows[long]]
        energies[:] = [rows["energies"].T]
        for target, name in ((q, "q"), (v, "v"), (force, "force"), (active, "active")):
            target[...] = state[name]
        ledger.work, ledger.supplied, ledger.last = state["work"], state["supplied"], state["last"]
        self._found = None
        with collective(self.comm):
            if self.comm.rank == 0 and state["done"] == self.count:  # killed between the last state and the mark
                self._finish()
        return state["done"], state["exchanges"]

    def append(self, done: int, exchanges: int, keep: dict, energies: list, q, v, force, active, ledger) -> None:
        """Record the last chunk of `keep` and `energies` and the state after `done` steps; at the last one the file is marked complete."""
        rows = {**{long: keep[short][-1] for short, long in _SHORT.items()}, "energies": energies[-1].T}
        self._write(done, exchanges, rows, 1 + done // self.decimation - len(rows["time"]), q, v, force, active, ledger)

    def _write(self, done, exchanges, rows, first, q, v, force, active, ledger) -> None:
        with collective(self.comm):
            if self.comm.rank == 0:
                try:
                    self._check_place()
                    for name, values in rows.items():
                        self._put(name, values, first)
                    self._counter += 1
                    body = np.concatenate([[self._counter, done, exchanges, ledger.supplied], ledger.work, q, v, force, active, *(part.ravel() for part in ledger.last)])
                    self._put("state/" + "AB"[self._counter % 2], np.concatenate([[self._counter], body, [zlib.crc32(body.astype("<f8").tobytes())]]))
                    if done == self.count:
                        self._finish()
                except (OSError, RuntimeError) as error:
                    raise SolveError(f"transient: history file {self.path!r} cannot be written any more ({getattr(error, 'strerror', None) or error}); "
                                     "what it holds stays readable, and restart=True continues from there") from None

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

    def _finish(self) -> None:
        os.fsync(self._handle)
        os.close(self._handle)
        self._handle = None
        with h5py.File(self.path, "r+") as file:
            file.attrs.modify("complete", True)


_SHORT = {"time": "time", "q": "modal_displacement", "v": "modal_velocity", "s": "amplitudes", "force": "contact_force"}


def read_history(path: str) -> RecordedTransient:
    """Read a history, also one whose run has not ended, or was killed.

    Raises
    ------
    ValueError
        If the file is missing, truncated or of another kind; one sentence.

    Warns
    -----
    IncompleteHistory
        If the run that wrote it has not ended; what it had recorded is returned.
    """
    path = os.fspath(path)
    with _opened(path) as file:
        state, reduction = _newest_state(file), _read_reduction(file)
        rows = _rows(file, state["done"])
        complete, step, count = bool(file.attrs["complete"]), float(file.attrs["step"]), int(file.attrs["count"])
    if not complete:
        warnings.warn(f"history file {path!r} is incomplete: its run has recorded {state['done']} of {count} steps; restart=True continues it", IncompleteHistory, stacklevel=2)
    return RecordedTransient(rows["time"], rows["modal_displacement"], rows["modal_velocity"], rows["amplitudes"], rows["contact_force"],
                             Energy(*rows["energies"].T), step, state["exchanges"], reduction, complete=complete)


# ---------------------------------------------------------------------- parts of the file
@contextlib.contextmanager
def _opened(path: str):
    """A history file open for reading; every failure as a ValueError of one sentence."""
    if not os.path.isfile(path):
        raise ValueError(f"history file {path!r} does not exist")
    try:
        with h5py.File(path, "r") as file:
            if file.attrs.get("format") != FORMAT:
                raise ValueError(f"{path!r} is an HDF5 file of another kind, not {FORMAT}")
            if int(file.attrs["format_version"]) > FORMAT_VERSION:
                raise ValueError(f"history file {path!r} has format version {file.attrs['format_version']}, newer than this program's {FORMAT_VERSION}")
            yield file
    except (OSError, KeyError, RuntimeError, IndexError) as error:
        raise ValueError(f"history file {path!r} is truncated or no HDF5 file ({error})") from None


def _lay_out(path: str, reduction: Reduction, settings: dict, checks: np.ndarray, state_size: int) -> None:
    """The whole structure of the file, complete before it takes its name."""
    rows = 1 + settings["count"] // settings["decimation"]
    shapes = {"time": (rows,), "modal_displacement": (rows, len(reduction.omega)), "modal_velocity": (rows, len(reduction.omega)),
              "amplitudes": (rows, checks.shape[1]), "contact_force": (rows, len(reduction.initial_gap)), "energies": (rows, 5)}
    temporary = os.path.join(os.path.dirname(path), f".{os.path.basename(path)}.{os.getpid()}.part")
    try:
        with h5py.File(temporary, "w") as file:
            file.attrs["complete"] = False
            file.attrs["format"], file.attrs["format_version"] = FORMAT, FORMAT_VERSION
            file.attrs.update(settings)
            for field in fields(Reduction):
                value = getattr(reduction, field.name)
                if isinstance(value, np.ndarray):
                    file.require_group("reduction").create_dataset(field.name, data=value)
                else:
                    file.require_group("reduction").attrs.create(field.name, list(value), shape=(len(value),), dtype=h5py.string_dtype())
            file.create_dataset("signal_checks", data=checks)
            for name, shape in shapes.items():
                _reserve(file, name, shape)
                file[name].attrs["unit"], file[name].attrs["description"] = _ROWS[name]
            file.create_group("state")
            for slot in ("state/A", "state/B"):
                _reserve(file, slot, (state_size,))
            file.flush()
        os.replace(temporary, path)
    finally:
        if os.path.exists(temporary):
            os.remove(temporary)


def _reserve(file: h5py.File, name: str, shape: tuple) -> None:
    """A contiguous dataset with a place in the file, but not written: file systems with holes give no blocks to it."""
    layout = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
    layout.set_layout(h5py.h5d.CONTIGUOUS)
    layout.set_alloc_time(h5py.h5d.ALLOC_TIME_EARLY)
    layout.set_fill_time(h5py.h5d.FILL_TIME_NEVER)
    h5py.h5d.create(file.id, name.encode(), h5py.h5t.IEEE_F64LE, h5py.h5s.create_simple(shape), layout)


def _state_sizes(modes: int, rows: int, pairs: int, loads: int) -> tuple[int, ...]:
    """Lengths of counter, done, exchanges, supplied (together), work, q, v, force, active, and the ledger's last instant in five parts."""
    return 4, 3, modes, modes, rows, rows, loads + pairs, loads + pairs, 2, 1, loads


def _newest_state(file: h5py.File) -> dict:
    """The newer of the states whose checksum is right."""
    bodies = [values[1:-1] for values in (file["state/A"][()], file["state/B"][()]) if values[0] > 0 and zlib.crc32(values[1:-1].astype("<f8").tobytes()) == values[-1]]
    if not bodies:
        raise ValueError(f"history file {file.filename!r} holds no recorded instant")
    body = max(bodies, key=lambda b: b[0])
    modes, pairs, loads = len(file["reduction/omega"]), len(file["reduction/initial_gap"]), file["amplitudes"].shape[1]
    head, work, q, v, force, active, drive, moved, stored, loss, rates = np.split(body, np.cumsum(_state_sizes(modes, pairs if file.attrs["contact"] else 0, pairs, loads))[:-1])
    return {"counter": int(head[0]), "done": int(head[1]), "exchanges": int(head[2]), "supplied": float(head[3]), "work": work, "q": q, "v": v, "force": force,
            "active": active != 0.0, "last": (drive[None], moved[None], stored[None], loss, rates[None])}


def _rows(file: h5py.File, done: int) -> dict[str, np.ndarray]:
    count = 1 + done // int(file.attrs["decimation"])
    return {name: file[name][:count] for name in _ROWS}


def _read_reduction(file: h5py.File) -> Reduction:
    group = file["reduction"]
    return Reduction(**{f.name: group[f.name][()] if f.name in group else tuple(group.attrs[f.name]) for f in fields(Reduction)})


def _read_for_restart(path: str, reduction: Reduction, settings: dict, checks: np.ndarray):
    """Reduction, state and rows of a former run of the same model, loads and settings."""
    with _opened(path) as file:
        former = _read_reduction(file)
        difference = _difference(former, reduction)
        if difference:
            raise ValueError(f"history file {path!r} was written for another model ({difference}); restart with that model, or name another file")
        for name, value in settings.items():
            if not _close(file.attrs[name], value):
                raise ValueError(f"history file {path!r} was written with {name} = {file.attrs[name]}, not {value}; restart with the same value, or name another file")
        if not _close(file["signal_checks"][()], checks):
            raise ValueError(f"history file {path!r} was written for other load signals; restart with the same loads, or name another file")
        state = _newest_state(file)
        return former, state, _rows(file, state["done"])


def _in_rows(reduction: Reduction) -> Reduction:
    """The same with all arrays contiguous, row by row."""
    arrays = {f.name: getattr(reduction, f.name) for f in fields(Reduction)}
    return replace(reduction, **{name: np.ascontiguousarray(values) for name, values in arrays.items() if isinstance(values, np.ndarray)})


def _difference(one: Reduction, other: Reduction) -> str:
    """What tells two reductions apart; signs of modes and rounding by other numbers of ranks do not."""
    if one.points != other.points or one.tips != other.tips:
        return "its points or cracks differ"
    for text, a, b in (("modes", one.omega, other.omega), ("contact pairs", one.initial_gap, other.initial_gap), ("loads", one.load_modes.T, other.load_modes.T)):
        if len(a) != len(b):
            return f"{len(a)} {text}, not {len(b)}"
    if not np.allclose(one.frequencies, other.frequencies, rtol=SAME, atol=SAME * other.frequencies[-1] * 1e-3):
        worst = int(np.argmax(np.abs(one.frequencies - other.frequencies)))
        return f"frequency {worst + 1} is {one.frequencies[worst]:.7g} Hz, not {other.frequencies[worst]:.7g} Hz"
    if not _close(one.damping, other.damping):
        return "its damping differs"
    # static compliances, modes and residual together: the same whatever the signs of the modes
    for text, of in (("initial gaps", lambda r: r.initial_gap), ("contact pairs' compliance", lambda r: _compliance(r.gap_modes, r.omega) + r.gap_flexibility),
                     ("loads' compliance", lambda r: _compliance(r.load_modes.T, r.omega) + r.load_flexibility),
                     ("loads on the pairs", lambda r: _compliance(r.gap_modes, r.omega, r.load_modes.T) + r.gap_loads)):
        if not _close(of(one), of(other)):
            return f"its {text} differ"
    return ""


def _compliance(left: np.ndarray, omega: np.ndarray, right: np.ndarray | None = None) -> np.ndarray:
    elastic = omega > 1e-6 * omega[-1]
    return (left[:, elastic] / omega[elastic] ** 2) @ (left if right is None else right)[:, elastic].T


def _close(one, other) -> bool:
    if isinstance(one, str) or isinstance(other, str):
        return one == other
    one, other = np.asarray(one, dtype=float), np.asarray(other, dtype=float)
    return one.shape == other.shape and bool(np.allclose(one, other, rtol=1e-9 if one.ndim == 0 else SAME, atol=SAME * np.abs(other).max(initial=0.0) if one.ndim else 0.0))

"""A time history on disk while it is integrated: readable after Ctrl-C, kill -9 or a full disk, and the start
of a further run.

The HDF5 file is laid out once, every dataset contiguous and at its final size with nothing allocated on the
disk; the run then writes plain bytes at known places. No structure of the file changes any more, so that
there is no instant at which a killed run leaves one that HDF5 cannot read. What is valid is told by the newer
of two states, "A" and "B", written in turn after the rows they vouch for. A longer run of the same kind moves
into a new, larger file that takes the old one's name when it is whole.
"""

from __future__ import annotations

import os
import zlib
from dataclasses import dataclass

import h5py
import numpy as np

from ..analysis import transient as analysis
from ..analysis.transient import Energy, History
from ..errors import SolveError
from ..parallel import collective
from ..petsc import MPI
from ..reduction.reduced_model import Reduction
from .history_file import (
    FORMAT,
    FORMAT_VERSION,
    SLOTS,
    UNREDUCED,
    IncompleteHistory,
    RunningFile,
    check_settings,
    mapped_rows,
    new_file,
    opened,
    reserve_rows,
    reserve_states,
    signal_checks,
    warn_unless,
)
from .reduction_file import difference, in_rows, read_reduction, write_reduction

__all__ = ["HistoryFile", "IncompleteHistory", "RecordedTransient", "read_history"]

_ROWS = {
    "time": ("s", "instants"),
    "modal_displacement": ("m sqrt(kg)", "modal coordinates q"),
    "modal_velocity": ("m sqrt(kg)/s", "derivative of q"),
    "amplitudes": ("unit of the load", "values of the load signals"),
    "contact_force": ("N", "forces of the contact pairs, compression positive"),
    "energies": ("J", "kinetic, strain, external, damping, contact"),
}


@dataclass(frozen=True, eq=False, repr=False)
class RecordedTransient(History):
    """A history read from a file.

    Attributes
    ----------
    complete : bool
        Whether the run that wrote it reached its end.
    """

    complete: bool = True


class HistoryFile(RunningFile):
    """The file of a running history; rank 0 writes, an error of it is raised on every rank. A context
    manager.

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
    in_memory : bool
        False: rows are let go of once they are in the file.

    Attributes
    ----------
    in_memory : bool
    reduction : Reduction
        That of the file in a restart, so that the continued history is the same to the last bit; otherwise
        the one given. Arrays are contiguous in both cases: BLAS rounds products of others differently.

    Raises
    ------
    ValueError
        If the file is no history, of another model, load or setting, or cannot be made.
    """

    def __init__(
        self,
        comm: MPI.Comm,
        path: str,
        restart: bool,
        reduction: Reduction,
        signals,
        count: int,
        step: float,
        contact: bool,
        scheme: str,
        start,
        decimation: int,
        in_memory: bool = True,
    ):
        super().__init__(comm, path)
        self.count, self.decimation, self.in_memory, self._counter = count, decimation, in_memory, 0
        state = "modal" if not isinstance(start, str) else start
        given = [
            float(np.linalg.norm(part))
            for part in ((reduction.omega * start[0], start[1]) if state == "modal" else ())
        ]
        settings = {
            "count": count,
            "step": step,
            "contact": bool(contact),
            "scheme": scheme,
            "start": state,
            "start_norms": np.array(given),
            "decimation": decimation,
            "chunk": analysis.CHUNK,
        }
        checks = signal_checks(signals, count * step)
        sizes = _state_sizes(
            len(reduction.omega),
            len(reduction.initial_gap) if contact else 0,
            len(reduction.initial_gap),
            len(signals),
        )
        found = None
        with collective(comm):
            if comm.rank == 0:
                try:
                    if restart and os.path.lexists(self.path):
                        found, former, states = _read_for_restart(self.path, reduction, settings, signals)
                        if former < count:
                            _lay_out(self.path, found[0], settings, checks, sum(sizes) + 2, found[2], states)
                        if not in_memory:
                            found = (*found[:2], None)
                    else:
                        _lay_out(self.path, reduction, settings, checks, sum(sizes) + 2)
                    self._open((*_ROWS, *SLOTS))
                except (OSError, RuntimeError) as error:
                    raise ValueError(
                        f"history file {self.path!r} cannot be written "
                        f"({getattr(error, 'strerror', None) or error}); name another folder or change its "
                        "permissions"
                    ) from None
        self._found = comm.bcast(found)
        self.reduction = in_rows(self._found[0] if self._found else reduction)

    def begin(self, keep: dict, energies: list, q, v, force, active, ledger) -> tuple[int, int]:
        """Record the initial state, or put the file's rows and state in its place; steps done and exchanges
        of active sets.
        """
        if self._found is None:
            self.append(0, 0, keep, energies, q, v, force, active, ledger)
            return 0, 0
        _, state, rows = self._found
        self._counter = state["counter"]
        for short, long in _SHORT.items():
            keep[short][:] = [rows[long]] if self.in_memory else []
        energies[:] = [rows["energies"].T] if self.in_memory else []
        for target, name in ((q, "q"), (v, "v"), (force, "force"), (active, "active")):
            target[...] = state[name]
        ledger.work, ledger.supplied, ledger.last = state["work"], state["supplied"], state["last"]
        self._found = None
        with collective(self.comm):
            if (
                self.comm.rank == 0 and state["done"] == self.count
            ):  # killed between the last state and the mark
                self._finish()
        return state["done"], state["exchanges"]

    def append(
        self, done: int, exchanges: int, keep: dict, energies: list, q, v, force, active, ledger
    ) -> None:
        """Record the last chunk of `keep` and `energies` and the state after `done` steps; at the last one
        the file is marked complete.
        """
        rows = {**{long: keep[short][-1] for short, long in _SHORT.items()}, "energies": energies[-1].T}
        self._write(
            done,
            exchanges,
            rows,
            1 + done // self.decimation - len(rows["time"]),
            q,
            v,
            force,
            active,
            ledger,
        )
        if not self.in_memory:
            for parts in (*keep.values(), energies):
                parts.clear()

    def history(self) -> tuple[dict, np.ndarray]:
        """All rows by their short names, and the energies (5, n), as they lie in the file. Collective."""
        rows = self.recorded(_ROWS, 1 + self.count // self.decimation)
        return {short: rows[long] for short, long in _SHORT.items()}, rows["energies"].T

    def _write(self, done, exchanges, rows, first, q, v, force, active, ledger) -> None:
        with collective(self.comm):
            if self.comm.rank == 0:
                try:
                    self._check_place()
                    for name, values in rows.items():
                        self._put(name, values, first)
                    self._counter += 1
                    body = np.concatenate(
                        [
                            [self._counter, done, exchanges, ledger.supplied],
                            ledger.work,
                            q,
                            v,
                            force,
                            active,
                            *(part.ravel() for part in ledger.last),
                        ]
                    )
                    self._put(
                        "state/" + "AB"[self._counter % 2],
                        np.concatenate([[self._counter], body, [zlib.crc32(body.astype("<f8").tobytes())]]),
                    )
                    if done == self.count:
                        self._finish()
                except (OSError, RuntimeError) as error:
                    raise SolveError(
                        f"transient: history file {self.path!r} cannot be written any more "
                        f"({getattr(error, 'strerror', None) or error}); "
                        "what it holds stays readable, and restart=True continues from there"
                    ) from None


_SHORT = {
    "time": "time",
    "q": "modal_displacement",
    "v": "modal_velocity",
    "s": "amplitudes",
    "force": "contact_force",
}


def read_history(path: str):
    """Read a history, also one whose run has not ended, or was killed: a `RecordedTransient`, or a
    `RecordedFullTransient` of an unreduced model.

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
    with opened(path, None) as file:
        unreduced = file.attrs["format"] == UNREDUCED
    if unreduced:
        from .full_history import read_full_history  # stands above this module

        return read_full_history(path)
    with opened(path) as file:
        state, reduction = _newest_state(file), read_reduction(file["reduction"])
        rows = _rows(file, state["done"])
        complete, step, count = (
            bool(file.attrs["complete"]),
            float(file.attrs["step"]),
            int(file.attrs["count"]),
        )
    warn_unless(complete, path, state["done"], count, 3)
    return RecordedTransient(
        rows["time"],
        rows["modal_displacement"],
        rows["modal_velocity"],
        rows["amplitudes"],
        rows["contact_force"],
        reduction,
        Energy(*rows["energies"].T),
        step,
        state["exchanges"],
        complete=complete,
    )


# ---------------------------------------------------------------------- parts of the file
def _lay_out(
    path: str,
    reduction: Reduction,
    settings: dict,
    checks: np.ndarray,
    state_size: int,
    former: dict | None = None,
    states: dict | None = None,
) -> None:
    """The whole structure of the file, complete before it takes its name, with the rows and states of a
    shorter run if there are any.
    """
    rows = 1 + settings["count"] // settings["decimation"]
    shapes = {
        "time": (rows,),
        "modal_displacement": (rows, len(reduction.omega)),
        "modal_velocity": (rows, len(reduction.omega)),
        "amplitudes": (rows, checks.shape[1]),
        "contact_force": (rows, len(reduction.initial_gap)),
        "energies": (rows, 5),
    }
    with new_file(path) as file:
        file.attrs["format"], file.attrs["format_version"] = FORMAT, FORMAT_VERSION
        file.attrs.update(settings)
        write_reduction(file.create_group("reduction"), reduction)
        file.create_dataset("signal_checks", data=checks)
        reserve_rows(file, shapes, _ROWS, former)
        reserve_states(file, state_size, states)


def _state_sizes(modes: int, rows: int, pairs: int, loads: int) -> tuple[int, ...]:
    """Lengths of counter, done, exchanges, supplied (together), work, q, v, force, active, and the ledger's
    last instant in five parts.
    """
    return 4, 3, modes, modes, rows, rows, loads + pairs, loads + pairs, 2, 1, loads


def _newest_state(file: h5py.File) -> dict:
    """The newer of the states whose checksum is right."""
    bodies = [
        values[1:-1]
        for values in (file["state/A"][()], file["state/B"][()])
        if values[0] > 0 and zlib.crc32(values[1:-1].astype("<f8").tobytes()) == values[-1]
    ]
    if not bodies:
        raise ValueError(f"history file {file.filename!r} holds no recorded instant")
    body = max(bodies, key=lambda b: b[0])
    modes, pairs, loads = (
        len(file["reduction/omega"]),
        len(file["reduction/initial_gap"]),
        file["amplitudes"].shape[1],
    )
    head, work, q, v, force, active, drive, moved, stored, loss, rates = np.split(
        body, np.cumsum(_state_sizes(modes, pairs if file.attrs["contact"] else 0, pairs, loads))[:-1]
    )
    return {
        "counter": int(head[0]),
        "done": int(head[1]),
        "exchanges": int(head[2]),
        "supplied": float(head[3]),
        "work": work,
        "q": q,
        "v": v,
        "force": force,
        "active": active != 0.0,
        "last": (drive[None], moved[None], stored[None], loss, rates[None]),
    }


def _rows(file: h5py.File, done: int) -> dict[str, np.ndarray]:
    count = 1 + done // int(file.attrs["decimation"])
    return {name: file[name][:count] for name in _ROWS}


def _read_for_restart(path: str, reduction: Reduction, settings: dict, signals):
    """(reduction, state, rows) of a former run of the same model, loads and settings, its number of steps and
    its states as they are.
    """
    with opened(path) as file:
        former = read_reduction(file["reduction"])
        other = difference(former, reduction)
        if other:
            raise ValueError(
                f"history file {path!r} was written for another model ({other}); restart with that model, or "
                "name another file"
            )
        check_settings(file, settings, signals)
        state = _newest_state(file)
        return (
            (former, state, mapped_rows(path, _ROWS, 1 + state["done"] // settings["decimation"])),
            int(file.attrs["count"]),
            {slot: file[slot][()] for slot in SLOTS},
        )

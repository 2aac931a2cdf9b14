"""The history file of an unreduced model; every rank writes its own part of the state, nothing is gathered.

Laid out as `history`. Each of the two states holds the ranks' unknowns one after another, and a head by rank
0 that is written last, with checksums of all parts. The unknowns' order depends on the number of ranks, so
that a run continues on as many as it began with.
"""

from __future__ import annotations

import os
import zlib
from dataclasses import dataclass

import h5py
import numpy as np

from ..dynamics import unreduced_history as analysis
from ..dynamics.unreduced_history import History, assembled
from ..errors import SolveError
from ..parallel import collective
from .history_file import (
    FORMAT_VERSION,
    SLOTS,
    UNREDUCED,
    RunningFile,
    check_settings,
    close,
    mapped_rows,
    new_file,
    opened,
    reserve_rows,
    reserve_states,
    signal_checks,
    warn_unless,
)

_ROWS = {
    "time": ("s", "instants"),
    "displacement": ("m", "of the named points"),
    "velocity": ("m/s", "of the named points"),
    "acceleration": ("m/s^2", "of the named points"),
    "contact_force": ("N", "forces of the contact pairs, compression positive"),
    "gap": ("m", "gaps of the contact pairs"),
    "energies": ("J", "kinetic, strain, external, damping, contact"),
    "stress_intensity": ("Pa m^(1/2)", "K_I and K_II of the tips"),
}


@dataclass(frozen=True, eq=False, repr=False)
class RecordedFullTransient(History):
    """An unreduced model's history read from a file.

    Attributes
    ----------
    complete : bool
        Whether the run that wrote it reached its end.
    """

    complete: bool = True


class FullHistoryFile(RunningFile):
    """The file of a running history of an unreduced model; an error of one rank is raised on every one. A
    context manager.

    Parameters
    ----------
    march : FullMarch
        Its state is that at t = 0.
    path : str
    restart : bool
        Continue the file if it exists; False: replace it.
    signals : sequence of Signal
    count, contact, start, decimation, in_memory
        See `analysis.transient.transient`.

    Raises
    ------
    ValueError
        If the file is no history, of another model, load, setting or number of ranks, or cannot be made.
    """

    def __init__(
        self,
        march,
        path: str,
        restart: bool,
        signals,
        count: int,
        contact: bool,
        start,
        decimation: int,
        in_memory: bool = True,
    ):
        model = march.model
        super().__init__(model.comm, path)
        self.march, self.count, self.decimation, self.in_memory, self._counter, self._found = (
            march,
            count,
            decimation,
            in_memory,
            0,
            None,
        )
        sizes, points = np.array(self.comm.allgather(march.u.size)), (len(model.points), 2)
        self._shapes = {
            "time": (),
            "displacement": points,
            "velocity": points,
            "acceleration": points,
            "contact_force": (march.pairs,),
            "gap": (march.pairs,),
            "energies": (5,),
            "stress_intensity": (len(model.tips.names), 2),
        }
        # counter, steps done, work, active set, carried force, slope, checksums of the parts; the head's own
        # checksum
        self._head = 2 + 3 + 2 * march.pairs + march.slope.size + self.comm.size + 1
        self._first = self._head + 2 * int(sizes[: self.comm.rank].sum())
        size = self._head + 2 * int(sizes.sum())
        norms = np.sqrt(march.summed(np.array([march.u @ march.u, march.v @ march.v])))
        settings = {
            "count": count,
            "step": march.step,
            "contact": bool(contact),
            "scheme": march.scheme,
            "start": start if isinstance(start, str) else "functions",
            "start_norms": norms,
            "decimation": decimation,
            "chunk": analysis.CHUNK,
            "ranks": self.comm.size,
            "damping": model.damping,
            "damped_modes": len(march.omega),
            "rayleigh": np.array(model.rayleigh),
        }
        probe = march.fingerprint()
        states = None
        with collective(self.comm):
            if self.comm.rank == 0:
                try:
                    if restart and os.path.lexists(self.path):
                        self._found, former, states = self._read(settings, signals, probe)
                        if former < count:
                            self._lay_out(settings, signals, probe, size, self._found, states)
                    else:
                        self._lay_out(settings, signals, probe, size)
                except (OSError, RuntimeError) as error:
                    raise ValueError(
                        f"history file {self.path!r} cannot be written "
                        f"({getattr(error, 'strerror', None) or error}); name another folder or change its "
                        "permissions"
                    ) from None
        with collective(self.comm):
            try:
                self._open((*_ROWS, *SLOTS))
            except OSError as error:
                raise ValueError(
                    f"history file {self.path!r} cannot be written by rank {self.comm.rank} "
                    f"({error.strerror or error}); name a folder that all ranks share"
                ) from None
        self._continued, self._found = self.comm.bcast(
            (self._found is not None, self._found if in_memory else None)
        )

    def _lay_out(
        self,
        settings: dict,
        signals,
        probe: np.ndarray,
        size: int,
        former: dict | None = None,
        states: dict | None = None,
    ) -> None:
        model = self.march.model
        rows, points, tips = (
            1 + settings["count"] // settings["decimation"],
            tuple(model.points),
            model.tips.names,
        )
        shapes = {name: (rows, *shape) for name, shape in self._shapes.items()}
        with new_file(self.path) as file:
            file.attrs["format"], file.attrs["format_version"] = UNREDUCED, FORMAT_VERSION
            file.attrs.update(settings)
            for name, value in (("points", points), ("tips", tips)):
                file.attrs.create(name, list(value), shape=(len(value),), dtype=h5py.string_dtype())
            file.create_dataset(
                "signal_checks", data=signal_checks(signals, settings["count"] * settings["step"])
            )
            file.create_dataset("fingerprint", data=probe)
            reserve_rows(file, shapes, _ROWS, former)
            reserve_states(file, size, states)

    def _read(self, settings: dict, signals, probe: np.ndarray) -> tuple[dict, int, dict | None]:
        """Rows of a former run of the same kind, its number of steps, and its states if they have to move."""
        model = self.march.model
        with opened(self.path, UNREDUCED) as file:
            if (
                tuple(file.attrs["points"]) != tuple(model.points)
                or tuple(file.attrs["tips"]) != model.tips.names
                or not close(file["fingerprint"][()], probe)
            ):
                raise ValueError(
                    f"history file {self.path!r} was written for another model or another step; restart with "
                    "those, or name another file"
                )
            check_settings(file, settings, signals)
            done = int(_newest_head(file)[1])
            former = int(file.attrs["count"])
            return (
                mapped_rows(self.path, _ROWS, 1 + done // self.decimation),
                former,
                {slot: file[slot][()] for slot in SLOTS} if former < self.count else None,
            )

    def resume(self) -> tuple[int, list]:
        """Steps done and rows of the file that is continued, and its state put into the march; 0 and nothing
        for a new one.
        """
        if not self._continued:
            return 0, []
        march = self.march
        with collective(self.comm):
            with h5py.File(self.path, "r") as file:
                parts = {}
                for slot in SLOTS:
                    head = file[slot][: self._head]
                    part = file[slot][self._first : self._first + 2 * march.u.size]
                    if (
                        _valid(head)
                        and zlib.crc32(part.tobytes())
                        == head[self._head - 1 - self.comm.size + self.comm.rank]
                    ):
                        parts[head[0]] = head, part
        # the newest that all ranks hold
        counters = set.intersection(*(set(given) for given in self.comm.allgather(list(parts))))
        with collective(self.comm):
            if not counters:
                raise ValueError(f"history file {self.path!r} holds no whole state")
        head, body = parts[max(counters)]
        march.u[:], march.v[:] = np.split(body, 2)
        march.work, active, march.carried, slope, _ = np.split(
            head[2:], np.cumsum([3, march.pairs, march.pairs, march.slope.size])
        )
        march.active, march.slope = active != 0.0, slope.reshape(march.slope.shape)
        march.settle(fold=False)
        self._counter, done, found = int(head[0]), int(head[1]), self._found
        self._found, count = None, 1 + done // self.decimation
        with collective(self.comm):
            if self.comm.rank == 0 and done == self.count:  # killed between the last state and the mark
                self._finish()
        return done, [
            tuple(
                found[name][:count] if self.in_memory else np.zeros((0, *shape))
                for name, shape in self._shapes.items()
            )
        ]

    def append(self, done: int, rows: tuple) -> None:
        """Record a chunk's rows and the settled state after `done` steps; at the last one the file is marked
        complete.
        """
        march = self.march
        self._counter += 1
        slot, body = SLOTS[self._counter % 2], np.concatenate([march.u, march.v])
        sums = self.comm.gather(float(zlib.crc32(body.tobytes())))
        self._guarded(lambda: self._put(slot, body, self._first))
        if self.comm.rank == 0:
            head = np.concatenate(
                [[self._counter, done], march.work, march.active, march.carried, march.slope.ravel(), sums]
            )

        def vouch():
            if self.comm.rank > 0:
                return
            for name, values in zip(_ROWS, rows):
                self._put(name, values, 1 + done // self.decimation - len(values))
            self._put(slot, np.append(head, zlib.crc32(head.tobytes())))
            if done == self.count:
                self._finish()

        self._guarded(vouch)

    def history(self) -> list[tuple]:
        """All rows as they lie in the file. Collective."""
        return [tuple(self.recorded(_ROWS, 1 + self.count // self.decimation).values())]

    def _guarded(self, work) -> None:
        with collective(self.comm):
            try:
                self._check_place()
                work()
            except (OSError, RuntimeError) as error:
                raise SolveError(
                    f"transient: history file {self.path!r} cannot be written any more "
                    f"({getattr(error, 'strerror', None) or error}); "
                    "what it holds stays readable, and restart=True continues from there"
                ) from None


def read_full_history(path: str) -> RecordedFullTransient:
    """Read an unreduced model's history, also one whose run has not ended; see `history.read_history`."""
    with opened(path, UNREDUCED) as file:
        head, attrs = _newest_head(file), dict(file.attrs)
        rows = _rows(file, int(head[1]))
    complete = bool(attrs["complete"])
    warn_unless(complete, path, int(head[1]), int(attrs["count"]), 3)
    return assembled(
        rows.values(),
        tuple(attrs["points"]),
        tuple(attrs["tips"]),
        float(attrs["step"]),
        float(attrs["damping"]),
        int(attrs["damped_modes"]),
        tuple(float(value) for value in attrs["rayleigh"]),
        RecordedFullTransient,
        complete=complete,
    )


def _rows(file: h5py.File, done: int) -> dict[str, np.ndarray]:
    count = 1 + done // int(file.attrs["decimation"])
    return {name: file[name][:count] for name in _ROWS}


def _newest_head(file: h5py.File) -> np.ndarray:
    """The head of the newer state whose checksum is right."""
    pairs, points = file["gap"].shape[1], file["displacement"].shape[1]
    length = 2 + 3 + 2 * pairs + 2 * points + int(file.attrs["ranks"]) + 1
    heads = [head for head in (file[slot][:length] for slot in SLOTS) if _valid(head)]
    if not heads:
        raise ValueError(f"history file {file.filename!r} holds no recorded instant")
    return max(heads, key=lambda head: head[0])


def _valid(head: np.ndarray) -> bool:
    return bool(head[0] > 0 and zlib.crc32(head[:-1].tobytes()) == head[-1])

"""The file of a running history, reduced or not: what it takes down, and how a further run continues it."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from meshing.whole_file import reason

from ..errors import SolveError
from ..parallel import collective
from ..petsc import MPI
from ..reduction.reduced_model import ReducedModel
from ..signals.signal import Signal
from ..system.tip_facts import TipFacts
from ..writing import destination
from .hdf5 import new_hdf5, opened
from .history_layout import (
    FORM,
    SLOTS,
    VERSION,
    WHAT,
    ColumnLike,
    Contents,
    Head,
    OpenRows,
    Rows,
    block_sum,
    cannot_go_on,
    checksum,
    mapped,
    newest,
    signal_checks,
    verified,
)
from .lock import WriterLock
from .reduced_models import adopted, close, difference, in_rows, read_reduced_model, write_reduced_model


@dataclass(frozen=True)
class FormerRun:
    """What is continued: number of steps, step (s), every how many of them are kept."""

    count: int
    step: float
    decimation: int


class _Former(NamedTuple):
    """What a shorter run has recorded."""

    head: Head
    states: np.ndarray
    rows: Rows
    blocks: np.ndarray


class HistoryFile:
    """The file of a running history; an `integration.Recorder` and a context manager.

    A reduced model's state is the same on all ranks and rank 0 writes; of an unreduced one every rank writes
    its own part, and a run continues on as many ranks as it began with. An error of one rank is raised on all
    of them.

    Parameters
    ----------
    comm : Comm
    path : str
    kind : {"reduced", "unreduced"}
        Of the model.
    resume : bool
        Continue the file if it exists; False: replace it.
    in_memory : bool
        False: rows are let go of once they are in the file.

    Attributes
    ----------
    former : FormerRun or None
        The run that is continued.
    in_memory : bool

    Raises
    ------
    TypeError, ValueError
        If the file is no history of this kind, is damaged, is being written by another run or cannot be
        written.
    """

    def __init__(self, comm: MPI.Comm, path: Any, *, kind: str, resume: bool = False, in_memory: bool = True):
        self.comm, self.kind, self.in_memory = comm, kind, in_memory
        self._lock: WriterLock | None = None
        self._open: OpenRows | None = None
        self._counter = self._rows = self._blocks = 0
        self._begun = False
        self._reduced: ReducedModel | None = None
        former = None
        try:
            with collective(comm):
                self.path = destination(path, WHAT)
                if comm.rank == 0:
                    self._lock = WriterLock(self.path, WHAT)
                    if resume and os.path.exists(self.path):
                        former = self._read_former()
        except BaseException:
            self.close()
            raise
        self.former: FormerRun | None = comm.bcast(former)

    def __enter__(self) -> HistoryFile:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Give the file up to others."""
        for item, end in ((self._open, OpenRows.close), (self._lock, WriterLock.release)):
            if item is not None:
                end(item)  # type: ignore[arg-type]
        self._open = self._lock = None

    def _read_former(self) -> FormerRun:
        with opened(self.path, WHAT, {FORM: VERSION}) as file:
            contents = Contents.read(file)
        if contents.kind != self.kind:
            raise ValueError(
                f"{WHAT} {self.path!r} is that of {_ARTICLE[contents.kind]} model, not of "
                f"{_ARTICLE[self.kind]} one; name another file"
            )
        settings = contents.settings
        return FormerRun(settings["count"], settings["step"], settings["decimation"])

    # ------------------------------------------------------------------ before the first step
    def adopt(self, reduced: ReducedModel) -> ReducedModel:
        """The reduced model to integrate: of a run that is resumed the file's own, so that the history is
        the same to the last bit; else the one given, as it would come from the file. Collective.

        Raises
        ------
        ValueError
            If the file was written for another model or other loads.
        """
        stored = None
        with collective(self.comm):
            if self.comm.rank == 0 and self.former is not None:
                with opened(self.path, WHAT, {FORM: VERSION}) as file:
                    stored = read_reduced_model(file["reduced_model"])
                other = difference(stored, reduced)
                if other:
                    raise ValueError(
                        f"{WHAT} {self.path!r} was written for another model ({other}); give that "
                        "model, or name another file"
                    )
        stored = self.comm.bcast(stored)
        self._reduced = in_rows(reduced if stored is None else adopted(stored, reduced))
        return self._reduced

    def begin(
        self,
        columns: Mapping[str, tuple[tuple[int, ...], str, str]],
        settings: Mapping[str, Any],
        signals: Sequence[Signal],
        *,
        texts: Mapping[str, Sequence[str]] | None = None,
        tips: TipFacts | None = None,
        fingerprint: np.ndarray | None = None,
    ) -> None:
        """What is recorded, and under which conditions; of a run that is resumed they must be the file's.
        Collective.

        Parameters
        ----------
        columns : dict of str to (shape, unit, description)
        settings : dict
            Numbers, texts and arrays by name, "count", "step", "decimation" and "chunk" among them.
        signals : sequence of Signal
        texts : dict of str to sequence of str, optional
            Further names.
        tips : TipFacts, optional
            Of an unreduced model.
        fingerprint : array, optional
            Tells unreduced models apart.

        Raises
        ------
        ValueError
            If the file was written otherwise, or is that of a longer run.
        """
        if self.kind == "unreduced":
            settings = {**settings, "ranks": self.comm.size}
        with collective(self.comm):
            self._contents = Contents(
                self.kind,
                settings,
                {name: ColumnLike(*column) for name, column in columns.items()},
                (),
                signal_checks(signals, settings["count"] * settings["step"]),
                texts or {},
                {} if fingerprint is None else {"fingerprint": fingerprint},
                tips,
            )
            if self.comm.rank == 0 and self.former is not None:
                self._check(signals)

    def _check(self, signals: Sequence[Signal]) -> None:
        """Refuse a file of another model, other settings or signals, and one that reaches further."""
        with opened(self.path, WHAT, {FORM: VERSION}) as file:
            found = Contents.read(file)
        mine, theirs = self._contents.settings, found.settings
        for name, value in mine.items():
            if name != "count" and (name not in theirs or not close(theirs[name], value)):
                raise ValueError(
                    f"{WHAT} {self.path!r} was written with {name} = {theirs.get(name)}, not {value}; "
                    "give the same value, or name another file"
                )
        named = [None if tips is None else tips.names for tips in (found.tips, self._contents.tips)]
        texts = {name: tuple(values) for name, values in self._contents.texts.items()}
        if (
            named[0] != named[1]
            or found.texts != texts
            or not all(close(found.arrays[name], array) for name, array in self._contents.arrays.items())
        ):
            raise ValueError(
                f"{WHAT} {self.path!r} was written for another model or other loads; give those, or "
                "name another file"
            )
        end, asked = (s["count"] * s["step"] for s in (theirs, mine))
        if theirs["count"] > mine["count"]:
            raise ValueError(
                f"{WHAT} {self.path!r} is that of a run of {end:.6g} s, longer than {asked:.6g} s; read it, "
                "or name another file"
            )
        if not close(found.signal_checks, signal_checks(signals, end)):
            raise ValueError(
                f"{WHAT} {self.path!r} was written for other load signals; give the same loads, or "
                "name another file"
            )

    # ------------------------------------------------------------------ an integration.Recorder
    def resume(self) -> tuple[int, Rows, np.ndarray] | None:
        """Steps done, rows (none but in memory) and this rank's checkpoint of the former run; None for a new
        one. Collective.
        """
        if self.former is None:
            return None
        comm, found, rows = self.comm, None, {}
        with collective(comm):
            if comm.rank == 0:
                with opened(self.path, WHAT, {FORM: VERSION}) as file:
                    contents = Contents.read(file)
                    head, states, _ = newest(file, contents)
                    blocks = file["running/blocks"][: head.blocks]
                rows = verified(self.path, contents, head)
                if self.former.count < self._contents.settings["count"]:
                    self._lay_out(contents.sizes, _Former(head, states, rows, blocks))
                found = contents.sizes, head, states
        sizes, head, states = comm.bcast(found)
        self._take_up(sizes, head)
        part = 0 if self.kind == "reduced" else comm.rank
        if self.in_memory:
            shared = {}
            for name, (shape, *_) in self._contents.columns.items():
                shared[name] = np.array(rows[name]) if comm.rank == 0 else np.empty((head.rows, *shape))
                comm.Bcast(shared[name])
            rows = shared
        else:
            rows = {}
        return head.done, rows, np.split(states, np.cumsum(sizes)[:-1])[part]

    def append(self, done: int, rows: Rows, checkpoint: np.ndarray) -> None:
        """Record the rows of a chunk, then the state after it, which vouches for them. Collective."""
        comm, each = self.comm, self.kind == "unreduced"
        if not self._begun:
            sizes = tuple(comm.allgather(len(checkpoint))) if each else (len(checkpoint),)
            with collective(comm):
                if comm.rank == 0:
                    self._lay_out(sizes)
            self._take_up(sizes, Head(0, 0, 0, 0, ()))
        self._counter += 1
        slot = SLOTS[self._counter % 2]
        sums = tuple(comm.allgather(checksum(checkpoint))) if each else (checksum(checkpoint),)
        if each or comm.rank == 0:
            self._guarded(lambda out: out.put(slot, checkpoint, self._first))
        else:
            self._guarded(None)
        count = len(rows["time"])
        head = Head(self._counter, done, self._rows + count, self._blocks + 1, sums)

        def vouch(out: OpenRows) -> None:
            for name, values in rows.items():
                out.put(f"rows/{name}", values, self._rows)
            out.put("running/blocks", np.array([[head.rows, block_sum(rows, 0, count)]]), self._blocks)
            out.put(slot, head.array())
            out.put("running/recorded", np.array([head.rows]))
            if done == self._contents.settings["count"]:
                out.synchronise()

        self._guarded(vouch if comm.rank == 0 else None)
        self._rows, self._blocks = head.rows, head.blocks

    def recorded(self) -> Rows:
        """All rows as they lie in the file, read when they are used. Collective."""
        with collective(self.comm):
            try:
                return mapped(self.path, tuple(self._contents.columns), self._rows)
            except (OSError, ValueError) as error:
                raise SolveError(
                    f"transient: rank {self.comm.rank} cannot read {WHAT} {self.path!r} ({reason(error)}); "
                    "in_memory = False needs a folder that all ranks share"
                ) from None

    def _guarded(self, work: Callable[[OpenRows], None] | None) -> None:
        with collective(self.comm):
            if work is not None and self._open is not None:
                try:
                    self._open.check_place()
                    work(self._open)
                except OSError as error:
                    raise cannot_go_on(self.path, error) from None

    def _lay_out(self, sizes: tuple[int, ...], former: _Former | None = None) -> None:
        """A new file, with what a shorter run has recorded."""
        self._contents = replace(self._contents, sizes=sizes)
        with new_hdf5(self.path, WHAT, FORM, VERSION) as file:
            self._contents.lay_out(file, 0 if former is None else former.head.blocks)
            if self._reduced is not None:
                write_reduced_model(file.create_group("reduced_model"), self._reduced)
            if former is None:
                return
            head = former.head
            for name, values in former.rows.items():
                if values.size:
                    file[f"rows/{name}"][: head.rows] = values
            file["running/blocks"][: head.blocks] = former.blocks
            file[SLOTS[head.counter % 2]][...] = np.concatenate([head.array(), former.states])
            file["running/recorded"][...] = head.rows

    def _take_up(self, sizes: tuple[int, ...], head: Head) -> None:
        """Open the file for writing behind what a head vouches for."""
        self._counter, self._rows, self._blocks = head.counter, head.rows, head.blocks
        self._begun = True
        rank = self.comm.rank if self.kind == "unreduced" else 0
        self._first = len(Head(0, 0, 0, 0, (0,) * len(sizes)).array()) + sum(sizes[:rank])
        with collective(self.comm):
            if self.comm.rank == 0 or self.kind == "unreduced":
                try:
                    self._open = OpenRows(self.path, tuple(self._contents.columns))
                except OSError as error:
                    raise ValueError(
                        f"{WHAT} {self.path!r} cannot be written by rank {self.comm.rank} "
                        f"({reason(error)}); name a folder that all ranks share"
                    ) from None


_ARTICLE = {"reduced": "a reduced", "unreduced": "an unreduced"}

"""The journal of a running history, reduced or not: what it holds, and how a further run continues it."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import fields
from typing import Any

import numpy as np

from meshing.whole_file import reason

from ...errors import SolveError
from ...petsc import MPI
from ...ranks.capacity import SHARE, available_memory, in_bytes
from ...ranks.parallel import collective
from ...record.files import from_image, image
from ...record.journal import Kept, read
from ...record.record import Record
from ...reduction.comparison import close
from ...signals.signal import Signal
from ..history import History, of_instants
from ..integration import Integrator, OfOtherRanks, Steps
from ..states import Rows
from ..unreduced.ranks import Labels, alike
from .run_file import OF_MODEL, OF_START, RunFile

WHAT = "history file"
# Instants at which the signals of a resumed run are compared with the former run's.
SIGNAL_CHECKS = 4097


class HistoryFile(RunFile):
    """The file of a running history; a context manager. Rank 0 writes.

    A frame holds the rows of a chunk, the state beside the journal what the next chunk goes on from. A
    reduced model's state is the same on all ranks; of an unreduced one each has a part, and the layouts say
    which: in the head, and beside the state where a run has gone on with another number of ranks.

    Parameters
    ----------
    comm, path, resume
        See `RunFile`.
    kind : {"reduced", "unreduced"}
        Of the model.
    in_memory : bool
        False: rows are let go of once they are in the file.

    Attributes
    ----------
    former : Steps or None
        The run that is continued.
    in_memory : bool
    """

    def __init__(self, comm: MPI.Comm, path: Any, *, kind: str, resume: bool = False, in_memory: bool = True):
        self.kind, self.in_memory = kind, in_memory
        super().__init__(comm, path, "history", resume=resume)
        self._layouts: list[Labels] = []  # of all ranks, on rank 0
        self._moved: dict[str, Any] = {}  # those that are to stand beside the state
        former = None
        if (kept := self._former) is not None:
            known = {**kept.head, "count": kept.state["count"]}
            former = Steps(*(known[f.name] for f in fields(Steps)))
        self.former: Steps | None = comm.bcast(former)

    def _look(self, kept: Kept) -> None:
        if kept.head["kind"] != self.kind:
            kinds = {"reduced": "a reduced", "unreduced": "an unreduced"}
            raise self.refused(f"is that of {kinds[kept.head['kind']]} model, not of {kinds[self.kind]} one")
        if not kept.state and len(kept.ends) > 1:
            raise ValueError(
                f"{WHAT} {self.path!r} cannot be gone on with: the file beside it, "
                f"{f'{self.path}.state'!r}, is missing; put it back, or run again without resume"
            )
        if not kept.vouched:  # killed before the first one: there is nothing to go on with
            assert self._journal is not None  # it has left something
            self._journal.former = None

    # ------------------------------------------------------------------ before the first step
    def begin(self, signals: Sequence[Signal], integrator: Integrator, first: History) -> None:
        """What is recorded, and under which conditions; of a run that is resumed they must be the file's.
        Collective.

        Parameters
        ----------
        signals : sequence of Signal
        integrator : Integrator
            Which tells "count", "step", "decimation" and "chunk" among others.
        first : History
            As far as t = 0.

        Raises
        ------
        ValueError
            If the file was written otherwise, or is that of a longer run.
        """
        if self.path is None:
            return
        told = integrator.told()
        self._count = int(told.head["count"])
        self._layouts = list(filter(None, self.comm.gather(told.layout) or []))
        with collective(self.comm):
            if self._journal is None:
                return
            head = {"kept": "history", "record": "History", "kind": self.kind, **told.head}
            former = self._journal.former
            if former is not None:
                self._require_same(former, head, signals)
                if not alike(former.head["layouts"], self._layouts):
                    self._moved = {"layouts": self._layouts}
                self._journal.begin({}, former.vouched)
                return
            head["signals"] = signal_checks(signals, head["count"] * head["step"])
            if first.reduced is not None:
                head["model"] = image(first.reduced)
            self._journal.begin({**head, "first": image(first, first.reduced), "layouts": self._layouts})

    def _require_same(self, former: Kept, mine: Mapping[str, Any], signals: Sequence[Signal]) -> None:
        """Refuse a file of another model, other settings or signals, and one that reaches further."""
        theirs = former.head
        first = sorted(mine, key=lambda name: name in OF_MODEL)
        self.require_same({name: mine[name] for name in first if name not in OF_START | {"count"}})
        end, asked = former.state["count"] * theirs["step"], mine["count"] * mine["step"]
        if former.state["count"] > mine["count"]:
            raise self.refused(f"is that of a run of {end:.6g} s, longer than {asked:.6g} s", "read it")
        if not close(theirs["signals"], signal_checks(signals, theirs["count"] * theirs["step"])):
            raise self.refused("was written for other load signals", "give the same loads")
        # last, for other loads make it another one
        self.require_same({name: v for name, v in mine.items() if name in OF_START})

    # ------------------------------------------------------------------ while it runs
    def resume(self) -> tuple[int, Rows, list[Any] | OfOtherRanks] | None:
        """Steps done, rows (none but in memory) and this rank's checkpoint of the former run, of one on other
        ranks all of them; None for a new one. Collective.
        """
        if self.former is None:
            return None
        comm, found, rows = self.comm, None, {}
        with collective(comm):
            if self._journal is not None and self._journal.former is not None:
                former = self._journal.former
                rows = rows_of(former, self.in_memory) if self.in_memory else {}
                state = former.state
                layouts = (former.head | state)["layouts"]
                found = state["done"], state["parts"], [] if alike(layouts, self._layouts) else layouts
        done, parts, layouts = comm.bcast(found)
        rows = {name: comm.bcast(rows.get(name)) for name in comm.bcast(list(rows))}
        if self.kind == "reduced":
            return done, rows, parts[0]
        return done, rows, OfOtherRanks(parts, layouts) if layouts else parts[comm.rank]

    def append(self, done: int, rows: Rows, integrator: Integrator) -> None:
        """Record the rows of a chunk, then the state after it, which vouches for them. Collective."""
        if self.path is None:
            return
        state = integrator.checkpoint()
        parts = self.comm.gather(state) if self.kind == "unreduced" else [state]
        with collective(self.comm):
            if self._journal is not None and parts is not None:
                self._journal.append(rows)
                found = {"done": done, "count": self._count, "parts": parts}
                self._journal.checkpoint({**found, "exchanges": integrator.exchanges, **self._moved})

    def recorded(self) -> Rows:
        """All rows, on the disk, read when they are used. Collective."""
        with collective(self.comm):
            try:
                return rows_of(read(os.path.realpath(self.path)), in_memory=False)
            except (OSError, ValueError) as error:
                raise SolveError(
                    f"transient: rank {self.comm.rank} cannot read {WHAT} {self.path!r} ({reason(error)}); "
                    "in_memory = False needs a folder that all ranks share"
                ) from None


def rows_of(kept: Kept, in_memory: bool) -> Rows:
    """The rows that the state vouches for, one chunk behind the other: in memory, or in a file without a name
    beside the journal, from which they are read when they are used.

    Raises
    ------
    ValueError
        If they are no numbers, or there is no memory for them.
    """
    size = kept.ends[kept.vouched]
    if in_memory and size > SHARE * available_memory():
        raise ValueError(
            f"{WHAT} {kept.path!r} would take {in_bytes(size)} of memory, "
            f"{in_bytes(SHARE * available_memory())} are free; read it with in_memory = False"
        )
    rows: dict[str, np.ndarray] = {}
    count, first = 1 + kept.state["done"] // kept.head["decimation"], 0
    for frame in kept.frames(kept.vouched):
        last = first + len(frame["time"])
        for name, values in frame.items():
            whole = (count, *values.shape[1:])
            if name not in rows and (in_memory or not values.size):
                rows[name] = np.zeros(whole)
            elif name not in rows:
                with tempfile.TemporaryFile(dir=os.path.dirname(kept.path) or ".") as file:
                    rows[name] = np.memmap(file, float, "w+", shape=whole)
            if rows[name].shape != whole or not np.isfinite(values).all():
                raise ValueError(f"its {name} of rows {first + 1} to {last} are not all finite numbers")
            rows[name][first:last] = values
        first = last
    if first != count:
        raise ValueError(f"it has {first} rows, not the {count} of so many steps")
    return rows


def result_of(kept: Kept, beside: Mapping[str, Record], in_memory: bool) -> History:
    """The history of a journal, as far as it has come, with what stands beside it (`from_image`).

    Raises
    ------
    ValueError
        If its rows are not those of its model.
    """
    head, state = kept.head, kept.state
    if "count" not in state:
        raise ValueError(
            f"{WHAT} {kept.path!r} holds no recorded instant: its run has not come to one, or "
            f"the file beside it, {f'{kept.path}.state'!r}, is missing; both belong together"
        )
    first: History = from_image(head["first"], beside)
    rows = rows_of(kept, in_memory)
    mine, found = ({name: v.shape[1:] for name, v in part.items()} for part in (first.instants(), rows))
    if found != mine:
        raise ValueError(f"its rows are {found}, which is not what the model has")
    complete = state["done"] == state["count"]
    return of_instants(first, rows, exchanges=state["exchanges"], complete=complete)


def signal_checks(signals: Sequence[Signal], duration: float) -> np.ndarray:
    """(SIGNAL_CHECKS, loads): values that tell load signals apart."""
    times = np.linspace(0.0, duration, SIGNAL_CHECKS)
    return np.stack([s(times) for s in signals], axis=-1) if signals else np.zeros((SIGNAL_CHECKS, 0))

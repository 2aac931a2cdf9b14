"""Integration of a motion in chunks of steps, kept in memory or by a recorder."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import numpy as np

from ..errors import SolveError, on_all_ranks
from ..petsc import MPI
from ..signals.signal import Signal
from ..system.fields.tip_facts import TipFacts
from .history import History

Rows = dict[str, np.ndarray]


class Column(NamedTuple):
    """What a row holds under a name."""

    shape: tuple[int, ...]
    unit: str
    description: str


@dataclass(frozen=True)
class Steps:
    """Equal steps of a history.

    Attributes
    ----------
    count : int
    step : float
        s.
    contact : bool
    scheme : str
    decimation : int
        Every so many steps are kept.
    """

    count: int
    step: float
    contact: bool
    scheme: str
    decimation: int

    @property
    def settings(self) -> dict[str, Any]:
        """What a file must have been written with to be continued."""
        return {
            "count": self.count,
            "step": self.step,
            "contact": self.contact,
            "scheme": self.scheme,
            "decimation": self.decimation,
        }

    @property
    def kept(self) -> int:
        """Instants that are kept, the first one included."""
        return 1 + self.count // self.decimation


@dataclass(frozen=True)
class FormerRun:
    """What is continued: number of steps, step (s), every how many of them are kept."""

    count: int
    step: float
    decimation: int


class UnreducedFacts(NamedTuple):
    """What the file of an unreduced model's history tells of the model: names of points, the tips, what is
    supported, what tells models apart, and what tells this rank's unknowns apart.
    """

    points: tuple[str, ...]
    tips: TipFacts
    supports: tuple[str, ...]
    fingerprint: np.ndarray
    layout: Mapping[str, np.ndarray]


class OfOtherRanks(NamedTuple):
    """Checkpoints of all ranks of a former run whose states stood otherwise, and their layouts."""

    parts: list[np.ndarray]
    layouts: Sequence[Mapping[str, np.ndarray]]


class Integrator(Protocol):
    """A system that can be advanced: reduced or not."""

    comm: MPI.Comm
    chunk: int
    columns: dict[str, Column]

    def begin(self, record: Recorder, signals: Sequence[Signal]) -> None:
        """Tell a recorder what the history will hold. Collective."""

    def first(self) -> Rows:
        """The row of t = 0, each array of length 1."""

    def advance(self, done: int, steps: int, decimation: int) -> Rows:
        """Take some steps after `done` ones; the rows of those that are kept. They may be views of memory
        that the next steps are written to.
        """

    def checkpoint(self) -> np.ndarray:
        """All that the further steps depend on, a flat array of constant length: this rank's part of it."""

    def restore(self, checkpoint: Any) -> None:
        """Go on from what `checkpoint` has given, an unreduced model from `OfOtherRanks` too. Collective."""

    def history(self, rows: Rows) -> History:
        """The motion of all rows."""


class Recorder(Protocol):
    """Keeps rows and checkpoints while a motion is integrated."""

    in_memory: bool

    def begin(
        self,
        columns: Mapping[str, Column],
        settings: Mapping[str, Any],
        signals: Sequence[Signal],
        unreduced: UnreducedFacts | None = None,
    ) -> None:
        """What is recorded, and under which conditions. Collective."""

    def resume(self) -> tuple[int, Rows, np.ndarray | OfOtherRanks] | None:
        """Steps done, rows (none but in memory) and this rank's checkpoint of a former run; None for a new
        one. Collective.
        """

    def append(self, done: int, rows: Rows, checkpoint: np.ndarray) -> None:
        """Keep the rows of a chunk and the state after it. Collective."""

    def recorded(self) -> Rows:
        """All rows. Collective."""


def integrate(
    integrator: Integrator,
    steps: Steps,
    recorder: Recorder | None = None,
    progress: Callable[[float], None] | None = None,
) -> History:
    """Advance a system over all steps."""
    done, former = 0, recorder.resume() if recorder is not None else None
    if former is not None:
        done, rows, checkpoint = former
        integrator.restore(checkpoint)
    else:
        rows = integrator.first()
        if recorder is not None:
            recorder.append(0, rows, integrator.checkpoint())
    kept: Rows | None = None
    if recorder is None or recorder.in_memory:  # made at once, so that nothing is held twice
        kept = {name: np.empty((steps.kept, *column.shape)) for name, column in integrator.columns.items()}
    filled = _fill(kept, rows, 0)
    while done < steps.count:
        size = min(integrator.chunk, steps.count - done)
        rows = integrator.advance(done, size, steps.decimation)
        _require_finite(rows)
        done += size
        filled = _fill(kept, rows, filled)
        if recorder is not None:
            recorder.append(done, rows, integrator.checkpoint())
        if progress is not None:
            progress(done / steps.count)
    if kept is None:
        assert recorder is not None
        kept = recorder.recorded()
    return integrator.history(kept)


def _require_finite(rows: Rows) -> None:
    """Raise SolveError where a motion has left the range of numbers."""
    for name, values in rows.items():
        # their sum of squares is quicker to tell, but may overflow
        if not (np.isfinite(np.vdot(values, values)) or np.isfinite(values).all()):
            first = int(np.argwhere(~np.isfinite(values))[0][0])
            raise on_all_ranks(
                SolveError(
                    f"transient: the {name.replace('_', ' ')} leaves the range of numbers at t = "
                    f"{rows['time'][first]:.6g} s; are the loads of usual size, in N and Pa?"
                )
            )


def _fill(kept: Rows | None, rows: Rows, first: int) -> int:
    """Put rows in their place; the number of rows so far."""
    if kept is None:
        return 0
    last = first + len(rows["time"])
    for name, values in rows.items():
        kept[name][first:last] = values
    return last


def row_size(columns: dict[str, Column]) -> int:
    """Bytes of a row."""
    return 8 * sum(math.prod(column.shape) for column in columns.values())

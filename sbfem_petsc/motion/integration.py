"""Integration of a motion in chunks of steps, kept in memory or by a recorder."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import numpy as np

from ..errors import failed_solve
from ..petsc import MPI
from .history import History
from .states import Rows


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
    def kept(self) -> int:
        """Instants that are kept, the first one included."""
        return 1 + self.count // self.decimation


class Told(NamedTuple):
    """What the file of a history tells of its run: numbers, texts, arrays and records by name, of an
    unreduced model also what tells models apart, and beside it what tells this rank's unknowns apart.
    """

    head: dict[str, Any]
    layout: Mapping[str, np.ndarray] = {}


class OfOtherRanks(NamedTuple):
    """Checkpoints of all ranks of a former run whose states stood otherwise, and their layouts."""

    parts: list[list[Any]]
    layouts: Sequence[Mapping[str, np.ndarray]]


class Integrator(Protocol):
    """A system that can be advanced: reduced or not; `exchanges` are those of active sets so far."""

    comm: MPI.Comm
    steps: Steps
    chunk: int
    exchanges: int

    def told(self) -> Told:
        """What a file tells of the run. Collective."""

    def first(self) -> History:
        """The motion as far as t = 0."""

    def advance(self, done: int, steps: int, decimation: int) -> Rows:
        """Take some steps after `done` ones; the rows of those that are kept. They may be views of memory
        that the next steps are written to.
        """

    def checkpoint(self) -> list[Any]:
        """All that the further steps depend on, numbers and arrays: this rank's part of it."""

    def restore(self, checkpoint: Any) -> None:
        """Go on from what `checkpoint` has given, an unreduced model from `OfOtherRanks` too. Collective."""


def chunks(
    integrator: Integrator, first: Rows, report: Callable[[float], None], done: int = 0
) -> Iterator[tuple[int, Rows]]:
    """Steps taken so far and the first rows, then those after each chunk of the steps that are left, and the
    rows of it that are kept.
    """
    steps = integrator.steps
    yield done, first
    while done < steps.count:
        size = min(integrator.chunk, steps.count - done)
        rows = integrator.advance(done, size, steps.decimation)
        _require_finite(rows)
        done += size
        yield done, rows
        report(done / steps.count)


def _require_finite(rows: Rows) -> None:
    """Raise SolveError where a motion has left the range of numbers."""
    for name, values in rows.items():
        # their sum of squares is quicker to tell, but may overflow
        if not (np.isfinite(np.vdot(values, values)) or np.isfinite(values).all()):
            first = int(np.argwhere(~np.isfinite(values))[0][0])
            raise failed_solve(
                f"transient: the {name.replace('_', ' ')} leaves the range of numbers at t = "
                f"{rows['time'][first]:.6g} s; are the loads of usual size, in N and Pa?"
            )

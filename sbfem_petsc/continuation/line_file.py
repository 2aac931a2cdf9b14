"""The journal of lines that are followed by continuation: their points beside the result made of them."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any, TypeVar

import numpy as np

from ..motion.files import run_file
from ..motion.files.run_file import RunFile
from ..petsc import MPI
from ..ranks.parallel import collective, on_root
from ..record.files import image
from ..record.journal import Frame
from ..record.record import Record
from ..reduction.reduced_model import ReducedModel
from .follow import Line
from .problem import Point, Problem

System = TypeVar("System", ReducedModel, None)
# What is kept of each point, in one array behind the other.
_PARTS = ("unknowns", "memory")


class LineFile(RunFile):
    """The file of a result under way, whose lines a later run can go on with; a context manager.

    A frame holds points of a line, and from which one on they take the place of former ones; the state beside
    the journal is the result that was made of them, at most two seconds ago.

    Parameters
    ----------
    comm, path, resume
        See `RunFile`.
    """

    def __init__(self, comm: MPI.Comm, path: Any, *, resume: bool = False):
        super().__init__(comm, path, "result", resume=resume)
        self._head, self._lines = dict[str, Any](), list[Frame]()
        self._told: list[tuple[list[Point], tuple]] = []
        self._begun, self._written = False, -np.inf

    def begin(
        self, reduced: System, conditions: Mapping[str, Any], start: np.ndarray
    ) -> tuple[System, np.ndarray]:
        """Note what is followed, and read the lines of a former run under the same conditions. Collective.

        Parameters
        ----------
        reduced : ReducedModel or None
            None: the conditions tell all there is to tell of the system.
        conditions : dict
            Texts, numbers and arrays by their names, the same for a run that is gone on with.
        start : (n,) array
            What the lines begin with, to rounding the same.

        Returns
        -------
        ReducedModel or None, (n,) array
            To go on with: the file's own model, whose modes its states are in, and start.

        Raises
        ------
        ValueError
            If the file was written for another model or under other conditions.
        """
        known: Any = None if reduced is None else self.adopt(reduced)
        found = self.comm.bcast(on_root(self.comm, lambda: self._read(conditions)))
        begin = np.array(start, dtype=float)
        if found is not None:
            begin, self._lines = found
        if self.comm.rank == 0:
            self._head = {"kept": self.kept, **conditions, "begins": begin}
            if known is not None:
                self._head["model"] = image(known)
        return known, begin

    def _read(self, conditions: Mapping[str, Any]) -> tuple[np.ndarray, list[Frame]] | None:
        if self._former is None:
            return None
        self.require_same(conditions)
        lines: list[Frame] = []
        for frame in self._former.frames():
            number, first = frame["line"], frame["first"]
            former = lines[number] if number < len(lines) else {"points": []}
            own = zip(*(np.split(frame[n], np.cumsum(frame[f"{n} sizes"])[:-1]) for n in _PARTS))
            points = [(u, value, m) for (u, m), value in zip(own, frame["value"].tolist())]
            lines[number : number + 1] = [{**frame, "points": former["points"][:first] + points}]
        return self._former.head["begins"], lines

    def lines(self, problem: Problem) -> list[Line]:
        """The lines of the run that is gone on with, as solutions of a problem."""
        found = [
            Line(
                [problem.recalled(*point) for point in line["points"]],
                line["length"],
                line["sign"],
                line["reason"],
                line["complete"],
            )
            for line in self._lines
        ]
        self._told = [(list(line.points), _facts(line)) for line in found]
        return found

    def update(self, result: Callable[[], Record], lines: Sequence[Line], last: bool = False) -> None:
        """Keep what is new of the lines, and at most every two seconds but for the last time the result made
        of them. Collective.
        """
        due = self.comm.bcast(last or time.monotonic() - self._written > run_file.PAUSE)
        found = result() if due else None
        with collective(self.comm):
            if self._journal is not None:
                if not self._begun:
                    former = self._former
                    self._journal.begin(self._head, 0 if former is None else len(former.ends) - 1)
                    self._begun = True
                for number, line in enumerate(lines):
                    self._keep(number, line)
                if found is not None:
                    self._journal.checkpoint({"result": image(found)})
                    self._written = time.monotonic()

    def _keep(self, number: int, line: Line) -> None:
        """A frame of what is new of a line."""
        told, facts = self._told[number] if number < len(self._told) else ([], None)
        same = [one is other for one, other in zip(told, line.points)]
        first = same.index(False) if False in same else len(same)
        new = line.points[first:]
        if not new and len(told) == len(line.points) and facts == _facts(line):
            return
        frame: Frame = {"line": number, "first": first, "value": np.array([point.value for point in new])}
        frame |= dict(zip(("length", "sign", "reason", "complete"), _facts(line)))
        memories = [point.problem.memory(point) for point in new]
        for name, parts in zip(_PARTS, ([point.u for point in new], memories)):
            frame[name] = np.concatenate([*parts, np.zeros(0)])
            frame[f"{name} sizes"] = np.array([len(part) for part in parts], dtype=int)
        assert self._journal is not None  # the caller has asked
        self._journal.append(frame)
        self._told[number : number + 1] = [(list(line.points), _facts(line))]


def _facts(line: Line) -> tuple[float, float | None, str, bool]:
    return line.length, line.sign, line.reason, line.complete

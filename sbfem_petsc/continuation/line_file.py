"""The journal of lines that are followed by continuation: their points beside the result made of them."""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any, TypeVar

import numpy as np

from meshing.warnings import BranchWarning, caller_level

from ..motion.excitation import Excitation
from ..motion.files import run_file
from ..motion.files.run_file import RunFile
from ..motion.period_map import Period
from ..motion.unreduced.ranks import Labels, alike, layout_of, moved_whole
from ..petsc import MPI
from ..progress import Progress, progress_bar, silent
from ..ranks.parallel import collective, on_root
from ..record.files import image
from ..record.journal import Frame
from ..record.record import Record
from ..reduction.comparison import in_rows
from ..reduction.reduced_model import ReducedModel
from ..system.solve.pencil import Pencil
from .follow import Follower, Line, Settings, ran_out
from .problem import Point, Problem, Range

System = TypeVar("System", ReducedModel, None)
# What is kept of each line beside its points.
FACTS = ("length", "sign", "reason", "complete")


class LineFile(RunFile):
    """The file of a result under way, whose lines a later run can go on with; a context manager.

    A frame holds points of a line, and from which one on they take the place of former ones; the state beside
    the journal is the result that was made of them, at most two seconds ago. Whose the unknowns of an
    unreduced model are stands in the head, and in the first frame of a run on another number of ranks.

    Parameters
    ----------
    comm, path, kept, resume
        See `RunFile`.
    task, progress
        See `progress_bar`: `report` is told the fraction done by those who follow the lines.
    """

    def __init__(
        self,
        comm: MPI.Comm,
        path: Any,
        kept: str = "result",
        *,
        resume: bool = False,
        task: str = "",
        progress: Progress = None,
    ):
        super().__init__(comm, path, kept, resume=resume)
        self.report: Callable[[float], None] = silent
        self._bar = progress_bar(comm, task, progress)
        self._head, self._lines = dict[str, Any](), list[Frame]()
        self._recorded: list[tuple[list[Point], dict[str, Any]]] = []
        self._begun, self._written = False, -np.inf
        self._model: ReducedModel | None = None  # that of the head, on rank 0
        self._moved: dict[str, Any] = {}  # layouts that are to stand in the next frame; on rank 0

    def __enter__(self) -> LineFile:
        self.report = self._bar.__enter__()
        return self

    def __exit__(self, *error: Any) -> None:
        self._bar.__exit__(*error)
        super().__exit__(*error)

    def begin(
        self,
        reduced: System,
        conditions: Mapping[str, Any],
        start: np.ndarray,
        pencil: Pencil | None = None,
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
        pencil : Pencil, optional
            Of an unreduced model, whose unknowns the ranks share: a run of another number of them is gone on
            with to 1e-6, of as many bit by bit.

        Returns
        -------
        ReducedModel or None, (n,) array
            To go on with: the file's own model, whose modes its states are in, and start.

        Raises
        ------
        ValueError
            If the file was written for another model or under other conditions.
        """
        if self.path is None:
            return reduced, start
        known: Any = None if reduced is None else self.adopt(reduced)
        found = self.comm.bcast(on_root(self.comm, lambda: self._read(conditions)))
        begin = np.array(start, dtype=float)
        layouts: list[Labels] = []
        if pencil is not None:
            layouts = self.comm.gather(layout_of(pencil)) or []
        if found is not None:
            begin, self._lines, runs = found
            if pencil is not None and self._put_in_order(pencil, runs, layouts):
                self._moved = {"layouts": layouts}
        if self.comm.rank == 0:
            self._head = {"kept": self.kept, **conditions, "begins": begin, "layouts": layouts}
            if known is not None:
                self._keep_model(known)
        return known, begin

    def _keep_model(self, reduced: ReducedModel) -> None:
        """Put the model into the head, to which results refer."""
        self._model, self._head["model"] = reduced, image(reduced)

    def begin_period(
        self, period: Period, conditions: Mapping[str, Any], start: np.ndarray, any_steps: bool = False
    ) -> tuple[Period, np.ndarray]:
        """As `begin`, of motions of a map, whose loads and steps are conditions as well; `any_steps` goes on
        in the steps of the former run, whatever they are. Collective.
        """
        if self.path is None:
            return period, start
        steps = period.steps
        if any_steps:
            former = self._former
            found = on_root(self.comm, lambda: steps if former is None else former.head["steps"])
            steps = self.comm.bcast(found)
        recorded = {**conditions, "steps": steps, **conditions_of(period.excitation)}
        reduced, start = self.begin(period.reduced, {**recorded, "contact": period.pairs > 0}, start)
        return Period(reduced, period.excitation, steps, period.pairs > 0), start

    def anew(self, owner: str, period: Period) -> Period:
        """Begin again, in other steps or modes, of which an owner's caller is warned where points of a former
        run are lost. The map to go on with, as it would come from the file.
        """
        if self.path is None:
            return period
        if (modes := self.modes()) is not None:
            warnings.warn(
                f"{owner}: the points in {self.path!r}, in {modes} modes, are not accurate enough or lead to "
                f"no further one; the curve is followed anew in {period.reduced.in_words} and "
                f"{period.steps} steps a period",
                BranchWarning,
                stacklevel=caller_level(),
            )
        period = Period(in_rows(period.reduced), period.excitation, period.steps, period.pairs > 0)
        if self.comm.rank == 0:
            self._head["steps"] = period.steps
            self._keep_model(period.reduced)
        self._begun, self._written = False, -np.inf
        self._lines, self._recorded, self._moved = [], [], {}
        if self._journal is not None:
            self._journal.former = None
        return period

    def _read(
        self, conditions: Mapping[str, Any]
    ) -> tuple[np.ndarray, list[Frame], list[list[Labels]]] | None:
        """What the lines began with, the lines, and the layouts of the ranks of each run."""
        if self._former is None:
            return None
        self.require_same(conditions)
        lines, runs = list[Frame](), [self._former.head["layouts"]]
        for frame in self._former.frames():
            if "layouts" in frame:
                runs.append(frame["layouts"])
            number, first = frame["line"], frame["first"]
            former = lines[number]["points"][:first] if number < len(lines) else []
            points = [(*point, len(runs) - 1) for point in frame["points"]]
            lines[number : number + 1] = [{**frame, "points": former + points}]
        return self._former.head["begins"], lines, runs

    def _put_in_order(self, pencil: Pencil, runs: list[list[Labels]], own: list[Labels]) -> bool:
        """Put the points of runs on other ranks in the order of these, whose layouts rank 0 has; whether the
        last one is such a run. Collective.
        """
        others = self.comm.bcast([not alike(run, own) for run in runs])
        for line in self._lines:
            points = line["points"]
            for run in np.flatnonzero(others):
                of_run = [k for k, point in enumerate(points) if point[-1] == run]
                if not of_run:
                    continue
                u = np.array([points[k][0] for k in of_run])
                states = moved_whole(pencil, runs[run], u[:, :-1])
                for k, state in zip(of_run, states):
                    points[k] = np.append(state, points[k][0][-1]), *points[k][1:]
        return others[-1]

    def lines(self, problem: Problem) -> list[Line]:
        """The lines of the run that is gone on with, as solutions of a problem."""
        found = [
            Line(
                [
                    replace(problem.recalled(problem.own(u), value, kept), residuals=tuple(residuals))
                    for u, value, residuals, kept, _ in line["points"]
                ],
                **{name: line[name] for name in FACTS},
            )
            for line in self._lines
        ]
        self._recorded = [(list(line.points), _facts(line)) for line in found]
        return found

    def line(self, problem: Problem) -> Line | None:
        """The first of them; None of a new run."""
        return next(iter(self.lines(problem)), None)

    def follow(
        self,
        lines: Sequence[Line],
        within: Range,
        settings: Settings,
        result: Callable[[], Record],
        share: Callable[[float], float],
        tell: Callable[[Point], str | None] = lambda point: None,
    ) -> bool:
        """Follow the last of some lines, unless a former run has come to its end; whether it was. Collective.

        Parameters
        ----------
        lines : sequence of Line
        within : Range
        settings : Settings
        result : callable
            Makes the result of the lines as they are.
        share : callable
            How much of the run is behind at a value.
        tell : callable, optional
            Notes what is kept of a point, and says why the line ends before it, if it does.
        """
        line = lines[-1]
        for point in line.points:
            tell(point)
            if point not in line.points[-2:]:
                point.state.forget()
        if line.reason and not ran_out(line.reason):
            return False
        for point in Follower(line, within, settings):
            if why := tell(line.points[-1]):
                line.points.pop()
                line.reason = why
                break
            self.update(result, lines)
            self.report(min(1.0, share(point.value)))
        return True

    def update(self, result: Callable[[], Record], lines: Sequence[Line], last: bool = False) -> None:
        """Keep what is new of the lines, and at most every two seconds but for the last time the result made
        of them. Collective.
        """
        if self.path is None:
            return
        due = self.comm.bcast(last or time.monotonic() - self._written > run_file.PAUSE)
        found, news = (
            result() if due else None,
            [self._new(number, line) for number, line in enumerate(lines)],
        )
        with collective(self.comm):
            if self._journal is not None:
                if not self._begun:
                    former = self._former
                    self._journal.begin(self._head, 0 if former is None else len(former.ends) - 1)
                    self._begun = True
                for frame in filter(None, news):
                    self._journal.append({**frame, **self._moved})
                    self._moved = {}
                if found is not None:
                    self._journal.checkpoint({"result": image(found, self._model)})
                    self._written = time.monotonic()

    def _new(self, number: int, line: Line) -> Frame | None:
        """A frame of what is new of a line; None if nothing is. Collective."""
        recorded, facts = self._recorded[number] if number < len(self._recorded) else ([], None)
        same = [one is other for one, other in zip(recorded, line.points)]
        first = same.index(False) if False in same else len(same)
        new = line.points[first:]
        if not new and len(recorded) == len(line.points) and facts == _facts(line):
            return None
        points = [(p.problem.whole(p.u), p.value, p.residuals, p.problem.memory(p)) for p in new]
        self._recorded[number : number + 1] = [(list(line.points), _facts(line))]
        return {"line": number, "first": first, "points": points, **_facts(line)}


def conditions_of(excitation: Excitation) -> dict[str, Any]:
    """What a run must have been begun with to be gone on with, of its loads."""
    return {
        "periods": excitation.periods,
        "frequencies": excitation.orders,
        "loads": excitation.amplitudes,
    }


def _facts(line: Line) -> dict[str, Any]:
    return {name: getattr(line, name) for name in FACTS}

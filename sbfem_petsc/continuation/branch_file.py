"""The journal of a branch under way: its points as they are found, and the branch so far beside them."""

from __future__ import annotations

import itertools
import math
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from ..motion.files import run_file
from ..motion.files.run_file import RunFile
from ..motion.period_map import Period
from ..motion.unreduced.period import UnreducedPeriod
from ..motion.unreduced.ranks import Labels, kept_layouts, layout_of, layouts_in, moved_whole
from ..petsc import MPI
from ..ranks.parallel import collective
from ..record.files import image
from ..record.journal import Kept
from ..reduction.reduced_model import ReducedModel
from ..system.solve.pencil import Pencil
from .branch import Branch
from .follow import Line
from .problem import Point
from .problems.driven_orbits import ParameterRange

# Marks a run whose branch has come to its end, which is not followed again.
FINISHED = "finished"


class BranchFile(RunFile):
    """The file of a branch under way; a `branch_following.BranchRecorder` and a context manager. Rank 0
    writes.

    A frame holds points, and from which one on they take the place of former ones; the state beside the
    journal is the branch that was made of them, at most two seconds ago. Whose the unknowns of an unreduced
    model are stands in the head, and in the first frame of a run on another number of ranks.

    Parameters
    ----------
    comm, path, resume
        See `RunFile`.

    Attributes
    ----------
    former : (states (n, k), values (n,), float, str, bool) or None
        See `branch_following.BranchRecorder`.
    """

    def __init__(self, comm: MPI.Comm, path: Any, *, resume: bool = False):
        super().__init__(comm, path, "branch", resume=resume)
        self.former: tuple[np.ndarray, np.ndarray, float, str, bool] | None = None
        self._head: dict[str, Any] = {}
        self._layouts: dict[str, np.ndarray] = {}  # those that are to stand in the next frame; on rank 0
        self._elsewhere = False  # whether the newest points are of another number of ranks
        self._told: list[Point] = []
        self._finished, self._begun, self._written = False, -1, -np.inf

    def begin(
        self, period: Period, over: ParameterRange, largest_step: float = math.inf, any_steps: bool = False
    ) -> tuple[ReducedModel, int]:
        """Note what is followed, and read the points of a former run under the same conditions. Collective.

        Parameters
        ----------
        period : Period
        over : ParameterRange
        largest_step : float
        any_steps : bool
            Go on in the steps of the former run, whatever they are.

        Returns
        -------
        ReducedModel, int
            The one to go on with: the file's own, whose modes its states are in; and the steps.

        Raises
        ------
        ValueError
            If the file was written for another model, load, range or largest step.
        """
        reduced = self.adopt(period.reduced)
        conditions = {**_conditions(period, over, largest_step), "contact": period.pairs > 0}
        steps = self._begin(conditions, any_steps)
        if self.comm.rank == 0:
            self._head["model"] = image(reduced)
        return reduced, steps or period.steps

    def begin_unreduced(
        self, period: UnreducedPeriod, over: ParameterRange, largest_step: float = math.inf
    ) -> None:
        """The same of motions of an unreduced model: on as many ranks bit by bit, on others to 1e-6.
        Collective.
        """
        march, own = period.march(over.frequency or over.start), _conditions(period, over, largest_step)
        own |= {"contact": period.contact, "fingerprint": march.fingerprint()}
        layouts = kept_layouts(self.comm, layout_of(period.pencil))
        self._begin(own, pencil=period.pencil)
        if self.comm.rank == 0:
            self._head |= layouts
            if self._elsewhere:
                self._layouts = layouts

    def _begin(
        self, conditions: dict[str, Any], any_steps: bool = False, pencil: Pencil | None = None
    ) -> int:
        """Compare with a former run, and take up its points; its steps, 0 if there is none."""
        self._head, found = {"kept": self.kept, **conditions}, None
        with collective(self.comm):
            if self._former is not None:
                given = {name: v for name, v in conditions.items() if not (any_steps and name == "steps")}
                self.require_same(given)
                state = self._former.state
                finished = bool(state) and state["reason"] == FINISHED
                found = *_points(self._former), finished, self._former.head["steps"]
        found = self.comm.bcast(found)
        if found is None:
            return 0
        pieces, end, self._finished, self._begun = found
        points = []
        for layouts, rows in pieces:
            self._elsewhere = len(layouts) != self.comm.size
            if pencil is not None and self._elsewhere:
                rows = np.column_stack([moved_whole(pencil, layouts, rows[:, :-1]), rows[:, -1]])
            points.append(rows)
        if points:
            whole = np.concatenate(points)
            self.former = whole[:, :-1], whole[:, -1], *end
        return self._begun

    def update(self, branch: Callable[[], Branch], line: Line, last: bool = False) -> None:
        """Keep the points of a line that are new, and at most every two seconds but for the last time the
        branch made of them; a finished one stays as it is. Collective.
        """
        if self._finished:
            return
        problem: Any = line.problem  # of driven orbits
        self._go_on(line, problem.period.steps)
        first = next(
            (k for k, (one, other) in enumerate(zip(self._told, line.points)) if one is not other),
            min(len(self._told), len(line.points)),
        )
        new = np.array([problem.whole(point.u) for point in line.points[first:]])
        due = self.comm.bcast(last or time.monotonic() - self._written > run_file.PAUSE)
        found = branch() if due else None
        with collective(self.comm):
            if self._journal is not None:
                facts = {"first": first, "length": line.length, "reason": line.reason}
                facts["complete"] = line.complete
                self._journal.append({**facts, **self._layouts, "unknowns": new})
                self._layouts = {}
                if found is not None:
                    asked = found.map is None or found.multipliers.shape[1] > 0
                    ended = last and found.complete and asked
                    reason = FINISHED if ended else line.reason
                    self._journal.checkpoint({"reason": reason, "result": image(found)})
                    self._written = time.monotonic()
        self._told = list(line.points)

    def _go_on(self, line: Line, steps: int) -> None:
        """Begin the journal, or go on behind what was read, before the first update."""
        if steps != self._begun or self.former is None and not self._told:
            self._anew(steps)
        elif not self._told:  # what was read is kept already
            self._told = line.points[: len(self.former[1])] if self.former is not None else []
            with collective(self.comm):
                if self._journal is not None and self._journal.former is not None:
                    self._journal.begin({}, len(self._journal.former.ends) - 1)

    def _anew(self, steps: int) -> None:
        """Begin the journal, again where the steps have changed."""
        self._begun, self._told, self._layouts = steps, [], {}
        with collective(self.comm):
            if self._journal is not None:
                self._journal.former = None
                self._journal.begin({**self._head, "steps": steps})
        self._written = -np.inf


def _conditions(
    period: Period | UnreducedPeriod, over: ParameterRange, largest_step: float
) -> dict[str, Any]:
    """What a run must have been begun with to be gone on with."""
    return {
        "parameter": over.name,
        "start": over.start,
        "stop": over.stop,
        "largest_step": largest_step if math.isfinite(largest_step) else "none",
        "steps": period.steps,
        "periods": period.excitation.periods,
        "fixed_frequency": over.frequency or 0.0,
        "loads": period.excitation.amplitudes,
    }


def _points(kept: Kept) -> tuple[list[tuple[list[Labels], np.ndarray]], tuple[float, str, bool]]:
    """All points, state and value in a row, of each run whose ranks differ from those of the one before, with
    the ranks' layouts; the length of the next step, why the line ended, and whether it is complete.
    """
    layouts, points, end = layouts_in(kept.head), list[tuple[list[Labels], np.ndarray]](), (0.0, "", False)
    for frame in kept.frames():
        layouts = layouts_in(frame) or layouts
        points[frame["first"] :] = [(layouts, row) for row in frame["unknowns"]]
        end = float(frame["length"]), str(frame["reason"]), bool(frame["complete"])
    runs = [list(run) for _, run in itertools.groupby(points, lambda point: id(point[0]))]
    return [(run[0][0], np.array([row for _, row in run])) for run in runs], end

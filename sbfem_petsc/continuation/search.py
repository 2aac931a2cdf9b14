"""Search for a steady state where Newton's method does not converge from the first guess.

A stable steady state is what a history settles on, so a history is followed until Newton's method takes over
from it; one period costs a small part of a Newton iteration. Steady states that no history reaches, or that
take too long, are looked for along branches: from a small load, from larger damping, from neighbouring
frequencies. The message of a search in vain says what was tried and how far it came.
"""

from __future__ import annotations

import functools
import math
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..errors import SolveError, failed_solve
from ..motion.period_map import DrivenPeriod, FixedPoint, Period
from ..progress import Progress, progress_bar, refused, silent
from .follow import Line, Settings, follow
from .newton import attempt
from .problem import Point
from .problems.driven_orbits import Orbits, ParameterRange
from .shooting import shoot


@dataclass(frozen=True)
class Search:
    """How far a steady state is looked for.

    Attributes
    ----------
    settling : tuple of int
        Periods of a history after which Newton's method is tried; the last number is doubled from then on.
    time_constants : float
        The history is given up after so many time constants of the mode that decays most slowly ...
    work : float
        ... or so many steps times modes, here and, a tenth of them, before other ways are tried.
    attempt : int
        Newton iterations of one attempt; from a history that is near its end two to four are enough.
    longest : int
        Multiples of the loads' period that a history is watched for.
    ramp : float
        Factor on the oscillating loads from which they are raised; 0: they are not.
    dampings : tuple of float
        Factors on the damping ratios from which they are lowered.
    neighbours : tuple of float
        Relative distances of the frequencies from which the wanted one is approached.
    hurries : bool
        Whether Newton's method from the first guess is given up where faces rub and it hardly gains: for one
        near a known motion.
    """

    settling: tuple[int, ...] = (1, 3, 10, 30)
    time_constants: float = 40.0
    work: float = 6e8
    attempt: int = 12
    longest: int = 6
    ramp: float = 0.02
    dampings: tuple[float, ...] = (4.0, 16.0, 64.0)
    neighbours: tuple[float, ...] = (0.01, -0.01, 0.04, -0.04)
    hurries: bool = False


NEWTON_ALONE = Search(settling=(), ramp=0.0, dampings=(), neighbours=())
# Near a motion that is known.
NEWTON_NEARBY = replace(NEWTON_ALONE, hurries=True)
# Of the state's size: a change over some periods below which a history has come back to where it was, and of
# the change over fewer periods: below which that is more than slow settling.
RETURNED, TRULY = 1e-4, 1e-2
# Newton's method is tried again behind a long history if that has come nearer to its end by this factor.
NEARER = 0.3
# Periods of such a history at most.
SHORT = 240
# Points at most of a branch that leads to the wanted motion.
POINTS = 400
# The same from a neighbouring frequency.
NEAR_BY = 40
# Periods of a history at most, in multiples of the last of `Search.settling`, where friction alone damps it.
RUBBED = 10
# So many times the compliance of a row that sticks a step of the modes may give way.
TREMBLES = 10.0
# Newton iterations with a derivative of their own after which a branch that leads to the motion is given up.
EFFORT = 1500


def find_steady_state(
    driven: DrivenPeriod,
    guess: np.ndarray,
    *,
    jacobian: str = "auto",
    multiples: bool = True,
    search: Search | None = None,
    progress: Progress = None,
) -> tuple[FixedPoint, str]:
    """A periodic motion, by whatever leads to one.

    Parameters
    ----------
    driven : DrivenPeriod
        With contact.
    guess : (2 m,) array
        First guess of x(0) = (Omega q, q').
    jacobian : str
        See `shoot`.
    multiples : bool
        Whether a motion of several of the loads' periods is an answer, if a history settles on one.
    search : Search, optional
    progress : callable, "auto" or None
        Told the share of the search that is behind where Newton's method does not converge at once.

    Returns
    -------
    shot : FixedPoint
        Its `driven.period` is the given one or one of several times its length.
    path : str
        "Newton", "history", "ramp of the load", "ramp of the damping" or "neighbouring frequency".

    Raises
    ------
    SolveError
        If nothing leads to one; it says what was tried.
    """
    failed = list[SolveError]()
    search = search or Search()
    hurries = search.hurries and driven.period.friction is not None
    find = functools.partial(shoot, driven, guess, jacobian, hurries=hurries)
    shot = attempt(find, SolveError, failed)
    if shot is not None:
        return shot, "Newton"
    tried = _Attempts(driven, guess, jacobian, multiples, search)
    near = [1.0 + distance for distance in search.neighbours]
    ways = [
        (tried.settle_first, "history"),
        (tried.raise_load, "ramp of the load"),
        (lambda: tried.along("damping", search.dampings), "ramp of the damping"),
        (lambda: tried.along("frequency", near), "neighbouring frequency"),
        (tried.settle, "history"),
    ]
    if driven.factor != 1.0:  # branches go to the whole load
        ways = [ways[0], ways[-1]]
    with progress_bar(driven.period.reduced.comm, "search for a steady state", progress) as report:
        for k, (way, path) in enumerate(ways):
            tried.report = _part(report, k, len(ways))
            shot = way()
            report((k + 1) / len(ways) if shot is None else 1.0)
            if shot is not None:
                return shot, path
    others = f". Tried in vain as well: {'; '.join(tried.notes)}" if tried.notes else ""
    raise failed_solve(f"{failed[0]}{others}{_trembles(driven)}")


def _trembles(driven: DrivenPeriod) -> str:
    """What may help where faces stick by so little compliance that forces tremble from step to step."""
    period, constants = driven.period, driven.constants
    rubs = np.append(np.zeros(len(period.laws)), constants.rubbing.static) > 0.0
    own = np.diag(constants.residual)[rubs]
    moved = np.diag(constants.flexibility[0])[rubs] - own
    stiff = moved > TREMBLES * own
    if not stiff.any():
        return ""
    k = int((moved / own).argmax())
    ratio = float(moved[k] / own[k])
    return (
        f". {int(stiff.sum())} of {len(own)} rows that rub give way by as little as {own[k]:.3g} m/N where "
        f"they stick, {ratio:.3g} times less than the modes in a step: their friction trembles from step to "
        f"step; give them {moved[k]:.2g} m/N by the law's tangential_compliance or reduce_matrices' "
        f"tangent_compliance, keep fewer modes, or take {math.ceil(math.sqrt(ratio))} times the steps"
    )


def _part(report: Callable[[float], None], number: int, count: int) -> Callable[[float], None]:
    """Who is told how much is behind of one of several equal parts of what a report is of."""
    return lambda done: report((number + min(1.0, done)) / count)


class _History:
    """A history of whole periods that looks for what it settles on.

    Attributes
    ----------
    past : deque
        The last states, one for each period.
    done : int
        Periods.
    changes : list of float
        Relative, over the last one, two, ..
    repeat : int
        Periods after which it repeats itself where that is more than one, else 0.
    tried_at : float
        The change at which Newton's method was tried last.
    failed : str
        Why it cannot be gone on with.
    over : bool
        Whether nothing new is to be expected of it.
    """

    def __init__(self, driven: DrivenPeriod, state: np.ndarray, longest: int):
        self.driven, self.size = driven, driven.oscillation
        self.past: deque[np.ndarray] = deque([state], longest + 1)
        self.done, self.repeat, self.tried_at, self.failed, self.over = 0, 0, math.inf, "", False
        self.changes = [math.nan]

    def reach(self, target: int, tell: Callable[[int], None]) -> bool:
        """Go on to so many periods; whether that is possible."""
        try:
            while self.done < target and not self.over:
                self.past.append(self.past[-1] + self.driven.run(self.past[-1]).residual)
                self.done += 1
                tell(self.done)
        except SolveError as error:  # a contact problem that was not solved
            if refused(error):
                raise
            self.failed, self.over = str(error), True
        if self.over:
            return False
        past = self.past
        norm = max(self.driven.period.size(past[-1]), self.size, 1e-300)
        self.changes = [float(np.linalg.norm(past[-1] - past[-1 - n])) / norm for n in range(1, len(past))]
        self.repeat = _recurrence(self.changes)
        return True


class _Attempts:
    """The ways to a steady state, and what is to be notes of each that failed."""

    def __init__(
        self, driven: DrivenPeriod, guess: np.ndarray, jacobian: str, multiples: bool, search: Search
    ):
        self.driven, self.period, self.guess = driven, driven.period, guess
        self.jacobian, self.multiples, self.search = jacobian, multiples, search
        self.notes: list[str] = []
        self.report: Callable[[float], None] = silent
        self._own = _History(driven, guess, search.longest)

    def _newton(self, driven: DrivenPeriod, state: np.ndarray) -> FixedPoint | None:
        """The fixed point near a state, or None."""
        find = functools.partial(shoot, driven, state, self.jacobian, self.search.attempt)
        return attempt(find, SolveError)

    # ---------------------------------------------------------------- a history
    def settle_first(self) -> FixedPoint | None:
        """Where a history settles soon."""
        most = int(0.1 * self.search.work / (self.period.steps * self.period.modes))
        return self._followed(self._own, most)

    def settle(self) -> FixedPoint | None:
        """Where that history settles in the end."""
        own = self._own
        shot = self._followed(own)
        if shot is None and own.failed:
            self.notes.append(f"a history: {own.failed}")
        elif shot is None and own.done:
            repeats = f" and which repeats itself after {own.repeat} periods: give periods={own.repeat}"
            self.notes.append(
                f"a history of {own.done} periods, after which x(T) - x(0) is at {own.changes[0]:.1e} of x(0)"
                f"{repeats if own.repeat else ''}"
            )
        return shot

    def _followed(self, history: _History, most: float = math.inf) -> FixedPoint | None:
        """Fixed point behind a history, which is gone on with to so many periods, or None."""
        driven, period = history.driven, history.driven.period
        most = min(most, self._patience(period, driven.duration))
        for target in self._rounds(history.done, most):
            if not history.reach(target, lambda done: self.report(done / most)):
                return None
            # a failed attempt takes as long as some hundreds of periods
            if (
                history.done <= self.search.settling[-1]
                or target >= most
                or not history.changes[0] > NEARER * history.tried_at
            ):
                history.tried_at = history.changes[0]
                shot = self._newton(driven, history.past[-1])
                if shot is not None:
                    return shot
            repeat = history.repeat
            if repeat and self.multiples:
                longer = period.repeated(repeat).at(driven.frequency, driven.factor)
                shot = self._newton(longer, history.past[-1])
                if shot is not None:
                    return shot
            history.over = 0 < repeat and not self.multiples and history.changes[repeat - 1] < 1e-2 * RETURNED
        return None

    def _rounds(self, done: int, most: float) -> list[int]:
        """Periods after which Newton's method is tried, of which so many are done."""
        rounds = [periods for periods in self.search.settling if periods < most]
        while rounds and len(rounds) >= len(self.search.settling) and rounds[-1] < most:
            rounds.append(int(min(2 * rounds[-1], most)))
        return [periods for periods in rounds if periods > done]

    def _patience(self, period: Period, duration: float) -> float:
        """Periods after which a history is given up; few without damping."""
        r = period.reduced
        slowest = float((r.damping * period.weights).min()) * duration
        if slowest <= 0.0:
            last = self.search.settling[-1] if self.search.settling else 0
            return last if period.friction is None else RUBBED * last
        most = self.search.work / (period.steps * period.modes)
        return math.ceil(min(most, max(self.search.time_constants / slowest, 100.0)))

    # ---------------------------------------------------------------- along branches
    def raise_load(self) -> FixedPoint | None:
        """The end of a branch from a small load. With nothing but touching faces and no constant load, the
        motion is proportional to the load and nothing is gained.
        """
        period, ramp = self.period, self.search.ramp
        preloaded = (period.excitation.orders == 0).any()
        if ramp <= 0.0 or not preloaded and (period.reduced.homogeneous or not period.pairs):
            return None
        return self.along("load", (ramp,))

    def along(self, name: str, values: Sequence[float]) -> FixedPoint | None:
        """The end of a branch over a parameter, from a motion at one of some values of it, relative to the
        wanted one, of which the first alone counts but of the frequency.
        """
        ends, lost, report = list[str](), list[str](), self.report
        fixed = None if name == "frequency" else self.driven.frequency
        goal = self.driven.frequency if fixed is None else 1.0
        if name == "damping" and not self.period.reduced.damping.any():
            return None
        for k, begin in enumerate(goal * value for value in values):
            self.report = _part(report, k, len(values))
            over = ParameterRange(name, begin if fixed else 2.0 * begin - goal, goal, fixed)
            driven = over.at(self.period, begin)
            first = self._newton(driven, driven.linear_state)
            if first is None:  # behind a history from there
                history = _History(driven, driven.linear_state, self.search.longest)
                first = self._followed(history, SHORT)
            if first is None or first.driven.period is not driven.period:
                lost.append(f"{begin:.6g}")
                continue
            shot, ended = self._followed_branch(first, begin, over)
            if shot is not None:
                return shot
            ends.append(f" from {begin:.6g} (until {ended})")
            if fixed:
                break
        if values:
            nowhere = f" (no motion at {', '.join(lost)})" if lost else ""
            self.notes.append(f"continuation over the {name}{','.join(ends)}{nowhere}")
        return None

    def _followed_branch(
        self, first: FixedPoint, value: float, over: ParameterRange
    ) -> tuple[FixedPoint | None, str]:
        """The wanted motion at the end of a branch from one at a value of a parameter, and why that ended."""
        line = Line([Point.known(Orbits(self.period, over), np.append(first.state, value))])
        points, effort = POINTS if over.frequency else NEAR_BY, 0.0

        def tell(line: Line) -> None:
            nonlocal effort
            self.report(abs(line.points[-1].value - over.start) / over.range.extent)
            effort += line.points[-1].effort
            if effort > EFFORT:
                raise SolveError(f"{EFFORT} Newton iterations, at {line.points[-1].value:.6g}")

        failed = list[Exception]()
        if attempt(functools.partial(follow, line, over.range, Settings(points), tell), told=failed) is None:
            return None, str(failed[0])
        if not over.reached(line.points[-1].value):
            return None, line.reason
        # of the map itself, not of a copy of it
        return self._newton(self.driven, line.points[-1].u[:-1]), line.reason


def _recurrence(changes: list[float]) -> int:
    """The fewest periods, more than one, after which a state has returned though not after one; 0 if none."""
    returned = (n for n in range(1, len(changes)) if changes[n] < min(RETURNED, TRULY * min(changes[:n])))
    return next(returned, -1) + 1

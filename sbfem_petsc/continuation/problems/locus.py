"""Loci of bifurcations: curves in the plane of the forcing frequency and a second parameter.

With the motions x(T; f, p) - x(0) = 0 a two-dimensional surface over (f, p), a locus is the line on it
along which a multiplier stays on the unit circle. The equations are in `locus_problem`; each side of a known
point is a line of its own.

Where a row begins to touch, the orbit of the model is also one of the model without that row, on which the
row's least gap over the period passes through zero smoothly: that is what is solved for, from either side.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from dataclasses import replace
from typing import ClassVar

import numpy as np

from meshing.warnings import BranchWarning

from ...errors import SolveError, warn
from ...motion.factors import FACTORS
from ...motion.period_map import DrivenPeriod
from ...motion.period_motion import PeriodMotion
from ...record.record import Record, described, quantity
from ..bifurcations import Bifurcation
from ..branch import Branch
from ..events import folds
from ..extrapolation import extrapolated
from ..follow import CLOSED, Line, Settings, points_of, ran_out
from ..line_file import LineFile
from ..newton import attempt
from ..orbit import make_orbit, run_again
from ..problem import Lost, Point, Range
from .driven_orbits import Family, OpenRowFamily, least
from .locus_problem import LocusProblem

KINDS = ("fold", "period doubling", "Neimark-Sacker", "grazing")
# How a side is followed: its points, the first one included, and lengths of steps.
PACE = Settings(points=101, first=0.02, largest=0.2, smallest=1e-4)
AT_END = "end of the range"
# Distance of a grazing point from the last one that is open, in steps of the branch: further away it belongs
# to another part of it.
NEAR = 3.0
# Residual, last step and gap of one, relative.
EXACT = 1e-12, 1e-9, 0.0


@described
class Locus(Record):
    """A bifurcation followed over two parameters: the forcing frequency and a factor on the oscillating
    loads, all damping ratios, or all initial gaps.
    """

    coordinates: ClassVar = ("frequency", "value")

    kind: str = quantity(text="what is followed", one_of=KINDS)
    parameter: str = quantity(text="what the factor is on", one_of=tuple(FACTORS))
    frequency: np.ndarray = quantity("Hz", "forcing frequency", "point", least=0.0)
    value: np.ndarray = quantity("1", "factor on the second parameter", "point")
    states: np.ndarray = quantity(
        "m sqrt(kg)/s", "(Omega q, q') at t = 0", "point state", detail=True, repr=False
    )
    multiplier: np.ndarray = quantity(
        "1", "the one on the unit circle; nan for grazing", "point", kinds="c", finite=False, repr=False
    )
    reasons: tuple[str, str] = quantity(text="why either end is one", dims="end")
    periods: int = quantity("1", "forcing periods in the period of the motion", default=1, least=1)
    largest_displacement: float = quantity(
        "m",
        "largest displacement of a named point in the motion whose state is the largest",
        default=math.nan,
        least=0.0,
        finite=False,
        repr=False,
    )

    def _furthest(self, least: float = 0.0) -> float:
        """Largest displacement of a named point, m."""
        return self.largest_displacement

    def __len__(self) -> int:
        return len(self.value)

    def __repr__(self) -> str:
        return (
            f"Locus({self.kind}, {points_of(len(self))}, {self.frequency.min():.7g} to "
            f"{self.frequency.max():.7g} Hz, "
            f"factor on the {self.parameter} {self.value.min():.6g} to {self.value.max():.6g}; ends: "
            f"{self.reasons[0]}; {self.reasons[1]})"
        )


def follow_locus(
    family: Family, kind: str, begin: np.ndarray, limits: tuple[float, float], pace: Settings, run: LineFile
) -> Locus:
    """Follow a bifurcation over the frequency and a second parameter, from a known point to both sides.

    Parameters
    ----------
    family : Family
    kind : str
    begin : array
        Unknowns close to the locus, see `LocusProblem`.
    limits : (float, float)
        Of the second parameter, between which the locus is followed.
    pace : Settings
        Of each side.
    run : LineFile

    Raises
    ------
    SolveError
        If no point is found near the first one.
    """
    problem = LocusProblem(family, kind, begin, limits[1] - limits[0])
    lines = run.lines(problem)

    def share(value: float) -> float:
        first, end = problem.value(begin)[0], limits[len(lines) - 1]
        done = min(1.0, abs(value - first) / max(abs(end - first), 1e-300))
        return 0.5 * (len(lines) - 1 + done)

    for number, direction in enumerate((-1, 1)):
        if number and lines[0].reason == CLOSED:
            break
        if len(lines) == number:
            first = lines[0].points[0] if lines else _first(problem)
            # as a run that is gone on with has it, whatever the other side has made of it
            lines.append(Line([problem.recalled(first.u, first.value, problem.memory(first))]))
        within = Range(*limits, direction)
        run.follow(lines[: number + 1], within, pace, lambda: _joined(family, kind, lines), share)
    result = _joined(family, kind, lines, located=True)
    result = replace(result, largest_displacement=_largest_displacement(family, result))
    run.update(lambda: result, lines, last=True)
    run.report(1.0)
    return result


def _first(problem: LocusProblem) -> Point:
    """The point of the locus next to its start, with the second parameter held, or the frequency: a fold's
    locus may run along the parameter's axis.
    """
    failed = list[Lost]()
    for held in (1, 0):
        if (found := attempt(functools.partial(problem.first, held), Lost, failed)) is not None:
            return found
    _, frequency, value = problem.split(problem.begin)
    raise SolveError(
        f"locus: no {problem.kind} was found near {frequency:.8g} Hz and the factor {value:.6g}: {failed[0]}"
    )


def _joined(family: Family, kind: str, lines: Sequence[Line], located: bool = False) -> Locus:
    """Both sides as one line, with the extremes of the second parameter between its points if they are to be
    located.
    """
    sides = [line.points[1:] for line in lines]
    reasons = [_reason(line) for line in lines] + ["unfinished"] * (2 - len(lines))
    if reasons[0] == CLOSED:
        sides, reasons = [sides[0][:-1]], [CLOSED, CLOSED]
    points = [*reversed(sides[0]), lines[0].points[0], *(sides[1] if len(sides) > 1 else ())]
    if located:
        for k, point in reversed(folds(Line(points))):
            points.insert(k + 1, point)
    size = points[0].problem.modes2
    u = np.array([point.u for point in points])
    return Locus(
        kind,
        family.parameter,
        u[:, size].copy(),
        np.array([point.value for point in points]),
        u[:, :size].copy(),
        np.array([point.state.multiplier for point in points]),
        (reasons[0], reasons[1]),
        family.period.excitation.periods,
    )


def _largest_displacement(family: Family, locus: Locus) -> float:
    """Of named points in the motion whose state is the largest, m."""
    k = int(np.argmax(np.linalg.norm(locus.states, axis=1)))
    driven = family.at(float(locus.frequency[k]), float(locus.value[k]))
    return make_orbit(run_again(driven, locus.states[k]), "point of a locus")._furthest()


def _reason(line: Line) -> str:
    """Why a side ends, the points of which are counted without the first one."""
    return points_of(len(line.points) - 1) if ran_out(line.reason) else line.reason or "unfinished"


# ---------------------------------------------------------------------- grazing points of a branch
def least_gaps(driven: DrivenPeriod, motion: PeriodMotion) -> np.ndarray:
    """(rows,): how far rows that are always free are from being held, m, at the least over the period; of the
    others minus the overlap that their largest force stands for; -inf of those that are never free.
    """
    p = driven.period
    gaps = driven.free_gap + motion.states @ p.right @ p.left.T + motion.forces @ p.residual_flexibility
    room, force = p.laws.room(gaps[:-1]), np.abs(motion.forces).max(axis=0)
    overlap = -force * np.diag(driven.constants.flexibility[0] + p.residual_flexibility)
    always = [least(row) if np.isfinite(row).all() else -np.inf for row in room.T]
    return np.where((force > 0.0) & np.isfinite(always), overlap, always)


def grazing_row(driven: DrivenPeriod, state: np.ndarray) -> int:
    """The row that is nearest to begin or cease touching on an orbit."""
    return int(np.argmin(np.abs(least_gaps(driven, driven.run(state)))))


def find_grazing(branch: Branch, every: bool) -> list[Bifurcation]:
    """Grazing points between the points of a branch.

    Parameters
    ----------
    branch : Branch
    every : bool
        Of every row; False: only where the motion without any contact begins or ends.

    Warns
    -----
    BranchWarning
        Of one that is not found.
    """
    period, result = branch.period, []
    touching = np.zeros((len(branch), period.pairs), dtype=bool)
    for k, (value, state) in enumerate(zip(branch.value, branch.states)):
        driven = branch.over.at(period, float(value))
        gaps = least_gaps(driven, driven.run(state))
        touching[k] = (gaps < 0.0) & np.isfinite(gaps)
    for k in range(1, len(branch)):
        changed = touching[k] != touching[k - 1]
        if not every and touching[k].any() == touching[k - 1].any():
            continue
        found = []
        for row in np.flatnonzero(changed):
            try:
                found.append(_grazing(branch, k, int(row), bool(touching[k, row])))
            except SolveError as error:
                warn(str(error), BranchWarning)
        if found and not every:  # of several rows the first that touches
            opened = not touching[k].any()
            open_end = float(branch.value[k if opened else k - 1])
            found = [min(found, key=lambda item: abs(item.value - open_end))]
        result += found
    return result


def _grazing(branch: Branch, k: int, row: int, closes: bool) -> Bifurcation:
    """Where a row begins (or ceases) to touch between the points k - 1 and k."""
    inside, outside = (k - 1, k) if closes else (k, k - 1)
    begin, end = float(branch.value[inside]), float(branch.value[outside])

    def located(times: int, near: Point | None = None) -> Point:
        """In so many times the steps, from the point in the branch's own."""
        period = branch.period.in_steps(times * branch.period.steps)
        over, state, value = branch.parameter, branch.states[inside], begin
        if near is not None:
            state, value = near.u[: near.problem.modes2], near.value
        driven, held = branch.over.at(period, value), int(over == "frequency")
        family = OpenRowFamily(period, row, "load" if held else over)
        factor = 1.0 if held else value
        start = np.append(state, [driven.frequency, factor])
        problem = LocusProblem(family, "grazing", start, factor or 1.0)
        problem.closed, problem.settled, problem.band = EXACT
        found = problem.first(held)
        found.value = float(found.u[problem.modes2 + 1 - held])
        if abs(found.value - value) > NEAR * max(abs(end - begin), 1e-9 * abs(begin)):
            raise Lost(f"row {row} does not begin to touch there")
        return found

    try:
        point = located(1)
    except SolveError:
        raise SolveError(
            f"grazing_points: where contact row {row} begins to touch between the points {k - 1} and {k} of "
            f"the branch, at {begin:.8g} and {end:.8g}, was not found; give a branch with a smaller "
            "largest_step"
        ) from None
    value, error = extrapolated(point.value, lambda times: located(times, point).value)
    state = point.u[: point.problem.modes2]
    direction, none = np.zeros(len(state), complex), complex(np.nan)
    return Bifurcation("grazing", value, none, state, direction, k, point.value, error, row)

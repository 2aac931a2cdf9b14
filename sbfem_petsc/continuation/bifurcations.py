"""Folds, period doublings, Neimark-Sacker and grazing points between the points of a branch."""

from __future__ import annotations

import math

import numpy as np

from ..record.record import Record, described, quantity
from . import extrapolation
from .events import find_zero, fold_between, folds, furthest
from .follow import Line
from .multipliers import outside
from .problem import Point

# A located multiplier this near the unit circle has passed it there.
RESOLVED = 1e-2


@described
class Bifurcation(Record):
    """A point where the number of unstable multipliers changes, or where the branch turns back.

    Of kind "grazing" a pair begins or ceases to touch, and the multiplier is inside the unit circle on one
    side and outside on the other, however near.
    """

    kind: str = quantity(
        text="what it is", one_of=("fold", "period doubling", "Neimark-Sacker", "branch point", "grazing")
    )
    value: float = quantity(
        "Hz or 1", "the branch's parameter, extrapolated from the steps, and moved as by more modes"
    )
    multiplier: complex = quantity(
        "1", "the one that passes the unit circle", called="own_multiplier", finite=False
    )
    state: np.ndarray = quantity("m sqrt(kg)/s", "(Omega q, q') at t = 0", "state", detail=True)
    direction: np.ndarray = quantity("m sqrt(kg)/s", "Floquet direction", "state", kinds="fc", detail=True)
    after: int = quantity("1", "index of the point of the branch behind it", least=0, detail=True)
    own_value: float = quantity(
        "Hz or 1", "where it is in the branch's own steps, whose are its state, multiplier and direction"
    )
    error: float = quantity(
        "Hz or 1",
        "uncertainty of the value, by twice and four times the steps and by modes left out, where these "
        "are known; nan where it is not found in more of them",
        finite=False,
    )
    row: int | None = quantity(
        "1", "contact row that begins or ceases to touch", called="contact_row", default=None, least=0
    )

    def __repr__(self) -> str:
        known = math.isfinite(self.error)
        error = f" +- {self.error:.1g}" if known else ", uncertainty not known"
        return f"Bifurcation({self.kind} at {self.value:.7g}{error}, multiplier {self.multiplier:.6g})"


def locate(line: Line) -> list[Bifurcation]:
    """All bifurcations of a branch that has been gone through, in order of arc length."""
    result, turns, counts = [], dict(folds(line)), _outside(line)
    for k in range(1, len(line.points)):
        if k - 1 in turns:
            result.append(_fold(line, k - 1, turns[k - 1]))
        if counts[k - 1] != counts[k]:
            crossing = _crossing(line, k, max(counts[k - 1 : k + 1]) - 1)
            # a real multiplier through +1 at a turning point is the fold itself
            turned = bool(turns.keys() & {k - 2, k - 1, k}) or _turns(line.points, k)
            if crossing is not None and crossing.kind == "branch point":
                crossing = _beside(line, k, turns) if turned else _fold_or(crossing, line, k)
            if crossing is not None:
                result.append(crossing)
    return sorted(result, key=lambda item: _place(line, item))


def _place(line: Line, item: Bifurcation) -> float:
    """In points of a branch, by the way between the two beside it."""
    begin, end = (line.points[k].state.state for k in (item.after - 1, item.after))
    chord = end - begin
    return item.after + float((item.state - begin) @ chord) / max(float(chord @ chord), 1e-300)


def _outside(line: Line) -> list[int]:
    """How many multipliers of each point are outside the unit circle."""
    return [int(outside(point.state.multipliers).sum()) for point in line.points]


def unlocated(line: Line, why: str) -> str:
    """Where a branch has bifurcations, and why they are not located; "" where it has none."""
    counts, values = _outside(line), line.values
    passed = [k for k in range(1, len(counts)) if counts[k - 1] != counts[k]]
    turned = [
        k for k in range(1, len(values) - 1) if _turns(line.points, k + 1) and not {k, k + 1} & {*passed}
    ]
    places = [f"between {values[k - 1]:.7g} and {values[k]:.7g}" for k in sorted(passed + turned)]
    return f"bifurcations {', '.join(places)} are not located: {why}" if places else ""


def follow_multiplier(spectra: dict[float, np.ndarray], start: float, rank: int) -> dict[float, complex]:
    """The multiplier of a rank at one place of a branch, at the others: at each, from the nearest place on,
    the one that is nearest to where those at the two places before let it be expected.
    """
    first = complex(spectra[start][rank])
    result = {start: first.conjugate() if first.imag < 0.0 else first}
    for place in sorted(spectra, key=lambda place: abs(place - start))[1:]:
        near = sorted(result, key=lambda other: abs(other - place))[:2]
        expected = result[near[0]]
        if len(near) > 1:
            expected += (result[near[0]] - result[near[1]]) * (place - near[0]) / (near[0] - near[1])
        upper = spectra[place][spectra[place].imag >= 0.0]
        result[place] = complex(upper[np.abs(upper - expected).argmin()])
    return result


def by_steps(point: Point) -> float:
    """How far the steps of time change the value that belongs to a motion."""
    period = point.problem.period
    return float(abs(point.value) * (2.0 * np.pi * period.excitation.periods / period.steps) ** 2 / 12.0)


def _turns(points: list[Point], k: int) -> bool:
    steps = np.diff([point.value for point in points[max(0, k - 2) : k + 2]])
    return bool((steps[1:] * steps[:-1] < 0.0).any())


def _beside(line: Line, k: int, turns: dict[int, Point]) -> Bifurcation | None:
    """A fold between two points beside one that is known, None where there is no further one."""
    between = None if k - 1 in turns else fold_between(line, k - 1)
    if between is None or any(abs(t.value - between.value) <= by_steps(between) for t in turns.values()):
        return None
    return _fold(line, k - 1, between)


def _fold_or(crossing: Bifurcation, line: Line, k: int) -> Bifurcation:
    """A multiplier through +1 before point k as the fold that it is where the tangents turn there, though the
    points go on beyond another fold; or where the points turn beside it, though steps keep the tangents from
    it: as far away as they change a period.
    """
    between = fold_between(line, k - 1)
    if between is not None:
        return _fold(line, k - 1, between)
    turn = furthest(line, k, by_steps(line.points[k]))
    return crossing if turn is None else _fold(line, turn, line.points[turn])


def _fold(line: Line, k: int, point: Point) -> Bifurcation:
    """A point between point k and the next one as a fold."""
    values = point.state.multipliers
    nearest = int(np.argmin(np.abs(values.values - 1.0)))
    multiplier, (value, error) = complex(values.values[nearest]), extrapolation.fold(line, k, point)
    state, direction = point.state.state, values.direction(nearest)
    return Bifurcation("fold", value, multiplier, state, direction, k + 1, point.value, error)


def _crossing(line: Line, k: int, rank: int) -> Bifurcation | None:
    """Where the multiplier of the given rank by modulus passes the unit circle between points k - 1 and k."""

    def excess(point: Point) -> float:
        return float(np.abs(point.state.multipliers.values[rank]) - 1.0)

    def smooth(places: dict[float, Point]) -> dict[float, float]:
        """The same of one multiplier, whatever its rank at other points."""
        spectra = {place: point.state.multipliers.values for place, point in places.items()}
        unstable_end = 0.0 if ends[0] > 0.0 else 1.0
        followed = follow_multiplier(spectra, unstable_end, rank)
        return {place: abs(value) - 1.0 for place, value in followed.items()}

    first, second = line.points[k - 1 : k + 1]
    ends = excess(first), excess(second)
    if ends[0] * ends[1] > 0.0:
        return None
    point, one, other = find_zero(line, k - 1, excess, ends, smooth, RESOLVED)
    at = point.state.multipliers
    value = complex(at.values[rank])
    # a jump over the circle between two points that touch differently, finer than bifurcations are located
    unresolved = abs(abs(value) - 1.0) > RESOLVED and (first.state.touching != second.state.touching).any()
    # beside a pair that begins to touch it may pass the circle as elsewhere
    jump = max(abs(excess(end)) for end in (one, other)) > RESOLVED
    rows, row = np.flatnonzero(one.state.touching != other.state.touching), None
    if (len(rows) and jump) or unresolved:
        kind, row = "grazing", int(rows[0]) if len(rows) == 1 else None
        place, error = extrapolation.jump(line, k - 1, (point, one, other))
    else:
        real = "period doubling" if value.real < 0.0 else "branch point"
        kind = "Neimark-Sacker" if value.imag != 0.0 else real
        place, error = extrapolation.passage(line, k - 1, (point, one, other), value)
    state, direction = point.state.state, at.direction(rank)
    return Bifurcation(kind, place, value, state, direction, k, point.value, error, row)

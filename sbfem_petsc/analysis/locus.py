"""Bifurcations followed in two parameters, and the grazing points of a branch."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from meshing.warnings import BranchWarning

from ..checks import instance
from ..continuation.bifurcations import Bifurcation
from ..continuation.branch import Branch
from ..continuation.follow import CLOSED
from ..continuation.line_file import LineFile
from ..continuation.multipliers import eigenvalues
from ..continuation.problems.driven_orbits import Family, OpenRowFamily
from ..continuation.problems.locus import AT_END, KINDS, PACE, Locus, find_grazing, follow_locus, grazing_row
from ..errors import SolveError, warn
from ..motion.factors import FACTORS
from ..motion.preparation import refuse_falling
from ..progress import Progress
from ..ranks.parallel import collective
from .analysis import analysis
from .options import GrazingOptions, LociOptions, LocusOptions

# A multiplier further than this from 1 is that of a corner, not of a smooth fold.
SMOOTH = 0.1
# The kinds of which a multiplier is on the unit circle.
SMOOTH_KINDS = ("fold", "period doubling", "Neimark-Sacker")
# A bifurcation this near to a line that is known, relative to its state and to the branch's range, is on it.
ONE = 0.03
# What a bifurcation's state may miss of itself over a period, relative.
PERIODIC = 1e-4
# A factor this near to 1 is 1.
AT = 1e-6


@analysis(LocusOptions, rubs=True)
def locus(
    branch: Branch,
    bifurcation: Bifurcation,
    start: float,
    stop: float,
    *,
    parameter: str = "load",
    points: int = 100,
    largest_step: float | None = None,
    file: str | None = None,
    resume: bool = False,
    progress: Progress = "auto",
) -> Locus:
    """Follow a bifurcation of a branch over the forcing frequency and a second parameter.

    The lines of folds bound the frequencies and loads at which there is more than one motion, those of period
    doublings and Neimark-Sacker points where a motion loses its stability: a map of behaviour. A line of
    grazing points is where a pair that is open begins to touch.

    Parameters
    ----------
    branch : Branch
        Of `frequency_response` or `load_response`; the locus is that of its steps, which are not halved.
    bifurcation : Bifurcation
        One of the branch's or of `grazing_points`: a fold, a period doubling, a Neimark-Sacker or a grazing
        point.
    start, stop : float
        Factors on the second parameter between which the locus is followed; the branch's own conditions, the
        factor 1 (of a `load_response` over this parameter: the bifurcation's), lie between them or at an end.
    parameter : {"load", "damping", "gap"}
        What the factor is on: all oscillating loads, all damping ratios, or all initial gaps.
    points : int
        To either side of the bifurcation, at most.
    largest_step : float, optional
        Largest change of the factor from a point to the next one, for a finer line.
    file : str, optional
        Journal that is kept up to date (`read`).
    resume : bool
        Continue `file` if it exists, with the same branch, bifurcation and settings.
    progress : callable, "auto" or None
        As for `transient`.

    Returns
    -------
    Locus

    Raises
    ------
    TypeError, ValueError
        For input that makes no sense; for a branch point, which is no line in the plane.
    SolveError
        If Newton's method does not find the bifurcation again.

    Notes
    -----
    Where faces rub, multipliers are those with each change from stick to slip located inside its step; of
    more than 16 rows a branch's own are those of its steps, some percent off the unit circle there.
    """
    what = "locus"
    instance(what, "branch", branch, Branch, "a Branch")
    comm = branch.period.reduced.comm
    refuse_falling(what, branch.period.friction)
    with collective(comm):
        instance(what, "bifurcation", bifurcation, Bifurcation, "a Bifurcation of the branch")
        if why := _why_none(branch, bifurcation):
            raise ValueError(f"locus: bifurcation = {bifurcation!r} {why}")
        _require_effect(what, branch, parameter)
        value = bifurcation.own_value if branch.parameter == parameter else 1.0
        if not min(start, stop) <= value <= max(start, stop):
            raise ValueError(
                f"locus: the bifurcation is at the factor {value:.6g} on the {parameter}, which must lie "
                f"between start = {start:g} and stop = {stop:g}"
            )
    row, driven = bifurcation.row, branch.over.at(branch.period, bifurcation.own_value)
    if bifurcation.kind == "grazing" and row is None:  # of several that change within a step of the branch
        row = grazing_row(driven, bifurcation.state)
    kind, begin = bifurcation.kind, np.append(bifurcation.state, [driven.frequency, value])
    if kind == "Neimark-Sacker":
        begin = np.append(begin, abs(np.angle(bifurcation.multiplier)))
    limits, factor = (min(start, stop), max(start, stop)), driven.factor
    period = branch.period if branch.parameter == parameter else driven.period
    with LineFile(comm, file, resume=resume, task="locus", progress=progress) as run:
        told = {"kind": kind, "row": -1 if row is None else row, "parameter": parameter}
        told |= {"start": start, "stop": stop, "factor": factor, "largest_step": largest_step or "none"}
        told |= {"frequency": driven.frequency, "unknowns": len(begin)}
        period, begin = run.begin_period(period, told, begin)
        family = Family(period, parameter, factor)
        if row is not None:
            family = OpenRowFamily(period, row, parameter, factor)
        pace = replace(PACE, points=points + 1, largest_step=largest_step or np.inf)
        return follow_locus(family, kind, begin, limits, pace, run)


def _why_none(branch: Branch, item: Bifurcation) -> str:
    """Why a branch has no line of a bifurcation, and what to give; "" where it has."""
    if item.kind not in KINDS:
        return "cannot be followed; give a fold, a period doubling, a Neimark-Sacker or a grazing point"
    size = branch.states.shape[1]
    if item.state.shape != (size,):
        return f"has {item.state.size} unknowns, the branch {size}; give one of branch.bifurcations"
    missed = branch.over.at(branch.period, item.own_value).run(item.state).residual
    if not np.linalg.norm(missed) <= PERIODIC * branch.period.size(item.state):
        return (
            "is no motion of the branch, under whose loads it is not periodic; give one of "
            "branch.bifurcations"
        )
    if item.kind == "fold" and not _smooth(branch, item):
        return (
            "is a corner of the branch, where a pair begins to touch, and no multiplier is 1 there; give a "
            "smooth fold"
        )
    return ""


def _require_effect(what: str, branch: Branch, parameter: str) -> None:
    """Refuse a factor on what is zero throughout, over which every line is vertical but for rounding."""
    values = {"damping": branch.period.reduced.damping, "gap": branch.period.reduced.initial_gap}
    if parameter in values and not values[parameter].any():
        raise ValueError(
            f"{what}: parameter = {parameter!r} has no effect, for {FACTORS[parameter]} are 0; give another "
            f"parameter, or a model with {parameter}"
        )


@analysis(LociOptions, rubs=True)
def loci(
    branch: Branch,
    start: float,
    stop: float,
    *,
    parameter: str = "load",
    kinds: Sequence[str] = SMOOTH_KINDS,
    points: int = 100,
    largest_step: float | None = None,
    progress: Progress = "auto",
) -> tuple[Locus, ...]:
    """Follow all bifurcations of a branch over the forcing frequency and a second parameter, each line once.

    Parameters
    ----------
    branch : Branch
        Of `frequency_response`.
    start, stop, parameter, points, largest_step, progress
        See `locus`.
    kinds : sequence of {"fold", "period doubling", "Neimark-Sacker", "grazing"}
        Which are followed. Folds at corners, which are no lines of a multiplier 1, are left out; "grazing"
        are the ends of motions without any contact.

    Returns
    -------
    tuple of Locus

    Raises
    ------
    TypeError, ValueError
        For input that makes no sense.

    Warns
    -----
    BranchWarning
        Of bifurcations that could not be followed, and of lines that end inside the range.
    """
    what = "loci"
    instance(what, "branch", branch, Branch, "a Branch")
    refuse_falling(what, branch.period.friction)
    with collective(branch.period.reduced.comm):
        if branch.parameter != "frequency":
            raise ValueError(
                f"{what}: branch = {branch!r} is over the {branch.parameter}; give one over the frequency"
            )
        _require_effect(what, branch, parameter)
    found = [b for b in branch.bifurcations if b.kind in SMOOTH_KINDS and b.kind in kinds]
    found = [b for b in found if b.kind != "fold" or _smooth(branch, b)]
    if "grazing" in kinds:
        found += grazing_points(branch)
    along = partial(locus, parameter=parameter, points=points, largest_step=largest_step, progress=progress)
    result: list[Locus] = []
    for item in found:
        if any(_passes(line, item, branch) for line in result):
            continue
        try:
            line = along(branch, item, start, stop)
        except SolveError as error:
            warn(f"{what}: {item!r} was not followed: {error}", BranchWarning)
            continue
        result.append(line)
        for k, reason in zip((0, -1), line.reasons):
            if reason != CLOSED and not reason.startswith(AT_END):
                warn(
                    f"{what}: the line of {item!r} ends inside the range, at {line.frequency[k]:.8g} Hz and "
                    f"the factor {line.value[k]:.6g}: {reason}",
                    BranchWarning,
                )
    return tuple(result)


def _smooth(branch: Branch, item: Bifurcation) -> bool:
    """Whether a fold is no corner; where faces rub, multipliers of the steps do not tell."""
    multiplier = item.multiplier
    if branch.period.friction is not None and item.state.shape == branch.states.shape[1:]:
        driven = branch.over.at(branch.period, item.own_value)
        values = eigenvalues(driven.monodromy(driven.run(item.state), rubbing=True))
        multiplier = values[np.argmin(np.abs(values - 1.0))]
    return bool(abs(multiplier - 1.0) <= SMOOTH)


def _passes(line: Locus, item: Bifurcation, branch: Branch) -> bool:
    """Whether a line passes the branch's own conditions at a bifurcation, to the distance of its points."""
    if line.kind != item.kind:
        return False
    # an end of the range is met to rounding
    beyond = np.where(np.abs(line.value - 1.0) < AT, 0.0, line.value - 1.0)
    for k in np.flatnonzero(beyond[:-1] * beyond[1:] <= 0.0):
        share = (1.0 - line.value[k]) / ((line.value[k + 1] - line.value[k]) or 1.0)
        frequency = line.frequency[k] + share * (line.frequency[k + 1] - line.frequency[k])
        state = line.states[k] + share * (line.states[k + 1] - line.states[k])
        near = np.linalg.norm(state - item.state) < ONE * branch.period.size(item.state)
        if near and abs(frequency - item.own_value) < ONE * np.ptp(branch.value):
            return True
    return False


@analysis(GrazingOptions)
def grazing_points(branch: Branch, *, every: bool = False) -> tuple[Bifurcation, ...]:
    """Find where a motion of a branch begins or ceases to touch: the least gap over the period is zero there.

    They need not change stability; those that do are among `branch.bifurcations` as well, less exactly.

    Parameters
    ----------
    branch : Branch
        Of `frequency_response` or `load_response`.
    every : bool
        Of every contact row; default: only the ends of the motions without any contact.

    Returns
    -------
    tuple of Bifurcation
        Of kind "grazing", in order of the branch; their multiplier is nan, the state is that of grazing.

    Raises
    ------
    TypeError
        If `branch` is none.

    Warns
    -----
    BranchWarning
        Of one that is not found, where the branch turns too sharply between two points.
    """
    instance("grazing_points", "branch", branch, Branch, "a Branch")
    return tuple(find_grazing(branch, every))

"""Branches of free motions over their energy: what is kept of each point, finer points, what lies between."""

from __future__ import annotations

import contextlib
import functools
import math
from dataclasses import replace
from typing import ClassVar

import numpy as np

from ...checks import index_of
from ...errors import SolveError, failed_solve, on_all_ranks
from ...motion.excitation import one_sided
from ...motion.period_map import require_waves
from ...record.record import derived, described, quantity
from ...reduction.reduced_model import ReducedModel
from ..events import folds, refine
from ..follow import Line, Settings, follow, points_of
from ..line_file import LineFile
from ..orbit import UNASKED, OfOrbits, Orbit, make_orbit, run_again
from ..problem import Lost, Point, Range
from .free import ADDED, UNCERTAIN, FreeMotions, FreeState, FreeSystem
from .free_stability import FreeEvent, divide_interactions, free_events, free_multipliers, interactions_of

# Points a decade where the motions of all energies are alike.
DECADE = 8
# A point is next to each turn in energy, relative.
NEXT = 2e-3
HARMONICS = 20
# Additional gaps fall by this factor at first and at most, and no slower than by the second one; relative to
# those between which the mode moves freely they are left out from the third number on.
FALL, SLOWEST, LEAVE_OUT = 3.0, 1.01, 1e-4
# Relative opening of a pair by the mode below which it is not notes from those at the tip.
NEAR_TIP = 1e-3
# Gaps between which the mode moves freely, relative to its own opening: rounding does not touch them.
AJAR = 1.001
# How the branch is followed: lengths and turns of steps, and points at most on the way to its first energy.
PACE = Settings(points=400, first=0.05, largest=0.4, smallest=1e-6, turn=0.25)


@described
class Backbone(OfOrbits):
    """Free periodic motions, point by point along their branch.

    Errors are what half the step changes, estimates; nan without refinement, or where half the step leads
    elsewhere, as it may at an interaction with a high mode. The damping ratio by the rate of decay is
    xi / (4 pi f), of a linear system of the same frequency whose amplitude falls as that of a free vibration
    does at the moment, by exp(-xi t / 2) (the modal damping ratio of Krack 2015); without damping the trace
    that the steps leave, about 1e-14. That by the energy is what the dampers take in a period over 4 pi times
    the energy; it is the other one times twice the mean kinetic energy over the energy, and the same where
    nothing touches.

    Multipliers, empty if they were not asked for, are without those that every free motion has: +1 along the
    motion and, without damping, +1 along the branch; with damping less what the self-excitation gives to
    every disturbance. Interactions that were passed over are all on whose tongue the state would change by
    more than 1e-3 of itself. Events are turns in energy, located between the points, and where the branch
    becomes stable or unstable.
    """

    coordinates: ClassVar = ("energy", "frequency", "stable")

    mode: int = quantity("1", "the followed one, from 1", least=1)
    energy: np.ndarray = quantity(
        "J", "energy at t = 0, where the velocity of the followed mode vanishes", "point", least=0.0
    )
    frequency: np.ndarray = quantity("Hz", "its frequency", "point", least=1e-300)
    frequency_error: np.ndarray = quantity("Hz", "error of the frequency", "point", finite=False)
    damping_ratio: np.ndarray = quantity("1", "damping ratio by the rate of decay", "point")
    damping_error: np.ndarray = quantity("1", "error of damping_ratio", "point", finite=False)
    energy_damping_ratio: np.ndarray = quantity("1", "damping ratio by the energy", "point")
    energy_damping_error: np.ndarray = quantity("1", "error of energy_damping_ratio", "point", finite=False)
    passed: tuple[tuple[float, float], ...] = quantity(
        "J", "energies on either side of interactions with higher modes passed over", "interaction side"
    )
    events: tuple[FreeEvent, ...] = quantity(text="in order", part="FreeEvent")
    damped: bool = quantity("1", "whether with the model's damping")
    reason: str = quantity(text="why the branch ends")
    complete: bool = quantity("1", "whether it reached the last energy", row=True)
    excitation: np.ndarray = quantity(
        "1/s", "self-excitation that makes up for damping", "point", detail=True
    )
    own_frequency: np.ndarray = quantity(
        "Hz", "frequency in the branch's own steps", "point", detail=True, least=1e-300
    )

    reduced: ReducedModel = quantity(text="the reduced model", part="ReducedModel", detail=True)
    steps: int = quantity("1", "time steps a period of the motion", detail=True, least=1)

    def check(self) -> None:
        """Raise ValueError unless points and model belong together."""
        modes = len(self.reduced.omega)
        require_waves(self.steps, 1)
        if (
            not len(self.energy)
            or self.mode > self.reduced.natural
            or self.states.shape[1] != 2 * modes
            or self.point_harmonics.shape[1:3] != self.reduced.points.modes.shape[:2]
            or any(event.after > len(self.energy) for event in self.events)
        ):
            raise ValueError(
                f"{len(self.energy)} motions of mode {self.mode} are not those of {modes} modes and "
                f"{len(self.points)} points"
            )

    @functools.cached_property
    def _system(self) -> FreeSystem:
        """Whose motions these are."""
        return FreeSystem(self.reduced, self.mode - 1, self.steps)

    @derived("1", "whether small disturbances die out", "point", kinds="b")
    def stable(self) -> np.ndarray:
        """(n,) bool: no multiplier outside the unit circle by more than 1e-5; False throughout where
        stability was not asked for.
        """
        return ~self.unstable & self.stability_known

    @property
    def stability_known(self) -> bool:
        """Whether stability was asked for."""
        return bool(self.multipliers.shape[1])

    @property
    def unstable(self) -> np.ndarray:
        """(n,) bool: some multiplier is; False throughout where stability was not asked for."""
        largest = np.abs(self.multipliers).max(axis=1, initial=0.0)
        return largest > 1.0 + UNCERTAIN

    def orbit(self, k: int) -> Orbit:
        """The k-th motion over its period, integrated again from its state; with damping under the
        self-excitation that keeps it going.
        """
        k = index_of("orbit", "k", k, len(self.energy))
        driven = self._system.at(float(self.own_frequency[k]), float(self.excitation[k]))
        told = self.multipliers[k], UNCERTAIN
        return make_orbit(run_again(driven, self.states[k]), "point of a backbone", told)

    def __len__(self) -> int:
        return len(self.energy)

    def __repr__(self) -> str:
        verdict = f"{self.unstable.sum()} unstable" if self.stability_known else UNASKED
        return (
            f"Backbone(mode {self.mode}, {points_of(len(self))}, {self.energy.min():.4g} to "
            f"{self.energy.max():.4g} J, {self.frequency.min():.7g} to {self.frequency.max():.7g} Hz, "
            f"{verdict}, {self.reason})"
        )


def follow_backbone(rows: Rows, start: float, stop: float, pace: Settings, run: LineFile) -> Backbone:
    """Follow free motions from one energy (J) towards another.

    Parameters
    ----------
    rows : Rows
        Of the system.
    start, stop : float
    pace : Settings
    run : LineFile

    Raises
    ------
    SolveError
        If no motion is found at the first energy.
    """
    limits = min(start, stop), max(start, stop)
    problem = FreeMotions(rows.system, limits, rows.interactions)
    within = Range(*limits, 1 if stop > start else -1)
    line = run.line(problem) or _begun(problem, start, stop)

    def share(energy: float) -> float:
        return abs(math.log(energy / start) / math.log(stop / start))

    if run.follow([line], within, pace, lambda: rows.backbone(line), share, rows.tell) and line.complete:
        rows.refine_line(line, abs(math.log(stop / start)))
    result = rows.finished(line)
    run.update(lambda: result, [line], last=True)
    return result


def _begun(problem: FreeMotions, start: float, stop: float) -> Line:
    """The first motion of a branch; all of it where motions of all energies are alike."""
    try:
        first = first_motion(problem.system, start)
    except SolveError as error:
        if not isinstance(error, Lost):  # it says so itself
            raise on_all_ranks(error) from None
        mode = problem.system.mode + 1
        text = f"backbone: no free motion of mode {mode} was found at {start:.6g} J: {error}"
        raise failed_solve(text) from None
    first = problem.recalled(first.u, start, (False, False))
    if not problem.system.reduced.homogeneous:
        return Line([first])
    line = Line([first], reason=f"end of the range at {stop:.8g}", complete=True)
    count = max(2, 1 + math.ceil(DECADE * abs(math.log10(stop / start))))
    for energy in np.geomspace(start, stop, count)[1:].tolist():
        u = first.u.copy()
        u[:-2] *= math.sqrt(energy / start)
        line.points.append(problem.recalled(u, energy, (False, False)))
    return line


class Rows:
    """What is kept of points, and the result that is made of it.

    Parameters
    ----------
    system : FreeSystem
    refine, stability : bool
        Whether frequencies are solved for with half the step too, and multipliers computed.
    damped, interactions : bool
        With the model's damping; into interactions.
    """

    def __init__(self, system: FreeSystem, refine: bool, stability: bool, damped: bool, interactions: bool):
        self.system, self.refine, self.stability = system, refine, stability
        self.damped, self.interactions = damped, interactions
        self.first: Point | None = None

    def tell(self, point: Point) -> None:
        """Note what is kept of a point."""
        state, first = point.state, self.first or point
        if first is not point and self.system.reduced.homogeneous:  # one motion times a factor
            factor = float(np.linalg.norm(state.state) / np.linalg.norm(first.state.state))
            scaled = ("point_harmonics", "point_amplitudes")
            point.told = first.told | {name: factor * first.told[name] for name in scaled}
            point.told["states"] = state.state
            return
        values = free_multipliers(state, damped=self.damped) if self.stability else np.zeros(0, complex)
        self.first, own, changed = first, _numbers(state), np.full(3, np.nan)
        found = own.copy()
        # where half the step leads elsewhere the point stays as it is, with an error that is not known
        with contextlib.suppress(SolveError):
            if self.refine:
                difference = _numbers(self._finer(point)) - own
                found, changed = own + 4.0 / 3.0 * difference, np.abs(difference)
        u = state.seen()[0]
        point.told = {
            "states": state.state,
            "point_harmonics": np.moveaxis(one_sided(u)[: HARMONICS + 1], 0, -1),
            "point_amplitudes": 0.5 * np.ptp(u[..., -1], axis=0),
            "multipliers": values,
            **dict(zip(("frequency", "damping_ratio", "energy_damping_ratio"), found)),
            **dict(zip(("frequency_error", "damping_error", "energy_damping_error"), changed)),
            "excitation": state.excitation,
            "own_frequency": state.frequency,
        }

    def _finer(self, point: Point) -> FreeState:
        """The same motion in half the step; that of closed faces by way of damped ones where it has to be."""
        finer = point.problem.finer(2)
        try:
            return finer.of_energy(point.u, point.value, point.linear).state
        except SolveError:
            if not self.system.reduced.homogeneous:
                raise
            return finer.system.around(point, ADDED).state

    def refine_line(self, line: Line, decades: float) -> None:
        """Further points where the branch bends, passes interactions or turns in energy."""

        def above() -> np.ndarray:
            """(1, n): frequencies above the lowest one, and their range: what curves over the energy show."""
            frequency = line.told("own_frequency")
            return (frequency - frequency.min() + np.ptp(frequency))[None]

        refine(line, lambda: np.log(line.values) / decades, above, self.tell)
        if self._passes:
            divide_interactions(line, self.tell)
        for before, point in reversed(folds(line)):
            nearest = min(abs(line.points[k].value - point.value) for k in (before, before + 1))
            if nearest > NEXT * point.value:
                self.tell(point)
                line.points.insert(before + 1, point)

    @property
    def _passes(self) -> bool:
        """Whether interactions are looked for: with damping there are none."""
        return not (self.damped or self.interactions or self.system.reduced.homogeneous)

    def finished(self, line: Line) -> Backbone:
        """The result with what lies between its points."""
        result = self.backbone(line)
        if self.system.reduced.homogeneous:
            return result
        return replace(
            result,
            passed=interactions_of(line) if self._passes else result.passed,
            events=free_events(line, damped=self.damped, stability=self.stability),
        )

    def backbone(self, line: Line) -> Backbone:
        """The result as it is."""
        steps = zip(line.points, line.points[1:])
        return Backbone(
            **line.columns,
            mode=self.system.mode + 1,
            energy=line.values,
            passed=tuple((one.value, other.value) for one, other in steps if other.leapt),
            events=(),
            damped=self.damped,
            reason=line.reason or "unfinished",
            complete=line.complete,
            reduced=self.system.reduced,
            steps=self.system.steps,
        )


def _numbers(state: FreeState) -> np.ndarray:
    """(3,): frequency and both damping ratios."""
    return np.array([state.frequency, state.damping_ratio, state.energy_damping_ratio])


# ---------------------------------------------------------------------- the first motion
def first_motion(system: FreeSystem, energy: float) -> Point:
    """The free motion of the followed mode at an energy, J.

    Below the energy at which faces touch it is the mode itself. Above it the branch is followed up to there;
    where faces touch at rest, as those of a closed crack do, gaps are opened until the mode moves freely and
    brought down again.

    Raises
    ------
    SolveError
        If the way there ends before.
    """
    r, k = system.reduced, system.mode
    sign, touching = system.open_side()
    guess = float(r.frequencies[k]), 2.0 * float(r.damping[k]) * r.omega[k]
    low = energy if energy < touching or system.pairs == 0 else 0.9 * touching
    if not low > 0.9e-12 * energy:
        return _from_opened_gaps(system, energy, sign, guess)
    first = system.motion(system.linear(low, sign), *guess, low)
    if low == energy:
        return first
    first.problem = FreeMotions(system, (0.5 * low, energy), interactions=False)
    line = follow(Line([first]), Range(0.5 * low, energy, 1), PACE)
    if line.points[-1].value == energy:
        return line.points[-1]
    raise SolveError(
        f"backbone: the branch of mode {k + 1} could not be followed from {low:.4g} J, where nothing "
        f"touches, to {energy:.4g} J: {line.reason}"
    )


def _from_opened_gaps(system: FreeSystem, energy: float, sign: float, guess: tuple[float, float]) -> Point:
    """From gaps between which the mode moves freely, lowered to the given ones, with damping that is taken
    away thereafter; the self-excitation makes up for it all the way.
    """
    r, k = system.reduced, system.mode
    moved = np.abs(r.gap.modes[:, k]) / system.weights[k]
    largest = float(moved.max(initial=0.0))
    if largest == 0.0:
        return system.motion(system.linear(energy, sign), *guess, energy)
    # a crack's opening grows with the root of the distance from its tip: its square is a notch's
    shape = math.sqrt(2.0 * energy) * moved * np.maximum(moved / largest, NEAR_TIP)

    def opened(share: float) -> FreeSystem:
        """With damping besides, lest multiples of the frequency meet those of high modes."""
        other = replace(r, initial_gap=r.initial_gap + share * shape, damping=r.damping + ADDED)
        return FreeSystem(other, k, system.steps)

    share, fall = AJAR / max(float(moved.min()) / largest, NEAR_TIP), FALL
    there = opened(share)
    guess = guess[0], guess[1] + 2.0 * ADDED * r.omega[k]
    point = there.motion(there.linear(energy, sign), *guess, energy)
    while share > 0.0:
        lower = share / fall if share / fall >= LEAVE_OUT else 0.0
        try:
            point = opened(lower).again(point, energy)
        except SolveError:
            fall = math.sqrt(fall)
            if fall < SLOWEST:
                raise SolveError(
                    f"backbone: mode {k + 1} could not be followed from an opened crack to the given one "
                    f"beyond {share:.3g} of the opening in which it moves freely; try more steps or modes"
                ) from None
            continue
        share, fall = lower, min(FALL, fall**1.5)
    try:
        return system.without(point, ADDED)
    except SolveError as error:
        said = str(error).removeprefix("backbone: ")
        raise SolveError(
            f"backbone: mode {k + 1} is found at {point.state.frequency:.6g} Hz with a damping ratio of "
            f"{ADDED:g} added, but not without it ({said}), as where multiples of its frequency meet those "
            "of high modes; take damping=True, or other modes or steps"
        ) from None

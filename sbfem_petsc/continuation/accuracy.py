"""An accuracy that is asked for: more modes and steps where the told errors of harmonics are above it, and
what is said where these cannot be had.
"""

from __future__ import annotations

import contextlib
import functools
import math
from collections.abc import Callable
from dataclasses import replace
from typing import Generic, NamedTuple, Protocol, TypeVar

import numpy as np

from meshing.warnings import AccuracyWarning

from ..errors import SolveError, warn
from ..motion.contact_work import MOST
from ..motion.period_map import FixedPoint, Period
from ..motion.preparation import PeriodSettings
from ..progress import refused
from ..reduction.build import LEAST_MODES, MOST_MODES, modes_beyond, most_modes
from ..reduction.reduced_model import ReducedModel
from ..system.model import Model
from .harmonic_errors import added, harmonic_error_estimates
from .newton import attempt
from .orbit import LOWEST, largest_error
from .problems.driven_orbits import ParameterRange
from .search import NEWTON_ALONE, find_steady_state

# Of the highest frequency of the modes from one attempt to the next, by the error; the least share of it that
# is left to the steps, and the share that they may have; power of the modes by which errors fall at best.
LEAST_MORE, MOST_MORE, LEFT, OF_STEPS, FASTEST = 1.25, 2.5, 0.25, 0.6, 4.0
# Where faces rub, times the steps of a known motion up to which one near it that is lost is looked for in
# twice as many.
LOST = 2
# Times the first steps where nobody asked.
UNASKED = 4


Found = TypeVar("Found")


class Map(Protocol):
    """What a solution is found in, such as a `Period`."""

    @property
    def reduced(self) -> ReducedModel:
        """Its modes."""

    @property
    def told_steps(self) -> int:
        """Its steps, as `Words.each` counts them."""


Where = TypeVar("Where", bound=Map)


class Told(NamedTuple, Generic[Where, Found]):
    """A solution, where it was found, and (3, n) what is told of its errors, as by
    `harmonic_error_estimates`.
    """

    where: Where
    found: Found
    errors: np.ndarray


class Words(NamedTuple):
    """What is said of results that are less accurate: what has the error, what steps are counted in, what
    helps against theirs, and what becomes of one that is lost.
    """

    subject: str = "harmonics 1 to 4"
    each: str = " a forcing period"
    remedy: str = "give more than steps = {}"
    lost: str = "no motion is found near it"


HARMONICS = Words()


class Accuracy:
    """What is asked of harmonics 1 to 4, if anything, and which of modes and steps may grow: those that were
    not given, to `PeriodSettings.most` and `MOST` times the first steps. Where `MOST_MODES` are far from
    enough there are the usual ones.

    Parameters
    ----------
    owner : str
        The analysis, for messages.
    system : Model or ReducedModel
    settings : PeriodSettings
        With an accuracy, a user's or the default (`preparation.following`), or none.
    words : Words
    """

    def __init__(
        self, owner: str, system: Model | ReducedModel, settings: PeriodSettings, words: Words = HARMONICS
    ):
        self.owner, self.settings, self.words = owner, settings, words
        self.value = math.inf if settings.accuracy is None else settings.accuracy
        self.asked, self._vain = settings.most >= MOST_MODES, ""
        self._model = system if isinstance(system, Model) and settings.modes is None else None
        times = MOST if self.asked else UNASKED
        self._most_steps = times * settings.least if settings.steps is None else 0

    def met(self, errors: np.ndarray) -> bool:
        """Whether told errors, see `harmonic_error_estimates`, are within it."""
        return self.settings.accuracy is None or largest_error(errors.sum(axis=0)) <= self.value

    def reached(
        self,
        prepare: Callable[[PeriodSettings, Told[Where, Found] | None], Where],
        find: Callable[[Where, Told[Where, Found] | None], Told[Where, Found]],
        told: Told[Where, Found] | None = None,
        settings: PeriodSettings | None = None,
    ) -> Told[Where, Found]:
        """The solution in modes and steps in which it is accurate, or which may not grow. Where it is lost in
        fewer than the usual modes it is looked for in these; where it is lost, or has no memory, in more than
        it was found in, that one is kept, and the reason.

        Parameters
        ----------
        prepare : callable
            Where settings have it looked for, near one that is not accurate enough, if any; ValueError where
            there is no memory.
        find : callable
            The solution there, near that one.
        told : Told, optional
            The first one, if it is known.
        settings : PeriodSettings, optional
            To begin with. Default: those that are asked for, or what a first one calls for.
        """
        settings = settings or (self.settings if told is None else self._next(told))
        while settings is not None:
            where: Where | None = None
            try:
                where = prepare(settings, told)
                told = find(where, told)
            except (SolveError, ValueError) as error:
                if refused(error):
                    raise
                lost = where if isinstance(error, SolveError) else None
                if lost is not None and told is not None and self._trembles(lost, told):
                    settings = replace(settings, least=2 * lost.told_steps)
                    continue
                usual = None if lost is None else self._usual(lost)
                if usual is not None:
                    settings = replace(settings, modes=usual)
                    continue
                if told is None:
                    raise
                # further modes and steps are of no use: they do not grow any more
                self._model, self._most_steps = None, 0
                self._vain = str(error)
                if lost is not None:  # what is said of a solution that is not found again
                    modes, steps = lost.reduced.in_words, lost.told_steps
                    self._vain = f"{self.words.lost} in {modes} and {steps} steps{self.words.each}"
            settings = self._next(told)
        assert told is not None  # there are settings to begin with where none is known
        return told

    def _next(self, told: Told[Where, Found]) -> PeriodSettings | None:
        """Settings of the next attempt, None where there is to be none."""
        more = self.further(told.where.reduced, told.where.told_steps, told.errors)
        return None if more is None else replace(self.settings, modes=more[0], least=more[1])

    def _trembles(self, lost: Map, told: Told[Where, Found]) -> bool:
        """Whether a motion that is lost is to be looked for in twice the steps: where faces rub, changes
        between stick and slip leave the map of few steps kinks, on which Newton's method ends.
        """
        most = min(self._most_steps // 2, LOST * told.where.told_steps)
        return lost.reduced.friction is not None and lost.told_steps <= most

    def _usual(self, where: Map) -> int | None:
        """The usual modes, None where modes are given or are not fewer."""
        if self.settings.accuracy is None or self._model is None:
            return None
        usual = min(LEAST_MODES, most_modes(self._model))
        return usual if where.reduced.natural < usual else None

    def further(self, reduced: ReducedModel, steps: int, errors: np.ndarray) -> tuple[int | None, int] | None:
        """Modes, None where they were given, and steps a forcing period of the next attempt; None where told
        errors are within it or nothing may grow.
        """
        if self.settings.accuracy is None:
            return None
        modes = more = reduced.natural
        most = self._most_modes(modes)
        by_steps, late = largest_error(errors[1]), largest_error(errors[2:].sum(axis=0))
        # viscosity goes with what is left out, about as 1 / modes: where the most of them would leave too
        # much, nothing is to be far below it
        viscous = late * modes > self.value * most
        counted, wanted = (errors[:2], max(self.value, late)) if viscous else (errors, self.value)
        by_modes = largest_error(np.delete(counted, 1, axis=0).sum(axis=0))
        usual = min(LEAST_MODES, most)
        in_vain = not by_modes <= self._hoped(wanted, modes)
        if (viscous or in_vain) and modes < usual:
            return usual, steps
        if in_vain or largest_error(counted.sum(axis=0)) <= wanted:
            return None
        times, left, share, rubs = 1, wanted, 1.0, reduced.friction is not None
        if self._model is not None and by_modes > (1.0 - OF_STEPS) * wanted:
            top, power = reduced.frequencies[:modes].max(), 0.5 if rubs or not reduced.vectors else 0.25
            share = min(max((2.0 * by_modes / wanted) ** power, LEAST_MORE), MOST_MORE)
            beyond = modes_beyond(self._model, share * top, math.ceil(LEAST_MORE * modes))
            more = min(most, max(modes, min(self.settings.most, beyond)))
        if more == modes:
            left = min(wanted, max(2.0 * (wanted - by_modes), LEFT * wanted))
        elif rubs:  # more modes change sides in steps as much shorter, and those of few tell little of them
            left, by_steps = max(wanted, LEFT * by_modes), share * by_steps
        if by_steps > OF_STEPS * left or more == modes:
            times = self._more_steps(steps, by_steps / left)
        if more == modes and (times == 1 or by_modes > wanted):
            return None  # steps alone do not help
        return more if self._model is not None else self.settings.modes, times * steps

    def _more_steps(self, steps: int, above: float) -> int:
        """How many times the steps, whose error is so many times what is wanted."""
        times, needed = 1, math.sqrt(2.0 * above) if math.isfinite(above) else 2.0
        while times < needed and 2 * times * steps <= self._most_steps:
            times *= 2
        return times

    def _hoped(self, value: float, modes: int) -> float:
        """The error by modes from which the most of them may come to a value, at best."""
        return value * (self._most_modes(modes) / modes) ** FASTEST

    def _most_modes(self, modes: int) -> int:
        """How many there may be, where there are so many."""
        return modes if self._model is None else min(most_modes(self._model), max(MOST_MODES, modes))

    def tried(
        self, over: ParameterRange, period: Period, prepared: Callable[[PeriodSettings], Period]
    ) -> Period:
        """The map of a curve in whose modes and steps both ends and the linear peak are accurate, as far as
        Newton's method finds motions there at once.
        """
        for place in _places(over, period):
            with contextlib.suppress(SolveError):
                period = self.enough(over, place, _told(over, period, place), prepared)
        return period

    def told(self, over: ParameterRange, period: Period) -> float:
        """The largest told error at both ends and the linear peak, inf where Newton's method finds no motion
        at once, of which the owner's caller is warned if it is above the accuracy.
        """
        found = []
        for place in _places(over, period):
            with contextlib.suppress(SolveError):
                found.append(_told(over, period, place).errors)
        worst = max(
            found or [np.full((3, LOWEST), np.inf)], key=lambda errors: largest_error(errors.sum(axis=0))
        )
        self.tell(period, worst)
        return largest_error(worst.sum(axis=0))

    def enough(
        self,
        over: ParameterRange,
        value: float,
        told: Told[Period, FixedPoint],
        prepared: Callable[[PeriodSettings], Period],
        settings: PeriodSettings | None = None,
    ) -> Period:
        """The map in whose modes and steps, of some settings to begin with, a point of a curve is accurate;
        where Newton's method loses that point, the last one.
        """

        def found(period: Period, former: Told[Period, FixedPoint] | None) -> Told[Period, FixedPoint]:
            assert former is not None  # it grows from one
            driven, fixed = over.at(period, value), former.found
            state = driven.linear_state + added(fixed, period)
            newton = functools.partial(find_steady_state, driven, state, multiples=False, search=NEWTON_ALONE)
            again = attempt(newton, SolveError)
            if again is None:
                return Told(period, fixed, np.zeros_like(former.errors))
            return Told(period, again[0], harmonic_error_estimates(again[0]))

        return self.reached(lambda settings, _: prepared(settings), found, told, settings).where

    def missing(self, reduced: ReducedModel, steps: int, errors: np.ndarray) -> str:
        """What told errors above it, or none, mean; "" where they are within it."""
        if self.met(errors):
            return ""
        by_modes, by_steps = (largest_error(part) for part in errors[:2])
        if math.isnan(by_modes + by_steps):
            return (
                f"the error of {self.words.subject} is not told, as no point is named, the model was read "
                "from a file or there is no memory for more modes; name points of the mesh, or reduce the "
                "model again"
            )
        modes, late = reduced.natural, largest_error(errors[2:].sum(axis=0))
        if late > max(by_modes, by_steps):
            cause = f"viscous by Rayleigh's b of what is left out beyond {reduced.in_words}"
            remedy = "damp the modes, as damping does, or ask for less"
        elif by_modes >= by_steps:
            cause, remedy = f"left out beyond {reduced.in_words}", f"give more than modes = {modes}"
            if self._model is not None and modes >= most_modes(self._model):
                remedy = "refine the mesh, which has no further ones, or ask for less"
            elif modes < (most := self._most_modes(modes)) and not by_modes <= self._hoped(self.value, modes):
                more = "" if most == MOST_MODES else " or refine the mesh"
                remedy = f"ask for less{more}, as {most} modes would be far from it too"
            elif self._model is not None and not self.asked and modes < MOST_MODES:
                remedy = f"give accuracy = {self.value:g} for up to {self._most_modes(modes)}"
            elif self._vain:
                remedy = f"give a few more than modes = {modes}, or ask for less"
            elif self._model is None and self.settings.modes is None:
                remedy = "reduce the model to more modes"
        else:
            cause, remedy = f"lost in {steps} steps{self.words.each}", self.words.remedy.format(steps)
        worst, why = largest_error(errors.sum(axis=0)), self._vain and f" ({self._vain})"
        off = f"told to be {worst:.2g} off" if math.isfinite(worst) else "off by what is not found"
        asked = f"not within accuracy = {self.value:g}{'' if self.asked else ', the default'}"
        return f"{self.words.subject} are {off}, {asked}, most by what is {cause}{why}; {remedy}"

    def tell(self, where: Map, errors: np.ndarray) -> str:
        """Warn the owner's caller of told errors above it; what is missing of what was asked is returned."""
        missing = self.missing(where.reduced, where.told_steps, errors)
        if missing:
            warn(f"{self.owner}: {missing}", AccuracyWarning)
        return missing if self.asked else ""


def _places(over: ParameterRange, period: Period) -> list[float]:
    """Both ends of a range and the linear peak in it."""
    places = [over.start, over.stop]
    if over.name == "frequency":
        inside = [float(f) for f in period.reduced.frequencies if min(places) < f < max(places)]
        places += sorted(inside, key=lambda f: -period.at(f).oscillation)[:1]
    return list(filter(None, places))


def _told(over: ParameterRange, period: Period, place: float) -> Told[Period, FixedPoint]:
    """The motion that Newton's method finds at once there."""
    driven = over.at(period, place)
    fixed, _ = find_steady_state(driven, driven.linear_state, multiples=False, search=NEWTON_ALONE)
    return Told(period, fixed, harmonic_error_estimates(fixed))

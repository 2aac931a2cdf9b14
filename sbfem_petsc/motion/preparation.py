"""From a user's periodic loads to the period map of a reduced model."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Protocol

from ..checks import optional_integer, shown
from ..contact.friction import Friction
from ..errors import wrong_input
from ..ranks.capacity import require_compiler, require_memory
from ..ranks.parallel import collective
from ..reduction import build
from ..reduction.build import ACCURATE, LEAST_MODES, MOST_MODES, modes_for
from ..reduction.left_out import BEHIND
from ..reduction.reduced_model import ReducedModel, share_modes
from ..signals.waves import Harmonic
from ..system.model import Model
from ..system.solve.pencil import top_of_band
from .excitation import LINES, Excitation
from .loading import Loading, communicator, loading, warn_of_reduced
from .period_map import Period
from .step_plan import CONTACT_STEP, contact_steps, warn_if_coarse

# Steps a forcing period, and most forcing periods that a common period of tones is looked for in.
STEPS, LONGEST = 512, 64
# Default steps a period of the loads' highest frequency, with contact: with 64, 32, 16 of them the sidebands
# of a breathing crack are off by 6e-4, 1 %, 5 %.
FAST_STEPS = 32
# Boundary unknowns above which more than the usual modes are made for those alone who ask for them: 275 modes
# of a plate of 10,788, whose steps follow, take minutes.
LARGE = 5000
# Directions of contact at an instant that the derivative keeps: of some twenty rows about so many remain.
DIRECTIONS = 6


class Begun(Protocol):
    """A motion to begin from, such as an orbit."""

    @property
    def reduced(self) -> ReducedModel | None:
        """Its model, None where it was not reduced."""


@dataclass(frozen=True)
class PeriodSettings:
    """How the period of a steady state is integrated and shot at.

    Attributes
    ----------
    periods : int or None
        Forcing periods in one period of the motion; None: the fewest in which all tones fit.
    steps : int or None
        Time steps a forcing period; None: 512, or as many as keep the step below 0.8 of the shortest modal
        period and 1 / 32 of that of the loads' highest frequency.
    modes : int or None
        None: as many as the accuracy asks for; without one all modes up to 8 times the loads' highest
        frequency, at least 80.
    first : int or None
        Modes to begin with where they are not given, those of a motion to begin from; 0: the default.
    contact : bool
    jacobian : {"auto", "dense", "matrix-free", "differences"}
    longest : int
        Most forcing periods in a common period of tones.
    segments : int
        The default number of steps is such that the period's is a multiple of it.
    band : float or None
        Highest forcing frequency that the modes are to serve, Hz; None: the one of the period.
    accuracy : float or None
        Of harmonics 1 to 4: tells how many modes there are to begin with where they are not given.
    most : int
        Modes that it begins with at most, unless those up to 8 times the loads' highest frequency are more,
        and that it may grow to; fewer than `MOST_MODES` where nobody asked, and what is missing then blocks
        nothing.
    least : int
        Steps a forcing period at least where they are not given; 0: by default or as the accuracy asks for.
    vectors : bool or None
        Whether vectors behind the modes stand for further ones; None: where an accuracy chooses these. Along
        curves none do: they ring at each change of contact, which bends the curve; nor in sweeps, whose steps
        would follow them.
    """

    periods: int | None = None
    steps: int | None = None
    modes: int | None = None
    contact: bool = True
    jacobian: str = "auto"
    longest: int = LONGEST
    segments: int = 1
    band: float | None = None
    accuracy: float | None = None
    most: int = MOST_MODES
    least: int = 0
    first: int | None = None
    vectors: bool | None = None

    def __post_init__(self) -> None:
        if self.vectors is None and self.accuracy is not None:
            object.__setattr__(self, "vectors", self.modes is None)
        if not self.least:
            least = STEPS if self.accuracy is None else accurate_steps(self.accuracy)
            object.__setattr__(self, "least", least)


def following(
    settings: PeriodSettings, system: Model | ReducedModel, most: int = MOST_MODES
) -> PeriodSettings:
    """Settings that ask for an accuracy of 1e-3 by default, in so many modes at most: of a model whose modes
    and steps are left to us, and that has named points, without which no error is told. A model of more than
    `LARGE` boundary unknowns has no more than the usual modes.
    """
    left = settings.accuracy is None and settings.modes is None and settings.steps is None
    if not left or not isinstance(system, Model) or not system.points:
        return settings
    most = most if system.boundary_unknowns <= LARGE else LEAST_MODES
    return replace(settings, accuracy=ACCURATE, most=most, least=0)


def beginning(settings: PeriodSettings, guess: Begun | None) -> PeriodSettings:
    """Settings with the modes of a motion to begin from, where none are given."""
    if settings.first is not None or guess is None or guess.reduced is None:
        return settings
    own = settings.vectors is None and settings.modes is None
    vectors = guess.reduced.vectors > 0 if own else settings.vectors
    return replace(settings, first=guess.reduced.natural, vectors=vectors)


def expected(
    model: Model, frequency: float, highest: float, accuracy: float | None = None, vectors: bool = True
) -> tuple[int, int]:
    """Modes, with vectors behind them or without, and steps a forcing period (its frequency in Hz), that a
    steady state begins with by default, or for an accuracy, under loads up to a frequency (Hz). As many as
    the usual modes are not computed for it, and their steps are those of an upper estimate of their highest
    frequency. Collective.
    """
    settings = PeriodSettings(accuracy=accuracy) if accuracy else following(PeriodSettings(), model)
    accuracy = settings.accuracy or ACCURATE
    modes = modes_for(model, highest, accuracy, settings.most, vectors)
    if modes < LEAST_MODES:
        top = float(model.modes(modes).frequencies[-1])
    else:
        top = top_of_band(model.statics.elements, modes) / (2.0 * math.pi)
    top *= BEHIND.top if vectors else 1.0
    contact = top / (CONTACT_STEP * frequency) if len(model.contact) else 0.0
    return modes, max(
        accurate_steps(accuracy), math.ceil(contact), math.ceil(FAST_STEPS * highest / frequency)
    )


def accurate_steps(accuracy: float) -> int:
    """Steps a forcing period that an accuracy of harmonics asks for, to begin with: their error is of second
    order, and coarser ones ruin small harmonics.
    """
    return 64 * math.ceil(STEPS / 64 * math.sqrt(ACCURATE / accuracy))


def prepare(
    owner: str,
    system: Model | ReducedModel,
    load: Any,
    frequency: float,
    *,
    settings: PeriodSettings,
    guess: Begun | None = None,
) -> Period:
    """The period map of checked input. Collective.

    Parameters
    ----------
    owner : str
        The analysis, for messages.
    guess : Orbit, optional
        A motion to begin from, of the same model.
    """
    with collective(communicator(system)):
        loads, excitation = driving(owner, system, load, frequency, settings=settings)
    require_compiler(owner, communicator(system))
    unknown = any(signal.highest_frequency is None for signal in loads.signals)
    highest = max(frequency if unknown else 0.0, loads.highest_frequency)
    highest *= (settings.band or frequency) / frequency
    reduced = serving(owner, system, loads, settings, highest)
    with collective(communicator(system)):
        if guess is not None:
            check_guess(owner, guess, reduced, carried=True)
    excitation = excitation.moving(reduced, frequency)
    steps = steps_of(owner, reduced, settings, (frequency, loads.highest_frequency), "forcing period")
    if settings.steps is None:
        if len(excitation.orders) > LINES:  # none of them is to fold back
            steps = max(steps, math.ceil((2 * excitation.orders.max() + 1) / excitation.periods))
        multiple = settings.segments // math.gcd(settings.segments, excitation.periods)
        steps = multiple * math.ceil(steps / multiple)
    require_period(owner, reduced, steps * excitation.periods, len(excitation.orders), settings.contact)
    return Period(reduced, excitation, steps * excitation.periods, settings.contact)


def serving(
    owner: str, system: Model | ReducedModel, loads: Loading, settings: PeriodSettings, highest: float
) -> ReducedModel:
    """The reduced model for an analysis under loads up to a frequency, Hz: the system itself, or one made of
    the model and kept there. Collective.
    """
    if isinstance(system, ReducedModel):
        if settings.modes is not None:
            raise wrong_input(
                f"{owner}: modes = {shown(settings.modes)} has no meaning beside a reduced model; reduce it "
                "to so many modes"
            )
        warn_of_reduced(owner, system, loads, highest)
        return system
    modes = settings.first or None if settings.modes is None else settings.modes
    with collective(system.comm):
        optional_integer(owner, "modes", modes, least=1, most=system.boundary_unknowns // 2)
    system.require_support(f"{owner} of the reduced model")
    # what has no known band shakes vectors as well, which answer as modes do below their own band alone
    known = all(signal.highest_frequency is not None for signal in loads.signals)
    vectors = bool(settings.vectors) and known
    if modes is None and settings.accuracy is not None:
        modes = modes_for(system, highest if known else 0.0, settings.accuracy, settings.most, vectors)
    result = build.reduced(system, loads.units, modes or build.default_modes(system, highest), vectors)
    warn_of_reduced(owner, result, loads, highest)
    return result


def steps_of(
    owner: str, reduced: ReducedModel, settings: PeriodSettings, frequencies: tuple[float, float], period: str
) -> int:
    """Time steps in a period of a frequency, Hz, under loads up to another one; the owner's caller is warned
    of few that are given. `period` says which it is.
    """
    frequency, fastest = frequencies
    contact, steps = settings.contact and len(reduced.initial_gap) > 0, settings.steps
    if steps is None:
        fast = math.ceil(FAST_STEPS * fastest / frequency)
        return max(settings.least, contact_steps(reduced, frequency), fast) if contact else settings.least
    if contact:
        warn_if_coarse(owner, steps, frequency, fastest, period=period)
    return steps


def driving(
    owner: str, system: Model | ReducedModel, load: Any, frequency: float, *, settings: PeriodSettings
) -> tuple[Loading, Excitation]:
    """A user's loads, checked, and what they are over a common period; ValueError for a prescribed
    displacement that jumps. Not collective.
    """
    loads = loading(owner, system, load, lambda value: Harmonic(value, frequency))
    excitation = Excitation.of(loads.signals, frequency, settings.periods, settings.longest)
    if excitation.jumps is not None:
        for k in loads.edges:
            loads.require_continuous(owner, k, bool(excitation.jumps.sizes[:, k].any()))
    return loads, excitation


def period_memory(reduced: ReducedModel, steps: int, orders: int, contact: bool = True) -> float:
    """Bytes of the motion over a period of so many steps and of its derivative, while contact acts at half of
    the instants; `orders` are the multiples of the base frequency in the loads.
    """
    modes, rows = len(reduced.omega), len(reduced.initial_gap) if contact else 0
    # two motions, the linear one and its gaps; the rows that are condensed for the derivative
    motion = 6 * modes + 6 * rows + 8 * min(orders, LINES)
    return 8.0 * steps * (motion + 0.5 * min(rows, DIRECTIONS) * 7 * modes)


def require_period(owner: str, reduced: ReducedModel, steps: int, orders: int, contact: bool) -> None:
    """Refuse a period whose motion and derivative would take more memory than is free. Collective.

    Raises
    ------
    ValueError
        On all ranks.
    """
    require_memory(
        owner,
        reduced.comm,
        period_memory(reduced, steps, orders, contact),
        f"{steps:,d} steps a period of {reduced.in_words}",
        lambda share: "give fewer steps or modes, or use static for so slow a load",
    )


def finer(owner: str, period: Period, times: int) -> Period:
    """A period in so many times the steps, if there is room for it. Collective.

    Raises
    ------
    ValueError
        On all ranks.
    """
    steps, orders = times * period.steps, len(period.excitation.orders)
    require_period(owner, period.reduced, steps, orders, period.pairs > 0)
    return period.in_steps(steps)


def check_reduction(owner: str, reduction: object, model: object) -> None:
    """Raise TypeError unless it is "modes" or None; ValueError for None beside a reduced model."""
    if reduction is not None and not (isinstance(reduction, str) and reduction == "modes"):
        raise TypeError(
            f"{owner}: reduction = {shown(reduction)} must be 'modes' or None; a reduced model is given in "
            "the place of the model"
        )
    if reduction is None and not isinstance(model, Model):
        raise ValueError(f"{owner}: reduction = None needs the model itself, not a reduced one")


def require_unreduced(
    owner: str,
    model: Model | ReducedModel,
    given: Mapping[str, Any],
    taken: Mapping[str, tuple[Any, ...]],
) -> None:
    """Raise ValueError where something is given that motions of an unreduced model do not have: arguments by
    their names, and the values that are taken of them, of others None.
    """
    model.require_frictionless(f"{owner} of the unreduced model")
    for name, value in given.items():
        if value not in taken.get(name, (None,)):
            raise ValueError(
                f"{owner}: {name} = {shown(value)} is for the reduced model; the unreduced one, reduction = "
                "None, is shot at from its linear response, without a matrix, in the steps given, with its "
                "own damping and gaps, and has no multipliers (what the steps do not resolve keeps its size "
                "and would be the largest): leave it out"
            )


def tells_stability(owner: str, period: Period, asked: bool | None) -> bool:
    """Whether multipliers are computed; raise ValueError where they are asked for in vain: where friction
    falls as a slip begins, an instant that moves with the state, they are not those of steps that keep it.
    """
    if asked and period.jumps:
        raise wrong_input(
            f"{owner}: stability = True, and friction falls where a slip begins, as static_friction is "
            "more than friction; steps do not tell such multipliers: leave it out, and follow a history "
            "by transient"
        )
    return asked is not False and not period.jumps


def refuse_falling(owner: str, friction: Friction | None) -> None:
    """Raise ValueError, on all ranks, where friction falls as a slip begins: of motions whose periods differ
    nothing tells which rows slip on into the next one.
    """
    if friction is not None and friction.falls:
        raise wrong_input(
            f"{owner}: friction falls where a slip begins, as static_friction is more than friction, and "
            "a row that slips is to go on slipping in the next period, which is another one here; leave "
            "static_friction out, or follow a history by transient"
        )


def check_guess(owner: str, guess: Begun, reduced: ReducedModel, carried: bool = False) -> None:
    """A motion's state has a meaning in the modes of its own model alone, of which it may be carried to
    others.
    """
    if guess.reduced is None:
        raise ValueError(f"{owner}: the motion to begin from is that of an unreduced model")
    same = guess.reduced is reduced or (
        guess.reduced.model is not None
        and guess.reduced.model is reduced.model
        and (carried or share_modes(guess.reduced, reduced))
    )
    if not same:
        raise ValueError(
            f"{owner}: the motion to begin from belongs to another model or another number of modes "
            f"({guess.reduced.in_words}, not {reduced.in_words}); give one of the same model, modes = "
            f"{guess.reduced.natural}, or its reduced model in the place of the model"
        )

"""Steady states of two tones whose frequencies need no common multiple: vibro-acoustic modulation as it is
measured, and motions whose second tone is their own.
"""

from __future__ import annotations

import functools
import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from meshing.warnings import StepWarning

from ..checks import Bounds, instance, numbers_of, real
from ..continuation.accuracy import Accuracy, Told, Words
from ..continuation.harmonic_errors import in_modes
from ..continuation.orbit import LOWEST
from ..continuation.problem import Point
from ..continuation.problems.curve_system import require_room, resampled
from ..continuation.problems.own_tone import OwnTone, curve_near
from ..continuation.problems.tones import (
    EXPONENTS,
    TURNS,
    QuasiPeriodic,
    motion_of,
    own_curve,
    own_motion,
    warn_if_unresolved,
)
from ..continuation.problems.torus import Torus, exponents, line_error_estimates
from ..errors import failed_solve, warn
from ..motion.contact_work import MOST, times_more, warn_of_contact_work
from ..motion.excitation import Excitation
from ..motion.loading import Loading, communicator, loading
from ..motion.preparation import (
    PeriodSettings,
    beginning,
    check_guess,
    following,
    prepare,
    refuse_falling,
    serving,
    steps_of,
)
from ..motion.two_tones import drives, highest, tone
from ..ranks.capacity import require_compiler
from ..ranks.parallel import collective
from ..reduction.build import MOST_OF_MANY
from ..reduction.reduced_model import ReducedModel
from ..system.model import Model
from .analysis import analysis
from .options import QuasiPeriodicOptions

# What an accuracy is of, in sentences.
LINES = Words("lines m f1 + n f2 with |m| + |n| = 1 to 4", " a period of the faster tone")
_Told = Told[Torus, Point]


@analysis(QuasiPeriodicOptions, rubs=True)
def quasi_periodic(
    model: Model | ReducedModel,
    load,
    frequencies: tuple[float, float | None],
    *,
    samples: int = 21,
    steps: int | None = None,
    modes: int | None = None,
    guess: QuasiPeriodic | None = None,
    stability: bool = True,
    accuracy: float | None = None,
) -> QuasiPeriodic:
    """Find the steady response to two tones of any frequencies by shooting of an invariant curve; or to one,
    with a second tone that is the motion's own.

    The trajectories from the samples are shared by the model's ranks.

    Parameters
    ----------
    model : Model or ReducedModel
    load : PointForce, EdgeLoad, SupportMotion, EdgeMotion, a sum or a sequence of them
        For a ReducedModel a signal for each unit load.
        Made of `Harmonic` signals at f1, f2 or multiples of either; `Constant` signals are preloads. With one
        tone as for `periodic`.
    frequencies : (float, float or None)
        f1, f2, Hz; in the usual words the probe and the pump. None: the second tone is the motion's own, of
        unknown frequency; such a motion leaves a branch at a Neimark-Sacker point (`switch_branch`).
    samples : int
        Phases of the slower tone: multiples up to half as many are resolved. Contact makes multiples of the
        loads' ones; a warning tells if not even the second of the highest is among those, and if the result
        says that they were not enough (`QuasiPeriodic.tail`).
    steps : int, optional
        Time steps in a period of the faster tone; a warning tells of fewer than 20 in a period of the highest
        multiple among the loads. Default: 512, or as many as keep the step below 0.8 of the shortest modal
        period and 1 / 32 of that of the highest multiple; they are halved, and the motion is found again,
        where contact does too much work in them (see `periodic`), but those of `guess` are kept where the
        second tone is the motion's own.
    modes : int, optional
        Default: as for `periodic`.
    guess : QuasiPeriodic, optional
        A motion to begin from, of the same model. Default: the linear response. Where the
        second tone is the motion's own: one of that kind, with f1 near its.
    stability : bool
        Compute the largest Lyapunov exponents.
    accuracy : float, optional
        Of the lines m f1 + n f2 with |m| + |n| = 1 to 4 of the named points, `largest_mode_error`: modes and
        steps that are not given are as many as that needs, see `periodic`. The motion is found twice more,
        in twice the steps and in half as many modes again. Of two given tones; of the samples it knows
        nothing, `tail` does. Default: as for `periodic`, in 160 modes at most.

    Raises
    ------
    ValueError, TypeError
        For input that makes no sense, a tone that belongs to neither frequency is named; if it would take
        more memory than is free; and for friction that falls where a slip begins (`static_friction`).
    SolveError
        If Newton's method does not converge, neither from the first guess nor behind a history of the curve.

    Warns
    -----
    AccuracyWarning
        If the told error is above `accuracy` in the modes or steps given, or in as many as there may be.
    StepWarning
        If contact is possible and the samples or the steps given are few for the loads' multiples; if the
        samples do not resolve the motion; if contact does much work in the steps.
    """
    comm = communicator(model)
    with collective(comm):
        if guess is not None:
            instance("quasi_periodic", "guess", guess, QuasiPeriodic, "an earlier result of quasi_periodic")
        asked = _checked(frequencies, samples, guess)
    if isinstance(asked, float):
        if accuracy is not None:
            raise ValueError(
                f"quasi_periodic: accuracy = {accuracy:g} is for two given tones; where the second one is "
                "the motion's own its errors are not told: leave it out"
            )
        assert guess is not None  # checked
        settings = PeriodSettings(steps=steps, modes=modes)
        found = _with_own_tone(model, load, asked, guess, (settings, samples, stability))
        warn_if_unresolved("quasi_periodic", found)
        return found
    frequencies = asked
    with collective(comm):
        loads = loading("quasi_periodic", model, load, tone)
        swapped = frequencies[1] > frequencies[0]
        ordered = frequencies[::-1] if swapped else frequencies
        driven = drives(loads.signals, ordered)
    tones = _TwoTones(model, loads, driven, ordered, samples)
    settings = PeriodSettings(None, steps, modes, accuracy=accuracy)
    settings = beginning(following(settings, model, MOST_OF_MANY), guess)
    aim = Accuracy("quasi_periodic", model, settings, LINES)
    torus, point, errors = aim.reached(tones.prepared, functools.partial(tones.found, settings, guess))
    aim.tell(torus, errors)
    growth, curve = np.zeros(0), point.state
    if stability:
        growth = exponents(curve.maps(smooth=True), torus.rotation, EXPONENTS, TURNS) * ordered[0]
    told = curve.told(growth, ordered[0]) | {"swapped": swapped, "mode_error": errors.sum(axis=0)}
    told |= {"fast_loads": driven[0], "slow_loads": driven[1]}
    found = motion_of(point, frequencies, torus.linear, **told)
    warn_if_unresolved("quasi_periodic", found)
    return found


class _TwoTones(NamedTuple):
    """What is looked for, whatever the modes and steps."""

    model: Model | ReducedModel
    loads: Loading
    driven: tuple[Excitation, Excitation]
    frequencies: tuple[float, float]
    samples: int

    def prepared(self, settings: PeriodSettings, near: _Told | None) -> Torus:
        """The map in the modes and steps of settings. Collective."""
        what, fastest = "quasi_periodic", highest(self.driven, self.frequencies)
        reduced = serving(what, self.model, self.loads, settings, fastest)
        refuse_falling(what, reduced.friction)
        steps = self._steps(reduced, settings)
        require_compiler(what, self.model.comm)
        return self._torus(reduced, steps)

    def found(
        self, settings: PeriodSettings, guess: QuasiPeriodic | None, torus: Torus, near: _Told | None
    ) -> _Told:
        """The invariant curve of a map near the differences of another one to the linear response, and the
        error that is told of its lines, nan where no accuracy is asked for. Collective.
        """
        states = None
        if near is not None:
            states = in_modes(near.found.state.states - near.where.linear, near.where.reduced, torus.reduced)
        elif guess is not None:
            with collective(self.model.comm):
                check_guess("quasi_periodic", guess, torus.reduced, carried=True)
            states = resampled(in_modes(guess.states, guess.reduced, torus.reduced), self.samples)
        steps, most = torus.period.steps, MOST if settings.steps is None else 1
        torus, point = self._solved(torus, states, most * steps)
        errors = np.full((1, LOWEST), np.nan)
        if settings.accuracy is not None:
            errors = line_error_estimates(torus, point, self._torus)
        return Told(torus, point, errors)

    def _torus(self, reduced: ReducedModel, steps: int) -> Torus:
        """The map in so many steps, if there is room for it."""
        comm, orders = self.model.comm, max(len(drive.orders) for drive in self.driven)
        require_room("quasi_periodic", reduced, comm, samples=self.samples, steps=steps, orders=orders)
        return Torus(reduced, self.driven, self.frequencies, samples=self.samples, steps=steps, comm=comm)

    def _solved(self, torus: Torus, states: np.ndarray | None, most: int) -> tuple[Torus, Point]:
        """The map, of so many steps at most, and its invariant curve near a guess. Collective."""
        while True:
            point = torus.solve(states if states is None else states + torus.linear)
            count, work = torus.period.steps, torus.contact_work(point.state.motions)
            times = times_more(work, count, most)
            if times == 1:
                warn_of_contact_work("quasi_periodic", work, count)
                return torus, point
            states = point.state.states - torus.linear
            torus = self._torus(torus.reduced, times * count)

    def _steps(self, reduced: ReducedModel, settings: PeriodSettings) -> int:
        """Time steps in a period of the faster tone; a warning where they or the samples given are few."""
        (fast, slow), order = self.frequencies, int(self.driven[1].orders.max())
        if len(reduced.initial_gap) and self.samples // 2 < 2 * order:
            warn(
                f"quasi_periodic: {self.samples} samples resolve multiples up to {self.samples // 2} of "
                f"{slow:g} Hz, of which the loads have multiple {order}; at least {4 * order + 1} are "
                "advisable",
                StepWarning,
            )
        fastest = highest(self.driven, self.frequencies)
        return steps_of("quasi_periodic", reduced, settings, (fast, fastest), "period of the faster tone")


def _checked(frequencies, samples: int, guess: QuasiPeriodic | None) -> tuple[float, float] | float:
    """Both frequencies, or the first one where the second is the motion's own."""
    what = "quasi_periodic"
    if isinstance(frequencies, (list, tuple)) and len(frequencies) == 2 and frequencies[1] is None:
        first = real(what, "frequencies[0]", frequencies[0], within=Bounds(above=0.0))
        if guess is None or guess.own is None:
            raise ValueError(
                f"{what}: a motion with a tone of its own, frequencies = ({first:g}, None), needs one to "
                "begin from, guess = switch_branch(branch, bifurcation) at a Neimark-Sacker point"
            )
        if samples % 2 == 0:
            raise ValueError(
                f"{what}: samples = {samples} must be odd where the second tone is the motion's own"
            )
        return first
    pair = numbers_of(
        what, "frequencies", frequencies, 2, "two numbers, (f1, f2), Hz", within=Bounds(above=0.0)
    )
    if pair[0] == pair[1]:
        raise ValueError(f"{what}: both frequencies are {pair[0]:g} Hz; use periodic for one tone")
    if guess is not None and guess.own is not None:
        raise ValueError(
            f"{what}: guess has a tone of its own; give frequencies = ({pair[0]:g}, None), or another guess"
        )
    return pair[0], pair[1]


# Swing of a curve, relative to that of the one it was looked for from, of which rounding alone is left.
SHRUNK = 1e-6


def _with_own_tone(
    model: Model | ReducedModel,
    load,
    first: float,
    begin: QuasiPeriodic,
    wanted: tuple[PeriodSettings, int, bool],
) -> QuasiPeriodic:
    """The motion with a tone of its own near another one: settings, samples and whether the exponents are
    wanted.
    """
    assert begin.own is not None  # the caller has asked
    settings, samples, stability = wanted
    comm, old = communicator(model), begin.own.period
    periods = old.excitation.periods
    settings = replace(settings, periods=periods, steps=settings.steps or old.steps // periods)
    if settings.modes is None and isinstance(model, Model):
        settings = replace(settings, modes=begin.reduced.natural, vectors=begin.reduced.vectors > 0)
    period = prepare("quasi_periodic", model, load, first * periods, settings=settings)
    refuse_falling("quasi_periodic", period.friction)
    with collective(comm):
        if period.unknowns != begin.states.shape[1]:
            raise ValueError(
                "quasi_periodic: guess belongs to another model or number of modes "
                f"({begin.reduced.in_words}, not {period.reduced.in_words}); give one of the same model"
            )
    own = OwnTone(period, "frequency", None, samples, comm)
    known = resampled(begin.states + begin.own.driven(own_curve(begin)[-1]).linear_state, samples)
    u = np.append(known.ravel(), [begin.frequencies[1] / begin.frequencies[0], first * periods])
    swing = float(np.linalg.norm(known - known.mean(axis=0))) / math.sqrt(samples)
    point = curve_near(own, u)
    if point.state.swing < SHRUNK * swing:
        raise failed_solve(
            f"quasi_periodic: at {first:g} Hz the iteration ends at the periodic motion, which has no tone "
            "of its own; take a frequency nearer to that of guess, or quasi_periodic_response"
        )
    return own_motion(point, stability)

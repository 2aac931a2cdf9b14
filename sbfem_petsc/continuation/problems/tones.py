"""Steady states of two tones and their lines."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np

from meshing.warnings import StepWarning

from ...checks import integer
from ...errors import warn
from ...motion.excitation import Excitation
from ...motion.states import Point
from ...record.record import derived, described, quantity
from ...reduction.reduced_model import OfReduced, ReducedModel
from ...system.elements.plausibility import furthest_of_lines
from ...system.fields.places import checked_place
from ..orbit import UNASKED, ToldError, component, in_words, told_error
from ..problem import Point as CurvePoint
from .curve import RESOLVED, CurveState, spectral_tail
from .curve_system import tangents
from .own_tone import Curves, OwnTone, strays
from .torus import Torus, exponents

# Lyapunov exponents that are followed, and turns of the map they are averaged over.
EXPONENTS, TURNS = 4, 400
# A history that strays so far, in its swings, from a curve that is said to attract it refutes the curve: 0.03
# is the farthest that samples and steps explained, 0.1 the least where a tone locked.
STRAYED = 0.05
# A number of turns that is whole but for rounding.
WHOLE = 1e-9


@described
class QuasiPeriodic(ToldError, OfReduced):
    """A steady state of two tones: u = Re sum c_mn exp(2 pi i (m f1 + n f2) t).

    Where f2 is the motion's own, f1 is the inverse of the period of the motion it leaves, f2 is below f1, and
    `own` is the map whose invariant curve this is. Of the Lyapunov exponents, which are empty if they were
    not asked for, the one along the second tone's phase, zero, is left out; they are nan where they would say
    that a motion with a tone of its own attracts others, and a history from it leaves it.
    """

    labels: ClassVar = {"place": "points", "tone": "tones"}
    coordinates: ClassVar = ("multiple", "frequency")
    tones = "f1", "f2"  # their names

    frequencies: tuple[float, float] = quantity("Hz", "f1 and f2", "tone", least=1e-300)
    samples: int = quantity("1", "phases of the slower tone", least=3)
    steps: int = quantity("1", "time steps in a period of the faster tone", least=1)
    reduced: ReducedModel = quantity(text="the reduced model", part="ReducedModel", detail=True)
    states: np.ndarray = quantity(
        "m sqrt(kg)/s",
        "differences (Omega q, q') to the linear response at the beginning of a period of the faster tone, "
        "and of slips just before it to those at rest, over the root of their compliance",
        "sample state",
        detail=True,
    )
    residuals: tuple[float, ...] = quantity(
        "1", "of Newton's method, relative to the linear response", "iterate"
    )
    exponents: np.ndarray = quantity("1/s", "largest Lyapunov exponents", "exponent", finite=False)
    contact_peak: float = quantity("N", "contact resultant of largest modulus", row=True)
    lines: np.ndarray = quantity(
        "m",
        "amplitudes at multiples 0 to 20 of the faster tone plus those, about 0, of the slower one",
        "fast slow place xy",
        kinds="c",
        detail=True,
        repr=False,
    )
    swapped: bool = quantity("1", "whether f2 is the faster tone", default=False, detail=True, repr=False)
    load_factor: float = quantity("1", "factor on the oscillating loads", default=1.0, least=0.0)
    own: OwnTone | None = quantity(
        text="the map, where the second tone is the motion's own",
        part="OwnTone",
        default=None,
        detail=True,
        repr=False,
    )
    fast_loads: Excitation | None = quantity(
        text="loads of the faster tone and constant ones, where both tones are given",
        part="Excitation",
        default=None,
        detail=True,
        repr=False,
    )
    slow_loads: Excitation | None = quantity(
        text="those of the slower tone",
        part="Excitation",
        dims="order:slow_order",
        default=None,
        detail=True,
        repr=False,
    )
    friction_power: float | None = quantity(
        "W", "mean power lost to friction, where faces rub", kinds="f", default=None, least=0.0, row=True
    )
    sticking: int | None = quantity(
        "1", "slips that stick throughout, on which the motion depends", kinds="iu", default=None, least=0
    )
    mode_error: np.ndarray = told_error(
        "the lines m f1 + n f2, |m| + |n| = 0 to 4, of the named points", ", the largest of each such order"
    )

    def check(self) -> None:
        """Raise ValueError unless curve, lines and model belong together."""
        modes, places = len(self.reduced.omega), len(self.points)
        slips = len(self.reduced.initial_gap) - self.reduced.gaps
        lines = 2 * (self.samples // 2) + 1, places, self.reduced.points.modes.shape[1]
        if (
            self.states.shape != (self.samples, 2 * modes + slips)
            or self.lines.shape[1:] != lines
            or not len(self.lines)
            or len(self.frequencies) != 2
            or (self.own is not None and self.own.samples != self.samples)
        ):
            raise ValueError(
                f"{self.samples} samples, {modes} modes and {places} points do not fit states of shape "
                f"{self.states.shape} and lines of shape {self.lines.shape}"
            )
        if (self.own is None) == (self.fast_loads is None or self.slow_loads is None):
            raise ValueError("a motion of two tones has the loads of both, or a tone of its own")

    @derived("1", "whether disturbances die out, where that is known", row=True)
    def stable(self) -> bool | None:
        """Whether disturbances die out; None if the exponents were not asked for, or if the second tone is
        the motion's own and the samples do not resolve it (`resolved`).
        """
        if not len(self.exponents) or (self.own is not None and not self.resolved):
            return None
        return bool(self.exponents[0] < 0.0)

    @derived("1", "share of the highest quarter of the harmonics of the samples", row=True)
    def tail(self) -> float:
        """Share (0 to 1) of what the slower tone's phase changes in the differences to the linear response
        that is in the highest quarter of the harmonics of the samples, in the norm of the energy.

        Harmonics of a curve that its samples resolve fall; where the highest are not small, those beyond
        them are missing, or the curve has none to end with: a tone that locks makes it a staircase.
        """
        return spectral_tail(self.states)

    @derived("1", "whether the samples resolve the motion")
    def resolved(self) -> bool:
        """Whether `tail` is at most 0.01 and the exponents, if asked for, are numbers.

        Also where the map takes samples to samples: given tones with a common period of as many periods of
        the faster one as there are samples, or of a part of those. Nothing is interpolated then.
        """
        slow, fast = sorted(self.frequencies)
        turns = self.samples * slow / fast
        among = self.own is None and abs(turns - round(turns)) <= WHOLE * turns
        return among or (self.tail <= RESOLVED and not np.isnan(self.exponents).any())

    @derived("1", "multiples of the slower tone in the lines", "slow", kinds="i", detail=True)
    def orders(self) -> np.ndarray:
        """(k,): multiples of the slower tone in `harmonics`."""
        return np.arange(self.lines.shape[1]) - self.lines.shape[1] // 2

    @property
    def _listed(self) -> np.ndarray:
        """(k, 2): multiples of the faster and the slower tone of all lines, by frequency; of a line and its
        mirror image, which begin with 0, the one whose frequency is positive.
        """
        fast, slow = np.meshgrid(np.arange(len(self.lines)), self.orders, indexing="ij")
        found = np.column_stack([fast.ravel(), slow.ravel()])
        found = found[(found[:, 0] > 0) | (found[:, 1] >= 0)]
        pair = np.array(self.frequencies[::-1] if self.swapped else self.frequencies)
        return found[np.argsort(np.abs(found @ pair), kind="stable")]

    @derived("1", "m and n of each line m f1 + n f2", "line tone", called="multiple", kinds="i", stored=False)
    def line_multiples(self) -> np.ndarray:
        """(k, 2): for tables."""
        return self._listed[:, ::-1] if self.swapped else self._listed

    @derived("Hz", "frequency of each line", "line", called="frequency", stored=False)
    def line_frequencies(self) -> np.ndarray:
        """(k,): for tables."""
        return np.abs(self.line_multiples @ np.array(self.frequencies))

    @derived("m", "amplitude of u_y of each line", "line place", called="amplitude", kinds="c", stored=False)
    def line_amplitudes(self) -> np.ndarray:
        """(k, points): for tables."""
        fast, slow = self._listed.T
        return self.lines[fast, slow + self.lines.shape[1] // 2, :, -1]

    def _furthest(self, least: float = 0.0) -> float:
        """Largest displacement of a named point by its lines, m; less than `least` where that is known to be
        so.
        """
        return furthest_of_lines(np.moveaxis(self.lines, (2, 3), (0, 1)), least)

    def harmonics(self, point: Point, direction: str = "y") -> np.ndarray:
        """(21, k) complex: amplitudes at the multiples 0 to 20 of the faster tone plus those of `orders` of
        the slower one, m. At a place (x, y), m, the motion is integrated again. Collective for (x, y).
        """
        if not isinstance(point, str):
            place = checked_place("harmonics", point)
            found = self._at_place(place, lambda of: self._curve().lines(of)[:, :, 0])
            return component(found, direction, self.of_rows)
        return component(self.lines[:, :, self._index(point)], direction, self.of_rows)

    def _curve(self) -> CurveState:
        """The invariant curve, to be integrated again."""
        if self.own is not None:
            u = own_curve(self)
            return Curves(self.own, u).at(u)
        assert self.fast_loads is not None and self.slow_loads is not None  # checked
        torus = Torus(
            self.reduced,
            (self.fast_loads, self.slow_loads),
            self.frequencies[::-1] if self.swapped else self.frequencies,
            samples=self.samples,
            steps=self.steps,
            comm=self.reduced.comm,
        )
        return torus.at(np.append((self.states + torus.linear).ravel(), 0.0))

    def line(self, m: int, n: int, point: Point, direction: str = "y") -> complex:
        """Complex amplitude at m f1 + n f2, m; at (0, 0) the mean. Of points see `harmonics`.

        Raises
        ------
        ValueError
            If the line is beyond what the samples and steps resolve.
        """
        m, n = integer("line", "m", m), integer("line", "n", n)
        fast, slow = (n, m) if self.swapped else (m, n)
        lines = self.harmonics(point, direction)
        if fast < 0 or (fast == 0 and slow < 0):
            return np.conj(self.line(-m, -n, point, direction))
        middle = lines.shape[1] // 2
        if fast >= len(lines) or abs(slow) > middle:
            raise ValueError(
                f"line ({m}, {n}) is not resolved: {self.samples} samples and {self.steps} steps give "
                f"multiples up to {len(lines) - 1} of the faster tone and {middle} of the slower one"
            )
        return complex(lines[fast, middle + slow])

    def modulation_index(self, point: Point, direction: str = "y") -> float:
        """(|c_1,1| + |c_1,-1|) / |c_1,0|: sidebands of the first tone over itself."""
        sidebands = sum(abs(self.line(1, n, point, direction)) for n in (1, -1))
        return sidebands / abs(self.line(1, 0, point, direction))

    def __repr__(self) -> str:
        unknown = UNASKED if self.resolved else "not resolved by its samples"
        verdict = {True: "stable", False: "unstable", None: unknown}[self.stable]
        born = " (its own)" if self.own is not None else ""
        if self.friction_power is not None:
            verdict += f", {self.friction_power:.6g} W lost to friction"
        if self.sticking:
            verdict += f", {self.sticking} slips stick throughout and depend on where the search began"
        return (
            f"QuasiPeriodic({self.frequencies[0]:.6g} and {self.frequencies[1]:.6g} Hz{born}, {self.samples} "
            f"samples, {self.steps} steps, {self.reduced.in_words}, {len(self.residuals) - 1} "
            f"Newton iterations, {in_words(self.mode_error)}{verdict}, peak contact "
            f"resultant {self.contact_peak:.6g} N)"
        )


def motion_of(
    point: CurvePoint, frequencies: tuple[float, float], linear: np.ndarray, **told: Any
) -> QuasiPeriodic:
    """The motion of an invariant curve beside a linear response's state, with what `CurveState.told` and
    others tell of it.
    """
    problem, states = point.problem, point.state.states - linear
    period = problem.period
    facts = problem.samples, period.steps, period.reduced, states, point.residuals
    return QuasiPeriodic(frequencies, *facts, **told)


def own_motion(point: CurvePoint, stability: bool) -> QuasiPeriodic:
    """The motion of an invariant curve with a tone of its own, a point of `Curves`. Collective."""
    state, own = point.state, point.problem.tone
    driven = own.driven(state.value)
    first = 1.0 / driven.duration
    if state.recorded is None:  # else of a former run
        growth = np.zeros(0)
        if stability:
            maps, along = state.linearised(smooth=True)[0].maps, tangents(state.states)
            growth = exponents(maps, state.rotation, EXPONENTS, TURNS, along) / driven.duration
            if growth[0] * driven.duration * TURNS < -1.0 and strays(point, TURNS) > STRAYED:
                growth = np.full_like(growth, np.nan)
        state.recorded = state.told(growth, first)
    told = {"load_factor": driven.factor, "own": own.at(point.value), **state.recorded}
    return motion_of(point, (first, state.rotation * first), driven.linear_state, **told)


def attracts(motion: QuasiPeriodic) -> bool:
    """Whether a motion's exponents say that it attracts histories within their length."""
    return bool(len(motion.exponents) and motion.exponents[0] * TURNS < -motion.frequencies[0])


def own_curve(motion: QuasiPeriodic) -> np.ndarray:
    """The unknowns of the invariant curve of a motion with a tone of its own: samples, rotation and value."""
    own, first = motion.own, motion.frequencies[0]
    assert own is not None  # the caller has asked
    if own.parameter == "frequency":
        value = first * own.period.excitation.periods
    else:
        value = getattr(own, own.parameter)
    states = motion.states + own.driven(value).linear_state
    return np.append(states.ravel(), [motion.frequencies[1] / first, value])


def warn_if_unresolved(owner: str, found: QuasiPeriodic) -> None:
    """Warn the owner's caller of a curve that its samples do not resolve."""
    if found.resolved:
        return
    missing = (
        f"{found.tail:.2g} of its change with the {'second' if found.own is not None else 'slower'} tone is "
        f"in the highest quarter of their harmonics, more than {RESOLVED:g}; lines may be off by as much, "
        "small ones by more"
        if found.tail > RESOLVED
        else "a history from it leaves it, though its exponents are negative"
    )
    text = (
        f"{owner}: {found.samples} samples do not resolve the motion: {missing}: take more, "
        f"samples={2 * found.samples - found.samples % 2}, or more steps"
    )
    if found.own is not None:
        text += "; if that does not help the tone locks, see periodic(..., periods=n)"
    warn(text, StepWarning)

"""Steady states of two tones and their lines."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from typing import ClassVar

import numpy as np

from meshing.warnings import StepWarning

from ...checks import integer
from ...errors import at_point, caller_level, on_all_ranks
from ...motion.excitation import Excitation
from ...motion.period_map import Period
from ...motion.period_motion import PeriodMotion
from ...motion.states import Point
from ...petsc import MPI
from ...record.record import Record, derived, described, quantity
from ...reduction.outputs import LinearOutput
from ...reduction.reduced_model import ReducedModel
from ...system.elements.plausibility import furthest_of_lines
from ...system.fields.places import checked_place
from ..orbit import LOWEST, component, in_words, largest_error
from ..problem import Point as CurvePoint
from .curve import RESOLVED, CurveState, spectral_tail
from .curve_system import tangents
from .own_tone import Curves, OwnTone, strays
from .torus import exponents

# Multiples of the first tone of which lines are kept.
LINES = 20
# Instants at which displacements are looked at together.
INSTANTS = 512
# Lyapunov exponents that are followed, and turns of the map they are averaged over.
EXPONENTS, TURNS = 4, 400
# A history that strays so far, in its swings, from a curve that is said to attract it refutes the curve: 0.03
# is the farthest that samples and steps explained, 0.1 the least where a tone locked.
STRAYED = 0.05
# A number of turns that is whole but for rounding.
WHOLE = 1e-9


@described
class QuasiPeriodic(Record):
    """A steady state of two tones: u = Re sum c_mn exp(2 pi i (m f1 + n f2) t).

    Where f2 is the motion's own, f1 is the inverse of the period of the motion it leaves, f2 is below f1, and
    `own` is the map whose invariant curve this is. Of the Lyapunov exponents, which are empty if they were
    not asked for, the one along the second tone's phase, zero, is left out; they are nan where they would say
    that a motion with a tone of its own attracts others, and a history from it leaves it.
    """

    labels: ClassVar = {"place": "points", "tone": "tones"}
    coordinates: ClassVar = ("multiple", "frequency")

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
    contact_peak: float = quantity("N", "largest contact resultant", least=0.0, row=True)
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

    friction_power: float | None = quantity(
        "W", "mean power lost to friction, where faces rub", kinds="f", default=None, least=0.0, row=True
    )
    sticking: int | None = quantity(
        "1", "slips that stick throughout, on which the motion depends", kinds="iu", default=None, least=0
    )

    mode_error: np.ndarray = quantity(
        "1",
        "error of the lines m f1 + n f2, |m| + |n| = 0 to 4, of the named points by left-out modes and the "
        "steps, the largest of each such order; inf where it is not found, nan where no accuracy was asked "
        "for",
        "low_harmonic",
        finite=False,
        default_factory=lambda: np.full(LOWEST, np.nan),
    )

    @derived("1", "largest error of such lines, each by its order", row=True, finite=False)
    def largest_mode_error(self) -> float:
        """Largest of `mode_error[k] / k`."""
        return largest_error(self.mode_error)

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

    @property
    def points(self) -> tuple[str, ...]:
        """Named points."""
        return self.reduced.points.names

    @property
    def tones(self) -> tuple[str, str]:
        """Names of the tones."""
        return "f1", "f2"

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

    @derived(
        "m",
        "amplitude of u_y of each line",
        "line place",
        called="amplitude",
        kinds="c",
        stored=False,
    )
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
        the slower one, m. Of a motion with a tone of its own also at a place (x, y), m, for which it is
        integrated again. Collective for (x, y).
        """
        if not isinstance(point, str):
            return component(self._lines_at(checked_place("harmonics", point)), direction)
        index = at_point({name: k for k, name in enumerate(self.points)}, point)
        return component(self.lines[:, :, index], direction)

    def _lines_at(self, place: tuple[float, float]) -> np.ndarray:
        """(21, k, 2) lines at a place, kept for the next time. Collective."""
        if self.own is None:
            raise on_all_ranks(
                TypeError(
                    f"harmonics: point = {place} must be the name of a point: of motions under two given "
                    "tones no others are kept; name further ones by points= of the mesh"
                )
            )
        known = self.__dict__.setdefault("_places", {})
        if place not in known:
            found, u = self.reduced.output_at("displacement", place), own_curve(self)
            alone = LinearOutput((), found.modes[None], found.loads[None], found.contact[None])
            known[place] = _own_lines(self.own, Curves(self.own, u).at(u), alone)[:, :, 0]
        return known[place]

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
        unknown = "stability not asked for" if self.resolved else "not resolved by its samples"
        verdict = {True: "stable", False: "unstable", None: unknown}[self.stable]
        born = " (its own)" if self.own is not None else ""
        if self.friction_power is not None:
            verdict += f", {self.friction_power:.6g} W lost to friction"
        if self.sticking:
            verdict += f", {self.sticking} slips stick throughout and depend on where the search began"
        return (
            f"QuasiPeriodic({self.frequencies[0]:.6g} and {self.frequencies[1]:.6g} Hz{born}, {self.samples} "
            f"samples, {self.steps} steps, {len(self.reduced.omega)} modes, {len(self.residuals) - 1} "
            f"Newton iterations, {in_words(self.mode_error)}{verdict}, peak contact "
            f"resultant {self.contact_peak:.6g} N)"
        )


def tone_lines(
    period: Period,
    motions: Sequence[PeriodMotion | None],
    rotation: float,
    linear: Sequence[tuple[Excitation, np.ndarray]],
    comm: MPI.Comm,
    points: LinearOutput | None = None,
) -> np.ndarray:
    """(21, k, points, 2) lines of all named points, m. Collective.

    Parameters
    ----------
    period : Period
        Of the faster tone.
    motions : sequence of PeriodMotion or None
        From each of the samples; this rank's.
    rotation : float
        Turns of the slower tone in a period of the faster one.
    linear : sequence of (Excitation, (k, m) array)
        Loads of the faster tone, and of the slower one, with the modal amplitudes of the linear response.
    comm : MPI.Comm
        Ranks that share the samples.
    points : LinearOutput, optional
        Others than the named ones.
    """
    points, samples = points or period.reduced.points, len(motions)
    steps, half = period.steps, samples // 2
    lines = min(LINES, steps // 2 - 1)
    orders, seen = np.arange(-half, half + 1), points.modes.shape[:2]
    found = np.zeros((lines + 1, len(orders), *seen), dtype=complex)
    mine = [(i, motion) for i, motion in enumerate(motions) if motion is not None]
    over_samples = np.exp(-2j * np.pi * orders[:, None] * [i for i, _ in mine] / samples) / samples
    for begin in range(0, steps if mine else 0, INSTANTS):
        part = slice(begin, min(begin + INSTANTS, steps))
        u = np.array([_moved(points, period.pairs, motion, part) for _, motion in mine])
        # the slower tone's lines over the samples at each instant, then the faster one's over the instants
        slow = np.tensordot(over_samples, u, axes=1)
        share = np.arange(part.start, part.stop) / steps
        forward = np.exp(-2j * np.pi * np.arange(lines + 1)[:, None] * share) / steps
        for j, order in enumerate(orders):
            turned = np.exp(-2j * np.pi * order * rotation * share)[:, None] * slow[j]
            found[:, j] += (forward @ turned).reshape(-1, *seen)
    comm.Allreduce(MPI.IN_PLACE, found)
    found *= 2.0
    found[0, half] *= 0.5
    if samples % 2 == 0:  # both ends of the range are the same harmonic of the samples
        found[:, [0, -1]] *= 0.5
    for tone, (drive, amplitudes) in enumerate(linear):
        response = np.einsum("pim,km->kpi", points.modes, amplitudes)
        response += np.einsum("pil,kl->kpi", points.loads, drive.amplitudes)
        for order, value in zip(drive.orders, response):
            place = (order, half) if tone == 0 else (0, half + order)
            if place[0] <= lines and place[1] < len(orders):
                found[place] += value
    return found


def _moved(points: LinearOutput, pairs: int, motion: PeriodMotion, part: slice) -> np.ndarray:
    """(n, 2 points): displacements of points at some instants, without the linear response."""
    u = np.einsum("pim,nm->npi", points.modes, motion.states[part], optimize=True)
    u += np.einsum("pic,nc->npi", points.contact[..., :pairs], motion.forces[part], optimize=True)
    return u.reshape(len(u), -1)


def _own_lines(own: OwnTone, state: CurveState, points: LinearOutput | None = None) -> np.ndarray:
    """`tone_lines` of a motion with a tone of its own. Collective."""
    driven = own.driven(state.value)
    linear = ((own.period.excitation.scaled(driven.factor), driven.amplitudes),)
    return tone_lines(own.period, state.motions, state.rotation, linear, own.comm, points)


def own_motion(point: CurvePoint, stability: bool) -> QuasiPeriodic:
    """The motion of an invariant curve with a tone of its own, a point of `Curves`. Collective."""
    state, own = point.state, point.problem.tone
    driven = own.driven(state.value)
    lines = _own_lines(own, state)
    growth = np.zeros(0)
    if stability:
        maps, along = state.linearised(smooth=True)[0].maps, tangents(state.states)
        growth = exponents(maps, state.rotation, EXPONENTS, TURNS, along) / driven.duration
        if growth[0] * driven.duration * TURNS < -1.0 and strays(point, TURNS) > STRAYED:
            growth = np.full_like(growth, np.nan)
    refuted = bool(np.isnan(growth).any())  # a file holds finite numbers
    rubbed = state.rubbed(1.0 / driven.duration).values()
    numbers = [state.peak, float(refuted), *rubbed], np.zeros(len(growth)) if refuted else growth
    parts = (point.residuals, *numbers, np.ascontiguousarray(lines).view(float).ravel())
    state.recorded = np.concatenate([[len(part) for part in parts], *parts])
    return recorded_motion(point)


def attracts(motion: QuasiPeriodic) -> bool:
    """Whether a motion's exponents say that it attracts histories within their length."""
    return bool(len(motion.exponents) and motion.exponents[0] * TURNS < -motion.frequencies[0])


def recorded_motion(point: CurvePoint) -> QuasiPeriodic:
    """The same of what is told of it already (`CurveState.recorded`)."""
    state, own = point.state, point.problem.tone
    driven = own.driven(state.value)
    sizes, first = state.recorded[:4].astype(int), 1.0 / driven.duration
    residuals, (peak, refuted, *rubbed), growth, lines = np.split(state.recorded[4:], np.cumsum(sizes)[:-1])
    seen = own.period.reduced.points.modes.shape[:2]
    return QuasiPeriodic(
        (first, state.rotation * first),
        own.samples,
        own.period.steps,
        own.period.reduced,
        state.states - driven.linear_state,
        tuple(residuals.tolist()),
        np.full_like(growth, np.nan) if refuted else growth,
        float(peak),
        lines.view(complex).reshape(-1, 2 * (own.samples // 2) + 1, *seen),
        load_factor=driven.factor,
        own=own.at(point.value),
        friction_power=rubbed[0] if rubbed else None,
        sticking=int(rubbed[1]) if rubbed else None,
    )


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
    warnings.warn(text, StepWarning, stacklevel=caller_level())

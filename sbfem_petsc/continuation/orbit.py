"""Steady states: periodic motions and what they are asked."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from dataclasses import field
from typing import Any

import numpy as np

from ..checks import choice, instance
from ..contact.law import peak_of
from ..errors import SolveError, called, failed_solve, wrong_input
from ..motion.excitation import one_sided
from ..motion.history import Motion
from ..motion.period_map import DrivenPeriod, FixedPoint
from ..motion.period_motion import PeriodMotion
from ..motion.states import ModalStates, Point
from ..record.record import Record, derived, described, quantity
from ..reduction.reduced_model import OfReduced, ReducedModel
from ..system.elements.plausibility import furthest_of_lines
from .multipliers import FLOOR, multipliers_of
from .shooting import WHOLE, shoot

# Modulus' distance from one beyond which the steps' error is not asked for: of 300 random masses with stops
# in 256 steps it was at most 0.021.
NEAR = 0.05
# Uncertainty relative to the change in twice the steps: all of an error of second order, 4/3, and a quarter
# more for where in a step pairs switch, which scatters. Of those motions it was between half and ten times
# the error in all but two.
SAFETY = 5.0 / 3.0
# Harmonics whose error is told, the mean among them.
LOWEST = 5
# Of stability, in the words of results.
UNASKED = "stability not asked for"
# Harmonics that are kept in files and tables beside the motion itself.
HARMONICS = 41
# Unit and words of a motion's state.
STATE = (
    "m sqrt(kg)/s",
    "(Omega q, q') at t = 0, and what faces that rub remember: slips over the root of their compliance",
)


def told_error(what: str, where: str = "") -> Any:
    """A field of errors by left-out modes and the steps, see `harmonic_error_estimates`."""
    return quantity(
        "1",
        f"error of {what} by left-out modes and the steps{where}; inf where it is not found, nan where it is "
        "not told",
        "low_harmonic",
        finite=False,
        default_factory=lambda: np.full(LOWEST, np.nan),
    )


class ToldError(Record):
    """A result with `mode_error`."""

    mode_error: np.ndarray

    @derived("1", "largest error of orders 1 to 4, each by its order", row=True, finite=False)
    def largest_mode_error(self) -> float:
        """Largest of `mode_error[k] / k`."""
        return largest_error(self.mode_error)


@described
class Orbit(Motion, ToldError):
    """A periodic motion; its instants are the equal steps of one period, the end left out.

    `path` is how it was reached: "Newton", "history" (some periods integrated before it), "ramp of the load",
    "ramp of the damping", "neighbouring frequency", "multiple shooting", "point of a curve" or "period
    doubling". `uncertainty` is `multiplier_error`, or what computes it when it is first asked for. State and
    multipliers are empty for an unreduced model. Where faces rub their slips at the instant before t = 0 are
    part of the state; slips that stick throughout the period keep what the search came upon, and have no part
    in the stability.
    """

    frequency: float = quantity("Hz", "forcing frequency f", least=1e-300)
    periods: int = quantity("1", "forcing periods in one period of the motion", least=1)
    residuals: tuple[float, ...] = quantity(
        "m sqrt(kg)/s", "norm of x(T) - x(0) at each Newton iterate", "iterate"
    )
    path: str = quantity(text="how it was reached")
    state: np.ndarray = quantity(*STATE, "state", detail=True, default_factory=lambda: np.zeros(0))
    multipliers: np.ndarray = quantity(
        "1",
        "Floquet multipliers over the motion's period, by falling modulus",
        "multiplier",
        kinds="cf",
        default_factory=lambda: np.zeros(0, dtype=complex),
    )
    uncertainty: float | Callable[[], float] = field(default=math.nan, compare=False)
    products: int = quantity(
        "1", "linearised periods integrated for the linear solves of an unreduced model", default=0
    )
    converged: bool = quantity("1", "whether it is one", default=True, row=True)
    step_error: float = quantity(
        "1", "relative change of the displacements from half as many steps", finite=False, default=math.nan
    )
    friction_loss: float | None = quantity(
        "J",
        "lost to friction over `periods` periods of the loads, where faces rub",
        kinds="f",
        default=None,
        row=True,
    )
    sticking: int | None = quantity(
        "1", "slips that stick throughout the period, on which the motion depends", kinds="iu", default=None
    )
    mode_error: np.ndarray = told_error("harmonics 0 to 4 of the named points and of the contact resultant")

    @property
    def iterations(self) -> int:
        """Newton iterations of the last solve."""
        return len(self.residuals) - 1

    @property
    def period(self) -> float:
        """s."""
        return self.periods / self.frequency

    @derived(
        "1",
        "uncertainty of the largest modulus of the multipliers by the steps",
        back=True,
        finite=False,
        kept=True,
    )
    def multiplier_error(self) -> float:
        """Uncertainty of the largest modulus of the multipliers by the steps, 5/3 of its change in twice as
        many; of left-out modes it knows nothing. nan if no motion is found in these. It takes two to three
        times as long as the multipliers themselves, so it is computed when it is first asked for; the verdict
        of a motion whose largest modulus is further than 0.05 from 1 does without.
        """
        return self.uncertainty() if callable(self.uncertainty) else self.uncertainty

    @classmethod
    def _revived(cls, found: dict[str, Any]) -> Any:
        """From a file: the uncertainty as a number."""
        return cls(**found | {"uncertainty": found.pop("multiplier_error")})

    def check(self) -> None:
        """Raise ValueError unless state and periods fit the instants."""
        super().check()
        size = 2 * self.states.q.shape[1] if isinstance(self.states, ModalStates) else 0
        if self.sticking is not None and self.reduced is not None:
            size += len(self.reduced.initial_gap) - self.reduced.gaps
        if len(self.state) != size or self.periods > len(self.time):
            raise ValueError(f"a state of {len(self.state)} numbers and {self.periods} periods do not fit")

    @derived(
        "m",
        "complex harmonics of the displacement, the mean first",
        "harmonic place xy",
        called="harmonics",
        kinds="c",
    )
    def point_harmonics(self) -> np.ndarray:
        """(41 at most, points, 2): of the named points."""
        u = self.point_displacements
        flat = [one_sided(column)[:: self.periods][:HARMONICS] for column in u.reshape(len(u), -1).T]
        return np.array(flat).T.reshape(-1, *u.shape[1:]) if flat else np.zeros((0, 0, 2), dtype=complex)

    @derived("m", "half the peak-to-peak of u_y", "place", called="amplitude", row=True)
    def point_amplitudes(self) -> np.ndarray:
        """(points,): of the named points."""
        return 0.5 * np.ptp(self.point_displacements[..., -1], axis=0)

    def __getstate__(self) -> dict[str, Any]:
        """What is pickled or copied: the uncertainty as a number."""
        return {**self.__dict__, "uncertainty": self.multiplier_error}

    @derived("1", "whether small disturbances die out, where that is known", row=True)
    def stable(self) -> bool | None:
        """Whether small disturbances die out: no multiplier outside the unit circle; None if the uncertainty
        does not allow a verdict, or there are no multipliers (not asked for, of an unreduced model, or
        friction that falls as a slip begins).
        """
        if not len(self.multipliers):
            return None
        largest = float(np.abs(self.multipliers[0]))
        return verdict_of(largest, 0.0 if abs(largest - 1.0) > NEAR else self.multiplier_error)

    def spectrum(self, point: Point, direction: str = "y") -> np.ndarray:
        """Complex amplitudes at the multiples of f / periods: u(t) = Re sum_j a_j exp(i 2 pi j f t /
        periods), a_0 the mean.
        """
        return one_sided(component(self.states.displacement(point), direction, self.of_rows))

    def harmonics(self, point: Point, direction: str = "y") -> np.ndarray:
        """Complex amplitudes at the multiples of f: u(t) = Re sum_k c_k exp(i 2 pi k f t), c_0 the mean,
        m.
        """
        return self.spectrum(point, direction)[:: self.periods]

    def subharmonics(self, point: Point, direction: str = "y") -> np.ndarray:
        """(periods,) complex amplitudes at j f / periods, j = 0 .. periods - 1; beside the mean, zero unless
        the motion truly takes several forcing periods.
        """
        return self.spectrum(point, direction)[: self.periods]

    def amplitude(self, point: Point, direction: str = "y") -> float:
        """Half the peak-to-peak of the displacement of a point, m."""
        return 0.5 * float(np.ptp(component(self.states.displacement(point), direction, self.of_rows)))

    def __repr__(self) -> str:
        verdict = why_undecided(self.reduced)
        if len(self.multipliers):
            verdict = {True: "stable", False: "unstable", None: "stability undecided"}[self.stable]
            verdict += f" (largest multiplier {np.abs(self.multipliers[0]):.7f})"
        model = self.reduced.in_words if self.reduced is not None else "unreduced model"
        if self.friction_loss is not None:
            over = f"{self.periods} periods" if self.periods > 1 else "a period"
            verdict += f", {self.friction_loss:.6g} J lost to friction in {over}"
        if self.sticking:
            verdict += (
                f", {self.sticking} slips stick throughout and have no part in that: the motion depends on "
                "them, and they on where the search began"
            )
        return (
            f"Orbit(at {self.frequency:.6g} Hz, {self.periods} forcing period{'s' * (self.periods > 1)}, "
            f"{len(self.time)} steps, {model}, {self.states.pairs} pairs, {self.iterations} Newton "
            f"iterations, {in_words(self.mode_error)}{verdict}, peak contact resultant "
            f"{'; '.join([f'{peak_of(self.contact_resultant):.6g} N', *self._borne(), *self.notes])})"
        )


def why_undecided(reduced: ReducedModel | None) -> str:
    """Why motions of a model tell no multipliers, in words."""
    if reduced is None:
        return "stability not computed"
    friction = reduced.friction
    if friction is not None and (friction.static > friction.kinetic).any():
        return "stability not told, as friction falls where a slip begins"
    return UNASKED


@described
class OfOrbits(OfReduced):
    """A branch of motions, and what they are asked at a point. Those kept are of named points, amplitudes of
    u_y; for others each motion is integrated again from its state.
    """

    states: np.ndarray = quantity(*STATE, "point state", detail=True)
    point_harmonics: np.ndarray = quantity(
        "m",
        "harmonics 0 to 20 of the displacement",
        "point place xy harmonic",
        called="harmonics",
        kinds="c",
        detail=True,
    )
    point_amplitudes: np.ndarray = quantity(
        "m", "half the peak-to-peak of u_y", "point place", called="amplitude", least=0.0
    )
    multipliers: np.ndarray = quantity(
        "1", "Floquet multipliers, by falling modulus", "point multiplier", kinds="c", detail=True
    )

    def orbit(self, k: int) -> Orbit:
        """The k-th motion."""
        raise NotImplementedError

    def amplitude(self, point: Point, direction: str = "y") -> np.ndarray:
        """(n,): half the peak-to-peak of the displacement of a named point, or of any point (x, y) in m, in
        m. Collective for (x, y).
        """
        if isinstance(point, str):
            index = self._index(point)
            if isinstance(direction, str) and direction == "y":
                return self.point_amplitudes[:, index]
        count = len(self.point_amplitudes)
        return np.array([self.orbit(k).amplitude(point, direction) for k in range(count)])

    def harmonics(self, point: Point, direction: str = "y") -> np.ndarray:
        """(n, 21) complex: harmonics 0 to 20 of the displacement of a named point, or of any point (x, y) in
        m, in m. Collective for (x, y).
        """
        if isinstance(point, str):
            return component(self.point_harmonics[:, self._index(point)], direction, self.of_rows, 1)
        found = np.zeros((len(self.point_harmonics), self.point_harmonics.shape[-1]), dtype=complex)
        for k, row in enumerate(found):
            values = self.orbit(k).harmonics(point, direction)[: len(row)]
            row[: len(values)] = values
        return found

    def _furthest(self, least: float = 0.0) -> float:
        """Largest displacement of a named point by its harmonics, m; less than `least` where that is known to
        be so.
        """
        return furthest_of_lines(self.point_harmonics[..., None], least)


def require_at(owner: str, name: str, orbit: object, frequency: float, periods: int | None = None) -> None:
    """Raise unless an argument of that name, if it is given, is an orbit at a frequency, Hz, and of so many
    periods.
    """
    if orbit is None:
        return
    known: Orbit = instance(owner, name, orbit, Orbit, "an Orbit")
    if abs(known.frequency - frequency) > 1e-9 * frequency:
        raise ValueError(f"{owner}: {name} is at {known.frequency:.9g} Hz, not at {frequency:.9g} Hz")
    if periods not in (None, known.periods):
        raise ValueError(f"{owner}: {name} takes {known.periods} forcing periods, not periods = {periods}")


# Multipliers, and the uncertainty of the largest modulus or what computes it; none.
Stability = tuple[np.ndarray, float | Callable[[], float]]
UNTOLD: Stability = (np.zeros(0, dtype=complex), math.nan)


def orbit_stability(fixed: FixedPoint) -> Stability:
    """Multipliers of an orbit, and what computes the uncertainty of the largest modulus."""
    values = multipliers_of(fixed).values
    return values, functools.partial(multiplier_error, fixed, values[0])


def multiplier_error(fixed: FixedPoint, value: complex) -> float:
    """Uncertainty of the largest modulus, that of `value`, by the same motion in twice the steps; nan if
    there is none.
    """
    period = fixed.driven.period
    try:
        near = fixed.monodromy if period.unknowns <= WHOLE else None
        other = shoot(fixed.driven.in_steps(2 * period.steps), fixed.state, near=near)
    except SolveError:
        return math.nan
    return uncertainty_of(abs(value) - abs(multipliers_of(other).values[0]))


def uncertainty_of(change: float) -> float:
    """Of the largest modulus, by its change in twice the steps."""
    return max(FLOOR, SAFETY * abs(change))


def largest_error(error: np.ndarray) -> float:
    """What of the errors of harmonics 1, 2, ... is compared with an accuracy: the largest of them, each
    divided by its order.
    """
    return float((error[1:] / np.arange(1, len(error))).max())


def in_words(error: np.ndarray) -> str:
    """That in a result's text."""
    largest = largest_error(error)
    if math.isinf(largest):
        return (
            "error of harmonics not found, as twice the steps or more modes lead elsewhere or have no part "
            "in it, "
        )
    return "" if math.isnan(largest) else f"error of harmonics {largest:.2g}, "


def verdict_of(largest: float, error: float) -> bool | None:
    """Whether a motion is stable by its largest modulus, None if that is nearer to 1 than its error; what
    only rounding tells from 1 is not outside the unit circle.
    """
    if largest > 1.0 + error:
        return False
    return True if largest + error <= 1.0 + 2.0 * FLOOR else None


def modal_motion(driven: DrivenPeriod, motion: PeriodMotion) -> tuple[np.ndarray, np.ndarray]:
    """Modal displacement and velocity, (n + 1, m) each: the linear steady state and what contact adds."""
    p = driven.period
    q = p.over_time(driven.amplitudes) + motion.states
    v = p.over_time(driven.speeds * driven.amplitudes) + motion.velocities
    if p.excitation.jumps is not None or p.excitation.further is not None:
        # at jumps, where they add up, lines that hardly move the modes are 1e-2 of the velocities
        impulses = driven.excitation.impulses(p.steps)
        v += driven.duration * impulses @ p.reduced.load_modes.T
    return q, v


def _edge_rates(driven: DrivenPeriod) -> np.ndarray | None:
    """(n, 2 edges): rates and accelerations of prescribed displacements over the period."""
    edges, count = driven.period.reduced.edges, driven.period.steps
    if not len(edges):
        return None
    lines = np.fft.rfft(driven.loads[:-1, edges], axis=0)
    speeds = 2j * np.pi / driven.duration * np.arange(len(lines))[:, None]
    return np.concatenate([np.fft.irfft(speeds**k * lines, count, axis=0) for k in (1, 2)], axis=1)


def run_again(driven: DrivenPeriod, state: np.ndarray) -> FixedPoint:
    """A periodic motion that is known by its state."""
    motion = driven.run(state)
    return FixedPoint(state, driven, motion, (float(np.linalg.norm(motion.residual)),))


def make_orbit(
    fixed: FixedPoint, path: str, stability: Stability = UNTOLD, error: np.ndarray | None = None
) -> Orbit:
    """An `Orbit` from a fixed point."""
    driven, motion, p = fixed.driven, fixed.motion, fixed.driven.period
    rubs = p.friction is not None
    q, v = modal_motion(driven, motion)
    forces = np.zeros((p.steps, len(p.reduced.initial_gap)))
    forces[:, : p.pairs] = motion.forces[:-1]
    if not (np.isfinite(q).all() and np.isfinite(forces).all()):
        raise failed_solve(
            f"{called()}: the motion leaves the range of numbers; are the loads of usual size, in N and Pa?"
        )
    return Orbit(
        np.arange(p.steps) * driven.step,
        ModalStates(q[:-1], v[:-1], driven.loads[:-1], forces, p.reduced, _edge_rates(driven)),
        driven.frequency,
        p.excitation.periods,
        fixed.residuals,
        path,
        fixed.state,
        *stability,
        friction_loss=float(motion.lost.sum()) if rubs else None,
        sticking=int(motion.stays(len(p.laws)).sum()) if rubs else None,
        mode_error=np.full(LOWEST, np.nan) if error is None else error,
    )


def component(array: np.ndarray, direction: str, of_rows: bool, axis: int = -1) -> np.ndarray:
    """Of displacements along an axis of x and y; of rows, which are one number each, that."""
    k = ("y", "x").index(choice("harmonics", "direction", direction, ("x", "y")))
    if k and of_rows:
        raise wrong_input("harmonics: direction = 'x', but the point is a row along a direction of its own")
    return np.take(array, -1 - k, axis)

"""Branches of periodic motions and what they are asked: amplitudes, harmonics, stability, peaks."""

from __future__ import annotations

import functools
import math
from typing import Any, ClassVar

import numpy as np

from meshing.warnings import IncompleteBranch

from ..checks import index_of
from ..errors import warn
from ..motion.period_map import Period
from ..motion.states import Point
from ..record.record import Record, derived, described, quantity
from ..reduction.reduced_model import ReducedModel
from .bifurcations import Bifurcation
from .follow import points_of, ran_out
from .multipliers import FLOOR
from .orbit import (
    OfOrbits,
    Orbit,
    ToldError,
    component,
    in_words,
    make_orbit,
    multiplier_error,
    run_again,
    told_error,
    verdict_of,
    why_undecided,
)
from .problems.driven_orbits import OverParameter, ParameterRange


@described
class Branch(OfOrbits, OverParameter, ToldError):
    """A branch of periodic motions, point by point in order of arc length.

    `map` is the period map whose fixed points these are, None for an unreduced model, whose states and
    multipliers are empty. The uncertainty of the largest modulus (see `Orbit`) is measured where the verdict
    may depend on it, nan elsewhere; inf where twice the steps have no motion. A branch is complete where it
    reached the end of the range, or has closed; it may also leave where it began.
    """

    labels: ClassVar = {"place": "names"}
    coordinates: ClassVar = ("value", "frequency", "stable")

    point_subharmonics: np.ndarray = quantity(
        "m",
        "amplitudes at j f / periods",
        "point place xy subharmonic",
        called="subharmonics",
        kinds="c",
        detail=True,
    )
    contact_peak: np.ndarray = quantity("N", "contact resultant of largest modulus over the period", "point")
    multiplier_error: np.ndarray = quantity(
        "1", "uncertainty of their largest modulus by the steps", "point", finite=False, detail=True
    )
    iterations: np.ndarray = quantity("1", "Newton iterations", "point", kinds="iu", detail=True)
    bifurcations: tuple[Bifurcation, ...] = quantity(text="in order", part="Bifurcation")
    reason: str = quantity(text="why the curve ends")
    complete: bool = quantity("1", "whether it reached the end of the range, or has closed", row=True)
    periods: int = quantity("1", "forcing periods in the period of the motion", least=1)
    names: tuple[str, ...]
    map: Period | None = quantity(text="the period map", part="Period", detail=True, repr=False)
    fixed_frequency: float | None = quantity("Hz", "if it is not the parameter", default=None, least=0.0)
    mode_error: np.ndarray = told_error(
        "harmonics 0 to 4 of the named points and of the contact resultant",
        ", the largest of both ends, the peak and where harmonics 2 to 4 are largest",
    )
    unlocated: str = quantity(text="where bifurcations are that are not located, and why", default="")

    def check(self) -> None:
        """Raise ValueError unless points, model and loads belong together."""
        size = 0 if self.map is None else self.map.unknowns
        if (
            not len(self.value)
            or self.states.shape[1] != size
            or (self.parameter == "frequency") != (self.fixed_frequency is None)
        ):
            raise ValueError(f"it is over {self.parameter!r} and has {points_of(len(self))}")
        if self.map is not None and self.map.excitation.periods != self.periods:
            raise ValueError(f"{self.periods} periods are not those of its loads")
        if any(item.after > len(self.value) or len(item.state) != size for item in self.bifurcations):
            raise ValueError("its bifurcations are not those of its points")

    def _warn_incomplete(self, path: str) -> None:
        """Warn of a branch that has not reached the end of its range."""
        if self.complete:
            return
        why = f"its run has ended: {self.reason}"
        if self.reason == "unfinished":
            why = "resume=True continues it, from points of its last two seconds that are not here"
        elif ran_out(self.reason):
            why = f"it was given {self.reason}; resume=True with more of them continues it"
        warn(f"branch file {path!r} is incomplete: it ends at {self.value[-1]:.8g}; {why}", IncompleteBranch)

    @property
    def period(self) -> Period:
        """The map whose fixed points these are.

        Raises
        ------
        ValueError
            If there is none.
        """
        if self.map is None:
            raise ValueError(
                "the curve is that of an unreduced model, whose states it does not keep; compute it with "
                "reduction = 'modes'"
            )
        return self.map

    @property
    def reduced(self) -> ReducedModel | None:
        """The reduced model whose motions these are, None for an unreduced one."""
        return None if self.map is None else self.map.reduced

    @property
    def points(self) -> tuple[str, ...]:
        """Named points."""
        return self.names

    @property
    def over(self) -> ParameterRange:
        """Its parameter, from its first point to its last one."""
        return ParameterRange(
            self.parameter, float(self.value[0]), float(self.value[-1]), self.fixed_frequency
        )

    @property
    def contact(self) -> bool:
        """Whether it is computed with contact."""
        return self.map is None or self.map.contact

    @derived("Hz", "forcing frequency", "point")
    def frequency(self) -> np.ndarray:
        """(n,): forcing frequency, Hz."""
        return self.value if self.parameter == "frequency" else np.full(len(self.value), self.fixed_frequency)

    @derived("m", "moduli of harmonics 0 to 3 of u_y", "point place order", stored=False)
    def harmonic(self) -> np.ndarray:
        """(n, points, 4): for tables."""
        return np.abs(self.point_harmonics[:, :, -1, :4])

    @derived("1", "whether small disturbances die out", "point", kinds="b")
    def stable(self) -> np.ndarray:
        """(n,) bool: no multiplier is outside the unit circle. Where their uncertainty does not allow that
        verdict (`undecided`) it is what they say; False throughout where there are none (not asked for, of an
        unreduced model, or friction that falls as a slip begins), but for curves without contact, whose
        disturbances die out.
        """
        if not self.multipliers.shape[1]:
            return np.full(len(self.value), not self.contact)
        return np.abs(self.multipliers[:, 0]) <= 1.0 + FLOOR

    @property
    def stability_known(self) -> bool:
        """Whether stability is known: there are multipliers, or no contact."""
        return bool(self.multipliers.shape[1]) or not self.contact

    @property
    def unstable(self) -> np.ndarray:
        """(n,) bool: some multiplier is outside the unit circle; False throughout where there are none."""
        return ~self.stable & self.stability_known

    @derived("1", "whether the uncertainty leaves that open", "point", kinds="b")
    def undecided(self) -> np.ndarray:
        """(n,) bool: where the multipliers' uncertainty does not allow a verdict, or there are none."""
        if not self.multipliers.shape[1]:
            return np.full(len(self.value), not self.stability_known)
        largest, error = np.abs(self.multipliers[:, 0]), np.nan_to_num(self.multiplier_error, posinf=np.inf)
        return np.array([verdict_of(*both) is None for both in zip(largest, error)])

    @property
    def converged(self) -> np.ndarray:
        """(n,) bool: every point that is kept has converged."""
        return np.ones(len(self.value), dtype=bool)

    def subharmonics(self, point: str, direction: str = "y") -> np.ndarray:
        """(n, periods) complex: amplitudes at j f / periods, m; the first is the mean."""
        return component(self.point_subharmonics[:, self._index(point)], direction, self.of_rows, 1)

    def peak(self, point: Point) -> Peak:
        """The curve's highest resonance at a point."""
        return find_peak(self.value, self.amplitude(point))

    def orbit(self, k: int | Bifurcation) -> Orbit:
        """The k-th point as an `Orbit`, or one of its bifurcations, integrated again from its state."""
        if isinstance(k, Bifurcation):
            there = run_again(self.over.at(self.period, k.own_value), k.state)
            return make_orbit(there, "bifurcation of a curve")
        k = index_of("orbit", "k", k, len(self.value))
        fixed = run_again(self.over.at(self.period, float(self.value[k])), self.states[k])
        values, error = self.multipliers[k], self.multiplier_error[k]
        later = len(values) and math.isnan(error)
        told: Any = functools.partial(multiplier_error, fixed, values[0]) if later else float(error)
        return make_orbit(fixed, "point of a curve", (values, told))

    def __repr__(self) -> str:
        unit = " Hz" if self.parameter == "frequency" else ""
        if self.stability_known:
            verdict = f"{int(self.unstable.sum())} unstable"
            verdict += f", {int(self.undecided.sum())} undecided" if self.undecided.any() else ""
        else:
            verdict = why_undecided(self.reduced)
        return (
            f"Branch({points_of(len(self))} over {self.parameter} {self.value.min():.6g} to "
            f"{self.value.max():.6g}{unit}, {verdict}, "
            f"{len(self.bifurcations)} bifurcations, {in_words(self.mode_error)}"
            f"{'; '.join(filter(None, (self.reason, self.unlocated)))})"
        )


@described
class Peak(Record):
    """A resonance peak; at half power the amplitude has fallen to 1 / sqrt(2), nan outside the curve."""

    frequency: float = quantity("Hz", "frequency of the largest amplitude", called="peak_frequency")
    amplitude: float = quantity("m", "largest amplitude", called="peak_amplitude")
    lower: float = quantity("Hz", "lower half-power frequency", called="lower_frequency", finite=False)
    upper: float = quantity("Hz", "upper half-power frequency", called="upper_frequency", finite=False)

    @derived("Hz", "half-power bandwidth")
    def bandwidth(self) -> float:
        """Hz."""
        return self.upper - self.lower

    @derived("1", "0 symmetric, positive leaning to higher frequencies, above 1 overhanging")
    def skewness(self) -> float:
        """0 for a symmetric peak, towards +1 where it leans to higher frequencies, -1 to lower ones; beyond
        where it overhangs.
        """
        return ((self.frequency - self.lower) - (self.upper - self.frequency)) / self.bandwidth


def find_peak(value: np.ndarray, amplitude: np.ndarray) -> Peak:
    """Peak and half-power frequencies of a curve given in order of arc length; parabola through the three
    highest points.
    """
    top = int(np.argmax(amplitude))
    frequency, height = float(value[top]), float(amplitude[top])
    if 0 < top < len(value) - 1:
        values, heights = value[top - 1 : top + 2], amplitude[top - 1 : top + 2]
        steps = np.hypot(np.diff(values) / np.ptp(value), np.diff(heights) / height)
        arc = np.concatenate([[0.0], np.cumsum(steps)])
        bend = np.polyfit(arc, heights, 2)
        if bend[0] < 0.0 and arc[0] <= (at := -0.5 * bend[1] / bend[0]) <= arc[2]:
            frequency = float(np.polyval(np.polyfit(arc, values, 2), at))
            height = float(np.polyval(bend, at))
    level = height / math.sqrt(2.0)

    def crossing(indices: range) -> float:
        for a, b in zip(indices[:-1], indices[1:]):
            if amplitude[a] >= level > amplitude[b]:
                rise = (value[b] - value[a]) * (amplitude[a] - level)
                return float(value[a] + rise / (amplitude[a] - amplitude[b]))
        return math.nan

    left, right = crossing(range(top, -1, -1)), crossing(range(top, len(value)))
    return Peak(frequency, height, *((left, right) if not left > right else (right, left)))

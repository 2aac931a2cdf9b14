"""Branches of periodic motions and what they are asked: amplitudes, harmonics, stability, peaks."""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass, field

import numpy as np

from ..checks import index_of, names_of
from ..motion.period_map import FixedPoint, Period
from ..motion.states import Point
from ..reduction.reduced_model import ReducedModel
from ..system.plausibility import furthest_of_lines
from ..writing import write_table
from .bifurcations import Bifurcation
from .orbit import FLOOR, Orbit, Orbits, axis_number, make_orbit, multiplier_error, verdict_of
from .problems.driven_orbits import ParameterRange


@dataclass(frozen=True, eq=False)
class Branch(Orbits):
    """A branch of periodic motions, point by point in order of arc length.

    Attributes
    ----------
    parameter : {"frequency", "load", "damping", "gap"}
    value : (n,) array
        Forcing frequency (Hz), or factor on the oscillating loads, all damping ratios or all gaps.
    states : (n, 2 m) array
        (Omega q, q') at t = 0; (n, 0) for an unreduced model.
    point_harmonics : (n, points, 2, 21) complex array
        Harmonics 0 to 20 of the displacement of all named points, m.
    point_amplitudes : (n, points) array
        Half the peak-to-peak of u_y, m.
    point_subharmonics : (n, points, 2, periods) complex array
        Amplitudes at j f / periods.
    contact_peak : (n,) array
        Largest contact resultant over the period, N.
    multipliers : (n, k) complex array
        By falling modulus; k = 0 for a linear response and an unreduced model.
    multiplier_error : (n,) array
        Uncertainty of the largest modulus (see `Orbit`), measured where the verdict may depend on it, nan
        elsewhere; inf where twice the steps have no motion.
    iterations : (n,) int array
        Newton iterations.
    bifurcations : tuple of Bifurcation
    reason : str
        Why the curve ends.
    complete : bool
        Whether it reached the end of the range, or has closed; a branch may also leave where it began.
    periods : int
    names : tuple of str
        Of the points.
    map : Period or None
        That whose fixed points these are; None for an unreduced model.
    fixed_frequency : float or None
        Hz, if it is not the parameter.
    """

    parameter: str
    value: np.ndarray
    states: np.ndarray
    point_harmonics: np.ndarray
    point_amplitudes: np.ndarray
    point_subharmonics: np.ndarray
    contact_peak: np.ndarray
    multipliers: np.ndarray
    multiplier_error: np.ndarray
    iterations: np.ndarray
    bifurcations: tuple[Bifurcation, ...]
    reason: str
    complete: bool
    periods: int
    names: tuple[str, ...]
    map: Period | None = field(repr=False)
    fixed_frequency: float | None = None

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
    def contact(self) -> bool:
        """Whether it is computed with contact."""
        return self.map is None or self.map.pairs > 0

    @property
    def over(self) -> ParameterRange:
        """Its parameter, from its first point to its last one."""
        return ParameterRange(
            self.parameter, float(self.value[0]), float(self.value[-1]), self.fixed_frequency
        )

    @property
    def frequency(self) -> np.ndarray:
        """(n,): forcing frequency, Hz."""
        return self.value if self.parameter == "frequency" else np.full(len(self.value), self.fixed_frequency)

    @property
    def stable(self) -> np.ndarray:
        """(n,) bool, True throughout where stability was not asked for: no multiplier is outside the unit
        circle. Where their uncertainty does not allow that verdict (`undecided`) it is what they say.
        """
        if not self.multipliers.shape[1]:
            return np.ones(len(self.value), dtype=bool)
        return np.abs(self.multipliers[:, 0]) <= 1.0 + FLOOR

    @property
    def undecided(self) -> np.ndarray:
        """(n,) bool: where the multipliers' uncertainty does not allow a verdict."""
        if not self.multipliers.shape[1]:
            return np.zeros(len(self.value), dtype=bool)
        largest, error = np.abs(self.multipliers[:, 0]), np.nan_to_num(self.multiplier_error, posinf=np.inf)
        return np.array([verdict_of(*both) is None for both in zip(largest, error)])

    @property
    def converged(self) -> np.ndarray:
        """(n,) bool: every point that is kept has converged."""
        return np.ones(len(self.value), dtype=bool)

    def subharmonics(self, point: str, direction: str = "y") -> np.ndarray:
        """(n, periods) complex: amplitudes at j f / periods, m; the first is the mean."""
        return self.point_subharmonics[:, self._index(point), axis_number(direction)]

    def _furthest(self, least: float = 0.0) -> float:
        """Largest displacement of a named point by its harmonics, m; less than `least` where that is known to
        be so.
        """
        return furthest_of_lines(self.point_harmonics[..., None], least)

    def peak(self, point: Point) -> Peak:
        """The curve's highest resonance at a point."""
        return find_peak(self.value, self.amplitude(point))

    def to_csv(self, path: str, points: tuple[str, ...] | None = None) -> None:
        """Write parameter, verdict, contact and the amplitudes and first harmonics of points (default: all)
        as comma-separated values.

        The file takes its name when it is whole.

        Raises
        ------
        TypeError, ValueError, KeyError
            If it cannot be written, or for an unknown point.
        """
        if self.parameter == "frequency":
            columns = {"frequency_Hz": self.value, "load_factor": np.ones(len(self.value))}
        else:
            columns = {f"{self.parameter}_factor": self.value, "frequency_Hz": self.frequency}
        columns |= {
            "stable": self.stable.astype(int),
            "undecided": self.undecided.astype(int),
            "contact_peak_N": self.contact_peak,
        }
        for point in self.points if points is None else names_of("to_csv", "points", points):
            columns[f"amplitude_{point}_m"] = self.amplitude(point)
            for k in (1, 2, 3):
                columns[f"harmonic{k}_y_{point}_m"] = np.abs(self.harmonics(point)[:, k])
        write_table(path, columns)

    def orbit(self, k: int) -> Orbit:
        """The k-th point as an `Orbit`, integrated again from its state."""
        k = index_of("orbit", "k", k, len(self.value))
        driven = self.over.at(self.period, float(self.value[k]))
        motion = driven.run(self.states[k])
        fixed = FixedPoint(self.states[k], driven, motion, (float(np.linalg.norm(motion.residual)),))
        values, error = self.multipliers[k], float(self.multiplier_error[k])
        if len(values) and math.isnan(error):
            later = functools.partial(multiplier_error, fixed, values[0])
            return make_orbit(fixed, values, later, "point of a curve")
        return make_orbit(fixed, values, error, "point of a curve")

    def __repr__(self) -> str:
        unit = " Hz" if self.parameter == "frequency" else ""
        asked = self.multipliers.shape[1] or not self.contact
        verdict = f"{int((~self.stable).sum())} unstable" if asked else "stability not asked for"
        if self.undecided.any():
            verdict += f", {int(self.undecided.sum())} undecided"
        return (
            f"Branch({len(self.value)} points over {self.parameter} {self.value.min():.6g} to "
            f"{self.value.max():.6g}{unit}, {verdict}, "
            f"{len(self.bifurcations)} bifurcations, {self.reason})"
        )


@dataclass(frozen=True)
class Peak:
    """A resonance peak.

    Attributes
    ----------
    frequency : float
        Of the largest amplitude, Hz.
    amplitude : float
        m.
    lower, upper : float
        Where the amplitude has fallen to 1 / sqrt(2), Hz; nan outside the curve.
    """

    frequency: float
    amplitude: float
    lower: float
    upper: float

    @property
    def bandwidth(self) -> float:
        """Hz."""
        return self.upper - self.lower

    @property
    def skewness(self) -> float:
        """0 for a symmetric peak, towards +1 where it leans to higher frequencies, -1 to lower ones."""
        return ((self.frequency - self.lower) - (self.upper - self.frequency)) / self.bandwidth


def find_peak(value: np.ndarray, amplitude: np.ndarray) -> Peak:
    """Peak and half-power frequencies of a curve given in order of arc length; parabola through the three
    highest points.
    """
    top = int(np.argmax(amplitude))
    frequency, height = float(value[top]), float(amplitude[top])
    if 0 < top < len(value) - 1:
        arc = np.concatenate(
            [
                [0.0],
                np.cumsum(
                    np.hypot(
                        np.diff(value[top - 1 : top + 2]) / np.ptp(value),
                        np.diff(amplitude[top - 1 : top + 2]) / height,
                    )
                ),
            ]
        )
        bend = np.polyfit(arc, amplitude[top - 1 : top + 2], 2)
        if bend[0] < 0.0:
            at = -0.5 * bend[1] / bend[0]
            if arc[0] <= at <= arc[2]:
                frequency, height = (
                    float(np.polyval(np.polyfit(arc, value[top - 1 : top + 2], 2), at)),
                    float(np.polyval(bend, at)),
                )
    level = height / math.sqrt(2.0)

    def crossing(indices) -> float:
        for a, b in zip(indices[:-1], indices[1:]):
            if amplitude[a] >= level > amplitude[b]:
                return float(
                    value[a] + (value[b] - value[a]) * (amplitude[a] - level) / (amplitude[a] - amplitude[b])
                )
        return math.nan

    left, right = crossing(range(top, -1, -1)), crossing(range(top, len(value)))
    return Peak(frequency, height, *((left, right) if not left > right else (right, left)))

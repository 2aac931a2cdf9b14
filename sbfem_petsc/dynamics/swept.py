"""Motions under a slowly swept frequency: amplitude cycle by cycle, and jumps."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from ..checks import positive
from ..errors import at_point
from ..reduction.reduced_model import ReducedModel
from ..writing import write_table


@dataclass(frozen=True)
class Jump:
    """A jump from one steady state to another.

    Attributes
    ----------
    frequency : float
        Where the amplitude has changed half-way, Hz.
    before, after : float
        Amplitude on either side, m.
    """

    frequency: float
    before: float
    after: float


@dataclass(frozen=True, eq=False)
class SweptResponse:
    """A motion under a swept frequency, one entry for each cycle of the drive.

    Attributes
    ----------
    frequency : (n,) array
        Mean forcing frequency of a cycle, Hz, rising or falling.
    duration : float
        Of the sweep, s.
    point_amplitudes : (n, points) array
        Half the peak-to-peak of u_y in a cycle, m.
    contact_peak : (n,) array
        Largest contact resultant in a cycle, N.
    settling : int
        Cycles in which a disturbance falls to 1/e: of the mode with the least decay among those in the range,
        or of the nearest one; 0 without damping.
    reduced : ReducedModel
    """

    frequency: np.ndarray
    duration: float
    point_amplitudes: np.ndarray
    contact_peak: np.ndarray
    settling: int
    reduced: ReducedModel = field(repr=False)

    @property
    def points(self) -> tuple[str, ...]:
        """Named points."""
        return self.reduced.points.names

    @property
    def upwards(self) -> bool:
        """Whether the frequency rises."""
        return bool(self.frequency[-1] > self.frequency[0])

    @property
    def tells_jumps(self) -> bool:
        """Whether there is damping, and the sweep longer than four settling times, so that jumps are told."""
        return 0 < 4 * self.settling < len(self.frequency)

    def amplitude(self, point: str) -> np.ndarray:
        """(n,): half the peak-to-peak of the y displacement of a point in each cycle, m."""
        return self.point_amplitudes[:, at_point({name: k for k, name in enumerate(self.points)}, point)]

    def jumps(self, point: str, least: float = 0.2) -> tuple[Jump, ...]:
        """Where the amplitude of a point changes by more than a share within four settling times.

        Compared are means over a settling time, two such times apart, so that the beats behind a jump are no
        jumps; a sweep that is not slow beside the settling time makes one of any steep curve.

        Parameters
        ----------
        point : str
        least : float
            Relative change: the larger over the smaller amplitude, less 1.

        Raises
        ------
        ValueError
            Without damping, and for a sweep shorter than four settling times, see `tells_jumps`.
        """
        amplitude, w = self.amplitude(point), self.settling
        least = positive("jumps", "least", least)
        if w == 0:
            raise ValueError("jumps: without damping no motion settles and nothing tells a jump from a beat")
        if not self.tells_jumps:
            raise ValueError(
                f"jumps: {len(amplitude)} cycles are no longer than four settling times of {w} cycles, where "
                "nothing tells a jump from a beat; sweep more slowly"
            )
        sums = np.concatenate([[0.0], np.cumsum(amplitude)])
        means = np.maximum((sums[w:] - sums[:-w]) / w, 1e-300)
        change = np.log(means[3 * w :] / means[: -3 * w])
        large = np.abs(change) > np.log1p(least)
        # runs of one sign
        code = np.where(large, np.sign(change), 0.0)
        edges = np.flatnonzero(np.diff(np.concatenate([[0.0], code, [0.0]])))
        found = []
        for first, last in zip(edges[:-1], edges[1:]):
            if code[first] == 0.0:
                continue
            k = first + int(np.argmax(np.abs(change[first:last])))
            before, after = float(means[k]), float(means[k + 3 * w])
            between = amplitude[k + w : k + 3 * w] > 0.5 * (before + after)
            half = k + w + int(np.argmax(between == (after > before)))
            found.append(Jump(float(self.frequency[half]), before, after))
        return tuple(found)

    def to_csv(self, path: str) -> None:
        """Write frequency, contact and the amplitudes of all points as comma-separated values.

        Raises
        ------
        TypeError, ValueError
            If it cannot be written.
        """
        columns = {"frequency_Hz": self.frequency, "contact_peak_N": self.contact_peak}
        columns |= {f"amplitude_{name}_m": self.amplitude(name) for name in self.points}
        write_table(path, columns)

    def __repr__(self) -> str:
        return (
            f"SweptResponse({self.frequency[0]:.7g} to {self.frequency[-1]:.7g} Hz in {self.duration:.6g} s, "
            f"{len(self.frequency)} cycles, peak contact resultant {self.contact_peak.max():.6g} N)"
        )


def cycle_ends(start: float, stop: float, duration: float) -> np.ndarray:
    """Times (s) at which whole cycles of a linear chirp end, the first at 0."""
    count = int(0.5 * (start + stop) * duration * (1.0 + 1e-12))
    phase, rate = np.arange(count + 1.0), (stop - start) / duration
    return 2.0 * phase / (start + np.sqrt(np.maximum(start**2 + 2.0 * rate * phase, 0.0)))


def over_cycles(ends: np.ndarray, step: float, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Least and largest values (cycles, k) in each cycle of (n, k) values at equal steps from 0, the instants
    at both of its ends included.
    """
    first = np.minimum(np.ceil(ends / step - 1e-9).astype(int), len(values) - 1)
    low, high = (
        operation.reduceat(values[: first[-1] + 1], first[:-1], axis=0)
        for operation in (np.minimum, np.maximum)
    )
    return np.minimum(low, values[first[1:]]), np.maximum(high, values[first[1:]])


def settling_cycles(reduced: ReducedModel, limits: Sequence[float]) -> int:
    """Cycles at the middle of a range of frequencies (Hz) in which a disturbance falls to 1/e."""
    f, middle = reduced.frequencies, 0.5 * (limits[0] + limits[1])
    inside = (f >= min(limits)) & (f <= max(limits))
    if not inside.any():
        inside[np.argmin(np.abs(f - middle))] = True
    decay = float((reduced.damping * reduced.omega)[inside].min())
    return max(1, int(np.ceil(middle / decay))) if decay > 0.0 else 0

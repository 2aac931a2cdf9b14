"""Nonlinear response curves: branches of periodic motions over the frequency or the load, their stability and
bifurcations.
"""

from __future__ import annotations

import math
import numbers
import warnings
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from ..dynamics.several_periods import lead_away
from ..errors import SolveError, UnknownName, on_all_ranks
from ..loads import as_loads
from ..material import positive
from ..parallel import collective
from ..progress import progress_bar
from ..reduction import Reduction, communicator
from ..signals import Constant, Signal
from ..system.model import Model
from .bifurcations import Bifurcation, between, locate
from .continuation import Station, Trace
from .harmonic import one_sided
from .periodic import (
    FLOOR,
    LONGEST,
    Orbit,
    _axis,
    make_orbit,
    modal_motion,
    multiplier_error,
    periodic,
    prepare,
)
from .shooting import Period, Shot
from .stability import multipliers

# `Orbit.path` of a motion next to a period doubling.
DOUBLED = "period doubling"
# Harmonics kept of every point.
HARMONICS = 20
# Frequencies of a linear response: so many over the range, and so many about each resonance.
EVEN, ABOUT = 201, 41
# A bend of the curve, over parameter and amplitude both scaled to 1, at which points are added (radian), the
# shortest chord that is divided, times.
BEND, SHORT, PASSES = 0.3, 0.01, 3
# Instants a period at which a linear response is evaluated.
INSTANTS = 256


class CurveWarning(UserWarning):
    """A curve has not come to the end of its range."""


@dataclass(frozen=True, eq=False)
class Curve:
    """A branch of periodic motions, point by point in order of arc length.

    Attributes
    ----------
    parameter : {"frequency", "load"}
    value : (n,) array
        Forcing frequency (Hz) or factor on the oscillating loads.
    states : (n, 2 m) array
        (Omega q, q') at t = 0.
    point_harmonics : (n, points, 2, 21) complex array
        Harmonics 0 to 20 of the displacement of all named points, m.
    point_amplitudes : (n, points) array
        Half the peak-to-peak of u_y, m.
    point_subharmonics : (n, points, 2, periods) complex array
        Amplitudes at j f / periods.
    contact_peak : (n,) array
        Largest contact resultant over the period, N.
    multipliers : (n, k) complex array
        By falling modulus; k = 0 for a linear response.
    multiplier_error : (n,) array
        Uncertainty of the largest modulus, measured on the points next to a change of the verdict, nan
        elsewhere.
    iterations : (n,) int array
        Newton iterations.
    bifurcations : tuple of Bifurcation
    reason : str
        Why the curve ends.
    complete : bool
        Whether it reached the end of the range; a branch may also leave where it began.
    periods : int
    period : Period
        The map whose fixed points these are.
    fixed_frequency : float or None
        Hz, if the load is the parameter.
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
    period: Period = field(repr=False)
    fixed_frequency: float | None = None

    @property
    def reduction(self) -> Reduction:
        return self.period.reduction

    @property
    def points(self) -> tuple[str, ...]:
        """Named points."""
        return self.reduction.points

    @property
    def frequency(self) -> np.ndarray:
        """(n,): forcing frequency, Hz."""
        return self.value if self.parameter == "frequency" else np.full(len(self.value), self.fixed_frequency)

    @property
    def stable(self) -> np.ndarray:
        """(n,) bool, True throughout where stability was not asked for: no multiplier outside the unit circle
        by more than the uncertainty.
        """
        return (
            np.abs(self.multipliers[:, 0]) <= 1.0 + np.nan_to_num(self.multiplier_error, nan=FLOOR)
            if self.multipliers.shape[1]
            else np.ones(len(self.value), dtype=bool)
        )

    @property
    def converged(self) -> np.ndarray:
        """(n,) bool: every point that is kept has converged."""
        return np.ones(len(self.value), dtype=bool)

    def amplitude(self, point: str) -> np.ndarray:
        """(n,): half the peak-to-peak of the y displacement of a point, m."""
        return self.point_amplitudes[:, self._index(point)]

    def harmonics(self, point: str, direction: str = "y") -> np.ndarray:
        """(n, 21) complex: harmonics 0 to 20 of the displacement of a point, m."""
        return self.point_harmonics[:, self._index(point), _axis(direction)]

    def subharmonics(self, point: str, direction: str = "y") -> np.ndarray:
        """(n, periods) complex: amplitudes at j f / periods, m; the first is the mean."""
        return self.point_subharmonics[:, self._index(point), _axis(direction)]

    def peak(self, point: str) -> Peak:
        """The curve's highest resonance at a point."""
        return find_peak(self.value, self.amplitude(point))

    def orbit(self, k: int) -> Orbit:
        """The k-th point as an `Orbit`, integrated again from its state."""
        driven = self._driven(float(self.value[k]))
        motion = driven.run(self.states[k])
        shot = Shot(self.states[k], np.zeros(0), driven, motion, (float(np.linalg.norm(motion.residual)),))
        return make_orbit(shot, self.multipliers[k], float(self.multiplier_error[k]), "point of a curve")

    def _driven(self, value: float):
        return (
            self.period.at(value)
            if self.parameter == "frequency"
            else self.period.at(self.fixed_frequency, value)
        )

    def _index(self, point: str) -> int:
        if point not in self.points:
            raise UnknownName(
                f"point {point!r} does not exist; the model has {', '.join(map(repr, self.points))}"
            )
        return self.points.index(point)

    def __repr__(self) -> str:
        unit = " Hz" if self.parameter == "frequency" else ""
        asked = self.multipliers.shape[1] or not self.period.pairs
        verdict = f"{int((~self.stable).sum())} unstable" if asked else "stability not asked for"
        return (
            f"Curve({len(self.value)} points over {self.parameter} {self.value.min():.6g} to "
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


def frequency_response(
    model: Model | Reduction,
    load,
    start: float,
    stop: float,
    contact: bool = True,
    periods: int | None = None,
    steps: int | None = None,
    modes: int | None = None,
    reduction: Reduction | str = "modes",
    first: Orbit | None = None,
    points: int = 400,
    largest_step: float = math.inf,
    stability: bool = True,
    file: str | None = None,
    resume: bool = False,
    progress: Callable[[float], None] | str | None = "auto",
) -> Curve:
    """Follow the periodic response over the forcing frequency, through folds; without contact the linear
    response.

    Parameters
    ----------
    model : Model or Reduction
    load : PointForce, EdgeLoad, a sum or a sequence of them; for a Reduction a value for each of its unit
    loads
        Numbers are amplitudes of sin(2 pi f t) at the swept frequency; `Constant` signals are preloads.
    start, stop : float
        Hz; `stop` below `start` sweeps downwards.
    contact : bool
    periods, steps, modes, reduction
        See `periodic`.
    first : Orbit, optional
        A motion at `start` on the branch that is wanted, of its own number of periods. Default: the one
        `periodic` finds. From one that `doubled` has found the branch goes away from the period doubling, if
        need be through a fold outside the range.
    points : int
        Points at most.
    largest_step : float
        Largest change of the frequency (Hz) from a point to the next one, for a finer curve.
    stability : bool
        Compute Floquet multipliers and bifurcations.
    file : str, optional
        HDF5 file that is kept up to date (`results.curves.read_curve`).
    resume : bool
        Continue `file` if it exists, with the same model, loads and settings.
    progress : callable, "auto" or None
        As for `transient`.

    Raises
    ------
    ValueError, TypeError, KeyError
        For input that makes no sense.
    SolveError
        If there is no first point, or if the curve comes to a stop within the range; the points so far are
        its attribute `curve`, and in `file`.
    """
    with collective(communicator(model)):
        for name, value in (("start", start), ("stop", stop)):
            positive("frequency_response", name, value, "Hz")
        if start == stop:
            raise ValueError(
                f"frequency_response: start and stop are both {start:g} Hz; give a range, or use periodic"
            )
        if first is not None and abs(first.frequency - start) > 1e-9 * start:
            raise ValueError(
                f"frequency_response: first is at {first.frequency:g} Hz, not at start = {start:g} Hz"
            )
        _check_step("frequency_response", largest_step)
        _amplitudes_only("frequency_response", load, model)
        if first is not None and periods not in (None, first.periods):
            raise ValueError(
                f"frequency_response: first takes {first.periods} forcing periods, not periods = {periods}"
            )
    if first is not None:
        periods, steps = first.periods, len(first.time) // first.periods if steps is None else steps
    periods = 1 if periods is None else periods
    highest = max(start, stop)
    if not contact:
        period = prepare(
            model, load, highest, periods, INSTANTS, modes, False, reduction, None, "auto", LONGEST
        )
        return _linear(period, start, stop)
    if first is None:
        # the mode count is that of the highest frequency
        reduction = prepare(
            model, load, highest, periods, steps, modes, True, reduction, None, "auto", LONGEST
        ).reduction
    period = prepare(
        model,
        load,
        start,
        periods,
        steps,
        modes,
        True,
        first.reduction if first else reduction,
        first,
        "auto",
        LONGEST,
    )

    def begin() -> np.ndarray:
        return periodic(
            model, load, start, periods, steps, reduction=period.reduction, start=first, stability=False
        ).state

    return _follow(
        model,
        period,
        "frequency",
        start,
        stop,
        begin,
        points,
        largest_step,
        stability,
        file,
        resume,
        progress,
        None,
        first is not None and first.path == DOUBLED,
    )


def load_response(
    model: Model | Reduction,
    load,
    frequency: float,
    start: float = 0.0,
    stop: float = 1.0,
    periods: int = 1,
    steps: int | None = None,
    modes: int | None = None,
    reduction: Reduction | str = "modes",
    first: Orbit | None = None,
    points: int = 400,
    largest_step: float = math.inf,
    stability: bool = True,
    file: str | None = None,
    resume: bool = False,
    progress: Callable[[float], None] | str | None = "auto",
) -> Curve:
    """Follow the periodic response over a factor on the oscillating loads at a fixed frequency; constant
    loads stay.

    Parameters
    ----------
    start, stop : float
        Factors; not negative.
    load, frequency, periods, steps, modes, reduction, first, points, largest_step, stability, file, resume,
    progress
        See `frequency_response`; `first` is an orbit at the factor `start`.
    """
    with collective(communicator(model)):
        for name, value in (("start", start), ("stop", stop)):
            if (
                isinstance(value, bool)
                or not isinstance(value, numbers.Real)
                or not (math.isfinite(value) and value >= 0.0)
            ):
                raise ValueError(f"load_response: {name} = {value!r} must be a factor, 0 or more")
        if start == stop:
            raise ValueError(
                f"load_response: start and stop are both {start:g}; give a range, or use periodic"
            )
        if first is not None and abs(first.frequency - frequency) > 1e-9 * frequency:
            raise ValueError(
                f"load_response: first is at {first.frequency:g} Hz, not at frequency = {frequency:g} Hz"
            )
        _check_step("load_response", largest_step)
    period = prepare(
        model,
        load,
        frequency,
        periods,
        steps,
        modes,
        True,
        first.reduction if first else reduction,
        first,
        "auto",
        LONGEST,
    )

    def begin() -> np.ndarray:
        from .shooting import shoot

        return shoot(
            period, first.state if first else period.at(frequency, start).linear_state, frequency, start
        ).state

    return _follow(
        model,
        period,
        "load",
        start,
        stop,
        begin,
        points,
        largest_step,
        stability,
        file,
        resume,
        progress,
        frequency,
        first is not None and first.path == DOUBLED,
    )


def _check_step(what: str, largest_step: float) -> None:
    if not isinstance(largest_step, numbers.Real) or isinstance(largest_step, bool) or not largest_step > 0.0:
        raise ValueError(f"{what}: largest_step = {largest_step!r} must be a positive number")


def _amplitudes_only(what: str, load, model) -> None:
    """Refuse signals other than constants where the frequency is swept."""
    if isinstance(model, Reduction):
        values = [("load", value) for value in (load if isinstance(load, (list, tuple)) else (load,))]
    else:
        values = [pair for item in as_loads(load).parts for pair in vars(item).items()]
    for name, value in values:
        if isinstance(value, Signal) and not isinstance(value, Constant):
            raise ValueError(
                f"{what}: {name} = {value!r} does not follow the swept frequency; give a number, the "
                "amplitude of sin(2 pi f t), or a Constant"
            )


def _follow(
    model: Model | Reduction,
    period: Period,
    name: str,
    start: float,
    stop: float,
    begin,
    most: int,
    largest_step: float,
    stability: bool,
    file,
    resume: bool,
    progress,
    frequency,
    leave: bool = False,
) -> Curve:
    """Trace a branch, with a record of it in a file."""
    if not period.drive.orders.any():
        raise on_all_ranks(
            ValueError(f"{name}_response: no load oscillates; give a number, the amplitude of sin(2 pi f t)")
        )
    from ..results.curves import CurveFile  # stands above this module

    record = (
        CurveFile(communicator(model), file, resume, period, name, start, stop, frequency)
        if file is not None
        else None
    )
    if record is not None and record.former is not None:
        period = Period(record.reduction, period.drive, period.steps, period.pairs > 0)
    rows = _Rows(period, stability)

    def driven(value: float):
        return period.at(value) if name == "frequency" else period.at(frequency, value)

    def station(state: np.ndarray, value: float) -> Station:
        point = driven(value)
        motion = point.run(state)
        return Station(
            Shot(state, np.array([value]), point, motion, (float(np.linalg.norm(motion.residual)),)), value
        )

    former = record.former if record is not None else None
    stations = (
        [station(state, value) for state, value in zip(*former[:2])]
        if former is not None
        else [station(begin(), start)]
    )
    trace = Trace(
        period,
        stations[0],
        name,
        min(start, stop),
        max(start, stop),
        1 if stop > start else -1,
        driven,
        most,
        largest_step,
    )
    trace.stations = stations
    if former is not None:
        trace.length = former[2]
    elif leave:
        lead_away(trace)
    for item in stations:
        rows.add(item)

    def curve(finished: bool) -> Curve:
        arrived = len(trace.stations) > 1 and (
            trace.stations[-1].value >= trace.upper
            if stop > start
            else trace.stations[-1].value <= trace.lower
        )
        bifurcations = tuple(locate(trace, rows.found)) if finished and stability else ()
        error = (
            _uncertainty(trace, rows.found, frequency)
            if finished and stability
            else np.full(len(trace.stations), np.nan)
        )
        return Curve(
            name,
            np.array([s.value for s in trace.stations]),
            np.array([s.shot.state for s in trace.stations]),
            *rows.arrays(),
            error,
            np.array([len(s.shot.residuals) - 1 for s in trace.stations]),
            bifurcations,
            trace.reason or "unfinished",
            arrived,
            period.drive.periods,
            period,
            frequency,
        )

    with progress_bar(communicator(model), f"{name} response", progress) as told:
        if not (len(stations) > 1 and not trace.lower < stations[-1].value < trace.upper):
            for item in trace:
                rows.add(item)
                if record is not None:
                    record.update(lambda: curve(False), trace.length)
                if told is not None:
                    told(min(1.0, abs(item.value - start) / abs(stop - start)))
            if not trace.lower < trace.stations[-1].value < trace.upper:
                _refine(trace, rows)
    result = curve(True)
    if record is not None:
        record.update(lambda: result, trace.length, last=True)
    if len(trace.stations) >= most:
        warnings.warn(
            f"{name}_response: the curve ends at {result.value[-1]:.8g} after {most} points, before "
            f"{stop:.8g}; raise points, or take more steps a period if it zigzags",
            CurveWarning,
            stacklevel=3,
        )
    elif trace.lower < result.value[-1] < trace.upper:
        error = SolveError(
            f"{name}_response: the curve stops at {result.value[-1]:.8g} after {len(result.value)} points: "
            f"{trace.reason}; take more steps a period, or see -shooting_snes_monitor"
        )
        error.curve = result
        raise on_all_ranks(error)
    return result


class _Rows:
    """What is kept of each point."""

    def __init__(self, period: Period, stability: bool):
        self.period, self.stability = period, stability
        self.rows, self.found = [], []

    def add(self, station: Station, place: int | None = None) -> None:
        """Note a point, at the end or before another one."""
        r, shot = self.period.reduction, station.shot
        q, _ = modal_motion(shot.driven, shot.motion)
        forces, pairs = shot.motion.forces[:-1], self.period.pairs
        u = (
            np.einsum("pim,nm->npi", r.sensor_modes, q[:-1], optimize=True)
            + np.einsum("pil,nl->npi", r.sensor_loads, shot.driven.loads[:-1], optimize=True)
            + np.einsum("pic,nc->npi", r.sensor_pairs[..., :pairs], forces, optimize=True)
        )
        spectrum, periods = one_sided(u), self.period.drive.periods
        found = multipliers(shot.driven, shot.motion) if self.stability else None
        row = (
            np.moveaxis(spectrum[::periods][: HARMONICS + 1], 0, -1),
            0.5 * np.ptp(u[..., 1], axis=0),
            np.moveaxis(spectrum[:periods], 0, -1),
            forces.sum(axis=1).max(initial=0.0),
            found.values if found is not None else np.zeros(0, dtype=complex),
        )
        place = len(self.rows) if place is None else place
        self.rows.insert(place, row)
        self.found.insert(place, found)

    def arrays(self):
        """Harmonics, amplitudes, subharmonics, contact peaks and multipliers of all points."""
        return tuple(np.array(column) for column in zip(*self.rows))


def _refine(trace: Trace, rows: _Rows) -> None:
    """Points between those where the amplitude of a named point bends sharply over the parameter, so that
    peaks stand where they are.
    """
    for _ in range(PASSES):
        stations = trace.stations
        value, amplitude = np.array([s.value for s in stations]) / trace.range, rows.arrays()[1]
        bent = set()
        for k in range(amplitude.shape[1]):
            if not amplitude[:, k].any():
                continue
            steps = np.diff(np.stack([value, amplitude[:, k] / amplitude[:, k].max()], axis=1), axis=0)
            angle = np.abs(np.diff(np.unwrap(np.arctan2(steps[:, 1], steps[:, 0]))))
            length = np.hypot(*steps.T)
            bent |= {m for i in np.flatnonzero(angle > BEND) for m in (i, i + 1) if length[m] > SHORT}
        for k in sorted(bent, reverse=True):
            try:
                station = between(trace, stations[k], stations[k + 1], 0.5)
            except SolveError:  # a corner of the branch: the curve is left as it is there
                continue
            rows.add(station, k + 1)
            stations.insert(k + 1, station)
        if not bent:
            break


def _uncertainty(trace: Trace, found, frequency: float | None) -> np.ndarray:
    """(n,): uncertainty of the largest modulus at the points next to a change of the verdict, nan
    elsewhere.
    """
    stable = np.array([np.abs(item.values[0]) <= 1.0 for item in found])
    changes = np.flatnonzero(stable[1:] != stable[:-1])
    result = np.full(len(found), np.nan)
    for k in {*changes, *(changes + 1)}:
        station = trace.stations[k]
        at = (station.value, 1.0) if frequency is None else (frequency, station.value)
        result[k] = multiplier_error(trace.period, station.shot, at[0], found[k].values, at[1])
    return result


def _linear(period: Period, start: float, stop: float) -> Curve:
    """The response without contact, closed form."""
    r = period.reduction
    lower, upper = min(start, stop), max(start, stop)
    inside = [(f, z) for f, z in zip(r.frequencies, r.damping) if lower < f < upper]
    near = [
        f * (1.0 + max(z, 1e-4) * np.tan(np.linspace(-1.45, 1.45, ABOUT if z else ABOUT - 1)))
        for f, z in inside
    ]  # an even number leaves out a resonance without damping
    values = np.unique(np.concatenate([np.linspace(lower, upper, EVEN), *near]))
    values = values[(values >= lower) & (values <= upper)]
    values = values if stop > start else values[::-1]
    rows, states = _Rows(period, stability=False), []
    for value in values:
        driven = period.at(float(value))
        motion = driven.run(driven.linear_state)
        states.append(driven.linear_state)
        rows.add(Station(Shot(driven.linear_state, np.zeros(0), driven, motion, (0.0,)), float(value)))
    return Curve(
        "frequency",
        values,
        np.array(states),
        *rows.arrays(),
        np.full(len(values), np.nan),
        np.zeros(len(values), dtype=int),
        (),
        f"end of the range at {values[-1]:g}",
        True,
        period.drive.periods,
        period,
    )

"""Periodic loads and the linear steady state of a reduced model, closed form in modal coordinates."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import replace
from fractions import Fraction

import numpy as np
from scipy.linalg import block_diag

from ..errors import called
from ..record.record import Record, described, quantity
from ..reduction.reduced_model import ReducedModel
from ..signals.samples import Samples
from ..signals.sampling import FIRST, resolved
from ..signals.signal import Constant, Signal, Sum
from ..signals.waves import Chirp, Harmonic, Step, ToneBurst

# Lines up to which motions over time are products with their waves; of more, Fourier transforms.
LINES = 64
# Sampled harmonics of a load below this share of its own largest one are rounding, and what tones that cancel
# each other leave of them.
ROUND_OFF = 1e-12
# Relative distance of a tone from a harmonic of the base frequency that rounding explains.
SAME = 1e-9
# Of lines that move the modes by less than this share of all, in velocity, the modes know nothing.
TAIL = 3e-5
# Lines that are looked at together.
BLOCK = 4096
# Most instants at which loads are sampled over a common period, and the last period in which they are
# compared.
INSTANTS, LATEST = 2**24, 4000
# Where signals are compared between two samples, as a share of their distance.
_BETWEEN = 0.381966
# An undamped mode this near to a harmonic of the load, relative, is at resonance.
RESONANCE = 1e-9


@described
class Excitation(Record):
    """Load amplitudes with a common period T = `periods` / f: s(t) = Re sum_k amplitude_k exp(i k 2 pi t /
    T). Of loads whose lines never end the amplitudes hold the first lines.
    """

    orders: np.ndarray = quantity(
        "1", "multiples of 1 / T, 0 for the constant part", "order", kinds="iu", least=0
    )
    amplitudes: np.ndarray = quantity("unit of the load", "one-sided amplitudes", "order load", kinds="c")
    periods: int = quantity("1", "forcing periods 1 / f in the common period", least=1)
    jumps: Jumps | None = quantity(text="those of loads whose lines never end", part="Jumps", default=None)
    further: Excitation | None = quantity(
        text="lines that hardly move the modes, but belong to the loads themselves; without those of jumps",
        part="Excitation",
        dims="order:further_order jump:further_jump",
        default=None,
    )

    @classmethod
    def of(cls, signals: Sequence[Signal], frequency: float, periods: int | None, bound: int) -> Excitation:
        """Excitation of load signals, in which a `Constant` stands for itself.

        Parameters
        ----------
        signals : sequence of Signal
            Tones (`Harmonic`), constants and sums of them, or any signal that is periodic in T.
        frequency : float
            Forcing frequency f, Hz.
        periods : int or None
            None: the fewest in which all tones fit.
        bound : int
            Most periods that are looked for.

        Raises
        ------
        ValueError
            If the signals have no common period; the message names neighbouring frequencies that have one.
        """
        periods = common_periods(signals, frequency, periods, bound)
        highest = max((s.highest_frequency or 0.0 for s in signals), default=0.0)
        instants = max(128.0, 8.0 * periods * highest / frequency)
        if not instants <= INSTANTS:
            raise ValueError(
                f"{called()}: {periods} period{'s' * (periods > 1)} of {frequency:g} Hz with loads up to "
                f"{highest:g} Hz take {instants:.3g} instants, more than {INSTANTS:,d}; give fewer periods "
                "or frequencies nearer to each other"
            )
        if all(_known(part) for signal in signals for part in parts_of(signal)):
            orders, found = by_formula([parts_of(signal) for signal in signals], frequency, periods)
            jumps, share = None, 0.0
        else:
            share = ROUND_OFF
            least = 2 ** math.ceil(math.log2(instants))
            orders, found, jumps = _by_samples(signals, frequency, periods, least)
        if not np.isfinite(found).all():
            raise ValueError(f"{called()}: the loads leave the range of numbers; give them in N and Pa")
        return cls(orders, found, periods, jumps)._audible(share)

    def _audible(self, share: float = ROUND_OFF) -> Excitation:
        """Without lines that are rounding: below so much of a load's largest one."""
        noise = share * np.abs(self.amplitudes).max(axis=0, initial=0.0)  # units differ
        result = replace(self, amplitudes=_above(self.amplitudes, noise))
        # a line that is none may be one beside the jumps
        further_values = np.abs(self.smooth) > noise
        return result._lines(((result.amplitudes != 0.0) | further_values).any(axis=1))

    def repeated(self, times: int) -> Excitation:
        """The same loads with `times` their common period."""
        jumps = self.jumps and self.jumps.repeated(times)
        further = self.further and self.further.repeated(times)
        return Excitation(self.orders * times, self.amplitudes, self.periods * times, jumps, further)

    def scaled(self, factor: float) -> Excitation:
        """The oscillating part times a factor; the constant part stays."""
        if factor == 1.0:
            return self
        return replace(
            self,
            amplitudes=np.where(self.orders[:, None] > 0, factor, 1.0) * self.amplitudes,
            jumps=self.jumps and replace(self.jumps, sizes=factor * self.jumps.sizes),
            further=self.further and self.further.scaled(factor),
        )

    @property
    def oscillating(self) -> Excitation:
        """Without the constant part."""
        return self._lines(self.orders > 0)

    def below(self, order: float) -> Excitation:
        """The lines below this order alone, if there are more than a few."""
        if len(self.orders) <= LINES:
            return self
        return replace(self._lines(self.orders < order), jumps=None, further=None)

    def _lines(self, chosen: np.ndarray) -> Excitation:
        return replace(self, orders=self.orders[chosen], amplitudes=self.amplitudes[chosen])

    def moving(self, reduction: ReducedModel, frequency: float) -> Excitation:
        """With the lines that hardly move the modes as further ones, if there are more than a few."""
        r, sizes = reduction, np.empty(len(self.orders))
        if len(sizes) <= LINES:
            return self
        for block in np.array_split(np.arange(len(sizes)), math.ceil(len(sizes) / BLOCK)):
            omega = 2.0 * np.pi * frequency / self.periods * self.orders[block, None]
            dynamic = np.abs(r.omega**2 - omega**2 + 2j * r.damping * r.omega * omega)
            moved = np.abs(_modal_loads(r, self.amplitudes[block], omega)) / np.maximum(
                dynamic, RESONANCE * omega**2
            )
            sizes[block] = np.linalg.norm(omega * moved, axis=1)
        left = np.sqrt(np.cumsum(sizes[::-1] ** 2))[::-1]
        moving = left > TAIL * left[0]
        others = self._lines(~moving)
        others = replace(others, amplitudes=others.smooth, jumps=None)
        return replace(self._lines(moving), further=others._audible())

    @property
    def smooth(self) -> np.ndarray:
        """Amplitudes without those of jumps."""
        return self.amplitudes if self.jumps is None else self.amplitudes - self.jumps.lines(self.orders)

    def loads(self, count: int) -> np.ndarray:
        """(count + 1, loads) values at equal steps from 0 to T, both ends; where they jump, the mean."""
        return self.over_time(self.smooth, count) + self.further_values(count)

    def further_values(self, count: int) -> np.ndarray | float:
        """What jumps and further lines have in the loads at equal steps from 0 to T, both ends."""
        values: np.ndarray | float = 0.0
        if self.jumps is not None:
            values = values + self.jumps.values(np.arange(count + 1) / count)
        if self.further is not None:
            values = values + self.further.loads(count)
        return values

    def impulses(self, count: int) -> np.ndarray | float:
        """Time integrals of what `beside` is without the jumps' lines, in common periods and without their
        means: the rates that it gives to modes which hardly follow it.
        """
        values: np.ndarray | float = 0.0
        if self.jumps is not None:
            lines = self.jumps.lines(self.orders)
            values = self.jumps.integrals(np.arange(count + 1) / count) - self._integrals(lines, count)
        if self.further is not None:
            values = values + self.further._integrals(self.further.amplitudes, count)
        return values

    def _integrals(self, amplitudes: np.ndarray, count: int) -> np.ndarray:
        """Over time, of lines, in common periods and without their means."""
        turns = np.where(self.orders > 0, 2j * np.pi * self.orders, np.inf)
        return self.over_time(amplitudes / turns[:, None], count)

    def over_time(self, amplitudes: np.ndarray, count: int) -> np.ndarray:
        """(count + 1, ...) real values of complex amplitudes (k, ...) at equal steps from 0 to T, both
        ends.
        """
        if len(self.orders) <= LINES:
            return (self.phases(count) @ amplitudes).real
        spectrum = np.zeros((count, *amplitudes.shape[1:]), dtype=complex)
        np.add.at(spectrum, self.orders % count, amplitudes)
        values = np.fft.ifft(spectrum, axis=0, norm="forward").real
        return np.concatenate([values, values[:1]])

    def phases(self, count: int) -> np.ndarray:
        """(count + 1, k): exp(i k 2 pi t / T) at equal steps from 0 to T, both ends."""
        return np.exp(2j * np.pi * (np.arange(count + 1)[:, None] * self.orders % count) / count)

    def response(self, reduction: ReducedModel, frequency: float) -> np.ndarray:
        """(k, m): complex modal amplitudes of the linear steady state.

        Raises
        ------
        ValueError
            If an undamped mode is driven at its own frequency: there is no steady state without contact to
            start from.
        """
        r = reduction
        omega = 2.0 * np.pi * frequency * self.orders[:, None] / self.periods
        forces = _modal_loads(r, self.amplitudes, omega)
        dynamic = r.omega**2 - omega**2 + 2j * r.damping * r.omega * omega
        # of each line by itself: those of other loads may be far larger
        noise = ROUND_OFF * np.abs(self.amplitudes) @ np.abs(r.load_modes).max(axis=0, initial=0.0)
        at_resonance = np.abs(dynamic) <= RESONANCE * np.maximum(r.omega, omega) ** 2
        at_resonance &= np.abs(forces) > noise[:, None]
        if at_resonance.any():
            order, mode = np.argwhere(at_resonance)[0]
            if r.omega[mode] == 0.0 and self.orders[order] == 0:
                raise ValueError(
                    f"{called()}: the constant load pushes the rigid-body motion of mode {mode + 1}; hold "
                    "the structure or leave the constant load out"
                )
            raise ValueError(
                f"{called()}: mode {mode + 1} at {r.frequencies[mode]:.6g} Hz has no damping and is driven "
                "at its own frequency, so that the linear response is infinite; give the model a damping "
                "ratio or move the frequency"
            )
        return forces / np.where(np.abs(dynamic) == 0.0, 1.0, dynamic)


def _modal_loads(r: ReducedModel, amplitudes: np.ndarray, omega: np.ndarray) -> np.ndarray:
    """(k, m): what amplitudes (k, loads) at omega (k, 1) do in the modes."""
    return amplitudes @ r.load_modes.T + 1j * omega * _rate_loads(r, amplitudes)


def _rate_loads(r: ReducedModel, amplitudes: np.ndarray) -> np.ndarray | float:
    """The share of rates of prescribed displacements in it, by i omega."""
    return amplitudes[:, r.edges] @ r.rate_modes.T if len(r.edges) else 0.0


@described
class Jumps(Record):
    """Jumps of loads as saw teeth: each falls evenly by what it jumps, so that its mean is zero, and has all
    its lines in closed form.
    """

    instants: np.ndarray = quantity("1", "shares of the common period", "jump", least=0.0)
    sizes: np.ndarray = quantity("unit of the load", "of the jumps", "jump load")

    def repeated(self, times: int) -> Jumps:
        """The same jumps in `times` the period."""
        instants = (np.arange(times)[:, None] + self.instants).ravel() / times
        return Jumps(instants, np.tile(self.sizes, (times, 1)))

    def lines(self, orders: np.ndarray) -> np.ndarray:
        """(k, loads) complex amplitudes of multiples of 1 / T."""
        turns = np.exp(-2j * np.pi * (orders[:, None] * self.instants % 1.0))
        teeth = np.where(orders > 0, -1j / (np.pi * np.maximum(orders, 1)), 0.0)
        return teeth[:, None] * (turns @ self.sizes)

    def values(self, shares: np.ndarray) -> np.ndarray:
        """(n, loads) values at shares of the period; at a jump the mean."""
        values = np.zeros((len(shares), self.sizes.shape[1]))
        for instant, size in zip(self.instants, self.sizes):
            since = (shares - instant) % 1.0
            at = np.minimum(since, 1.0 - since) < SAME
            values += np.where(at, 0.0, 0.5 - since)[:, None] * size
        return values

    def integrals(self, shares: np.ndarray) -> np.ndarray:
        """(n, loads): of the saw teeth over the period, in periods and without their means."""
        since = (shares[:, None] - self.instants) % 1.0
        return (0.5 * since * (1.0 - since) - 1.0 / 12.0) @ self.sizes


def common_periods(signals: Sequence[Signal], frequency: float, periods: int | None, bound: int) -> int:
    """Forcing periods in the common period of signals, by their tones; see `Excitation.of`."""
    tones = [part.frequency for signal in signals for part in parts_of(signal) if isinstance(part, Harmonic)]
    for signal in signals:
        _refuse_passing(signal)
    if periods is None:
        periods = next(
            (n for n in range(1, bound + 1) if all(_whole(n * tone / frequency) for tone in tones)), None
        )
        if periods is None:
            raise ValueError(_no_common_period(tones, frequency, bound))
    for tone in tones:
        if not _whole(periods * tone / frequency):
            raise ValueError(
                f"{called()}: the tone of {tone:g} Hz makes {periods * tone / frequency:.6g} cycles in "
                f"{periods} period{'s' * (periods > 1)} of {frequency:g} Hz; "
                f"a steady state needs a whole number: {_neighbours(tone, frequency, (periods,))}"
            )
    return periods


def by_formula(
    loads: Sequence[Sequence[Signal]], frequency: float, periods: int
) -> tuple[np.ndarray, np.ndarray]:
    """Multiples of the common period's frequency (k,) and amplitudes (k, loads) of loads, each of which
    consists of tones and constants.
    """
    found: dict[int, np.ndarray] = {}
    for k, parts in enumerate(loads):
        for part in parts:
            order, value = 0, complex(part(0.0))
            if isinstance(part, Harmonic) and round(periods * part.frequency / frequency):
                order = round(periods * part.frequency / frequency)
                value = -1j * part.amplitude * np.exp(1j * part.phase)
            line = found.setdefault(order, np.zeros(len(loads), dtype=complex))
            line[k] = _above(line[k] + value, ROUND_OFF * abs(value))
    orders = sorted(found)
    amplitudes = np.array([found[order] for order in orders], dtype=complex)
    return np.array(orders, dtype=int), amplitudes.reshape(len(orders), len(loads))


def _above(found: np.ndarray, noise: np.ndarray | float) -> np.ndarray:
    """Complex numbers without real and imaginary parts that are rounding."""
    real, imaginary = (np.where(np.abs(part) > noise, part, 0.0) for part in (found.real, found.imag))
    return real + 1j * imaginary


def one_sided(values: np.ndarray) -> np.ndarray:
    """Complex amplitudes a_j along the first axis: values = Re sum_j a_j exp(2 pi i j n / N)."""
    result = np.fft.rfft(values, axis=0) * (2.0 / len(values))
    result[0] *= 0.5
    if len(values) % 2 == 0:  # the highest frequency stands for itself alone
        result[-1] *= 0.5
    return result


def parts_of(signal: Signal) -> Sequence[Signal]:
    """The signals that a sum consists of, or the signal itself."""
    return signal.parts if isinstance(signal, Sum) else (signal,)


def _known(part: Signal) -> bool:
    """Whether a signal's harmonics follow from its formula."""
    return type(part) in (Constant, Harmonic)


def _by_samples(
    signals: Sequence[Signal], frequency: float, periods: int, count: int
) -> tuple[np.ndarray, np.ndarray, Jumps | None]:
    """The same of any signals from at least so many samples of the common period, which they must repeat, and
    in closed form of their jumps.
    """
    period = periods / frequency
    breaks = []
    for signal in signals:
        # from where jumps hardly are to there a period later
        places = (np.asarray(signal.breaks) / period - _BETWEEN) % 1.0 + _BETWEEN
        own = np.unique(np.round(places, 12)) * period
        if not all(_known(part) for part in parts_of(signal)):
            found = resolved(signal, _BETWEEN * period, (1.0 + _BETWEEN) * period, own)
            if found is not None:
                count, own = max(count, FIRST, 2 * found.intervals), found.breaks
        breaks.append(own)
    instants = np.concatenate([np.zeros(0), *breaks])
    if len(instants):  # whose lines do not end with the band
        count = max(count, FIRST)
    apart = period / count
    first = np.array([s(np.arange(count) * apart) for s in signals]).reshape(len(signals), count)
    # two periods are compared between the samples: jumps stand on these, and there rounding decides
    time = (np.arange(2 * count) + _BETWEEN) * apart
    values = np.array([s(time) for s in signals]).reshape(len(signals), 2, count)
    changes = np.abs(values[:, 1] - values[:, 0])
    if changes.max(initial=0.0) > 1e-6 * np.abs(values).max(initial=0.0):
        worst = int(np.argmax(changes.max(axis=1)))
        raise ValueError(_not_periodic(signals[worst], periods, frequency))
    for signal, row in zip(signals, first):
        if not _repeats(signal, row, period):
            raise ValueError(_not_periodic(signal, periods, frequency))
    sizes = block_diag(*((s.after(own) - s.before(own))[:, None] for s, own in zip(signals, breaks)))
    jumps, orders = Jumps(instants / period % 1.0, sizes), np.arange(count // 2 + 1)
    # from where jumps hardly are
    shares = _BETWEEN + np.arange(count) / count
    rest = np.stack([s(shares * period) for s in signals], axis=1) - jumps.values(shares)
    lines = one_sided(rest) * np.exp(-2j * np.pi * (_BETWEEN * orders % 1.0))[:, None] + jumps.lines(orders)
    return orders, lines, jumps if sizes.any() else None


def _refuse_passing(signal: Signal) -> None:
    """Refuse signals that begin and end, which no period repeats."""
    for part in parts_of(signal):
        if isinstance(part, (Step, ToneBurst, Chirp, Samples)):
            kind = type(part).__name__
            instead = (
                "Constant for what it settles at" if kind == "Step" else "periodic signal (Harmonic, Custom)"
            )
            raise ValueError(f"{called()}: {part!r} is not periodic; give a {instead}, or use transient")


def _repeats(signal: Signal, row: np.ndarray, period: float) -> bool:
    """Whether a signal is the same in later periods as in the first one, at whose samples values are given:
    in the next ones one by one, then ever further apart. Of a signal whose formula is not known only what is
    sampled is known.
    """
    if all(_known(part) for part in parts_of(signal)):
        return True
    stride = len(row) // 64
    within = (np.arange(0, len(row), stride) + _BETWEEN) / len(row)
    expected, size = np.asarray(signal(period * within)), float(np.abs(row).max(initial=0.0))
    later = np.unique(np.concatenate([np.arange(2, 32), np.geomspace(32, LATEST, 64).astype(int)]))
    time = period * (later[:, None] + within)
    values = np.asarray(signal(time.ravel())).reshape(time.shape)
    # the times themselves are rounded, by their own size
    slack = 1e-6 * max(size, float(np.abs(values).max(initial=0.0)))
    return bool(np.abs(values - expected).max(initial=0.0) <= slack)


def _not_periodic(signal: Signal, periods: int, frequency: float) -> str:
    return (
        f"{called()}: the signal {signal!r} does not repeat after {periods} "
        f"period{'s' * (periods > 1)} of {frequency:g} Hz; give a periodic signal, or use transient"
    )


def _whole(value: float) -> bool:
    return abs(value - round(value)) <= SAME * max(value, 1.0)


def _neighbours(tone: float, frequency: float, periods: Iterable[int]) -> str:
    """Frequencies next to a tone that make a whole number of cycles in one of the numbers of periods of
    `frequency`.
    """
    below, above = (
        max(Fraction(math.floor(n * tone / frequency), n) for n in periods),
        min(Fraction(math.ceil(n * tone / frequency), n) for n in periods),
    )
    # with digits enough to be accepted when they are copied
    return "for instance " + " or ".join(
        f"{float(part) * frequency:.12g} Hz ({part} of {frequency:g} Hz)"
        for part in (below, above)
        if part > 0
    )


def _no_common_period(tones: Iterable[float], frequency: float, bound: int) -> str:
    bad = next(t for t in tones if not any(_whole(n * t / frequency) for n in range(1, bound + 1)))
    return (
        f"{called()}: the tone of {bad:g} Hz has no common period with {frequency:g} Hz within {bound} "
        f"periods; choose {_neighbours(bad, frequency, range(1, min(bound, 16) + 1))}, "
        "raise longest, or use transient with a coherent record"
    )


def modal_forces(reduced: ReducedModel, amplitudes: np.ndarray, speeds: np.ndarray) -> np.ndarray:
    """Those under which the modes have amplitudes (k, m) in linear steady states of speeds i omega (k, 1)."""
    return (reduced.omega**2 + speeds * (speeds + 2.0 * reduced.damping * reduced.omega)) * amplitudes

"""What all signals have in common, constants, functions of a user, and sums."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, fields, replace
from numbers import Real
from typing import Any, cast

import numpy as np

from meshing.input_checks import check_said

from ..checks import real, real_array, said, shown

# Relative to a step: times that miss an end by less are at it, since k * dt is rounded.
ROUND_OFF = 1e-9
# Steps a period of the highest load frequency by default: loads are interpolated linearly, an error of (omega
# h)^2 / 12 = 3e-5.
STEPS_A_PERIOD = 320
# Relative to an instant: how far times that round-off has moved are from it at most.
JUST = 1e-3 * ROUND_OFF
# Of the larger one of two constants: what rounding leaves of them where they cancel each other.
_CANCELLED = 1e-12


class Signal:
    """What all signals have in common.

    Attributes
    ----------
    highest_frequency : float or None
        Top of the band that matters, Hz; 0 for steps and constants; None if it is not known.
    end : float
        Time after which the signal keeps its value, s; inf if it never does.
    breaks : tuple of float
        Instants at which the value jumps, or turns so sharply that no step passes over it, s, rising: a step
        of a history ends there.
    """

    # numpy leaves `number * signal` to the signal.
    __array_ufunc__ = None

    def __post_init__(self) -> None:
        check_said(self)

    @property
    def highest_frequency(self) -> float | None:
        return 0.0

    @property
    def end(self) -> float:
        return math.inf

    @property
    def breaks(self) -> tuple[float, ...]:
        return ()

    def __call__(self, t) -> np.ndarray:
        """Values at the times `t` (s), of the same shape."""
        return self._checked_values(t, 0)

    def before(self, t) -> np.ndarray:
        """Limits from the left at the times `t` (s), of the same shape."""
        return self._checked_values(t, -1)

    def after(self, t) -> np.ndarray:
        """Limits from the right at the times `t` (s), of the same shape."""
        return self._checked_values(t, 1)

    def _leaps(self, duration: float) -> bool:
        """Whether the value jumps in 0 <= t < duration (s)."""
        return any(0.0 <= t < duration and self.before(t) != self.after(t) for t in self.breaks)

    def _checked_values(self, t, side: int) -> np.ndarray:
        return self._values(real_array(type(self).__name__, "t", t, None, "s"), side)[()]

    def _values(self, t: np.ndarray, side: int = 0) -> np.ndarray:
        """Values, where the signal jumps those before (side -1), at (0) or behind it (1)."""
        raise NotImplementedError

    def _scaled(self, factor: float) -> Signal:
        signal: Any = self  # every signal has an amplitude, or scales itself
        return replace(signal, amplitude=factor * signal.amplitude)

    def __add__(self, other) -> Signal:
        return _total((self, as_signal(other)))

    def __radd__(self, other) -> Signal:
        return _total((as_signal(other), self))

    def __sub__(self, other) -> Signal:
        return self + -1.0 * as_signal(other)

    def __rsub__(self, other) -> Signal:
        return as_signal(other) + -1.0 * self

    def __neg__(self) -> Signal:
        return -1.0 * self

    def __mul__(self, factor: float) -> Signal:
        return self._scaled(real(type(self).__name__, "factor", factor))

    __rmul__ = __mul__

    def __truediv__(self, divisor: float) -> Signal:
        if real(type(self).__name__, "divisor", divisor) == 0.0:
            raise ValueError(f"{type(self).__name__}: divisor = {shown(divisor)} must not be zero")
        return self._scaled(1.0 / divisor)

    def __repr__(self) -> str:
        parts, signal = [], cast(Any, self)
        for own in fields(signal):
            value, unit = getattr(self, own.name), own.metadata.get("unit", "")
            text = f"{value:.10g}" if isinstance(value, float) else repr(value)
            parts.append(f"{own.name}={text}{unit and ' ' + unit}")
        return f"{type(self).__name__}({', '.join(parts)})"


@dataclass(frozen=True, repr=False)
class Constant(Signal):
    """`value` at all times: a preload beside oscillating loads."""

    value: float = field(metadata=said("value, in the unit of the component"))

    end = 0.0

    def _values(self, t: np.ndarray, side: int = 0) -> np.ndarray:
        return np.full(t.shape, self.value)

    def _scaled(self, factor: float) -> Constant:
        return Constant(factor * self.value)


@dataclass(frozen=True, repr=False)
class Custom(Signal):
    """amplitude * function(t), for a function that takes an (n,) array of times (s) and returns one finite
    number for each.

    `highest_frequency` is the top of the band that matters, Hz, `breaks` the instants at which the function
    jumps, s. Without a band, and where the function is not what the band says, an analysis samples it until
    twice as many samples agree, at most 2^20 in a history or a period, and finds the jumps itself; one that
    asks for more is refused. The function is tried at two times here and checked whenever it is called.
    """

    function: Callable[[np.ndarray], np.ndarray]
    highest_frequency: float | None = field(
        default=None, metadata=said("top of the band that matters", "Hz", ge=0)
    )
    amplitude: float = field(default=1.0, metadata=said("factor on the function"))
    breaks: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        if not callable(self.function):
            raise TypeError(
                f"Custom: function = {shown(self.function)} cannot be called; a function of an array of "
                "times is "
                "expected"
            )
        super().__post_init__()
        breaks = real_array("Custom", "breaks", self.breaks, 1)
        object.__setattr__(self, "breaks", tuple(np.unique(breaks).tolist()))
        self._values(np.array([0.0, 1e-6]))

    @property
    def _name(self) -> str:
        return getattr(self.function, "__name__", None) or type(self.function).__name__

    def _values(self, t: np.ndarray, side: int = 0) -> np.ndarray:
        times = t.ravel()
        if side:
            times = times + side * JUST * np.abs(times)
        try:
            result = np.asarray(self.function(times))
        except Exception as error:
            reason = " ".join(f"{type(error).__name__}: {error}".split())
            raise ValueError(
                f"Custom: {self._name} failed for an array of {times.size} times ({reason}); it must take an "
                f"array, as numpy.vectorize({self._name}) does"
            ) from error
        if result.dtype.kind not in "iuf":
            raise TypeError(
                f"Custom: {self._name} returned values of type {result.dtype}; real numbers are expected"
            )
        if result.shape != times.shape:
            raise ValueError(
                f"Custom: {self._name} returned the shape {result.shape} for {times.size} times; one number "
                "for each is expected"
            )
        if (bad := np.flatnonzero(~np.isfinite(result))).size:
            raise ValueError(
                f"Custom: {self._name} returned {result[bad[0]]} at t = {times[bad[0]]:g} s; finite numbers "
                "are expected"
            )
        return self.amplitude * result.reshape(t.shape)

    def __repr__(self) -> str:
        band = "unknown" if self.highest_frequency is None else f"{self.highest_frequency:.10g} Hz"
        return f"Custom({self._name}, highest_frequency={band}, amplitude={self.amplitude:.10g})"


@dataclass(frozen=True, repr=False)
class Sum(Signal):
    """Several signals acting together; made by adding signals."""

    parts: tuple[Signal, ...]

    def __post_init__(self) -> None:
        parts = tuple(as_signal(part) for part in self.parts)
        if not parts:
            raise ValueError("Sum: no signals were given; at least one is expected")
        object.__setattr__(self, "parts", parts)

    @property
    def end(self) -> float:
        return max(part.end for part in self.parts)

    @property
    def highest_frequency(self) -> float | None:
        """The highest one of the parts, Hz; None if one is not known."""
        bands = [part.highest_frequency for part in self.parts]
        known = [band for band in bands if band is not None]
        return max(known) if len(known) == len(bands) else None

    def _leaps(self, duration: float) -> bool:
        """Whether the value of a part jumps in 0 <= t < duration (s)."""
        return any(part._leaps(duration) for part in self.parts)

    @property
    def breaks(self) -> tuple[float, ...]:
        return tuple(sorted({instant for part in self.parts for instant in part.breaks}))

    def _values(self, t: np.ndarray, side: int = 0) -> np.ndarray:
        return np.sum([part._values(t, side) for part in self.parts], axis=0)

    def _scaled(self, factor: float) -> Sum:
        return Sum(tuple(part._scaled(factor) for part in self.parts))

    def __repr__(self) -> str:
        return " + ".join(map(repr, self.parts))


def _total(signals: tuple[Signal, ...]) -> Signal:
    """The sum, flat, with at most one constant and none that is zero."""
    parts = [part for signal in signals for part in (signal.parts if isinstance(signal, Sum) else (signal,))]
    constants = [part.value for part in parts if isinstance(part, Constant)]
    constant, parts = sum(constants), [part for part in parts if not isinstance(part, Constant)]
    rounding = abs(constant) <= _CANCELLED * max(map(abs, constants), default=0.0)
    if not (rounding and parts):
        parts.insert(0, Constant(0.0 if rounding else constant))
    return parts[0] if len(parts) == 1 else Sum(tuple(parts))


def as_signal(value) -> Signal:
    """A number as a `Constant`, a function of time as a `Custom` of unknown band, a signal as it is; else a
    TypeError.
    """
    if isinstance(value, Signal):
        return value
    if isinstance(value, Real) and not isinstance(value, (bool, np.bool_)):
        return Constant(float(value))
    if callable(value) and not isinstance(value, type):
        return Custom(value)
    raise TypeError(f"signal {shown(value)} is neither a number nor a signal nor a function of time")

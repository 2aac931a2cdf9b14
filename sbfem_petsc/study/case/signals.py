"""Tables of a case file for the signals of loads."""

from __future__ import annotations

from typing import ClassVar, Literal

from ...options import item
from ...signals import samples, signal, waves
from .tables import Name, Table, by_kind


class HarmonicSignal(Table):
    """amplitude * sin(2 pi frequency t + phase)."""

    made: ClassVar = waves.Harmonic

    kind: Literal["harmonic"] = item(text="a sine")
    amplitude: float = item(text="amplitude", unit="that of the component")
    frequency: float = item(text="frequency", unit="Hz", gt=0)
    phase: float = item(0.0, text="phase", unit="rad")


class ToneBurstSignal(Table):
    """amplitude * sin(2 pi frequency t) * (1 - cos(2 pi frequency t / cycles)) until cycles / frequency, then
    zero; its peak is 2 * amplitude."""

    made: ClassVar = waves.ToneBurst

    kind: Literal["tone_burst"] = item(text="a windowed sine")
    amplitude: float = item(text="half the peak", unit="that of the component")
    frequency: float = item(text="carrier frequency", unit="Hz", gt=0)
    cycles: float = item(text="cycles in the burst", gt=0)


class ChirpSignal(Table):
    """A sine whose frequency runs linearly from `start` to `stop`."""

    made: ClassVar = waves.Chirp

    kind: Literal["chirp"] = item(text="a sine of running frequency")
    amplitude: float = item(text="amplitude", unit="that of the component")
    start: float = item(text="first frequency", unit="Hz", ge=0)
    stop: float = item(text="last frequency", unit="Hz", ge=0)
    duration: float = item(text="duration", unit="s", gt=0)
    phase: float = item(0.0, text="phase at the start", unit="rad")
    taper: float = item(0.0, text="time of rise and of fall", unit="s", ge=0)


class StepSignal(Table):
    """Zero before `time`, `amplitude` from then on."""

    made: ClassVar = waves.Step

    kind: Literal["step"] = item(text="a jump, or a smooth rise")
    amplitude: float = item(text="value after the step", unit="that of the component")
    time: float = item(0.0, text="instant of the step", unit="s")
    rise: float = item(0.0, text="time of the rise", unit="s", ge=0)


class ConstantSignal(Table):
    """A constant: a preload beside oscillating loads."""

    made: ClassVar = signal.Constant

    kind: Literal["constant"] = item(text="a constant, a preload")
    value: float = item(text="value", unit="that of the component")


class SampledSignal(Table):
    """Samples from a text file of two columns, time and value."""

    made: ClassVar = samples.Samples.from_csv

    kind: Literal["samples"] = item(text="samples from a file")
    file: Name = item(text="path of the file, relative to the case file")
    interpolation: Literal["linear", "cubic"] = item("linear", text="between the samples")
    time_scale: float = item(1.0, text="factor on the times: 1e-3 for ms", gt=0)
    value_scale: float = item(1.0, text="factor on the values")


SIGNALS = (HarmonicSignal, ToneBurstSignal, ChirpSignal, StepSignal, ConstantSignal, SampledSignal)


Component = by_kind(*SIGNALS, number=True)

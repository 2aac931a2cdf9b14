"""Tables of a case file for the signals of loads."""

from __future__ import annotations

from typing import ClassVar, Literal

from ...options import item
from ...signals import samples, signal, waves
from .tables import Name, Table, by_kind, table_of


class SampledSignal(Table):
    """Samples from a text file of two columns, time and value."""

    made: ClassVar = samples.Samples.from_csv

    kind: Literal["samples"] = item(text="samples from a file")
    file: Name = item(text="path of the file, relative to the case file")
    interpolation: Literal["linear", "cubic"] = item("linear", text="between the samples")
    time_scale: float = item(1.0, text="factor on the times: 1e-3 for ms", gt=0)
    value_scale: float = item(1.0, text="factor on the values")


SIGNALS = (
    table_of(waves.Harmonic, "HarmonicSignal", "harmonic", "a sine"),
    table_of(waves.ToneBurst, "ToneBurstSignal", "tone_burst", "a windowed sine"),
    table_of(waves.Chirp, "ChirpSignal", "chirp", "a sine of running frequency"),
    table_of(waves.Step, "StepSignal", "step", "a jump, or a smooth rise"),
    table_of(signal.Constant, "ConstantSignal", "constant", "a constant, a preload"),
    SampledSignal,
)
Component = by_kind(*SIGNALS, number=True)

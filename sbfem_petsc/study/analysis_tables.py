"""Tables of a case file for analyses."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Literal

from ..analysis.options import (
    BackboneOptions,
    BasinsOptions,
    FrequencyRange,
    FrequencyResponseOptions,
    LineOptions,
    LoadHistoryOptions,
    LoadResponseOptions,
    ModalOptions,
    PeriodicOptions,
    QuasiPeriodicOptions,
    StaticOptions,
    SweptOptions,
    SwitchOptions,
    TorusCurveOptions,
    TransientOptions,
)
from ..options import Pair, item
from .case.sweep import Times
from .case.tables import Name, Names, Table, by_kind

_LOAD = "name of a load, or several that act together"


class Loaded(Table):
    """What a table of an analysis under one load has."""

    load: Names = item(text=_LOAD)
    factor: float = item(1.0, text="factor on the load")


class ModalAnalysis(ModalOptions, Table):
    """Natural frequencies and modes of the undamped structure with open cracks: `count` or `band`."""

    kind: Literal["modal"] = item(text="natural frequencies and modes")


class StaticAnalysis(StaticOptions, Loaded):
    """Displacement, contact forces and stress intensity under constant loads."""

    kind: Literal["static"] = item(text="equilibrium with contact")
    stress_at: dict[Name, Pair | Name] = item(
        {},
        text="places whose stress is wanted by names of your choice, name = [x, y] or the name of a point",
        unit="m",
    )


class LoadHistory(LoadHistoryOptions, Loaded):
    """Static states along loads that change slowly, signals taken at each time; numbers are constants."""

    kind: Literal["load_history"] = item(text="equilibria under slowly changing loads")
    times: Times = item(text="times of the states, an array or { start, stop, count }", unit="s")


class TransientAnalysis(TransientOptions, Loaded):
    """A time history with contact; numbers in the load are constants from t = 0."""

    kind: Literal["transient"] = item(text="time history")
    initial: Literal["rest", "equilibrium"] = item(
        "rest", text="at rest, or in static equilibrium with the loads at t = 0"
    )
    reduced: bool = item(True, text="false: the unreduced model")

    def contradictions(self) -> Iterator[tuple[str, str]]:
        """A scheme of the unreduced model alone, too."""
        yield from super().contradictions()
        if self.scheme == "paper" and self.reduced and "reduced" in self.model_fields_set:
            yield "scheme", '= "paper" integrates the unreduced model; leave reduced = true out'


class PeriodicAnalysis(PeriodicOptions, Loaded):
    """The steady state under periodic loads by shooting; numbers in the load are amplitudes of
    sin(2 pi frequency t)."""

    kind: Literal["periodic"] = item(text="steady state")
    reduced: bool = item(True, text="false: the unreduced model")

    def contradictions(self) -> Iterator[tuple[str, str]]:
        """What the unreduced model has not, too."""
        yield from super().contradictions()
        if not self.reduced and self.segments > 1:
            yield "segments", "is for the reduced model; leave out reduced = false or segments"
        if not self.reduced and self.tolerance is not None:
            yield "tolerance", "is for the reduced model; leave out reduced = false, or give steps"
        if not self.reduced and self.stability:
            yield "stability", "= true is for the reduced model; leave out reduced = false or stability"
        if not self.reduced and self.jacobian not in ("auto", "matrix-free"):
            yield "jacobian", f'= "{self.jacobian}" is for the reduced model; leave out reduced = false'


class FrequencyResponse(FrequencyResponseOptions, Loaded):
    """Steady states over the forcing frequency, through folds; the linear response without contact."""

    kind: Literal["frequency_response"] = item(text="response curve over the frequency")


class LoadResponse(LoadResponseOptions, Table):
    """Steady states at a fixed frequency over a factor on the oscillating loads."""

    kind: Literal["load_response"] = item(text="response curve over the load")
    load: Names = item(text=_LOAD)


class StartAxisTable(Table):
    """An axis of a grid of initial states."""

    values: Times = item(text="rising values: a list or { start, stop, count }")
    kind: Literal["displacement", "velocity", "impulse"] = item(
        "displacement", text="of a mode; impulse: of a unit load, N s"
    )
    mode: int = item(1, text="number of the mode, of an impulse that of the unit load, from 1", ge=1)
    point: Name | None = item(
        None, text="point whose motion the values are (m, m/s); default: modal coordinates"
    )
    direction: Literal["x", "y"] = item("y", text="direction of the point's motion")


class BasinsAnalysis(BasinsOptions, Loaded):
    """Which steady state the histories from a grid of initial states settle on."""

    kind: Literal["basins"] = item(text="basins of attraction")
    starts: list[StartAxisTable] = item(text="axes of the grid", min_length=1, max_length=3)


class SweptAnalysis(SweptOptions, Loaded):
    """A motion whose forcing frequency runs slowly from a steady state at `start` to `stop`, and back."""

    kind: Literal["swept_response"] = item(text="slowly swept frequency: amplitudes and jumps")
    back: bool = item(True, text="sweep back from stop to start as well")
    least: float = item(
        0.2, text="relative change of the amplitude, beyond that of a linear resonance, that is a jump", gt=0
    )


class LocusAnalysis(LineOptions, FrequencyRange, Loaded):
    """Bifurcations of a response curve over the frequency, followed over a second parameter: a map of
    behaviour."""

    kind: Literal["locus"] = item(text="bifurcations over frequency and a second parameter")
    least: float = item(0.5, text="least factor", ge=0, le=1)
    most: float = item(2.0, text="largest factor", ge=1)
    bifurcations: list[Literal["fold", "period doubling", "Neimark-Sacker", "grazing"]] = item(
        ["fold", "period doubling", "Neimark-Sacker"], text="which kinds are followed", min_length=1
    )

    def contradictions(self) -> Iterator[tuple[str, str]]:
        """A range of one factor, too."""
        yield from super().contradictions()
        if self.least == self.most:
            yield "most", f"= {self.most:g} is least itself; give a range of factors"


class ModulationAnalysis(Table):
    """Vibro-acoustic modulation: steady state under a strong low tone and a weak high one, with the sidebands
    of the high one. Numbers in the two loads are the tones' amplitudes."""

    kind: Literal["modulation"] = item(text="two tones and their sidebands")
    pump: Names = item(text="load of the low tone")
    pump_frequency: float = item(text="low tone", unit="Hz", gt=0)
    probe: Names = item(text="load of the high tone")
    probe_frequency: float = item(text="high tone", unit="Hz", gt=0)
    point: Name = item(text="point whose motion is read")
    direction: Literal["x", "y"] = item("y", text="direction of the motion that is read")
    pairs: int = item(3, text="pairs of sidebands", ge=1, le=10)
    longest: int = item(
        64, text="most periods of the low tone in the common period of both tones", ge=1, le=2000
    )
    steps: int | None = item(None, text="time steps a period of the low tone", ge=48)
    modes: int | None = item(None, text="modes; default: as for periodic", ge=1)
    contact: bool = item(True, text="false: crack faces may overlap")
    stability: bool = item(True, text="compute the Floquet multipliers")

    def contradictions(self) -> Iterator[tuple[str, str]]:
        """Tones in the wrong order."""
        if self.pump_frequency >= self.probe_frequency:
            yield (
                "pump_frequency",
                f"= {self.pump_frequency:g} must be below probe_frequency = {self.probe_frequency:g}, in Hz; "
                "exchange pump and probe",
            )


def _unresolved(order: int, samples: int) -> Iterator[tuple[str, str]]:
    """Lines that samples do not resolve."""
    if order > samples // 2:
        text = f"= {order} is more than half of samples = {samples}; give samples = {2 * order + 1} or more"
        yield "order", text


class QuasiPeriodicAnalysis(QuasiPeriodicOptions, Table):
    """The steady state under two tones of any frequencies: lines m probe + n pump. Numbers in the two loads
    are the tones' amplitudes; harmonic signals may be multiples of either tone."""

    kind: Literal["quasi_periodic"] = item(text="two tones without a common period")
    probe: Names = item(text="load of the first tone, whose sidebands are wanted")
    probe_frequency: float = item(text="first tone", unit="Hz", gt=0)
    pump: Names = item(text="load of the second tone")
    pump_frequency: float = item(text="second tone", unit="Hz", gt=0)
    order: int = item(3, text="lines are kept up to this |m| and |n|", ge=1, le=20)

    def contradictions(self) -> Iterator[tuple[str, str]]:
        """Tones that are one, and lines that the samples do not resolve."""
        if self.pump_frequency == self.probe_frequency:
            text = f"= {self.pump_frequency:g} is probe_frequency itself, in Hz; use periodic for one tone"
            yield "pump_frequency", text
        yield from _unresolved(self.order, self.samples)


class QuasiPeriodicResponse(TorusCurveOptions, SwitchOptions, FrequencyRange, Loaded):
    """Motions with a tone of their own behind a Neimark-Sacker point of a response curve over the frequency,
    followed over the frequency."""

    kind: Literal["quasi_periodic_response"] = item(text="curve of motions with a tone of their own")
    bifurcation: int = item(1, text="which of its Neimark-Sacker points, from 1", ge=1)
    end: float = item(text="frequency up to which the quasi-periodic motions are followed", unit="Hz", gt=0)
    order: int = item(3, text="lines are kept up to this |m| and |n|", ge=1, le=20)

    def contradictions(self) -> Iterator[tuple[str, str]]:
        """A range of one value, samples that are even, lines that they do not resolve."""
        yield from FrequencyRange.contradictions(self)
        yield from SwitchOptions.contradictions(self)
        yield from _unresolved(self.order, self.samples)


class Backbone(BackboneOptions, Table):
    """Free nonlinear vibration: frequency over energy of a nonlinear normal mode."""

    kind: Literal["backbone"] = item(text="frequency of free vibration over its energy")


ANALYSES = (
    ModalAnalysis,
    StaticAnalysis,
    LoadHistory,
    TransientAnalysis,
    PeriodicAnalysis,
    FrequencyResponse,
    LoadResponse,
    LocusAnalysis,
    SweptAnalysis,
    BasinsAnalysis,
    ModulationAnalysis,
    QuasiPeriodicAnalysis,
    QuasiPeriodicResponse,
    Backbone,
)
Analysis = by_kind(*ANALYSES)

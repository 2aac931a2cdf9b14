"""modulation: two tones with a common period, and the sidebands of the high one."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from fractions import Fraction
from typing import Any, Literal

import numpy as np

from ...indicators.lines import Sidebands, sidebands
from ...options import item
from ...record.found import Found, labelled
from ..case.tables import Name, Path
from ..costs import Cost, Size
from .kind import Drawn, Quantities, TwoTones, Values, Wanted, along, common_period
from .periodic import Steady, steady_cost

# Share of a period that counts as none when whole periods are counted.
_ROUNDING = 1e-9


class Modulation(Steady, TwoTones):
    """Vibro-acoustic modulation: steady state under a strong low tone and a weak high one, with the sidebands
    of the high one. Numbers in the two loads are the tones' amplitudes."""

    kind: Literal["modulation"] = item(text="two tones and their sidebands")
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
    function = "periodic"
    loads_in = ("pump", "probe")
    signals = ("constant",)

    def contradictions(self) -> Iterator[tuple[str, str]]:
        """Tones in the wrong order, sidebands below 0 Hz, and lines that the steps do not resolve."""
        furthest, rate = self.pairs * self.pump_frequency, self._steps() * self.pump_frequency
        if self.pump_frequency >= self.probe_frequency:
            yield (
                "pump_frequency",
                f"= {self.pump_frequency:g} must be below probe_frequency = {self.probe_frequency:g}, in Hz; "
                "exchange pump and probe",
            )
        elif furthest >= self.probe_frequency:
            yield (
                "pairs",
                f"= {self.pairs} reaches down to 0 Hz, for {self.pairs} times pump_frequency is "
                f"{furthest:g} Hz and probe_frequency = {self.probe_frequency:g} Hz; give fewer",
            )
        elif self.probe_frequency + furthest >= 0.5 * rate:
            yield (
                "steps",
                f"= {self.steps} tells lines below {0.5 * rate:g} Hz, and the highest sideband is at "
                f"{self.probe_frequency + furthest:g} Hz; give more, or leave steps out",
            )

    def given(self, case: Any) -> dict[str, Any]:
        return super().given(case) | {"frequency": self.pump_frequency, "steps": self._steps()}

    def _steps(self) -> int:
        """Time steps a period of the low tone; by default 64 or more of the high one."""
        return self.steps or max(512, math.ceil(64.0 * self.probe_frequency / self.pump_frequency))

    def _period(self) -> float:
        """Common period of the two tones, s."""
        ratio = Fraction(self.probe_frequency / self.pump_frequency).limit_denominator(self.longest)
        return ratio.denominator / self.pump_frequency

    def _sidebands(self, result: Any, noisy: Callable[[np.ndarray], np.ndarray] | None = None) -> Sidebands:
        """Read from the motion or from what `noisy` makes of it."""
        values, period = along(result.displacement(self.point), self.direction), self._period()
        # sidebands ask for two periods of the low tone at least, which a periodic motion has
        repeats = max(1, math.ceil(2.0 / (period * self.pump_frequency) - _ROUNDING))
        values = np.tile(values, repeats)
        values = values if noisy is None else noisy(values)
        time = np.arange(len(values)) * (repeats * period / len(values))
        return sidebands(time, values, self.probe_frequency, self.pump_frequency, order=self.pairs)

    def places(self) -> Iterator[tuple[Path, str]]:
        yield ("point",), self.point

    def tones(self, case: Any, path: Path) -> None:
        at = (*path, "probe_frequency")
        common_period(case, at, self.acting(case), self.pump_frequency, None, self.longest)

    def more(self, result: Any, points: Sequence[str]) -> Quantities:
        yield from super().more(result, points)
        yield labelled("common_period", self._period(), "s", "common period of both tones")

    def found(self, result: Any, points: Sequence[str]) -> Found:
        found, bands = super().found(result, points), self._sidebands(result)
        found.inner["sidebands"] = Found(
            [
                labelled("carrier", bands.carrier, "Hz", "high tone"),
                labelled("modulation", bands.modulation, "Hz", "low tone"),
                labelled("centre", complex(bands.centre), "m", "complex amplitude at the high tone"),
                labelled("lower", bands.lower, "m", "complex amplitudes at high - n low", "sideband"),
                labelled("upper", bands.upper, "m", "complex amplitudes at high + n low", "sideband"),
                labelled(
                    "indices", bands.indices, "1", "(|lower| + |upper|) / |centre| of each pair", "sideband"
                ),
                labelled("modulation_index", bands.modulation_index, "1", "that of the first pair"),
            ]
        )
        return found

    def row(self, result: Any, wanted: Wanted) -> Values:
        values = super().row(result, replace(wanted, noisy=None))
        # ratios to the low tone's own amplitude mean little for tones that are no multiples of it
        values = {key: entry for key, entry in values.items() if not key.startswith("A")}
        for ending, noisy in {"": None, "_noisy": wanted.noisy}.items():
            if ending and noisy is None:
                continue
            found = self._sidebands(result, noisy)
            values[f"modulation_index{ending}"] = (found.modulation_index, "1")
            values[f"sideband_indices{ending}"] = (np.asarray(found.indices), "1")
            values[f"carrier_amplitude{ending}"] = (abs(found.centre), "m")
        return values

    def pictures(self, result: Any, drawn: Drawn) -> Iterator[tuple[str, Any]]:
        found = self._sidebands(result)
        title = f"$u_{self.direction}$({self.point}), modulation index {found.modulation_index:.3g}"
        yield "sidebands", drawn.plot.plot_sidebands({drawn.title: found}, title=title, comm=drawn.comm)
        yield from super().pictures(result, drawn)

    def cost(self, size: Size) -> Cost:
        return steady_cost(size, self, self._steps() * max(1, round(self._period() * self.pump_frequency)))

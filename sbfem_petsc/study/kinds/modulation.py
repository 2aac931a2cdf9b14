"""modulation: two tones with a common period, and the sidebands of the high one."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from fractions import Fraction
from typing import Any, Literal

import numpy as np

from ...analysis.options import Integration
from ...indicators.lines import Sidebands, sidebands
from ...options import item
from ...record.found import Found, labelled
from ..case.tables import Name, Path
from ..costs import Cost, Size
from .kind import Drawn, Measured, Quantities, Steady, TwoTones, Values, along, common_period


class Modulation(Integration, Steady, TwoTones):
    """Vibro-acoustic modulation: steady state under a strong low tone and a weak high one, with the sidebands
    of the high one. Numbers in the two loads are the tones' amplitudes."""

    kind: Literal["modulation"] = item(text="two tones and their sidebands")
    point: Name = item(text="point whose motion is read")
    direction: Literal["x", "y"] = item("y", text="direction of the motion that is read")
    pairs: int = item(3, text="pairs of sidebands", ge=1, le=10)
    longest: int = item(
        64, text="most periods of the low tone in the common period of both tones", ge=1, le=2000
    )
    contact: bool = item(True, text="false: crack faces may overlap")
    stability: bool = item(True, text="compute the Floquet multipliers")
    function = "periodic"
    loads_in = ("pump", "probe")
    signals = ("constant",)

    def contradictions(self) -> Iterator[tuple[str, str]]:
        """Tones in the wrong order, sidebands below 0 Hz, and lines that the steps do not resolve."""
        low, high = self.pump_frequency, self.probe_frequency
        furthest, resolved = self.pairs * low, 0.5 * self._steps() * low
        if low >= high:
            text = f"= {low:g} must be below probe_frequency = {high:g}, in Hz; exchange pump and probe"
            yield "pump_frequency", text
        elif furthest >= high:
            yield (
                "pairs",
                f"= {self.pairs} reaches down to 0 Hz, for {self.pairs} times pump_frequency is "
                f"{furthest:g} Hz and probe_frequency = {high:g} Hz; give fewer",
            )
        elif high + furthest >= resolved:
            text = f"= {self.steps} tells lines below {resolved:g} Hz, and the highest sideband is at"
            yield "steps", f"{text} {high + furthest:g} Hz; give more, or leave steps out"

    def given(self, case: Any) -> dict[str, Any]:
        return super().given(case) | {"frequency": self.pump_frequency, "steps": self._steps()}

    def _steps(self) -> int:
        """Time steps a period of the low tone; by default 64 or more of the high one."""
        return self.steps or max(512, math.ceil(64.0 * self.probe_frequency / self.pump_frequency))

    def _periods(self) -> int:
        """Periods of the low tone in the common period of the two."""
        ratio = Fraction(self.probe_frequency / self.pump_frequency)
        return ratio.limit_denominator(self.longest).denominator

    def _sidebands(self, result: Any, measured: Measured = np.asarray) -> Sidebands:
        """Read from the motion as it is measured."""
        # they ask for two periods of the low tone at least, which a periodic motion has
        periods = max(2, result.periods)
        u = np.tile(along(result.displacement(self.point), self.direction), periods // result.periods)
        time = np.arange(len(u)) * (periods / self.pump_frequency / len(u))
        return sidebands(time, measured(u), self.probe_frequency, self.pump_frequency, order=self.pairs)

    def places(self) -> Iterator[tuple[Path, str]]:
        yield ("point",), self.point

    def tones(self, case: Any, path: Path) -> None:
        at = (*path, "probe_frequency")
        common_period(case, at, self.acting(case), self.pump_frequency, None, self.longest)

    def more(self, result: Any, points: Sequence[str]) -> Quantities:
        yield from super().more(result, points)
        period = self._periods() / self.pump_frequency
        yield labelled("common_period", period, "s", "common period of both tones")

    def found(self, result: Any, points: Sequence[str]) -> Found:
        found = super().found(result, points)
        found.inner["sidebands"] = Found.of(self._sidebands(result), points)
        return found

    def heard(self, result: Any, points: Sequence[str], measured: Measured, ending: str) -> Values:
        values = {} if ending else super().heard(result, points, measured, ending)
        found = self._sidebands(result, measured)
        values[f"modulation_index{ending}"] = (found.modulation_index, "1")
        values[f"sideband_indices{ending}"] = (found.indices, "1")
        values[f"carrier_amplitude{ending}"] = (abs(found.centre), "m")
        return values

    def pictures(self, result: Any, drawn: Drawn) -> Iterator[tuple[str, Any]]:
        found = self._sidebands(result)
        title = f"$u_{self.direction}$({self.point}), modulation index {found.modulation_index:.3g}"
        yield "sidebands", drawn.plot.plot_sidebands({drawn.title: found}, title=title, comm=drawn.comm)
        yield from super().pictures(result, drawn)

    def cost(self, size: Size) -> Cost:
        return size.motion(self, (size.modes(self.modes), self._steps()), self._periods())

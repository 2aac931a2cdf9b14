"""frequency_response: steady states over the forcing frequency."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any, Literal

from ...analysis.options import FrequencyResponseOptions
from ...options import item
from ...record.found import Found, column, labelled, of_points
from ..costs import CURVE_POINTS, Cost, Size
from .kind import Loaded, Quantities, Reducible


class Curve(Reducible):
    """A kind whose result is a response curve."""

    settles = oscillates = True
    saved = True
    details = ("harmonics",)
    pictured, captions = {"curve": "plot_branches"}, {"curve": "response curve"}

    def more(self, result: Any, points: Sequence[str]) -> Quantities:
        unstable = float(result.unstable.sum()) if result.stability_known else math.nan
        yield column(labelled("curve_points", len(result), text="points of the curve"))
        yield column(labelled("unstable_points", unstable, text="unstable ones, nan where that is unknown"))
        yield column(labelled("bifurcation_count", len(result.bifurcations), text="number of bifurcations"))
        if result.parameter != "frequency":
            last = lambda point: result.amplitude(point)[-1]
            yield column(of_points("last_amplitude", points, last, "m", "amplitude at the last point"))
            return
        for told in zip(*(result.peak(point).quantities() for point in points)):
            value = dict(zip(points, (q.value for q in told))).__getitem__
            yield column(of_points(told[0].name, points, value, told[0].unit, told[0].about.text))

    @classmethod
    def tables(cls, found: Found) -> Iterator[tuple[tuple[str, ...], list[tuple[Any, ...]]]]:
        rows = [(entry["kind"].value, entry["value"].value) for entry in found["bifurcations"]]
        yield ("bifurcation", "at"), rows


class FrequencyResponse(Curve, FrequencyResponseOptions, Loaded):
    """Steady states over the forcing frequency, through folds; the linear response without contact."""

    kind: Literal["frequency_response"] = item(text="response curve over the frequency")
    signals = ("constant",)

    def given(self, case: Any) -> dict[str, Any]:
        return super().given(case) | ({} if self.contact else {"file": None, "resume": False})

    def cost(self, size: Size) -> Cost:
        if not self.contact:
            return Cost(disk=1e6)
        taken = size.steady(self, self.start, max(self.start, self.stop, size.highest(self)), vectors=False)
        return curve_cost(size, self, taken, self.periods or 1)


def curve_cost(size: Size, table: Any, taken: tuple[int, int], periods: int = 1) -> Cost:
    """Of a curve of motions of so many forcing periods, in so many modes and steps a forcing period."""
    modes, steps = taken
    disk = 400.0 * min(table.points, CURVE_POINTS) * (modes + size.points * 60)
    return Cost(size.period(modes, steps * periods), disk, modes, steps)

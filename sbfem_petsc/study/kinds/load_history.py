"""load_history: equilibria under slowly changing loads."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np

from ...analysis.options import LoadHistoryOptions
from ...options import item
from ..case.sweep import Times, grid
from ..costs import Cost, Size
from .kind import Loaded, Moved, Values, Wanted, along


class LoadHistory(LoadHistoryOptions, Moved, Loaded):
    """Static states along loads that change slowly, signals taken at each time; numbers are constants."""

    kind: Literal["load_history"] = item(text="equilibria under slowly changing loads")
    times: Times = item(text="times of the states, an array or { start, stop, count }", unit="s")
    statics = True
    details = ("contact_force", "gap")
    pictured = {"history": "plot_load_history"}

    def given(self, case: Any) -> dict[str, Any]:
        return super().given(case) | {"time": grid(self.times)}

    def row(self, result: Any, wanted: Wanted) -> Values:
        values = super().row(result, wanted)
        values["closed_states"] = (float(np.sum(result.contact_resultant > 0.0)), "1")
        for point in wanted.points:
            values[f"peak/{point}"] = (float(np.abs(along(result.displacement(point))).max()), "m")
        for q in result.quantities(lambda about: about.called == "stress_intensity"):
            for name, factors in q.by_name():
                unit = q.units.get(name, q.unit)
                values[f"peak_stress_intensity/{name}"] = (np.abs(factors).max(axis=0), unit)
                if wanted.histories:
                    values[f"stress_intensity/{name}"] = (factors, unit)
        return values

    def cost(self, size: Size) -> Cost:
        count = len(grid(self.times))
        disk = 8.0 * count * (2 * size.pairs + 4 * size.points)
        return Cost(count * (16.0 * size.unknowns + 48.0 * size.pairs + 6e3), disk)

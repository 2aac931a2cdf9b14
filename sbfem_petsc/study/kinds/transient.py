"""transient: time history with contact."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any, Literal

import numpy as np

from ...analysis.options import TransientOptions
from ...options import item
from ...ranks.capacity import default_decimation
from ...record.found import labelled, of_points
from ..case.tables import Problem
from ..costs import Cost, Size
from .kind import Loaded, Moved, Quantities, Reducible, Values, Wanted, along


class Transient(Reducible, TransientOptions, Moved, Loaded):
    """A time history with contact; numbers in the load are constants from t = 0."""

    kind: Literal["transient"] = item(text="time history")
    initial: Literal["rest", "equilibrium"] = item(
        "rest", text="at rest, or in static equilibrium with the loads at t = 0"
    )
    moving = True
    details = ("contact_force", "slip", "friction_force", "velocity", "acceleration", "energy")
    pictured = {"history": "plot_history"}

    def lacking(self, case: Any, model: Any, most: int, words: str) -> Iterator[Problem]:
        """Loads that a structure at rest does not take, and more steps than there are or may be, too."""
        yield from super().lacking(case, model, most, words)
        from ...motion.loading import loading
        from ...motion.step_plan import default_step, plan_steps
        from ...reduction.build import default_modes

        step = self.step
        if model is not None:
            loads = loading("transient", model, self.acting(case))
            loads = loads.over("transient", self.duration, self.initial == "rest")
            highest, limited = loads.highest_frequency, self.contact and len(model.contact) or loads.jumps
            if step is None and self.accuracy is None:
                step = default_step(self.duration, highest, 0.0)
                if limited and (self.decimation or 1) * step > self.duration:  # the modes may need more
                    top = model.modes(self.modes or default_modes(model, highest)).frequencies[-1]
                    step = default_step(self.duration, highest, float(top))
        if step is not None:
            plan_steps(self.duration, step, self.decimation, 1, None)

    def more(self, result: Any, points: Sequence[str]) -> Quantities:
        dims = "time" if result.point_directions else "time xy"
        yield of_points("velocity", points, result.velocity, "m/s", "velocity", dims)
        yield of_points("acceleration", points, result.acceleration, "m/s^2", "acceleration", dims)
        energies = {q.name: q.value for q in result.energy.quantities()}
        text = "energies, work of loads and contact, and what damping and friction take"
        table = np.stack([*energies.values()], axis=1)
        yield labelled("energy", table, "J", text, "time kind", {"kind": energies})

    def row(self, result: Any, wanted: Wanted) -> Values:
        values = super().row(result, wanted)
        for point in wanted.points:
            u = result.displacement(point)
            values[f"peak/{point}"] = (float(np.abs(along(u)).max()), "m")
            if wanted.histories and wanted.noisy is not None:
                noisy = np.stack([wanted.noisy(c) for c in np.atleast_2d(u.T)], axis=-1)
                values[f"displacement_noisy/{point}"] = (noisy, "m")
        return values

    def cost(self, size: Size) -> Cost:
        highest = size.highest(self)  # of the loads: the highest mode is not known yet
        default = 1.0 / (320.0 * highest) if highest > 0.0 else self.duration / 2000.0
        count = max(1, math.ceil(self.duration / (self.step or default)))
        row = 8 * (2 * size.modes(self.modes) + size.pairs + 6 + 4 * size.points)
        memory = float(row * count / (self.decimation or default_decimation(count, row)))
        return Cost(memory, 2.0 * memory)

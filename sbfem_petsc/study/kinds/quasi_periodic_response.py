"""quasi_periodic_response: motions with a tone of their own behind a Neimark-Sacker point."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal

import numpy as np

import sbfem_petsc as sb

from ...analysis.options import FrequencyRange, SwitchOptions, TorusCurveOptions
from ...errors import SolveError
from ...options import item
from ...record.found import column, labelled, of_points
from ..costs import CURVE_POINTS, Cost, Size
from .kind import Loaded, Quantities, size_of
from .quasi_periodic import Lines, curve_memory, line_values, lines_of


class QuasiPeriodicResponse(Lines, TorusCurveOptions, SwitchOptions, FrequencyRange, Loaded):
    """Motions with a tone of their own behind a Neimark-Sacker point of a response curve over the frequency,
    followed over the frequency."""

    kind: Literal["quasi_periodic_response"] = item(text="curve of motions with a tone of their own")
    bifurcation: int = item(1, text="which of its Neimark-Sacker points, from 1", ge=1)
    end: float = item(text="frequency up to which the quasi-periodic motions are followed", unit="Hz", gt=0)
    signals = ("constant",)
    saved = oscillates = True
    pictured = {"own_tones": "plot_quasi_periodic"}

    def solve(self, case: Any, model: Any, file: Any = None, progress: Any = None) -> sb.QuasiPeriodicBranch:
        load = self.acting(case)
        curve = sb.frequency_response(model, load, **self.of(FrequencyRange), progress=progress)
        found = [item for item in curve.bifurcations if item.kind == "Neimark-Sacker"]
        if len(found) < self.bifurcation:
            raise SolveError(
                f"quasi_periodic_response: the curve from {self.start:g} to {self.stop:g} Hz has "
                f"{len(found)} Neimark-Sacker points, not {self.bifurcation}; give another bifurcation, "
                "range or load"
            )
        guess = sb.switch_branch(curve, found[self.bifurcation - 1], **self.of(SwitchOptions))
        options = {"largest_step": self.largest_step, **self.of(TorusCurveOptions)}
        return sb.quasi_periodic_response(guess, self.end, **options, progress=progress)

    def more(self, result: Any, points: Sequence[str]) -> Quantities:
        named = lines_of(result.frequencies[0], self.order)

        def lines(point: str) -> np.ndarray:
            return np.array([line_values(motion, named, point) for motion in result.motions])

        yield labelled("own_frequency", result.frequencies[:, 1], "Hz", "of the motion's own tone", "point")
        text = "m, n of each line, in order of frequency at the first motion"
        yield labelled("line_tones", named, "1", text, "kept_line number")
        text = "complex amplitudes of u_y at m f1 + n f2, by motion and line"
        yield of_points("lines", points, lines, "m", text, "point kept_line")

        def own(point: str) -> np.ndarray:
            return np.abs(result.line(0, 1, point))

        text = "amplitude of u_y at the own tone"
        yield of_points("own_amplitude", points, own, "m", text, "point")
        yield column(
            of_points("largest_own_amplitude", points, lambda p: own(p).max(), "m", f"largest {text}")
        )
        tones = result.frequencies[:, 1]
        for which, tone in (("least", float(tones.min())), ("largest", float(tones.max()))):
            yield column(labelled(f"{which}_own_frequency", tone, "Hz", f"{which} own tone"))
        yield from size_of(result)

    def cost(self, size: Size) -> Cost:
        lines, states = size.points * (2 * self.order + 1) ** 2, 2 * self.samples * size.modes(self.modes)
        disk = 16.0 * min(self.points, CURVE_POINTS) * (lines + states)
        return Cost(curve_memory(size, self), disk)

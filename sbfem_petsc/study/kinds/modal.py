"""modal: natural frequencies and modes."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any, Literal

import numpy as np

import sbfem_petsc as sb

from ...analysis.options import ModalOptions
from ...indicators.detection import frequency_shift
from ...options import item
from ...record.found import Found, column, labelled
from ..costs import Cost, Size
from .kind import Drawn, Kind, Quantities, Values, Wanted, estimated_error

# Rows of a report's table.
_ROWS = 60


class Modal(ModalOptions, Kind):
    """Natural frequencies and modes of the undamped structure with open cracks: `count` or `band`."""

    kind: Literal["modal"] = item(text="natural frequencies and modes")
    free = fields = True
    plane = ("accuracy",)
    captions = {"modes": "mode shapes"}

    def asked(self, case: Any, model: Any) -> Iterator[tuple[str, int]]:
        yield "count", self.count or 0
        if self.band is None or model is None:
            return
        from ...system.model import count_below
        from ...system.solve.pencil import top_of_band

        low, high = self.band
        # far below what the mesh carries nothing needs to be counted
        if 4.0 * math.pi * high > top_of_band(model.statics.elements, model.boundary_unknowns // 2):
            below = [count_below(model, end) or 0 if end else 0 for end in (low, high)]
            yield "band", below[1] - below[0]

    def more(self, result: Any, points: Sequence[str]) -> Quantities:
        yield estimated_error(self, result)
        if isinstance(result, sb.Modal):
            largest = float(result.residuals.max(initial=0.0))
            yield column(labelled("largest_residual", largest, text="largest of the residuals"))

    def row(self, result: Any, wanted: Wanted) -> Values:
        values, healthy = super().row(result, wanted), wanted.healthy()
        if healthy is not None:
            values["frequency_shift"] = (_shift(result.frequencies, healthy.frequencies), "1")
        return values

    def pictures(self, result: Any, drawn: Drawn) -> Iterator[tuple[str, Any]]:
        if isinstance(result, sb.Modal) and len(result.frequencies):
            yield "modes", drawn.plot.plot_modes(result)

    def write_fields(self, result: Any, path: str, model: Any) -> None:
        from ...results.vtu import write_modes

        if len(result.frequencies):
            write_modes(path, result)

    def cost(self, size: Size) -> Cost:
        count = self.count or 50
        return Cost(24.0 * size.unknowns * count, 16.0 * count * (size.points + 1))

    @classmethod
    def tables(cls, found: Found) -> Iterator[tuple[tuple[str, ...], list[tuple[Any, ...]]]]:
        frequencies = found["frequencies"].value[:_ROWS]
        yield ("mode", "frequency, Hz"), list(enumerate(map(float, frequencies), 1))


def _shift(cracked: Any, healthy: Any) -> np.ndarray:
    """Relative shift of frequencies paired by their numbers; nan where one structure has fewer in a band."""
    both = min(len(cracked), len(healthy))
    shift = frequency_shift(cracked[:both], healthy[:both])
    return np.append(shift, np.full(len(cracked) - both, np.nan))

"""backbone: frequency of free vibration over its energy."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, Literal

from ...analysis.options import BackboneOptions
from ...options import item
from ...record.found import column, labelled
from ..costs import Cost, Size
from .kind import Drawn, Kind, Quantities


class Backbone(BackboneOptions, Kind):
    """Free nonlinear vibration: frequency over energy of a nonlinear normal mode."""

    kind: Literal["backbone"] = item(text="frequency of free vibration over its energy")
    rubs = False
    details = ("harmonics",)

    def asked(self, case: Any, model: Any) -> Iterator[tuple[str, int]]:
        yield from super().asked(case, model)
        if self.modes is None:
            yield "mode", self.mode if model is None else self._kept()

    def _kept(self) -> int:
        from ...analysis.backbone import MODES  # on PETSc, which `sbfem doctor` may find missing

        return self.modes or 3 * self.mode + MODES

    def more(self, result: Any, points: Sequence[str]) -> Quantities:
        first, last = map(float, result.frequency[[0, -1]])
        yield column(labelled("first_frequency", first, "Hz", "frequency of the first point"))
        yield column(labelled("last_frequency", last, "Hz", "frequency of the last point"))
        yield column(labelled("last_energy", float(result.energy[-1]), "J", "energy of the last point"))

    def pictures(self, result: Any, drawn: Drawn) -> Iterator[tuple[str, Any]]:
        yield "backbone", drawn.plot.plot_backbone({drawn.title: result}, comm=drawn.comm)

    def cost(self, size: Size) -> Cost:
        from ...analysis.backbone import STEPS

        return size.curve(self, (self._kept(), self.steps or STEPS))

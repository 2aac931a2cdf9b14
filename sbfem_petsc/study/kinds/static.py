"""static: equilibrium with contact."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, Literal

import numpy as np

import sbfem_petsc as sb

from ...analysis.options import StaticOptions
from ...options import Pair, item
from ...record.found import column, labelled
from ..case.tables import FileName, Name, Path, Problem
from ..costs import Cost, Size
from .kind import Drawn, Loaded, Quantities, estimated_error

# Cracks of a model that are drawn.
MOST_CRACKS = 4


class Static(StaticOptions, Loaded):
    """Displacement, contact forces and stress intensity under constant loads."""

    kind: Literal["static"] = item(text="equilibrium with contact")
    stress_at: dict[FileName, Pair | Name] = item(
        {},
        text="places whose stress is wanted by names of your choice, name = [x, y] or the name of a point",
        unit="m",
    )
    signals = ()
    statics = fields = True
    plane = ("accuracy", "stress_at")
    captions = {"crack": "deformed region of crack", "contact": "contact pressure and gap along crack"}

    def places(self) -> Iterator[tuple[Path, str]]:
        return ((("stress_at", name), at) for name, at in self.stress_at.items() if isinstance(at, str))

    def lacking(self, case: Any, model: Any, most: int, words: str) -> Iterator[Problem]:
        """Places outside the structure, too."""
        yield from super().lacking(case, model, most, words)
        for name, at in self.stress_at.items() if model is not None else ():
            if not isinstance(at, str):
                try:
                    model.places([tuple(at)])
                except ValueError as error:
                    yield Problem(("stress_at", name), f"is refused: {error}")

    def more(self, result: Any, points: Sequence[str]) -> Quantities:
        places = [at if isinstance(at, str) else tuple(at) for at in self.stress_at.values()]
        if places:
            stresses = np.array([result.stress(place) for place in places])
            names = {"at": self.stress_at}
            yield column(labelled("stress", stresses, "Pa", "stress xx, yy, xy", "at tensor", names))
        yield estimated_error(self, result)

    def pictures(self, result: Any, drawn: Drawn) -> Iterator[tuple[str, Any]]:
        cracks = () if isinstance(result, sb.ReducedStatic) else result.model.cracks
        for crack in range(min(len(cracks), MOST_CRACKS)):
            yield f"crack{crack + 1}", drawn.plot.plot_crack(result.model, {drawn.title: result}, crack)
            if result.contact_resultant > 0.0:
                yield f"contact{crack + 1}", drawn.plot.plot_contact({drawn.title: result}, crack)

    def write_fields(self, result: Any, path: str, model: Any) -> None:
        from ...results.vtu import write_vtu

        write_vtu(path, getattr(model, "body", None) or result.model, {"displacement": result})

    def cost(self, size: Size) -> Cost:
        return Cost(disk=32.0 * size.pairs)

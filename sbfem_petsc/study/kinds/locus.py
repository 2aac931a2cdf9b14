"""locus: bifurcations of a response curve, followed over a second parameter."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any, Literal

import sbfem_petsc as sb

from ...analysis.options import FrequencyRange, LineOptions
from ...options import item
from ...record.found import Found, column, labelled
from ..case.tables import Problem
from ..costs import STEPS, Cost, Size
from .kind import Drawn, Loaded, Quantities


class Locus(LineOptions, FrequencyRange, Loaded):
    """Bifurcations of a response curve over the frequency, followed over a second parameter: a map of
    behaviour."""

    kind: Literal["locus"] = item(text="bifurcations over frequency and a second parameter")
    least: float = item(0.5, text="least factor", ge=0, le=1)
    most: float = item(2.0, text="largest factor", ge=1)
    bifurcations: list[Literal["fold", "period doubling", "Neimark-Sacker", "grazing"]] = item(
        ["fold", "period doubling", "Neimark-Sacker"], text="which kinds are followed", min_length=1
    )
    signals = ("constant",)
    saved = oscillates = True

    @property
    def frictionless(self) -> str | None:
        """See `Kind`."""
        return " of grazing points" if "grazing" in self.bifurcations else None

    def contradictions(self) -> Iterator[tuple[str, str]]:
        """A range of one factor, too."""
        yield from super().contradictions()
        if self.least == self.most:
            yield "most", f"= {self.most:g} is least itself; give a range of factors"

    def against(self, case: Any) -> Iterator[Problem]:
        """A factor on damping that there is none of, too."""
        yield from super().against(case)
        if self.parameter == "damping" and case.model.damping == 0.0 and case.model.rayleigh is None:
            text = '= "damping" has no effect without damping; give model.damping, or another parameter'
            yield Problem(("parameter",), text)

    def solve(self, case: Any, model: Any, file: Any = None, progress: Any = None) -> tuple[sb.Locus, ...]:
        load, kinds = self.acting(case), tuple(self.bifurcations)
        curve = sb.frequency_response(model, load, **self.of(FrequencyRange), progress=progress)
        options = self.of(LineOptions)
        return sb.loci(curve, self.least, self.most, kinds=kinds, **options, progress=progress)

    def more(self, result: Any, points: Sequence[str]) -> Quantities:
        yield labelled("count", len(result), text="number of lines")
        if not result:
            listed = " or ".join(filter(None, (", ".join(self.bifurcations[:-1]), self.bifurcations[-1])))
            found = f"was found on the curve from {self.start:g} to {self.stop:g} Hz"
            at = f" at {self.factor:g} times the load" * (self.factor != 1.0)
            reason = f"no {listed} that can be followed {found}{at}"
            yield labelled("reason", reason, text="why there is none")
        for kind in self.bifurcations:
            lines = [line for line in result if line.kind == kind]
            name = kind.replace(" ", "_").replace("-", "_").lower()
            yield column(labelled(f"{name}_lines", len(lines), text=f"lines of {kind}"))
            least = min((float(line.value.min()) for line in lines), default=math.nan)
            yield column(labelled(f"{name}_least_factor", least, text="least factor on them"))

    def found(self, result: Any, points: Sequence[str]) -> Found:
        lines = tuple(Found.of(line, points) for line in result)
        return Found(self.more(result, points), {"loci": lines})

    def pictures(self, result: Any, drawn: Drawn) -> Iterator[tuple[str, Any]]:
        if result:
            yield "loci", drawn.plot.plot_loci(result, title=drawn.title, comm=drawn.comm)

    def cost(self, size: Size) -> Cost:
        return Cost(size.period(size.modes(self.modes), self.steps or STEPS), 256.0 * self.points)

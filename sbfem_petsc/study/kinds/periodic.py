"""periodic: the steady state under periodic loads."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal

from ...analysis.options import PeriodicOptions
from ...indicators.lines import harmonic_ratios
from ...options import item
from ..case.tables import Path
from ..costs import Cost, Size
from .kind import Forced, Measured, Reducible, Steady, Values, common_period

# Highest order of the ratios A_n / A_1 that stand in the table of a sweep.
RATIOS = 6


class Periodic(Reducible, PeriodicOptions, Steady, Forced):
    """The steady state under periodic loads by shooting; numbers in the load are amplitudes of
    sin(2 pi frequency t)."""

    kind: Literal["periodic"] = item(text="steady state")
    settles = True

    @property
    def frictionless(self) -> str | None:
        return super().frictionless or (" in segments" if self.segments > 1 else None)

    def tones(self, case: Any, path: Path) -> None:
        found = self.acting(case, self.frequency)
        periods = common_period(case, (*path, "load"), found, self.frequency, self.periods, self.longest)
        if self.steps is not None and self.steps * periods % self.segments:
            raise case.problem(
                (*path, "segments"),
                f"= {self.segments} must divide the {self.steps * periods} steps of a period of the motion; "
                "give another number of either, or leave steps out",
            )

    def heard(self, result: Any, points: Sequence[str], measured: Measured, ending: str) -> Values:
        values = super().heard(result, points, measured, ending)
        for point in points:
            c, _ = values[f"harmonics{ending}/{point}"]
            if abs(c[1]) > 0.0:
                ratio = harmonic_ratios(c)
                values |= {f"A{n}_A1{ending}/{point}": (float(ratio[n]), "1") for n in range(2, RATIOS + 1)}
        return values

    def cost(self, size: Size) -> Cost:
        taken = size.steady(self, self.frequency, size.highest(self))
        return size.motion(self, taken, self.periods or 1)

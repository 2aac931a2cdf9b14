"""load_response: steady states over a factor on the oscillating loads, the damping or the gaps."""

from __future__ import annotations

from typing import Literal

from ...analysis.options import LoadResponseOptions
from ...options import item
from ..costs import Cost, Size
from .kind import Curve, Forced


class LoadResponse(Curve, LoadResponseOptions, Forced):
    """Steady states at a fixed frequency over a factor on the oscillating loads, the damping or the gaps."""

    kind: Literal["load_response"] = item(text="response curve over the load")

    def cost(self, size: Size) -> Cost:
        taken = size.steady(self, self.frequency, size.highest(self), vectors=False)
        return size.curve(self, taken, self.periods or 1)

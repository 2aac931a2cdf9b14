"""frequency_response: steady states over the forcing frequency."""

from __future__ import annotations

from typing import Any, Literal

from ...analysis.options import FrequencyResponseOptions
from ...options import item
from ..costs import Cost, Size
from .kind import Curve, Loaded


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
        return size.curve(self, taken, self.periods or 1)

"""swept_response: a motion whose forcing frequency runs slowly."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any, Literal

import numpy as np

import sbfem_petsc as sb

from ...analysis.options import SweptOptions
from ...options import item
from ...record.found import Found, labelled
from ..costs import Cost, Size
from .kind import Drawn, Loaded, Values, Wanted


class SweptResponse(SweptOptions, Loaded):
    """A motion whose forcing frequency runs slowly from a steady state at `start` to `stop`, and back."""

    kind: Literal["swept_response"] = item(text="slowly swept frequency: amplitudes and jumps")
    back: bool = item(True, text="sweep back from stop to start as well")
    least: float = item(
        0.2, text="relative change of the amplitude, beyond that of a linear resonance, that is a jump", gt=0
    )
    signals = ("constant",)
    saved = oscillates = True

    def solve(
        self, case: Any, model: Any, file: Any = None, progress: Any = None
    ) -> tuple[sb.SweptResponse, ...]:
        load, there = self.acting(case), self.of(SweptOptions)
        ways = [there, {**there, "start": self.stop, "stop": self.start}][: 1 + self.back]
        return tuple(sb.swept_response(model, load, **way, progress=progress) for way in ways)

    def _jumps(self, swept: Any, point: str) -> np.ndarray:
        """Frequencies at which the amplitude jumps, Hz; nan for a sweep too short or fast to tell."""
        if not swept.tells_jumps:
            return np.array([np.nan])
        return np.array([jump.frequency for jump in swept.jumps(point, self.least)])

    def found(self, result: Any, points: Sequence[str]) -> Found:
        text = "frequencies at which the amplitude jumps; nan for a sweep too short or fast to tell"
        ways = {}
        for swept in result:
            way = ways["up" if swept.upwards else "down"] = super().found(swept, points)
            jumps = {point: self._jumps(swept, point) for point in points}
            way.inner["jump"] = Found(
                labelled(point, at, "Hz", text, f"jump_of_{point}") for point, at in jumps.items()
            )
        return Found([], ways)

    def row(self, result: Any, wanted: Wanted) -> Values:
        values: Values = {}
        for swept in result:
            way = "up" if swept.upwards else "down"
            for point in wanted.points:
                jumps = self._jumps(swept, point)
                values[f"{way}_amplitude/{point}"] = (float(swept.amplitude(point).max()), "m")
                values[f"{way}_jumps/{point}"] = (float(len(jumps)) if swept.tells_jumps else math.nan, "1")
                values[f"{way}_first_jump/{point}"] = (float(jumps[0]) if len(jumps) else math.nan, "Hz")
        return values

    def pictures(self, result: Any, drawn: Drawn) -> Iterator[tuple[str, Any]]:
        point = drawn.point(result[0].points)
        if point is not None:
            options = {"least": self.least, "title": drawn.title}
            yield "swept", drawn.plot.plot_swept(None, result, point, **options, comm=drawn.comm)

    def cost(self, size: Size) -> Cost:
        highest, numbers = max(self.start, self.stop), 2 * size.points + 1  # x and y of points, and contact
        steps = self.steps or max(320, size.steady(self, highest, highest, vectors=False)[1])
        cycles = 0.5 * (self.start + self.stop) * self.duration * (1 + self.back)
        return Cost(8.0 * self.duration * highest * steps * numbers, 16.0 * cycles * (numbers + 1))

"""quasi_periodic: two tones without a common period."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, Literal

import numpy as np

from ...analysis.options import QuasiPeriodicOptions
from ...options import Options, item
from ...record.about import Quantity
from ...record.found import Found, column, labelled, of_points
from ..case.objects import located, signals_of
from ..case.tables import Path
from ..costs import STEPS, Cost, Size
from .kind import PERIODIC, Drawn, Quantities, TwoTones, symbol

# Lines of a spectrum in a report.
_LINES = 15


class Lines(Options):
    """Which lines of a spectrum are kept, of motions at some phases of a tone."""

    order: int = item(3, text="lines are kept up to this |m| and |n|", ge=1, le=20)

    def contradictions(self) -> Iterator[tuple[str, str]]:
        """Lines that the samples do not resolve, too."""
        yield from super().contradictions()
        samples = vars(self)["samples"]
        if self.order > samples // 2:
            words = f"= {self.order} is more than half of samples = {samples}; give samples"
            yield "order", f"{words} = {2 * self.order + 1} or more"


class QuasiPeriodic(Lines, QuasiPeriodicOptions, TwoTones):
    """The steady state under two tones of any frequencies: lines m probe + n pump. Numbers in the two loads
    are the tones' amplitudes; harmonic signals may be multiples of either tone."""

    kind: Literal["quasi_periodic"] = item(text="two tones without a common period")
    signals = PERIODIC
    captions = {"lines": "lines of the spectrum"}

    def contradictions(self) -> Iterator[tuple[str, str]]:
        """Tones that are one, too."""
        if self.pump_frequency == self.probe_frequency:
            text = f"= {self.pump_frequency:g} is probe_frequency itself, in Hz; use periodic for one tone"
            yield "pump_frequency", text
        yield from super().contradictions()

    def given(self, case: Any) -> dict[str, Any]:
        return super().given(case) | {"frequencies": (self.probe_frequency, self.pump_frequency)}

    def tones(self, case: Any, path: Path) -> None:
        from ...motion.two_tones import drives

        pair = (self.probe_frequency, self.pump_frequency)
        with located(case, *path):
            drives(signals_of(self.acting(case)), (max(pair), min(pair)))

    def more(self, result: Any, points: Sequence[str]) -> Quantities:
        named = lines_of(result.frequencies, self.order)
        yield labelled("probe_frequency", float(result.frequencies[0]), "Hz", "first tone")
        yield labelled("pump_frequency", float(result.frequencies[1]), "Hz", "second tone")
        yield labelled("line", named, "1", "m, n of each line", "kept_line number")
        frequencies = np.abs(named @ np.array(result.frequencies))
        text = "of each line, |m probe + n pump|"
        yield column(labelled("frequency", frequencies, "Hz", text, "kept_line"))

        def lines(name: str, direction: str) -> Quantity | None:
            text = f"complex amplitudes of u_{direction} by line"
            own = lambda point: line_values(result, named, point, direction)
            return of_points(name, points, own, "m", text, "kept_line")

        yield column(lines("lines", "y"))
        if not result.point_directions:
            yield lines("lines_x", "x")
        text = "(|c_1,1| + |c_1,-1|) / |c_1,0| of u_y"
        yield column(of_points("modulation_index", points, result.modulation_index, "1", text))
        text, carrier = "amplitude of u_y at the first tone", lambda point: abs(result.line(1, 0, point))
        yield column(of_points("carrier_amplitude", points, carrier, "m", text))
        yield column(labelled("residual", float(result.residuals[-1]), text="the last residual"))
        yield column(labelled("iterations", len(result.residuals) - 1, text="Newton iterations"))
        if len(result.exponents):
            largest = float(result.exponents[0])
            yield column(labelled("largest_exponent", largest, "1/s", "largest Lyapunov exponent"))
        yield labelled(
            "stable", result.stable, text="stability, None if it was not asked for or is not known"
        )

    def pictures(self, result: Any, drawn: Drawn) -> Iterator[tuple[str, Any]]:
        # one that is held has no lines
        point = drawn.point(p for p in result.points if result.line(1, 0, p) or result.line(0, 1, p))
        if point is not None:
            axes = drawn.plot.plot_lines({drawn.title: result}, point, order=self.order, comm=drawn.comm)
            yield "lines", axes

    def cost(self, size: Size) -> Cost:
        return Cost(curve_memory(size, self), 16.0 * size.points * (2 * self.order + 1) ** 2)

    @classmethod
    def tables(cls, found: Found) -> Iterator[tuple[tuple[str, ...], list[tuple[Any, ...]]]]:
        """Lines of the spectrum, the highest first."""
        numbers, frequencies = found["line"].value, found["frequency"].value
        lines = dict(found["lines"].by_name()) if "lines" in found else {}
        heights = np.abs([*lines.values()]).reshape(len(lines), len(numbers))
        order = np.argsort(-heights.max(axis=0, initial=0.0), kind="stable")[:_LINES]
        heading = ("line", "frequency, Hz", *(f"|{symbol(found, point)}|, µm" for point in lines))
        names = [f"{m} probe {n:+d} pump" for m, n in numbers[order]]
        yield heading, list(zip(names, frequencies[order].tolist(), *(1e6 * heights[:, order]).tolist()))


def lines_of(frequencies: Sequence[float], order: int) -> np.ndarray:
    """(k, 2): m and n of the lines m f1 + n f2 with |m|, |n| <= order, by ascending frequency from the mean
    on; of a line and its mirror image the one whose frequency is positive.
    """
    span = range(-order, order + 1)
    found = [(m * frequencies[0] + n * frequencies[1], m, n) for m in span for n in span]
    found = [entry for entry in found if entry[0] > 0.0 or entry[1:] == (0, 0)]
    return np.array([entry[1:] for entry in sorted(found)])


def line_values(result: Any, lines: np.ndarray, point: str, direction: str = "y") -> np.ndarray:
    """(k,) complex amplitudes of a quasi-periodic motion at lines (m, n), m."""
    return np.array([result.line(int(m), int(n), point, direction) for m, n in lines])


def curve_memory(size: Size, table: Any) -> float:
    """Bytes of an invariant curve and the derivative of its trajectories."""
    modes, steps = size.modes(table.modes), table.steps or STEPS
    return 8.0 * table.samples * (2 * modes * (2 * modes + steps) + steps * size.pairs)

"""periodic: the steady state under periodic loads."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any, Literal

import numpy as np

from ...analysis.options import PeriodicOptions
from ...indicators.lines import harmonic_ratios
from ...options import item
from ...record.found import Found, column, labelled, of_points
from ..case.tables import Path
from ..costs import Cost, Size
from .kind import Drawn, Forced, Moved, Quantities, Reducible, Values, Wanted, along, common_period

# Harmonics of each point in a row of a sweep, and in a report.
ROW_HARMONICS, SHOWN = 21, 11
# Highest order of the ratios A_n / A_1 that stand in the table of a sweep.
RATIOS = 6
# Makes of a motion what is measured of it.
Measured = Callable[[np.ndarray], np.ndarray]


class Steady(Moved):
    """A kind whose result is one periodic motion."""

    moving = saved = True
    details = ("contact_force", "slip", "friction_force", "displacement", "reactions")
    captions = Moved.captions | {
        "orbit": "phase plane; gaps and contact resultant over a period",
        "multipliers": "Floquet multipliers",
    }

    def more(self, result: Any, points: Sequence[str]) -> Quantities:
        text = "stability, None if it was not asked for or is not known"
        yield labelled("stable", result.stable, text=text)
        yield column(labelled("iterations", int(result.iterations), text="Newton iterations"))
        yield column(labelled("residual", float(result.residuals[-1]), "m sqrt(kg)/s", "the last residual"))
        if len(result.multipliers):
            modulus = float(np.abs(result.multipliers[0]))
            yield column(labelled("largest_multiplier", modulus, text="largest Floquet multiplier's modulus"))
        if result.periods > 1:
            text = "complex amplitudes of u_y at j f / periods"
            yield of_points("subharmonics", points, result.subharmonics, "m", text, "subharmonic")

    def row(self, result: Any, wanted: Wanted) -> Values:
        values = super().row(result, wanted) | self.heard(result, wanted.points, np.asarray, "")
        if wanted.noisy is not None:
            values |= self.heard(result, wanted.points, wanted.noisy, "_noisy")
        return values

    def heard(self, result: Any, points: Sequence[str], measured: Measured, ending: str) -> Values:
        """What is read from the motion as it is measured, by names with an ending."""
        values: Values = {}
        for point in points:
            u = measured(along(result.displacement(point)))
            c = np.fft.rfft(u)[:: result.periods][:ROW_HARMONICS] / len(u)
            c[1:] *= 2.0
            values[f"harmonics{ending}/{point}"] = (c, "m")
        return values

    def pictures(self, result: Any, drawn: Drawn) -> Iterator[tuple[str, Any]]:
        # one that is held has no harmonics
        point = drawn.point(point for point in result.points if along(result.displacement(point)).any())
        if point is None:
            return
        yield "harmonics", drawn.plot.plot_harmonics({drawn.title: result}, point, comm=drawn.comm)
        if result.reduced is not None:
            yield "orbit", drawn.plot.plot_orbit(result, point, title=drawn.title, comm=drawn.comm)
        if len(result.multipliers):
            yield "multipliers", drawn.plot.plot_multipliers(result, title=drawn.title, comm=drawn.comm)
        yield from super().pictures(result, drawn)

    def save(self, result: Any, path: str) -> None:
        if result.reduced is not None:
            super().save(result, path)

    @classmethod
    def tables(cls, found: Found) -> Iterator[tuple[tuple[str, ...], list[tuple[Any, ...]]]]:
        if "harmonics" in found:
            # of rows of a body those alone, else of u_y
            of = {name: c if c.ndim == 1 else c[:, 1] for name, c in found["harmonics"].by_name()}
            heading = ("harmonic", *(f"|{symbol(found, point)}|, µm" for point in of))
            yield heading, list(zip(range(SHOWN), *(1e6 * abs(c) for c in of.values())))


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
        return steady_cost(size, self, taken, self.periods or 1)


def symbol(found: Found, point: str) -> str:
    """A point's displacement in the heading of a table: u_y, or along its own direction."""
    along = found["direction"][point].value if "direction" in found else "y"
    return f"u_{along}({point})" if along else f"u({point})"


def steady_cost(size: Size, table: Any, taken: tuple[int, int], periods: int) -> Cost:
    """Of one motion of so many forcing periods, in so many modes and steps a forcing period."""
    modes, steps = taken
    disk = 8.0 * periods * steps * (3 * modes + size.pairs + 2 * size.points)
    return Cost(size.period(modes, periods * steps, table.contact), disk, modes, steps)

"""periodic: the steady state under periodic loads."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any, Literal

import numpy as np

from ...analysis.options import PeriodicOptions
from ...indicators.lines import harmonic_ratios
from ...options import item
from ...record.found import Found, column, labelled, of_points
from ..case.tables import Path
from ..costs import Cost, Size
from .kind import Drawn, Forced, Loaded, Moved, Quantities, Reducible, Values, Wanted, along, common_period

# Harmonics of each point in a row of a sweep, and in a report.
ROW_HARMONICS, SHOWN = 21, 11
# Highest order of the ratios A_n / A_1 that stand in the table of a sweep.
RATIOS = 6


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
        values = super().row(result, wanted)
        for point in wanted.points:
            u = result.displacement(point)
            motions = {"": along(u)}
            if wanted.noisy is not None:
                motions["_noisy"] = wanted.noisy(along(u))
            for ending, motion in motions.items():
                values |= _harmonics(ending, point, motion, result.periods)
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
        yield from drawn.rubbing(result)

    def save(self, result: Any, path: str) -> None:
        if result.reduced is not None:
            super().save(result, path)

    @classmethod
    def tables(cls, found: Found) -> Iterator[tuple[tuple[str, ...], list[tuple[Any, ...]]]]:
        harmonics = found["harmonics"].by_name() if "harmonics" in found else ()
        # of rows of a body those alone, else of u_y
        levels = {name: 1e6 * np.abs(c if c.ndim == 1 else c[:, 1]) for name, c in harmonics}
        orders = range(min([SHOWN, *map(len, levels.values())]) if levels else 0)
        heading = ("harmonic", *(f"|{symbol(found, point)}|, µm" for point in levels))
        yield heading, [(k, *(float(values[k]) for values in levels.values())) for k in orders]


class Periodic(Reducible, PeriodicOptions, Steady, Forced, Loaded):
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

    def cost(self, size: Size) -> Cost:
        modes, steps = size.steady(self, self.frequency, size.highest(self))
        cost = steady_cost(size, self, steps * (self.periods or 1), modes)
        return replace(cost, modes=modes, steps=steps)


def symbol(found: Found, point: str) -> str:
    """A point's displacement in the heading of a table: u_y, or along its own direction."""
    along = found["direction"][point].value if "direction" in found else "y"
    return f"u_{along}({point})" if along else f"u({point})"


def steady_cost(size: Size, table: Any, steps: int, modes: int | None = None) -> Cost:
    """Of one motion of so many steps and modes."""
    modes = modes or size.modes(table.modes)
    disk = 8.0 * steps * (3 * modes + size.pairs + 2 * size.points)
    return Cost(size.period(modes, steps, table.contact), disk)


def _harmonics(ending: str, point: str, u: np.ndarray, periods: int) -> Values:
    c = np.fft.rfft(u)[::periods] / len(u)
    c[1:] *= 2.0
    values: Values = {f"harmonics{ending}/{point}": (c[:ROW_HARMONICS], "m")}
    if abs(c[1]) > 0.0:
        ratio = harmonic_ratios(c[:ROW_HARMONICS])
        values |= {f"A{n}_A1{ending}/{point}": (float(ratio[n]), "1") for n in range(2, RATIOS + 1)}
    return values

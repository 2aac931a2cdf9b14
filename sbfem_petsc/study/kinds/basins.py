"""basins: which steady state the histories from a grid of initial states settle on."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any, Literal

import numpy as np

import sbfem_petsc as sb

from ...analysis.options import BasinsOptions
from ...contact.law import peak_of
from ...options import item
from ...record.found import Found, column, labelled, of_points
from ..case import objects
from ..case.sweep import Times, grid
from ..case.tables import Name, Path, Problem, Table
from ..costs import FEWEST_MODES, Cost, Size
from .kind import Drawn, Forced, Quantities


class StartAxis(Table):
    """An axis of a grid of initial states."""

    values: Times = item(text="rising values: a list or { start, stop, count }")
    kind: Literal["displacement", "velocity", "impulse"] = item(
        "displacement", text="of a mode; impulse: of a unit load, N s"
    )
    mode: int = item(1, text="number of the mode, of an impulse that of the unit load, from 1", ge=1)
    point: Name | None = item(
        None, text="point whose motion the values are (m, m/s); default: modal coordinates"
    )
    direction: Literal["x", "y"] = item("y", text="direction of the point's motion")

    def contradictions(self) -> Iterator[tuple[str, str]]:
        """Values that do not rise, and a point that an impulse has not."""
        values = self.values
        listed = values if isinstance(values, list) else [values.start, values.stop][: values.count]
        if any(after <= before for before, after in zip(listed, listed[1:])):
            yield "values", f"= {listed} must rise"
        if self.kind == "impulse" and self.point is not None:
            yield "point", f"= {self.point!r} has no meaning for an impulse; leave it out"


class Basins(BasinsOptions, Forced):
    """Which steady state the histories from a grid of initial states settle on."""

    kind: Literal["basins"] = item(text="basins of attraction")
    starts: list[StartAxis] = item(text="axes of the grid", min_length=1, max_length=3)
    oscillates = saved = True

    def given(self, case: Any) -> dict[str, Any]:
        starts = [sb.StartAxis(**{**dict(axis), "values": grid(axis.values)}) for axis in self.starts]
        return super().given(case) | {"starts": starts}

    def lacking(self, case: Any, model: Any, most: int, words: str) -> Iterator[Problem]:
        """Modes and unit loads that there are not, too."""
        yield from super().lacking(case, model, most, words)
        units = objects.units(case, self.acting(case))
        highest = max((axis.mode for axis in self.starts if axis.kind != "impulse"), default=0)
        if self.modes is not None:
            most, words = self.modes, "as the table says; give more modes"
        elif model is not None and min(FEWEST_MODES, most // 2) < highest <= most:
            most, words = self._kept(case, model), "those that are kept by default; give modes"
        for k, axis in enumerate(self.starts):
            text = ""
            if axis.kind != "impulse":
                if axis.mode > most:
                    text = f"is more than the {most:,d} modes there are, {words}"
            elif axis.mode > len(units):
                text = f"is no number of a unit load; there are {len(units)}, from 1; give one of these"
            elif isinstance(units[axis.mode - 1], sb.EdgeMotion):
                text = "is a prescribed displacement, which gives no impulse; name one that is a force"
            if text:
                yield Problem(("starts", k, "mode"), f"= {axis.mode:,d} {text}")

    def _kept(self, case: Any, model: Any) -> int:
        """Modes of a model by default. Collective."""
        from ...reduction.build import default_modes

        bands = [one.highest_frequency for one in objects.signals_of(self.acting(case, self.frequency))]
        return default_modes(model, max(self.frequency if band is None else band for band in bands))

    def places(self) -> Iterator[tuple[Path, str]]:
        for k, axis in enumerate(self.starts):
            if axis.point is not None:
                yield ("starts", k, "point"), axis.point

    def found(self, result: Any, points: Sequence[str]) -> Found:
        found = super().found(result, points)
        found.inner["orbits"] = tuple(_orbit(result, k, points) for k in range(len(result.orbits)))
        return found

    def more(self, result: Any, points: Sequence[str]) -> Quantities:
        share, lost = float(result.share.max(initial=0.0)), float(np.mean(result.reached < 0))
        yield column(labelled("orbit_count", len(result.orbits), text="number of steady states"))
        yield column(labelled("largest_share", share, text="largest share of the initial states"))
        yield column(labelled("not_settled", lost, text="share of those that reach none"))

    def pictures(self, result: Any, drawn: Drawn) -> Iterator[tuple[str, Any]]:
        if len(result.axes) == 2 and min(result.reached.shape) > 1:
            yield "basins", drawn.plot.plot_basins(result, title=drawn.title, comm=drawn.comm)

    def cost(self, size: Size) -> Cost:
        starts = math.prod(len(grid(axis.values)) for axis in self.starts)
        return Cost(64.0 * starts * size.modes(self.modes), 32.0 * starts)


def _orbit(result: Any, k: int, points: Sequence[str]) -> Found:
    """What is told of a steady state."""
    orbit = result.orbits[k]
    largest, peak = complex(orbit.multipliers[0]), peak_of(orbit.contact_resultant)
    return Found(
        [
            labelled("periods", int(orbit.periods), text="forcing periods in its period"),
            labelled("largest_multiplier", largest, text="of largest modulus"),
            labelled("contact_peak", peak, "N", "contact resultant of largest modulus"),
            labelled("integrity", result.integrity(k), "J", "least energy that leads away"),
            of_points("amplitude", points, orbit.amplitude, "m", "half the peak-to-peak of u_y"),
        ]
    )

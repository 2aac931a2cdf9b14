"""Tables of a case file for ranges of values and sweeps."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Annotated, Any, Literal

from pydantic import Field

from ...options import item
from .tables import Names, Problem, Table

# Most values of a range, and rows of a sweep.
MOST = 1_000_000


class Range(Table):
    """Values from `start` to `stop`, both included; `count` of them in a grid."""

    start: float = item(text="first value", unit="that of the key")
    stop: float = item(text="last value", unit="that of the key")
    count: int | None = item(None, text="number of values (not for Latin hypercube samples)", ge=1, le=MOST)
    scale: Literal["linear", "logarithmic"] = item("linear", text="spacing")

    def contradictions(self) -> Iterator[tuple[str, str]]:
        """A range that has no logarithm."""
        if self.scale == "logarithmic" and not min(self.start, self.stop) > 0.0:
            yield "scale", '= "logarithmic" needs start and stop greater than 0'


class Grid(Range):
    """Values from `start` to `stop`, both included."""

    count: int = item(text="number of values", ge=1, le=MOST)


Values = Annotated[list[int | float | bool | str], Field(min_length=1)] | Range
Times = Annotated[list[float], Field(min_length=1)] | Grid


class Noise(Table):
    """White measurement noise on the motion that indicators are read from: histories of `transient`, one
    period of `periodic` and `modulation`."""

    snr: float = item(text="signal-to-noise ratio", unit="dB")
    seed: int = item(0, text="seed of the random numbers", ge=0)


class SweepTable(Table):
    """The analyses of the case for many values of its keys."""

    parameters: Annotated[dict[str, Values], Field(min_length=1)] = item(
        text='values of each key that varies, "geometry.notches[0].depth" = [...] or { start, stop, count }'
    )
    method: Literal["grid", "list", "latin_hypercube"] = item(
        "grid", text="every combination; the n-th values together; random samples that fill the ranges"
    )
    samples: int | None = item(None, text="number of Latin hypercube samples", ge=1, le=MOST)
    seed: int = item(0, text="seed of the samples", ge=0)
    analyses: Names | None = item(None, text="analyses that are run in each row; default: all")
    healthy: dict[str, Any] | None = item(
        None,
        text="keys of the structure that frequency shifts are relative to; default: without notches and "
        "cracks",
    )
    noise: Noise | None = item(None, text="measurement noise, { snr, seed }")
    ranks_per_row: int = item(1, text="ranks that compute a row together", ge=1)
    histories: bool = item(False, text="keep the motion of the points, not its harmonics alone")

    def problems(self) -> Iterator[Problem]:
        """What does not fit the method."""
        latin = self.method == "latin_hypercube"
        if latin and self.samples is None:
            text = 'is missing; method = "latin_hypercube" needs the number of samples'
            yield Problem(("samples",), text)
        if not latin and self.samples is not None:
            text = 'is for method = "latin_hypercube"; leave it out or change method'
            yield Problem(("samples",), text)
        for name, values in self.parameters.items():
            here = ("parameters", name)
            if isinstance(values, list):
                if latin:
                    yield Problem(here, 'must be { start, stop } with method = "latin_hypercube"')
            elif latin and values.count is not None:
                text = 'is not for method = "latin_hypercube"; give sweep.samples'
                yield Problem((*here, "count"), text)
            elif not latin and values.count is None:
                yield Problem((*here, "count"), "is missing (number of values); add it")
        yield from self._numbers()

    def _numbers(self) -> Iterator[Problem]:
        """Too many rows, and lists that are not equally long."""
        lengths = {
            name: len(values) if isinstance(values, list) else values.count or 0
            for name, values in self.parameters.items()
        }
        rows = math.prod(lengths.values())
        if self.method == "grid" and rows > MOST:
            yield Problem(
                ("parameters",),
                f"make {rows:,d} rows, more than {MOST:,d}; give fewer values, or samples with "
                'method = "latin_hypercube"',
            )
        if self.method == "list" and len(set(lengths.values())) > 1:
            listed = ", ".join(f"{name}: {count}" for name, count in lengths.items())
            text = f'must have equally many values each with method = "list" ({listed})'
            yield Problem(("parameters",), text)

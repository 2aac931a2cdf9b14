"""Tables of a case file for ranges of values and sweeps."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Discriminator, Field, Tag

from ...options import item
from .tables import Names, Table

# Most values of a range, and rows of a sweep.
MOST = 1_000_000


class Range(Table):
    """Values from `start` to `stop`, both included; `count` of them in a grid."""

    start: float = item(text="first value", unit="that of the key")
    stop: float = item(text="last value", unit="that of the key")
    count: int | None = item(None, text="number of values (not for Latin hypercube samples)", ge=1, le=MOST)
    scale: Literal["linear", "logarithmic"] = item("linear", text="spacing")


def _values_or_range(value: Any) -> str:
    return "range" if isinstance(value, (dict, Range)) else "values"


Values = Annotated[
    Annotated[list[int | float | bool | str], Field(min_length=1), Tag("values")]
    | Annotated[Range, Tag("range")],
    Discriminator(_values_or_range),
]
Times = Annotated[
    Annotated[list[float], Field(min_length=1), Tag("values")] | Annotated[Range, Tag("range")],
    Discriminator(_values_or_range),
]


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

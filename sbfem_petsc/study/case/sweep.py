"""What a sweep varies: its table in a case file, ranges of values, dotted paths into the case."""

from __future__ import annotations

import copy
import itertools
import math
import re
from collections.abc import Iterator, Mapping
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import AfterValidator, Field, ValidationError

from ... import options
from ...options import item, one_of
from .problems import from_validation, written
from .tables import Names, Path, Problem, Table

# Most values of a range, and rows of a sweep.
MOST = 1_000_000
_KEY = r'"([^"]*)"|([A-Za-z0-9_-]+)'
_PART = re.compile(rf"{_KEY}|\[(\d+)\]")
_NAME = re.compile(rf"(?:{_KEY})(?:\.(?:{_KEY})|\[\d+\])*")
# Tables that decide over mesh, model and reduction.
STRUCTURE = ("geometry", "body", "mesh", "points", "material", "materials", "model")
# Keys that say in words what they are, with their owner in the place of {}; and entries of arrays.
_WORDS = {
    **{f"f{axis}": f"force of {{}} along {axis}" for axis in "xy"},
    **{f"t{axis}": f"traction of {{}} along {axis}" for axis in "xy"},
    **{f"a{axis}": f"acceleration of {{}} along {axis}" for axis in "xyz"},
    "young": "Young's modulus of {}",
    "poisson": "Poisson's ratio of {}",
}
_SINGLE = {"notches": "notch", "holes": "hole", "cracks": "crack", "supports": "support"}


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

    def between(self, share: np.ndarray) -> np.ndarray:
        """Values at shares of the way from start to stop."""
        if self.scale == "linear":
            return self.start + share * (self.stop - self.start)
        low, high = math.log(self.start), math.log(self.stop)
        return np.exp(low + share * (high - low))


class Grid(Range):
    """Values from `start` to `stop`, both included."""

    count: int = item(text="number of values", ge=1, le=MOST)


def parsed(name: str) -> Path:
    """Path of a name such as "geometry.notches[0].depth".

    Raises
    ------
    ValueError
        If it is none.
    """
    if not _NAME.fullmatch(name):
        raise ValueError("is no path into the case; write it as in geometry.notches[0].depth")
    return tuple(int(number) if number else quoted or bare for quoted, bare, number in _PART.findall(name))


def _key(name: str) -> str:
    parsed(name)
    return name


Values = Annotated[list[int | float | bool | str], Field(min_length=1)] | Range
Key = Annotated[str, AfterValidator(_key)]
Times = Annotated[list[float], Field(min_length=1)] | Grid


def grid(values: list[Any] | Range) -> list[Any]:
    """Values that stand in an array, or those of a range with its count."""
    if not isinstance(values, Range):
        return list(values)
    assert values.count is not None
    spaced = np.linspace if values.scale == "linear" else np.geomspace
    found: list[Any] = spaced(values.start, values.stop, values.count).tolist()
    return found


class Noise(Table):
    """White measurement noise on the motion that indicators are read from: histories of `transient`, one
    period of `periodic` and `modulation`."""

    snr: float = item(text="signal-to-noise ratio", unit="dB")
    seed: int = item(0, text="seed of the random numbers", ge=0)


class SweepTable(Table):
    """The analyses of the case for many values of its keys."""

    parameters: Annotated[dict[Key, Values], Field(min_length=1)] = item(
        text='values of each key that varies, "geometry.notches[0].depth" = [...] or { start, stop, count }'
    )
    method: Literal["grid", "list", "latin_hypercube"] = item(
        "grid", text="every combination; the n-th values together; random samples that fill the ranges"
    )
    samples: int | None = item(None, text="number of Latin hypercube samples", ge=1, le=MOST)
    seed: int = item(0, text="seed of the samples", ge=0)
    analyses: Names | None = item(None, text="analyses that are run in each row; default: all")
    healthy: dict[Key, Any] | None = item(
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
            yield Problem(("samples",), 'is missing; method = "latin_hypercube" needs the number of samples')
        if not latin and self.samples is not None:
            yield Problem(("samples",), 'is for method = "latin_hypercube"; leave it out or change method')
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

    def rows(self) -> list[dict[str, Any]]:
        """Values of all parameters, row by row; the last parameter runs fastest in a grid."""
        ranges = [values for values in self.parameters.values() if isinstance(values, Range)]
        if self.method == "latin_hypercube":
            assert self.samples is not None
            from scipy.stats import qmc  # slow to load, for all commands

            shares = qmc.LatinHypercube(d=len(ranges), seed=self.seed).random(self.samples)
            columns = [values.between(shares[:, k]).tolist() for k, values in enumerate(ranges)]
        else:
            columns = [grid(values) for values in self.parameters.values()]
        chosen = itertools.product(*columns) if self.method == "grid" else zip(*columns)
        return [dict(zip(self.parameters, row)) for row in chosen]


def replaced_in(data: dict[str, Any], values: Mapping[str, Any]) -> dict[str, Any]:
    """A copy of a case's data with values at dotted paths, without the sweep, whose own paths need not lead
    anywhere any more.

    Raises
    ------
    ValueError
        If the table or array around a path does not exist.
    """
    result = {key: copy.deepcopy(value) for key, value in data.items() if key != "sweep"}
    for name, value in values.items():
        *above, last = path = parsed(name)
        here: Any = result
        if above:  # tables that are left out have defaults
            result.setdefault(str(path[0]), {})
        for k, part in enumerate(above):
            here = _entry(here, part, path[: k + 1])
        if isinstance(last, int) or not isinstance(here, dict):
            _entry(here, last, path)
        here[last] = value
    return result


def _entry(here: Any, part: str | int, path: Path) -> Any:
    if isinstance(part, int):
        if not isinstance(here, list):
            raise ValueError(f"leads nowhere: {written(path[:-1])} is no array")
        if part >= len(here):
            raise ValueError(f"leads nowhere: {written(path[:-1])} has {len(here)} entries, numbered from 0")
        return here[part]
    if not isinstance(here, dict):
        raise ValueError(f"leads nowhere: {written(path[:-1])} is no table")
    if part not in here:
        raise ValueError(f"leads nowhere: {written(path)} does not exist; {one_of(here, part)}")
    return here[part]


def parameter_problems(data: dict[str, Any], sweep: SweepTable, tables: Any) -> Iterator[Problem]:
    """What is wrong with the parameters of a sweep: their paths, and their first and last values.

    Parameters
    ----------
    data : dict
        The case as the user wrote it.
    sweep : SweepTable
    tables : type
        CaseTables, which the case with these values must be valid as.
    """
    for name, values in sweep.parameters.items():
        here: Path = ("sweep", "parameters", name)
        for value in [values.start, values.stop] if isinstance(values, Range) else values:
            try:
                changed = replaced_in(data, {name: value})
                tables.model_validate(changed)
            except ValidationError as error:
                first = from_validation(error)[0]
                yield Problem(here, f"is refused: {written(first.path)} {first.text}")
                break
            except ValueError as error:
                yield Problem(here, str(error))
                break


def unit_of(tables: Any, name: str) -> str:
    """Unit of the key at a dotted path of a case, "" if it has none or is not described."""
    here, unit = tables, ""
    for part in parsed(name):
        if isinstance(part, str) and not isinstance(here, dict):
            unit = options.unit_of(type(here).model_fields[part])
            here = getattr(here, part)
        else:
            here = here[part]
    return unit


def words_of(name: str) -> str:
    """The key at a dotted path of a case in words: "depth of notch 1", "force of pump along y"."""
    *above, key = parsed(name)
    if isinstance(key, int):
        return name.split(".", 1)[-1]
    owners: list[str] = []
    for k, part in enumerate(above):
        if isinstance(part, int):
            owners[-1] = f"{_SINGLE.get(owners[-1], owners[-1])} {part + 1}"
        elif k > 0:  # the table itself says nothing that its keys do not
            owners.append(part)
    pattern = _WORDS.get(key, f"{key.replace('_', ' ')} of {{}}")
    return pattern.replace(" of {}", "" if not owners else " of " + " of ".join(reversed(owners)))


def structural(row: Mapping[str, Any]) -> tuple[tuple[str, Any], ...]:
    """Part of a row's values that decides over the structure: of a body, where its loads act, too."""
    paths = {name: parsed(name) for name in row}
    return tuple(
        (name, row[name])
        for name, (first, *_, last) in paths.items()
        if first in STRUCTURE or last == "point"
    )

"""Dotted paths into a case, and the values that a sweep gives them."""

from __future__ import annotations

import copy
import itertools
import math
import re
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from pydantic import ValidationError

from ... import options
from ...options import one_of
from .problems import from_validation, written
from .sweep import Range, SweepTable
from .tables import Path, Problem

_PART = re.compile(r'(?:^|\.)(?:"([^"]*)"|([A-Za-z0-9_-]+))|\[(\d+)\]')
# Tables that decide over mesh, model and reduction.
STRUCTURE = ("geometry", "body", "mesh", "points", "material", "materials", "model")
# Keys that say in words what they are, with their owner in the place of {}; and entries of arrays.
_WORDS = {
    "fx": "force of {} along x",
    "fy": "force of {} along y",
    "tx": "traction of {} along x",
    "ty": "traction of {} along y",
    "ax": "acceleration of {} along x",
    "ay": "acceleration of {} along y",
    "young": "Young's modulus of {}",
    "poisson": "Poisson's ratio of {}",
}
_SINGLE = {"notches": "notch", "holes": "hole", "cracks": "crack", "supports": "support"}


def parsed(name: str) -> Path:
    """Path of a name such as "geometry.notches[0].depth".

    Raises
    ------
    ValueError
        If it is none.
    """
    path: list[str | int] = []
    at = 0
    for found in _PART.finditer(name):
        if found.start() != at:
            break
        at = found.end()
        path.append(int(found[3]) if found[3] is not None else found[1] if found[1] is not None else found[2])
    if at != len(name) or not path or isinstance(path[0], int) or name.startswith("."):
        raise ValueError("is no path into the case; write it as in geometry.notches[0].depth")
    return tuple(path)


def replaced_in(data: dict[str, Any], values: Mapping[str, Any]) -> dict[str, Any]:
    """A copy of a case's data with values at dotted paths.

    Raises
    ------
    ValueError
        If the table or array around a path does not exist.
    """
    result = copy.deepcopy(data)
    for name, value in values.items():
        path = parsed(name)
        here: Any = result
        if path[1:]:  # tables that are left out have defaults
            result.setdefault(str(path[0]), {})
        for k, part in enumerate(path[:-1]):
            here = _entry(here, part, path[: k + 1])
        last = path[-1]
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
    bare = {key: value for key, value in data.items() if key != "sweep"}
    for name, values in sweep.parameters.items():
        here: Path = ("sweep", "parameters", name)
        ends = [values.start, values.stop] if isinstance(values, Range) else values
        for value in ends:
            try:
                changed = replaced_in(bare, {name: value})
                tables.model_validate(changed)
            except ValidationError as error:
                first = from_validation(error, changed, tables)[0]
                yield Problem(here, f"is refused: {written(first.path)} {first.text}")
                break
            except ValueError as error:
                yield Problem(here, str(error))
                break
    for name in sweep.healthy or {}:
        try:
            parsed(name)
        except ValueError as error:
            yield Problem(("sweep", "healthy", name), str(error))


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


def rows(sweep: SweepTable) -> list[dict[str, Any]]:
    """Values of all parameters, row by row; the last parameter runs fastest in a grid."""
    names = list(sweep.parameters)
    if sweep.method == "latin_hypercube":
        assert sweep.samples is not None
        from scipy.stats import qmc  # slow to load, for all commands

        unit = qmc.LatinHypercube(d=len(names), seed=sweep.seed).random(sweep.samples)
        shares = [
            _between(values, unit[:, k])
            for k, values in enumerate(sweep.parameters.values())
            if isinstance(values, Range)
        ]
        return [dict(zip(names, map(float, row))) for row in np.stack(shares, axis=1)]
    columns = [grid(values) for values in sweep.parameters.values()]
    chosen = zip(*columns) if sweep.method == "list" else itertools.product(*columns)
    return [dict(zip(names, row)) for row in chosen]


def _between(values: Range, share: np.ndarray) -> np.ndarray:
    if values.scale == "linear":
        return values.start + share * (values.stop - values.start)
    low, high = math.log(values.start), math.log(values.stop)
    return np.exp(low + share * (high - low))


def grid(values: Any) -> list[Any]:
    """Values that stand in an array, or those of a range with its count."""
    if not isinstance(values, Range):
        return list(values)
    assert values.count is not None
    spaced = np.linspace if values.scale == "linear" else np.geomspace
    found: list[Any] = spaced(values.start, values.stop, values.count).tolist()
    return found


def structural(row: Mapping[str, Any]) -> tuple[tuple[str, Any], ...]:
    """Part of a row's values that decides over the structure: of a body, where its loads act, too."""
    paths = {name: parsed(name) for name in row}
    return tuple(
        (name, row[name])
        for name, (first, *_, last) in paths.items()
        if first in STRUCTURE or last == "point"
    )

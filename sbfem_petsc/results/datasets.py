"""Datasets of a results file: values with their units and descriptions, distributed rows, trees of them."""

from __future__ import annotations

import contextlib
import dataclasses
from typing import Any, NamedTuple

import h5py
import numpy as np

from meshing.whole_file import reason

from ..parallel import collective
from ..petsc import MPI
from .gather import stream

WHAT = "results file"

# Units of the fields of materials and loads, by name.
UNITS = {
    "young": "Pa",
    "young_1": "Pa",
    "young_2": "Pa",
    "young_3": "Pa",
    "shear_12": "Pa",
    "density": "kg/m^3",
    "angle": "degree",
    "fx": "N",
    "fy": "N",
    "tx": "Pa",
    "ty": "Pa",
    "pressure": "Pa",
}


@contextlib.contextmanager
def written(comm: MPI.Comm, path: str):
    """`collective` with the system's errors turned into one sentence."""
    with collective(comm):
        try:
            yield
        except (OSError, RuntimeError) as error:
            raise ValueError(f"{WHAT} {path!r} cannot be written: {reason(error)}") from None


class Label(NamedTuple):
    """Name, unit and description of a dataset."""

    name: str
    unit: str
    description: str


class Place(NamedTuple):
    """Where ranks write to: a group, which rank 0 alone has, of the file at a path."""

    comm: MPI.Comm
    group: h5py.Group | None
    path: str


def declare(group: h5py.Group, label: Label, shape: tuple, kind, **layout) -> h5py.Dataset:
    """A dataset with its unit and description, still without values."""
    dataset = group.create_dataset(label.name, shape=shape, dtype=kind, **(layout if 0 not in shape else {}))
    dataset.attrs["unit"], dataset.attrs["description"] = label.unit, label.description
    return dataset


def put(group: h5py.Group, name: str, values, unit: str, description: str) -> None:
    """A dataset with its values, unit and description."""
    values = np.asarray(values)
    declare(group, Label(name, unit, description), values.shape, values.dtype)[...] = values


def put_rows(place: Place, label: Label, numbers: np.ndarray, values: np.ndarray, size: int) -> None:
    """One distributed dataset, streamed to rank 0, where alone an error can arise."""
    comm, group, path = place
    dataset: Any = None
    with written(comm, path):
        if group is not None:
            dataset = declare(group, label, (size, *values.shape[1:]), values.dtype)
    with written(comm, path):
        stream(
            comm,
            numbers,
            values,
            size,
            lambda first, rows: dataset.write_direct(
                np.ascontiguousarray(rows), dest_sel=np.s_[first : first + len(rows)]
            ),
        )


def put_fields(group: h5py.Group, item) -> None:
    """A material or load: numbers as datasets with units, texts as attributes."""
    group.attrs["kind"] = type(item).__name__
    for field in dataclasses.fields(item):
        value = getattr(item, field.name)
        if isinstance(value, str):
            group.attrs[field.name] = value
        elif value is not None:
            put(
                group,
                field.name,
                float(value),
                UNITS.get(field.name, "1"),
                f"{field.name} of {type(item).__name__}",
            )


def tree(group: h5py.Group, units: dict[str, str]) -> dict:
    """Groups as dicts: attributes, datasets and subgroups by name."""
    result = {
        name: value.tolist() if isinstance(value, np.ndarray) else value
        for name, value in group.attrs.items()
    }
    for name, item in group.items():
        if isinstance(item, h5py.Group):
            result[name] = tree(item, units)
        else:
            units[item.name] = item.attrs["unit"]
            result[name] = item[()]
    return result

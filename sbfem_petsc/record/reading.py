"""Records out of HDF5, each part checked by what its class says: a file may come from a stranger."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from typing import Any

import h5py
import numpy as np

from .about import About
from .layout import names_along, text
from .record import Record, entries, expanded, record_class


def records_in(group: h5py.Group, beside: Mapping[str, Record] = {}) -> Any:
    """What `layout.write` wrote into a group, or into groups of it: a record, a tuple, or a dict by name;
    `beside` holds parts that it names and another file has.

    Raises
    ------
    ValueError
        If a part is missing, of another type or length, out of its range, or does not fit the others.
    """
    reader = _Reader(dict(beside))
    if "record" in group.attrs:
        return reader.record(group, (), {})
    found = {name: reader.record(group[name], (), {}) for name in group}
    if "several" not in group.attrs:
        return found
    if group.attrs["several"] != len(found):
        raise ValueError(f"it has {len(found)} parts, not {group.attrs['several']}")
    return tuple(found.values())


class _Reader:
    """What has been read of a file, by its place: parts that are named a second time are not read again."""

    def __init__(self, known: dict[str, Record]) -> None:
        self.known = known

    def record(self, group: h5py.Group, given: tuple[str, ...], above: Mapping[str, int]) -> Record:
        """The record of a group, with axes that are given and the lengths of those above."""
        cls = record_class(text(group.attrs["record"]))
        back = [about for about in entries(cls).values() if about.stored and (about.field or about.back)]
        lengths, values = dict(above), dict[str, Any]()
        for about in back:
            if not about.part:
                values |= _quantity(group, about, given, lengths)
        for dim, at in cls._labelled(given).items():
            if at in cls.__dataclass_fields__ and at not in values:
                values[at] = names_along(group, dim)
                if values[at] and lengths.get(dim, len(values[at])) != len(values[at]):
                    raise ValueError(f"{dim!r} has {len(values[at])} names for {lengths[dim]} entries")
        for about in back:
            if about.part:
                values |= self._part(group, about, expanded(about.dims, given), lengths)
        # what a class has beside its quantities is of the process that made it
        for f in dataclasses.fields(cls):
            if f.default is f.default_factory is dataclasses.MISSING:
                values.setdefault(f.name, None)
        made: Record = cls._revived(values)
        made.check()
        self.known[group.name] = made
        return made

    def _part(
        self, group: h5py.Group, about: About, given: tuple[str, ...], lengths: Mapping[str, int]
    ) -> dict[str, Any]:
        """A part, or several of them, by its name; nothing where it may be missing."""
        name, of = about.name, tuple(map(record_class, about.part.split()))
        item: Any = group.get(name)
        found: Any = None
        if name in group.attrs:
            found = self.known[text(group.attrs[name])]
        elif item is None:
            return _missing(about)
        elif "several" in item.attrs:
            found = tuple(self.record(item[key], (), {}) for key in item)
            if len(found) != item.attrs["several"]:
                raise ValueError(f"{name!r} has {len(found)} entries, not {item.attrs['several']}")
        else:
            found = self.record(item, given, lengths)
        several = isinstance(found, tuple)
        if several != about.type.startswith("tuple") or not all(
            isinstance(one, of) for one in (found if several else (found,))
        ):
            raise ValueError(f"{name!r} is not of {about.part}")
        return {name: found}


def _missing(about: About) -> dict[str, Any]:
    """What stands for a field that is not there; ValueError where it must be."""
    if not about.needed and about.field:
        return {}
    if about.needed and "None" not in about.type:
        raise ValueError(f"{about.name!r} is missing")
    return {about.name: None}


def _quantity(
    group: h5py.Group, about: About, given: tuple[str, ...], lengths: dict[str, int]
) -> dict[str, Any]:
    """A field as its type says: number, text, array, tuple, or dict by names."""
    name, here, kind = about.name, about.called, about.type
    dims = expanded(about.dims, given)
    if here in group.attrs and "dict" in kind:
        if not isinstance(group.attrs[here], h5py.Empty):
            raise ValueError(f"{name!r} is no set of entries by name")
        return {name: {}}  # without an entry
    if here in group.attrs and not dims and about.kinds == "U":
        word = text(group.attrs[here])
        if about.one_of and word not in about.one_of:
            raise ValueError(f"{name} = {word!r} is none of {', '.join(about.one_of)}")
        return {name: word}
    if here not in group:
        return _missing(about)
    array = sound(group[here], about, dims, lengths)
    if not dims:
        return {name: array.item()}
    if kind.startswith("dict"):
        dim = about.by or dims[0]
        parts, names = np.moveaxis(array, dims.index(dim), 0), names_along(group, dim)
        if len(names) != len(parts):
            raise ValueError(f"{dim!r} has {len(names)} names for {len(parts)} entries")
        plain = "tuple" in kind or "ndarray" not in kind  # numbers, or tuples of them
        made = [_tuple(part.tolist()) if plain else np.ascontiguousarray(part) for part in parts]
        return {name: dict(zip(names, made))}
    return {name: _tuple(array.tolist()) if kind.startswith("tuple") else array}


def _tuple(items: Any) -> Any:
    return tuple(map(_tuple, items)) if isinstance(items, list) else items


def _decoded(data: h5py.Dataset, about: About) -> np.ndarray:
    """Numbers, truths or texts of a data set."""
    array, name = np.asarray(data[()]), about.name
    if array.dtype == np.int8 and "b" in about.kinds and text(data.attrs.get("dtype", "")) == "bool":
        if not np.isin(array, (0, 1)).all():
            raise ValueError(f"{name!r} has values that are neither true nor false")
        array = array.astype(bool)
    if array.dtype.kind == "S":
        array = np.array([text(item) for item in array.ravel().tolist()], dtype=str).reshape(array.shape)
    return array


def sound(data: Any, about: About, dims: tuple[str, ...], lengths: dict[str, int]) -> np.ndarray:
    """The numbers of a field: of its type, lengths that agree with the others', within its range."""
    name = about.name
    if isinstance(data, h5py.Dataset) and data.ndim == len(dims) - 1 and "xy" in dims:  # of rows
        alone = dims.index("xy")
        array = sound(data, about, (*dims[:alone], *dims[alone + 1 :]), lengths)
        return np.expand_dims(array, alone)
    if not isinstance(data, h5py.Dataset) or data.ndim != len(dims):
        raise ValueError(f"{name!r} is no array over {', '.join(dims) or 'nothing'}")
    array = _decoded(data, about)
    shape = tuple(lengths.setdefault(dim, n) for dim, n in zip(dims, array.shape))
    if shape != array.shape or array.dtype.kind not in about.kinds:
        wanted = " x ".join(f"{dim} ({n})" for dim, n in zip(dims, shape)) or "one"
        raise ValueError(f"{name!r} is {array.dtype} of shape {array.shape}, not {wanted} values")
    if array.dtype.kind in "fc" and about.finite and not np.isfinite(array).all():
        raise ValueError(f"{name!r} has values that are not finite")
    if array.dtype.kind in "iuf" and about.least > -math.inf and (array < about.least).any():
        raise ValueError(f"{name!r} has values below {about.least:g}")
    return array

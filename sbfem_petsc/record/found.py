"""Quantities that no class says alone: what a case keeps of a result."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any

import h5py
import numpy as np

from .about import About, Entry, Quantity
from .layout import axes_of, bare, put, text, texts_of, value_of, within
from .record import Record
from .views import Views


def told(
    name: str,
    value: Any,
    unit: str = "1",
    text: str = "",
    dims: str = "",
    names: Mapping[str, Iterable[str]] = {},
) -> Quantity:
    """A quantity: a number, a text, None, or an array over its axes, with the names along some of them."""
    about = About(unit, text, tuple(dims.split()))
    found = np.asarray(value) if about.dims else value
    along = {dim: tuple(entries) for dim, entries in names.items()}
    return Quantity(Entry(name, about, "", False, False), found, unit, about.dims, along)


def of_points(
    name: str,
    points: Sequence[str],
    value: Callable[[str], Any],
    unit: str,
    text: str,
    dims: str = "",
) -> Quantity | None:
    """A quantity of each point, whose own axes are `dims`; None without points."""
    if not points:
        return None
    first, *others = dims.split() or [""]
    found = np.stack([np.asarray(value(point)) for point in points], axis=1 if first else 0)
    return told(name, found, unit, text, " ".join([first, "place", *others]), {"place": points})


class Found(Views):
    """Quantities and parts by name.

    Parameters
    ----------
    quantities : sequence of Quantity or None
        None stands for nothing.
    parts : dict of str to Found or tuple of Found
    """

    def __init__(self, quantities: Iterable[Quantity | None], parts: Mapping[str, Any] | None = None):
        found = {q.name: q for q in quantities if q is not None}
        # axes before what lies along them
        self.found = dict(sorted(found.items(), key=lambda item: item[1].dims != (item[0],)))
        self.inner = dict(parts or {})

    @classmethod
    def of(
        cls, record: Record, points: Sequence[str], *more: Quantity | None, details: Sequence[str] = ()
    ) -> Found:
        """What a record says of some of its points and more, but for details that are not named."""
        own = [
            q.among("place", points).told(detail=q.name in details)
            for q in record._presented(lambda about: not about.distributed)
            if q.name in details or (q.about.stored and not q.about.detail)
        ]
        own.sort(key=lambda q: q.name not in record.coordinates)
        parts = {}
        for name, about, part in record.parts():
            if not about.detail:
                several = tuple(cls.of(one, points) for one in (part if isinstance(part, tuple) else (part,)))
                parts[name] = several if isinstance(part, tuple) else several[0]
        added = (q and q.of_points(record.of_rows).told(detail=q.name in details) for q in more)
        return cls([*own, *added], parts)

    def quantities(
        self, wanted: Callable[[About], bool] = lambda about: True, **_: Any
    ) -> Iterator[Quantity]:
        return (q for q in self.found.values() if wanted(q.about))

    def parts(self) -> Iterator[tuple[str, About, Any]]:
        return ((name, About(), part) for name, part in self.inner.items())

    def __getitem__(self, name: str) -> Any:
        return self.found[name] if name in self.found else self.inner[name]

    def __contains__(self, name: str) -> bool:
        return name in self.found or name in self.inner

    def __repr__(self) -> str:
        return f"Found({', '.join([*self.found, *self.inner])})"

    def tables(self, details: bool = True) -> dict[str, dict[str, Any]]:
        """See `Views`; of parts by name, too."""
        tables = super().tables(details)
        for name, part in self.inner.items():
            own = part.tables(details) if isinstance(part, Found) else {}
            tables |= {f"{name}_{axis}": columns for axis, columns in own.items()}
        return tables

    def write(self, group: h5py.Group) -> None:
        """Into a group: a data set a quantity, also of texts; a group a part."""
        for q in self.found.values():
            array = np.asarray(np.nan if q.value is None else q.value)
            for dim, names in q.names.items():
                if dim not in group:
                    put(group, dim, texts_of(names), About(text=f"names of {dim}"), "1", (dim,))
            data = put(group, q.name, array, q.about, q.unit, q.dims)
            for mark, there in {"detail": q.about.detail, "none": q.value is None}.items():
                if there:
                    data.attrs[mark] = True
            if q.units.keys() > {""}:
                data.attrs["units_of_each"] = texts_of(q.units[name] for name, _ in q.by_name())
        for name, part in self.inner.items():
            own = within(group, name)
            for k, one in enumerate(part) if isinstance(part, tuple) else ():
                one.write(within(own, f"{k:04d}"))
            if isinstance(part, tuple):
                own.attrs["several"] = len(part)
            else:
                part.write(own)

    @classmethod
    def read(cls, group: h5py.Group) -> Found:
        """What `write` has written."""
        quantities, parts = [], dict[str, Any]()
        for name, item in group.items():
            if isinstance(item, h5py.Dataset):
                if not bare(item) and not (item.is_scale and item.dtype.kind == "S"):
                    quantities.append(_quantity(name, item))
            elif "several" in item.attrs:
                parts[name] = tuple(map(cls.read, item.values()))
            else:
                parts[name] = cls.read(item)
        return cls(quantities, parts)


def _quantity(name: str, data: h5py.Dataset) -> Quantity:
    unit, words = (text(data.attrs[key]) for key in ("units", "long_name"))
    axes = axes_of(data)
    value = None if "none" in data.attrs else value_of(data)
    names = {dim: along for dim, along in axes.items() if along}
    found = told(name, value, unit, words, " ".join(axes), names).told(detail="detail" in data.attrs)
    if any(len(along) != data.shape[k] for k, along in enumerate(axes.values()) if along):
        raise ValueError(f"{name!r} has other entries than names")
    each = [text(one) for one in data.attrs.get("units_of_each", ())]
    units = dict(zip([entry for entry, _ in found.by_name()], each))
    return dataclasses.replace(found, units=units)

"""Quantities that no class says alone: what a case keeps of a result."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any

import h5py
import numpy as np

from .about import About, Quantity
from .layout import bare, groups_of, put_quantity, text, text_of, texts_of, value_of, within
from .record import Record
from .views import Views

# Its name, and the names along it.
Axis = tuple[str, tuple[str, ...]]


def labelled(
    name: str,
    value: Any,
    unit: str = "1",
    text: str = "",
    dims: str = "",
    names: Mapping[str, Iterable[str]] = {},
) -> Quantity:
    """A quantity: a number, a text, None, or an array over its axes, with the names along some of them."""
    about = About(unit, text, tuple(dims.split())).of(name)
    found = np.asarray(value) if about.dims else value
    along = {dim: tuple(entries) for dim, entries in names.items()}
    return Quantity(about, found, unit, about.dims, along)


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
    return labelled(name, found, unit, text, " ".join([first, "place", *others]), {"place": points})


def column(found: Quantity | None) -> Quantity | None:
    """The same, also a column of a sweep."""
    return found and found.annotated(row=True)


class Found(Views):
    """Quantities and parts by name.

    Parameters
    ----------
    quantities : sequence of Quantity or None
        None stands for nothing.
    parts : dict of str to Found or tuple of Found
    coordinates : sequence of str
        See `Views`.
    """

    def __init__(
        self,
        quantities: Iterable[Quantity | None],
        parts: Mapping[str, Any] | None = None,
        coordinates: Sequence[str] = (),
    ):
        found = {q.name: q for q in quantities if q is not None}
        # axes before what lies along them
        self.found = dict(sorted(found.items(), key=lambda item: item[1].dims != (item[0],)))
        self.inner = dict(parts or {})
        self.coordinates = coordinates  # type: ignore[misc]  # each has its own

    @classmethod
    def of(
        cls, record: Record, points: Sequence[str], *more: Quantity | None, details: Sequence[str] = ()
    ) -> Found:
        """What a record says of some of its points and more, but for details that are not named."""
        own = [
            q.among("place", points).annotated(detail=q.name in details)
            for q in record._presented()
            if q.name in details or (q.about.stored and not q.about.detail)
        ]
        parts = {}
        for name, about, part in record.parts():
            if not about.detail:
                several = tuple(cls.of(one, points) for one in (part if isinstance(part, tuple) else (part,)))
                parts[name] = several if isinstance(part, tuple) else several[0]
        added = (q and q.of_points(record.of_rows).annotated(detail=q.name in details) for q in more)
        return cls([*own, *added], parts, record.coordinates)

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

    def each(self, *above: str) -> Iterator[tuple[tuple[str, ...], Quantity]]:
        """Quantities, of those with names each entry, and those of parts, by where they are."""
        for q in self.found.values():
            for name, _ in q.by_name():
                yield ((*above, q.name, name), q[name]) if name else ((*above, q.name), q)
        for name, part in self.inner.items():
            if isinstance(part, Found):
                yield from part.each(*above, name)

    def write(self, group: h5py.Group) -> None:
        """Into a group: a data set a quantity, also of texts; a group a part."""
        group.attrs["coordinates"] = text_of(" ".join(self.coordinates))
        for q in self.found.values():
            array = np.asarray(np.nan if q.value is None else q.value)
            data = put_quantity(group, q, array)
            for mark, there in {"detail": q.about.detail, "none": q.value is None}.items():
                if there:
                    data.attrs[mark] = True
            if q.units.keys() - {""}:
                data.attrs["units_of_each"] = texts_of(q.units.get(name, q.unit) for name, _ in q.by_name())
        for name, part in self.inner.items():
            for own, one in groups_of(within(group, name), part):
                one.write(own)

    @classmethod
    def read(cls, group: h5py.Group, above: Mapping[tuple[int, int], Axis] = {}) -> Found:
        """What `write` has written, with what lies along axes of groups above, by its address and number."""
        quantities, parts, along, axes = [], dict[str, Any](), dict(above), dict[str, Axis]()
        items = dict(group.items())
        for name, item in items.items():
            if isinstance(item, h5py.Dataset) and item.attrs.get("CLASS") == b"DIMENSION_SCALE":
                texts = item.dtype.kind == "S" and item.ndim == 1
                axes[name] = name, tuple(value_of(item).tolist()) if texts else ()
                along |= {at: axes[name] for at in _along(item)}
        for name, item in items.items():
            if isinstance(item, h5py.Group):
                several = [cls.read(one, along) for one in item.values()] if "several" in item.attrs else None
                parts[name] = cls.read(item, along) if several is None else tuple(several)
            elif name not in axes:
                at = _address(item.id)
                quantities.append(_quantity(name, item, [along[at, k] for k in range(item.ndim)]))
            elif not axes[name][1] and not bare(item):
                quantities.append(_quantity(name, item, [axes[name]]))
        return cls(quantities, parts, text(group.attrs["coordinates"]).split())


def _along(axis: h5py.Dataset) -> list[tuple[int, int]]:
    """Addresses of what lies along an axis, and which of its own it is. HDF5's own functions, by `dims`,
    crash where the attribute is something else; DIMENSION_LIST stands without a checksum, and HDF5 ends in a
    loop or finds another axis where it has changed.
    """
    found = axis.attrs.get("REFERENCE_LIST", ())
    return [(_address(h5py.h5r.dereference(one, axis.id)), int(number)) for one, number in found]


def _address(item: h5py.h5o.ObjectID) -> int:
    return int(h5py.h5o.get_info(item).addr)


def _quantity(name: str, data: h5py.Dataset, axes: list[Axis]) -> Quantity:
    if any(names and len(names) != n for (_, names), n in zip(axes, data.shape)):
        raise ValueError(f"{name!r} has other entries than names")
    marks = set(data.attrs)
    unit, words = text(data.attrs["units"]), text(data.attrs["long_name"])
    value = value_of(data)
    dims = " ".join(dim for dim, _ in axes)
    shown = None if "none" in marks else value if axes else value.item()
    found = labelled(name, shown, unit, words, dims, {dim: names for dim, names in axes if names})
    found = found.annotated(detail=True) if "detail" in marks else found
    if "units_of_each" not in marks:
        return found
    each = map(text, data.attrs["units_of_each"])
    return dataclasses.replace(found, units=dict(zip([entry for entry, _ in found.by_name()], each)))

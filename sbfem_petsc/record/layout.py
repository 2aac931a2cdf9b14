"""How a record lies in HDF5: data sets with units, words and named dimensions, as netCDF-4 has them. What is
read is checked by what its class says, for a file may come from a stranger.
"""

from __future__ import annotations

import dataclasses
import math
import zlib
from collections.abc import Iterator, Mapping
from typing import Any

import h5py
import numpy as np

from .about import About, Quantity, each
from .record import Record, entries, expanded, record_class

# Bytes up to which data stand in a header; of a chunk of others; from which on it is tried whether packing
# gains a tenth.
COMPACT, CHUNK, PACKED = 32768, 1 << 20, 2048
TYPES: dict[str, Any] = {"b": bool, "i": np.int64, "f": np.float64, "c": np.complex128, "U": str}
# The mark of netCDF-4 on an axis that has no entries of its own.
BARE = b"This is a netCDF dimension but not a netCDF variable.%10d"


def write(
    group: h5py.Group,
    record: Record,
    whole: Mapping[int, Mapping[str, Any]] = {},
    given: tuple[str, ...] = (),
    seen: dict[int, str] | None = None,
) -> None:
    """A record into a group: a data set a quantity, derived ones for other programs; a group a part.

    Parameters
    ----------
    whole : dict of int to dict
        What `Record._gathered` has found of each record, by its identity.
    given : tuple of str
        Axes that stand for "*", and those that have another name here, as "order:further_order".
    seen : dict of int to str
        Where parts are that stand in the file already: they are named, not written again.
    """
    seen = {} if seen is None else seen
    seen[id(record)] = group.name
    mine = whole.get(id(record), {})
    group.attrs["record"] = text_of(type(record).__name__)
    for q in record.quantities(lambda about: about.stored, given=given, **mine):
        if isinstance(q.value, str):
            group.attrs[q.name] = text_of(q.value)
            continue
        put_quantity(group, q, _array(record, q))
    for name, about in entries(type(record)).items():
        if about.field and isinstance(getattr(record, name), Mapping) and not getattr(record, name):
            group.attrs[about.called] = h5py.Empty("S2")
    parts = [*record.parts(), *((n, About(), item) for n, item in mine.items() if isinstance(item, Record))]
    for name, about, part in parts:
        if not about.stored:
            continue
        if id(part) in seen:
            group.attrs[name] = text_of(seen[id(part)])
            continue
        above = () if isinstance(part, tuple) else expanded(about.dims, given)
        for own, item in groups_of(within(group, name), part):
            write(own, item, whole, above, seen)


def put_quantity(group: h5py.Group, q: Quantity, array: np.ndarray) -> h5py.Dataset:
    """The numbers or texts of a quantity, behind the names along its axes."""
    for dim, names in q.names.items():
        _scale(group, dim, len(names), names)
    return put(group, q.name, array, q.about, q.unit, q.dims)


def groups_of(group: h5py.Group, part: Any) -> Iterator[tuple[h5py.Group, Any]]:
    """The group of a part, or new ones in it of several, by their names or numbers."""
    if isinstance(part, (list, tuple)):
        group.attrs["several"] = len(part)
        part = {f"{k:04d}": item for k, item in enumerate(part)}
    if isinstance(part, Mapping):
        yield from ((within(group, name), item) for name, item in part.items())
    else:
        yield group, part


def _array(record: Record, q: Quantity) -> np.ndarray:
    """The numbers or texts of a quantity, of the type that its class says.

    Raises
    ------
    ValueError
        If they could not be read again.
    """
    array = np.asarray(q.value)
    if array.dtype.kind not in q.about.kinds:
        array = array.astype(TYPES[q.about.kinds[0]], casting="same_kind")
    checked = array.dtype.kind in "fc" and q.about.finite and (q.about.field or q.about.back)
    if checked and not np.isfinite(array).all():
        raise ValueError(f"{q.name!r} of {record!r} has values that are not finite")
    return array


def within(group: h5py.Group, name: str) -> h5py.Group:
    """A new group in another one, which keeps the order of what it holds and no times."""
    how = h5py.h5p.create(h5py.h5p.GROUP_CREATE)
    how.set_link_creation_order(h5py.h5p.CRT_ORDER_TRACKED)
    how.set_obj_track_times(False)
    link = h5py.h5p.create(h5py.h5p.LINK_CREATE)
    link.set_char_encoding(h5py.h5t.CSET_UTF8)
    return h5py.Group(h5py.h5g.create(group.id, name.encode(), lcpl=link, gcpl=how))


def put(
    group: h5py.Group, name: str, array: np.ndarray, about: About, unit: str, dims: tuple[str, ...]
) -> h5py.Dataset:
    """A data set with unit, words and named dimensions: packed where that is worth it, else in the header if
    it is small, or in chunks.
    """
    if array.dtype.kind == "U":
        array = texts_of(array.ravel().tolist()).reshape(array.shape)
    logical = array.dtype.kind == "b"  # as netCDF has it
    array = np.ascontiguousarray(array.astype(np.int8) if logical else array).reshape(array.shape)
    packed = {"compression": 1, "shuffle": True} if _worth_packing(array) else {}
    if array.nbytes <= COMPACT and not packed:
        layout = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
        layout.set_layout(h5py.h5d.COMPACT)
        layout.set_obj_track_times(False)
        # `create_dataset` leaves scalars out of the header, where they would have no checksum
        space = h5py.h5s.create_simple(array.shape) if array.ndim else h5py.h5s.create(h5py.h5s.SCALAR)
        kind = h5py.h5t.py_create(array.dtype, logical=True)
        data = h5py.Dataset(h5py.h5d.create(group.id, name.encode(), kind, space, layout))
        if array.size:
            data[...] = array
    else:
        # of equal chunks, for the last one is filled up
        pieces = -(-len(array) // max(1, CHUNK // max(1, array[0].nbytes)))
        rows = -(-len(array) // pieces)
        data = group.create_dataset(
            name, data=array, chunks=(rows, *array.shape[1:]), fletcher32=True, **packed
        )
    data.attrs["units"], data.attrs["long_name"] = text_of(unit), text_of(about.text)
    if logical:
        data.attrs["dtype"] = text_of("bool")
    for k, dim in enumerate(dims):
        if dim == name:
            data.make_scale(dim)
        else:
            data.dims[k].attach_scale(_scale(group, dim, array.shape[k]))
    return data


def _worth_packing(array: np.ndarray) -> bool:
    """Whether packing gains a tenth of what is no more than a chunk, and so costs no time."""
    if not array.ndim or not PACKED <= array.nbytes <= CHUNK:
        return False
    shuffled = array.reshape(-1, 1).view(np.uint8).T
    return len(zlib.compress(shuffled.tobytes(), 1)) < 0.9 * array.nbytes


def _scale(group: h5py.Group, dim: str, length: int, names: tuple[str, ...] = ()) -> h5py.Dataset:
    """A dimension by its name, and by those along it if there are any: of this group or one above it; or a
    new one, which the parts of the outermost record share if it has nothing else of that name, and no names.
    """
    home = group
    for here in _upwards(group):
        if dim in here:
            found = here[dim]
            alike = isinstance(found, h5py.Dataset) and found.shape == (length,)
            if alike and (here is group or not names or names_along(here, dim) == names):
                return found
            break
        if "record" in here.attrs and dim not in _names(record_class(text(here.attrs["record"]))):
            home = here
    if names:
        return put(group, dim, texts_of(names), About(text=f"names of {dim}"), "1", (dim,))
    made = home.create_dataset(dim, (length,), ">f4")
    made.make_scale(BARE % length)
    return made


def _upwards(group: h5py.Group) -> Iterator[h5py.Group]:
    """A group, and those above it."""
    yield group
    while group.name != "/":
        group = group.parent
        yield group


def _names(cls: type[Record]) -> frozenset[str]:
    """What a group of a record may hold."""
    return frozenset(name for about in entries(cls).values() for name in (about.name, about.called))


def bare(data: h5py.Dataset) -> bool:
    """Whether a data set is an axis alone, without numbers."""
    if data.id.get_storage_size():
        return False
    name = data.attrs.get("NAME")
    return isinstance(name, bytes) and name.startswith(BARE[:20])


def value_of(data: h5py.Dataset) -> np.ndarray:
    """What `put` has written: numbers, truths or texts.

    Raises
    ------
    ValueError
        If they are none.
    """
    array = np.asarray(data[()])
    if array.dtype == np.int8 and text(data.attrs.get("dtype", "")) == "bool":
        if not np.isin(array, (0, 1)).all():
            raise ValueError(f"{data.name!r} has values that are neither true nor false")
        return array.astype(bool)
    return np.char.decode(array, "utf-8").astype(str) if array.dtype.kind == "S" else array


def names_along(group: h5py.Group, dim: str) -> tuple[str, ...]:
    """Names of the entries of an axis, in this group or one above."""
    axis = next((here[dim] for here in _upwards(group) if dim in here), None)
    if axis is None or bare(axis):
        return ()
    found = tuple(map(text, value_of(axis).tolist()))
    if len(set(found)) < len(found):
        raise ValueError(f"{dim!r} names an entry twice")
    return found


def text_of(words: str) -> np.bytes_:
    """A text as HDF5 keeps it with a checksum: of a fixed length."""
    text: np.bytes_ = texts_of([words])[0]
    return text


def texts_of(words: Any) -> np.ndarray:
    """The same of several."""
    found = [str(word).encode() for word in words]
    # netCDF takes those of one byte for single characters
    return np.array(found, dtype=h5py.string_dtype("utf-8", max([2, *map(len, found)])))


def text(item: Any) -> str:
    """What `text_of` made."""
    if not isinstance(item, (bytes, str)):
        raise ValueError(f"{item!r} is no text")
    return item.decode() if isinstance(item, bytes) else item


def records_in(group: h5py.Group, beside: Mapping[str, Record] = {}) -> Any:
    """What `layout.write` wrote into a group, or into groups of it: a record, a tuple, or a dict by name;
    `beside` holds parts that it names and another file has.

    Raises
    ------
    ValueError
        If a part is missing, of another type or length, out of its range, or does not fit the others.
    """
    return _Reader(dict(beside)).parts(group, (), {})


class _Reader:
    """What has been read of a file, by its place: parts that are named a second time are not read again."""

    def __init__(self, known: dict[str, Record]) -> None:
        self.known = known

    def parts(self, group: h5py.Group, given: tuple[str, ...], above: Mapping[str, int]) -> Any:
        """The record of a group, or several by their numbers or names."""
        if "record" in group.attrs:
            return self.record(group, given, above)
        found = {name: self.record(group[name], (), {}) for name in group}
        if "several" not in group.attrs:
            return found
        if group.attrs["several"] != len(found):
            raise ValueError(f"{group.name!r} has {len(found)} parts, not {group.attrs['several']}")
        return tuple(found.values())

    def record(self, group: h5py.Group, given: tuple[str, ...], above: Mapping[str, int]) -> Record:
        """The record of a group, with axes that are given and the lengths of those above."""
        cls = record_class(text(group.attrs["record"]))
        back = [about for about in entries(cls).values() if about.stored and (about.field or about.back)]
        lengths, values = dict(above), dict[str, Any]()
        for about in sorted(back, key=lambda about: bool(about.part)):  # those of others' axes last
            dims = expanded(about.dims, given)
            if about.called in group or about.called in group.attrs:
                found = self._part if about.part else _quantity
                values[about.name] = found(group, about, dims, lengths)
            elif about.needed and "None" not in about.type:
                raise ValueError(f"{about.name!r} is missing")
            elif about.needed or not about.field:
                values[about.name] = None
        for dim, at in cls._labelled(given).items():
            if at in cls.__dataclass_fields__ and at not in values:
                values[at] = names_along(group, dim)
                if values[at] and lengths.get(dim, len(values[at])) != len(values[at]):
                    raise ValueError(f"{dim!r} has {len(values[at])} names for {lengths[dim]} entries")
        # what a class has beside its quantities is of the process that made it
        for f in dataclasses.fields(cls):
            if f.default is f.default_factory is dataclasses.MISSING:
                values.setdefault(f.name, None)
        made: Record = cls._revived(values)
        made.check()
        self.known[group.name] = made
        return made

    def _part(
        self, group: h5py.Group, about: About, dims: tuple[str, ...], lengths: Mapping[str, int]
    ) -> Any:
        """A part, or several of them, by its name."""
        name, of = about.name, tuple(map(record_class, about.part.split()))
        if name in group.attrs:
            found = self.known[text(group.attrs[name])]
        else:
            found = self.parts(group[name], dims, lengths)
        alike = not isinstance(found, dict) and all(isinstance(one, of) for one in each(found))
        if not alike or isinstance(found, tuple) != about.type.startswith("tuple"):
            raise ValueError(f"{name!r} is not of {about.part}")
        return found


def _quantity(group: h5py.Group, about: About, dims: tuple[str, ...], lengths: dict[str, int]) -> Any:
    """A field as its type says: number, text, array, tuple, or dict by names."""
    name, here, kind = about.name, about.called, about.type
    if here in group.attrs and "dict" in kind:
        if not isinstance(group.attrs[here], h5py.Empty):
            raise ValueError(f"{name!r} is no set of entries by name")
        return {}
    if here in group.attrs and not dims and about.kinds == "U":
        word = text(group.attrs[here])
        if about.one_of and word not in about.one_of:
            raise ValueError(f"{name} = {word!r} is none of {', '.join(about.one_of)}")
        return word
    array = sound(group.get(here), about, dims, lengths)
    if not dims:
        return array.item()
    if kind.startswith("dict"):
        dim = about.by or dims[0]
        parts, names = np.moveaxis(array, dims.index(dim), 0), names_along(group, dim)
        if len(names) != len(parts):
            raise ValueError(f"{dim!r} has {len(names)} names for {len(parts)} entries")
        plain = "tuple" in kind or "ndarray" not in kind  # numbers, or tuples of them
        made = [_tuple(part.tolist()) if plain else np.ascontiguousarray(part) for part in parts]
        return dict(zip(names, made))
    return _tuple(array.tolist()) if kind.startswith("tuple") else array


def _tuple(items: Any) -> Any:
    return tuple(map(_tuple, items)) if isinstance(items, list) else items


def sound(data: Any, about: About, dims: tuple[str, ...], lengths: dict[str, int]) -> np.ndarray:
    """The numbers of a field: of its type, lengths that agree with the others', within its range."""
    name = about.name
    if isinstance(data, h5py.Dataset) and data.ndim == len(dims) - 1 and "xy" in dims:  # of rows
        alone = dims.index("xy")
        array = sound(data, about, (*dims[:alone], *dims[alone + 1 :]), lengths)
        return np.expand_dims(array, alone)
    if not isinstance(data, h5py.Dataset) or data.ndim != len(dims):
        raise ValueError(f"{name!r} is no array over {', '.join(dims) or 'nothing'}")
    array = value_of(data)
    shape = tuple(lengths.setdefault(dim, n) for dim, n in zip(dims, array.shape))
    if shape != array.shape or array.dtype.kind not in about.kinds:
        wanted = " x ".join(f"{dim} ({n})" for dim, n in zip(dims, shape)) or "one"
        raise ValueError(f"{name!r} is {array.dtype} of shape {array.shape}, not {wanted} values")
    if array.dtype.kind in "fc" and about.finite and not np.isfinite(array).all():
        raise ValueError(f"{name!r} has values that are not finite")
    if array.dtype.kind in "iuf" and about.least > -math.inf and (array < about.least).any():
        raise ValueError(f"{name!r} has values below {about.least:g}")
    return array

"""How a record lies in HDF5: data sets with units, words and named dimensions, as netCDF-4 has them."""

from __future__ import annotations

import zlib
from collections.abc import Iterator, Mapping
from typing import Any

import h5py
import numpy as np

from .about import About, Quantity
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
        for own, item in groups_of(group, name, part):
            write(own, item, whole, above, seen)


def put_quantity(group: h5py.Group, q: Quantity, array: np.ndarray) -> h5py.Dataset:
    """The numbers or texts of a quantity, behind the names along its axes."""
    for dim, names in q.names.items():
        if not _named(group, dim, names):
            put(group, dim, texts_of(names), About(text=f"names of {dim}"), "1", (dim,))
    return put(group, q.name, array, q.about, q.unit, q.dims)


def groups_of(group: h5py.Group, name: str, part: Any) -> Iterator[tuple[h5py.Group, Any]]:
    """New groups of a part, or of each of several by their numbers."""
    own = within(group, name)
    if not isinstance(part, tuple):
        yield own, part
        return
    own.attrs["several"] = len(part)
    yield from ((within(own, f"{k:04d}"), item) for k, item in enumerate(part))


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


def _scale(group: h5py.Group, dim: str, length: int) -> h5py.Dataset:
    """A dimension by its name: of this group or one above it; or a new one, which the parts of the outermost
    record share if it has nothing else of that name.
    """
    home = group
    for here in _upwards(group):
        if dim in here:
            found = here[dim]
            if isinstance(found, h5py.Dataset) and found.shape == (length,):
                return found
            break
        if "record" in here.attrs and dim not in _names(record_class(text(here.attrs["record"]))):
            home = here
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


def value_of(data: h5py.Dataset) -> Any:
    """What `put` has written: an array, a number or a text."""
    value = data[()]
    if isinstance(value, bytes):
        return value.decode()
    if data.dtype.kind == "S":
        return np.char.decode(value, "utf-8")
    if "dtype" in data.attrs:
        value = value.astype(bool)
    return value.item() if isinstance(value, np.generic) else value


def names_along(group: h5py.Group, dim: str) -> tuple[str, ...]:
    """Names of the entries of an axis, in this group or one above."""
    of = next((here for here in _upwards(group) if dim in here or dim in here.attrs), group)
    item = of[dim] if dim in of else of.attrs.get(dim)
    if isinstance(item, h5py.Dataset):
        if bare(item):
            return ()
        item = item[()]
    if item is None or isinstance(item, h5py.Empty):
        return ()
    found = tuple(text(entry) for entry in np.ravel(item).tolist())
    if len(set(found)) < len(found):
        raise ValueError(f"{dim!r} names an entry twice")
    return found


def _named(group: h5py.Group, dim: str, names: tuple[str, ...]) -> bool:
    """Whether an axis has its names already: in this group, or the same ones above."""
    of = next((here for here in _upwards(group) if dim in here), group)
    found = of.get(dim)
    texts = isinstance(found, h5py.Dataset) and found.dtype.kind == "S"
    return dim in group or (texts and names_along(of, dim) == names)


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

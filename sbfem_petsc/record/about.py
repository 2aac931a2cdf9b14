"""What a quantity is, and a value with it: unit, words, axes and the names along them."""

from __future__ import annotations

import dataclasses
import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

# Entries of the axes that every result has.
AXES = dict(xy=("x", "y"), component=("I", "II"), side=("before", "behind"), tensor=("xx", "yy", "xy"))
# Kinds of NumPy's types by the types of fields.
KINDS = {"bool": "b", "int": "iu", "float": "f", "complex": "c", "str": "U"}


@dataclass(frozen=True)
class About:
    """What a field or a derived quantity is.

    Attributes
    ----------
    unit, text : str
        "1" without dimension.
    called : str
        Its name in files and tables, if that is another one.
    dims : tuple of str
        Names of its axes; of a part those that stand for "*" in it.
    kinds : str
        Kinds of NumPy's types that it may have; default: by the type of the field.
    least : float
        Of all numbers.
    finite : bool
    one_of : tuple of str
        Texts that it may be.
    by : str
        Axis of the names of a dict; default: the first one.
    detail : bool
        Left out of tables and summaries.
    row : bool
        A column of a sweep.
    stored : bool
        False: it is not written to files.
    back : bool
        Of a derived quantity: it is read, for `Record._revived`.
    distributed : bool
        Ranks have parts of it, and `Record._gathered` the whole.
    kept : bool
        Of a derived quantity: it is computed once.
    part : str
        Name of the record class that it, or each of a tuple, is of; of several classes that it may be of.
    unit_of : callable
        The unit of one record, where that depends on it; or units of its entries by their names, that of all
        by "".
    name, type : str
        Of the field or derived quantity, which `of` tells, and `called` and `kinds` where they are not given.
    field, needed : bool
        Whether it is a field, and must be there.
    """

    unit: str = "1"
    text: str = ""
    dims: tuple[str, ...] = ()
    called: str = ""
    kinds: str = ""
    least: float = -math.inf
    finite: bool = True
    one_of: tuple[str, ...] = ()
    by: str = ""
    detail: bool = False
    row: bool = False
    stored: bool = True
    back: bool = False
    distributed: bool = False
    kept: bool = False
    part: str = ""
    unit_of: Callable[[Any], str | Mapping[str, str]] | None = None
    name: str = ""
    type: str = ""
    field: bool = False
    needed: bool = False

    def of(self, name: str, type: str = "", *, field: bool = False, needed: bool = False) -> About:
        """The same of a field or derived quantity of a record class."""
        known = re.findall(r"\b(bool|int|float|complex|str)\b", type.removeprefix("dict[str,"))
        kinds = self.kinds or (KINDS[known[0]] if known else "f")
        called = self.called or name
        return dataclasses.replace(
            self, name=name, type=type, called=called, kinds=kinds, field=field, needed=needed
        )

    def units(self, record: Any) -> Mapping[str, str]:
        """Units of a record's entries by their names, that of all by ""."""
        annotated = self.unit if self.unit_of is None else self.unit_of(record)
        return {"": annotated} if isinstance(annotated, str) else annotated


def each(part: Any) -> list[Any]:
    """Of several things, by their names or not, or of one."""
    if isinstance(part, Mapping):
        return list(part.values())
    return list(part) if isinstance(part, (list, tuple)) else [part]


# Of points that are rows of a body, in what is shown of motions.
DIRECTION = About("1", "directions of the points", ("place",)).of("direction", "str")


@dataclass(frozen=True, eq=False)
class Quantity:
    """A value with what it is.

    Attributes
    ----------
    value : array, number or text
    unit : str
    dims : tuple of str
    names : dict of str to tuple of str
        Entries along some of the axes.
    units : dict of str to str
        Of entries by their names, where they have different ones.
    """

    about: About
    value: Any
    unit: str
    dims: tuple[str, ...]
    names: Mapping[str, tuple[str, ...]]
    units: Mapping[str, str] = dataclasses.field(default_factory=dict)

    @property
    def name(self) -> str:
        """In files and tables."""
        return self.about.called

    def of_points(self, rows: bool) -> Quantity:
        """Of rows of a body, which have a direction each: without an axis of x and y and the word u_y."""
        if "xy" in self.dims and self.value.shape[k := self.dims.index("xy")] == 1:
            return self._at(k, -1, self.unit).of_points(rows)
        return self.annotated(text=self.about.text.replace("u_y", "u")) if rows else self

    def annotated(self, **about: Any) -> Quantity:
        """The same, of which something else is said."""
        return dataclasses.replace(self, about=dataclasses.replace(self.about, **about))

    def among(self, dim: str, names: Sequence[str]) -> Quantity:
        """Its entries of some names along an axis, where that has names."""
        known = self.names.get(dim, ())
        rows = [k for k, name in enumerate(known) if name in names]
        if len(rows) == len(known):
            return self
        along = {**self.names, dim: tuple(known[k] for k in rows)}
        return dataclasses.replace(self, value=np.take(self.value, rows, self.dims.index(dim)), names=along)

    def _at(self, axis: int, index: int, unit: str) -> Quantity:
        dims = (*self.dims[:axis], *self.dims[axis + 1 :])
        return dataclasses.replace(self, value=np.take(self.value, index, axis), dims=dims, unit=unit)

    def by_name(self) -> Iterator[tuple[str, Any]]:
        """The entries along the first axis that has names; otherwise the whole, by ""."""
        axis = next((k for k, dim in enumerate(self.dims) if dim in self.names), None)
        if axis is None:
            yield "", self.value
        else:
            for k, name in enumerate(self.names[self.dims[axis]]):
                yield name, np.take(self.value, k, axis)

    def __getitem__(self, name: str) -> Quantity:
        """The entry of a name."""
        axis = next((k for k, dim in enumerate(self.dims) if name in self.names.get(dim, ())), None)
        if axis is None:
            raise KeyError(name)
        return self._at(axis, self.names[self.dims[axis]].index(name), self.units.get(name, self.unit))

    def columns(self) -> Iterator[tuple[str, Any]]:
        """Real columns over the first axis, by the entries of the others."""
        shape = self.value.shape[1:] if self.dims else ()
        further = [self.names.get(dim) or AXES.get(dim) or range(n) for dim, n in zip(self.dims[1:], shape)]
        for index in np.ndindex(shape):
            name = "_".join([self.name, *(str(names[k]) for names, k in zip(further, index))])
            part = self.value[(slice(None), *index)] if self.dims else self.value
            if np.iscomplexobj(part):
                yield from ((f"re_{name}", part.real), (f"im_{name}", part.imag))
            else:
                yield name, part

"""Results as records: names, units, words and named axes of what they hold stand once, in their dataclasses.

Files (HDF5 laid out as netCDF-4), tables, JSON, xarray's view, columns of sweeps, HTML and the list of
attributes in docstrings are read from there.
"""

from __future__ import annotations

import base64
import dataclasses
import functools
import importlib
import math
import os
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, Generic, TypeVar

import numpy as np

from ..checks import names_of
from ..checks import path as checked_path
from ..writing import write_table

if TYPE_CHECKING:
    from typing_extensions import dataclass_transform
else:  # of Python 3.11, for type checkers alone

    def dataclass_transform(**options):
        return lambda decorator: decorator


# Entries of the axes that every result has.
AXES = {"xy": ("x", "y"), "component": ("I", "II"), "side": ("before", "behind")}
# Kinds of NumPy's types by the types of fields.
KINDS = {"bool": "b", "int": "iu", "float": "f", "complex": "c", "str": "U"}
# The axis of what has none.
NONE = "values"
# Entries up to which an array stands in a summary.
LONGEST = 100_000
# Entries up to which an array is shown by its numbers.
_FEW = 12
# Stands for the axes that a part is given where it is a field.
GIVEN = "*"

Value = TypeVar("Value")
Kind = TypeVar("Kind")
_ENTRIES: dict[Any, dict[str, Entry]] = {}


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

    def units(self, record: Any) -> Mapping[str, str]:
        """Units of a record's entries by their names, that of all by ""."""
        told = self.unit if self.unit_of is None else self.unit_of(record)
        return {"": told} if isinstance(told, str) else told


def quantity(
    unit: str = "1", text: str = "", dims: str = "", *, default: Any = dataclasses.MISSING, **more: Any
) -> Any:
    """A field that is a quantity: further keywords are those of `About` and of `dataclasses.field`."""
    own = {name: more.pop(name) for name in list(more) if name not in About.__dataclass_fields__}
    about = About(unit, text, tuple(dims.split()), **more)
    return dataclasses.field(default=default, metadata={"about": about}, **own)


class Derived(Generic[Value]):
    """A property that is a quantity."""

    def __init__(self, about: About, function: Callable[[Any], Value]):
        self.about, self.function = about, function
        self.type = str(function.__annotations__.get("return", ""))
        self.__doc__ = function.__doc__ or _words(about)

    def __get__(self, record: Any, owner: Any = None) -> Value:
        if record is None:
            return self  # type: ignore[return-value]
        value = self.function(record)
        if self.about.kept:
            record.__dict__[self.function.__name__] = value  # which is found before this is asked again
        return value


def derived(
    unit: str = "1", text: str = "", dims: str = "", **more: Any
) -> Callable[[Callable[[Any], Value]], Derived[Value]]:
    """Make a function a property that is a quantity: `@derived("N", "sum of the forces", "time")`. Further
    keywords are those of `About`.
    """
    return functools.partial(Derived, About(unit, text, tuple(dims.split()), **more))


@dataclass(frozen=True, eq=False)
class Entry:
    """A field or derived quantity of a record class: whether it is a field, must be there, and its type."""

    name: str
    about: About
    type: str
    field: bool
    needed: bool

    @property
    def called(self) -> str:
        """Its name in files and tables."""
        return self.about.called or self.name

    @property
    def kinds(self) -> str:
        """Kinds of NumPy's types that it may have."""
        found = re.findall(r"\b(bool|int|float|complex|str)\b", self.type.removeprefix("dict[str,"))
        return self.about.kinds or (KINDS[found[0]] if found else "f")


def entries(cls: Any) -> dict[str, Entry]:
    """What a record class holds, by name: fields, then derived quantities."""
    if cls in _ENTRIES:
        return _ENTRIES[cls]
    found = _ENTRIES[cls] = {}
    for f in dataclasses.fields(cls):
        if "about" in f.metadata:
            needed = f.default is dataclasses.MISSING and f.default_factory is dataclasses.MISSING
            found[f.name] = Entry(f.name, f.metadata["about"], str(f.type), True, needed)
    for base in reversed(cls.__mro__):
        for name, item in vars(base).items():
            if isinstance(item, Derived):
                found[name] = Entry(name, item.about, item.type, False, False)
    return found


# Of points that are rows of a body, in what is shown of motions.
DIRECTION = Entry("direction", About("1", "directions of the points", ("place",)), "str", False, False)


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

    entry: Entry
    value: Any
    unit: str
    dims: tuple[str, ...]
    names: Mapping[str, tuple[str, ...]]
    units: Mapping[str, str] = dataclasses.field(default_factory=dict)

    @property
    def name(self) -> str:
        """In files and tables."""
        return self.entry.called

    @property
    def about(self) -> About:
        """What it is."""
        return self.entry.about

    @property
    def titled(self) -> str:
        """Unit as it stands behind a name in the head of a column."""
        return "" if self.unit == "1" else f" [{self.unit}]"

    def of_points(self, rows: bool) -> Quantity:
        """Of rows of a body, which have a direction each: without an axis of x and y and the word u_y."""
        if "xy" in self.dims and self.value.shape[k := self.dims.index("xy")] == 1:
            return self.only(k).of_points(rows)
        if not rows or "u_y" not in self.about.text:
            return self
        about = dataclasses.replace(self.about, text=self.about.text.replace("u_y", "u"))
        return dataclasses.replace(self, entry=dataclasses.replace(self.entry, about=about))

    def only(self, axis: int) -> Quantity:
        """The last entry along an axis."""
        dims = (*self.dims[:axis], *self.dims[axis + 1 :])
        return dataclasses.replace(self, value=np.take(self.value, -1, axis), dims=dims)

    def by_name(self) -> Iterator[tuple[str, Any]]:
        """The entries along the first axis that has names; otherwise the whole, by ""."""
        axis = next((k for k, dim in enumerate(self.dims) if dim in self.names), None)
        if axis is None:
            yield "", self.value
        else:
            for k, name in enumerate(self.names[self.dims[axis]]):
                yield name, np.take(self.value, k, axis)

    def columns(self) -> Iterator[tuple[str, Any]]:
        """Real columns over the first axis, by the entries of the others."""
        if not self.dims:
            parts = [(self.name, self.value)]
        else:
            further = [
                self.names.get(dim) or AXES.get(dim) or range(n)
                for dim, n in zip(self.dims[1:], self.value.shape[1:])
            ]
            parts = [
                (
                    "_".join([self.name, *(str(names[k]) for names, k in zip(further, index))]),
                    self.value[(slice(None), *index)],
                )
                for index in np.ndindex(self.value.shape[1:])
            ]
        for name, part in parts:
            if np.iscomplexobj(part):
                yield from ((f"re_{name}", part.real), (f"im_{name}", part.imag))
            else:
                yield name, part


class Record:
    """A dataclass whose fields say what they are.

    Attributes
    ----------
    labels : dict of str to str
        Axes, and the attributes that name their entries.
    coordinates : tuple of str
        Quantities that tell where along an axis the others are: they come first in its table.
    """

    labels: ClassVar[Mapping[str, str]] = {}
    coordinates: ClassVar[tuple[str, ...]] = ()
    classes: ClassVar[dict[str, type[Record]]] = {}
    __dataclass_fields__: ClassVar[dict[str, dataclasses.Field[Any]]]

    def __init_subclass__(cls, **more: Any) -> None:
        super().__init_subclass__(**more)
        Record.classes[cls.__name__] = cls

    # ------------------------------------------------------------------ what may be said anew
    @classmethod
    def _revived(cls, found: dict[str, Any]) -> Any:
        """The record of what was read, by the names of fields and of derived quantities that are read."""
        return cls(**found)

    def check(self) -> None:
        """Raise ValueError unless the fields, each of which is sound, belong together."""

    def _gathered(self) -> dict[str, Any]:
        """On rank 0 the whole of what is distributed, by name; empty for what was read. Collective."""
        return {}

    def _told(self, path: str) -> None:
        """Warn of what a file does not hold."""

    # ------------------------------------------------------------------ what is read from the class
    def quantities(
        self,
        wanted: Callable[[About], bool] = lambda about: True,
        *,
        given: tuple[str, ...] = (),
        **whole: Any,
    ) -> Iterator[Quantity]:
        """Fields and derived quantities in order, but for those that are None.

        Parameters
        ----------
        wanted : callable
            Those that are looked at.
        given : tuple of str
            Axes that stand for "*".
        whole
            what `_gathered` has found.
        """
        for name, entry in entries(type(self)).items():
            about = entry.about
            if about.part or not wanted(about):
                continue
            value = whole.get(name) if about.distributed else getattr(self, name)
            if value is None:
                continue
            dims = expanded(about.dims, given)
            names = self._names_along(dims, given)
            if isinstance(value, Mapping):
                axis = dims.index(about.by) if about.by else 0
                names[dims[axis]] = tuple(value)
                value = np.stack([np.asarray(v) for v in value.values()], axis) if value else None
                if value is None:
                    continue
            if isinstance(value, tuple) and not value and len(dims) > 1:
                value = np.zeros((0,) * len(dims))
            units = about.units(self)
            found = np.asarray(value) if dims else value
            yield Quantity(entry, found, units[""], dims, names, units).of_points(self.of_rows)

    def _names_along(self, dims: tuple[str, ...], given: tuple[str, ...]) -> dict[str, tuple]:
        """Of the entries along axes, where there are any."""
        found = {dim: tuple(getattr(self, at)) for dim, at in self._labelled(given).items() if dim in dims}
        return {dim: names for dim, names in found.items() if names}

    @classmethod
    def _labelled(cls, given: tuple[str, ...] = ()) -> dict[str, str]:
        """`labels`, the first of the given axes for "*"."""
        return {(given[0] if given else NONE) if dim == GIVEN else dim: at for dim, at in cls.labels.items()}

    def parts(self) -> Iterator[tuple[str, About, Any]]:
        """Records inside this one, alone or in tuples, but for those that are None."""
        for name, entry in entries(type(self)).items():
            if entry.about.part and getattr(self, name) is not None:
                yield name, entry.about, getattr(self, name)

    @property
    def of_rows(self) -> bool:
        """Whether its points are rows of a body or of matrices: one displacement each."""
        return self._reduced is not None and bool(self._reduced.of_rows)

    @property
    def point_directions(self) -> dict[str, str]:
        """Directions of its points by their names, where they are rows of a body."""
        return {} if self._reduced is None else dict(self._reduced.point_directions)

    @property
    def _reduced(self) -> Any:
        return getattr(self, "reduced", None) or getattr(self, "reduced_model", None)

    def _presented(self, wanted: Callable[[About], bool]) -> Iterator[Quantity]:
        """As `quantities`; displacements of rows as the one number that they are."""
        for q in self.quantities(wanted):
            yield q.only(q.dims.index("xy")) if self.of_rows and {"place", "xy"} <= {*q.dims} else q
        if self.point_directions and wanted(DIRECTION.about):
            names = {"place": tuple(self.point_directions)}
            yield Quantity(DIRECTION, np.array([*self.point_directions.values()]), "1", ("place",), names)

    def sweep_row(self, points: Sequence[str] | None = None) -> dict[str, tuple[Any, str]]:
        """What a row of a sweep keeps, of some points or all: values and units by "quantity" or
        "quantity/name".

        Raises
        ------
        TypeError, ValueError
            If points are no names.
        """
        chosen = None if points is None else names_of("sweep_row", "points", points)
        return {
            f"{q.name}/{name}" if name else q.name: (item, q.units.get(name, q.unit))
            for q in self._presented(lambda about: about.row)
            for name, item in q.by_name()
            if chosen is None or "place" not in q.names or name in chosen
        }

    def tables(self) -> dict[str, dict[str, Any]]:
        """Columns by axis, with the unit in their heads: of each axis its entries or coordinates first."""
        found: dict[str, dict[str, Any]] = {}
        of = list(self._presented(lambda about: not about.detail))
        for q in sorted(of, key=lambda q: q.name not in self.coordinates):  # stable
            if not q.dims:
                single = found.setdefault(NONE, {"quantity": [], "value": [], "unit": []})
                for name, item in q.columns():
                    for column, entry in zip(single.values(), (name, item, q.unit)):
                        column.append(entry)
                continue
            axis = q.dims[0]
            if not len(q.value):
                continue
            if axis not in found:
                found[axis] = {axis: list(q.names[axis])} if axis in q.names else {}
            found[axis] |= {f"{name}{q.titled}": column for name, column in q.columns()}
        return found

    def to_csv(self, path: str) -> list[str]:
        """Write tables of comma-separated values, one for each axis, with numbers of all digits.

        Parameters
        ----------
        path : str
            Of the table of the first axis; the others' stand beside it, as path_AXIS.csv, and what has no
            axis as path_values.csv: quantity, value, unit.

        Returns
        -------
        list of str
            The files.

        Raises
        ------
        TypeError, ValueError
            If they cannot be written.
        """
        stem, ending = os.path.splitext(checked_path("table", "path", path))
        tables = self.tables()
        first = next((axis for axis in tables if axis != NONE), NONE)
        files = {axis: f"{stem}{'' if axis == first else f'_{axis}'}{ending}" for axis in tables}
        for axis, columns in tables.items():
            write_table(files[axis], columns)
        return list(files.values())

    def to_xarray(self) -> Any:
        """The quantities as an `xarray.Dataset`, with units and words in their attributes. Needs xarray."""
        try:
            import xarray
        except ImportError as error:
            raise ImportError(
                f"to_xarray needs xarray ({error}); install it with `pip install 'sbfem-petsc[xarray]'`"
            ) from error

        found: dict[str, Any] = {}
        names: dict[str, list[str]] = {}
        for q in self._presented(lambda about: not about.distributed):
            names |= {dim: list(entries) for dim, entries in q.names.items()}
            found[q.name] = (q.dims, q.value, {"units": q.unit, "long_name": q.about.text})
        return xarray.Dataset(found, names).set_coords([name for name in self.coordinates if name in found])

    def summary(self) -> dict[str, Any]:
        """What JSON can hold: entries by name, complex numbers as magnitude and phase, nan as null."""
        found: dict[str, Any] = {}
        for q in self._presented(lambda about: not (about.detail or about.distributed)):
            named = {name: plain(item) for name, item in q.by_name()}
            found[q.name] = named.get("", named)
        for name, about, part in self.parts():
            if not about.detail:
                found[name] = [p.summary() for p in part] if isinstance(part, tuple) else part.summary()
        return found

    def _repr_html_(self) -> str:
        from html import escape

        lines = [
            "".join(
                f"<td>{escape(cell)}</td>"
                for cell in (q.name, _shown(q.value), "" if q.unit == "1" else q.unit, q.about.text)
            )
            for q in self._presented(lambda about: not (about.distributed or about.detail))
        ]
        head, table = f"<b>{escape(repr(self))}</b>", f"<table><tr>{'</tr><tr>'.join(lines)}</tr></table>"
        return head + self._picture() + table

    def _picture(self) -> str:
        """A small picture for notebooks, where it has one and there is Matplotlib."""
        try:
            drawing = importlib.import_module(f"{__package__.split('.')[0]}.plot.inline")
        except ImportError:
            return ""
        found = drawing.small_picture(self)
        if found is None:
            return ""
        data = base64.b64encode(found).decode()
        return f'<br><img style="max-width: min(34em, 100%)" alt="" src="data:image/png;base64,{data}">'


def record_class(name: str) -> type[Record]:
    """The record class of a name; those of results that nobody has used yet are loaded.

    Raises
    ------
    ValueError
        If there is none.
    """
    face = importlib.import_module(__package__.split(".")[0])  # which knows where each public name is
    if name not in Record.classes and name in face.__all__:
        getattr(face, name)
    if name not in Record.classes:
        raise ValueError(f"{name!r} is no kind of result of this program")
    return Record.classes[name]


def expanded(dims: tuple[str, ...], given: tuple[str, ...]) -> tuple[str, ...]:
    """Axes, with those that are given in the place of "*", or renamed as "order:further_order" says."""
    renamed = dict(one.split(":") for one in given if ":" in one)
    plain = tuple(one for one in given if ":" not in one)
    return tuple(renamed.get(one, one) for dim in dims for one in (plain if dim == GIVEN else (dim,)))


@dataclass_transform(eq_default=False, frozen_default=True, field_specifiers=(quantity, dataclasses.field))
def described(cls: type[Kind]) -> type[Kind]:
    """A class decorator: a frozen dataclass whose docstring has a section "Attributes" from what the class
    says of its quantities.
    """
    made = dataclass(frozen=True, eq=False, repr="__repr__" not in vars(cls))(cls)
    lines = []
    axes = {dim for entry in entries(made).values() if entry.about.stored for dim in entry.about.dims}
    for name, entry in entries(made).items():
        about = entry.about
        if about.stored and entry.called in axes and about.dims != (entry.called,):
            raise TypeError(f"{cls.__name__}: {name} is named as an axis is; give one of them another name")
        kind = re.sub(r"np\.ndarray", "array", entry.type) if not about.dims or about.part else "array"
        shape = f"({', '.join(about.dims)}) " if about.dims and not about.part else ""
        lines += [f"{name} : {shape}{kind}", f"    {_words(about)}."]
    made.__doc__ = "\n    ".join([(made.__doc__ or "").rstrip(), "", "Attributes", "----------", *lines, ""])
    return made


def _words(about: About) -> str:
    return f"{about.text[:1].upper()}{about.text[1:]}" + ("" if about.unit == "1" else f", {about.unit}")


def plain(item: Any) -> Any:
    """As JSON can hold it; of a long array its shape."""
    if isinstance(item, np.ndarray) and item.ndim and len(item) > LONGEST:
        return {"shape": list(item.shape)}
    if np.iscomplexobj(item):
        return {"magnitude": plain(np.abs(item)), "phase": plain(np.angle(item))}
    if isinstance(item, (np.ndarray, np.generic)):
        return (
            item.tolist() if item.dtype.kind in "biuf" and np.isfinite(item).all() else plain(item.tolist())
        )
    if isinstance(item, (list, tuple)):
        return [plain(entry) for entry in item]
    return None if isinstance(item, float) and not math.isfinite(item) else item


def _shown(item: Any) -> str:
    """A value in few words, short arrays by their numbers."""
    if isinstance(item, np.ndarray) and item.ndim:
        if item.size > _FEW:
            return f"{' x '.join(map(str, item.shape))} values"
        return ("; " if item.ndim > 1 or item.dtype.kind == "U" else ", ").join(map(_shown, item))
    return f"{item:.6g}" if isinstance(item, (float, complex)) else str(item)

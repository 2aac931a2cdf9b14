"""Results as records: names, units, words and named axes of what they hold stand once, in their dataclasses.

Files (HDF5 laid out as netCDF-4), tables, JSON, xarray's view, columns of sweeps, HTML and the list of
attributes in docstrings are read from there.
"""

from __future__ import annotations

import dataclasses
import functools
import importlib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, Generic, TypeVar

import numpy as np

from .about import About, Quantity
from .views import NONE, Views

if TYPE_CHECKING:
    from typing_extensions import dataclass_transform
else:  # of Python 3.11, for type checkers alone

    def dataclass_transform(**options):
        return lambda decorator: decorator


# Stands for the axes that a part is given where it is a field.
GIVEN = "*"

Value = TypeVar("Value")
Kind = TypeVar("Kind")
_ENTRIES: dict[Any, dict[str, About]] = {}


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


def entries(cls: Any) -> dict[str, About]:
    """What a record class holds, by name: fields, then derived quantities."""
    if cls in _ENTRIES:
        return _ENTRIES[cls]
    found = _ENTRIES[cls] = {}
    for f in dataclasses.fields(cls):
        if "about" in f.metadata:
            needed = f.default is dataclasses.MISSING and f.default_factory is dataclasses.MISSING
            found[f.name] = f.metadata["about"].of(f.name, str(f.type), field=True, needed=needed)
    for base in reversed(cls.__mro__):
        for name, item in vars(base).items():
            if isinstance(item, Derived):
                found[name] = item.about.of(name, item.type)
    return found


def of_each(parts: str, kind: type[Record], dim: str) -> Callable[..., Derived[Any]]:
    """Makes what a record has of each of its parts, records of a kind in a tuple: by the name and in the
    words of theirs, along a further axis before the others; None where these have none. Keywords are those
    of `About` that differ.
    """

    def derived_of(name: str, **more: Any) -> Derived[Any]:
        own = entries(kind)[name]
        if (of_part := own.unit_of) is not None:
            more["unit_of"] = lambda record: of_part(getattr(record, parts)[0])
        about = dataclasses.replace(own, dims=(dim, *own.dims), row=False, **more)

        def values(record: Any) -> np.ndarray | None:
            found = [getattr(part, name) for part in getattr(record, parts)]
            if isinstance(found[0], dict):
                rows = np.array([list(part.values()) for part in found])
                return rows.reshape(len(found), -1, *(2 for _ in own.dims[1:]))
            return None if found[0] is None else np.array(found)

        return Derived(about, values)

    return derived_of


class Record(Views):
    """A dataclass whose fields say what they are.

    Attributes
    ----------
    labels : dict of str to str
        Axes, and the attributes that name their entries.
    """

    labels: ClassVar[Mapping[str, str]] = {}
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

    def _furthest(self, least: float = 0.0) -> float:
        """Largest displacement, m, or less than `least` where that is known to be so: that of its parts.
        Collective.
        """
        several = [part if isinstance(part, tuple) else (part,) for _, _, part in self.parts()]
        return max((part._furthest(least) for parts in several for part in parts), default=0.0)

    def _warn_incomplete(self, path: str) -> None:
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
        for name, about in entries(type(self)).items():
            if about.part or not wanted(about):
                continue
            value = whole.get(name) if about.distributed else getattr(self, name)
            if value is None or (isinstance(value, Mapping) and not value):
                continue
            dims = expanded(about.dims, given)
            names = self._names_along(dims, given)
            if isinstance(value, Mapping):
                axis = dims.index(about.by) if about.by else 0
                names[dims[axis]] = tuple(value)
                value = np.stack([np.asarray(v) for v in value.values()], axis)
            if isinstance(value, tuple) and not value and len(dims) > 1:
                value = np.zeros((0,) * len(dims))
            units = about.units(self)
            found = np.asarray(value) if dims else value
            yield Quantity(about, found, units[""], dims, names, units).of_points(self.of_rows)

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
        for name, about in entries(type(self)).items():
            if about.part and getattr(self, name) is not None:
                yield name, about, getattr(self, name)

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
        return getattr(self, "reduced", None)


def record_class(name: str) -> type[Record]:
    """The record class of a name; those of results that nobody has used yet are loaded.

    Raises
    ------
    ValueError
        If there is none.
    """
    face = importlib.import_module("..", __package__)  # which knows where each public name is
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
    axes = {dim for about in entries(made).values() if about.stored for dim in about.dims}
    for name, about in entries(made).items():
        if about.stored and about.called in axes and about.dims != (about.called,):
            raise TypeError(f"{cls.__name__}: {name} is named as an axis is; give one of them another name")
        kind = about.type.replace("np.ndarray", "array") if not about.dims or about.part else "array"
        shape = f"({', '.join(about.dims)}) " if about.dims and not about.part else ""
        lines += [f"{name} : {shape}{kind}", f"    {_words(about)}."]
    made.__doc__ = "\n    ".join([(made.__doc__ or "").rstrip(), "", "Attributes", "----------", *lines, ""])
    return made


def _words(about: About) -> str:
    return f"{about.text[:1].upper()}{about.text[1:]}" + ("" if about.unit == "1" else f", {about.unit}")

"""What is shown of a record: tables, JSON, xarray's view, columns of sweeps, HTML."""

from __future__ import annotations

import base64
import importlib
import math
from collections.abc import Callable, Iterator, Sequence
from typing import Any, ClassVar

import numpy as np

from ..checks import flag, names_of
from ..writing import write_table
from .about import DIRECTION, About, Quantity

# The axis of what has none.
NONE = "values"
# Entries up to which an array stands in a summary.
LONGEST = 100_000
# Axes whose entries are counted from 1, as in pictures, columns of sweeps and arguments.
FROM_ONE = ("mode", "sideband")
# Entries up to which an array is shown by its numbers.
_FEW = 12


class Views:
    """What all records can be looked at as.

    Attributes
    ----------
    coordinates : tuple of str
        Quantities that tell where along an axis the others are: they come first in its table.
    """

    coordinates: ClassVar[Sequence[str]] = ()
    # directions of points that are rows of a body or of matrices
    point_directions: Any = {}

    def quantities(self, wanted: Callable[[About], bool]) -> Iterator[Quantity]:
        """Those that are wanted."""
        raise NotImplementedError

    def parts(self) -> Iterator[tuple[str, About, Any]]:
        """Records inside this one, alone or in tuples."""
        raise NotImplementedError

    def _presented(self, wanted: Callable[[About], bool] = lambda about: True) -> Iterator[Quantity]:
        """As `quantities`, and the directions of points that have one each."""
        yield from self.quantities(wanted)
        if self.point_directions and wanted(DIRECTION):
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

    def tables(self, details: bool = False) -> dict[str, dict[str, Any]]:
        """Columns by axis, with the unit in their heads: its coordinates, names or numbers first."""
        flag("tables", "details", details)
        found: dict[str, dict[str, Any]] = {}
        of = list(self._presented(lambda about: details or not about.detail))
        told = {q.dims[0] for q in of if q.dims and q.name in (q.dims[0], *self.coordinates)}
        for q in sorted(of, key=lambda q: q.name not in self.coordinates):  # stable
            if not q.dims:
                single = found.setdefault(NONE, {"quantity": [], "value": [], "unit": []})
                for name, item in q.columns():
                    for column, entry in zip(single.values(), (name, item, q.unit)):
                        column.append(entry)
                continue
            axis, unit = q.dims[0], "" if q.unit == "1" else f" [{q.unit}]"
            if not len(q.value):
                continue
            if axis not in found:
                least = int(axis in FROM_ONE)
                first = q.names.get(axis, range(least, least + len(q.value)))
                found[axis] = {} if axis in told and axis not in q.names else {axis: list(first)}
            found[axis] |= {f"{name}{unit}": column for name, column in q.columns()}
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
            If there are none, they cannot be written, or one would replace a file that does not belong to the
            first.
        """
        tables = self.tables()
        if not tables:
            raise ValueError(f"to_csv: this {type(self).__name__} has nothing to put into a table")
        first = next((axis for axis in tables if axis != NONE), NONE)
        return write_table(path, tables.pop(first), tables)

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
        for q in self._presented():
            names |= {dim: list(entries) for dim, entries in q.names.items()}
            found[q.name] = (q.dims, q.value, {"units": q.unit, "long_name": q.about.text})
        return xarray.Dataset(found, names).set_coords([name for name in self.coordinates if name in found])

    def summary(self, details: bool = False) -> dict[str, Any]:
        """What JSON can hold: entries by name, complex numbers as magnitude and phase, nan as null; of long
        arrays their shape, unless there are to be details.
        """
        flag("summary", "details", details)
        found: dict[str, Any] = {}
        for q in self._presented(lambda about: details or not about.detail):
            named = {name: plain(item, math.inf if details else LONGEST) for name, item in q.by_name()}
            found[q.name] = named.get("", named)
        for name, about, part in self.parts():
            if not about.detail:
                several = [p.summary(details) for p in (part if isinstance(part, tuple) else (part,))]
                found[name] = several if isinstance(part, tuple) else several[0]
        return found

    def _repr_html_(self) -> str:
        from html import escape

        lines = [
            "".join(
                f"<td>{escape(cell)}</td>"
                for cell in (q.name, in_words(q.value), "" if q.unit == "1" else q.unit, q.about.text)
            )
            for q in self._presented(lambda about: not about.detail)
        ]
        head, table = f"<b>{escape(repr(self))}</b>", f"<table><tr>{'</tr><tr>'.join(lines)}</tr></table>"
        return head + self._picture() + table

    def _picture(self) -> str:
        """A small picture for notebooks, where it has one and there is Matplotlib."""
        try:
            drawing = importlib.import_module("..plot.inline", __package__)
        except ImportError:
            return ""
        found = drawing.small_picture(self)
        if found is None:
            return ""
        data = base64.b64encode(found).decode()
        return f'<br><img style="max-width: min(34em, 100%)" alt="" src="data:image/png;base64,{data}">'


def plain(item: Any, longest: float = LONGEST) -> Any:
    """As JSON can hold it; of a long array its shape."""
    if isinstance(item, np.ndarray) and item.ndim and len(item) > longest:
        return {"shape": list(item.shape)}
    if np.iscomplexobj(item):
        return {"magnitude": plain(np.abs(item), longest), "phase": plain(np.angle(item), longest)}
    if isinstance(item, (np.ndarray, np.generic)):
        finite = item.dtype.kind in "biuf" and np.isfinite(item).all()
        return item.tolist() if finite else plain(item.tolist())
    if isinstance(item, (list, tuple)):
        return [plain(entry) for entry in item]
    return None if isinstance(item, float) and not math.isfinite(item) else item


def in_words(item: Any) -> str:
    """A value in few words, short arrays by their numbers."""
    if isinstance(item, np.ndarray) and item.ndim:
        if item.size > _FEW:
            return f"{' x '.join(map(str, item.shape))} values"
        return ("; " if item.ndim > 1 or item.dtype.kind == "U" else ", ").join(map(in_words, item))
    return f"{item:.6g}" if isinstance(item, (float, complex)) else str(item)

"""Values with units and descriptions, and trees of them as JSON can hold them."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..record.record import LONGEST, Record
from ..record.record import plain as json_of


@dataclass(frozen=True, eq=False)
class Quantity:
    """A value with its unit and description.

    Attributes
    ----------
    value : float, int, bool, str, None or array
    unit : str
        "1" without dimension.
    text : str
    detail : bool
        Whether it is left out of the summary in JSON.
    dims : tuple of str
        Names of the axes; none: they are named after it.
    """

    value: Any
    unit: str = "1"
    text: str = ""
    detail: bool = False
    dims: tuple[str, ...] = ()


Tree = dict[str, Any]
# In texts of a body's results.
_OWN = "u along the point's own direction"


def tree_of(record: Record, points: Sequence[str], details: Sequence[str] = ()) -> Tree:
    """Quantities of a record and of those in it, but for details that are not named.

    Parameters
    ----------
    record : Record
    points : sequence of str
        Points whose motion is kept.
    details : sequence of str
    """
    tree: Tree = {}
    for q in record.quantities(lambda about: not about.distributed):
        if q.about.detail and q.name not in details:
            continue
        known = set(points) if "place" in q.names else set(dict(q.by_name()))
        by = next((dim for dim in q.dims if dim in q.names), None)
        dims = tuple(dim for dim in q.dims if dim != by)
        entries = {
            name: Quantity(_value(item), q.units.get(name, q.unit), q.about.text, q.about.detail, dims)
            for name, item in q.by_name()
            if name in known
        }
        tree[q.name] = entries.get("", entries)
    for name, about, part in record.parts():
        if not about.detail:
            parts = [tree_of(one, points) for one in (part if isinstance(part, tuple) else (part,))]
            tree[name] = parts if isinstance(part, tuple) else parts[0]
    return tree


def _value(item: Any) -> Any:
    """A number or text as Python's; texts of several states as one."""
    if isinstance(item, np.ndarray) and item.dtype.kind == "U":
        return "; ".join(dict.fromkeys(item.ravel().tolist()))
    return (
        item.item() if isinstance(item, np.generic) or np.ndim(item) == 0 and hasattr(item, "item") else item
    )


def of_points(
    points: Sequence[str], value: Callable[[str], Any], unit: str, text: str, detail: bool = False
) -> Tree:
    """A quantity of each point."""
    return {point: Quantity(value(point), unit, text, detail) for point in points}


def of_body(tree: Tree, directions: dict[str, str]) -> Tree:
    """The tree of a body's result: what is said of u_y is of each point's own direction, which it tells."""

    def turned(entry: Any) -> Any:
        if isinstance(entry, dict):
            return {name: turned(part) for name, part in entry.items()}
        if isinstance(entry, list):
            return [turned(part) for part in entry]
        told = isinstance(entry, Quantity) and "u_y" in entry.text
        return dataclasses.replace(entry, text=entry.text.replace("u_y", _OWN)) if told else entry

    text = "directions of the points of a body"
    return turned(tree) | {"directions": {name: Quantity(d, "1", text) for name, d in directions.items()}}


def symbol(tree: Tree, point: str) -> str:
    """A point's displacement in the heading of a table: u_y, or along its own direction."""
    own = tree.get("directions")
    along = "y" if own is None else own[point].value
    return f"u_{along}({point})" if along else f"u({point})"


def quantities(result: Any, **described: tuple[str, str]) -> Tree:
    """Attributes of a result with their units and descriptions."""
    return {name: Quantity(getattr(result, name), *about) for name, about in described.items()}


def plain(tree: Any, where: str = "") -> Any:
    """A tree as JSON can hold it: complex numbers as magnitude and phase, nan as null.

    Parameters
    ----------
    tree : Tree, Quantity or value
    where : str
        Path of the tree in the results file, for histories too long to stand in the summary.
    """
    if isinstance(tree, dict):
        kept = {key: value for key, value in tree.items() if not _detailed(value)}
        return {key: plain(value, f"{where}/{key}") for key, value in kept.items()}
    if isinstance(tree, list):
        return [plain(value, where) for value in tree]
    value = tree.value if isinstance(tree, Quantity) else tree
    if dataclasses.is_dataclass(value):
        raise TypeError(f"{value!r} is no quantity")
    if isinstance(value, np.ndarray) and value.ndim and len(value) > LONGEST:
        return {"dataset": where, "shape": list(value.shape)}
    return json_of(value)


def _detailed(entry: Any) -> bool:
    """Whether a quantity, or all of a table of them, is a detail."""
    if isinstance(entry, dict) and entry:
        return all(isinstance(value, Quantity) and value.detail for value in entry.values())
    return isinstance(entry, Quantity) and entry.detail

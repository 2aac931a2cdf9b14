"""Checks of single inputs; each error is one sentence that names the item, its value and what was
expected.
"""

from __future__ import annotations

import dataclasses
import math
import numbers
import operator
import os
from collections.abc import Callable, Collection, Mapping
from typing import Any, NamedTuple

import numpy as np

HIGHEST_ORDER = 20
# Beyond which areas and their squares leave the range of numbers.
LARGEST = 1e100
# Integers beyond any that counts something.
MOST = 10**18


class Bounds(NamedTuple):
    """Between which a number lies: `above` and `below` are excluded, `least` and `most` are not."""

    above: float | None = None
    least: float | None = None
    below: float | None = None
    most: float | None = None


ANY = Bounds()
_HOLD = [("above", operator.gt), ("at least", operator.ge), ("below", operator.lt), ("at most", operator.le)]


def shown(value: Any) -> str:
    """What stands for a value in a message: its repr on one line, cut where it is long; numbers of NumPy's
    are numbers, also in lists, tuples and dicts.
    """
    try:
        line = " ".join(repr(_plain(value)).split())
    except Exception:  # a foreign class' own fault
        line = f"<{type(value).__name__}>"
    return line if len(line) <= 80 else f"{line[:76]} ..."


def _plain(value: Any) -> Any:
    if isinstance(value, np.generic):
        return value.item()
    if type(value) in (list, tuple):
        return type(value)(map(_plain, value))
    return {key: _plain(item) for key, item in value.items()} if type(value) is dict else value


def real(owner: str, name: str, value: Any, unit: str = "", *, within: Bounds = ANY) -> float:
    """`value` as a finite float between bounds.

    Raises
    ------
    TypeError
        If it is no real number; a bool is none.
    ValueError
        If it is not finite or outside the bounds.
    """
    in_unit = f" ({unit})" if unit else ""
    if isinstance(value, (bool, np.bool_)) or not isinstance(value, numbers.Real):
        raise TypeError(f"{owner}: {name} = {shown(value)} must be a number{in_unit}")
    try:
        number = float(value)
    except OverflowError:
        number = math.inf
    bounds = [(word, holds, bound) for (word, holds), bound in zip(_HOLD, within) if bound is not None]
    if not (math.isfinite(number) and all(holds(number, bound) for _, holds, bound in bounds)):
        wanted = " and ".join(["finite", *(f"{word} {bound:g}" for word, _, bound in bounds)])
        raise ValueError(f"{owner}: {name} = {shown(value)} must be {wanted}{in_unit}")
    return number


def positive(owner: str, name: str, value: Any, unit: str = "") -> float:
    """`value` as a finite float above zero; errors as `real`."""
    return real(owner, name, value, unit, within=Bounds(above=0.0))


def integer(owner: str, name: str, value: Any, *, least: int | None = None, most: int | None = None) -> int:
    """`value` as an int between bounds, both included; TypeError or ValueError otherwise."""
    if isinstance(value, bool) or not isinstance(value, numbers.Integral):
        raise TypeError(f"{owner}: {name} = {shown(value)} must be an integer")
    number = int(value)
    if number < (-MOST if least is None else least) or number > (MOST if most is None else most):
        if least is not None and most is not None:
            wanted = f"between {least} and {most}"
        elif least is not None and number < least:
            wanted = f"at least {least}"
        else:
            wanted = f"at most {MOST:g} in size" if most is None else f"at most {most}"
        raise ValueError(f"{owner}: {name} = {shown(value)} must be {wanted}")
    return number


def flag(owner: str, name: str, value: Any) -> bool:
    """`value` as a bool; TypeError for anything else, however true it looks."""
    if not isinstance(value, (bool, np.bool_)):
        raise TypeError(f"{owner}: {name} = {shown(value)} must be True or False")
    return bool(value)


def choice(owner: str, name: str, value: Any, options: Collection[str]) -> str:
    """`value` as one of several words; ValueError otherwise."""
    if not isinstance(value, str) or value not in options:
        kind = ValueError if isinstance(value, str) else TypeError
        raise kind(f"{owner}: {name} = {shown(value)} must be one of {', '.join(map(repr, options))}")
    return value


def text(owner: str, name: str, value: Any) -> str:
    """`value` as a string that is not empty; TypeError or ValueError otherwise."""
    if not isinstance(value, str):
        raise TypeError(f"{owner}: {name} = {shown(value)} must be a string")
    if not value.strip():
        raise ValueError(f"{owner}: {name} = {value!r} must not be empty")
    return value


def path(owner: str, name: str, value: Any) -> str:
    """`value`, a string or a path, as the string of a path; TypeError or ValueError otherwise."""
    if not isinstance(value, (str, os.PathLike)) or not isinstance(os.fspath(value), str):
        raise TypeError(f"{owner}: {name} = {shown(value)} must be a string or a path")
    place = os.fspath(value)
    if not place.strip() or any(ord(letter) < 32 or 0xD800 <= ord(letter) < 0xE000 for letter in place):
        raise ValueError(f"{owner}: {name} = {place!r} is no name of a file")
    return place


def values_at(what: str, function: Callable[..., Any], places: np.ndarray) -> Any:
    """What a user's function gives for arrays x, y ... of places (n, 2) or (n, 3); ValueError if it fails."""
    try:
        return function(*places.T.copy())
    except Exception as error:  # of any kind
        axes = "x and y" if places.shape[1] == 2 else "x, y and z"
        why = f"{type(error).__name__}: {error}"
        raise ValueError(f"{what} failed as a function of arrays {axes}: {why}") from error


def number(owner: str, name: str, value: Any) -> float:
    """`value` as a float whose square is one as well; errors as `real`."""
    return real(owner, name, value, within=Bounds(least=-LARGEST, most=LARGEST))


def length(owner: str, name: str, value: Any) -> float:
    """`value` as a length, m; errors as `real`."""
    return real(owner, name, value, "m", within=Bounds(above=0.0, most=LARGEST))


def said(text: str, unit: str = "", one_of: tuple[str, ...] = (), **bounds: float) -> dict[str, Any]:
    """Metadata of a dataclass's field: what it is, for tables of case files and checks.

    Parameters
    ----------
    text, unit : str
    one_of : tuple of str
        Words that it may be.
    **bounds
        gt, ge, lt, le: above, at least, below, at most.
    """
    return {"text": text, "unit": unit, "one_of": one_of, "bounds": bounds}


def check_said(item: Any) -> None:
    """Put numbers and words, checked by what their metadata say (`said`), in the place of fields of a frozen
    object; one that is None by default may be that.
    """
    owner = type(item).__name__
    for own in dataclasses.fields(item):
        value, told = getattr(item, own.name), own.metadata
        if "bounds" not in told or value is own.default is None:
            continue
        within = Bounds(*map(told["bounds"].get, ("gt", "ge", "lt", "le")))
        if told["one_of"]:
            choice(owner, own.name, value, told["one_of"])
        else:
            object.__setattr__(item, own.name, real(owner, own.name, value, told["unit"], within=within))


def check_fields(item: object, owner: str, checks: Mapping[str, Callable[[str, str, Any], Any]]) -> None:
    """Put in the place of fields of a frozen object what their checks make of them; `owner` names it."""
    for name, check in checks.items():
        object.__setattr__(item, name, check(owner, name, getattr(item, name)))


def checked_order(order: Any) -> int:
    """`order` as an order of edges; errors as `integer`."""
    return integer("mesh", "order", order, least=1, most=HIGHEST_ORDER)


def checked_name(owner: str, name: Any) -> str:
    """`name` as a string that is not empty and can be printed; `owner` is what has it: "mesh: points has".

    Raises
    ------
    TypeError, ValueError
        It is not.
    """
    if not isinstance(name, str) or not name.strip() or not name.isprintable():
        kind = ValueError if isinstance(name, str) else TypeError
        raise kind(
            f"{owner} the name {shown(name)}, which must be a non-empty string without control characters"
        )
    return name


def named_points(points: Any) -> Mapping[str, Any]:
    """Points by their names, none for None; TypeError or ValueError otherwise."""
    if points is None:
        return {}
    if not isinstance(points, Mapping):
        raise TypeError(
            f'mesh: points = {shown(points)} must be a dict of names to (x, y) such as {{"P": (0.1, 0.0)}}'
        )
    for name in points:
        checked_name("mesh: points has", name)
    return points

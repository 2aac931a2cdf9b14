"""Checks of arguments; each error is one sentence that names the item, its value and what was expected."""

from __future__ import annotations

import errno
import math
import numbers
import os
import stat
from collections.abc import Collection
from typing import Any, NamedTuple

import numpy as np


class Bounds(NamedTuple):
    """Between which a number lies: `above` and `below` are excluded, `least` and `most` are not."""

    above: float | None = None
    least: float | None = None
    below: float | None = None
    most: float | None = None


ANY = Bounds()
# Integers beyond any that counts something.
MOST = 10**18


def real(
    owner: str,
    name: str,
    value: Any,
    unit: str = "",
    *,
    within: Bounds = ANY,
) -> float:
    """`value` as a finite float between bounds.

    Raises
    ------
    TypeError
        If it is no real number; a bool is none.
    ValueError
        If it is not finite or outside the bounds.
    """
    above, least, below, most = within
    in_unit = f" ({unit})" if unit else ""
    if isinstance(value, (bool, np.bool_)) or not isinstance(value, numbers.Real):
        raise TypeError(f"{owner}: {name} = {shown(value)} must be a number{in_unit}")
    try:
        number = float(value)
    except OverflowError:
        number = math.inf
    bounds = [
        f"above {above:g}" if above is not None else "",
        f"at least {least:g}" if least is not None else "",
        f"below {below:g}" if below is not None else "",
        f"at most {most:g}" if most is not None else "",
    ]
    inside = (
        math.isfinite(number)
        and (above is None or number > above)
        and (least is None or number >= least)
        and (below is None or number < below)
        and (most is None or number <= most)
    )
    if not inside:
        wanted = " and ".join(part for part in ["finite", *bounds] if part)
        raise ValueError(f"{owner}: {name} = {shown(value)} must be {wanted}{in_unit}")
    return number


def positive(owner: str, name: str, value: Any, unit: str = "") -> float:
    """`value` as a finite float above zero; errors as `real`."""
    return real(owner, name, value, unit, within=Bounds(above=0.0))


def frequency(owner: str, name: str, value: Any) -> float:
    """`value` as a frequency that a structure can be driven at, Hz; errors as `real`."""
    positive(owner, name, value, "Hz")
    return real(owner, name, value, "Hz", within=Bounds(least=1e-12, most=1e15))


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


def optional_integer(
    owner: str, name: str, value: Any, *, least: int | None = None, most: int | None = None
) -> int | None:
    """None, or as `integer`."""
    return None if value is None else integer(owner, name, value, least=least, most=most)


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


def require_regular(path: str | os.PathLike[str]) -> None:
    """Raise OSError for what is there but no file: a pipe would be waited for, and a device has no end."""
    mode = os.stat(path).st_mode
    if stat.S_ISDIR(mode):
        raise OSError(errno.EISDIR, os.strerror(errno.EISDIR))
    if not stat.S_ISREG(mode):
        raise OSError(errno.EINVAL, "it is no regular file")


def callback(owner: str, name: str, value: Any) -> Any:
    """`value` if it can be called; TypeError otherwise."""
    if not callable(value):
        raise TypeError(f"{owner}: {name} = {shown(value)} must be a function")
    return value


def progress(owner: str, value: Any) -> Any:
    """What is called with the fraction done: a function, "auto" or None; TypeError or ValueError
    otherwise.
    """
    if value is None or (isinstance(value, str) and value == "auto"):
        return value
    if isinstance(value, str) or not callable(value):
        kind = ValueError if isinstance(value, str) else TypeError
        raise kind(f"{owner}: progress = {shown(value)} must be a function, 'auto' or None")
    return value


def instance(owner: str, name: str, value: Any, kinds: type | tuple[type, ...], wanted: str) -> Any:
    """`value` if it is of one of some classes, `wanted` in words; TypeError otherwise."""
    if not isinstance(value, kinds):
        raise TypeError(f"{owner}: {name} = {shown(value)} must be {wanted}")
    return value


def numbers_of(
    owner: str, name: str, value: Any, count: int, what: str, within: Bounds = ANY
) -> tuple[float, ...]:
    """`value` as so many finite floats; TypeError or ValueError otherwise.

    Parameters
    ----------
    what : str
        What is expected, for messages: "two frequencies, low and high, in Hz".
    within : Bounds
    """
    if not isinstance(value, (list, tuple, np.ndarray)) or getattr(value, "ndim", 1) != 1:
        raise TypeError(f"{owner}: {name} = {shown(value)} must be {what}")
    if len(value) != count:
        raise ValueError(f"{owner}: {name} = {shown(value)} must be {what}")
    return tuple(real(owner, f"{name}[{k}]", item, within=within) for k, item in enumerate(value))


def names_of(owner: str, name: str, value: Any) -> tuple[str, ...]:
    """`value`, a sequence of names, as a tuple; TypeError otherwise."""
    if not isinstance(value, (list, tuple)) or not all(isinstance(item, str) for item in value):
        raise TypeError(f"{owner}: {name} = {shown(value)} must be a sequence of names")
    return tuple(value)


def index_of(owner: str, name: str, value: Any, count: int) -> int:
    """`value` as the index of one of so many things, from 0, or from the end if it is negative; TypeError or
    ValueError otherwise.
    """
    index = integer(owner, name, value, least=-count, most=count - 1)
    return index % count


def real_array(owner: str, name: str, value: Any, dimensions: int | None, unit: str = "") -> np.ndarray:
    """`value` as a new array of finite floats with so many dimensions; None: any.

    Raises
    ------
    TypeError
        If its entries are no real numbers; bools and complex numbers are none.
    ValueError
        If it has other dimensions, masked entries or values that are not finite.
    """
    in_unit = f" ({unit})" if unit else ""
    refuse_masked(owner, name, value)
    try:
        array = np.asarray(value)
    except ValueError:  # rows of different lengths
        raise ValueError(f"{owner}: {name} has rows of different lengths") from None
    if array.dtype.kind not in "iuf":
        raise TypeError(f"{owner}: {name} = {shown(value)} must be an array of real numbers{in_unit}")
    if dimensions is not None and array.ndim != dimensions:
        raise ValueError(f"{owner}: {name} has {array.ndim} dimensions, {dimensions} are expected")
    array = array.astype(float)
    if not np.isfinite(array).all():
        place = tuple(int(k) for k in np.argwhere(~np.isfinite(array))[0])
        at = place[0] if len(place) == 1 else place
        raise ValueError(f"{owner}: {name}[{at}] = {array[place]} must be finite{in_unit}")
    return array


def refuse_masked(owner: str, name: str, value: Any) -> None:
    """Raise a ValueError for a masked array: the values behind its mask would be taken."""
    if np.ma.is_masked(value):
        raise ValueError(f"{owner}: {name} has masked entries; leave them out")


def shown(value: Any) -> str:
    """What stands for a value in a message: its repr on one line, cut where it is long."""
    try:
        line = " ".join(repr(value).split())
    except Exception:  # a foreign class' own fault
        line = f"<{type(value).__name__}>"
    return line if len(line) <= 80 else f"{line[:76]} ..."

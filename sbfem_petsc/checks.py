"""Checks of arguments; each error is one sentence that names the item, its value and what was expected.

Those of single values are `meshing.input_checks`, for both packages.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from meshing.input_checks import ANY, Bounds, choice, flag, integer, path, positive, real, said, shown, text

# what is passed on
__all__ = ["ANY", "Bounds", "choice", "flag", "integer", "path", "positive", "real", "said", "shown", "text"]


def optional_integer(
    owner: str, name: str, value: Any, *, least: int | None = None, most: int | None = None
) -> int | None:
    """None, or as `integer`."""
    return None if value is None else integer(owner, name, value, least=least, most=most)


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


def instances(owner: str, name: str, value: Any, kind: type, wanted: str) -> tuple[Any, ...]:
    """One of a class, or a sequence of them, `wanted` in words, as a tuple; TypeError otherwise."""
    several = (value,) if isinstance(value, kind) else value
    if not isinstance(several, (list, tuple)):
        raise TypeError(f"{owner}: {name} = {shown(value)} must be {wanted}")
    one = f"a {kind.__name__}"
    return tuple(instance(owner, f"{name}[{k}]", item, kind, one) for k, item in enumerate(several))


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


def real_array(
    owner: str, name: str, value: Any, dimensions: int | tuple[int, ...] | None, unit: str = ""
) -> np.ndarray:
    """`value` as a new array of finite floats with so many dimensions, or of a shape; None: any.

    Raises
    ------
    TypeError
        If its entries are no real numbers; bools and complex numbers are none.
    ValueError
        If it has other dimensions, another shape, masked entries or values that are not finite.
    """
    in_unit = f" ({unit})" if unit else ""
    refuse_masked(owner, name, value)
    try:
        array = np.asarray(value)
    except ValueError:  # rows of different lengths
        raise ValueError(f"{owner}: {name} has rows of different lengths") from None
    if array.dtype.kind not in "iuf":
        raise TypeError(f"{owner}: {name} = {shown(value)} must be an array of real numbers{in_unit}")
    if isinstance(dimensions, tuple) and array.shape != dimensions:
        raise ValueError(f"{owner}: {name} has shape {array.shape}, {dimensions} was expected")
    if isinstance(dimensions, int) and array.ndim != dimensions:
        raise ValueError(f"{owner}: {name} has {array.ndim} dimensions, {dimensions} are expected")
    array = array.astype(float)
    if not np.isfinite(array).all():
        place = tuple(int(k) for k in np.argwhere(~np.isfinite(array))[0])
        at = place[0] if len(place) == 1 else place
        raise ValueError(f"{owner}: {name}[{at}] = {array[place]} must be finite{in_unit}")
    return array


def require_symmetric(owner: str, name: str, matrix: Any, share: float) -> None:
    """ValueError for a dense or sparse matrix whose entries differ across its diagonal by more than a share
    of its largest one.
    """
    most, trial = share * abs(matrix).max(), np.random.default_rng(0).uniform(1.0, 2.0, matrix.shape[0])
    if np.abs(matrix @ trial - matrix.T @ trial).max() <= 0.1 * most:  # sooner than a difference of matrices
        return
    if (off := abs(matrix - matrix.T).max()) > most:
        raise ValueError(f"{owner}: {name} is not symmetric, entries differ by up to {off:g}")


def refuse_masked(owner: str, name: str, value: Any) -> None:
    """Raise a ValueError for a masked array: the values behind its mask would be taken."""
    if np.ma.is_masked(value):
        raise ValueError(f"{owner}: {name} has masked entries; leave them out")

"""Checks of what a file holds, which may come from a stranger: objects of its own alone, numbers of
shapes and ranges that belong together.
"""

from __future__ import annotations

import math
import os
from typing import Any

import h5py
import numpy as np

from ..capacity import available_memory, in_bytes

# What the compression that files of this program may have gains at most.
DEFLATE = 1032


def require_own(file: h5py.File) -> None:
    """Raise ValueError unless everything in a file is its own, there once, and no larger than the file can
    hold: no links, no storage in other files, no data that only memory would have room for.
    """
    size, total = os.path.getsize(file.filename), 0
    seen, waiting = {h5py.h5o.get_info(file.id).addr}, [file["/"]]
    while waiting:
        group = waiting.pop()
        for name in group:
            if not isinstance(group.get(name, getlink=True), h5py.HardLink):
                raise ValueError(f"{name!r} leads elsewhere")
            item = group[name]
            address = h5py.h5o.get_info(item.id).addr
            if address in seen:
                raise ValueError(f"{name!r} is there twice")
            seen.add(address)
            if isinstance(item, h5py.Group):
                waiting.append(item)
            elif isinstance(item, h5py.Dataset):
                if item.external or item.is_virtual:
                    raise ValueError(f"{name!r} is stored elsewhere")
                filters = item.id.get_create_plist().get_nfilters()
                if item.nbytes > (DEFLATE if filters else 1) * size:
                    raise ValueError(f"{name!r} is larger than the file")
                total += item.nbytes
    if total > size and total > available_memory():
        raise ValueError(f"it would take {in_bytes(total)} of memory, more than is free")


def numbers(
    group: h5py.Group | h5py.File,
    name: str,
    *shape: int | None,
    finite: bool = True,
    least: float = -math.inf,
    kinds: str = "f",
) -> np.ndarray:
    """A data set of numbers.

    Parameters
    ----------
    name : str
    shape : int or None
        Lengths that are expected; None: any.
    finite : bool
        Whether it must be.
    least : float
        Of all numbers.
    kinds : str
        Kinds of NumPy's types that it may have.

    Raises
    ------
    ValueError
        If it is missing or not what is expected.
    """
    item = group.get(name)
    if not isinstance(item, h5py.Dataset):
        raise ValueError(f"{name!r} is missing")
    values = np.asarray(item[()])
    fits = values.ndim == len(shape) and all(n is None or n == m for n, m in zip(shape, values.shape))
    if not fits or values.dtype.kind not in kinds:
        wanted = " x ".join("n" if n is None else str(n) for n in shape)
        raise ValueError(f"{name!r} is {values.dtype} of shape {values.shape}, not {wanted} numbers")
    if finite and not np.isfinite(values).all():
        raise ValueError(f"{name!r} has values that are not finite")
    if values.dtype.kind != "c" and (values < least).any():
        raise ValueError(f"{name!r} has values below {least:g}")
    return values


def whole(item: Any, name: str, *, least: int = 0, most: int | None = None) -> int:
    """An attribute as a whole number; ValueError otherwise."""
    value = _attribute(item, name)
    if not isinstance(value, (int, np.integer)) or value < least or (most is not None and value > most):
        limit = f" to {most}" if most is not None else " or more"
        raise ValueError(f"{name} = {value!r} is no whole number, {least}{limit}")
    return int(value)


def number(item: Any, name: str, *, finite: bool = True, least: float = -math.inf) -> float:
    """An attribute as a number; ValueError otherwise."""
    value = _attribute(item, name)
    if not isinstance(value, (float, int, np.floating, np.integer)) or value < least:
        raise ValueError(f"{name} = {value!r} is no number from {least:g} on")
    if finite and not math.isfinite(value):
        raise ValueError(f"{name} = {value!r} is not finite")
    return float(value)


def text(item: Any, name: str) -> str:
    """An attribute as a text; ValueError otherwise."""
    value = _attribute(item, name)
    if not isinstance(value, str):
        raise ValueError(f"{name} = {value!r} is no text")
    return value


def texts(item: Any, name: str) -> tuple[str, ...]:
    """An attribute as different texts; ValueError otherwise."""
    values = np.asarray(_attribute(item, name)).ravel().tolist()
    if not all(isinstance(value, str) for value in values) or len(set(values)) < len(values):
        raise ValueError(f"{name} = {values!r} are no different names")
    return tuple(values)


def truth(item: Any, name: str) -> bool:
    """An attribute as True or False; ValueError otherwise."""
    value = _attribute(item, name)
    if not isinstance(value, (bool, np.bool_)):
        raise ValueError(f"{name} = {value!r} is neither True nor False")
    return bool(value)


def _attribute(item: Any, name: str) -> Any:
    if name not in item.attrs:
        raise ValueError(f"{name!r} is missing")
    return item.attrs[name]

"""Checks of what pictures are asked for, before anything is drawn."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from ..checks import Bounds, choice, flag, integer, numbers_of, positive, real, shown
from ..parallel import checked_communicator, collective


def check(owner: str, **arguments: Any) -> None:
    """Raise TypeError or ValueError for an argument that makes no sense; what it must be follows from its
    name. With `comm` among them, on all its ranks: collective.
    """
    together: Any = contextlib.nullcontext()
    if "comm" in arguments:
        together = collective(checked_communicator(owner, arguments.pop("comm")))
    with together:
        for name, value in arguments.items():
            CHECKS[name](owner, name, value)


def _text(owner: str, name: str, value: Any) -> None:
    if not isinstance(value, str):
        raise TypeError(f"{owner}: {name} = {shown(value)} must be a text")


def _text_or_none(owner: str, name: str, value: Any) -> None:
    if value is not None:
        _text(owner, name, value)


def _window(owner: str, name: str, value: Any) -> None:
    if value is None:
        return
    start, stop = numbers_of(owner, name, value, 2, "two numbers, the lower one first")
    if not start < stop:
        raise ValueError(f"{owner}: {name} = {shown(value)} must be two numbers, the lower one first")


def _table(of: Callable[[str, str, Any], Any]) -> Callable[[str, str, Any], None]:
    """A check of a dict by name, each entry by another check; None is none."""

    def checked(owner: str, name: str, value: Any) -> None:
        if value is None:
            return
        if not isinstance(value, Mapping) or not all(isinstance(key, str) for key in value):
            raise TypeError(f"{owner}: {name} = {shown(value)} must be a dict by name")
        for key, item in value.items():
            of(owner, f"{name}[{key!r}]", item)

    return checked


def _numbers(owner: str, name: str, value: Any) -> None:
    if isinstance(value, (str, Mapping)) or not isinstance(value, (Sequence, np.ndarray)):
        raise TypeError(f"{owner}: {name} = {shown(value)} must be a sequence of numbers")
    for k, item in enumerate(value):
        real(owner, f"{name}[{k}]", item)


def curve(owner: str, name: str, value: Any) -> None:
    """Raise unless a value is a pair of arrays of one length that can be drawn over each other."""
    if not isinstance(value, (tuple, list)) or len(value) != 2:
        raise TypeError(f"{owner}: {name} = {shown(value)} must be two arrays, places and values")
    try:
        along, values = (np.asarray(part) for part in value)
    except ValueError:  # rows of different lengths
        raise ValueError(f"{owner}: {name} must be two arrays, places and values") from None
    if along.ndim != 1 or along.shape != values.shape or along.dtype.kind not in "iuf":
        raise ValueError(
            f"{owner}: {name} has the shapes {along.shape} and {values.shape}; two arrays of one length, "
            "places and values, are expected"
        )
    if values.dtype.kind not in "iufc" or not len(along):
        raise ValueError(f"{owner}: {name} has no numbers to be drawn")
    if not np.isfinite(along).all() or not np.isfinite(values).any():
        raise ValueError(f"{owner}: {name} has places, or all values, that are not finite")


CHECKS: dict[str, Callable[[str, str, Any], Any]] = {
    "point": _text,
    "title": _text,
    "quantity": _text,
    "label": _text_or_none,
    "direction": lambda owner, name, value: choice(owner, name, value, ("x", "y")),
    "count": lambda owner, name, value: integer(owner, name, value, least=1, most=10_000),
    "order": lambda owner, name, value: integer(owner, name, value, least=1, most=1000),
    "columns": lambda owner, name, value: integer(owner, name, value, least=1, most=100),
    "crack": lambda owner, name, value: integer(owner, name, value, least=0),
    "decades": lambda owner, name, value: real(owner, name, value, within=Bounds(above=0.0, most=300.0)),
    "window": _window,
    "forces": _table(positive),
    "lines": _table(real),
    "pairs": _table(lambda owner, name, value: integer(owner, name, value, least=0)),
    "harmonics": _table(_numbers),
    "spectra": _table(curve),
    "every": flag,
}

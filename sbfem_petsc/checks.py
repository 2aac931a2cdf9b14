"""Checks of arguments; each error is one sentence that names the item, its value and what was expected."""

from __future__ import annotations

import math
import numbers
from collections.abc import Collection
from typing import Any


def real(
    owner: str,
    name: str,
    value: Any,
    unit: str = "",
    *,
    above: float | None = None,
    least: float | None = None,
    below: float | None = None,
    most: float | None = None,
) -> float:
    """`value` as a finite float between bounds.

    Raises
    ------
    TypeError
        If it is no real number; a bool is none.
    ValueError
        If it is not finite or outside the bounds (`above` and `below` are excluded, `least` and `most` are not).
    """
    in_unit = f" ({unit})" if unit else ""
    if isinstance(value, bool) or not isinstance(value, numbers.Real) or type(value).__name__ == "bool_":
        raise TypeError(f"{owner}: {name} = {value!r} must be a number{in_unit}")
    number = float(value)
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
        raise ValueError(f"{owner}: {name} = {value!r} must be {wanted}{in_unit}")
    return number


def positive(owner: str, name: str, value: Any, unit: str = "") -> float:
    """`value` as a finite float above zero; errors as `real`."""
    return real(owner, name, value, unit, above=0.0)


def integer(owner: str, name: str, value: Any, *, least: int | None = None, most: int | None = None) -> int:
    """`value` as an int between bounds, both included; TypeError or ValueError otherwise."""
    if isinstance(value, bool) or not isinstance(value, numbers.Integral):
        raise TypeError(f"{owner}: {name} = {value!r} must be an integer")
    number = int(value)
    if (least is not None and number < least) or (most is not None and number > most):
        if least is not None and most is not None:
            wanted = f"between {least} and {most}"
        else:
            wanted = f"at least {least}" if least is not None else f"at most {most}"
        raise ValueError(f"{owner}: {name} = {value!r} must be {wanted}")
    return number


def flag(owner: str, name: str, value: Any) -> bool:
    """`value` as a bool; TypeError for anything else, however true it looks."""
    if type(value).__name__ not in ("bool", "bool_"):
        raise TypeError(f"{owner}: {name} = {value!r} must be True or False")
    return bool(value)


def choice(owner: str, name: str, value: Any, options: Collection[str]) -> str:
    """`value` as one of several words; ValueError otherwise."""
    if not isinstance(value, str) or value not in options:
        raise ValueError(f"{owner}: {name} = {value!r} must be one of {', '.join(map(repr, options))}")
    return value

"""Checks of single inputs; each error is one sentence that names the item, its value and what was
expected.
"""

from __future__ import annotations

import math

import numpy as np

HIGHEST_ORDER = 20


def number(item: str, name: str, value: object) -> float:
    """`value` as a finite float, or the error that names it."""
    if isinstance(value, bool) or not isinstance(value, (int, float, np.integer, np.floating)):
        raise TypeError(f"{item}: {name} is {value!r}, a number was expected.")
    if not math.isfinite(value):
        raise ValueError(f"{item}: {name} is {value}, a finite number was expected.")
    return float(value)


def positive(item: str, name: str, value: object, unit: str = "m") -> float:
    """`value` as a finite float above zero, or the error that names it."""
    result = number(item, name, value)
    if result <= 0:
        raise ValueError(f"{item}: {name} is {result:g} {unit}, it must be greater than zero.")
    return result


def checked_order(order: object) -> int:
    """`order` as an int in range, or the error that names it."""
    if isinstance(order, bool) or not isinstance(order, (int, np.integer)):
        raise TypeError(f"mesh: order is {order!r}, a whole number from 1 to {HIGHEST_ORDER} was expected.")
    if not 1 <= order <= HIGHEST_ORDER:
        raise ValueError(f"mesh: order is {order}, a whole number from 1 to {HIGHEST_ORDER} was expected.")
    return int(order)


def flag(item: str, name: str, value: object) -> bool:
    """`value` as a bool, or the error that names it."""
    if not isinstance(value, (bool, np.bool_)):
        raise TypeError(f"{item}: {name} is {value!r}, True or False was expected.")
    return bool(value)

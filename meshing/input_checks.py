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


def checked_faces(extent: float, face_size: object, face_edges: object) -> tuple[float | None, int]:
    """Longest edge on the faces of cracks, m, and least number of edges; `extent` is the body's size, m."""
    if face_size is not None and positive("mesh", "face_size", face_size) < 1e-6 * extent:
        raise ValueError(
            f"mesh: face_size {face_size:g} m is below 1e-6 of the body's size {extent:g} m; make it larger."
        )
    if isinstance(face_edges, bool) or not isinstance(face_edges, (int, np.integer)):
        raise TypeError(f"mesh: face_edges is {face_edges!r}, a whole number was expected.")
    if not 1 <= face_edges <= 1000:
        raise ValueError(f"mesh: face_edges is {face_edges}, 1 to 1000 was expected.")
    return None if face_size is None else positive("mesh", "face_size", face_size), int(face_edges)

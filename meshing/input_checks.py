"""Checks of single inputs; each error is one sentence that names the item, its value and what was
expected.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

HIGHEST_ORDER = 20
# Beyond which areas and their squares leave the range of numbers.
LARGEST = 1e100


def shown(value: object) -> str:
    """What stands for a value in a message: its repr on one line, cut where it is long."""
    try:
        line = " ".join(repr(value).split())
    except Exception:  # a foreign class' own fault
        line = f"<{type(value).__name__}>"
    return line if len(line) <= 80 else f"{line[:76]} ..."


def number(item: str, name: str, value: object) -> float:
    """`value` as a finite float, or the error that names it."""
    if isinstance(value, bool) or not isinstance(value, (int, float, np.integer, np.floating)):
        raise TypeError(f"{item}: {name} is {shown(value)}, a number was expected.")
    try:
        result = float(value)
    except OverflowError:
        result = math.inf
    if not abs(result) <= LARGEST:
        raise ValueError(
            f"{item}: {name} is {shown(value)}, a finite number of at most {LARGEST:g} was expected."
        )
    return result


def positive(item: str, name: str, value: object, unit: str = "m") -> float:
    """`value` as a finite float above zero, or the error that names it."""
    result = number(item, name, value)
    if result <= 0:
        raise ValueError(f"{item}: {name} is {result:g} {unit}, it must be greater than zero.")
    return result


def checked_order(order: object) -> int:
    """`order` as an int in range, or the error that names it."""
    if isinstance(order, bool) or not isinstance(order, (int, np.integer)):
        raise TypeError(
            f"mesh: order is {shown(order)}, a whole number from 1 to {HIGHEST_ORDER} was expected."
        )
    if not 1 <= order <= HIGHEST_ORDER:
        raise ValueError(
            f"mesh: order is {shown(order)}, a whole number from 1 to {HIGHEST_ORDER} was expected."
        )
    return int(order)


def flag(item: str, name: str, value: object) -> bool:
    """`value` as a bool, or the error that names it."""
    if not isinstance(value, (bool, np.bool_)):
        raise TypeError(f"{item}: {name} is {shown(value)}, True or False was expected.")
    return bool(value)


def choice(item: str, name: str, value: object, options: tuple[str, ...]) -> str:
    """`value` as one of several words, or the error that names it."""
    if not isinstance(value, str) or value not in options:
        wanted = " or ".join(f'"{option}"' for option in options)
        kind = ValueError if isinstance(value, str) else TypeError
        raise kind(f"{item}: {name} is {shown(value)}, {wanted} was expected.")
    return value


def checked_name(owner: str, name: object) -> str:
    """`name` as a string that is not empty and can be printed, or the error that names it; `owner` is what
    has it, "mesh: points has".
    """
    if not isinstance(name, str):
        raise TypeError(f"{owner} the name {shown(name)}, a non-empty string was expected.")
    if not name.strip() or not name.isprintable():
        raise ValueError(
            f"{owner} the name {shown(name)}, a non-empty string without control characters was expected."
        )
    return name


def named_points(points: object) -> Mapping[str, object]:
    """Points by their names, none for None, or the error that says otherwise."""
    if points is None:
        return {}
    if not isinstance(points, Mapping):
        raise TypeError(
            f'mesh: points is {shown(points)}, a dict of names to (x, y) such as {{"P": (0.1, 0.0)}} was '
            "expected."
        )
    for name in points:
        checked_name("mesh: points has", name)
    return points


def checked_faces(extent: float, face_size: object, face_edges: object) -> tuple[float | None, int]:
    """Longest edge on the faces of cracks, m, and least number of edges; `extent` is the body's size, m."""
    if face_size is not None and positive("mesh", "face_size", face_size) < 1e-6 * extent:
        raise ValueError(
            f"mesh: face_size {face_size:g} m is below 1e-6 of the body's size {extent:g} m; make it larger."
        )
    if isinstance(face_edges, bool) or not isinstance(face_edges, (int, np.integer)):
        raise TypeError(f"mesh: face_edges is {shown(face_edges)}, a whole number was expected.")
    if not 1 <= face_edges <= 1000:
        raise ValueError(f"mesh: face_edges is {shown(face_edges)}, 1 to 1000 was expected.")
    return None if face_size is None else positive("mesh", "face_size", face_size), int(face_edges)

"""Harmonics of several steady states side by side: a table to print, and comma-separated values."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from ..checks import integer, shown
from ..continuation.orbit import Orbit
from ..motion.states import Point
from ..writing import write_table

if TYPE_CHECKING:
    from rich.table import Table


def harmonics_table(
    orbits: Mapping[str, Orbit], point: Point, *, count: int = 10, title: str | None = None
) -> Table:
    """Moduli of the mean and of the harmonics of the y displacement of a point, and those of the last motion
    over its first harmonic.

    Parameters
    ----------
    orbits : dict of Orbit
        By the names of their columns.
    point : str or (x, y)
        Name of a point, or coordinates in m.
    count : int
        Number of the last harmonic.
    title : str, optional

    Returns
    -------
    rich.table.Table

    Raises
    ------
    TypeError, ValueError
        If there is no motion, or a motion has fewer harmonics.
    """
    from rich.table import Table

    found = {name: np.abs(c) for name, c in _harmonics("harmonics_table", orbits, point, count).items()}
    last = list(found)[-1]
    result = Table(title=title, caption="0: the mean; what is below 1e-12 of the first is rounding")
    for name in ("harmonic", *found, f"{last}, over the first"):
        result.add_column(name, justify="right")
    for k in range(count + 1):
        result.add_row(
            str(k), *(f"{c[k]:.4e}" for c in found.values()), f"{found[last][k] / found[last][1]:.3e}"
        )
    return result


def write_harmonics(orbits: Mapping[str, Orbit], path: str, point: Point, *, count: int = 10) -> None:
    """Write the complex harmonics of the y displacement of a point as comma-separated values: a row a
    harmonic, columns re_NAME_m and im_NAME_m a motion.

    Parameters
    ----------
    orbits : dict of Orbit
        By name; blanks and commas of the names become underscores.
    path : str
    point : str or (x, y)
        Name of a point, or coordinates in m.
    count : int
        Number of the last harmonic.

    Raises
    ------
    TypeError, ValueError
        See `harmonics_table`; or if the file cannot be written.
    """
    columns: dict[str, np.ndarray] = {"harmonic": np.arange(count + 1)}
    for name, c in _harmonics("write_harmonics", orbits, point, count).items():
        plain = name.replace(", ", "_").replace(" ", "_")
        if f"re_{plain}_m" in columns:
            raise ValueError(
                f"write_harmonics: two of orbits have the columns {plain!r}; give them other names"
            )
        columns |= {f"re_{plain}_m": c.real, f"im_{plain}_m": c.imag}
    write_table(path, columns)


def _harmonics(where: str, orbits: Mapping[str, Orbit], point: Point, count: int) -> dict[str, np.ndarray]:
    """(count + 1,) complex harmonics of each motion."""
    count = integer(where, "count", count, least=1)
    if not isinstance(orbits, Mapping) or not orbits:
        raise TypeError(f"{where}: orbits = {shown(orbits)} must be a dict of motions by name")
    for name, orbit in orbits.items():
        if not isinstance(orbit, Orbit):
            raise TypeError(f"{where}: orbits[{name!r}] = {shown(orbit)} is no Orbit")
    found = {name: orbit.harmonics(point) for name, orbit in orbits.items()}
    for name, c in found.items():
        if len(c) <= count:
            raise ValueError(
                f"{where}: count = {count} is above the last harmonic of {name!r}, {len(c) - 1}, which its "
                "steps tell apart"
            )
    return {name: c[: count + 1] for name, c in found.items()}

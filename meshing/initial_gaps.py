"""Initial gaps of the faces of a crack given by the user: a number, a function of position, or an array."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from meshing.input_checks import shown, values_at
from meshing.mesh_arrays import MeshArrays

# A number, a function of arrays x and y, or one value for each of the crack's pairs, m.
Gap = float | Callable[[np.ndarray, np.ndarray], Any] | np.ndarray


def gaps_with(mesh: MeshArrays, crack: str, gap: Gap) -> np.ndarray:
    """(pairs,): the mesh's initial gaps with those of one crack replaced, m.

    Parameters
    ----------
    crack : str
    gap : float, callable or (n,) array
        See `BoundaryMesh.with_gap`.

    Raises
    ------
    TypeError, ValueError
        The mesh has no such crack; the gaps are no finite numbers >= 0, one for each pair.
    """
    names = [item.name for item in mesh.cracks]
    if not isinstance(crack, str) or crack not in names:
        known = ", ".join(map(repr, names)) or "none"
        raise ValueError(f"with_gap: crack {shown(crack)} does not exist; the mesh has {known}.")
    mine = np.flatnonzero(mesh.pairs.crack == names.index(crack))
    where = f"with_gap: gap of crack {crack!r}"
    if callable(gap):
        gap = values_at(where, gap, mesh.nodes[mesh.pairs.nodes[mine]].mean(axis=1))
    result = mesh.pairs.gap.copy()
    result[mine] = _numbers(where, gap, len(mine))
    return result


def _numbers(where: str, given: object, count: int) -> np.ndarray:
    """Gaps (count,) from a number or an array, checked."""
    try:
        values = np.asarray(given)
        if isinstance(given, (bool, str)) or values.dtype.kind not in "iuf":
            raise TypeError
    except (TypeError, ValueError):
        raise TypeError(
            f"{where} is {shown(given)}; a distance in m, a function of arrays x and y that gives it, or an "
            "array with one value for each pair was expected."
        ) from None
    if values.shape not in ((), (count,)):
        raise ValueError(f"{where} has the shape {values.shape}; the crack has {count} pairs, ({count},).")
    values = np.broadcast_to(values.astype(float), (count,))
    wrong = np.flatnonzero(~((values >= 0.0) & np.isfinite(values)))
    if len(wrong):
        raise ValueError(
            f"{where} is {values[wrong[0]]:g} m at pair {wrong[0]}; gaps are finite and not negative."
        )
    return values


def remade_with_gap(make: Callable[..., Any], crack: str, gap: Gap, /, **options: Mapping[str, Any]) -> Any:
    """A mesh made anew, with the gap again: how a finer mesh of the same structure is made."""
    return make(**options).with_gap(crack, gap)

"""Reductions in HDF5, and whether two of them are of the same model."""

from __future__ import annotations

from dataclasses import fields, replace

import h5py
import numpy as np

from ..reduction.reduced_model import Reduction
from .history_file import SAME, close


def write_reduction(group: h5py.Group, reduction: Reduction) -> None:
    """All fields: arrays as datasets, names as attributes."""
    for field in fields(Reduction):
        value = getattr(reduction, field.name)
        if isinstance(value, np.ndarray):
            group.create_dataset(field.name, data=value)
        else:
            group.attrs.create(field.name, list(value), shape=(len(value),), dtype=h5py.string_dtype())


def read_reduction(group: h5py.Group) -> Reduction:
    """What `write_reduction` wrote."""
    return Reduction(
        **{
            f.name: group[f.name][()] if f.name in group else tuple(group.attrs[f.name])
            for f in fields(Reduction)
        }
    )


def in_rows(reduction: Reduction) -> Reduction:
    """The same with all arrays contiguous, row by row."""
    arrays = {f.name: getattr(reduction, f.name) for f in fields(Reduction)}
    return replace(
        reduction,
        **{
            name: np.ascontiguousarray(values)
            for name, values in arrays.items()
            if isinstance(values, np.ndarray)
        },
    )


def difference(one: Reduction, other: Reduction) -> str:
    """What tells two reductions apart, "" if nothing; signs of modes and rounding by other numbers of ranks
    do not.
    """
    if one.points != other.points or one.tips != other.tips:
        return "its points or cracks differ"
    for text, a, b in (
        ("modes", one.omega, other.omega),
        ("contact pairs", one.initial_gap, other.initial_gap),
        ("loads", one.load_modes.T, other.load_modes.T),
    ):
        if len(a) != len(b):
            return f"{len(a)} {text}, not {len(b)}"
    if not np.allclose(
        one.frequencies, other.frequencies, rtol=SAME, atol=SAME * other.frequencies[-1] * 1e-3
    ):
        worst = int(np.argmax(np.abs(one.frequencies - other.frequencies)))
        return (
            f"frequency {worst + 1} is {one.frequencies[worst]:.7g} Hz, not {other.frequencies[worst]:.7g} Hz"
        )
    if not close(one.damping, other.damping):
        return "its damping differs"
    # static compliances, modes and residual together: the same whatever the signs of the modes
    for text, of in (
        ("initial gaps", lambda r: r.initial_gap),
        ("contact pairs' compliance", lambda r: _compliance(r.gap_modes, r.omega) + r.gap_flexibility),
        ("loads' compliance", lambda r: _compliance(r.load_modes.T, r.omega) + r.load_flexibility),
        ("loads on the pairs", lambda r: _compliance(r.gap_modes, r.omega, r.load_modes.T) + r.gap_loads),
    ):
        if not close(of(one), of(other)):
            return f"its {text} differ"
    return ""


def _compliance(left: np.ndarray, omega: np.ndarray, right: np.ndarray | None = None) -> np.ndarray:
    elastic = omega > 1e-6 * omega[-1]
    return (left[:, elastic] / omega[elastic] ** 2) @ (left if right is None else right)[:, elastic].T

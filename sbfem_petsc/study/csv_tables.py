"""Quantities of an analysis as CSV tables."""

from __future__ import annotations

import csv
import os
from collections.abc import Sequence
from typing import Any

import numpy as np

from ..writing import replaced
from .quantities import Quantity, Tree


def write_tables(tree: Tree, folder: str, name: str) -> list[str]:
    """Write the CSV files of an analysis: one for the arrays of each length, one for single values. Empty
    arrays are left out.

    Returns
    -------
    list of str
        Files written.
    """
    columns: dict[int, list[tuple[str, np.ndarray]]] = {}
    single: list[tuple[str, Any, str]] = []
    for key, entry in _leaves(tree):
        value, unit = entry.value, entry.unit
        if isinstance(value, np.ndarray) and value.ndim:
            if not len(value):
                continue
            ending = "" if unit == "1" else f" [{unit}]"
            flat = value.reshape(len(value), -1)
            for k in range(flat.shape[1]):
                part = f"{key}{f'/{k}' if value.ndim > 1 else ''}"
                if np.iscomplexobj(flat):
                    columns.setdefault(len(value), []).append((f"|{part}|{ending}", np.abs(flat[:, k])))
                    columns[len(value)].append((f"arg {part} [rad]", np.angle(flat[:, k])))
                else:
                    columns.setdefault(len(value), []).append((f"{part}{ending}", flat[:, k]))
        else:
            single.append((key, value, unit))
    written = []
    if single:
        written.append(os.path.join(folder, f"{name}.csv"))
        _write(written[-1], [("quantity", "value", "unit"), *single])
    for length, found in columns.items():
        written.append(os.path.join(folder, f"{name}_{length}.csv"))
        rows = zip(*(column.tolist() for _, column in found))
        _write(written[-1], [[heading for heading, _ in found], *rows])
    return written


def _write(path: str, rows: Sequence[Sequence[Any]]) -> None:
    with replaced(path, "table") as temporary, open(temporary, "w", newline="", encoding="utf-8") as file:
        csv.writer(file).writerows(rows)


def _leaves(tree: Tree, above: str = "") -> list[tuple[str, Quantity]]:
    found: list[tuple[str, Quantity]] = []
    for name, entry in sorted(tree.items()):  # as files have them
        if isinstance(entry, Quantity):
            found.append((f"{above}{name}", entry))
        elif isinstance(entry, dict):
            found += _leaves(entry, f"{above}{name}/")
    return found

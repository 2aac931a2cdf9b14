"""Files of a study: trees of quantities in HDF5, JSON, each replaced as a whole."""

from __future__ import annotations

import json
from typing import Any

import h5py
import numpy as np

from ..writing import replaced
from .quantities import Quantity, Tree


def write_json(path: str, value: Any) -> None:
    """Write JSON, whole or not at all."""
    with replaced(path, "file") as temporary, open(temporary, "w", encoding="utf-8") as file:
        json.dump(value, file, indent=1, allow_nan=False)
        file.write("\n")


def read_json(path: str) -> Any:
    """Contents of a JSON file.

    Raises
    ------
    ValueError
        If it is missing or broken.
    """
    try:
        with open(path, encoding="utf-8") as file:
            return json.load(file)
    except OSError as error:
        raise ValueError(f"{path!r} cannot be read ({error.strerror or error})") from None
    except (ValueError, RecursionError):
        raise ValueError(f"{path!r} is no JSON file") from None


def write_tree(group: h5py.Group, tree: Tree) -> None:
    """Write a tree of quantities below a group; attributes "unit" and "description"."""
    for name, entry in tree.items():
        if isinstance(entry, Quantity):
            value = entry.value
            # None has no place in HDF5
            data = group.create_dataset(name, data=h5py.Empty("f8") if value is None else value)
            data.attrs["unit"], data.attrs["description"] = entry.unit, entry.text
            if entry.detail:
                data.attrs["detail"] = True
        elif isinstance(entry, dict):
            write_tree(group.create_group(name), entry)
        elif isinstance(entry, list):
            parts = group.create_group(name)
            parts.attrs["list"] = True
            for k, part in enumerate(entry):
                write_tree(parts.create_group(f"{k:04d}"), part)
        else:
            group.create_dataset(name, data=entry)


def read_tree(group: h5py.Group) -> Any:
    """The tree below a group."""
    tree: Tree = {}
    for name, entry in group.items():
        if isinstance(entry, h5py.Group):
            tree[name] = read_tree(entry)
            continue
        value = entry[()]
        if isinstance(value, h5py.Empty):
            value = None
        elif isinstance(value, bytes):
            value = value.decode()
        elif isinstance(value, np.generic):
            value = value.item()
        if "unit" in entry.attrs:
            tree[name] = Quantity(
                value, entry.attrs["unit"], entry.attrs["description"], bool(entry.attrs.get("detail", False))
            )
        else:
            tree[name] = value
    return list(tree.values()) if group.attrs.get("list", False) else tree

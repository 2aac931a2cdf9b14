"""Files of a study, each replaced as a whole: quantities in HDF5, laid out as records are, and JSON."""

from __future__ import annotations

import contextlib
import json
import os
from collections.abc import Iterator
from typing import Any

import h5py
import numpy as np

from ..record.files import opened, written
from ..record.layout import bare, put, text, text_of
from ..record.record import About
from ..writing import replaced
from .case.case import Case
from .quantities import Quantity, Tree

WHAT = "results file"


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


@contextlib.contextmanager
def new_results(path: str, holds: str) -> Iterator[h5py.File]:
    """A new file of results, "run", "analysis" or "sweep", laid out as those of records are.

    Raises
    ------
    ValueError
        See `record.files.written`.
    """
    with written(path, WHAT) as file:
        file.attrs["holds"] = text_of(holds)
        yield file


@contextlib.contextmanager
def results_in(path: str, *wanted: str) -> Iterator[h5py.File]:
    """A file of results to read.

    Raises
    ------
    ValueError
        See `record.files.opened`; if it is of another kind.
    """
    with opened(path, WHAT) as file:
        if "holds" in file.attrs and holds(file) == "analysis" and "analysis" not in wanted:
            run = os.path.dirname(os.path.dirname(os.path.abspath(path)))
            raise ValueError(
                f"{path!r} is one analysis of a run, which is read as a whole, by sb.read({run!r}) or "
                "the name of that folder"
            )
        if "holds" not in file.attrs or holds(file) not in wanted:
            raise ValueError(f"{path!r} is an HDF5 file of another kind, not of a {' or '.join(wanted)}")
        yield file


def holds(file: h5py.File) -> str:
    """What a file of results is of."""
    return text(file.attrs["holds"])


def write_case(group: h5py.Group, case: Case) -> None:
    """The case's text and the files it names, from which it can be run again."""
    group.attrs["file"] = text_of(os.path.basename(case.file))
    _put_bytes(group, "text", case.text.encode(), "the case file, in UTF-8")
    files = group.create_group("files")
    for k, (name, contents) in enumerate(case.named_files().items()):
        _put_bytes(files, f"{k:03d}", contents, "a file that it names").attrs["name"] = text_of(name)


def _put_bytes(group: h5py.Group, name: str, contents: bytes, words: str) -> h5py.Dataset:
    return put(group, name, np.frombuffer(contents, np.uint8), About(text=words), "1", (f"{name}_byte",))


def case_in(file: h5py.File) -> tuple[str, str]:
    """Text of the case that results are of, and name of its file."""
    return file["case/text"][()].tobytes().decode(), text(file["case"].attrs["file"])


def write_tree(group: h5py.Group, tree: Tree) -> None:
    """Write a tree of quantities below a group: a data set each, with unit, words and named axes."""
    for name, entry in sorted(tree.items(), key=lambda item: not _coordinate(*item)):
        if not isinstance(entry, (dict, list)):
            _put_quantity(group, name, entry, tree)
            continue
        part = group.create_group(name, track_order=True)
        if isinstance(entry, list):
            part.attrs["list"] = True
            entry = {f"{k:04d}": item for k, item in enumerate(entry)}
        write_tree(part, entry)


def _coordinate(name: str, entry: Any) -> bool:
    return isinstance(entry, Quantity) and entry.dims == (name,)


def _put_quantity(group: h5py.Group, name: str, item: Any, beside: Tree) -> None:
    """A quantity, or a plain value."""
    entry = item if isinstance(item, Quantity) else Quantity(item)
    array = np.asarray(np.nan if entry.value is None else entry.value)
    dims = entry.dims if len(entry.dims) == array.ndim else [f"{name}_{k}" for k in range(array.ndim)]
    free = tuple(dim if dim not in beside or _coordinate(dim, beside[dim]) else f"{dim}_axis" for dim in dims)
    data = put(group, name, array, About(text=entry.text), entry.unit, free)
    marks = {"detail": entry.detail, "none": entry.value is None, "plain": entry is not item}
    for mark in (mark for mark, there in marks.items() if there):
        data.attrs[mark] = True


def read_tree(group: h5py.Group, *, axes: bool = False) -> Any:
    """The tree below a group; `axes`: with their names, which a file that is written of it needs."""
    tree: Tree = {}
    for name, entry in group.items():
        if isinstance(entry, h5py.Group):
            tree[name] = read_tree(entry, axes=axes)
        elif not bare(entry):
            value, unit, words = value_of(entry), *(text(entry.attrs[key]) for key in ("units", "long_name"))
            found = Quantity(value, unit, words, "detail" in entry.attrs, _dims(name, entry) if axes else ())
            tree[name] = value if "plain" in entry.attrs else found
    return list(tree.values()) if "list" in group.attrs else tree


def _dims(name: str, data: h5py.Dataset) -> tuple[str, ...]:
    return (name,) if data.is_scale else tuple(dim[0].name.split("/")[-1] for dim in data.dims)


def value_of(data: h5py.Dataset) -> Any:
    """What `put` has written: an array, a number or a text; None where it is marked so."""
    if "none" in data.attrs:
        return None
    value = data[()]
    if isinstance(value, bytes):
        return value.decode()
    if data.dtype.kind == "S":
        return np.char.decode(value, "utf-8")
    if "dtype" in data.attrs:
        value = value.astype(bool)
    return value.item() if isinstance(value, np.generic) else value

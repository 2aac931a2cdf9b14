"""Files of a study, each replaced as a whole: quantities in HDF5, laid out as records are, and JSON."""

from __future__ import annotations

import contextlib
import json
import os
from collections.abc import Iterator
from typing import Any

import h5py
import numpy as np

from meshing.whole_file import replaced

from ..record.about import About
from ..record.files import opened, written
from ..record.layout import put, text, text_of
from ..writing import as_json
from .case.case import Case

WHAT = "results file"


def write_json(path: str, value: Any) -> None:
    """Write JSON, whole or not at all."""
    with replaced(path, "file") as temporary, open(temporary, "w", encoding="utf-8") as file:
        file.write(f"{as_json(value)}\n")


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

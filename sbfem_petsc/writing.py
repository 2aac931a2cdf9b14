"""Files in output folders and elsewhere, written whole or not at all; tables of numbers, and JSON."""

from __future__ import annotations

import contextlib
import csv
import itertools
import json
import os
import tempfile
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from mpi4py import MPI

from meshing.folder_index import home_of
from meshing.whole_file import replaced

from .checks import path as checked_path
from .output_folder import make_folder
from .ranks.parallel import collective


def check_output_folder(path: str, comm: MPI.Comm) -> str:
    """Make the folder if it is missing and see that every rank can write into it. Collective, for the start
    of a program.

    Returns
    -------
    str
        The absolute path.

    Raises
    ------
    ValueError
        One sentence, on all ranks.
    """
    folder = os.path.abspath(os.fspath(path))
    with collective(comm):
        if comm.rank == 0:
            make_folder(folder)
    with collective(comm):
        try:
            with tempfile.TemporaryFile(dir=folder):
                pass
        except OSError as error:
            raise ValueError(
                f"output folder {folder!r} cannot be written ({error.strerror or error}); name another one "
                "or change its permissions"
            ) from None
    return folder


@contextlib.contextmanager
def spare_folder() -> Iterator[str]:
    """A folder for files that nobody keeps.

    Raises
    ------
    ValueError
        If the system has no place for one, as on a full disk.
    """
    try:
        folder = tempfile.TemporaryDirectory()
    except OSError as error:
        raise ValueError(
            f"there is no folder for temporary files ({error.strerror or error}); make room, or name one in "
            "the environment variable TMPDIR"
        ) from None
    with folder as name:
        yield name


def write_table(
    path: Any, columns: Mapping[str, Any], beside: Mapping[str, Mapping[str, Any]] = {}
) -> list[str]:
    """Write columns of equal length as comma-separated values, numbers with all their digits; other tables
    beside it, as path_NAME.csv: all of them or none.

    Returns
    -------
    list of str
        The files.

    Raises
    ------
    TypeError, ValueError
        See `replaced`; if what stands there, in no output folder, is no table.
    """
    path = checked_path("table", "path", path)
    # in an output folder `claim` knows what is the program's, whatever a spreadsheet has made of it
    if os.path.isfile(path) and home_of(path) is None and not _holds_table(path):
        raise ValueError(f"table {path!r} would replace a file that holds no table; name another one")
    with replaced(path, "table") as temporary:
        files = [temporary, *(f"_{name}".join(os.path.splitext(temporary)) for name in beside)]
        for name, table in zip(files, (columns, *beside.values())):
            entries = [np.asarray(values).tolist() for values in table.values()]  # csv writes all digits
            with open(name, "w", newline="", encoding="utf-8") as file:
                writer = csv.writer(file)
                writer.writerow(table)
                writer.writerows(zip(*entries))
    folder = os.path.dirname(os.path.realpath(path) if os.path.islink(path) else path)
    return [os.path.join(folder, os.path.basename(name)) for name in files]


def _holds_table(path: str) -> bool:
    """Whether a file is empty, or its first two lines have as many values, two at least."""
    try:
        with open(path, newline="", encoding="utf-8") as file:
            widths = [len(row) for row in itertools.islice(csv.reader(file), 2)]
    except (OSError, UnicodeDecodeError, csv.Error):
        return False
    return not widths or min(widths) == max(widths) > 1


def as_json(value: Any, levels: int = 3, end: str = "\n") -> str:
    """JSON whose first levels of tables have a line for each entry, as a person reads it, and as fast as on
    one line; ValueError for nan and infinity.
    """
    if not levels or not isinstance(value, dict) or not value:
        return json.dumps(value, allow_nan=False)
    inner = f"{end} "
    entries = (f"{json.dumps(str(key))}: {as_json(item, levels - 1, inner)}" for key, item in value.items())
    return f"{{{inner}{f',{inner}'.join(entries)}{end}}}"

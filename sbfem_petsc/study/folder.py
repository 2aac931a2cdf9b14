"""The folder of a run: which case it holds; its files, each replaced as a whole:
quantities in HDF5, laid out as records are, and JSON.
"""

from __future__ import annotations

import contextlib
import json
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import h5py
import numpy as np

import sbfem_petsc as sb
from meshing.whole_file import read_whole, replaced

from ..output_folder import HeldFolder, make_folder, one_at_a_time
from ..ranks.parallel import alone, on_root
from ..record.about import About
from ..record.files import SCHEMA, written
from ..record.layout import bare, put, text, text_of
from ..writing import as_json, check_output_folder
from .case.case import Case

# Of analyses in the folder; of their results that stand in files of their own.
PARTS, RESULT = "analyses", "result"
WHAT = "results file"
_WAY = "name another folder with --output, or give --replace to"


@contextlib.contextmanager
def held_folder(
    path: str, case: Case, what: str, replace: bool, comm: Any, *, shared: bool = False
) -> Iterator[str]:
    """The folder of a run or a sweep while it is under way, made if it is missing. Collective; see
    `hold_folder`.
    """
    path = check_output_folder(path, comm)
    folder = on_root(comm, lambda: hold_folder(path, case, what, replace, shared=shared))
    try:
        yield path
    finally:
        if folder is not None:
            folder.close()
        if not alone(comm):
            comm.Barrier()  # nobody's folder goes while others read it


def hold_folder(
    path: str, case: Case, what: str, replace: bool = False, *, shared: bool = False
) -> HeldFolder:
    """Hold a folder, which says in a file what is done in it, so that an interrupted run goes on.

    Parameters
    ----------
    path : str
        Existing folder.
    case : Case
    what : {"run", "sweep"}
        What is done with the case.
    replace : bool
        Give up what another case or version left in the folder.
    shared : bool
        Other processes may be at work in it for the same case.

    Raises
    ------
    ValueError
        If the folder holds another case or anything that no run has made, or another process is at work in
        it.
    """
    with one_at_a_time(path):
        folder = HeldFolder(path, shared)
        try:
            _begin(folder, case, what, replace, shared)
            if shared:
                folder.share()
        except BaseException:
            folder.close()
            raise
    return folder


def _begin(folder: HeldFolder, case: Case, what: str, replace: bool, shared: bool) -> None:
    key, other = (case.key, "sweep") if what == "run" else (case.sweep_key, "run")
    mine = {"schema": SCHEMA, "version": sb.__version__, "case": key}
    if os.path.lexists(os.path.join(folder.path, f"{other}.json")) and not replace:
        raise ValueError(f"{folder.path!r} holds the results of a {other}; {_WAY} overwrite it")
    state = os.path.join(folder.path, f"{what}.json")
    left = folder.keeps_beside(state)  # before a look at the state, which others write first
    there = os.path.lexists(state) and not replace
    begun, same = folder.others or left, False
    if there and (begun or shared):
        try:
            _require_same(state, mine, what)
            same = True
        except ValueError:
            if begun:  # else nothing is lost
                raise
    if not same:
        # a kill may have left rows of another case without their state
        if there or not shared or (left and not folder.others):
            folder.clear()
        write_json(state, mine)
    make_folder(os.path.join(folder.path, PARTS if what == "run" else "rows"))


def _require_same(path: str, mine: dict[str, Any], what: str) -> None:
    """Raise ValueError unless a former process has left the same in a file."""
    try:
        former = dict(json.loads(read_whole(Path(path))))
    except (ValueError, TypeError, RecursionError):
        raise ValueError(f"{path!r} is not what a run has written; {_WAY} overwrite it") from None
    folder = os.path.dirname(path)
    if any(former.get(key) != mine[key] for key in ("version", "schema")):
        raise ValueError(
            f"{folder!r} has the schema {former.get('schema', 'before 6')}, of version "
            f"{former.get('version')}, and this program writes {SCHEMA}; {_WAY} compute it again"
        )
    if former != mine:
        raise ValueError(
            f"{folder!r} holds the {what} of another case, or of this one as another state of the program "
            f"has understood it; {_WAY} overwrite it"
        )


def part_of(path: str, name: str, ending: str = "h5") -> str:
    """File of an analysis in the folder of a run."""
    return os.path.join(path, PARTS, f"{name}.{ending}")


def write_json(path: str, value: Any) -> None:
    """Write JSON, whole or not at all."""
    with replaced(path, "file") as temporary, open(temporary, "w", encoding="utf-8") as file:
        file.write(f"{as_json(value)}\n")


@contextlib.contextmanager
def new_results(path: str, holds: str, case: Case | None = None) -> Iterator[h5py.File]:
    """A new file of results, "run", "analysis" or "sweep", laid out as those of records are; with the case it
    is of, if one is given.

    Raises
    ------
    ValueError
        See `record.files.written`.
    """
    with written(path, WHAT) as file:
        file.attrs["holds"] = text_of(holds)
        if case is not None:
            _write_case(file.create_group("case"), case)
        yield file


def _write_case(group: h5py.Group, case: Case) -> None:
    """The case's text and the files it names, from which it can be run again."""
    group.attrs["file"] = text_of(os.path.basename(case.file))
    _put_bytes(group, "text", case.text.encode(), "the case file, in UTF-8")
    files = group.create_group("files")
    for k, (name, contents) in enumerate(case.named_files().items()):
        _put_bytes(files, f"{k:03d}", contents, "a file that it names").attrs["name"] = text_of(name)


def _put_bytes(group: h5py.Group, name: str, contents: bytes, words: str) -> h5py.Dataset:
    return put(group, name, np.frombuffer(contents, np.uint8), About(text=words), "1", (f"{name}_byte",))


def case_in(file: h5py.File) -> tuple[str, str, dict[str, bytes]]:
    """Text of the case that results are of, name of its file, and contents of those that it names."""
    case = file["case"]
    named = (entry for entry in case["files"].values() if not bare(entry))
    files = {text(entry.attrs["name"]): entry[()].tobytes() for entry in named}
    return case["text"][()].tobytes().decode(), text(case.attrs["file"]), files

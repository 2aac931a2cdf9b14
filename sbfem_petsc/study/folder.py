"""The folder of a run: which case it holds, which analyses are finished; its files, each replaced as a whole:
quantities in HDF5, laid out as records are, and JSON.
"""

from __future__ import annotations

import contextlib
import json
import os
import zlib
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
from ..writing import as_json
from .case.case import Case

# Of analyses in the folder; of their results that stand in files of their own.
PARTS, RESULT = "analyses", "result"
WHAT = "results file"


class Folder(HeldFolder):
    """State of a run, kept in a file so that an interrupted run goes on. On rank 0 alone.

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

    def __init__(self, path: str, case: Case, what: str, replace: bool = False, *, shared: bool = False):
        self.state_file = os.path.join(path, f"{what}.json")
        self.parts = os.path.join(path, PARTS if what == "run" else "rows")
        with one_at_a_time(path):
            super().__init__(path, shared)
            try:
                self.state = self._begin(case, what, replace, shared)
                if shared:
                    self.share()
            except BaseException:
                self.close()
                raise

    def _begin(self, case: Case, what: str, replace: bool, shared: bool) -> dict[str, Any]:
        mine = {
            "schema": SCHEMA,
            "version": sb.__version__,
            "what": what,
            "case": case.key if what == "run" else case.sweep_key,
            "given": case.given,
        }
        other = "sweep" if what == "run" else "run"
        way = "name another folder with --output, or give --replace to"
        if os.path.lexists(os.path.join(self.path, f"{other}.json")) and not replace:
            raise ValueError(f"{self.path!r} holds the results of a {other}; {way} overwrite it")
        there = os.path.lexists(self.state_file) and not replace
        begun = self.others or self.keeps_beside(self.state_file)
        if there and (begun or shared):
            try:
                former = self._former(mine, way)
                make_folder(self.parts)
                return former
            except ValueError:
                if begun:  # else nothing is lost
                    raise
        if there or not shared:
            self.clear()
        make_folder(self.parts)
        mine["done"] = {}
        self._keep(mine)
        return mine

    def _keep(self, state: dict[str, Any]) -> None:
        write_json(self.state_file, {**state, "checksum": checksum(state)})

    def _former(self, mine: dict[str, Any], way: str) -> dict[str, Any]:
        """The state that a former process has left; ValueError unless it was of the same case."""
        damaged = ValueError(f"{self.state_file!r} is not what a run has written; {way} overwrite it")
        try:
            former = json.loads(read_whole(Path(self.state_file)))
        except (ValueError, RecursionError):
            raise damaged from None
        if not isinstance(former, dict):
            raise damaged
        if any(former.get(key) != mine[key] for key in ("version", "schema")):
            raise ValueError(
                f"{self.path!r} has the schema {former.get('schema', 'before 6')}, of version "
                f"{former.get('version')}, and this program writes {SCHEMA}; {way} compute it again"
            )
        if former.pop("checksum", None) != checksum(former):
            raise damaged
        if former["case"] != mine["case"]:
            what = mine["what"]
            if former["given"] == mine["given"]:
                raise ValueError(
                    f"{self.path!r} holds the {what} of a case as an earlier state of version "
                    f"{former['version']} understood it; {way} compute it again"
                )
            raise ValueError(f"{self.path!r} holds the {what} of another case; {way} overwrite it")
        return former

    def finished(self, name: str) -> bool:
        """Whether an analysis is done and its file still there."""
        return name in self.state["done"] and os.path.isfile(part_of(self.path, name))

    def finish(self, name: str, seconds: float) -> None:
        """Note, on the disk, that an analysis is done, and how long it took."""
        self.state["done"][name] = seconds
        self._keep(self.state)


def part_of(path: str, name: str, ending: str = "h5") -> str:
    """File of an analysis in the folder of a run."""
    return os.path.join(path, PARTS, f"{name}.{ending}")


def checksum(state: dict[str, Any]) -> int:
    """Of a state, by which changed bytes of its file are told."""
    return zlib.crc32(json.dumps(state, sort_keys=True).encode())


@contextlib.contextmanager
def held_folder(
    path: str, case: Case, what: str, replace: bool, comm: Any, *, shared: bool = False
) -> Iterator[Folder | None]:
    """The folder of a run or a sweep while it is under way, on rank 0. Collective."""
    folder = on_root(comm, lambda: Folder(path, case, what, replace, shared=shared))
    try:
        yield folder
    finally:
        if folder is not None:
            folder.close()
        if not alone(comm):
            comm.Barrier()  # nobody's folder goes while others read it


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

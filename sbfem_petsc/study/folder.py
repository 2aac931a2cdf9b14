"""The folder of a run: which case it holds, and which analyses are finished."""

from __future__ import annotations

import contextlib
import json
import os
import zlib
from collections.abc import Iterator
from typing import Any

import sbfem_petsc as sb

from ..output_folder import HeldFolder, make_folder, one_at_a_time
from ..ranks.parallel import alone, collective
from ..record.files import SCHEMA
from .case.case import Case
from .storage import read_json, write_json

# Of analyses in the folder; of their results that stand in files of their own.
PARTS, RESULT = "analyses", "result"


class Folder:
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
        self.path = path
        self.state_file = os.path.join(path, f"{what}.json")
        self.parts = os.path.join(path, PARTS if what == "run" else "rows")
        with one_at_a_time(path):
            self.held = HeldFolder(path, shared)
            try:
                self.state = self._begin(case, what, replace, shared)
                if shared:
                    self.held.share()
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
        begun = self.held.others or self.held.keeps_beside(self.state_file)
        if there and (begun or shared):
            try:
                former = self._former(mine, way)
                make_folder(self.parts)
                return former
            except ValueError:
                if begun:  # else nothing is lost
                    raise
        if there or not shared:
            self.held.clear()
        make_folder(self.parts)
        mine["done"] = {}
        self._keep(mine)
        return mine

    def _keep(self, state: dict[str, Any]) -> None:
        write_json(self.state_file, {**state, "checksum": checksum(state)})

    def _former(self, mine: dict[str, Any], way: str) -> dict[str, Any]:
        """The state that a former process has left; ValueError unless it was of the same case."""
        former = read_json(self.state_file)
        damaged = ValueError(f"{self.state_file!r} is not what a run has written; {way} overwrite it")
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
        return name in self.state["done"] and os.path.isfile(self.part(name))

    def part(self, name: str, kind: str = "h5") -> str:
        """File of an analysis."""
        return os.path.join(self.parts, f"{name}.{kind}")

    def finish(self, name: str, seconds: float) -> None:
        """Note, on the disk, that an analysis is done, and how long it took."""
        self.state["done"][name] = seconds
        self._keep(self.state)

    def close(self) -> None:
        """Leave the folder to others."""
        self.held.close()


def checksum(state: dict[str, Any]) -> int:
    """Of a state, by which changed bytes of its file are told."""
    return zlib.crc32(json.dumps(state, sort_keys=True).encode())


@contextlib.contextmanager
def held_folder(
    path: str, case: Case, what: str, replace: bool, comm: Any, *, shared: bool = False
) -> Iterator[Folder | None]:
    """The folder of a run or a sweep while it is under way, on rank 0. Collective."""
    folder: Folder | None = None
    with collective(comm):
        if comm.rank == 0:
            folder = Folder(path, case, what, replace, shared=shared)
    try:
        yield folder
    finally:
        if folder is not None:
            folder.close()
        if not alone(comm):
            comm.Barrier()  # nobody's folder goes while others read it

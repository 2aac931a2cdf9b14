"""Files of runs under way: one writer each, what was run said in the head of a journal, gone on with."""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import Any, TypeVar

import numpy as np

from ...petsc import MPI
from ...ranks.parallel import collective, on_root
from ...record.files import from_image
from ...record.journal import Journal, Kept
from ...reduction.comparison import adopted, close, difference, in_rows
from ...reduction.reduced_model import ReducedModel

Self = TypeVar("Self", bound="RunFile")
# What tells of the structure and its loads, and of the state a run began in: users have other names for them.
OF_MODEL = {"points", "tip_names", "supports", "fingerprint"}
OF_START = {"initial_norms"}
# Seconds between two updates of the result beside a journal's frames.
PAUSE = 2.0


class RunFile:
    """The file of a run; a context manager. Rank 0 writes; an error of it is raised on all ranks.

    Parameters
    ----------
    comm : Comm
    path : str or None
        None: nothing is kept, nor gone on with.
    kept : str
        What is kept, one of `study.reading.KEPT`.
    resume : bool
        Go on with the file if it exists; False: replace it.

    Raises
    ------
    TypeError, ValueError
        If the file is of another kind, is damaged, is being written by another run or cannot be written.
    """

    def __init__(self, comm: MPI.Comm, path: Any, kept: str, *, resume: bool = False):
        self.comm, self.kept, self.what = comm, kept, f"{kept} file"
        self.path = os.fspath(path) if isinstance(path, os.PathLike) else path
        self._journal: Journal | None = None
        try:
            with collective(comm):
                if comm.rank == 0 and path is not None:
                    self._journal = Journal(path, self.what, resume=resume)
                    former = self._former
                    if former is not None and former.head.get("kept") != kept:
                        raise self.refused("is that of another kind of run")
                    if former is not None:
                        self._look(former)
        except BaseException:
            self.close()
            raise

    def __enter__(self: Self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Give the file up to others."""
        if self._journal is not None:
            self._journal.close()
            self._journal = None

    def refused(self, why: str, remedy: str = "") -> ValueError:
        """Of a file that this run cannot go on with, what helps beside another one."""
        return ValueError(f"{self.what} {self.path!r} {why}; {remedy and f'{remedy}, or '}name another file")

    def _look(self, former: Kept) -> None:
        """Raise ValueError for a former run that cannot be gone on with; on rank 0."""

    @property
    def _former(self) -> Kept | None:
        """What a former run has left; on rank 0."""
        return None if self._journal is None else self._journal.former

    def adopt(self, reduced: ReducedModel) -> ReducedModel:
        """The reduced model to go on with: of a run that is resumed the file's own, in whose modes its states
        are, so that all is the same to the last bit; else the one given, as it would come from the file.
        Collective.

        Raises
        ------
        ValueError
            If the file was written for another model or other loads.
        """
        if self.path is None:
            return reduced
        stored = self.comm.bcast(on_root(self.comm, lambda: self._stored(reduced)))
        return in_rows(reduced if stored is None else adopted(stored, reduced))

    def modes(self) -> int | None:
        """How many a run that is resumed has; None of a new one. Collective."""
        found = on_root(self.comm, lambda: getattr(self._former_model(), "natural", None))
        return self.comm.bcast(found)

    def _former_model(self) -> ReducedModel | None:
        """That of the former run, if there is one; on rank 0."""
        head = {} if self._former is None else self._former.head
        return from_image(head["model"]) if "model" in head else None

    def _stored(self, reduced: ReducedModel) -> ReducedModel | None:
        if self._former is None:
            return None
        stored = self._former_model()
        if stored is None:
            raise self.refused("is that of another kind of run")
        if other := difference(stored, reduced):
            raise self.refused(f"was written for another model ({other})", "resume with that model")
        return stored

    def require_same(self, given: Mapping[str, Any]) -> None:
        """Raise ValueError unless the former run was begun under the same conditions; on rank 0."""
        stored = {} if self._former is None else self._former.head
        for name, value in given.items():
            if name in stored and close(stored[name], value):
                continue
            if name in OF_MODEL | OF_START:
                told = "model or other loads" if name in OF_MODEL else "initial displacement or velocity"
                raise self.refused(f"was written for another {told}", "give the same")
            if np.ndim(value):
                raise self.refused(f"was written for other {name}", f"resume with the same {name}")
            written = f"was written with {name} = {stored.get(name)}, not {value}"
            raise self.refused(written, "resume with the same value")

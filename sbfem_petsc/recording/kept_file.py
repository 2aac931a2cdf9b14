"""Files that are kept up to date while a run goes on: one writer each, written whole, gone on with."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Mapping
from typing import Any, TypeVar

import numpy as np

from ..errors import SolveError
from ..parallel import collective
from ..petsc import MPI
from ..reduction.comparison import close, difference
from ..reduction.reduced_model import ReducedModel
from ..writing import destination
from .hdf5 import opened
from .lock import WriterLock

Self = TypeVar("Self", bound="KeptFile")
# Seconds between two updates of a file.
PAUSE = 2.0


class KeptFile:
    """A file under way; a context manager. Rank 0 writes; an error of it is raised on all ranks.

    Parameters
    ----------
    comm : Comm
    path : str
    what : str
        Kind of file, for messages.
    form, version
        Of its format.
    resume : bool
        Continue the file if it exists; False: replace it.

    Attributes
    ----------
    continued : bool
        Whether there is a file to go on with; on rank 0.

    Raises
    ------
    TypeError, ValueError
        If the file is of another kind, is damaged, is being written by another run or cannot be written.
    """

    def __init__(self, comm: MPI.Comm, path: Any, what: str, form: str, version: int, *, resume: bool):
        self.comm, self.what, self.forms = comm, what, {form: version}
        self._lock, self._written, self.continued = None, -np.inf, False
        try:
            with collective(comm):
                self.path = destination(path, what)
                if comm.rank == 0:
                    self._lock = WriterLock(self.path, what)
                    if resume and os.path.exists(self.path):
                        with opened(self.path, what, self.forms):
                            self.continued = True
        except BaseException:
            self.close()
            raise

    def __enter__(self: Self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Give the file up to others."""
        if self._lock is not None:
            self._lock.release()
            self._lock = None

    def require_same(
        self,
        reduced: tuple[ReducedModel, ReducedModel] | None,
        stored: Mapping[str, Any],
        given: Mapping[str, Any],
    ) -> None:
        """Raise ValueError unless the file was written for the same model and settings: the stored and the
        given one of each.
        """
        other = "" if reduced is None else difference(*reduced)
        if other:
            raise ValueError(
                f"{self.what} {self.path!r} was written for another model ({other}); resume with that model, "
                "or name another file"
            )
        for key, value in given.items():
            if close(stored[key], value):
                continue
            if np.ndim(value):
                raise ValueError(
                    f"{self.what} {self.path!r} was written for other {key}; resume with the same {key}, or "
                    "name another file"
                )
            raise ValueError(
                f"{self.what} {self.path!r} was written with {key} = {stored[key]}, not {value}; "
                "resume with the same value, or name another file"
            )

    def due(self, last: bool) -> bool:
        """Whether it is time to write, the same on all ranks. Collective."""
        return bool(self.comm.bcast(last or time.monotonic() - self._written > PAUSE))

    def save(self, write: Callable[[], None], last: bool) -> None:
        """Write, at most every two seconds but for the last time. Collective."""
        with collective(self.comm):
            if self.comm.rank == 0 and (last or time.monotonic() - self._written > PAUSE):
                try:
                    write()
                except ValueError as error:
                    raise SolveError(
                        f"{error}; what the file held before stays readable, and resume=True continues from "
                        "there"
                    ) from None
                self._written = time.monotonic()

"""The file of lines that are followed by continuation: their points beside the result made of them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, TypeVar

import h5py
import numpy as np

from ..parallel import on_root
from ..petsc import MPI
from ..recording.hdf5 import new_hdf5, opened, put
from ..recording.kept_file import KeptFile
from ..recording.reduced_models import read_reduced_model, write_reduced_model
from ..recording.sound import number, numbers, text, truth
from ..reduction.comparison import adopted, in_rows
from ..reduction.reduced_model import ReducedModel
from .follow import Line
from .problem import Problem

System = TypeVar("System", ReducedModel, None)
WHAT, FORM, VERSION = "result file", "sbfem-petsc result", 2


class LineFile(KeptFile):
    """The file of a result under way, whose lines a later run can go on with; a context manager.

    Parameters
    ----------
    comm : Comm
    path : str
    write : callable
        Writes a result into an open file.
    resume : bool
        Continue the file if it exists; False: replace it.

    Raises
    ------
    TypeError, ValueError
        See `KeptFile`.
    """

    def __init__(
        self, comm: MPI.Comm, path: Any, write: Callable[[h5py.File, Any], None], *, resume: bool = False
    ):
        self._write, self._conditions = write, dict[str, Any]()
        self._reduced: ReducedModel | None = None
        self._begin, self._former = np.zeros(0), list[dict[str, Any]]()
        super().__init__(comm, path, WHAT, FORM, VERSION, resume=resume)

    def begin(
        self, reduced: System, conditions: Mapping[str, Any], start: np.ndarray
    ) -> tuple[System, np.ndarray]:
        """Note what is followed, and read the lines of a former run under the same conditions. Collective.

        Parameters
        ----------
        reduced : ReducedModel or None
            None: the conditions tell all there is to tell of the system.
        conditions : dict
            Texts, numbers and arrays by their names, the same for a run that is gone on with.
        start : (n,) array
            What the lines begin with, to rounding the same.

        Returns
        -------
        ReducedModel or None, (n,) array
            To go on with: the file's own model, whose modes its states are in, and start.

        Raises
        ------
        ValueError
            If the file was written for another model or under other conditions.
        """
        found = on_root(self.comm, lambda: self._read(reduced, conditions) if self.continued else None)
        found = self.comm.bcast(found)
        self._conditions, self._begin = dict(conditions), np.array(start, dtype=float)
        known: Any = reduced
        if found is not None:
            stored, self._begin, self._former = found
            known = None if reduced is None else adopted(stored, reduced)
        self._reduced = known = None if known is None else in_rows(known)
        return known, self._begin

    def _read(self, reduced: ReducedModel | None, conditions: Mapping[str, Any]):
        with opened(self.path, WHAT, self.forms) as file:
            if "continuation" not in file:
                raise ValueError(f"{WHAT} {self.path!r} is no file of a run; name another file")
            group = file["continuation"]
            known = {**group.attrs, **{name: item[()] for name, item in group["conditions"].items()}}
            if set(known) != set(conditions) or (reduced is None) == ("reduced_model" in group):
                raise ValueError(f"{WHAT} {self.path!r} is of another kind of run; name another file")
            stored = None if reduced is None else read_reduced_model(group["reduced_model"])
            both = None if stored is None or reduced is None else (stored, reduced)
            self.require_same(both, known, conditions)
            lines = [_read_line(group["lines"][name]) for name in sorted(group["lines"])]
            return stored, numbers(group, "start", None), lines

    def lines(self, problem: Problem) -> list[Line]:
        """The lines of the run that is gone on with, as solutions of a problem."""
        return [
            Line(
                [problem.recalled(*point) for point in zip(line["unknowns"], line["value"], line["memory"])],
                line["length"],
                line["sign"],
                line["reason"],
                line["complete"],
            )
            for line in self._former
        ]

    def update(self, result: Callable[[], Any], lines: Sequence[Line], last: bool = False) -> None:
        """Write the result as it is and the lines, at most every two seconds but for the last time.
        Collective.
        """
        self.save(lambda: self._put(result(), lines), last)

    def _put(self, result: Any, lines: Sequence[Line]) -> None:
        with new_hdf5(self.path, WHAT, FORM, VERSION) as file:
            self._write(file, result)
            group = file.create_group("continuation")
            arrays = group.create_group("conditions")
            for name, value in self._conditions.items():
                if np.ndim(value):
                    arrays[name] = value
                else:
                    group.attrs[name] = value
            put(group, "start", self._begin, "SI", "what the lines begin with")
            if self._reduced is not None:
                write_reduced_model(group.create_group("reduced_model"), self._reduced)
            for k, line in enumerate(lines):
                _write_line(group.create_group(f"lines/{k:03d}"), line)


def _write_line(group: h5py.Group, line: Line) -> None:
    group.attrs.update(
        {
            "length": line.length,
            "sign": np.nan if line.sign is None else line.sign,
            "reason": line.reason,
            "complete": line.complete,
        }
    )
    memories = [point.problem.memory(point) for point in line.points]
    put(group, "value", line.values, "SI", "what the range is over")
    for name, parts in (("unknowns", [point.u for point in line.points]), ("memory", memories)):
        put(group, name, np.concatenate(parts), "SI", f"{name} of all points, one behind the other")
        put(group, f"{name}_sizes", [len(part) for part in parts], "1", "numbers of each point")


def _read_line(group: h5py.Group) -> dict[str, Any]:
    value = numbers(group, "value", None)
    found = {"value": value.tolist(), "length": number(group, "length", least=0.0)}
    for name in ("unknowns", "memory"):
        sizes = numbers(group, f"{name}_sizes", len(value), kinds="iu", least=0)
        found[name] = np.split(numbers(group, name, int(sizes.sum())), np.cumsum(sizes)[:-1])
    sign = number(group, "sign", finite=False)
    return {
        **found,
        "sign": None if np.isnan(sign) else sign,
        "reason": text(group, "reason"),
        "complete": truth(group, "complete"),
    }

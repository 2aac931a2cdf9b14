"""A case for many values of its keys, shared out over groups of ranks; what is finished is not repeated."""

from __future__ import annotations

import contextlib
import functools
import os
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from ..checks import flag, instance, integer, path, shown
from ..errors import OutOfMemory, SolveError, SolverFailure, UnknownName
from ..progress import Watch, watch_for
from ..ranks.capacity import PlannedFile, require_disk
from ..ranks.parallel import agreed, checked_communicator, collective, on_root
from ..writing import spare_folder
from . import rows as row_files
from .case.case import Case, read_case
from .case.problems import CaseError
from .case.sweep import SweepTable, structural
from .costs import ROW, Size
from .folder import held_folder
from .kinds.kind import Values, Wanted
from .rows import Row
from .shares import Shares
from .structure import Structure
from .sweep_file import FILE, Sweep, together

# Points that a mesh names beside those of the case.
POINTS = 5
# Keys of a geometry that a structure without damage has not.
FAULTS = ("notches", "cracks")


@agreed()
def sweep(
    case: Case | str | os.PathLike[str],
    parameters: Mapping[str, Any] | None = None,
    *,
    output: str | os.PathLike[str] | None = None,
    method: str = "grid",
    samples: int | None = None,
    seed: int = 0,
    analyses: Sequence[str] | None = None,
    healthy: Mapping[str, Any] | None = None,
    noise: Mapping[str, float] | None = None,
    ranks_per_row: int = 1,
    histories: bool = False,
    rows: tuple[int, int] | None = None,
    comm: Any = None,
    replace: bool = False,
    watch: Watch | None = None,
) -> Sweep:
    """Run the analyses of a case for many values of its keys. Collective.

    Parameters
    ----------
    case : Case or path-like
        Its [sweep] table is used unless `parameters` are given.
    parameters : dict, optional
        Dotted paths into the case ("geometry.notches[0].depth") to lists of values, or to
        {"start": , "stop": , "count": , "scale": "linear" or "logarithmic"}.
    output : path-like, optional
        Folder of sweep.h5 and sweep.csv; an interrupted sweep goes on there. Default: nothing is kept.
    method : {"grid", "list", "latin_hypercube"}
        Every combination; the n-th values together; random samples that fill the ranges.
    samples, seed : int
        Number of Latin hypercube samples, and their seed.
    analyses : sequence of str, optional
        Default: all of the case.
    healthy : dict, optional
        Values of the structure that frequency shifts are relative to. Default: no notches, no cracks.
    noise : dict, optional
        {"snr": dB, "seed": int}: white noise on the motion that indicators are read from.
    ranks_per_row : int
        Ranks that compute a row together.
    histories : bool
        Keep the motion of the points too.
    rows : (int, int), optional
        Number of the first row, from 0, and that behind the last: these are computed alone, into an
        `output` that other processes may compute other rows into. A last call without it finishes what is
        missing and writes the table.
    comm : mpi4py communicator, optional
        Default: MPI.COMM_WORLD.
    replace : bool
        Give up what another sweep has left in the folder.
    watch : Watch, optional
        Is told what is under way. Default: a bar on a terminal, lines elsewhere.

    Returns
    -------
    Sweep
        On all ranks; of `rows` those alone.

    Raises
    ------
    ValueError
        For input that makes no sense, on all ranks. A row that fails keeps its reason.
    """
    comm = checked_communicator("sweep", comm)
    with collective(comm):
        keys: dict[str, Any] = {"method": method, "samples": samples, "seed": seed, "analyses": analyses}
        keys |= {"healthy": healthy, "noise": noise, "ranks_per_row": ranks_per_row, "histories": histories}
        if output is not None:
            path("sweep", "output", output)
        if watch is not None:
            instance("sweep", "watch", watch, Watch, "a Watch")
        checked = _swept(case, parameters, keys)
        table = checked.tables.sweep
        part = _part(rows, len(table.rows()), output, flag("sweep", "replace", replace))
        if comm.size % table.ranks_per_row:
            raise checked.problem(
                ("sweep", "ranks_per_row"),
                f"= {table.ranks_per_row} does not divide the {comm.size} ranks; start a multiple of it",
            )
    with spare_folder() as spare, watch or watch_for(comm) as told:
        folder = comm.bcast(spare) if output is None else os.fspath(output)
        with held_folder(folder, checked, "sweep", replace, comm, shared=part is not None) as place:
            return _Sweeping(checked, place, comm, told, part).all()


def _swept(case: Any, parameters: Any, keys: dict[str, Any]) -> Any:
    """The case with its sweep, of the call's own keys if there are parameters."""
    if not isinstance(case, Case):
        path("sweep", "case", case)
    table = None
    if parameters is not None:
        table = SweepTable.checked("sweep", {"parameters": parameters, **keys}).model_dump(exclude_none=True)
    checked = case if isinstance(case, Case) else read_case(case, table)
    if table is not None:
        return checked.with_data({**case.data, "sweep": table}) if checked is case else checked
    given = [name for name, value in keys.items() if value != SweepTable.model_fields[name].default]
    if given:
        raise ValueError(
            f"sweep: {given[0]} = {shown(keys[given[0]])} is of no use without parameters, for the "
            "case's own [sweep] table is followed; write it there, or give parameters"
        )
    if checked.tables.sweep is None:
        raise checked.problem(("sweep",), "is missing; add [sweep.parameters] with the keys that vary")
    return checked


def _part(rows: Any, count: int, output: Any, replace: bool) -> range | None:
    """The rows of a call that computes some of them."""
    if rows is None:
        return None
    if not isinstance(rows, (list, tuple)) or len(rows) != 2:
        what = "two numbers: of the first row, and behind the last"
        raise TypeError(f"sweep: rows = {shown(rows)} must be {what}")
    first, behind = (integer("sweep", f"rows[{k}]", value, least=0) for k, value in enumerate(rows))
    if not first < min(behind, count):
        raise ValueError(
            f"sweep: rows = {shown(rows)} holds none of the {count:,d} rows, numbered from 0; give a first "
            "row and a larger number behind the last"
        )
    if output is None:
        raise ValueError("sweep: rows needs the folder that others compute into too; give output")
    if replace:
        raise ValueError(
            "sweep: replace = True is not for some of the rows, beside which others may be computed; "
            "call it once without rows"
        )
    return range(first, min(behind, count))


class _Sweeping:
    """A sweep under way on this rank.

    Attributes
    ----------
    group : Comm
        Ranks that compute a row together with this one.
    leads : bool
        Whether this one writes what they have computed.
    """

    def __init__(self, case: Case, path: str, comm: Any, watch: Watch, part: range | None):
        assert case.tables.sweep is not None
        self.case, self.comm, self.watch, self.table = case, comm, watch, case.tables.sweep
        self.folder, self.path = os.path.join(path, "rows"), path
        self.inputs = self.table.rows()
        self.part, self.numbers = part, part or range(len(self.inputs))
        self.names = self.table.analyses or list(case.tables.analyses)
        group, place = divmod(comm.rank, self.table.ranks_per_row)
        self.leads = place == 0
        self.named = f"rows {self.numbers.start} to {self.numbers.stop - 1}"
        begin = "" if part is None else f"{part.start:07d}-{part.stop:07d}-"
        self.file = os.path.join(self.folder, f"{begin}{group:05d}.rows")
        self.healthy: dict[str, Any] = {}

    def all(self) -> Sweep:
        """Compute what is missing and put the table together."""
        with contextlib.ExitStack() as stack:
            with collective(self.comm):
                if self.leads:
                    stack.enter_context(row_files.held(self.file, self.named))
            self._compute()
        result: Sweep = self.comm.bcast(on_root(self.comm, self._together))
        return result

    def _together(self) -> Sweep:
        """The table, which is written if it is that of all rows."""
        found = row_files.read(self.folder)
        rows = [found.get(k, Row(k, "not computed", np.nan)) for k in self.numbers]
        table = together(self.case, [self.inputs[k] for k in self.numbers], rows)
        if self.part is None:
            table.write(self.case, self.path)
        return table

    def _compute(self) -> None:
        """Rows that are not finished, those of one structure together."""
        comm, total = self.comm, len(self.numbers)
        rows = functools.partial(row_files.every, self.folder)
        done = comm.bcast(on_root(comm, lambda: {row.number for row in rows() if not row.reason}))
        missing = [k for k in self.numbers if k not in done]
        self._require_disk(len(missing))
        part = "" if self.part is None else f" ({self.named})"
        self.watch.stage(f"{total} rows{part}, {total - len(missing)} of them finished before")
        alike: dict[tuple, list[int]] = {}
        for k in missing:
            alike.setdefault(structural(self.inputs[k]), []).append(k)
        structures = list(alike.values())
        with Shares(comm, self.table.ranks_per_row, [*map(len, structures)]) as shares:
            self.group = shares.group
            while (place := shares.structure()) is not None:
                self._structure(structures[place], shares, place, total)

    def _require_disk(self, rows: int) -> None:
        """Refuse rows that would not fit on the disk: of each its figures, and motions where they are kept.
        Collective.
        """
        tables, each = self.case.tables, ROW
        if self.table.histories:
            size = Size(self.case, 0, 0, len((tables.body or tables).points) + POINTS)
            each += sum(tables.analyses[name].cost(size).disk for name in self.names)
        file = PlannedFile(os.path.join(self.path, FILE), rows * each)
        fewer = "give fewer, leave histories out, or name another folder"

        def remedy(share: float) -> str:
            return f"about {int(share * rows):,d} rows fit; {fewer}"

        require_disk("sweep", self.comm, file, what=f"{rows:,d} rows", remedy=remedy)

    def _structure(self, numbers: list[int], shares: Shares, place: int, total: int) -> None:
        """Rows of one structure, as long as no other group has taken them."""
        results: dict[str, Any] = {}
        began = time.monotonic()
        with contextlib.ExitStack() as stack:
            structure, fault = self._tried(lambda: Structure(self._case_of(numbers), self.group))
            if structure is not None:
                stack.callback(structure.close)
            while (taken := shares.row(place)) is not None:
                number = numbers[taken]
                work = functools.partial(self._row, number, structure or fault, results)
                values, reason = self._tried(work)
                if self.leads:
                    row_files.append(self.file, Row(number, reason, time.monotonic() - began, values or {}))
                if self.comm.rank == 0:
                    self.watch.fraction(1.0 - shares.left().sum() / total)
                began = time.monotonic()

    def _case_of(self, numbers: list[int]) -> Case:
        """Of the first row whose values make sense: all have one structure."""
        for number in numbers[:-1]:
            with contextlib.suppress(CaseError):
                return self.case.with_values(self.inputs[number])
        return self.case.with_values(self.inputs[numbers[-1]])

    def _tried(self, work: Callable[[], Any]) -> tuple[Any, str]:
        """What a work gives, or why it fails: a row that does must not end the others."""
        try:
            return work(), ""
        except Exception as error:
            if isinstance(error, (OutOfMemory, MemoryError)) and self.group.size > 1:
                raise  # ranks may wait for this one
            expected = isinstance(error, (ValueError, UnknownName, SolveError, SolverFailure))
            return None, str(error) if expected else f"{type(error).__name__}: {error}"

    def _row(self, number: int, structure: Structure | str, alike: dict[str, Any]) -> Values:
        """Values of a row on a structure, or of none for a reason."""
        case = self.case.with_values(self.inputs[number])
        if isinstance(structure, str):
            raise ValueError(structure)
        case.check_tones(self.names)
        structure.check(case, self.names)
        points = structure.points(case)
        values: Values = {}
        for name in self.names:
            kind = case.tables.analyses[name]
            key = kind.model_dump_json() if not kind.loads_in else ""
            result = alike.get(key) or structure.solve(case, name)
            if key:
                alike[key] = result
            healthy = functools.partial(self._healthy, case, name)
            wanted = Wanted(points, self._noisy(number, name), self.table.histories, healthy)
            found = kind.row(result, wanted)
            values.update({f"{name}/{quantity}": entry for quantity, entry in found.items()})
            structure.release(result)
        return values

    def _noisy(self, number: int, name: str) -> Callable[[np.ndarray], np.ndarray] | None:
        """Adds white noise of a signal-to-noise ratio (dB, of powers about the mean), that of a row."""
        noise = self.table.noise
        if noise is None:
            return None
        place = list(self.case.tables.analyses).index(name)
        random, share = np.random.default_rng([noise.seed, number, place]), 10.0 ** (-noise.snr / 20.0)
        return lambda u: u + share * float(np.std(u)) * random.standard_normal(u.shape)

    def _healthy(self, case: Case, name: str) -> Any:
        """Result of the healthy structure beside a row; None where there is none. Collective."""
        changes = self.table.healthy
        if changes is None:
            changes = {f"geometry.{fault}": [] for fault in FAULTS if hasattr(case.tables.geometry, fault)}
            if not changes:
                return None
            changes["model.contact_laws"] = {}
        # what else the case says may name points and edges of a crack
        kind, loads = case.tables.analyses[name], case.data.get("loads", {})
        alone = {"loads": {load: loads[load] for load in kind.loads()}, "output": {}}
        reference = case.with_values({**changes, **alone, "analyses": {name: case.data["analyses"][name]}})
        key = f"{reference.structure_key} {kind.model_dump_json()}"
        if key not in self.healthy:
            with contextlib.closing(Structure(reference, self.group)) as structure:
                self.healthy[key] = structure.solve(reference, name)
                structure.release(self.healthy[key])
        return self.healthy[key]

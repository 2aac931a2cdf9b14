"""All analyses of a case into a folder: interrupted runs go on, finished analyses are not repeated."""

from __future__ import annotations

import contextlib
import json
import os
import time
from dataclasses import dataclass
from typing import Any

import h5py

import sbfem_petsc as sb

from ..errors import OutOfMemory, SolveError, SolverFailure
from ..output_folder import make_folder
from ..progress import Watch
from ..ranks.capacity import PlannedFile, require_disk, require_memory
from ..ranks.parallel import agreed, checked_communicator, collective, on_root, ranks_of
from ..record.files import opened
from ..record.found import Found
from ..record.layout import text, text_of, within
from . import pictures
from .case.case import Case, read_case
from .case.objects import located
from .case.problems import CaseError
from .folder import RESULT, WHAT, case_in, held_folder, new_results, part_of, write_json
from .structure import Structure

RESULTS, SUMMARY, PICTURES, TABLES = "results.h5", "summary.json", "pictures", "tables"
# Keys that memory grows or falls with.
SIZES = ("count", "times", "starts", "samples", "steps", "step", "duration", "decimation", "points", "modes")


@agreed()
def run_case(
    case: Case | str | os.PathLike[str],
    output: str | os.PathLike[str],
    *,
    comm: Any = None,
    replace: bool = False,
    watch: Watch | None = None,
) -> dict[str, Any]:
    """Run the analyses of a case that are not finished in a folder. Collective.

    Parameters
    ----------
    case : Case or path-like
    output : path-like
        Folder; it receives results.h5, summary.json, pictures/, tables/ and files of the single analyses.
    comm : mpi4py communicator, optional
        Default: MPI.COMM_WORLD.
    replace : bool
        Give up what another case has left in the folder.
    watch : Watch, optional
        Is told what is under way.

    Returns
    -------
    dict
        Contents of summary.json. An analysis that fails does not keep the others from running.

    Raises
    ------
    ValueError
        For a case that makes no sense, a folder that cannot be written or holds another case; on all ranks.
    """
    comm = checked_communicator("run_case", comm)
    watch = Watch() if watch is None else watch
    with collective(comm):
        checked = case if isinstance(case, Case) else read_case(case)
        if checked.tables.sweep is not None:
            checked.with_values({})  # of its own values, which rows may mend
        checked.check_tones(checked.tables.analyses)
    with held_folder(os.fspath(output), checked, "run", replace, comm) as path:
        with _Run(checked, path, comm, watch) as run:
            return run.all()


class _Run(contextlib.ExitStack):
    def __init__(self, case: Case, path: str, comm: Any, watch: Watch):
        super().__init__()
        self.case, self.path, self.comm, self.watch = case, path, comm, watch
        self.structure: Structure | None = None
        self.model: dict[str, Any] = {}
        self.failed: dict[str, tuple[str, bool]] = {}  # why, and whether for its input

    def all(self) -> dict[str, Any]:
        output = self.case.tables.output
        lack = pictures.lacking() if output.pictures or output.animation else None
        if lack is not None:
            self.watch.say(f"{lack}; the case runs without")
            self.case = self.case.with_values({"output.pictures": False, "output.animation": False})
        done = self.comm.bcast(on_root(self.comm, lambda: list(self._finished())))
        pending = [name for name in self.case.tables.analyses if name not in done]
        for name in done:
            self.watch.say(f"{name}: finished before; sbfem plot and sbfem export make other files of it")
        try:
            if pending:
                self._begin(pending)
            for k, name in enumerate(pending):
                self._one(name, f"[{k + 1}/{len(pending)}] {name}")
        except BaseException:
            if self.comm.size == 1 and self._finished():
                self._write()  # what it has come to
            raise
        summary: dict[str, Any] = self.comm.bcast(on_root(self.comm, self._write))
        return summary

    def _finished(self) -> dict[str, tuple[dict[str, Any], Found]]:
        """Facts and quantities of the analyses whose files stand. On rank 0."""
        parts = {}
        for name in self.case.tables.analyses:
            path = part_of(self.path, name)
            if not os.path.isfile(path):
                continue
            try:
                with opened(path, WHAT) as part:
                    parts[name] = json.loads(text(part.attrs["run"])), Found.read(part)
            except ValueError as error:
                raise ValueError(f"{error}; remove this file to have {name} computed again") from None
        return parts

    def _begin(self, pending: list[str]) -> None:
        """Make the structure; what analyses ask of it or of the disk and it has not is told before any is
        solved. Collective.
        """
        self.watch.stage("mesh and model")
        self.structure = self.enter_context(contextlib.closing(Structure(self.case, self.comm)))
        self.model = self.structure.facts()
        self.structure.check(self.case, pending)
        size, kept = self.structure.size(self.case), 0.0
        for name in pending:
            cost = self.case.tables.analyses[name].cost(size)
            kept += cost.disk
            with located(self.case, "analyses", name):
                self._require_room(name, cost.memory, kept)

    def _require_room(self, name: str, memory: float, kept: float) -> None:
        """Refuse an analysis by the memory and the disk (bytes, with what is kept before it) that it is
        estimated to take. Collective.
        """
        kind = self.case.tables.analyses[name]
        given = ", ".join(key for key in SIZES if key in kind.model_fields_set) or "modes"
        low = 0.5 * memory / self.comm.size  # estimates of what all ranks take are good to a factor of two
        what, less = "what it asks for, by a low estimate,", f"ask for less ({given})"
        require_memory(kind.kind, self.comm, low, what, lambda share: less)
        file = PlannedFile(os.path.join(self.path, RESULTS), kept)
        fewer = "keep fewer instants (decimation) or points, or name another folder"
        what = f"what is kept up to {name}"
        require_disk(kind.kind, self.comm, file, what=what, remedy=lambda share: fewer)

    def _one(self, name: str, title: str) -> None:
        """An analysis, its file and its pictures; a failure is noted with its reason."""
        case, kind = self.case, self.case.tables.analyses[name]
        assert self.structure is not None
        began = time.monotonic()
        try:
            self.watch.stage(f"{title} ({kind.kind})")
            with located(case, "analyses", name):
                file = part_of(self.path, name, f"{RESULT}.journal")
                result = self.structure.solve(case, name, file=file, progress=self.watch.fraction)
                found = kind.found(result, self.structure.points(case))
        except (CaseError, SolveError, SolverFailure) as error:
            if isinstance(error, OutOfMemory) and self.comm.size > 1:
                raise  # other ranks, which may wait for this one, must end too
            self.failed[name] = str(error), isinstance(error, CaseError)
            self.watch.say(f"{name} failed: {error}")
            return
        seconds = time.monotonic() - began
        # what several ranks share they write together
        if self.comm.rank == 0 or ranks_of(result) is not None:
            kind.save(result, part_of(self.path, name, RESULT))
        output = case.tables.output
        if output.pictures or output.vtu or output.animation:
            self.watch.stage(f"{title}: pictures and files")
            pictures.draw(case, name, result, self.structure.model, os.path.join(self.path, PICTURES))
        line = repr(result) if result != () else found["reason"].value
        self.structure.release(result)
        facts = {"seconds": seconds, "model": self.model}
        on_root(self.comm, lambda: self._keep(name, found, facts))
        self.watch.say(f"{name}: {line} ({seconds:.1f} s)")

    def _keep(self, name: str, found: Found, facts: dict[str, Any]) -> None:
        """What an analysis has found, in tables and the file by which it is finished. On rank 0."""
        if self.case.tables.output.csv:
            make_folder(os.path.join(self.path, TABLES))
            found.to_csv(os.path.join(self.path, TABLES, f"{name}.csv"))
        with new_results(part_of(self.path, name), "analysis") as file:
            file.attrs["run"] = text_of(json.dumps(facts))
            found.write(file)

    def _write(self) -> dict[str, Any]:
        """results.h5 and summary.json of all finished analyses, each replaced as a whole. On rank 0."""
        finished, kinds = self._finished(), self.case.tables.analyses
        run: dict[str, Any] = {
            "title": self.case.tables.title,
            "version": sb.__version__,
            "case": self.case.key,
            "ranks": self.comm.size,
            "ended": time.strftime("%Y-%m-%dT%H:%M:%S%z"),
            "complete": len(finished) == len(kinds),
            "model": self.model,
            "seconds": {},
            "failed": {name: reason for name, (reason, _) in self.failed.items()},
            "wrong_input": any(wrong for _, wrong in self.failed.values()),
        }
        summary: dict[str, Any] = {"run": run}
        with new_results(os.path.join(self.path, RESULTS), "run", self.case) as file:
            group = within(file, "analyses")
            for name, (facts, found) in finished.items():
                run["model"], run["seconds"][name] = facts["model"], facts["seconds"]
                own = within(group, name)
                own.attrs["kind"] = text_of(kinds[name].kind)
                found.write(own)
                summary[name] = {"kind": kinds[name].kind, **found.summary()}
            file.attrs["run"] = text_of(json.dumps(run))
        write_json(os.path.join(self.path, SUMMARY), summary)
        return summary


@dataclass(frozen=True, eq=False)
class RunResults:
    """Contents of a run's results.h5.

    Attributes
    ----------
    path : str
    text : str
        The case.
    case_file : str
    files : dict of str to bytes
        Contents of the files that the case names.
    run : dict
        Versions, model, seconds, failures.
    analyses : dict of str to Found
        Quantities by the names of the analyses.
    kinds : dict of str to str
    """

    path: str
    text: str
    case_file: str
    files: dict[str, bytes]
    run: dict[str, Any]
    analyses: dict[str, Found]
    kinds: dict[str, str]

    @classmethod
    def of(cls, path: str, file: h5py.File) -> RunResults:
        """What stands in an open file of results."""
        analyses = file["analyses"].items()
        return cls(
            path,
            *case_in(file),
            json.loads(text(file.attrs["run"])),
            {name: Found.read(group) for name, group in analyses},
            {name: text(group.attrs["kind"]) for name, group in analyses},
        )

    def __repr__(self) -> str:
        listed = ", ".join(f"{name} ({kind})" for name, kind in self.kinds.items()) or "none"
        return f"RunResults({self.path!r}: {listed})"

    def to_csv(self, folder: str) -> list[str]:
        """Write the tables of all analyses; the files."""
        written: list[str] = []
        for name, found in self.analyses.items():
            written += found.to_csv(os.path.join(folder, f"{name}.csv"))
        return written

    def facts(self) -> dict[str, Any]:
        """What summary.json holds."""
        found = {name: {"kind": self.kinds[name], **own.summary()} for name, own in self.analyses.items()}
        return {"run": self.run, **found}

    def told(self, name: str) -> str:
        """Kind of an analysis, and how long it took, to two digits."""
        seconds = self.run["seconds"].get(name)
        if not seconds:
            return self.kinds[name]
        unit, factor = ("s", 1.0) if seconds < 90.0 else ("min", 60.0) if seconds < 5400.0 else ("h", 3600.0)
        return f"{self.kinds[name]}, {float(f'{seconds / factor:.2g}'):g} {unit}"

    def value(self, name: str, *keys: str) -> Any:
        """Value of a quantity, ("push", "displacement", "A")."""
        here: Any = self.analyses[name]
        for key in keys:
            here = here[key]
        return getattr(here, "value", here)

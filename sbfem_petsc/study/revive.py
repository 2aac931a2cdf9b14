"""Results on the disk: what they hold, their pictures again, other formats."""

from __future__ import annotations

import contextlib
import functools
import os
import re
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

import sbfem_petsc as sb

from ..output_folder import make_output_folder, regular_file
from ..progress import Watch
from ..ranks.parallel import on_root
from ..record.about import Quantity
from ..record.layout import bare, text
from ..writing import spare_folder
from . import pictures
from .case.analyses import kind_called
from .case.case import Case, case_from_text
from .folder import PARTS, RESULT, holds, results_in
from .run import RESULTS, RunResults, duration
from .structure import Structure, lines_of
from .sweep_file import FILE, Sweep


def read_any(path: str | os.PathLike[str]) -> RunResults | Sweep:
    """Results of a run or a sweep: a file, or the folder of one.

    Raises
    ------
    ValueError
        If there are none.
    """
    name = os.fspath(path)
    if os.path.isdir(name):
        for candidate in (RESULTS, FILE):
            found = regular_file(name, candidate)
            if found is not None:
                return read_any(found)
        if os.path.isdir(os.path.join(name, "rows")):
            raise ValueError(
                f"{name!r} holds rows of a sweep, but no table of all yet; call  sbfem sweep CASE --output "
                f"{name}  without --rows, which computes what is missing and writes it"
            )
        if os.path.isdir(os.path.join(name, PARTS)):
            raise ValueError(
                f"{name!r} holds analyses of a run that has not come to its end; call  sbfem run CASE "
                f"--output {name}  again, which goes on where it was and writes {RESULTS}"
            )
        raise ValueError(
            f"{name!r} holds neither {RESULTS} nor {FILE}; name the folder that  sbfem run  or  "
            "sbfem sweep  wrote"
        )
    if not os.path.isfile(name):
        raise ValueError(f"results {name!r} do not exist; name results.h5, sweep.h5 or the folder of a run")
    if name.endswith(".toml"):
        raise ValueError(
            f"{name!r} is a case file; name the results that  sbfem run  or  sbfem sweep  made of it"
        )
    with results_in(name, "run", "sweep") as file:
        return (Sweep if holds(file) == "sweep" else RunResults).of(name, file)


def described(results: RunResults | Sweep) -> str:
    """What a results file holds, as text."""
    if isinstance(results, Sweep):
        lines = [repr(results)]
        lines += [
            f"  {name}: {len(values)} values from {values[0]} to {values[-1]}"
            for name, values in ((name, np.unique(column)) for name, column in results.inputs.items())
        ]
        lines += [
            f"  {name:45s} {'x'.join(map(str, array.shape)):>12s} {results.units[name]}"
            for name, array in results.values.items()
        ]
        return "\n".join(lines)
    run = results.run
    lines = [f"{results.path}: {run['title'] or results.case_file}, version {run['version']}, {run['ended']}"]
    model = run["model"]
    if model:
        lines.append(f"  {'; '.join(f'{what} {words}' for what, words in lines_of(model))}")
    for name, found in results.analyses.items():
        seconds = run["seconds"].get(name)
        lines.append(f"  {name} ({results.kinds[name]}{f', {duration(seconds)}' if seconds else ''})")
        lines += [f"    {_line('/'.join(where), q)}" for where, q in found.each()]
    lines += [f"  {name} FAILED: {reason}" for name, reason in run["failed"].items()]
    return "\n".join(lines)


def _line(where: str, q: Quantity) -> str:
    shown = f"{q.value:.6g}" if isinstance(q.value, float) else str(q.value)
    if np.size(q.value) > 4:
        shown = f"array {'x'.join(map(str, q.value.shape))}"
    return f"{where:34s} {shown}{'' if q.unit == '1' else f' {q.unit}'}" + (
        f"  ({text})" if (text := q.about.text) else ""
    )


def case_of(results: RunResults | Sweep, folder: str) -> Case:
    """The case that results were made from; the files it names are put into `folder`."""
    files: dict[str, str] = {}
    with results_in(results.path, "run", "sweep") as file:
        named = (entry for entry in file["case/files"].values() if not bare(entry))
        for number, entry in enumerate(named):
            # whatever the name is, nothing is written or read elsewhere; readers know formats by the ending
            name = text(entry.attrs["name"])
            ending = re.search(r"\.\w{1,8}$", name)
            files[name] = f"{number:03d}{ending[0] if ending else ''}"
            with open(os.path.join(folder, files[name]), "wb") as written:
                written.write(entry[()].tobytes())
    return case_from_text(results.text, results.case_file, folder, files)


def draw_again(path: str, output: str | None, comm: Any, watch: Watch, *, animation: bool = False) -> str:
    """Pictures of a run or sweep. Collective.

    Histories, motions, curves, backbones, loci and basins are read; modes and static solutions, and motions
    that are to be animated, are computed again from the case.

    Returns
    -------
    str
        The folder.
    """
    from ..plot.maps import draw_sweep  # says what is missing before anything is computed

    results, home = _found(path, comm)
    folder = output or os.path.join(home, "pictures")
    if isinstance(results, Sweep):
        on_root(comm, lambda: make_output_folder(folder))
        on_root(comm, lambda: draw_sweep(results, folder))
        return folder
    with _again(results, comm, animation=animation) as (case, structure):
        for name in results.analyses:
            watch.stage(f"{name}: pictures")
            animated = case.tables.output.animation and kind_called(results.kinds[name]).moving
            recorded = None if animated else _recorded(home, name)
            if recorded is not None:
                pictures.draw(case, name, recorded, None, folder)
            elif case.tables.body is None:
                result = structure().solve(case, name)
                pictures.draw(case, name, result, structure().model, folder)
                structure().release(result)
            else:
                watch.say(f"{name}: not drawn, for results do not hold a body's matrices; run it again")
    return folder


def _found(path: str, comm: Any) -> tuple[RunResults | Sweep, str]:
    """Results of a file or folder on all ranks, and their folder. Collective."""
    results = comm.bcast(on_root(comm, lambda: read_any(path)))
    return results, os.path.dirname(os.path.abspath(results.path))


@contextlib.contextmanager
def _again(
    results: RunResults, comm: Any, *, animation: bool = False
) -> Iterator[tuple[Case, Callable[[], Structure]]]:
    """The case of results, and the one structure on which its analyses are computed again, made when it is
    needed. Collective.
    """
    with spare_folder() as spare, contextlib.ExitStack() as stack:
        case = case_of(results, spare)
        case = case.with_values({"output.animation": True}) if animation else case

        @functools.cache
        def structure() -> Structure:
            made = Structure(case, comm)
            stack.callback(made.close)
            return made

        yield case, structure


def _recorded(home: str, name: str) -> Any:
    """A result that an analysis left in a file of its own; None if there is none."""
    files = (regular_file(home, PARTS, f"{name}.{RESULT}.{ending}") for ending in ("journal", "h5"))
    file = next(filter(None, files), None)
    return None if file is None else sb.read(file)


def export_results(path: str, wanted: list[str], output: str | None, comm: Any, watch: Watch) -> list[str]:
    """Results as CSV tables, or VTU files for ParaView. Collective.

    Returns
    -------
    list of str
        Files written.
    """
    results, home = _found(path, comm)
    folder = output or os.path.join(home, "export")
    written: list[str] = []
    on_root(comm, lambda: make_output_folder(folder))
    if "csv" in wanted:
        written += comm.bcast(on_root(comm, lambda: results.to_csv(folder)))
    if "vtu" in wanted:
        if isinstance(results, Sweep):
            raise ValueError("--vtu is for the results of a run; a sweep keeps no fields")
        written += _vtu(results, folder, comm, watch)
    return written


def _vtu(results: RunResults, folder: str, comm: Any, watch: Watch) -> list[str]:
    names = [name for name, kind in results.kinds.items() if kind_called(kind).fields]
    if not names:
        raise ValueError("--vtu writes modes and static displacements, and these results hold neither")
    with _again(results, comm) as (case, structure):
        if case.tables.body is not None:
            raise ValueError("--vtu: results do not hold a body's matrices; say vtu = true in [output]")
        for name in names:
            watch.stage(f"{name}: fields")
            result, path = structure().solve(case, name), os.path.join(folder, f"{name}.vtu")
            case.tables.analyses[name].write_fields(result, path, structure().model)
            structure().release(result)
    ending = "vtu" if comm.size == 1 else "pvtu"
    written = (os.path.join(folder, f"{name}.{ending}") for name in names)
    return [path for path in written if os.path.isfile(path)]  # of a band without modes there is none

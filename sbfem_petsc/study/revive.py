"""Results on the disk: what they hold, their pictures again, other formats."""

from __future__ import annotations

import contextlib
import functools
import os
import re
from typing import Any

import sbfem_petsc as sb

from ..output_folder import make_output_folder, regular_file
from ..progress import Watch
from ..ranks.parallel import on_root
from ..record.files import opened
from ..record.layout import text
from ..record.views import in_words
from ..writing import spare_folder
from . import pictures
from .case.analyses import kind_called
from .case.case import Case, case_from_text
from .folder import PARTS, RESULT, WHAT
from .run import RESULTS, RunResults
from .structure import Structure, lines_of
from .sweep_file import FILE, Sweep

# What a file may hold.
_KINDS: dict[str, type[RunResults] | type[Sweep]] = {"run": RunResults, "sweep": Sweep}


def read_any(path: str | os.PathLike[str]) -> RunResults | Sweep:
    """Results of a run or a sweep: a file, or the folder of one.

    Raises
    ------
    ValueError
        If there are none.
    """
    name = os.fspath(path)
    if os.path.isdir(name):
        there = [file for file in (RESULTS, FILE) if regular_file(name, file)]
        if not there:
            raise ValueError(f"{name!r} holds {_instead(name)}")
        name = os.path.join(name, there[0])
    if not os.path.isfile(name):
        raise ValueError(f"results {name!r} do not exist; name results.h5, sweep.h5 or the folder of a run")
    if name.endswith(".toml"):
        raise ValueError(
            f"{name!r} is a case file; name the results that  sbfem run  or  sbfem sweep  made of it"
        )
    with opened(name, WHAT) as file:
        holds = text(file.attrs.get("holds", ""))
        if holds == "analysis":
            run = os.path.dirname(os.path.dirname(os.path.abspath(name)))
            raise ValueError(
                f"{name!r} is one analysis of a run, which is read as a whole, by sb.read({run!r}) or "
                "the name of that folder"
            )
        if holds not in _KINDS:
            raise ValueError(f"{name!r} is an HDF5 file of another kind, not of a run or a sweep")
        return _KINDS[holds].of(os.path.abspath(name), file)


def _instead(folder: str) -> str:
    """What a folder holds without a file of results, and what to do."""
    if os.path.isdir(os.path.join(folder, "rows")):
        return (
            f"rows of a sweep, but no table of all yet; call  sbfem sweep CASE --output {folder}  without "
            "--rows, which computes what is missing and writes it"
        )
    if os.path.isdir(os.path.join(folder, PARTS)):
        return (
            f"analyses of a run that has not come to its end; call  sbfem run CASE --output {folder}  "
            f"again, which goes on where it was and writes {RESULTS}"
        )
    return f"neither {RESULTS} nor {FILE}; name the folder that  sbfem run  or  sbfem sweep  wrote"


def described(results: RunResults | Sweep) -> str:
    """What a results file holds, as text."""
    if isinstance(results, Sweep):
        facts, lines = results.facts(), [repr(results)]
        for name, values in facts["inputs"].items():
            lines.append(f"  {name}: {len(values)} values from {values[0]} to {values[-1]}")
        for name, q in facts["values"].items():
            lines.append(f"  {name:45s} {'x'.join(map(str, q['shape'])):>12s} {q['unit']}")
        return "\n".join(lines)
    run = results.run
    lines = [f"{results.path}: {run['title'] or results.case_file}, version {run['version']}, {run['ended']}"]
    lines.append(f"  {'; '.join(f'{what} {words}' for what, words in lines_of(run['model']))}")
    for name, found in results.analyses.items():
        lines.append(f"  {name} ({results.told(name)})")
        for where, q in found.each():
            unit = "" if q.unit == "1" else f" {q.unit}"
            lines.append(f"    {'/'.join(where):34s} {in_words(q.value)}{unit}  ({q.about.text})")
    lines += [f"  {name} FAILED: {reason}" for name, reason in run["failed"].items()]
    return "\n".join(lines)


def case_of(results: RunResults | Sweep, folder: str) -> Case:
    """The case that results were made from; the files it names are put into `folder`."""
    names: dict[str, str] = {}
    for number, (name, contents) in enumerate(results.files.items()):
        # whatever the name is, nothing is written or read elsewhere; readers know formats by the ending
        ending = re.search(r"\.\w{1,8}$", name)
        names[name] = f"{number:03d}{ending[0] if ending else ''}"
        with open(os.path.join(folder, names[name]), "wb") as written:
            written.write(contents)
    return case_from_text(results.text, results.case_file, folder, names)


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

    results, folder = _found(path, output, "pictures", comm)
    if isinstance(results, Sweep):
        on_root(comm, lambda: draw_sweep(results, folder))
    else:
        changes = {"output.animation": True} if animation else {}
        _draw(results, list(results.analyses), changes, folder, comm, watch)
    return folder


def export_results(path: str, wanted: list[str], output: str | None, comm: Any, watch: Watch) -> list[str]:
    """Results as CSV tables, or VTU files for ParaView. Collective.

    Returns
    -------
    list of str
        Files written.
    """
    results, folder = _found(path, output, "export", comm)
    written: list[str] = []
    if "csv" in wanted:
        written += comm.bcast(on_root(comm, lambda: results.to_csv(folder)))
    if "vtu" in wanted:
        if isinstance(results, Sweep):
            raise ValueError("--vtu is for the results of a run; a sweep keeps no fields")
        names = [name for name, kind in results.kinds.items() if kind_called(kind).fields]
        if not names:
            raise ValueError("--vtu writes modes and static displacements, and these results hold neither")
        if "body" in results.run["model"]:
            raise ValueError("--vtu: results do not hold a body's matrices; say vtu = true in [output]")
        changes = {"output.vtu": True, "output.pictures": False, "output.animation": False}
        _draw(results, names, changes, folder, comm, watch)
        ending = "vtu" if comm.size == 1 else "pvtu"
        made = (os.path.join(folder, f"{name}.{ending}") for name in names)
        written += filter(os.path.isfile, made)  # of a band without modes there is none
    return written


def _found(path: str, output: str | None, name: str, comm: Any) -> tuple[RunResults | Sweep, str]:
    """Results of a file or folder on all ranks; and a folder for what is made of them, one of some name
    beside them unless there is to be another. Collective.
    """
    results = comm.bcast(on_root(comm, lambda: read_any(path)))
    folder = output or os.path.join(os.path.dirname(results.path), name)
    on_root(comm, lambda: make_output_folder(folder))
    return results, folder


def _draw(
    results: RunResults, names: list[str], changes: dict[str, Any], folder: str, comm: Any, watch: Watch
) -> None:
    """What the case, with some changes, asks for of analyses: of their results where these were recorded and
    are enough, else of those that are computed again. Collective.
    """
    with spare_folder() as spare, contextlib.ExitStack() as stack:
        case = case_of(results, spare).with_values(changes)

        @functools.cache
        def structure() -> Structure:
            return stack.enter_context(contextlib.closing(Structure(case, comm)))

        output = case.tables.output
        for name in names:
            watch.stage(f"{name}: {'pictures' if output.pictures else 'fields'}")
            animated = output.animation and kind_called(results.kinds[name]).moving
            recorded = None if animated else _recorded(results, name)
            if recorded is not None:
                pictures.draw(case, name, recorded, None, folder)
            elif case.tables.body is None:
                result = structure().solve(case, name)
                pictures.draw(case, name, result, structure().model, folder)
                structure().release(result)
            else:
                watch.say(f"{name}: not drawn, for results do not hold a body's matrices; run it again")


def _recorded(results: RunResults, name: str) -> Any:
    """A result that an analysis left in a file of its own; None if there is none."""
    names = (f"{name}.{RESULT}.{ending}" for ending in ("journal", "h5"))
    files = (regular_file(os.path.dirname(results.path), PARTS, file) for file in names)
    return next((sb.read(file) for file in files if file is not None), None)

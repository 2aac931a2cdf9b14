"""Results on the disk: what they hold, their pictures again, other formats."""

from __future__ import annotations

import os
import re
from typing import Any

import numpy as np

import sbfem_petsc as sb

from ..output_folder import make_output_folder, regular_file
from ..progress import Watch
from ..ranks.parallel import on_root
from ..record.found import Found
from ..record.layout import bare, text
from ..record.views import plain
from ..writing import spare_folder
from . import pictures
from .case.analyses import kind_called
from .case.case import Case, case_from_text
from .estimates import duration
from .folder import PARTS
from .run import RESULTS, RunResults
from .storage import holds, results_in, write_json
from .structure import Structure, lines_of
from .sweep_file import FILE, Sweep, write_csv


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
            f"  {name}: {len(np.unique(column))} values from {column.min()} to {column.max()}"
            for name, column in results.inputs.items()
        ]
        lines += [
            f"  {name:45s} {'x'.join(map(str, array.shape)):>12s} {results.units.get(name, '1')}"
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
        lines += [f"    {line}" for line in _lines(found)]
    lines += [f"  {name} FAILED: {reason}" for name, reason in run["failed"].items()]
    return "\n".join(lines)


def _lines(found: Found, above: str = "") -> list[str]:
    lines = []
    for q in found.quantities():
        text = f"  ({q.about.text})" if q.about.text else ""
        for name, value in q.by_name():
            shown = (
                f"array {'x'.join(map(str, value.shape))}"
                if isinstance(value, np.ndarray) and value.size > 4
                else f"{value:.6g}"
                if isinstance(value, float)
                else str(value)
            )
            unit = q.units.get(name, q.unit)
            title = f"{above}{q.name}{f'/{name}' if name else ''}"
            lines.append(f"{title:34s} {shown}{'' if unit == '1' else f' {unit}'}{text}")
    for name, part in found.inner.items():
        lines += _lines(part, f"{above}{name}/") if isinstance(part, Found) else []
    return lines


def case_of(results: RunResults | Sweep, path: str, folder: str) -> Case:
    """The case that results were made from; the files it names are put into `folder`."""
    files: dict[str, str] = {}
    with results_in(path, "run", "sweep") as file:
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

    results = on_root(comm, lambda: read_any(path))
    results = comm.bcast(results)
    source = (
        os.path.join(path, FILE if isinstance(results, Sweep) else RESULTS) if os.path.isdir(path) else path
    )
    home = os.path.dirname(os.path.abspath(source))
    folder = output or os.path.join(home, "pictures")
    if isinstance(results, Sweep):
        on_root(comm, lambda: make_output_folder(folder))
        on_root(comm, lambda: draw_sweep(results, folder))
        return folder
    with spare_folder() as spare:
        case = case_of(results, source, spare)
        if animation:
            case = case.with_values({"output.animation": True})
        structure: Structure | None = None
        try:
            for name in results.analyses:
                watch.stage(f"{name}: pictures")
                animated = case.tables.output.animation and kind_called(results.kinds[name]).moving
                recorded = None if animated else _recorded(home, name)
                if recorded is None:
                    if case.tables.body is not None:
                        watch.say(
                            f"{name}: not drawn, for results do not hold a body's matrices; run it again"
                        )
                        continue
                    structure = structure or Structure(case, comm)
                    recorded = structure.solve(case, name)
                pictures.draw(case, name, recorded, structure.model if structure else None, folder)
                if structure is not None:
                    structure.release(recorded)
        finally:
            if structure is not None:
                structure.destroy()
    return folder


def _recorded(home: str, name: str) -> Any:
    """A result that an analysis left in a file of its own; None if there is none."""
    for ending in ("history.journal", "curve.journal", "result.journal", "curve.h5", "orbit.h5", "result.h5"):
        file = regular_file(home, PARTS, f"{name}.{ending}")
        if file is not None:
            return sb.read(file)
    return None


def export_results(path: str, wanted: list[str], output: str | None, comm: Any, watch: Watch) -> list[str]:
    """Results as CSV tables, JSON, or VTU files for ParaView. Collective.

    Returns
    -------
    list of str
        Files written.
    """
    results = comm.bcast(on_root(comm, lambda: read_any(path)))
    source = (
        os.path.join(path, FILE if isinstance(results, Sweep) else RESULTS) if os.path.isdir(path) else path
    )
    folder = output or os.path.join(os.path.dirname(os.path.abspath(source)), "export")
    written: list[str] = []
    on_root(comm, lambda: make_output_folder(folder))
    if "csv" in wanted:
        written += comm.bcast(on_root(comm, lambda: _csv(results, folder)))
    if "json" in wanted:
        written += comm.bcast(on_root(comm, lambda: _json(results, folder)))
    if "vtu" in wanted:
        if isinstance(results, Sweep):
            raise ValueError("--vtu is for the results of a run; a sweep keeps no fields")
        written += _vtu(results, source, folder, comm, watch)
    return written


def _csv(results: RunResults | Sweep, folder: str) -> list[str]:
    if isinstance(results, Sweep):
        path = os.path.join(folder, "sweep.csv")
        write_csv(results, path)
        return [path]
    return [
        path
        for name, found in results.analyses.items()
        for path in found.to_csv(os.path.join(folder, f"{name}.csv"))
    ]


def _json(results: RunResults | Sweep, folder: str) -> list[str]:
    path = os.path.join(folder, "sweep.json" if isinstance(results, Sweep) else "results.json")
    if isinstance(results, Sweep):
        value: Any = {
            "inputs": {name: column.tolist() for name, column in results.inputs.items()},
            "values": {name: plain(array) for name, array in results.values.items()},
            "units": results.units,
            "reasons": results.reasons,
        }
    else:
        value = {
            "run": results.run,
            **{name: own.summary(True) for name, own in results.analyses.items()},
        }
    write_json(path, value)
    return [path]


def _vtu(results: RunResults, source: str, folder: str, comm: Any, watch: Watch) -> list[str]:
    names = [name for name, kind in results.kinds.items() if kind_called(kind).fields]
    if not names:
        raise ValueError("--vtu writes modes and static displacements, and these results hold neither")
    with spare_folder() as spare:
        case = case_of(results, source, spare)
        if case.tables.body is not None:
            raise ValueError("--vtu: results do not hold a body's matrices; say vtu = true in [output]")
        structure = Structure(case, comm)
        try:
            written = []
            for name in names:
                watch.stage(f"{name}: fields")
                stem = os.path.join(folder, name)
                result = structure.solve(case, name)
                case.tables.analyses[name].write_fields(result, f"{stem}.vtu", structure.model)
                structure.release(result)
                written.append(f"{stem}.{'vtu' if comm.size == 1 else 'pvtu'}")
        finally:
            structure.destroy()
    return written

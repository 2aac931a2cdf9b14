"""Results in one self-describing HDF5 file, written by rank 0 and complete or not there at all."""

from __future__ import annotations

import contextlib
import os
import tempfile
from dataclasses import dataclass

from meshing.folder_index import make_folder

from ..analysis.static import Static
from ..checks import instance, shown
from ..loads import as_loads
from ..parallel import agreed, collective
from ..petsc import MPI, require_thread
from ..recording.hdf5 import new_hdf5, opened
from ..recording.sound import numbers
from ..system.modal_result import Modal
from ..system.model import Model
from ..writing import destination
from .contents import write_head, write_inputs, write_mesh, write_modal, write_static
from .datasets import WHAT, tree, written

FORMAT, FORMAT_VERSION = "sbfem-petsc results", 2


@dataclass(frozen=True, eq=False)
class Results:
    """Contents of a results file.

    Attributes
    ----------
    path : str
    versions, options, inputs, mesh : dict
        Names to numbers, strings, arrays or further such dicts.
    modal : dict or None
        "frequencies" (Hz), "residuals", "shapes" (modes, nodes, 2), "points", "solver", "iterations".
    static : dict of str to dict
        For each case "displacement" (nodes, 2), "contact_force", "gap", "active", "contact_resultant",
        "stress_intensity", "points", "loads", ...
    units : dict of str to str
        Unit of every dataset by its path in the file, "1" without dimension.
    """

    path: str
    versions: dict
    options: dict
    inputs: dict
    mesh: dict
    modal: dict | None
    static: dict[str, dict]
    units: dict[str, str]

    def __repr__(self) -> str:
        modes = f"{len(self.modal['frequencies'])} modes" if self.modal else "no modes"
        cases = ", ".join(self.static) or "none"
        return f"Results({self.path!r}: {len(self.mesh['nodes'])} nodes, {modes}, static cases: {cases})"


def check_output_folder(path: str, comm: MPI.Comm) -> str:
    """Make the folder if it is missing and see that every rank can write into it. Collective, for the start
    of a program.

    Returns
    -------
    str
        The absolute path.

    Raises
    ------
    ValueError
        One sentence, on all ranks.
    """
    folder = os.path.abspath(os.fspath(path))
    with collective(comm):
        if comm.rank == 0:
            make_folder(folder)
    with collective(comm):
        try:
            with tempfile.TemporaryFile(dir=folder):
                pass
        except OSError as error:
            raise ValueError(
                f"output folder {folder!r} cannot be written ({error.strerror or error}); name another one "
                "or change its permissions"
            ) from None
    return folder


@agreed()
def write_results(
    path: str,
    model: Model,
    modal: Modal | None = None,
    static: Static | dict[str, Static] | None = None,
    loads: dict | None = None,
) -> str:
    """Write inputs, versions, PETSc options, mesh, modes and static cases to an HDF5 file. Collective.

    Parameters
    ----------
    path : str
        Replaced only when the new file is complete.
    model : Model
    modal : Modal, optional
    static : Static or dict of str to Static, optional
        One case ("static") or named ones.
    loads : dict of str to loads, optional
        Load of each static case, or one load for a single case.

    Returns
    -------
    str
        `path`.

    Raises
    ------
    ValueError
        If a name makes no sense or the file cannot be written; on all ranks.

    Notes
    -----
    Rank 0 writes. Fields come to it slab by slab in the order of the mesh's node numbers, so that it never
    holds a whole one. Every dataset has the attributes "unit" and "description"; the root's "complete" is set
    last.
    """
    require_thread()
    instance("write_results", "model", model, Model, "a Model")
    comm = model.comm
    with collective(comm):
        destination(path, WHAT)
        if modal is not None:
            instance("write_results", "modal", modal, Modal, "a Modal")
        cases = _cases(static, loads)
        for name, result in (("modal", modal), *((name, result) for name, (result, _) in cases.items())):
            if result is not None and result.model is not model:
                raise ValueError(
                    f"write_results: {name!r} was computed with another model than the one given"
                )
    file = None
    with contextlib.ExitStack() as stack:
        with written(comm, path):
            if comm.rank == 0:
                file = stack.enter_context(new_hdf5(path, WHAT, FORMAT, FORMAT_VERSION))
                write_head(file)
                write_inputs(file.create_group("inputs"), model)
        write_mesh(comm, file, model, path)
        if modal is not None:
            write_modal(comm, file, modal, path)
        for name, (result, load) in cases.items():
            write_static(comm, file, name, result, load, path)
        with written(comm, path):
            if file is not None:
                file.attrs["complete"] = True
            stack.close()
    return path


def read_results(path: str) -> Results:
    """Read a results file.

    Raises
    ------
    ValueError
        If the file is missing, truncated, damaged or of another kind; one sentence.
    """
    with opened(path, WHAT, {FORMAT: FORMAT_VERSION}) as file:
        units: dict[str, str] = {}
        numbers(file, "mesh/nodes", None, 2)
        if "modal" in file:
            numbers(file, "modal/frequencies", None, least=0.0)
        contents = tree(file, units)
        parts = [contents[name] for name in ("versions", "petsc_options", "inputs", "mesh")]
        if not all(isinstance(part, dict) for part in [*parts, contents.get("static", {})]):
            raise ValueError("it has data sets in the place of groups")
    return Results(
        os.fspath(path),
        contents["versions"],
        contents["petsc_options"],
        contents["inputs"],
        contents["mesh"],
        contents.get("modal"),
        contents.get("static", {}),
        units,
    )


def _cases(static, loads) -> dict[str, tuple[Static, object]]:
    """Static cases by name with their loads."""
    if static is None:
        return {}
    if isinstance(static, Static):
        static, loads = {"static": static}, None if loads is None else {"static": loads}
    if not isinstance(static, dict) or not isinstance(loads, (dict, type(None))):
        raise TypeError(
            f"write_results: static = {shown(static)} and loads = {shown(loads)} must be one case and its "
            "load, or dicts of these by name"
        )
    for name, result in static.items():
        instance("write_results", f"static[{name!r}]", result, Static, "a Static")
    for name, load in (loads or {}).items():
        try:
            as_loads(load)
        except TypeError as error:
            raise TypeError(f"write_results: loads[{name!r}]: {error}") from None
    unknown = sorted(set(loads or {}) - set(static))
    if unknown:
        raise ValueError(f"loads are given for {unknown}, but the static cases are {sorted(static)}")
    for name in static:
        if not isinstance(name, str) or not name.strip(". ") or "/" in name or not name.isprintable():
            raise ValueError(f"static case {name!r}: its name must be a text without '/'")
    return {
        name: (result, (loads or {}).get(name, getattr(result, "load", None)))
        for name, result in static.items()
    }

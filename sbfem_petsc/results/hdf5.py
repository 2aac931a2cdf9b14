"""Results in one self-describing HDF5 file, written by rank 0 and complete or not there at all."""

from __future__ import annotations

import contextlib
import dataclasses
import datetime
import os
import platform
import tempfile
from dataclasses import dataclass
from importlib import metadata
from typing import Any

import h5py
import numpy as np
import scipy

from ..analysis.static import Static
from ..loads import as_loads
from ..parallel import collective
from ..petsc import MPI, PETSc, SLEPc
from ..recording.hdf5 import new_hdf5, opened
from ..system.model import Model
from ..system.modes import Modal
from ..writing import destination, reason
from .gather import global_size, stream

WHAT, FORMAT, FORMAT_VERSION = "results file", "sbfem-petsc results", 2

# Units of the fields of materials and loads, by name.
_UNITS = {
    "young": "Pa",
    "young_1": "Pa",
    "young_2": "Pa",
    "young_3": "Pa",
    "shear_12": "Pa",
    "density": "kg/m^3",
    "angle": "degree",
    "fx": "N",
    "fy": "N",
    "tx": "Pa",
    "ty": "Pa",
    "pressure": "Pa",
}


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
            try:
                os.makedirs(folder, exist_ok=True)
            except OSError as error:
                raise ValueError(
                    f"output folder {folder!r} cannot be made ({error.strerror or error}); name another one "
                    "or free its place"
                ) from None
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
    comm = model.comm
    with collective(comm):
        destination(path, WHAT)
        cases = _cases(static, loads)
        for name, result in (("modal", modal), *((name, result) for name, (result, _) in cases.items())):
            if result is not None and result.model is not model:
                raise ValueError(
                    f"write_results: {name!r} was computed with another model than the one given"
                )
    file = None
    with contextlib.ExitStack() as stack:
        with _written(comm, path):
            if comm.rank == 0:
                file = stack.enter_context(new_hdf5(path, WHAT, FORMAT, FORMAT_VERSION))
                _write_head(file)
                _write_inputs(file.create_group("inputs"), model)
        _write_mesh(comm, file, model, path)
        if modal is not None:
            _write_modal(comm, file, modal, path)
        for name, (result, load) in cases.items():
            _write_static(comm, file, name, result, load, path)
        with _written(comm, path):
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
        tree = _tree(file, units)
    return Results(
        os.fspath(path),
        tree["versions"],
        tree["petsc_options"],
        tree["inputs"],
        tree["mesh"],
        tree.get("modal"),
        tree.get("static", {}),
        units,
    )


# ---------------------------------------------------------------------- parts of the file
@contextlib.contextmanager
def _written(comm: MPI.Comm, path: str):
    """`collective` with the system's errors turned into one sentence."""
    with collective(comm):
        try:
            yield
        except (OSError, RuntimeError) as error:
            raise ValueError(f"{WHAT} {path!r} cannot be written: {reason(error)}") from None


def _cases(static, loads) -> dict[str, tuple[Static, object]]:
    """Static cases by name with their loads."""
    if static is None:
        return {}
    if isinstance(static, Static):
        static, loads = {"static": static}, None if loads is None else {"static": loads}
    unknown = sorted(set(loads or {}) - set(static))
    if unknown:
        raise ValueError(f"loads are given for {unknown}, but the static cases are {sorted(static)}")
    for name in static:
        if not isinstance(name, str) or not name.strip(". ") or "/" in name:
            raise ValueError(f"static case {name!r}: its name must be a text without '/'")
    return {
        name: (result, (loads or {}).get(name, getattr(result, "load", None)))
        for name, result in static.items()
    }


def _write_head(file: h5py.File) -> None:
    file.attrs["created"] = datetime.datetime.now(datetime.timezone.utc).isoformat(timespec="seconds")
    try:
        own = metadata.version("sbfem-petsc")
    except metadata.PackageNotFoundError:
        own = "unknown (not installed)"
    versions = {
        "sbfem-petsc": own,
        "petsc": ".".join(map(str, PETSc.Sys.getVersion())),
        "slepc": ".".join(map(str, SLEPc.Sys.getVersion())),
        "mpi": MPI.Get_library_version().splitlines()[0].strip("\0 "),
        "numpy": np.__version__,
        "scipy": scipy.__version__,
        "h5py": h5py.__version__,
        "hdf5": h5py.version.hdf5_version,
        "python": platform.python_version(),
    }
    file.create_group("versions").attrs.update(versions)
    file.create_group("petsc_options").attrs.update(
        {name: value or "" for name, value in PETSc.Options().getAll().items()}
    )


def _write_inputs(group: h5py.Group, model: Model) -> None:
    _put(group, "thickness", model.thickness, "m", "thickness of the structure")
    _put(group, "damping", model.damping, "1", "modal damping ratio of dynamic analyses")
    _put(group, "rayleigh", model.rayleigh, "1/s, s", "factors a, b of the damping a M + b K beside it")
    _put(group, "continued_fraction", model.continued_fraction, "1", "terms of the continued fraction")
    _put(group, "order", model.order, "1", "polynomial order of the edges")
    _put(group, "ranks", model.comm.size, "1", "MPI ranks that computed this file")
    for name, material in zip(model.material_names, model.materials):
        _put_fields(group.require_group("materials").create_group(name.replace("/", "_")), material)
    for number, support in enumerate(model.supports, 1):
        part = group.require_group("supports").create_group(f"{number}")
        part.attrs["where"] = support.where
        springs = "N/m^3" if support.where in model.edge_set_names else "N/m"
        _put(part, "fixed", np.array(support.fixed), "1", "whether x and y are held fixed")
        _put(part, "springs", np.array(support.springs), springs, "elastic support in x and y")


def _write_mesh(comm: MPI.Comm, file: h5py.File | None, model: Model, path: str) -> None:
    """Node coordinates, S-elements, points, cracks and contact pairs."""
    part = model.part
    group = None
    with _written(comm, path):
        if file is not None:  # on rank 0
            group = file.create_group("mesh")
            group.attrs["edge_sets"], group.attrs["materials"] = (
                list(model.edge_set_names),
                list(model.material_names),
            )
            _put(
                group,
                "boundary_unknowns",
                model.boundary_unknowns,
                "1",
                "displacement unknowns on S-element boundaries after the supports",
            )
            _put(
                group,
                "unknowns",
                model.unknowns,
                "1",
                "the same with all auxiliary unknowns of the continued fraction",
            )
            _put(group, "shapes", model.shapes, "1", "different shapes of S-elements")
            for name, (at, *_) in model.points.items():
                _put(
                    group.require_group("points"),
                    name.replace("/", "_"),
                    np.array(at),
                    "m",
                    f"coordinates of point {name}",
                )
            pairs = model.pairs
            for name, values, unit, text in (
                (
                    "nodes",
                    pairs.nodes,
                    "1",
                    "node on the face the normal points to, node on the opposite face",
                ),
                ("normal", pairs.normal, "1", "unit normal of the crack's axis"),
                ("gap", pairs.gap, "m", "initial gap"),
                ("crack", pairs.crack, "1", "number of the crack, from 0"),
                ("position", pairs.position, "1", "fraction of the face's length from the tip"),
            ):
                _put(group.require_group("pairs"), name, values, unit, text)
            for crack in model.cracks:
                facts = group.require_group("cracks").create_group(crack.name.replace("/", "_"))
                _put(facts, "tip", np.array(crack.tip), "m", "coordinates of the tip")
                _put(facts, "axis", np.array(crack.axis), "1", "unit vector from the tip to the mouth")
                _put(facts, "opening", crack.opening, "rad", "total angle between the faces")
                _put(facts, "length", crack.length, "m", "length along the axis")
    nodes = global_size(comm, part.nodes)
    _put_rows(
        comm, group, "nodes", part.nodes, part.coordinates, nodes, "m", "coordinates of the nodes", path
    )
    order = np.argsort(part.elements)
    elements = part.elements[order]
    for name, values, unit, text in (
        ("scaling_centres", part.centres, "m", "scaling centres of the S-elements"),
        (
            "closed",
            part.closed.astype(np.int8),
            "1",
            "1: the boundary is a loop; 0: the scaling centre lies on the boundary",
        ),
        (
            "element_materials",
            np.array([model.named_materials(int(k))[0] for k in part.materials], dtype=np.int64),
            "1",
            "numbers in the list of materials; around a tip at an interface that of the first edge's sector",
        ),
        (
            "element_nodes_count",
            np.array([len(c) for c in part.chains], dtype=np.int64),
            "1",
            "number of boundary nodes",
        ),
    ):
        _put_rows(comm, group, name, elements, np.asarray(values)[order], model.elements, unit, text, path)
    # Chains of different lengths stand one after the other, in the order of the S-elements.
    counts = np.zeros(model.elements, dtype=np.int64)
    counts[part.elements] = [len(c) for c in part.chains]
    comm.Allreduce(MPI.IN_PLACE, counts)
    starts = np.concatenate([[0], np.cumsum(counts)])
    flat = np.concatenate(
        [part.nodes[part.chains[i]] for i in order] or [np.empty(0, dtype=np.int64)]
    ).astype(np.int64)
    places = np.concatenate(
        [np.arange(starts[e], starts[e + 1]) for e in elements] or [np.empty(0, dtype=np.int64)]
    )
    text = "boundary nodes of the S-elements, counter-clockwise, one element after the other"
    _put_rows(comm, group, "element_nodes", places, flat, int(starts[-1]), "1", text, path)


def _write_modal(comm: MPI.Comm, file: h5py.File | None, modal: Modal, path: str) -> None:
    model, count = modal.model, len(modal.frequencies)
    nodes = global_size(comm, model.part.nodes)
    shapes: Any = None
    with _written(comm, path):
        if file is not None:  # on rank 0
            group = file.create_group("modal")
            group.attrs["solver"] = modal.solver
            _put(group, "frequencies", modal.frequencies, "Hz", "natural frequencies, lowest first")
            _put(group, "residuals", modal.residuals, "1", "||K x - omega^2 M x|| / ||omega^2 M x||")
            _put(group, "iterations", modal.iterations, "1", "iterations of the eigensolver")
            _put(group, "unknowns", modal.unknowns, "1", "unknowns of the eigenvalue problem")
            for name, values in modal.point_shapes.items():
                _put(
                    group.require_group("points"),
                    name.replace("/", "_"),
                    values,
                    "1/sqrt(kg)",
                    f"displacement of point {name} in each mode",
                )
            shapes = _declare(
                group,
                "shapes",
                (count, nodes, 2),
                float,
                "1/sqrt(kg)",
                "mode shapes (mode, node, x and y), modal mass 1",
                chunks=(1, nodes, 2),
            )
    for mode in range(count):
        field = modal.nodal(mode)

        def write(first: int, rows: np.ndarray, mode: int = mode) -> None:
            shapes.write_direct(rows, dest_sel=np.s_[mode, first : first + len(rows)])

        with _written(comm, path):
            stream(comm, model.part.nodes, field, nodes, write)


def _write_static(comm: MPI.Comm, file: h5py.File | None, name: str, result: Static, load, path: str) -> None:
    model = result.model
    group = None
    exponents = dict(zip(model.tips.names, model.tips.exponents))
    with _written(comm, path):
        if file is not None:  # on rank 0
            group = file.require_group("static").create_group(name)
            group.attrs["solver"] = result.solver
            for number, item in enumerate(as_loads(load).parts if load is not None else (), 1):
                _put_fields(group.require_group("loads").create_group(f"{number}"), item)
            _put(
                group,
                "contact_force",
                result.contact_force,
                "N",
                "forces of the contact pairs, compression positive",
            )
            _put(group, "contact_resultant", result.contact_resultant, "N", "sum of the contact forces")
            _put(group, "gap", result.gap, "m", "gaps of the contact pairs")
            _put(group, "active", result.active, "1", "pairs in contact")
            _put(group, "iterations", result.iterations, "1", "iterations of the active set")
            _put(group, "residual", result.residual, "1", "||K u - f - G' force|| / ||f||")
            for crack, values in result.stress_intensity.items():
                intensity = group.require_group("stress_intensity").create_group(crack.replace("/", "_"))
                _put(
                    intensity,
                    "factors",
                    np.array(values),
                    "Pa m^(1 - exponent)",
                    f"K_I and K_II at the tip of {crack}",
                )
                _put(
                    intensity,
                    "exponents",
                    exponents[crack],
                    "1",
                    "exponents of the displacement at the tip, 1/2 at a crack",
                )
            for point, displacement in result.point_displacements.items():
                _put(
                    group.require_group("points"),
                    point.replace("/", "_"),
                    displacement,
                    "m",
                    f"displacement of point {point}",
                )
    _put_rows(
        comm,
        group,
        "displacement",
        model.part.nodes,
        result.field,
        global_size(comm, model.part.nodes),
        "m",
        "displacement of the nodes",
        path,
    )


# ---------------------------------------------------------------------- small pieces
def _declare(
    group: h5py.Group, name: str, shape: tuple, kind, unit: str, description: str, **layout
) -> h5py.Dataset:
    dataset = group.create_dataset(name, shape=shape, dtype=kind, **(layout if 0 not in shape else {}))
    dataset.attrs["unit"], dataset.attrs["description"] = unit, description
    return dataset


def _put(group: h5py.Group, name: str, values, unit: str, description: str) -> None:
    values = np.asarray(values)
    _declare(group, name, values.shape, values.dtype, unit, description)[...] = values


def _put_rows(
    comm: MPI.Comm,
    group: h5py.Group | None,
    name: str,
    numbers: np.ndarray,
    values: np.ndarray,
    size: int,
    unit: str,
    description: str,
    path: str,
) -> None:
    """One distributed dataset, streamed to rank 0, where alone an error can arise."""
    dataset: Any = None
    with _written(comm, path):
        if comm.rank == 0:
            dataset = _declare(group, name, (size, *values.shape[1:]), values.dtype, unit, description)
    with _written(comm, path):
        stream(
            comm,
            numbers,
            values,
            size,
            lambda first, rows: dataset.write_direct(
                np.ascontiguousarray(rows), dest_sel=np.s_[first : first + len(rows)]
            ),
        )


def _put_fields(group: h5py.Group, item) -> None:
    """A material or load: numbers as datasets with units, texts as attributes."""
    group.attrs["kind"] = type(item).__name__
    for field in dataclasses.fields(item):
        value = getattr(item, field.name)
        if isinstance(value, str):
            group.attrs[field.name] = value
        elif value is not None:
            _put(
                group,
                field.name,
                float(value),
                _UNITS.get(field.name, "1"),
                f"{field.name} of {type(item).__name__}",
            )


def _tree(group: h5py.Group, units: dict[str, str]) -> dict:
    """Groups as dicts: attributes, datasets and subgroups by name."""
    result = {
        name: value.tolist() if isinstance(value, np.ndarray) else value
        for name, value in group.attrs.items()
    }
    for name, item in group.items():
        if isinstance(item, h5py.Group):
            result[name] = _tree(item, units)
        else:
            units[item.name] = item.attrs["unit"]
            result[name] = item[()]
    return result

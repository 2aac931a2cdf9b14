"""The parts of a results file: head, inputs, mesh, modes, static cases."""

from __future__ import annotations

import datetime
import platform
from importlib import metadata
from typing import Any

import h5py
import numpy as np
import scipy

from ..analysis.static import Static
from ..loads import as_loads
from ..petsc import MPI, PETSc, SLEPc
from ..system.modal_result import Modal
from ..system.model import Model
from .datasets import Label, Place, declare, put, put_fields, put_rows, written
from .gather import global_size, stream


def write_head(file: h5py.File) -> None:
    """When, with which versions and with which PETSc options the file is made."""
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


def write_inputs(group: h5py.Group, model: Model) -> None:
    """What a model was made with: damping, materials, supports."""
    put(group, "thickness", model.thickness, "m", "thickness of the structure")
    put(group, "damping", model.damping, "1", "modal damping ratio of dynamic analyses")
    put(group, "rayleigh", model.rayleigh, "1/s, s", "factors a, b of the damping a M + b K beside it")
    put(group, "continued_fraction", model.continued_fraction, "1", "terms of the continued fraction")
    put(group, "order", model.order, "1", "polynomial order of the edges")
    put(group, "ranks", model.comm.size, "1", "MPI ranks that computed this file")
    for name, material in zip(model.material_names, model.materials):
        put_fields(group.require_group("materials").create_group(name.replace("/", "_")), material)
    for number, support in enumerate(model.supports, 1):
        part = group.require_group("supports").create_group(f"{number}")
        part.attrs["where"] = support.where
        springs = "N/m^3" if support.where in model.edge_set_names else "N/m"
        put(part, "fixed", np.array(support.fixed), "1", "whether x and y are held fixed")
        put(part, "springs", np.array(support.springs), springs, "elastic support in x and y")


def write_mesh(comm: MPI.Comm, file: h5py.File | None, model: Model, path: str) -> None:
    """Node coordinates, S-elements, points, cracks and contact pairs."""
    part = model.part
    group = None
    with written(comm, path):
        if file is not None:  # on rank 0
            group = file.create_group("mesh")
            group.attrs["edge_sets"], group.attrs["materials"] = (
                list(model.edge_set_names),
                list(model.material_names),
            )
            put(
                group,
                "boundary_unknowns",
                model.boundary_unknowns,
                "1",
                "displacement unknowns on S-element boundaries after the supports",
            )
            put(
                group,
                "unknowns",
                model.unknowns,
                "1",
                "the same with all auxiliary unknowns of the continued fraction",
            )
            put(group, "shapes", model.shapes, "1", "different shapes of S-elements")
            for name, (at, *_) in model.points.items():
                put(
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
                ("position", pairs.position, "1", "fraction of the crack's length from its first tip"),
            ):
                put(group.require_group("pairs"), name, values, unit, text)
            for crack in model.cracks:
                facts = group.require_group("cracks").create_group(crack.name.replace("/", "_"))
                put(facts, "tip", np.array(crack.tip), "m", "coordinates of the tip")
                put(facts, "axis", np.array(crack.axis), "1", "unit vector from the tip to the mouth")
                put(facts, "opening", crack.opening, "rad", "total angle between the faces")
                put(facts, "length", crack.length, "m", "length along the axis")
    nodes = global_size(comm, part.nodes)
    place = Place(comm, group, path)
    put_rows(place, Label("nodes", "m", "coordinates of the nodes"), part.nodes, part.coordinates, nodes)
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
        put_rows(place, Label(name, unit, text), elements, np.asarray(values)[order], model.elements)
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
    put_rows(place, Label("element_nodes", "1", text), places, flat, int(starts[-1]))


def write_modal(comm: MPI.Comm, file: h5py.File | None, modal: Modal, path: str) -> None:
    """Frequencies and mode shapes. Collective."""
    model, count = modal.model, len(modal.frequencies)
    nodes = global_size(comm, model.part.nodes)
    shapes: Any = None
    with written(comm, path):
        if file is not None:  # on rank 0
            group = file.create_group("modal")
            group.attrs["solver"] = modal.solver
            put(group, "frequencies", modal.frequencies, "Hz", "natural frequencies, lowest first")
            put(group, "residuals", modal.residuals, "1", "||K x - omega^2 M x|| / ||omega^2 M x||")
            put(group, "iterations", modal.iterations, "1", "iterations of the eigensolver")
            put(group, "unknowns", modal.unknowns, "1", "unknowns of the eigenvalue problem")
            for name, values in modal.point_shapes.items():
                put(
                    group.require_group("points"),
                    name.replace("/", "_"),
                    values,
                    "1/sqrt(kg)",
                    f"displacement of point {name} in each mode",
                )
            shapes = declare(
                group,
                Label("shapes", "1/sqrt(kg)", "mode shapes (mode, node, x and y), modal mass 1"),
                (count, nodes, 2),
                float,
                chunks=(1, nodes, 2),
            )
    for mode in range(count):
        field = modal.nodal(mode)

        def write(first: int, rows: np.ndarray, mode: int = mode) -> None:
            shapes.write_direct(rows, dest_sel=np.s_[mode, first : first + len(rows)])

        with written(comm, path):
            stream(comm, model.part.nodes, field, nodes, write)


def write_static(comm: MPI.Comm, file: h5py.File | None, name: str, result: Static, load, path: str) -> None:
    """A static solution under the name of its load. Collective."""
    model = result.model
    group = None
    exponents = dict(zip(model.tips.names, model.tips.exponents))
    with written(comm, path):
        if file is not None:  # on rank 0
            group = file.require_group("static").create_group(name)
            group.attrs["solver"], group.attrs["notes"] = result.solver, list(result.notes)
            for number, item in enumerate(as_loads(load).parts if load is not None else (), 1):
                put_fields(group.require_group("loads").create_group(f"{number}"), item)
            put(
                group,
                "contact_force",
                result.contact_force,
                "N",
                "forces of the contact pairs, compression positive",
            )
            put(group, "contact_resultant", result.contact_resultant, "N", "sum of the contact forces")
            put(group, "gap", result.gap, "m", "gaps of the contact pairs")
            put(group, "active", result.active, "1", "pairs in contact")
            put(group, "iterations", result.iterations, "1", "iterations of the active set")
            put(group, "residual", result.residual, "1", "||K u - f - G' force|| / ||f||")
            for crack, values in result.stress_intensity.items():
                intensity = group.require_group("stress_intensity").create_group(crack.replace("/", "_"))
                put(
                    intensity,
                    "factors",
                    np.array(values),
                    "Pa m^(1 - exponent)",
                    f"K_I and K_II at the tip of {crack}",
                )
                put(
                    intensity,
                    "exponents",
                    exponents[crack],
                    "1",
                    "exponents of the displacement at the tip, 1/2 at a crack",
                )
            for point, displacement in result.point_displacements.items():
                put(
                    group.require_group("points"),
                    point.replace("/", "_"),
                    displacement,
                    "m",
                    f"displacement of point {point}",
                )
    put_rows(
        Place(comm, group, path),
        Label("displacement", "m", "displacement of the nodes"),
        model.part.nodes,
        result.field,
        global_size(comm, model.part.nodes),
    )

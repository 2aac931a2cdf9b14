"""VTU files for ParaView: interior sampled, high order edges subdivided, one piece a rank."""

from __future__ import annotations

import contextlib
import os
import xml.etree.ElementTree as xml
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from meshing.whole_file import destination, replaced

from ..analysis.modal import ReducedModal
from ..bodies.finite_element_model import FiniteElementModel, nodal_field
from ..checks import flag, instance, optional_integer, shown
from ..petsc import MPI
from ..ranks.parallel import agreed, collective, ranks_of
from ..system.fields.sampling import Patches, point_grid_cells, sample
from ..system.model import Model
from ..system.solve.modal_result import Modal, chosen_modes

STRESSES = ("stress_xx", "stress_yy", "stress_xy", "von_mises")
# A mode's coordinates have the unit m sqrt(kg).
_MODES_UNIT = "/sqrt(kg)"


@agreed("fields")  # of this rank's nodes
def write_vtu(
    path: str,
    model: Model | FiniteElementModel,
    fields: Mapping[str, Any],
    *,
    stress: bool = True,
    subdivisions: int | None = None,
) -> str:
    """Write displacement fields and their stresses to a VTU file, or a PVTU file with one piece a rank.
    Collective.

    Units stand in the arrays' names: "NAME (m)", "NAME von_mises (Pa)".

    Parameters
    ----------
    path : str
        Name of the file; its extension is replaced by .vtu on one rank and by .pvtu on several (pieces:
        _0.vtu, _1.vtu ...).
    model : Model or FiniteElementModel
        Of a body its own elements are written, or points where it has none, without stresses.
    fields : dict of str to Static, Field or (m, 2) array, of a body ReducedStatic, Field or (nodes, 3) array
        `Motion.field(time)` is a field; an array holds displacements of this rank's nodes alone, m, without
        what contact and loads on the faces inside tip elements add there; modes by `write_modes`.
    stress : bool
        Write stresses too: stress_xx, stress_yy, stress_xy, von_mises.
    subdivisions : int, optional
        Straight pieces an edge; default: the order of the edges.

    Returns
    -------
    str
        The file to open.

    Raises
    ------
    ValueError
        If a field has a wrong shape or the file cannot be written; on all ranks.

    Notes
    -----
    Points are not shared between the edges of an S-element: its stress is discontinuous there, as the method
    gives it. Cell data: "element" and "material" (numbers), "rank". The stress at a scaling centre, a crack
    tip for one, is that at a hundredth of the way to the boundary.
    """
    instance("write_vtu", "model", model, (Model, FiniteElementModel), "a Model or FiniteElementModel")
    with collective(ranks_of(model) or MPI.COMM_SELF):
        if not isinstance(fields, Mapping) or not all(isinstance(name, str) for name in fields):
            raise TypeError(f"write_vtu: fields = {shown(fields)} must be a dict of fields by name")
        flag("write_vtu", "stress", stress)
        subdivisions = optional_integer("write_vtu", "subdivisions", subdivisions, least=1, most=100)
    return _write(path, model, fields, stress, subdivisions, "")


@agreed()
def write_modes(
    path: str,
    modal: Modal | ReducedModal,
    modes: Sequence[int] | None = None,
    *,
    stress: bool = False,
    subdivisions: int | None = None,
) -> str:
    """Write mode shapes, with their numbers and frequencies in the arrays' names: "mode 1, 26.4 Hz
    (m/sqrt(kg))". Collective.

    Parameters
    ----------
    path, stress, subdivisions
        See `write_vtu`.
    modal : Modal or ReducedModal
        Of a `Model`, or of a body whose shapes are kept.
    modes : sequence of int, optional
        0 the lowest; default: all.

    Returns
    -------
    str
        The file to open.
    """
    instance("write_modes", "modal", modal, (Modal, ReducedModal), "a Modal or ReducedModal")
    model = modal.body if isinstance(modal, ReducedModal) else modal.model
    if not isinstance(model, (Model, FiniteElementModel)):
        raise TypeError("write_modes: modal must be the modes of a Model, or of a body with its shapes")
    count = len(modal.frequencies)
    with collective(ranks_of(model) or MPI.COMM_SELF):
        chosen = chosen_modes("write_modes", range(count) if modes is None else modes, count)
        flag("write_modes", "stress", stress)
        subdivisions = optional_integer("write_modes", "subdivisions", subdivisions, least=1, most=100)
    fields = {f"mode {k + 1}, {modal.frequencies[k]:.6g} Hz": modal.nodal(k) for k in chosen}
    return _write(path, model, fields, stress, subdivisions, _MODES_UNIT)


def _write(
    path: str,
    model: Model | FiniteElementModel,
    fields: Mapping[str, Any],
    stress: bool,
    subdivisions: int | None,
    per: str,
) -> str:
    comm = ranks_of(model) or MPI.COMM_SELF  # each rank has a body of its own
    with collective(comm):
        destination(path, "VTU file")
        stem, suffix = os.path.splitext(os.fspath(path))
        stem = stem if suffix.lower() in (".vtu", ".pvtu") else stem + suffix
        piece = f"{stem}_{comm.rank}.vtu" if comm.size > 1 else f"{stem}.vtu"
    if isinstance(model, FiniteElementModel):
        mesh = _of_body(model, fields, per)
    else:
        mesh = sampled_mesh(model, fields, subdivisions, stress, per)
    with collective(comm):
        if mesh:
            _write_piece(piece, mesh)
        else:
            with contextlib.suppress(FileNotFoundError):
                os.remove(destination(piece, "VTU file"))
    if comm.size == 1:
        return piece
    pieces = comm.gather((os.path.basename(piece), _arrays(mesh) if mesh else None))
    with collective(comm):
        if pieces is not None:  # on rank 0
            _write_index(f"{stem}.pvtu", {name: arrays for name, arrays in pieces if arrays})
    return f"{stem}.pvtu"


def _of_body(body: FiniteElementModel, fields: Mapping[str, Any], per: str) -> dict:
    """A body's own elements, or its nodes, as the arguments of a meshio mesh."""
    data = {"node": body.labels}
    data |= {
        f"{name} (m{per})": nodal_field(body, "write_vtu", name, given) for name, given in fields.items()
    }
    cells = body.elements or {"vertex": np.arange(len(body.labels))[:, None]}
    return {"points": body.places, "cells": list(cells.items()), "point_data": data}


def sampled_mesh(
    model: Model, fields: Mapping[str, Any], subdivisions: int | None, stress: bool, per: str = ""
) -> dict[str, Any]:
    """Fields at the points of a rank's cells as the arguments of a meshio mesh, none where it has no cells:
    quadrilaterals first, then the triangles at the scaling centres. Collective.
    """
    points, offset = [], 0
    data: dict[str, list[np.ndarray]] = {}
    blocks: dict[str, list] = {"quad": [], "triangle": []}
    facts: dict[str, list] = {"quad": [], "triangle": []}
    patches = sample(model.tips, dict(fields), subdivisions, stress)
    if not patches:
        return {}
    for patch in patches:
        points.append(_three(patch.positions.reshape(-1, 2)))
        for kind, corners in zip(blocks, point_grid_cells(patch)):
            blocks[kind].append(corners.reshape(-1, corners.shape[-1]) + offset)
            elements = np.repeat(model.layout.part.elements[patch.elements], corners.shape[1])
            ranks = np.full(len(elements), model.comm.rank)
            facts[kind].append(np.stack([elements, _materials(model, patch, len(elements)), ranks]))
        for name, values in patch.displacements.items():
            data.setdefault(f"{name} (m{per})", []).append(_three(values.reshape(-1, 2)))
        for name, values in patch.stresses.items():
            for component, column in zip(STRESSES, np.moveaxis(values, -1, 0)):
                data.setdefault(f"{name} {component} (Pa{per})", []).append(column.ravel())
        offset += len(points[-1])
    joined = [np.concatenate(facts[kind], axis=1).astype(np.int32) for kind in blocks]
    return {
        "points": np.concatenate(points),
        "cells": [(kind, np.concatenate(parts)) for kind, parts in blocks.items()],
        "point_data": {name: np.concatenate(parts) for name, parts in data.items()},
        "cell_data": dict(zip(("element", "material", "rank"), map(list, zip(*joined)))),
    }


def _materials(model: Model, patch: Patches, count: int) -> np.ndarray:
    """(count,): material of each cell, numbered ring by ring, edge by edge."""
    named = np.array(model.cells.named_materials(patch.material))
    if len(named) == 1:
        return np.full(count, named[0])
    pieces = patch.positions.shape[3] - 1
    ring = np.repeat(named, pieces)
    return np.tile(ring, count // len(ring))


def _three(values: np.ndarray) -> np.ndarray:
    """VTK knows vectors of three components alone; meshio would pad with a warning."""
    return np.column_stack([values, np.zeros(len(values))])


def _write_piece(path: str, mesh: dict) -> None:
    """The one door to meshio for VTU: compressed binary, complete or not there at all."""
    import meshio  # 0.2 s that only those who write VTU should wait for
    from meshio._mesh import topological_dimension

    topological_dimension.setdefault("wedge15", 3)  # which meshio 5.3 knows, but for this
    with replaced(path, "VTU file") as temporary:
        meshio.write(temporary, meshio.Mesh(**mesh), file_format="vtu")


def _arrays(mesh: dict) -> dict[str, dict[str, dict[str, str]]]:
    """What an index says of the arrays of a piece: type, name and components, by where they belong."""
    of = {"PPointData": mesh["point_data"], "PPoints": {"Points": mesh["points"]}}
    of["PCellData"] = {name: blocks[0] for name, blocks in mesh["cell_data"].items()}
    return {
        part: {
            name: {"type": a.dtype.name.capitalize(), "NumberOfComponents": str(a[:1].size)}
            for name, a in arrays.items()
        }
        for part, arrays in of.items()
    }


def _write_index(path: str, pieces: dict[str, Any]) -> None:
    """The PVTU file: names and types of the arrays, and the pieces."""
    root = xml.Element(
        "VTKFile", type="PUnstructuredGrid", version="0.1", byte_order="LittleEndian", header_type="UInt32"
    )
    grid = xml.SubElement(root, "PUnstructuredGrid", GhostLevel="0")
    for part, arrays in next(iter(pieces.values())).items():
        place = xml.SubElement(grid, part)
        for name, told in arrays.items():
            xml.SubElement(place, "PDataArray", Name=name, **told)
    for piece in pieces:
        xml.SubElement(grid, "Piece", Source=piece)
    write_xml(root, path, "PVTU file")


def write_xml(root: xml.Element, path: str, what: str) -> None:
    """An XML file, whole or not at all."""
    xml.indent(root)
    with replaced(path, what) as temporary:
        xml.ElementTree(root).write(temporary, encoding="utf-8", xml_declaration=True)

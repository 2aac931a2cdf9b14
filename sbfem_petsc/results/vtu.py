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
            _write_piece(piece, _of_body(model, fields, per))
            return piece
        patches = sample(model.tips, dict(fields), subdivisions, stress)
        if patches:
            _write_piece(piece, _mesh(model, patches, per))
        else:
            with contextlib.suppress(FileNotFoundError):
                os.remove(destination(piece, "VTU file"))
    if comm.size == 1:
        return piece
    pieces = comm.gather(os.path.basename(piece) if patches else None)
    with collective(comm):
        if pieces is not None:  # on rank 0
            _write_index(f"{stem}.pvtu", [p for p in pieces if p], fields, stress, per)
    return f"{stem}.pvtu"


def _displacement(name: str, per: str) -> str:
    return f"{name} (m{per})"


def _stress(name: str, component: str, per: str) -> str:
    return f"{name} {component} (Pa{per})"


def _of_body(body: FiniteElementModel, fields: Mapping[str, Any], per: str) -> dict:
    """A body's own elements, or its nodes, as the arguments of a meshio mesh."""
    data = {"node": body.labels}
    data |= {
        _displacement(name, per): nodal_field(body, "write_vtu", name, given)
        for name, given in fields.items()
    }
    cells = body.elements or {"vertex": np.arange(len(body.labels))[:, None]}
    return {"points": body.places, "cells": list(cells.items()), "point_data": data}


def sampled_mesh(
    model: Model, fields: Mapping[str, Any], subdivisions: int | None, stress: bool
) -> dict[str, Any]:
    """Fields at the points of all cells of a model on one rank, as the arguments of a meshio mesh."""
    return _mesh(model, sample(model.tips, dict(fields), subdivisions, stress), "")


def _mesh(model: Model, patches: list[Patches], per: str) -> dict:
    """All patches of a rank as the arguments of a meshio mesh: quadrilaterals first, then the triangles at
    the scaling centres.
    """
    points, offset = [], 0
    data: dict[str, list[np.ndarray]] = {}
    blocks: dict[str, list] = {"quad": [], "triangle": []}
    facts: dict[str, list] = {"quad": [], "triangle": []}
    for patch in patches:
        flat = patch.positions.reshape(-1, 2)
        points.append(flat)
        for kind, corners in zip(blocks, point_grid_cells(patch)):
            blocks[kind].append(corners.reshape(-1, corners.shape[-1]) + offset)
            elements = np.repeat(model.layout.part.elements[patch.elements], corners.shape[1])
            facts[kind].append(
                np.stack(
                    [
                        elements,
                        _materials(model, patch, len(elements)),
                        np.full(len(elements), model.comm.rank),
                    ]
                )
            )
        for name, values in patch.displacements.items():
            data.setdefault(_displacement(name, per), []).append(values.reshape(-1, 2))
        for name, values in patch.stresses.items():
            for component, column in zip(STRESSES, np.moveaxis(values, -1, 0)):
                data.setdefault(_stress(name, component, per), []).append(column.ravel())
        offset += len(flat)
    point_data = {name: np.concatenate(parts) for name, parts in data.items()}
    cells = [(kind, np.concatenate(parts)) for kind, parts in blocks.items()]
    joined = [np.concatenate(facts[kind], axis=1).astype(np.int32) for kind in blocks]
    cell_data = {
        name: [part[row] for part in joined] for row, name in enumerate(("element", "material", "rank"))
    }
    point_data = {name: _three(values) if values.ndim == 2 else values for name, values in point_data.items()}
    return {
        "points": _three(np.concatenate(points)),
        "cells": cells,
        "point_data": point_data,
        "cell_data": cell_data,
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

    with replaced(path, "VTU file") as temporary:
        meshio.write(temporary, meshio.Mesh(**mesh), file_format="vtu")


def _write_index(path: str, pieces: list[str], fields: Mapping, stress: bool, per: str) -> None:
    """The PVTU file: names and types of the arrays, and the pieces."""
    root = xml.Element(
        "VTKFile", type="PUnstructuredGrid", version="0.1", byte_order="LittleEndian", header_type="UInt32"
    )
    grid = xml.SubElement(root, "PUnstructuredGrid", GhostLevel="0")
    point_data = xml.SubElement(grid, "PPointData")
    for name in fields:
        xml.SubElement(
            point_data, "PDataArray", type="Float64", Name=_displacement(name, per), NumberOfComponents="3"
        )
    for name in fields if stress else ():
        for component in STRESSES:
            xml.SubElement(point_data, "PDataArray", type="Float64", Name=_stress(name, component, per))
    cell_data = xml.SubElement(grid, "PCellData")
    for name in ("element", "material", "rank"):
        xml.SubElement(cell_data, "PDataArray", type="Int32", Name=name)
    points = xml.SubElement(grid, "PPoints")
    xml.SubElement(points, "PDataArray", type="Float64", Name="Points", NumberOfComponents="3")
    for piece in pieces:
        xml.SubElement(grid, "Piece", Source=piece)
    write_xml(root, path, "PVTU file")


def write_xml(root: xml.Element, path: str, what: str) -> None:
    """An XML file, whole or not at all."""
    xml.indent(root)
    with replaced(path, what) as temporary:
        xml.ElementTree(root).write(temporary, encoding="utf-8", xml_declaration=True)

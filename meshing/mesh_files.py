"""Boundary meshes in files: HDF5 for ourselves, meshio's formats for other programs."""

from __future__ import annotations

import hashlib
import io
import os
import re
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from meshing.mesh_arrays import ContactPairs, Crack, MeshArrays, Tip
from meshing.whole_file import BadTarget, checked_path, read_whole, write_whole

Mesh = TypeVar("Mesh", bound=MeshArrays)

_FORMAT = "sbfem boundary mesh"
_VERSION = 5
_BLOCK = 512  # bytes ahead of the HDF5 content; the least that HDF5 knows
_ARRAYS = {
    "nodes": "coordinates of the nodes, m",
    "edges": "nodes of each edge at the Gauss-Lobatto-Legendre points",
    "element_start": "element_edges[element_start[e]:element_start[e + 1]] are the edges of S-element e, "
    "counter-clockwise",
    "element_edges": "edges of all S-elements, flat",
    "element_reversed": "true where the element runs through the edge from its last node to its first",
    "scaling_centres": "scaling centre of each S-element, m",
    "closed": "true: the edges form a loop; false: a chain whose scaling centre is on the boundary",
    "materials": "index into material_names",
}
_PAIRS = {
    "nodes": "node on the face the normal points to, node on the opposite face",
    "normal": "unit normal of the faces",
    "gap": "initial gap, m",
    "crack": "index of the crack",
    "position": "fraction of the crack's length from the first tip (0) to the mouth or the other (1)",
    "arc": "the same, m",
    "weight": "length of face that the pair stands for, m",
}
# Attributes of a crack's group and the fields they hold.
_CRACK = {
    "name": "name",
    "tip_m": "tip",
    "axis": "axis",
    "opening_rad": "opening",
    "length_m": "length",
    "tip_element": "tip_element",
}
_TIP = {
    "name": "name",
    "crack": "crack",
    "position_m": "position",
    "axis": "axis",
    "opening_rad": "opening",
    "element": "element",
    "faces": "faces",
    "arc_m": "arc",
}


def save(mesh: MeshArrays, path: str | os.PathLike[str]) -> None:
    """Write a mesh to an HDF5 file.

    The file describes itself (every data set has a "description"). Ahead of the HDF5 content stands a block
    of 512 bytes with the checksum of all that follows; HDF5's own tools skip it. An existing file is replaced
    once the new one is complete.

    Raises
    ------
    TypeError, ValueError
        `path` is no path, or the file cannot be written.
    """
    path = checked_path("save", path)
    content = _packed(mesh)

    def fill(place: Path) -> None:
        place.write_bytes(_head(content) + content)

    try:
        write_whole(path, fill)
    except OSError as error:
        raise ValueError(f"{path}: the mesh cannot be written there ({error.strerror or error}).") from error


def _packed(mesh: MeshArrays) -> bytes:
    """The HDF5 content of a file, without the block ahead of it."""
    import h5py

    buffer = io.BytesIO()
    with h5py.File(buffer, "w", userblock_size=_BLOCK) as file:
        file.attrs.update({"format": _FORMAT, "version": _VERSION, "order": mesh.order})
        file.attrs["clamped"] = mesh.clamped or ""
        for name, description in _ARRAYS.items():
            _write(file, name, getattr(mesh, name), description)
        names = np.array(mesh.material_names, dtype=h5py.string_dtype())
        _write(file, "material_names", names, "names of the materials")
        for name, description in _PAIRS.items():
            _write(file, f"pairs/{name}", getattr(mesh.pairs, name), f"contact pairs: {description}")
        # Names are stored as attributes: a data set's name may not contain a slash.
        for title, items in (("edge_sets", mesh.edge_sets), ("points", mesh.points)):
            group = file.create_group(title)
            for i, (name, numbers) in enumerate(items.items()):
                description = f"{title.replace('_', ' ')[:-1]} {name!r}"
                _write(group, str(i), np.asarray(numbers), description).attrs["name"] = name
        group = file.create_group("sector_materials")
        for element, sectors in mesh.sector_materials.items():
            _write(group, str(element), sectors, "material of the sector of each edge of an S-element")
        for title, parts, fields in (("cracks", mesh.cracks, _CRACK), ("tips", mesh.tips, _TIP)):
            group = file.create_group(title)
            for i, item in enumerate(parts):
                group.create_group(str(i)).attrs.update(
                    {key: getattr(item, name) for key, name in fields.items()}
                )
    return buffer.getvalue()[_BLOCK:]


def _head(content: bytes) -> bytes:
    """The block ahead of the HDF5 content: what the file is, and the content's checksum."""
    text = f"{_FORMAT}, version {_VERSION}\nsha256 {hashlib.sha256(content).hexdigest()}\n"
    return text.encode().ljust(_BLOCK, b"\n")


def load(path: str | os.PathLike[str], kind: type[Mesh]) -> Mesh:
    """Read a mesh that `save` has written, as an object of `kind`.

    Raises
    ------
    TypeError, ValueError
        `path` is no path; the file is missing, truncated, changed since it was written, of another version,
        or no boundary mesh; its arrays do not fit together (see `meshing.contact_checks` and
        `meshing.mesh_arrays.check`).
    """
    path = checked_path("load", path)
    stored = read_whole(path)
    head, content = stored[:_BLOCK], stored[_BLOCK:]
    found = re.match(rb"sbfem boundary mesh, version ([0-9]+)\n", head)
    if not found:
        older = stored.startswith(b"\x89HDF") and b"sbfem boundary mesh" in stored
        raise ValueError(
            f"{path}: it was written by an older version of this program, without a checksum; make the mesh "
            "again and save it."
            if older
            else f"{path}: it is not a boundary mesh that was saved here, or its beginning is damaged."
        )
    if int(found[1]) != _VERSION:
        raise ValueError(
            f"{path}: it has version {int(found[1])}, this program reads version {_VERSION}; make the mesh "
            "again and save it, or use the other program."
        )
    if head != _head(content):
        raise ValueError(
            f"{path}: its content is not what was written (the checksum differs): it is truncated or "
            "damaged; save the mesh again."
        )
    try:
        return kind(**_unpacked(stored))
    except (OSError, KeyError, RuntimeError, TypeError, AttributeError) as error:
        raise ValueError(f"{path}: it is no boundary mesh of this version ({error}).") from error
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error


def _unpacked(stored: bytes) -> dict[str, Any]:
    """Fields of the mesh in a file's bytes."""
    import h5py

    with h5py.File(io.BytesIO(stored), "r") as file:

        def values(name: str) -> np.ndarray:
            return _own(file, name, len(stored))[()]

        named = {
            title: {
                _own(file, f"{title}/{i}", len(stored)).attrs["name"]: values(f"{title}/{i}")
                for i in range(len(file[title]))
            }
            for title in ("edge_sets", "points")
        }
        cracks, tips = (
            [
                {name: _plain(file[title][str(i)].attrs[key]) for key, name in fields.items()}
                for i in range(len(file[title]))
            ]
            for title, fields in (("cracks", _CRACK), ("tips", _TIP))
        )
        return {
            "order": int(file.attrs["order"]),
            "clamped": str(file.attrs["clamped"]) or None,
            **{name: values(name) for name in _ARRAYS},
            "material_names": tuple(name.decode() for name in values("material_names").tolist()),
            "sector_materials": {
                int(element): values(f"sector_materials/{element}") for element in file["sector_materials"]
            },
            "edge_sets": named["edge_sets"],
            "points": {name: int(node) for name, node in named["points"].items()},
            "pairs": ContactPairs(**{name: values(f"pairs/{name}") for name in _PAIRS}),
            "cracks": tuple(Crack(**fields) for fields in cracks),
            "tips": tuple(Tip(**fields) for fields in tips),
        }


def _own(file, name: str, size: int):
    """A data set whose numbers are all in the file of `size` bytes: no link and no storage elsewhere."""
    import h5py

    dataset = file[name] if isinstance(file.get(name, getlink=True), h5py.HardLink) else None
    if not isinstance(dataset, h5py.Dataset) or dataset.external or dataset.is_virtual:
        raise KeyError(f"{name} is no data set of this file")
    if dataset.nbytes > size:
        raise KeyError(f"{name} is larger than the file")
    return dataset


def export(mesh: MeshArrays, path: str | os.PathLike[str]) -> None:
    """Write the edges in a format of meshio, chosen by the file's ending.

    Edges become polylines through their GLL nodes: p straight "line" cells each, so that curved edges keep
    all their nodes. (The high-order cells of VTK expect equidistant nodes, which GLL nodes are not.) Cell
    data: "edge", "element" (the first S-element it belongs to), "material"; "set_NAME" is 1 on the edges of a
    set. Point data: "gap" of contact pairs, -1 elsewhere.

    Raises
    ------
    ValueError
        meshio does not know the ending or the file cannot be written.
    """
    import meshio

    edge = np.repeat(np.arange(len(mesh.edges)), mesh.order)
    owner = np.zeros(len(mesh.edges), int)
    element = np.repeat(np.arange(mesh.elements), np.diff(mesh.element_start))
    owner[mesh.element_edges[::-1]] = element[::-1]
    lines = np.stack([mesh.edges[:, :-1].ravel(), mesh.edges[:, 1:].ravel()], axis=1)
    gap = np.full(len(mesh.nodes), -1.0)
    gap[mesh.pairs.nodes] = mesh.pairs.gap[:, None]
    cell_data = {"edge": [edge], "element": [owner[edge]], "material": [mesh.materials[owner[edge]]]}
    for name, numbers in mesh.edge_sets.items():
        cell_data[f"set_{name}"] = [np.isin(edge, numbers).astype(np.int32)]
    points = np.column_stack([mesh.nodes, np.zeros(len(mesh.nodes))])
    path = checked_path("export", path)
    exported = meshio.Mesh(points, [("line", lines)], point_data={"gap": gap}, cell_data=cell_data)
    try:
        write_whole(path, exported.write)
    except BadTarget:
        raise
    except Exception as error:  # meshio's writers raise what they like
        said = " ".join(str(getattr(error, "strerror", None) or error).split())
        raise ValueError(
            f"{path}: the mesh cannot be exported there ({said}); use an ending meshio writes, e.g. .vtu, "
            "and a folder you can write."
        ) from error


def _plain(value):
    """An HDF5 attribute as Python's own type."""
    return (
        tuple(value.tolist())
        if isinstance(value, np.ndarray)
        else value.item()
        if isinstance(value, np.generic)
        else value
    )


def _write(group, name: str, values: np.ndarray, description: str):
    dataset = group.create_dataset(name, data=values)
    dataset.attrs["description"] = description
    return dataset

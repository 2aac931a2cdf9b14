"""Boundary meshes in files: HDF5 for ourselves, meshio's formats for other programs."""

from __future__ import annotations

import contextlib
import os
from pathlib import Path
from typing import TypeVar

import numpy as np

from meshing.mesh_arrays import ContactPairs, Crack, MeshArrays, Tip

Mesh = TypeVar("Mesh", bound=MeshArrays)

_FORMAT = "sbfem boundary mesh"
_VERSION = 2
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
    "position": "fraction of the crack's length from the tip (0) to the mouth (1)",
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
}


def save(mesh: MeshArrays, path: str | Path) -> None:
    """Write a mesh to an HDF5 file.

    The file describes itself (every data set has a "description"). It is written under a temporary name in
    the same folder and then renamed.

    Raises
    ------
    ValueError
        The file cannot be written.
    """
    import h5py

    path = Path(path)
    temporary = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        with h5py.File(temporary, "w") as file:
            file.attrs.update(
                {"format": _FORMAT, "version": _VERSION, "order": mesh.order, "clamped": mesh.clamped or ""}
            )
            for name, description in _ARRAYS.items():
                _write(file, name, getattr(mesh, name), description)
            _write(
                file,
                "material_names",
                np.array(mesh.material_names, dtype=h5py.string_dtype()),
                "names of the materials",
            )
            for name, description in _PAIRS.items():
                _write(file, f"pairs/{name}", getattr(mesh.pairs, name), f"contact pairs: {description}")
            # Names are stored as attributes: a data set's name may not contain a slash.
            for title, items in (("edge_sets", mesh.edge_sets), ("points", mesh.points)):
                group = file.create_group(title)
                for i, (name, numbers) in enumerate(items.items()):
                    _write(
                        group, str(i), np.asarray(numbers), f"{title.replace('_', ' ')[:-1]} {name!r}"
                    ).attrs["name"] = name
            for title, items, fields in (("cracks", mesh.cracks, _CRACK), ("tips", mesh.tips, _TIP)):
                group = file.create_group(title)
                for i, item in enumerate(items):
                    group.create_group(str(i)).attrs.update(
                        {key: getattr(item, name) for key, name in fields.items()}
                    )
            # The last thing written; a file without it is not complete.
            file.attrs["complete"] = True
        with open(temporary, "rb") as file:
            os.fsync(file.fileno())
        os.replace(temporary, path)
    except OSError as error:
        with contextlib.suppress(OSError):
            temporary.unlink()
        raise ValueError(f"{path}: the mesh cannot be written there ({error.strerror or error}).") from error


def load(path: str | Path, kind: type[Mesh]) -> Mesh:
    """Read a mesh that `save` has written, as an object of `kind`.

    Raises
    ------
    ValueError
        The file is missing, truncated, or not a boundary mesh.
    """
    import h5py

    path = Path(path)
    if not path.is_file():
        raise ValueError(f"{path}: there is no such file.")
    try:
        with h5py.File(path, "r") as file:
            if file.attrs.get("format") != _FORMAT:
                raise ValueError(f"{path}: it is an HDF5 file but not a boundary mesh.")
            if file.attrs["version"] > _VERSION:
                raise ValueError(
                    f"{path}: it has version {file.attrs['version']}, this program reads up to {_VERSION}; "
                    "update the program."
                )
            if file.attrs["version"] < _VERSION:
                raise ValueError(
                    f"{path}: it has version {file.attrs['version']}, which knows no tips; save the "
                    "mesh again."
                )
            if not file.attrs.get("complete", False):
                raise ValueError(f"{path}: it is not complete; save the mesh again.")
            sets, points = (
                {group[str(i)].attrs["name"]: group[str(i)][()] for i in range(len(group))}
                for group in (file["edge_sets"], file["points"])
            )
            cracks, tips = (
                [
                    {name: _plain(file[title][str(i)].attrs[key]) for key, name in fields.items()}
                    for i in range(len(file[title]))
                ]
                for title, fields in (("cracks", _CRACK), ("tips", _TIP))
            )
            return kind(
                order=int(file.attrs["order"]),
                clamped=str(file.attrs.get("clamped", "")) or None,
                **{name: file[name][()] for name in _ARRAYS},
                material_names=tuple(file["material_names"].asstr()[()]),
                edge_sets=sets,
                points={name: int(node) for name, node in points.items()},
                pairs=ContactPairs(**{name: file[f"pairs/{name}"][()] for name in _PAIRS}),
                cracks=tuple(Crack(**fields) for fields in cracks),
                tips=tuple(Tip(**fields) for fields in tips),
            )
    except (OSError, KeyError, RuntimeError) as error:  # h5py's ways to say that bytes are missing
        raise ValueError(f"{path}: it is truncated, corrupt or not an HDF5 file ({error}).") from error


def export(mesh: MeshArrays, path: str | Path) -> None:
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
    try:
        meshio.Mesh(points, [("line", lines)], point_data={"gap": gap}, cell_data=cell_data).write(path)
    except (OSError, meshio.ReadError, meshio.WriteError, KeyError) as error:
        raise ValueError(
            f"{path}: the mesh cannot be exported there ({error}); use an ending meshio writes, e.g. .vtu, "
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

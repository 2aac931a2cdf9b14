"""Boundary meshes in files: HDF5 for ourselves, meshio's formats for other programs."""

from __future__ import annotations

import hashlib
import io
import os
import re
from collections.abc import Iterator
from dataclasses import fields
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from meshing.input_checks import path as checked_path
from meshing.mesh_arrays import ContactPairs, Crack, MeshArrays, Tip
from meshing.whole_file import read_whole, replaced

_FORMAT = "sbfem boundary mesh"
_VERSION = 6
_BLOCK = 512  # bytes ahead of the HDF5 content; the least that HDF5 knows
_SETS = {"edge_sets": "edge set", "points": "point"}


Mesh = TypeVar("Mesh", bound=MeshArrays)


def save(mesh: MeshArrays, path: str | os.PathLike[str]) -> None:
    """Write a mesh to an HDF5 file.

    The file describes itself (every data set has a "description"). Ahead of the HDF5 content stands a block
    of 512 bytes with the checksum of all that follows; HDF5's own tools skip it. An existing mesh is replaced
    once the new one is complete.

    Raises
    ------
    TypeError, ValueError
        `path` is no path, the file cannot be written, or it would replace one that holds no mesh.
    """
    path = checked_path("save", "path", path)
    content = _packed(mesh)
    with replaced(path, "mesh") as temporary:
        if os.path.exists(path) and not _FORMAT.encode().startswith(_beginning(path)):
            raise ValueError(f"save: path {path!r} would replace a file that holds no mesh; name another one")
        Path(temporary).write_bytes(_head(content) + content)


def _beginning(path: str) -> bytes:
    """What tells a mesh, of an empty file nothing."""
    with open(path, "rb") as file:
        return file.read(len(_FORMAT))


def _packed(mesh: MeshArrays) -> bytes:
    """The HDF5 content of a file, without the block ahead of it."""
    import h5py

    buffer = io.BytesIO()
    with h5py.File(buffer, "w", userblock_size=_BLOCK) as file:
        file.attrs.update({"format": _FORMAT, "version": _VERSION, "order": mesh.order})
        file.attrs["clamped"] = mesh.clamped or ""
        for owner, group in ((mesh, file), (mesh.pairs, file.create_group("pairs"))):
            for item in _arrays(owner):
                _write(group, item.name, getattr(owner, item.name), item.metadata["description"])
        names = np.array(mesh.material_names, dtype=h5py.string_dtype())
        _write(file, "material_names", names, "names of the materials")
        # Names are stored as attributes: a data set's name may not contain a slash.
        for title, what in _SETS.items():
            group = file.create_group(title)
            for i, (name, numbers) in enumerate(getattr(mesh, title).items()):
                _write(group, str(i), np.asarray(numbers), f"{what} {name!r}").attrs["name"] = name
        group = file.create_group("sector_materials")
        for element, sectors in mesh.sector_materials.items():
            _write(group, str(element), sectors, "material of the sector of each edge of an S-element")
        for title in ("cracks", "tips"):
            group = file.create_group(title)
            group.attrs["description"] = "lengths and places in m, angles in radian"
            for i, item in enumerate(getattr(mesh, title)):
                group.create_group(str(i)).attrs.update(vars(item))
    return buffer.getvalue()[_BLOCK:]


def _arrays(owner: Any) -> Iterator[Any]:
    """Fields of a class, or of an object of it, that are arrays."""
    return (item for item in fields(owner) if item.metadata)


def _write(group: Any, name: str, values: np.ndarray, description: str) -> Any:
    dataset = group.create_dataset(name, data=values)
    dataset.attrs["description"] = description
    return dataset


def _head(content: bytes) -> bytes:
    """The block ahead of the HDF5 content: what the file is, and the content's checksum."""
    text = f"{_FORMAT}, version {_VERSION}\nsha256 {hashlib.sha256(content).hexdigest()}\n"
    return text.encode().ljust(_BLOCK, b"\n")


def load(path: str | os.PathLike[str], kind: type[Mesh]) -> Mesh:
    """Read a mesh that `save` has written.

    Raises
    ------
    TypeError, ValueError
        `path` is no path; the file is missing, truncated, changed since it was written, of another version,
        or no boundary mesh; its arrays do not fit together (see `meshing.mesh_checks`).
    """
    path = checked_path("load", "path", path)
    stored = read_whole(Path(path))
    head, content = stored[:_BLOCK], stored[_BLOCK:]
    found = re.match(rb"sbfem boundary mesh, version ([0-9]+)\n", head)
    if not found:
        raise ValueError(
            f"{path}: it is not a boundary mesh that was saved here, or its beginning is damaged."
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

        def arrays(kind: type, group: str = "") -> dict[str, np.ndarray]:
            return {item.name: values(group + item.name) for item in _arrays(kind)}

        def named(title: str) -> dict[str, np.ndarray]:
            names = [f"{title}/{i}" for i in range(len(file[title]))]
            return {_own(file, name, len(stored)).attrs["name"]: values(name) for name in names}

        def parts(title: str, kind: type[Any]) -> tuple[Any, ...]:
            found = (file[title][str(i)].attrs for i in range(len(file[title])))
            return tuple(
                kind(**{item.name: _plain(attrs[item.name]) for item in fields(kind)}) for attrs in found
            )

        return {
            "order": int(file.attrs["order"]),
            "clamped": str(file.attrs["clamped"]) or None,
            **arrays(MeshArrays),
            "material_names": tuple(name.decode() for name in values("material_names").tolist()),
            "sector_materials": {
                int(element): values(f"sector_materials/{element}") for element in file["sector_materials"]
            },
            "edge_sets": named("edge_sets"),
            "points": {name: int(node) for name, node in named("points").items()},
            "pairs": ContactPairs(**arrays(ContactPairs, "pairs/")),
            "cracks": parts("cracks", Crack),
            "tips": parts("tips", Tip),
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
    set. Point data: "gap" of contact pairs, -1 elsewhere. Some formats have no room for cell data (Exodus):
    they get points and lines.

    Raises
    ------
    ValueError
        meshio does not know the ending, or the file cannot be written.
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
    path = checked_path("export", "path", path)
    exported = meshio.Mesh(points, [("line", lines)], point_data={"gap": gap}, cell_data=cell_data)
    with replaced(path, "mesh") as temporary:
        try:
            exported.write(temporary)
        except OSError:
            raise
        except Exception as error:  # meshio's writers raise what they like
            said = " ".join(str(error).split())
            raise ValueError(
                f"mesh {path!r} cannot be exported ({said}); use an ending that meshio writes, e.g. .vtu"
            ) from error


def _plain(value: Any) -> Any:
    """An HDF5 attribute as Python's own type."""
    if isinstance(value, np.ndarray):
        return tuple(value.tolist())
    return value.item() if isinstance(value, np.generic) else value

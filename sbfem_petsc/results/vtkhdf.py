"""One VTKHDF file of all instants of a motion, for ParaView 5.12 and newer: an unstructured grid that stays,
and values that change.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import h5py
import numpy as np

from meshing.whole_file import replaced

from ..record.files import for_hdf5

# VTK's numbers of cells.
_TYPES = {"quad": 9, "triangle": 5}


def write_series(path: str, times: np.ndarray, meshes: Iterator[dict[str, Any]]) -> None:
    """Write the grid of the first of several meshes and the values at the points of each.

    Parameters
    ----------
    path : str
    times : (n,) array
        s
    meshes : iterator of n dict
        Arguments of a meshio mesh, of one grid.
    """
    with (
        replaced(path, "VTKHDF file") as temporary,
        for_hdf5(temporary) as target,
        h5py.File(target, "w") as file,
    ):
        root = file.create_group("VTKHDF")
        root.attrs["Version"] = np.array([2, 0])
        root.attrs.create("Type", b"UnstructuredGrid", dtype=h5py.string_dtype("ascii", 16))
        values = root.create_group("PointData")
        for k, mesh in enumerate(meshes):
            count = len(mesh["points"])
            if k == 0:
                _grid(root, mesh)
            for name, array in mesh["point_data"].items():
                if k == 0:
                    shape = (len(times) * count, *array.shape[1:])
                    values.create_dataset(name, shape, array.dtype, chunks=array.shape, compression="gzip")
                values[name][k * count : (k + 1) * count] = array
            target.let_signals()
        _steps(root, times, count, list(values))


def _grid(root: h5py.Group, mesh: dict[str, Any]) -> None:
    cells = [block for _, block in mesh["cells"]]
    sizes = np.concatenate([np.full(len(block), block.shape[1]) for block in cells])
    root["Points"] = mesh["points"]
    root["Connectivity"] = np.concatenate([np.ravel(block) for block in cells]).astype(np.int64)
    root["Offsets"] = np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64)
    root["Types"] = np.concatenate(
        [np.full(len(block), _TYPES[kind], np.uint8) for kind, block in mesh["cells"]]
    )
    root["NumberOfPoints"] = [len(mesh["points"])]
    root["NumberOfCells"] = [len(sizes)]
    root["NumberOfConnectivityIds"] = [int(sizes.sum())]
    for name, parts in mesh["cell_data"].items():
        root.require_group("CellData")[name] = np.concatenate(parts)


def _steps(root: h5py.Group, times: np.ndarray, count: int, names: list[str]) -> None:
    """Times, and where the parts of each begin: the grid's at 0, the values' one behind the other."""
    steps, many = root.create_group("Steps"), len(times)
    steps.attrs["NSteps"] = many
    steps["Values"] = times
    steps["NumberOfParts"] = np.ones(many, np.int64)
    for name in ("PartOffsets", "PointOffsets"):
        steps[name] = np.zeros(many, np.int64)
    for name in ("CellOffsets", "ConnectivityIdOffsets"):
        steps[name] = np.zeros((many, 1), np.int64)
    offsets = steps.create_group("PointDataOffsets")
    for name in names:
        offsets[name] = np.arange(many, dtype=np.int64) * count
    for name in root.get("CellData", ()):
        steps.require_group("CellDataOffsets")[name] = np.zeros(many, np.int64)

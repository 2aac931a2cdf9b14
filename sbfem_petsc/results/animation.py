"""Field snapshots of a motion for ParaView: VTU (PVTU) files and a PVD file that gives their times."""

from __future__ import annotations

import os
import xml.etree.ElementTree as xml
from typing import Any

import numpy as np

from ..checks import flag, integer, optional_integer, path, real_array, text
from ..motion.history import Motion, model_with_fields
from ..petsc import MPI
from ..ranks.parallel import agreed, collective, ranks_of
from ..system.model import Model
from ..writing import check_output_folder
from .vtkhdf import write_series
from .vtu import sampled_mesh, write_vtu, write_xml


@agreed()
def write_animation(
    folder: str,
    motion: Motion,
    *,
    times: Any = None,
    every: int | None = None,
    name: str = "history",
    stress: bool = False,
    subdivisions: int | None = None,
) -> str:
    """Write displacement fields at chosen instants, for ParaView. Collective.

    Parameters
    ----------
    folder : str
        Made if it is missing. A name that ends in .vtkhdf is that of one file of all instants, which ParaView
        5.12 and newer open; on one rank.
    motion : History or Orbit
        Of a model, reduced or not, or of a body; the fields are those of `motion.field`, the residual
        flexibility of contact and loads included.
    times : sequence of float, optional
        s; the nearest recorded instants are taken.
    every : int, optional
        Every so many recorded instants. Default: about 100 in all. Give at most one of `times` and `every`.
    name : str
        Files are <name>.pvd and <name>_0000.vtu, <name>_0001.vtu ...
    stress, subdivisions
        See `write_vtu`.

    Returns
    -------
    str
        The PVD or VTKHDF file to open.

    Raises
    ------
    TypeError, ValueError
        If an instant makes no sense or a file cannot be written; on all ranks.
    SolveError
        If the motion keeps no fields: that of matrices, or read from a file, or a long one of an unreduced
        model.
    """
    model = model_with_fields("write_animation", motion)
    comm = ranks_of(model) or MPI.COMM_SELF
    with collective(comm):
        instants = _instants(motion.time, times, every)
        text("write_animation", "name", name)
        if os.path.basename(name) != name or not name.isprintable():
            raise ValueError(
                f"write_animation: name = {name!r} must be the beginning of a file's name, without a folder"
            )
        flag("write_animation", "stress", stress)
        subdivisions = optional_integer("write_animation", "subdivisions", subdivisions, least=1, most=100)
        path("write_animation", "folder", folder)
        single = os.fspath(folder).endswith(".vtkhdf")
        if single and (comm.size > 1 or not isinstance(model, Model)):
            raise ValueError(
                f"write_animation: folder = {os.fspath(folder)!r} asks for one file, which one rank writes "
                "of a Model; name a folder instead"
            )
    fields = ({"displacement": motion.field(float(motion.time[k]))} for k in instants)
    if single and isinstance(model, Model):
        meshes = (sampled_mesh(model, field, subdivisions, stress) for field in fields)
        write_series(os.fspath(folder), motion.time[instants], meshes)
        return os.fspath(folder)
    folder = check_output_folder(folder, comm)
    files = [
        write_vtu(
            os.path.join(folder, f"{name}_{number:04d}.vtu"),
            model,
            field,
            stress=stress,
            subdivisions=subdivisions,
        )
        for number, field in enumerate(fields)
    ]
    whole = os.path.join(folder, f"{name}.pvd")
    with collective(comm):
        if comm.rank == 0:
            _write_pvd(whole, motion.time[instants], files)
    return whole


def _instants(time: np.ndarray, times: Any, every: int | None) -> np.ndarray:
    """Indices of the recorded instants to write."""
    if times is not None and every is not None:
        raise ValueError("write_animation: give times or every, not both")
    if times is None:
        step = (
            max(1, len(time) // 100) if every is None else integer("write_animation", "every", every, least=1)
        )
        return np.arange(0, len(time), step)
    one = not isinstance(times, (list, tuple, np.ndarray))
    chosen = real_array("write_animation", "times", times, 0 if one else 1, "s").ravel()
    if not len(chosen) or chosen.min() < time[0] or chosen.max() > time[-1] * (1.0 + 1e-9):
        raise ValueError(
            f"write_animation: times must be finite and between {time[0]:g} and {time[-1]:.6g} s"
        )
    return np.unique([int(np.abs(time - at).argmin()) for at in chosen])


def _write_pvd(path: str, times: np.ndarray, files: list[str]) -> None:
    root = xml.Element("VTKFile", type="Collection", version="0.1", byte_order="LittleEndian")
    collection = xml.SubElement(root, "Collection")
    for time, file in zip(times, files):
        xml.SubElement(
            collection, "DataSet", timestep=repr(float(time)), part="0", file=os.path.basename(file)
        )
    write_xml(root, path, "PVD file")

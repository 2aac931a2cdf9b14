"""Field snapshots of a history for ParaView: VTU (PVTU) files and a PVD file that gives their times."""

from __future__ import annotations

import os
import xml.etree.ElementTree as xml

import numpy as np

from ..analysis.modal import Modal
from ..analysis.transient import History
from ..parallel import collective
from .hdf5 import check_output_folder
from .vtu import write_vtu

# Relative difference of a mode at the named points between the history's reduction and the modes given.
SAME_MODE = 1e-3


def write_animation(
    folder: str,
    modal: Modal,
    history: History,
    times=None,
    every: int | None = None,
    name: str = "history",
    stress: bool = False,
    subdivisions: int | None = None,
) -> str:
    """Write displacement fields at chosen instants, for ParaView. Collective.

    Parameters
    ----------
    folder : str
        Made if it is missing.
    modal : Modal
        Modes of the same model, `modal(model, count=len(history.reduction.omega))`; fewer give a smoother
        field.
    history : History
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
        The PVD file to open.

    Raises
    ------
    ValueError
        If the modes are another model's, an instant makes no sense or a file cannot be written; on all ranks.

    Notes
    -----
    Fields are sums of modes. The static residual flexibility of contact and loads is left out: displacements
    at the points of `history.displacement` include it, the fields do not, and the stress close to a contact
    pair or a point force is too smooth.
    """
    model = modal.model
    folder = check_output_folder(folder, model.comm)
    with collective(model.comm):
        instants = _instants(history.time, times, every)
        signs = _signs(modal, history)
    used = len(signs)
    vector = model.stiffness.createVecRight()
    files = []
    try:
        for number, instant in enumerate(instants):
            vector.array = modal.shapes[:, :used] @ (signs * history.modal_displacement[instant, :used])
            files.append(
                write_vtu(
                    os.path.join(folder, f"{name}_{number:04d}.vtu"),
                    model,
                    {"displacement": model.nodal(vector)},
                    stress,
                    subdivisions,
                )
            )
    finally:
        vector.destroy()
    path = os.path.join(folder, f"{name}.pvd")
    with collective(model.comm):
        if model.comm.rank == 0:
            try:
                _write_pvd(path, history.time[instants], files)
            except OSError as error:
                raise ValueError(f"PVD file {path!r} cannot be written: {error.strerror or error}") from None
    return path


def _instants(time: np.ndarray, times, every: int | None) -> np.ndarray:
    """Indices of the recorded instants to write."""
    if times is not None and every is not None:
        raise ValueError("write_animation: give times or every, not both")
    if times is None:
        if every is None:
            every = max(1, len(time) // 100)
        if isinstance(every, bool) or not isinstance(every, (int, np.integer)) or every < 1:
            raise ValueError(f"write_animation: every = {every!r} must be a positive integer")
        return np.arange(0, len(time), every)
    times = np.atleast_1d(np.asarray(times, dtype=float))
    if (
        times.ndim != 1
        or not len(times)
        or not np.isfinite(times).all()
        or times.min() < time[0]
        or times.max() > time[-1] * (1.0 + 1e-9)
    ):
        raise ValueError(
            f"write_animation: times must be finite and between {time[0]:g} and {time[-1]:.6g} s"
        )
    right = (
        np.clip(np.searchsorted(time, times), 1, max(len(time) - 1, 1))
        if len(time) > 1
        else np.zeros(len(times), dtype=int)
    )
    left = np.maximum(right - 1, 0)
    return np.unique(np.where(times - time[left] < time[right] - times, left, right))


def _signs(modal: Modal, history: History) -> np.ndarray:
    """Sign of each given mode relative to the history's; another solve may have turned it round."""
    r = history.reduction
    used = min(len(modal.frequencies), len(r.omega))
    other = "write_animation: the modes are not those of the history's model"
    if not np.allclose(modal.frequencies[:used], r.frequencies[:used], rtol=1e-5):
        raise ValueError(f"{other}: their frequencies differ")
    if set(r.points) - set(modal.point_shapes) or not r.points:
        raise ValueError(f"{other}: named points are missing")
    shapes = np.stack([modal.point_shapes[p][:used] for p in r.points])  # (points, modes, 2)
    expected = np.moveaxis(r.sensor_modes[:, :, :used], 1, 2)
    signs = np.where((shapes * expected).sum(axis=(0, 2)) < 0.0, -1.0, 1.0)
    distance = np.sqrt(((signs[:, None] * shapes - expected) ** 2).sum(axis=(0, 2)))
    if (distance > SAME_MODE * np.sqrt((expected**2).sum(axis=(0, 2)))).any():
        raise ValueError(f"{other}: mode {int(np.argmax(distance)) + 1} differs at the named points")
    return signs


def _write_pvd(path: str, times: np.ndarray, files: list[str]) -> None:
    root = xml.Element("VTKFile", type="Collection", version="0.1", byte_order="LittleEndian")
    collection = xml.SubElement(root, "Collection")
    for time, file in zip(times, files):
        xml.SubElement(
            collection, "DataSet", timestep=repr(float(time)), part="0", file=os.path.basename(file)
        )
    xml.indent(root)
    temporary = f"{path}.part"
    xml.ElementTree(root).write(temporary, encoding="utf-8", xml_declaration=True)
    os.replace(temporary, path)

"""The pictures and ParaView files of a case's results: the one place of a study that draws single results."""

from __future__ import annotations

import os
from typing import Any

from meshing.folder_index import make_output_folder

from ..parallel import on_root
from ..plot.animation import animate_crack
from ..plot.basins import plot_basins
from ..plot.branches import plot_branches
from ..plot.crack import plot_crack
from ..plot.drawing import save_picture
from ..plot.fields import plot_contact, plot_modes
from ..plot.histories import plot_history, plot_load_history
from ..plot.loci import plot_loci
from ..plot.meshes import plot_discretisation
from ..plot.orbits import plot_harmonics, plot_multipliers, plot_orbit
from ..plot.sweeps import plot_swept
from ..plot.tones import plot_backbone, plot_lines, plot_sidebands
from ..plot.tori import plot_quasi_periodic
from ..results.vtu import write_modes, write_vtu
from .case.case import Case
from .solve import modulation

# Cracks of a model that are drawn.
MOST_CRACKS = 4
# Kinds of analysis whose result is a motion.
MOVING = ("transient", "periodic", "modulation")


def draw(case: Case, name: str, result: Any, model: Any, folder: str) -> None:
    """Draw what the case's [output] asks for an analysis. Collective.

    Parameters
    ----------
    case : Case
    name : str
        Analysis.
    result
        Of that analysis.
    model : Model or None
        None where only a recorded result is at hand.
    folder : str
        Made if it is missing.
    """
    output, table = case.tables.output, case.tables.analyses[name]
    comm = _communicator(model)
    on_root(comm, lambda: make_output_folder(folder))
    stem = os.path.join(folder, name)
    if output.pictures:
        drawers = {
            "modal": _modal,
            "static": _static,
            "load_history": _load_history,
            "transient": _transient,
            "periodic": _periodic,
            "modulation": _modulation,
            "frequency_response": _branch,
            "load_response": _branch,
            "quasi_periodic": _lines,
            "quasi_periodic_response": _own_tones,
            "backbone": _backbone,
            "locus": _loci,
            "basins": _basins,
            "swept_response": _swept,
        }
        drawers[table.kind](case, name, result, model, stem)
    if output.animation and table.kind in MOVING and model is not None:
        animate(result, stem)
    if output.vtu and model is not None:
        write_fields(table.kind, result, model, stem)


def animate(motion: Any, stem: str) -> None:
    """Draw the first crack over a motion, where there is one that keeps its fields. Collective."""
    if motion.reduced is not None and motion.reduced.model.cracks:
        animate_crack(motion, f"{stem}_crack1.gif")


def draw_mesh(mesh: Any, path: str, comm: Any) -> None:
    """Draw a discretisation. Collective; the mesh on rank 0 at least."""
    _save(plot_discretisation(mesh, comm=comm), path, comm)


def _save(axes: Any, path: str, comm: Any) -> None:
    """Write a picture on rank 0, where its axes are."""
    on_root(comm, lambda: save_picture(axes, path))


def _communicator(model: Any) -> Any:
    from mpi4py import MPI

    return MPI.COMM_WORLD if model is None else model.comm


def _point(case: Case, known: Any) -> str | None:
    """The point that a picture shows: the first that the case asks for, else the free end's corner."""
    known = list(known)
    chosen = [point for point in case.tables.output.points or () if point in known]
    return chosen[0] if chosen else "A" if "A" in known else known[0] if known else None


def _modal(case: Case, name: str, result: Any, model: Any, stem: str) -> None:
    _save(plot_modes(result), f"{stem}_modes.png", _communicator(model))


def _static(case: Case, name: str, result: Any, model: Any, stem: str) -> None:
    model = result.model  # a finer one where an accuracy is asked for
    for crack in range(min(len(model.cracks), MOST_CRACKS)):
        axes = plot_crack(model, {name: result}, crack)
        _save(axes, f"{stem}_crack{crack + 1}.png", model.comm)
        if result.contact_resultant > 0.0:
            axes = plot_contact({name: result}, crack)
            _save(axes, f"{stem}_contact{crack + 1}.png", model.comm)


def _load_history(case: Case, name: str, result: Any, model: Any, stem: str) -> None:
    point = _point(case, model.points)
    if point is not None:
        _save(
            plot_load_history(result, point, title=name, comm=model.comm),
            f"{stem}_history.png",
            model.comm,
        )


def _transient(case: Case, name: str, result: Any, model: Any, stem: str) -> None:
    point = _point(case, result.points)
    if point is not None:
        comm = _communicator(model)
        _save(plot_history(result, point, title=name, comm=comm), f"{stem}_history.png", comm)


def _periodic(case: Case, name: str, result: Any, model: Any, stem: str) -> None:
    point = _point(case, result.points)
    if point is None:
        return
    comm = _communicator(model)
    _save(plot_harmonics({name: result}, point, comm=comm), f"{stem}_harmonics.png", comm)
    if result.reduced is not None:
        _save(plot_orbit(result, point, title=name, comm=comm), f"{stem}_orbit.png", comm)
    if len(result.multipliers):
        _save(plot_multipliers(result, title=name, comm=comm), f"{stem}_multipliers.png", comm)


def _modulation(case: Case, name: str, result: Any, model: Any, stem: str) -> None:
    table, comm = case.tables.analyses[name], _communicator(model)
    found = modulation(table, result)["sidebands"]
    title = f"$u_{table.direction}$({table.point}), modulation index {found.modulation_index:.3g}"
    _save(plot_sidebands({name: found}, title=title, comm=comm), f"{stem}_sidebands.png", comm)
    _periodic(case, name, result, model, stem)


def _branch(case: Case, name: str, result: Any, model: Any, stem: str) -> None:
    point = _point(case, result.points)
    if point is not None:
        comm = _communicator(model)
        _save(plot_branches({name: result}, point, comm=comm), f"{stem}_curve.png", comm)


def _lines(case: Case, name: str, result: Any, model: Any, stem: str) -> None:
    point = _point(case, result.points)
    if point is not None:
        order = case.tables.analyses[name].order
        comm = _communicator(model)
        _save(plot_lines({name: result}, point, order=order, comm=comm), f"{stem}_lines.png", comm)


def _own_tones(case: Case, name: str, result: Any, model: Any, stem: str) -> None:
    point = _point(case, result.motions[0].points)
    if point is not None:
        comm = _communicator(model)
        axes = plot_quasi_periodic(result, point, title=name, comm=comm)
        _save(axes, f"{stem}_own_tones.png", comm)


def _backbone(case: Case, name: str, result: Any, model: Any, stem: str) -> None:
    comm = _communicator(model)
    _save(plot_backbone({name: result}, comm=comm), f"{stem}_backbone.png", comm)


def _loci(case: Case, name: str, result: Any, model: Any, stem: str) -> None:
    if result:
        comm = _communicator(model)
        _save(plot_loci(result, title=name, comm=comm), f"{stem}_loci.png", comm)


def _swept(case: Case, name: str, result: Any, model: Any, stem: str) -> None:
    point = _point(case, result[0].points)
    if point is not None:
        comm, least = _communicator(model), case.tables.analyses[name].least
        axes = plot_swept(None, result, point, least=least, title=name, comm=comm)
        _save(axes, f"{stem}_swept.png", comm)


def _basins(case: Case, name: str, result: Any, model: Any, stem: str) -> None:
    if len(result.axes) == 2 and min(result.reached.shape) > 1:
        comm = _communicator(model)
        _save(plot_basins(result, title=name, comm=comm), f"{stem}_basins.png", comm)


def write_fields(kind: str, result: Any, model: Any, stem: str) -> None:
    """Write modes or static displacements for ParaView. Collective."""
    if kind == "static":
        write_vtu(f"{stem}.vtu", result.model, {"displacement": result})
    elif kind == "modal":
        write_modes(f"{stem}.vtu", result)

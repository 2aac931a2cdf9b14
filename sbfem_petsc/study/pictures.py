"""The pictures and ParaView files of a case's results: the one place of a study that draws single results."""

from __future__ import annotations

import os
from typing import Any

import numpy as np

from ..parallel import on_root
from .case import Case

MILLI = 1e3
# Cracks of a model that are drawn.
MOST_CRACKS = 4


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
    on_root(comm, lambda: os.makedirs(folder, exist_ok=True))
    stem = os.path.join(folder, name)
    if output.pictures:
        drawers = {
            "modal": _modal,
            "static": _static,
            "transient": _transient,
            "periodic": _periodic,
            "modulation": _periodic,
            "frequency_response": _curve,
            "load_response": _curve,
        }
        if table.kind in drawers:
            drawers[table.kind](case, name, result, model, stem)
    if output.vtu and model is not None:
        write_fields(table.kind, result, model, stem)


def draw_mesh(mesh: Any, path: str, comm: Any) -> None:
    """Draw a discretisation. Collective; the mesh on rank 0 at least."""
    from ..plot.meshes import plot_discretisation

    plot_discretisation(mesh, path, comm)


def _communicator(model: Any) -> Any:
    from mpi4py import MPI

    return MPI.COMM_WORLD if model is None else model.comm


def _point(case: Case, known: Any) -> str | None:
    """The point that a picture shows: the first that the case asks for, else the free end's corner."""
    known = list(known)
    chosen = [point for point in case.tables.output.points or () if point in known]
    return chosen[0] if chosen else "A" if "A" in known else known[0] if known else None


def _modal(case: Case, name: str, result: Any, model: Any, stem: str) -> None:
    from ..plot.fields import plot_modes

    plot_modes(result, f"{stem}_modes.png")


def _static(case: Case, name: str, result: Any, model: Any, stem: str) -> None:
    from ..plot.fields import plot_contact, plot_crack

    for crack in range(min(len(model.cracks), MOST_CRACKS)):
        plot_crack(model, {name: result.field}, f"{stem}_crack{crack + 1}.png", crack)
        if result.contact_resultant > 0.0:
            plot_contact({name: result}, f"{stem}_contact{crack + 1}.png", crack)


def _transient(case: Case, name: str, result: Any, model: Any, stem: str) -> None:
    from ..plot.histories import Panel, plot_histories

    points = case.tables.output.points or result.points
    panels = [
        Panel(
            f"$u_y$({point}), mm",
            {point: (result.time, result.displacement(point)[:, 1])},
            scale=MILLI,
            title="",
        )
        for point in list(points)[:4]
    ]
    if result.contact_force.shape[1]:
        panels.append(Panel("contact resultant, N", {"": (result.time, result.contact_resultant)}))
    plot_histories(panels, f"{stem}_history.png", _communicator(model))


def _periodic(case: Case, name: str, result: Any, model: Any, stem: str) -> None:
    from ..plot.curves import plot_harmonics, plot_multipliers, plot_orbit

    point = _point(case, result.points)
    if point is None:
        return
    comm = _communicator(model)
    plot_harmonics({name: result}, f"{stem}_harmonics.png", point, comm=comm)
    if result.reduced is not None:
        plot_orbit(result, f"{stem}_orbit.png", point, comm=comm)
        if len(result.multipliers):
            plot_multipliers(result, f"{stem}_multipliers.png", comm=comm)


def _curve(case: Case, name: str, result: Any, model: Any, stem: str) -> None:
    from ..plot.curves import plot_curves

    point = _point(case, result.points)
    if point is not None:
        plot_curves({name: result}, f"{stem}_curve.png", point, comm=_communicator(model))


def write_fields(kind: str, result: Any, model: Any, stem: str) -> None:
    """Write modes or static displacements for ParaView. Collective."""
    from ..results.vtu import write_vtu

    if kind == "static":
        write_vtu(f"{stem}.vtu", model, {"displacement": result.field})
    elif kind == "modal":
        shown = range(min(12, len(result.frequencies)))
        fields = {f"mode_{k + 1}_{result.frequencies[k]:.6g}_Hz": np.asarray(result.nodal(k)) for k in shown}
        write_vtu(f"{stem}.vtu", model, fields, stress=False)

"""The pictures and ParaView files of a case's results: the one place of a study that draws single results."""

from __future__ import annotations

import os
from typing import Any

from ..output_folder import make_output_folder
from ..ranks.parallel import on_root
from .case.case import Case
from .kinds.kind import Drawn


def lacking() -> str | None:
    """What is missing for pictures, in a sentence; None where they can be drawn."""
    try:
        from .. import plot  # noqa: F401
    except ImportError as error:
        return str(error)
    return None


def draw(case: Case, name: str, result: Any, model: Any, folder: str) -> None:
    """Draw what the case's [output] asks for an analysis. Collective.

    Parameters
    ----------
    case : Case
    name : str
        Analysis.
    result
        Of that analysis.
    model : Model, ReducedModel of a body, or None
        None where only a recorded result is at hand.
    folder : str
        Made if it is missing.
    """
    from mpi4py import MPI

    output, kind = case.tables.output, case.tables.analyses[name]
    comm = MPI.COMM_WORLD if model is None else model.comm
    on_root(comm, lambda: make_output_folder(folder))
    stem = os.path.join(folder, name)
    if output.pictures:
        for label, axes in kind.pictures(result, Drawn(name, output.points or (), comm)):
            _save(axes, f"{stem}_{label}.png", comm)
    if output.animation and kind.moving and model is not None:
        animate(result, stem)
    if output.vtu and kind.fields and model is not None:
        kind.write_fields(result, f"{stem}.vtu", model)


def animate(motion: Any, stem: str) -> None:
    """Draw the first crack over a motion, where there is one that keeps its fields. Collective."""
    from ..plot.animation import animate_crack

    reduced = motion.reduced
    if reduced is not None and (reduced.contact if reduced.model is None else reduced.model.cracks):
        animate_crack(motion, f"{stem}_crack1.gif")


def draw_mesh(mesh: Any, path: str, comm: Any) -> None:
    """Draw a discretisation. Collective; the mesh on rank 0 at least."""
    from ..plot.meshes import plot_discretisation

    _save(plot_discretisation(mesh, comm=comm), path, comm)


def _save(axes: Any, path: str, comm: Any) -> None:
    """Write a picture on rank 0, where its axes are."""
    from ..plot.drawing import save_picture

    on_root(comm, lambda: save_picture(axes, path))

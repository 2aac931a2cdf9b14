"""The pictures and ParaView files of a case's results: the one place of a study that draws single results."""

from __future__ import annotations

import functools
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
        from ..plot.drawing import save_picture

        for label, axes in kind.pictures(result, Drawn(name, output.points or (), comm)):
            on_root(comm, functools.partial(save_picture, axes, f"{stem}_{label}.png"))
    if output.animation and kind.moving and model is not None:
        from ..plot.animation import animate_crack

        # the first crack, where there is one and its fields are kept
        reduced = result.reduced
        if reduced is not None and (reduced.contact if reduced.model is None else reduced.model.cracks):
            animate_crack(result, f"{stem}_crack1.gif")
    if output.vtu and kind.fields and model is not None:
        kind.write_fields(result, f"{stem}.vtu", model)

"""The small picture beside a result's table in a notebook."""

from __future__ import annotations

import importlib
from collections.abc import Callable
from typing import Any

from ..petsc import MPI
from .drawing import each, png

plot: Any = importlib.import_module(__package__)  # which loads what is drawn alone
# Modes that are shown.
_MODES = 4
# Pictures by the names of the results' classes, of the first named point; a static solution's of the first
# crack, or of the body where there is none.
_PICTURES: dict[str, Callable[[Any], Any]] = {
    "Backbone": lambda result: plot.plot_backbone(result),
    "Basins": lambda result: plot.plot_basins(result),
    "Branch": lambda result: plot.plot_branches(result, result.points[0]),
    "History": lambda result: plot.plot_history(result, result.points[0]),
    "LoadHistory": lambda result: plot.plot_load_history(result, result.points[0]),
    "Locus": lambda result: plot.plot_loci(result),
    "Modal": lambda result: plot.plot_modes(result, range(min(_MODES, len(result.frequencies)))),
    "Orbit": lambda result: plot.plot_orbit(result, result.points[0]),
    "QuasiPeriodic": lambda result: plot.plot_lines(result, result.points[0]),
    "QuasiPeriodicBranch": lambda result: plot.plot_quasi_periodic(result, result.points[0]),
    "Static": lambda result: (plot.plot_crack if result.model and result.model.cracks else plot.plot_field)(
        result.model, {"": result}
    ),
    "SweptResponse": lambda result: plot.plot_swept(None, result, result.points[0]),
}


def small_picture(result: Any) -> bytes | None:
    """PNG of what a result is mostly drawn as; None where nothing is, and on several ranks, which would have
    to draw together.
    """
    draw = _PICTURES.get(type(result).__name__)
    if draw is None or MPI.COMM_WORLD.size > 1:
        return None
    try:
        return png(each(draw(result))[0])
    except (LookupError, TypeError, ValueError, RuntimeError):
        return None  # read from a file without what it shows

"""The small picture beside a result's table in a notebook."""

from __future__ import annotations

import importlib
from typing import Any

from matplotlib.axes import Axes

from ..petsc import MPI
from .drawing import png

# Modes that are shown.
_MODES = 4
# Pictures by the names of the results' classes: of all there is, and of the first named point.
_WHOLE = {"Backbone": "plot_backbone", "Basins": "plot_basins", "Locus": "plot_loci"}
_OF_POINT = {
    "Branch": "plot_branches",
    "History": "plot_history",
    "LoadHistory": "plot_load_history",
    "Orbit": "plot_orbit",
    "QuasiPeriodic": "plot_lines",
    "QuasiPeriodicBranch": "plot_quasi_periodic",
}


def small_picture(result: Any) -> bytes | None:
    """PNG of what a result is mostly drawn as; None where nothing is, and on several ranks, which would have
    to draw together.
    """
    if MPI.COMM_WORLD.size > 1:
        return None
    try:
        drawn = _drawn(type(result).__name__, result)
    except (KeyError, TypeError, ValueError, RuntimeError):  # read from a file without what it shows
        return None
    first = drawn if isinstance(drawn, Axes) else next(iter(drawn or ()), None)
    return None if first is None else png(first)


def _drawn(name: str, result: Any) -> Any:
    """Axes of a result of a class."""
    plot = importlib.import_module(__package__)  # which loads what is drawn alone
    if name in _WHOLE:
        return getattr(plot, _WHOLE[name])(result)
    if name in _OF_POINT and result.points:
        return getattr(plot, _OF_POINT[name])(result, result.points[0])
    if name == "SweptResponse" and result.points:
        return plot.plot_swept(None, result, result.points[0])
    if name == "Modal":
        return plot.plot_modes(result, range(min(_MODES, len(result.frequencies))))
    if name == "Static" and result.model is not None:  # the first crack, or the body where there is none
        return (plot.plot_crack if result.model.cracks else plot.plot_field)(result.model, {"": result})
    return None

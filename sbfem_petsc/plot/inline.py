"""The small picture beside a result's table in a notebook."""

from __future__ import annotations

from typing import Any

from matplotlib.axes import Axes

from ..petsc import MPI
from .basins import plot_basins
from .bodies import plot_field
from .branches import plot_branches
from .crack import plot_crack
from .drawing import png
from .fields import plot_modes
from .histories import plot_history, plot_load_history
from .loci import plot_loci
from .orbits import plot_orbit
from .sweeps import plot_swept
from .tones import plot_backbone, plot_lines, plot_quasi_periodic

# Modes that are shown.
_MODES = 4
# Pictures by the names of the results' classes: of all there is, and of the first named point.
_WHOLE: dict[str, Any] = {"Backbone": plot_backbone, "Basins": plot_basins, "Locus": plot_loci}
_OF_POINT: dict[str, Any] = {
    "Branch": plot_branches,
    "History": plot_history,
    "LoadHistory": plot_load_history,
    "Orbit": plot_orbit,
    "QuasiPeriodic": plot_lines,
    "QuasiPeriodicBranch": plot_quasi_periodic,
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
    if name in _WHOLE:
        return _WHOLE[name](result)
    if name in _OF_POINT and result.points:
        return _OF_POINT[name](result, result.points[0])
    if name == "SweptResponse" and result.points:
        return plot_swept(None, result, result.points[0])
    if name == "Modal":
        return plot_modes(result, range(min(_MODES, len(result.frequencies))))
    if name == "Static" and result.model is not None:  # the first crack, or the body where there is none
        return (plot_crack if result.model.cracks else plot_field)(result.model, {"": result})
    return None

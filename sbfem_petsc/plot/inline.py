"""The small picture beside a result's table in a notebook."""

from __future__ import annotations

import functools
from collections.abc import Callable
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


def small_picture(result: Any) -> bytes | None:
    """PNG of what a result is mostly drawn as; None where nothing is, and on several ranks, which would have
    to draw together.
    """
    draw = _DRAWN.get(type(result).__name__)
    if draw is None or MPI.COMM_WORLD.size > 1:
        return None
    try:
        drawn = draw(result)
    except (
        KeyError,
        TypeError,
        ValueError,
        RuntimeError,
    ):  # read from a file without what it shows
        return None
    first = drawn if isinstance(drawn, Axes) else next(iter(drawn or ()), None)
    return None if first is None else png(first)


def _at_first(draw: Callable[..., Any], result: Any) -> Any:
    """Of the first named point, where there is one."""
    return draw(result, result.points[0]) if result.points else None


def _modes(result: Any) -> Any:
    return plot_modes(result, range(min(_MODES, len(result.frequencies))))


def _static(result: Any) -> Any:
    """The first crack, or the body where there is none; nothing of a result without its model."""
    model = result.model
    if model is None:
        return None
    return (plot_crack if model.cracks else plot_field)(model, {"": result})


_DRAWN: dict[str, Callable[[Any], Any]] = {
    "Backbone": plot_backbone,
    "Basins": plot_basins,
    "Branch": functools.partial(_at_first, plot_branches),
    "History": functools.partial(_at_first, plot_history),
    "LoadHistory": functools.partial(_at_first, plot_load_history),
    "Locus": plot_loci,
    "Modal": _modes,
    "Orbit": functools.partial(_at_first, plot_orbit),
    "QuasiPeriodic": functools.partial(_at_first, plot_lines),
    "QuasiPeriodicBranch": functools.partial(_at_first, plot_quasi_periodic),
    "Static": _static,
    "SweptResponse": functools.partial(_at_first, functools.partial(plot_swept, None)),
}

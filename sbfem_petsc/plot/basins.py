"""Basins of attraction over the plane of two initial values."""

from __future__ import annotations

import math
from itertools import cycle
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap, to_rgb

from ..continuation.basins import Basins, StartAxis
from ..petsc import MPI
from .drawing import BLACK, CYCLE, Scale, dots, legend
from .picture import picture

UNSETTLED = "#BBBBBB"
# Share of white in the colour of a basin, in which the orbits' marks are to be seen.
LIGHT = 0.55


@picture(Basins)
def plot_basins(
    basins: Basins, *, title: str = "", ax: Any = None, comm: MPI.Comm | None = None
) -> Axes | None:
    """Draw which orbit each initial state of a grid of two axes leads to. Collective.

    The orbits' own states at t = 0 are marked where they fall in the plane, unstable ones by a cross; of a
    model with several modes they are its two coordinates alone. What has not settled is grey.

    Parameters
    ----------
    basins : Basins
        Of two axes with at least two values each; on rank 0 at least.
    title, ax, comm
        As for `plot_branches`.

    Returns
    -------
    Axes on rank 0, None elsewhere; `save_picture` writes them

    Raises
    ------
    TypeError, ValueError
        For something else than basins over two axes.
    """
    if len(basins.axes) != 2 or min(basins.reached.shape) < 2:
        raise ValueError(
            f"plot_basins: basins has {len(basins.axes)} axes and the shape {basins.reached.shape}; a "
            "grid of two axes with at least two values each is expected"
        )
    scales = across, up = [_scale(axis) for axis in basins.axes]
    first, second = (scale(axis.values) for scale, axis in zip(scales, basins.axes))
    colours = [colour for colour, _ in zip(cycle(CYCLE), basins.orbits)]
    pale = [tuple((1.0 - LIGHT) * np.array(to_rgb(colour)) + LIGHT) for colour in colours]
    (axes,) = ax.panels((1, 1), 3.6, 5.2)
    look: Any = {"cmap": ListedColormap([to_rgb(UNSETTLED), *pale]), "vmin": -1.5, "vmax": len(pale) - 0.5}
    axes.pcolormesh(first, second, basins.reached.T, shading="nearest", rasterized=True, **look)
    for k, (orbit, share, colour) in enumerate(zip(basins.orbits, basins.share, colours)):
        x, y = _place(basins, orbit.state)
        times = f"{orbit.periods} periods" if orbit.periods > 1 else "1 period"
        reached = f"{100.0 * share:.3g} %" if orbit.stable is not False else "unstable"
        edge = {"markeredgecolor": BLACK, "markeredgewidth": 0.8, "label": f"orbit {k}, {times}: {reached}"}
        dots(axes, (across(x), up(y)), "X" if orbit.stable is False else "o", 6, colour, **edge)
    if (basins.reached < 0).any():
        dots(axes, ([], []), "s", 6, UNSETTLED, label="not settled")
    axes.set(xlabel=across.label, ylabel=up.label, xlim=first[[0, -1]], ylim=second[[0, -1]])
    legend(axes, loc="upper left", bbox_to_anchor=(1.0, 1.0))
    return axes


def _scale(axis: StartAxis) -> Scale:
    """Of an axis, in a unit that suits its values."""
    top = max(map(abs, axis.values))
    if "kg" not in axis.unit or not top > 0.0:
        return Scale.of(axis.quantity, axis.unit, axis.values)
    exponent = 3 * math.floor(math.log10(top) / 3.0)  # of units that have no smaller ones
    unit = f"$10^{{{exponent}}}$ {axis.unit}" if exponent else axis.unit
    return Scale(10.0**-exponent, f"{axis.quantity} ({unit})")


def _place(basins: Basins, state: np.ndarray) -> tuple[float, float]:
    """Values on both axes of a state's projection on the plane of the axes, which may be oblique."""
    corner = basins.states[0, 0]
    directions = [
        (other - corner) / (axis.values[1] - axis.values[0])
        for axis, other in zip(basins.axes, (basins.states[1, 0], basins.states[0, 1]))
    ]
    found = np.linalg.lstsq(np.array(directions).T, state - corner, rcond=None)[0]
    return basins.axes[0].values[0] + float(found[0]), basins.axes[1].values[0] + float(found[1])

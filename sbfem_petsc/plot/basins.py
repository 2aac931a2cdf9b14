"""Basins of attraction over the plane of two initial values."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap, to_rgb

from ..continuation.basins import Basins, StartAxis
from ..petsc import MPI
from ..record.units import suited
from .drawing import BLACK, CYCLE, Sheet, dots
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
    (across, x_label), (up, y_label) = (_scale(axis) for axis in basins.axes)
    first, second = (factor * np.array(axis.values) for factor, axis in zip((across, up), basins.axes))
    count = len(basins.orbits)
    colours = [CYCLE[k % len(CYCLE)] for k in range(count)]
    pale = [(1.0 - LIGHT) * np.array(to_rgb(colour)) + LIGHT for colour in colours]
    (axes,) = Sheet.of(ax).panels((1, 1), 3.6, 5.2)
    axes.pcolormesh(
        first,
        second,
        basins.reached.T,
        cmap=ListedColormap([to_rgb(UNSETTLED), *map(tuple, pale)]),
        vmin=-1.5,
        vmax=count - 0.5,
        shading="nearest",
        rasterized=True,
    )
    share = basins.share
    for k, orbit in enumerate(basins.orbits):
        x, y = _place(basins, orbit.state)
        times = f"{orbit.periods} periods" if orbit.periods > 1 else "1 period"
        reached = f"{100.0 * share[k]:.3g} %" if orbit.stable is not False else "unstable"
        edge = {"markeredgecolor": BLACK, "markeredgewidth": 0.8, "label": f"orbit {k}, {times}: {reached}"}
        dots(axes, (x * across, y * up), "X" if orbit.stable is False else "o", 6, colours[k], **edge)
    if (basins.reached < 0).any():
        dots(axes, ([], []), "s", 6, UNSETTLED, label="not settled")
    axes.set(xlabel=x_label, ylabel=y_label, xlim=first[[0, -1]], ylim=second[[0, -1]])
    axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0))
    return axes


def _scale(axis: StartAxis) -> tuple[float, str]:
    """Factor on the values of an axis, and its label, in a unit that suits them."""
    factor, unit = suited(axis.unit, axis.values)
    if "kg" in unit:  # which has no smaller ones
        top = max(map(abs, axis.values))
        exponent = 3 * math.floor(math.log10(top) / 3.0) if top > 0.0 else 0
        factor, unit = 10.0**-exponent, f"$10^{{{exponent}}}$ {unit}" if exponent else unit
    return factor, f"{axis.quantity} ({unit})"


def _place(basins: Basins, state: np.ndarray) -> tuple[float, float]:
    """Values on both axes of a state's projection on the plane of the axes, which may be oblique."""
    corner = basins.states[0, 0]
    directions = [
        (other - corner) / (axis.values[1] - axis.values[0])
        for axis, other in zip(basins.axes, (basins.states[1, 0], basins.states[0, 1]))
    ]
    found = np.linalg.lstsq(np.array(directions).T, state - corner, rcond=None)[0]
    return basins.axes[0].values[0] + float(found[0]), basins.axes[1].values[0] + float(found[1])
